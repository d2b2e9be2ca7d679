"""The channel between two relays: what arrives, and when."""

from __future__ import annotations

from typing import Any

import pytest

from faultloop.config.channel import Channel
from faultloop.io.can.frames import Frame, State
from faultloop.io.can.table import Kind
from faultloop.nodes.channel import ROOM, Arrivals, new_channels

MS = 1_000_000
RELAYS = ["RA", "RB", "RC"]


def channel(only: str = "RB", seed: int = 1, **keys: Any) -> Arrivals:
    table = Channel.model_validate({"from": "RA", "to": "RB"} | keys)
    return Arrivals(new_channels([table], RELAYS, seed, only=only))


def pilot(relay: int = 0, poles: int = 0, st_num: int = 1, kind: Kind = Kind.PILOT) -> Frame:
    return State(kind, relay, poles, st_num, 0, 0, 0).encode()


def times(way: Arrivals, sent_ms: list[float], relay: int = 0) -> list[float]:
    """When what was sent then arrives [ms]."""
    for t in sent_ms:
        assert way.takes(round(t * MS), pilot(relay))
    return [t_ns / MS for t_ns, _ in way.poll(10_000 * MS)]


def test_delay_and_asymmetry_by_direction() -> None:
    keys = {"delay_ms": 5.0, "asymmetry_ms": 3.0}
    assert times(channel(**keys), [1, 2]) == [7.5, 8.5]
    assert times(channel("RA", **keys), [1, 2], relay=1) == [4.5, 5.5]


def test_what_has_not_arrived_is_not_there() -> None:
    way = channel(delay_ms=5.0)
    assert way.takes(0, pilot())
    assert way.next_ns == 5 * MS
    assert way.poll(5 * MS - 1) == []
    assert [t for t, _ in way.poll(5 * MS)] == [5 * MS]


def test_only_what_is_between_the_ends_goes_by_it() -> None:
    way = channel()
    assert not way.takes(0, pilot(2))  # of a relay without a channel: from the bus, as ever
    assert not way.takes(0, pilot(0, kind=Kind.TRIP))
    assert way.takes(0, pilot(0, kind=Kind.TRANSFER))


def test_jitter_is_even_and_overtakes_nothing() -> None:
    got = times(channel(delay_ms=2.0, jitter_ms=1.0), [4.0 * n for n in range(ROOM)])
    late = sorted(t - 4.0 * n - 2.0 for n, t in enumerate(got))
    assert len(got) == ROOM and 0 <= late[0] < 0.05 and 0.95 < late[-1] < 1
    assert sum(late) / ROOM == pytest.approx(0.5, abs=0.08)
    dense = times(channel(delay_ms=2.0, jitter_ms=5.0), [0.1 * n for n in range(ROOM)])
    assert dense == sorted(dense)


def test_loss_is_a_share_that_the_seed_decides() -> None:
    def kept(seed: int) -> list[float]:
        way, got = channel(seed=seed, loss=0.3), []
        for n in range(2000):
            way.takes(n * MS, pilot())
            got += [t / MS for t, _ in way.poll(n * MS)]
        return got

    assert len(kept(1)) == pytest.approx(1400, abs=4 * 20.5)  # four sigmas of a binomial
    assert kept(1) == kept(1) != kept(2)


def test_out_and_back_and_another_path() -> None:
    assert times(channel(out_at_s=0.01, out_for_s=0.01), [9, 10, 19, 20]) == [9, 20]
    keys = {"delay_ms": 12.0, "switch_at_s": [0.1], "switch_delay_ms": [5.0]}
    assert times(channel(**keys), [99, 100, 110]) == [111, 111, 115]  # nothing overtakes


def test_a_signal_that_ends_is_late_and_one_that_returns_never_ended() -> None:
    way = channel(delay_ms=1.0, reset_ms=10.0)
    for t, poles in ((0, 1), (20, 0), (25, 1), (50, 0)):
        way.takes(t * MS, pilot(poles=poles))
    got = [(t // MS, f.data[1] >> 4 & 7) for t, f in way.poll(1000 * MS)]
    assert got == [(1, 1), (26, 1), (61, 0)]


def test_a_swapped_cable_brings_anothers_frames_under_this_ones_name() -> None:
    way = channel(misrouted="RC", misrouted_at_s=0.01)
    assert way.takes(0, pilot(0)) and way.takes(20 * MS, pilot(0))
    assert way.takes(20 * MS, pilot(2))
    (_, first), (_, second) = way.poll(1000 * MS)
    assert first == pilot(0)
    assert second.id == Kind.PILOT and second.data == pilot(2).data  # and the CRC is over the identifier


def test_more_than_there_is_room_for_is_lost() -> None:
    got = times(channel(delay_ms=200.0), [0.1 * n for n in range(ROOM + 10)])
    assert len(got) == ROOM


@pytest.mark.parametrize(
    ("keys", "what"),
    [
        ({"to": "RA"}, "it is between two relays, not from 'RA' to itself"),
        ({"asymmetry_ms": 3.0}, "asymmetry 3 ms needs a delay of 1.5 ms, not 0"),
        ({"switch_at_s": [1.0]}, "switch_at_s and switch_delay_ms must be of the same length"),
        ({"out_for_s": 1.0}, "out_for_s needs out_at_s"),
    ],
)
def test_what_cannot_be(keys: dict[str, Any], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        channel(**keys)
