"""PSCH by itself: what is sent and tripped for what is seen and received, in the order of time.

Expected times and outcomes are those of the makers' manuals, as docs/relay.md has them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import RelaySettings
from faultloop.relay.functions.psch import PSCH
from tests.relay.functions.kernel import GIVEN, TURN, Kernel

ZONES = [
    {"zone": 1, "direction": "forward", "characteristic": "mho", "reach_pu": 0.8},
    {"zone": 2, "direction": "forward", "characteristic": "mho", "reach_pu": 1.5, "delay_ms": 350},
    {"zone": 3, "direction": "reverse", "characteristic": "mho", "reach_pu": 0.5},
]
Z1, Z2, Z3 = 1, 2, 4
MS = 4.8
TX, RX, BLOCK, ECHO, WEAK, LOST = range(1, 7)


class Scheme(Kernel):
    """A relay's PSCH, its zones and the signal as they are told."""

    def __init__(self, **table: Any) -> None:
        relay = GIVEN["relay"] | {"nominal_kv": 220}
        super().__init__(PSCH, table, pdis=ZONES, relay=relay)
        self.rx = self.transferred = 0
        self.q["x"][:3] = 127e3 * TURN
        self.samples = 0

    def run(self, ms: float, zones: int = 0, fault: int = 1, **more: Any) -> Scheme:
        """So long with these zones started; nothing of them, and it is undisturbed."""
        seen = zones != 0
        self.q["received"] = self.q["received_all"] = self.rx
        self.q["transferred"] = self.transferred
        self.q["disturbed"] = self.q["fed"] = seen
        self.q["fault"] = fault if seen else 0
        self.q["direction"] = 0 if not seen else -1 if zones & Z3 else 1
        self.step(count=round(ms * MS), **({"zones": zones} | more))
        return self

    def bit(self, place: int) -> bool:
        return bool(int(self.q["pickup"]) >> place & 1)

    @property
    def trips(self) -> int:
        """Mask of the poles it wants to trip; 0: none."""
        request = self.q["request"]
        if not request["made"]:
            return 0
        fault = int(request["fault"])
        return 1 << (fault - 1) if fault <= 3 and not request["three_pole"] else 7

    def until_trip(self, ms: float, zones: int = 0, **more: Any) -> float:
        """How long [ms] until it wants to trip; infinite where it does not within that time."""
        for n in range(round(ms * MS)):
            self.run(1 / MS, zones, **more)
            if self.trips:
                return (n + 1) / MS
        return np.inf


def test_permissive_overreach_trips_on_zone_and_signal_together() -> None:
    end = Scheme(type="pott").run(20, Z2)
    assert end.bit(TX) and end.q["pilot"] == 1 and not end.trips
    end.rx = 1
    assert end.until_trip(20, Z2) == pytest.approx(4.0, abs=0.5)  # coincidence_ms
    assert end.trips == 1  # the pole of A-G
    assert end.bit(RX)


@pytest.mark.parametrize(("zones", "rx"), [(0, 7), (Z3, 7), (Z2, 0)])
@pytest.mark.parametrize("kind", ["pott", "putt"])
def test_a_permissive_scheme_wants_both(kind: str, zones: int, rx: int) -> None:
    end = Scheme(type=kind)
    end.rx = rx
    assert end.until_trip(200, zones) == np.inf


def test_a_coincidence_shorter_than_a_relays_transient_is_none() -> None:
    """3.1 ms was the longest of a healthy line beside a strong source (144 runs)."""
    end = Scheme(type="pott")
    end.rx = 7
    assert end.until_trip(3.1, Z2) == np.inf
    assert end.run(1).until_trip(3.1, Z2) == np.inf
    assert Scheme(type="pott", coincidence_ms=0).run(0).until_trip(3.1, Z2) == np.inf  # nothing received


def test_underreach_sends_zone_one_alone() -> None:
    assert not Scheme(type="putt").run(20, Z2).bit(TX)
    assert Scheme(type="putt").run(20, Z1 | Z2).bit(TX)
    assert Scheme(type="dutt").run(20, Z1 | Z2).bit(TX)
    end = Scheme(type="dutt")
    end.rx = 1
    assert end.until_trip(20) < 1.0  # whatever it sees


def test_blocking_trips_after_the_coordination_time_unless_blocked() -> None:
    assert Scheme(type="dcb").until_trip(50, Z2) == pytest.approx(10.0, abs=0.5)
    far = Scheme(type="dcb")
    assert far.run(1, Z3).bit(TX) and far.q["pilot"] == 7
    near = Scheme(type="dcb").run(5, Z2)
    near.rx = 7
    assert near.until_trip(200, Z2) == np.inf
    near.rx = 0  # the signal is lost: it overreaches, which is what the scheme is known for
    assert near.until_trip(50, Z2) == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize(("hold", "trips"), [(60.0, False), (0.0, True)])
