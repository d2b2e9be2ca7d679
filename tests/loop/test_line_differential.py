"""Sets between two relays of a line: clocks, alignment, and the function on top, without plant or bus."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from faultloop.io.can.frames import Frame, Rejection
from faultloop.loop.phasors import give_first, say_first
from faultloop.nodes.clock import FOREVER
from faultloop.nodes.relay import RelayNode
from faultloop.relay import layout
from faultloop.relay.functions.pdif import PDIF, agreement
from faultloop.relay.layout import Instance
from faultloop.relay.recent import LENGTH
from faultloop.relay.settings import RelaySettings
from tests.relay.functions.kernel import GIVEN, TURN

MS = 1_000_000
HZ = 4800
SQRT2 = np.sqrt(2)


class End:
    """A relay's function and its node, with steady currents."""

    def __init__(self, number: int, clock: tuple[int, int, int] = (0, 0, FOREVER), **table: Any) -> None:
        settings = RelaySettings.from_dict(GIVEN | {"pdif": {"pickup_a": 200.0} | table})
        place = Instance("PDIF1", PDIF, settings.pdif, 0, 0)
        self.constants = layout.constants(settings, 96, [place])
        self.state = layout.initial_state()
        self.node = RelayNode(
            number, 0, [1 - number], 1.0, 0.0, linked=[1 - number], agreement=agreement(settings)
        )
        self.node.set_clock(*clock)
        self.q, self.w = self.state["shared"], self.state["pdif"][0, :1]
        self.q["settled"] = 1
        self.sent: list[tuple[int, Frame]] = []

    def step(self, k: int, currents: Any, hz: float = 50.0, then: Sequence[tuple[int, Any]] = ()) -> None:
        """Sample k of a sinusoid of these phasors (3,); of others from a sample on."""
        numbers = np.arange(k - LENGTH + 1, k + 1)
        turn = np.exp(2j * np.pi * hz * numbers / HZ)[:, None]
        for at_k, others in then:
            currents = np.where((numbers >= at_k)[:, None], others, currents)
        waves = SQRT2 * np.real(turn * currents)
        self.q["recent"]["value"][0, :, 3:6] = waves
        self.q["recent"]["head"] = LENGTH - 1
        self.q["number"], self.q["request"]["made"], self.q["pickup"] = k, 0, 0
        before = int(self.q["phasors"][0])
        c, s = self.constants.view(np.recarray)[0], self.state.view(np.recarray)[0]
        PDIF.step(c.shared, s.shared, c.pdif[0], s.pdif[0])
        t_ns = k * 1_000_000_000 // HZ
        if int(self.q["phasors"][0]) != before:
            say_first(self.node.nodes, 0, self.constants, self.state, t_ns)
            self.sent += [(t_ns, frame) for frame in self.node.poll(t_ns) if frame.id & ~0xF == 0x040]

    def take(self, t_ns: int, frame: Frame) -> None:
        if self.node.receive(t_ns, frame):
            give_first(self.node.nodes, 0, self.constants, self.state)

    @property
    def trips(self) -> bool:
        return bool(self.q["request"]["made"][0])

    def sums(self) -> Any:
        """Of the newest complete set, (3,)."""
        slot = int(self.w["last"][0]) % 16
        return self.w["own"]["i"][0, slot] + self.w["remote"]["set"]["i"][0, 0, slot]


def run(
    ends: tuple[End, End],
    currents: Any,
    delays_ms: tuple[float, float] | Callable[[int], tuple[float, float]] = (5.0, 5.0),
    samples: int = 960,
    hz: float = 50.0,
    then: Sequence[tuple[int, Any]] = (),
    lost: Callable[[int, int], bool] = lambda number, to: False,
) -> list[bool]:
    """Whether each has wanted to trip, after so many samples; ``delays_ms``: of the ways from 0 and from 1,
    at a sample; ``then``: other currents from a sample on; ``lost``: whether the set of that number to that
    end is."""
    line: list[tuple[int, int, Frame]] = []
    last_ns = [0, 0]
    wanted = [False, False]
    for k in range(samples):
        t_ns = k * 1_000_000_000 // HZ
        for due_ns, to, frame in [item for item in line if item[0] <= t_ns]:
            ends[to].take(due_ns, frame)
        line = [item for item in line if item[0] > t_ns]
        for n, end in enumerate(ends):
            end.step(k, currents[n], hz, [(at_k, others[n]) for at_k, others in then])
            way_ms = (delays_ms(k) if callable(delays_ms) else delays_ms)[n]
            for at_ns, frame in end.sent:
                if not lost(int(end.w["index"][0]), 1 - n):
                    last_ns[n] = max(last_ns[n], at_ns + round(way_ms * MS))  # nothing overtakes
                    line.append((last_ns[n], 1 - n, frame))
            end.sent = []
            wanted[n] |= end.trips
    return wanted


