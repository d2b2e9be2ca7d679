"""A scenario as processes on a real bus: run by test_processes.py where vcan0 and vcan1 are."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.io.can.table import CURRENT_LSB, VOLTAGE_LSB, Kind
from faultloop.io.mcap_reader import Log
from faultloop.live.supervisor import run_processes
from faultloop.result import Result

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
CAN = "socketcan:vcan0"
PACE = 0.1  # slow motion: the machine that tests this may have one busy processor
NODE = "\0faultloop\0node\0"


def nodes_alive() -> list[int]:
    """Process numbers of all nodes on this machine."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if NODE in path.read_text(errors="replace"):
                found.append(int(path.parent.name))
        except OSError:  # it has just ended
            continue
    return found


def wait_until(held, within_s: float = 30.0) -> bool:
    until = time.monotonic() + within_s
    while not held() and time.monotonic() < until:
        time.sleep(0.05)
    return held()


@pytest.fixture(autouse=True)
def nobody_is_left() -> Iterator[None]:
    """No test leaves a process behind."""
    assert nodes_alive() == []
    yield
    left = nodes_alive()
    for number in left:
        os.kill(number, signal.SIGKILL)
    assert left == []


def decisions(result: Result) -> list[tuple[object, ...]]:
    """What was decided, and at which sample."""
    rows = [(t.relay, t.function, t.zone, t.loop, t.poles, t.sample_count) for t in result.trips]
    return sorted(rows, key=str)


def log_of(result: Result) -> Log:
    assert result.log is not None
    return faultloop.open_log(result.log)


def assert_every_sample_is_there(log: Log, relays: int, total: int) -> None:
    """The listener's frames, by the sample count in each."""
    frames = log.array("/can")
    for number in range(relays):
        own = frames[frames["id"] == Kind.SAMPLED_VALUES + number]
        counts = [int.from_bytes(bytes(data)[4:8], "little") for data in own["data"]]
        assert counts == list(range(total))


def test_a_fault_trips_both_ends_as_in_the_simulation(tmp_path):
    """Five processes; every frame in the log; the same decisions at the same samples as in simulated time."""
    path = SCENARIOS / "ag-zone1.toml"
    result = run_processes(path, can=CAN, pace=PACE, log=tmp_path / "run.mcap")
    simulated = faultloop.run(path, keep=True)
    assert result.held
    assert result.died == ()
    assert {trip.relay for trip in result.trips} == {"RA", "RB"}
    assert decisions(result) == decisions(simulated)
    assert all(trip.received_ns is not None and trip.opened_ns is not None for trip in result.trips)
    assert result.pacing is not None
    assert set(result.pacing.lost.values()) == {0}
    assert set(result.pacing.dropped.values()) == {0}
    assert result.pacing.reaction.count == 2
    log = log_of(result)
    assert set(log.relays) == {"RA", "RB"}
    assert set(log.breakers) == {"QA", "QB"}
    assert_every_sample_is_there(log, 2, 1920)
    first_trip = min(trip.sample_count for trip in result.trips)
    for relay in ("RA", "RB"):
        ours, theirs = log.samples(relay), simulated.samples(relay)
        assert ours["sample_count"].tolist() == list(range(1920))
        for name, lsb in (("va", VOLTAGE_LSB), ("ic", CURRENT_LSB)):
            # Until the first trip the plant has heard nothing of anybody: the samples differ by rounding.
            difference = np.abs(ours[name] - theirs[name])[: first_trip + 1]
            assert difference.max() <= lsb / 2 * 1.001
    times = [entry.t_ns for entry in log.can]
    assert times == sorted(times)


@pytest.mark.parametrize("name", ["single-pole-trip", "zone2-remote-end", "reverse-fault"])
def test_decisions_are_those_of_the_simulation(tmp_path, name):
    path = SCENARIOS / f"{name}.toml"
    result = run_processes(path, can=CAN, pace=PACE, log=tmp_path / "run.mcap")
    assert result.died == ()
    assert result.held, result.expectations
    assert decisions(result)[:1] == decisions(faultloop.run(path))[:1]