def test_current_reversal(hold: float, trips: bool) -> None:
    """Behind for 40 ms, then ahead for 30 while the far end's signal still stands."""
    end = Scheme(type="pott", reverse_hold_ms=hold)
    end.rx = 7
    end.run(40, Z3)
    assert (end.until_trip(30, Z2) < np.inf) == trips
    assert end.bit(BLOCK) != trips
    if not trips:  # and where the fault then is on this line, it is not for good
        assert end.until_trip(60, Z2) == pytest.approx(60 - 30 + 4, abs=1)


def test_a_fault_behind_for_a_moment_does_not_hold() -> None:
    end = Scheme(type="pott")
    end.rx = 1
    assert end.run(10, Z3).until_trip(30, Z2) == pytest.approx(4.0, abs=0.5)


def test_the_echo_once_and_then_a_lockout() -> None:
    end = Scheme(type="pott", weak_infeed="echo")
    end.rx = 1
    assert not end.run(9).bit(ECHO)
    assert end.run(2).bit(ECHO) and end.q["pilot"] == 1
    assert end.run(95).bit(ECHO)
    assert not end.run(10).bit(ECHO)
    assert not end.run(1000).bit(ECHO)  # stuck: no second one
    assert end.w["strangers"] == 1  # and it is told
    end.rx = 0
    end.run(100)
    end.rx = 1
    assert not end.run(50).bit(ECHO)  # 250 ms of lockout
    end.rx = 0
    end.run(260)
    end.rx = 1
    assert end.run(50).bit(ECHO)
    assert not end.trips


def test_two_echoing_ends_do_not_ring() -> None:
    """A signal of 20 ms in, and what each end then says to the other, 5 ms apart."""
    ends = [Scheme(type="pott", weak_infeed="echo") for _ in range(2)]
    line = [[0] * 24 for _ in range(2)]
    said = []
    for n in range(round(700 * MS)):
        for k, end in enumerate(ends):
            end.rx = line[1 - k].pop(0) | (7 if k == 0 and n < 96 else 0)
        for k, end in enumerate(ends):
            end.run(1 / MS)
            line[k].append(int(end.q["pilot"]))
        said.append(any(end.bit(ECHO) for end in ends))
    assert any(said) and not any(said[round(300 * MS) :])


def test_no_echo_for_a_fault_behind_and_at_once_with_the_breaker_open() -> None:
    end = Scheme(type="pott", weak_infeed="echo")
    end.rx = 1
    assert not end.run(200, Z3).bit(ECHO)
    end = Scheme(type="pott", weak_infeed="echo")
    end.q["closed"] = 0
    end.run(60)
    end.rx = 1
    assert end.run(1).bit(ECHO)


@pytest.mark.parametrize(("volts", "fuse", "trips"), [(0.5, 0, True), (0.8, 0, False), (0.5, 1, False)])
def test_a_weak_end_trips_the_phase_whose_voltage_is_low(volts: float, fuse: int, trips: bool) -> None:
    end = Scheme(type="pott", weak_infeed="echo-and-trip")
    end.q["x"][0] *= volts
    end.rx, end.q["fuse_failure"] = 1, fuse
    assert (end.until_trip(100) < np.inf) == trips
    assert end.bit(WEAK) == trips and (end.trips in (0, 1))


BLIND = ({"fuse_failure": 1}, {"missing": 0b010}, {"vanished": 1}, {"proven": 0b101})


@pytest.mark.parametrize("lost", BLIND)
def test_an_end_that_misses_an_input_sends_nothing_back(lost: dict[str, int]) -> None:
    """Of a fault behind it, it sees nothing either, and the other end sees that ahead; but what is missing
    since the fault may be the fault's."""
    for before_ms, sent in ((110, False), (0, True)):
        end = Scheme(type="pott", weak_infeed="echo-and-trip")
        end.q["x"][0] *= 0.5
        end.run(before_ms, **lost)
        end.rx = 1
        end.run(50, **lost)
        assert end.bit(ECHO) == (end.q["pilot"] != 0) == sent
        if not sent:
            assert not end.bit(WEAK) and not end.trips
    opened = Scheme(type="pott", weak_infeed="echo")
    opened.run(200, closed=0, **lost)
    opened.rx = 1
    assert opened.run(1, closed=0, **lost).bit(ECHO), "nothing flows through an open breaker"