THROUGH = (1000 * TURN, -1000 * TURN)


def test_what_flows_through_cancels_and_a_fault_does_not() -> None:
    ends = End(0), End(1)
    assert run(ends, THROUGH) == [False, False]
    assert np.abs(ends[0].sums()).max() < 0.02  # two roundings to 10 mA
    fault = (1000 * TURN, [800, *(-1000 * TURN[1:])])
    ends = End(0), End(1)
    assert run(ends, fault, samples=400) == [True, True]
    assert ends[0].w["count"][0].tolist()[1:3] == [0, 0]  # phases B and C restrain


@pytest.mark.parametrize("hz", [47.0, 49.0, 52.0])
def test_off_nominal_what_flows_through_cancels_too(hz: float) -> None:
    """One linear filter at both ends: |sum| < 5 % of the current at any frequency."""
    ends = End(0), End(1)
    assert run(ends, THROUGH, hz=hz) == [False, False]
    assert np.abs(ends[1].sums()).max() < 0.1


def test_an_offset_of_a_global_clock_is_an_angle() -> None:
    """100 us are 1.8 degrees at 50 Hz: 2 * 1000 A * sin(0.9 degrees)."""
    ends = End(0), End(1, (100_000, 0, FOREVER))
    run(ends, THROUGH, samples=480)
    expected = 2000 * np.sin(np.radians(0.9))
    np.testing.assert_allclose(np.abs(ends[0].sums()), expected, rtol=0.02)


def test_by_the_round_trip_clocks_may_differ_and_drift() -> None:
    clocks = (0, 0, 0), (123_456_789, 50_000, 0)  # 123 ms and 50 ppm
    ends = tuple(End(n, clock, alignment="channel") for n, clock in enumerate(clocks))
    assert run(ends, THROUGH, samples=1440) == [False, False]  # type: ignore[arg-type]
    assert np.abs(ends[0].sums()).max() < 2.0  # some microseconds of the means' lag
    assert ends[0].w["last"][0] > 0


@pytest.mark.parametrize(
    ("amperes", "asymmetry_ms", "characteristic", "trips"),
    [
        (1000, 3.0, "percentage", False),
        (1000, 3.5, "percentage", True),  # 3.22 ms in closed form
        (2000, 2.3, "percentage", False),
        (2000, 2.8, "percentage", True),  # 2.56 ms
        (1000, 5.0, "alpha", False),
        (2000, 5.0, "alpha", False),
    ],
)
def test_asymmetry_of_the_round_trip(
    amperes: float, asymmetry_ms: float, characteristic: str, trips: bool
) -> None:
    keys = {"alignment": "channel", "characteristic": characteristic, "sequence": False}
    ends = End(0, **keys), End(1, **keys)
    delays = 5 + asymmetry_ms / 2, 5 - asymmetry_ms / 2
    wanted = run(ends, (amperes * TURN, -amperes * TURN), delays, samples=700)
    assert wanted == [trips, trips]


def test_a_time_that_is_lost_blocks_and_is_told() -> None:
    """One end's clock drifts off by 500 ppm from 50 ms on; both know, and nobody trips."""
    ends = End(0), End(1, (0, 500_000_000, 50 * MS))
    assert run(ends, THROUGH, samples=960) == [False, False]
    assert ends[0].w["out_of_time"][0] == 1
    assert int(ends[0].q["pickup"][0]) >> 4 & 1  # ChBlk


@pytest.mark.parametrize(
    ("characteristic", "jump_ms"),
    [
        *(("alpha", -4.0), ("percentage", 9.0)),
        *(pytest.param("alpha", ms, marks=pytest.mark.slow) for ms in (1.5, 9.0)),
        *(pytest.param("percentage", ms, marks=pytest.mark.slow) for ms in (-4.0, 1.5)),
    ],
)
def test_a_clock_that_jumps_makes_no_trip(characteristic: str, jump_ms: float) -> None:
    """Of one end, by the round trip: both refuse the other's sets, and are aligned again within 150 ms."""
    keys: dict[str, Any] = {"alignment": "channel", "characteristic": characteristic}
    ends = End(0, **keys), End(1, **keys)

    def lost(number: int, to: int) -> bool:
        if number == 40:
            ends[1].node.set_clock(round(jump_ms * MS), 0, FOREVER)
        return False

    assert run(ends, THROUGH, samples=480 + 720, lost=lost) == [False, False]
    assert all(end.node.rejected[Rejection.JUMP] > 2 for end in ends)
    assert [int(end.w["age"][0]) < 40 for end in ends] == [True, True]
    assert np.abs(ends[0].sums()).max() < 60.0  # what the mean has not yet followed


