"""A scenario as processes on a real bus: run by test_processes.py where vcan0 and vcan1 are."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.io.can.table import CURRENT_LSB, VOLTAGE_LSB, Kind
from faultloop.io.mcap_reader import Log
from faultloop.live.merge import merge
from faultloop.live.supervisor import Supervisor, run_processes
from faultloop.loop.outcome import Cast, outcome_of
from faultloop.loop.result import Result
from faultloop.loop.runner import Interrupted

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
CAN = "socketcan:vcan0"
PACES = (0.1, 0.02)  # slow motion: the machine that tests this may have one busy processor
LATE_MS = 50.0


def nodes_alive() -> list[int]:
    """Process numbers of all nodes on this machine."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, _, state = path.read_text(errors="replace").partition("(")[2].rpartition(")")
            if name.startswith("faultloop ") and state.split()[0] != "Z":  # not one that has ended
                found.append(int(path.parent.name))
        except OSError:  # it has just ended
            continue
    return found


def wait_until(held: Callable[[], bool], within_s: float = 60.0) -> bool:
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


def decisions(result: Result) -> list[tuple[str, str, int, str, int, int]]:
    """What was decided, and at which sample."""
    rows = [(t.relay, t.function, t.zone, t.loop, t.poles, t.sample_count) for t in result.trips]
    return sorted(rows)


def run_in_time(path: Path, log: Path) -> Result:
    """A run that kept its time, slower where the machine was too busy for the pace: a relay that works on its
    samples when the run is nearly over trips when nobody is left to open."""
    for pace in PACES:
        result = run_processes(path, can=CAN, pace=pace, log=log)
        assert result.pacing is not None
        late_ms = max(latency.greatest * pace for latency in result.pacing.latency.values())
        if late_ms < LATE_MS:
            return result
    pytest.fail(f"the machine is too busy: {late_ms:.0f} ms late at a pace of {pace:g}")


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
    result = run_in_time(path, tmp_path / "run.mcap")
    simulated = faultloop.run(path, keep=True)
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


@pytest.mark.slow
def test_each_pole_trips_on_its_own_as_in_the_simulation(tmp_path):
    path = SCENARIOS / "single-pole-trip.toml"
    result = run_in_time(path, tmp_path / "run.mcap")
    simulated = faultloop.run(path)
    assert result.died == ()
    assert [row[:-1] for row in decisions(result)] == [row[:-1] for row in decisions(simulated)]
    # From the first opening on the waves depend on how long the frames took.
    first_ns = min(trip.opened_ns for trip in simulated.trips if trip.opened_ns is not None)
    early = [row for row in decisions(simulated) if row[-1] * 10**9 < first_ns * 4800]
    assert early
    assert set(early) <= set(decisions(result))


DISTURBED = """
[can]
heartbeat_s = 0.1

[[bus_fault]]
kind = "loss"
node = "RA"
message = "trip"
pattern = "110"

[[bus_fault]]
kind = "forging"
node = "RB"
message = "trip"
content = "random"
rate_hz = 100
duration_s = 1.0

[[bus_fault]]
kind = "restart"
node = "RB"
start_s = 0.1
"""


@pytest.mark.slow  # half a minute; the same faults of a bus in simulated time: tests/loop/test_bus_faults.py
def test_a_killed_and_a_restarted_node_rejoin_and_lost_frames_lose_no_trip(tmp_path):
    """QA is killed, RB restarts, somebody forges, RA's first trip frames are lost: only the fault trips."""
    text = (SCENARIOS / "ag-zone1.toml").read_text(encoding="utf-8")
    text = text.replace('"settings/', f'"{SCENARIOS.as_posix()}/settings/')
    text = text.replace("duration_s = 0.4", "duration_s = 2.3").replace("after_s = 0.1", "after_s = 2.0")
    path = tmp_path / "disturbed.toml"
    path.write_text(text + DISTURBED, encoding="utf-8")
    scenario = faultloop.load_scenario(path)
    supervisor = Supervisor(scenario, CAN, 0.1, (), tmp_path / "nodes")
    try:
        clock = supervisor.begin()
        while clock.now_ns() < 50_000_000:
            supervisor.listen()
        supervisor.kill("QA")
        supervisor.restart("QA")
        supervisor.run()
        supervisor.finish()
    finally:
        supervisor.close()
    assert supervisor.died == []
    out = tmp_path / "merged.mcap"
    notes = merge(supervisor.logs, out, clock.start_ns, {}, {})
    assert len([note for note in notes if note.startswith(("QA", "RB"))]) == 2  # recovered, or not begun
    result = outcome_of(faultloop.open_log(out), Cast.of_scenario(scenario))
    decided = {(trip.relay, trip.function, trip.loop, trip.poles) for trip in result.trips}
    assert decided == {("RA", "PDIS1", "AG", 7), ("RB", "PDIS1", "AG", 7)}
    assert all(trip.t_ns > 2_000_000_000 for trip in result.trips)
    assert all(trip.opened_ns is not None for trip in result.trips)
    told = [event.text for event in result.events]
    assert any("refused: wrong CRC" in text for text in told)  # the forger's, by QB
    assert any("with empty filters" in text for text in told)  # RB, after its restart
    lost = sum(child.statistics.get("bus_faults", {}).get("B1", 0) for child in supervisor.children)
    assert lost >= 2


def test_nobody_outlives_a_killed_supervisor(tmp_path):
    command = [sys.executable, "-m", "faultloop", "run", SCENARIOS / "ag-zone1.toml", "--processes"]
    command += ["--can", CAN, "--pace", "0.005", "--log", tmp_path / "run.mcap"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        assert wait_until((tmp_path / "run.mcap.nodes" / "bus.mcap.part").exists)
        assert len(nodes_alive()) == 5
        process.kill()
    assert wait_until(lambda: nodes_alive() == [])


@pytest.mark.slow
def test_ctrl_c_ends_a_run_with_its_log_whole(tmp_path):
    def press(part_done: float) -> None:
        if part_done > 0.05:  # later than a node of a loaded machine is
            signal.raise_signal(signal.SIGINT)

    path = SCENARIOS / "ag-zone1.toml"
    with pytest.raises(Interrupted) as ended:
        run_processes(path, can=CAN, pace=0.01, log=tmp_path / "run.mcap", progress=press)
    result = ended.value.result
    assert result.interrupted
    assert result.died == ()
    assert log_of(result).relays == ("RA", "RB")
    assert len(result.samples("RA"))


@pytest.mark.slow  # tests/io/can_on_vcan.py has an interface that goes down under one node
def test_an_interface_that_goes_down_ends_the_run_with_one_line(tmp_path):
    log = tmp_path / "run.mcap"
    went: list[bool] = []

    def pull_the_plug(part_done: float) -> None:
        if part_done > 0.05 and not went:
            went.append(True)
            subprocess.run(["ip", "link", "set", "vcan1", "down"], check=True)

    path = SCENARIOS / "ag-zone1.toml"
    try:
        with pytest.raises(InputError, match="interface is down"):
            run_processes(
                path,
                can="socketcan:vcan1",
                pace=0.05,
                log=log,
                overrides=["fault.F1.after_s=0.38"],  # not before, however slow the machine
                progress=pull_the_plug,
            )
    finally:
        subprocess.run(["ip", "link", "set", "vcan1", "up"], check=True)
    told = faultloop.open_log(log)
    assert told.trips == []
    assert any("interface is down" in entry.message for entry in told.events)