@pytest.mark.parametrize("lost", BLIND)
def test_a_blocking_end_that_misses_an_input_blocks(lost: dict[str, int]) -> None:
    end = Scheme(type="dcb")
    assert not end.run(50, **lost).bit(TX)
    assert end.run(60, **lost).bit(TX) and end.q["pilot"] == 7
    whole = {key: 7 if key == "proven" else 0 for key in lost}
    assert not end.run(1, **whole).bit(TX)


def test_poles_of_a_cross_country_fault() -> None:
    """A-G here and B-G on the parallel line near the far end: this end sees A-B-G, the far end A-G ahead."""
    end = Scheme(type="pott")
    end.rx = 1
    end.run(10, Z2, fault=4)
    assert end.trips == 1
    one_bit = Scheme(type="pott", pole_bits=False)
    one_bit.rx = 7
    assert one_bit.run(10, Z2, fault=1).trips == 7  # stated: one bit is three poles


def test_an_evolving_fault_takes_the_other_poles() -> None:
    end = Scheme(type="pott")
    end.rx = 1
    assert end.run(10, Z2).trips == 1
    end.rx = 3
    assert end.run(10, Z2, fault=4).trips == 7


def test_a_transferred_trip_and_what_it_sends() -> None:
    end = Scheme(type="dtt")
    end.transferred = 2
    assert end.run(1).trips == 2
    end = Scheme(type="pott", transfer=True)
    end.q["poles"] = 7
    assert end.run(1).q["transfer"] == 7
    end.transferred = 7  # what came from there does not go back
    assert end.run(1).q["transfer"] == 0
    end = Scheme(type="pott")
    end.transferred = 7  # without `transfer` it is not listened to
    assert end.run(10).trips == 0


def test_a_silent_channel_is_told_after_a_while() -> None:
    end = Scheme(type="pott")
    end.q["linked"] = 0
    assert not end.run(99).bit(LOST)
    assert end.run(2).bit(LOST) and end.w["losses"] == 1
    end.q["linked"] = 1
    assert not end.run(1).bit(LOST)


@pytest.mark.parametrize(
    ("table", "key", "what"),
    [
        (
            {"type": "pott", "pilot_zone": 5},
            "psch.pilot_zone",
            "there is no zone 5; zones: 1, 2, 3",
        ),
        (
            {"type": "putt", "pilot_zone": 3},
            "psch.pilot_zone",
            "zone 3 is not forward, as a pilot zone must be",
        ),
        (
            {"type": "pott", "weak_infeed": "echo-and-trip"},
            "relay.nominal_kv",
            "missing; weak_voltage_pu is a part of it",
        ),
        (
            {"type": "dcb", "weak_infeed": "echo"},
            "psch",
            'weak_infeed is of type = "pott"; "dcb" has no use for an echo',
        ),
    ],
)
def test_settings_that_cannot_be(table: dict[str, Any], key: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | {"pdis": ZONES, "psch": table})
    assert (error.value.key, error.value.what) == (key, what)


def unbalanced_by(of_a: float) -> np.ndarray:
    """Phasors of a load whose voltage A has this part of itself left, its current A so much more."""
    return np.r_[127e3 * TURN * [of_a, 1, 1], 400 * TURN * [1 + 10 * (1 - of_a), 1, 1]]


@pytest.mark.parametrize(
    ("now", "sends"),
    [
        pytest.param(unbalanced_by(0.5), True, id="a fault"),
        pytest.param(unbalanced_by(1.0) * np.repeat([0.6, 5], 3), True, id="three phases"),
        pytest.param(unbalanced_by(1.0) * np.repeat([0.97, 3], 3), False, id="the load another line had"),
        pytest.param(unbalanced_by(1.0) * np.repeat([0.6, 1], 3), False, id="a voltage without a current"),
        pytest.param(unbalanced_by(1.0), False, id="as before"),
    ],
)
@pytest.mark.parametrize("kind", ["pott", "dcb"])
def test_a_pilot_by_direction_is_there_as_long_as_its_fault(kind: str, now: Any, sends: bool) -> None:
    """The direction stays until the change stands still; what the pilot compares does not (IEC 60255-121 has
    no such test; the reversal of two parallel lines in `suite schemes` is what it comes from)."""
    end = Scheme(type=kind, pilot="direction")
    end.rx = 7 if kind == "pott" else 0
    end.q["received"] = end.q["received_all"] = end.rx
    end.disturb(unbalanced_by(1.0), now)
    end.q["direction"], end.q["fault"] = 1, 1
    for ahead, wanted in ((1, sends), (0, False), (-1, False)):
        end.q["direction"] = ahead
        end.step(count=round(150 * MS))  # longer than what a trip sends
        assert bool(end.trips) == wanted
        assert bool(end.q["pilot"]) == (wanted if kind == "pott" else ahead < 0)  # dcb: behind, it blocks