def test_sets_that_are_missing_make_no_trip() -> None:
    ends = End(0), End(1)
    run(ends, THROUGH, samples=300)
    for k in range(300, 1100):  # nothing arrives, and the current of this end grows
        ends[0].step(k, 5000 * TURN)
        assert not ends[0].trips
    assert ends[0].w["losses"][0] == 1


@pytest.mark.parametrize(
    ("then", "outside"),
    [
        ((1000j * TURN, -1000j * TURN), True),  # turned
        ((1500 * TURN, -1500 * TURN), True),
        ((1500 * TURN, 900 * TURN), False),
        ((1500 * TURN, -400 * TURN), False),  # one end goes on taking load out
    ],
)
def test_a_fault_outside_is_known_from_the_first_set_on(then: Any, outside: bool) -> None:
    """Within half a cycle, before a current transformer has had the time to saturate."""
    ends = End(0), End(1)
    load = 500 * TURN, -500 * TURN
    run(ends, load, (0.0, 0.0), samples=480 + 48, then=[(480, then)])
    assert [int(end.w["external"][0]) > 0 for end in ends] == [outside, outside]


@pytest.mark.parametrize("hz", [47.0, 53.0])
def test_off_nominal_load_is_no_fault_outside(hz: float) -> None:
    ends = End(0), End(1)
    run(ends, THROUGH, samples=480, hz=hz)
    assert int(ends[0].w["external"][0]) == 0


def test_nothing_is_compared_with_a_set_that_never_came() -> None:
    """The set of instant 0 is none because nobody has written there yet."""
    ends = End(0), End(1)
    for k in range(12):
        ends[0].step(k, 5000 * TURN)
        give_first(ends[0].node.nodes, 0, ends[0].constants, ends[0].state)
    assert int(ends[0].w["last"][0]) == -1 and not ends[0].w["count"][0].any()


def test_a_set_that_is_lost_at_the_beginning_is_no_fault_outside() -> None:
    """What is compared with is the set of a cycle ago, and not what stood in its place before."""
    ends = End(0), End(1)
    run(ends, THROUGH, samples=480, lost=lambda number, to: number in (5, 9, 10, 30))
    assert [int(end.w["external"][0]) for end in ends] == [0, 0]


def unbalanced(amperes: float) -> Any:
    """Load through the line, and a fault current in phase A that is half of each end's."""
    part = np.array([amperes, 0, 0])
    return 200 * TURN + part, -200 * TURN + part


def chance(seed: int, share: float) -> Callable[[int, int], bool]:
    """Sets lost at random."""
    draws = np.random.default_rng(seed).random((400, 2)) < share
    return lambda number, to: bool(draws[number, to])


@pytest.mark.parametrize(("share", "most_sets"), [(0.0, 11), (0.05, 14), (0.2, 18)])
def test_the_sequence_elements_pass_over_what_is_lost(share: float, most_sets: int) -> None:
    """190 A in all are below the pickup of a phase: 8 sets of the sequence, not counting those that are lost.
    The filter shows enough of them in the third."""
    for seed in range(2):
        ends = End(0), End(1)
        samples = 480 + 12 * (most_sets + 3)  # and the channel's delay
        keys: dict[str, Any] = {"then": [(480, unbalanced(95.0))], "lost": chance(seed, share)}
        for end in ends:
            end.constants["pdif"]["rule"]["pickup"][0, 0, 1:] = 20.0
        assert run(ends, unbalanced(0.0), samples=samples, **keys) == [True, True], seed


def test_losses_make_no_trip_of_what_was_too_short() -> None:
    """Seven sets of the sequence, then none, whatever is lost of them and after them."""
    for seed in range(4):
        ends = End(0), End(1)
        short = [(480, unbalanced(95.0)), (480 + 48, unbalanced(0.0))]
        for end in ends:
            end.constants["pdif"]["rule"]["pickup"][0, 0, 1:] = 20.0
        keys: dict[str, Any] = {"then": short, "lost": chance(seed, 0.3)}
        assert run(ends, unbalanced(0.0), samples=612, **keys) == [False, False]


