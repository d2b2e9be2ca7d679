"""Nodes behind their checks: what they refuse, what they tell of it, and a whole run with keys."""

from __future__ import annotations

from pathlib import Path

import pytest

from faultloop.errors import InputError
from faultloop.io.can.authentication import CmacSeal
from faultloop.io.can.frames import Frame, Heartbeat, Rejection, decode
from faultloop.io.can.table import Alarm, Kind
from faultloop.loop.runner import run
from faultloop.loop.scenario import load_scenario
from faultloop.nodes import BreakerNode, Refusals, RelayNode

MS = 1_000_000
KEY = bytes(range(16))
EPOCH = 1_577_836_800_000_000_000


def seal(start_ns: int = 0, key: bytes = KEY) -> CmacSeal:
    state_kinds = (Kind.TRIP, Kind.CLOSE, Kind.PILOT, Kind.BREAKER_STATUS)
    return CmacSeal(dict.fromkeys(state_kinds, key), EPOCH, start_ns)


def relay(start_ns: int = 0, key: bytes = KEY) -> RelayNode:
    return RelayNode(0, 0, [], 1.0, 0.0, seal=seal(start_ns, key), start_ns=start_ns)


def breaker(said: list[tuple[int, str]], start_ns: int = 0) -> BreakerNode:
    return BreakerNode(
        0,
        [0],
        7,
        1.0,
        lambda t_ns, level, text: said.append((t_ns, text)),
        seal=seal(start_ns),
        start_ns=start_ns,
    )


def trips(node: RelayNode, until_ns: int) -> list[tuple[int, Frame]]:
    """Trip frames of a node up to a time, each when it is due."""
    sent = []
    while node.next_ns <= until_ns:
        t_ns = node.next_ns
        sent += [(t_ns, frame) for frame in node.poll(t_ns) if frame.id == Kind.TRIP]
    return sent


def test_an_authenticated_trip_operates_once() -> None:
    sender, receiver = relay(), breaker([])
    for t_ns, frame in trips(sender, 99 * MS):
        assert frame.fd and len(frame.data) == 32
        assert receiver.receive(t_ns, frame) is None
    sender.set(100 * MS, 7, 0, 0)
    commands = [receiver.receive(t_ns, frame) for t_ns, frame in trips(sender, 5000 * MS)]
    assert [c.t_ns for c in commands if c is not None] == [100 * MS]
    assert not receiver.rejected


def test_a_restarted_breaker_acts_on_the_trip_that_stands_and_on_no_recording() -> None:
    sender, said = relay(), []
    trips(sender, 99 * MS)
    sender.set(100 * MS, 7, 0, 0)
    recording = trips(sender, 500 * MS)
    receiver = breaker(said, start_ns=550 * MS)
    for n, (_, frame) in enumerate(recording):
        assert receiver.receive((551 + n) * MS, frame) is None
    assert receiver.rejected == {Rejection.BEFORE_START: len(recording)}
    genuine = trips(sender, 3000 * MS)
    commands = [receiver.receive(t_ns, frame) for t_ns, frame in genuine]
    assert [c is not None for c in commands] == [False, True] + [False] * (len(commands) - 2)
    for t_ns, frame in genuine:
        assert receiver.receive(t_ns + 500 * MS, frame) is None


def test_a_recording_of_a_trip_that_is_over_trips_no_restarted_breaker() -> None:
    sender, receiver = relay(), breaker([], start_ns=550 * MS)
    trips(sender, 99 * MS)
    sender.set(100 * MS, 7, 0, 0)
    recording = trips(sender, 500 * MS)
    sender.set(520 * MS, 0, 0, 0)
    for n, (_, frame) in enumerate(recording):
        assert receiver.receive((551 + n) * MS, frame) is None
    for t_ns, frame in trips(sender, 2000 * MS):
        if t_ns >= 550 * MS:
            assert receiver.receive(t_ns, frame) is None
            assert receiver.receive(t_ns, recording[-1][1]) is None
    assert set(receiver.rejected) == {Rejection.BEFORE_START, Rejection.OLD, Rejection.STALE}