@pytest.mark.parametrize(("gap", "count"), [(0, 6), (2, 4), (3, 2)])
def test_more_than_two_lost_sets_in_a_row_begin_the_count_anew(gap: int, count: int) -> None:
    """Of the six that have shown it by then, the second and those after it are lost."""
    ends = End(0), End(1)
    for end in ends:
        end.constants["pdif"]["rule"]["pickup"][0, 0, 1:] = 20.0
    run(
        ends, unbalanced(0.0), samples=620, then=[(480, unbalanced(95.0))],
        lost=lambda number, to: 45 <= number < 45 + gap,
    )  # fmt: skip
    assert [end.w["count"][0, 3] for end in ends] == [count, count]


@pytest.mark.parametrize("characteristic", ["alpha", "percentage"])
@pytest.mark.parametrize(
    ("amperes", "open_ct", "trips"),
    [
        (150, "block", False),
        (1000, "block", False),
        (3000, "block", False),
        (150, "trip", False),
        (1000, "trip", True),
    ],
)
def test_a_current_transformer_whose_circuit_opens(
    amperes: float, open_ct: str, trips: bool, characteristic: str
) -> None:
    """At this end, and as the other end sees it: neither trips, both tell; a fault in another phase does."""
    keys: dict[str, Any] = {"open_ct": open_ct, "characteristic": characteristic}
    ends = End(0, **keys), End(1, **keys)
    load = amperes * TURN, -amperes * TURN
    opened = amperes * TURN * [0, 1, 1], -amperes * TURN
    wanted = run(ends, load, samples=480, then=[(240, opened)])
    assert wanted == [trips, trips]
    if open_ct == "block":
        told = [int(end.q["pickup"][0]) >> 5 & 1 for end in ends]
        assert told == [1, 1]
        ends = End(0, **keys), End(1, **keys)
        fault = opened[0] + [0, 20_000, 0], opened[1] + [0, 15_000, 0]
        later = [(240, opened), (480, fault)]
        assert run(ends, load, samples=480 + 96, then=later) == [True, True]


@pytest.mark.parametrize("characteristic", ["alpha", "percentage"])
@pytest.mark.parametrize("left", [[0, 1, 1], [0, 0, 1], [0, 0, 0]])
def test_circuits_that_open_and_are_whole_again(left: list[int], characteristic: str) -> None:
    """One of them, two, all three: nobody trips, neither while the filter loses a current nor while it finds
    one again; then all phases count."""
    ends = tuple(End(n, characteristic=characteristic) for n in range(2))
    load, opened = (1000 * TURN, -1000 * TURN), (1000 * TURN * left, -1000 * TURN)
    assert run(ends, load, samples=480, then=[(240, opened)]) == [False, False]  # type: ignore[arg-type]
    lost = sum(1 << phase for phase in range(3) if not left[phase])
    assert [int(end.w["opened"][0].max()) for end in ends] == [lost, lost]
    ends = tuple(End(n, characteristic=characteristic) for n in range(2))
    wanted = run(ends, load, samples=720, then=[(240, opened), (480, load)])  # type: ignore[arg-type]
    assert wanted == [False, False]
    assert [int(end.w["opened"].any()) for end in ends] == [0, 0]


@pytest.mark.parametrize("left", [0.0, 0.3, 0.7])
def test_a_fault_inside_that_takes_a_current_away_is_no_open_circuit(left: float) -> None:
    """The far end feeds it, and this end's load goes elsewhere: another current changes, too."""
    ends = End(0), End(1)
    load = 1000 * TURN, -1000 * TURN
    fault = 1000 * TURN * [left, 1, 1], -1000 * TURN + [3000, 0, 0]
    assert run(ends, load, samples=600, then=[(480, fault)]) == [True, True]


def test_a_transferred_trip_that_is_not_said_any_more_is_over() -> None:
    """The far end's sets say that it trips; then its channel is silent."""
    ends = End(0, characteristic="alpha"), End(1)
    fault = (1000 * TURN, [800, *(-1000 * TURN[1:])])
    assert run(ends, fault, samples=560, lost=lambda number, to: number > 25) == [True, True]
    assert int(ends[0].w["remote"]["transfers"][0, 0]) >= 2
    assert not ends[0].trips