def test_another_key_is_refused_and_told() -> None:
    said: list[tuple[int, str]] = []
    forger, receiver = relay(key=bytes(16)), breaker(said)
    forger.set(0, 7, 0, 0)
    for t_ns, frame in trips(forger, 100 * MS):
        assert receiver.receive(t_ns, frame) is None
    assert set(receiver.rejected) == {Rejection.TAG}
    assert said == [(0, "frame 0x010 refused: wrong authentication tag")]


def test_a_heartbeat_shows_the_sum_and_the_alarm() -> None:
    receiver = breaker([])
    stray = Frame(0x7EE, b"")
    for n in range(3):
        receiver.receive(n * MS, stray)
    beats = [decode(f) for t in (0, 1, 2) for f in receiver.poll(t * 1000 * MS) if f.id >= Kind.HEARTBEAT]
    shown = [(b.rejected, b.alarms) for b in beats if isinstance(b, Heartbeat)]
    assert shown == [(3, Alarm.REJECTED), (3, 0), (3, 0)]


def test_a_flood_fills_no_log() -> None:
    said: list[str] = []
    refusals = Refusals(lambda t_ns, level, text: said.append(text))
    for n in range(30_000):  # 10,000 a second, each with an identifier of its own
        refusals.add(n * MS // 10, 0x10000 + n, Rejection.UNKNOWN_ID)
    refusals.beat(4000 * MS)
    assert said == [
        "frame 0x10000 refused: unknown identifier",
        "frames unknown identifiers refused: unknown identifier, 10000 more in 1.0 s",
        "frames unknown identifiers refused: unknown identifier, 10000 more in 1.0 s",
        "frames unknown identifiers refused: unknown identifier, 9999 more in 2.0 s",
    ]
    assert refusals.total == 30_000


def with_keys(root: Path, folder: Path, mode: int = 0o600) -> list[str]:
    keys = folder / "keys.toml"
    keys.write_text(f'default = "{KEY.hex()}"\n', encoding="utf-8")
    keys.chmod(mode)
    return ["can.fd=true", f"can.keys='{keys}'", "can.channel='test-protected'", "scenario.duration_s=0.3"]


def test_a_run_with_keys_decides_as_one_without(root: Path, tmp_path: Path) -> None:
    scenario = root / "scenarios" / "ag-zone1.toml"
    overrides = with_keys(root, tmp_path)
    plain = run(scenario, overrides=[o for o in overrides if "keys" not in o])
    sealed = run(scenario, overrides=overrides)
    assert [(t.relay, t.sample_count) for t in sealed.trips] == [
        (t.relay, t.sample_count) for t in plain.trips
    ]
    assert len(sealed.trips) >= 1
    for one, other in zip(sealed.trips, plain.trips, strict=True):
        assert one.received_ns is not None and other.received_ns is not None
        # 32 bytes of CAN FD at 2 Mbit/s take longer than 8 of classic, and not by a millisecond.
        assert 0 < abs(one.received_ns - other.received_ns) < MS
    assert not [e for run in (plain, sealed) for e in run.events if "refused" in e.text]


def test_keys_need_fd(root: Path) -> None:
    with pytest.raises(InputError, match="keys needs fd = true"):
        load_scenario(root / "scenarios" / "ag-zone1.toml", ["can.keys='keys.toml'"])


def test_a_key_file_that_cannot_be_used_ends_before_anything_is_written(root: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with pytest.raises(InputError, match=r"nowhere\.toml: cannot be read"):
        run(
            root / "scenarios" / "ag-zone1.toml",
            overrides=["can.fd=true", "can.keys='nowhere.toml'"],
            log=log,
        )
    assert list(tmp_path.iterdir()) == []
