"""The tools people use, all at once on one run over the kernel's CAN: run by test_tools.py where vcan0 is."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import can
import pytest

from faultloop.io.can.dbc import DBC_PATH
from faultloop.io.can.frames import State
from faultloop.io.can.table import Kind
from faultloop.testing import FaultloopBus, TestRun

ROOT = Path(__file__).resolve().parents[2]
FORGED = ("011#0070020000000000", "011#00", "7EE#0102030405060708", "100#00", "011#R8")
LOGS = ("capture.log", "capture.asc", "capture.blf")


@dataclass
class Captured:
    """What each tool made of the run."""

    run: TestRun
    folder: Path
    decoded: str
    monitor: dict

    def messages(self, name: str) -> list[can.Message]:
        with can.LogReader(self.folder / name) as reader:
            return [m for m in reader if isinstance(m, can.Message)]


def listeners() -> int:
    """Sockets that take every frame of vcan0."""
    lists = Path("/proc/net/can/rcvlist_all").read_text(encoding="ascii")
    return sum(line.split()[0] == "vcan0" for line in lists.splitlines() if line.strip())


def wait_for(count: int) -> None:
    for _ in range(400):
        if listeners() >= count:
            return
        time.sleep(0.05)
    raise AssertionError(f"{listeners()} of {count} listeners on vcan0")


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Captured]:
    """A fault on vcan0: a user's breaker as a process, and every tool beside it."""
    folder = tmp_path_factory.mktemp("tools")
    python, environment = sys.executable, os.environ | {"TERM": "xterm", "PYTHONUNBUFFERED": "1"}
    started: list[subprocess.Popen] = []
    keep = {"stdin": subprocess.DEVNULL, "env": environment}

    def start(*words: str, **how) -> subprocess.Popen:
        started.append(subprocess.Popen(words, **(keep | how)))
        return started[-1]

    bus = FaultloopBus("socketcan:vcan0", folder=folder, search=[ROOT / "scenarios"], pace=0.05)
    try:
        start(python, "examples/my_breaker.py", "socketcan", "vcan0", "--pace", "0.05")
        with (folder / "candump").open("wb") as out:
            dump = start("candump", "vcan0", stdout=out)
        with (folder / "monitor.json").open("wb") as out:
            words = ("monitor", "--can", "socketcan:vcan0", "--pace", "0.05", "--json")
            monitor = start(python, "-m", "faultloop", *words, stdout=out)
        loggers = [can.Logger(folder / name) for name in LOGS]
        with bus, can.Bus("vcan0", interface="socketcan") as listener, can.Notifier(listener, loggers):
            wait_for(4)
            run = bus.run("ag-zone1.toml", without=["QA"])
            subprocess.run(["sh", "-c", ";".join(f"cansend vcan0 {f}" for f in FORGED)], check=True)
            run.wait()
        for process in (dump, monitor):
            process.terminate()
            process.wait(20)
        with (folder / "candump").open("rb") as frames:
            words = (python, "-m", "cantools", "decode", "--single-line", str(DBC_PATH))
            decoded = subprocess.run(words, stdin=frames, capture_output=True, text=True, check=True)
        yield Captured(run, folder, decoded.stdout, json.loads((folder / "monitor.json").read_bytes()))
    finally:
        for process in started:
            process.kill()
            process.wait()


def test_the_users_breaker_cleared_the_fault(captured: Captured) -> None:
    trip = captured.run.trip("RA", zone=1)
    assert trip.opened_ms is not None
    assert captured.run.frames("BREAKER_STATUS", number=0)[-1].poles == ""
    assert {f.sender for f in captured.run.frames("BREAKER_STATUS", number=0)} == {"external"}


def test_forged_frames_are_refused_and_told_and_move_nothing(captured: Captured) -> None:
    events = [(e.source, e.text) for e in captured.run.result.events]
    assert ("QB", "frame 0x011 refused: wrong CRC") in events
    assert ("QB", "frame 0x011 refused: wrong length") in events
    assert ("QA", "frame 0x100 refused: wrong length") in events
    opened = [text for source, text in events if source == "QB" and "received" in text]
    assert opened == ["open poles ABC received from RB"]
    assert captured.run.frames("UNKNOWN", number=0x7EE)


def test_candump_and_cantools_decode_name_the_trip(captured: Captured) -> None:
    lines = [line for line in captured.decoded.splitlines() if "TRIP_00(" in line.replace(" ", "")]
    assert any("pole_a: 1" in line and "pole_c: 1" in line and "st_num: 2" in line for line in lines)
    assert any("BREAKER_STATUS_01(" in line for line in captured.decoded.splitlines())


def test_cantools_monitor_shows_it() -> None:
    leader, follower = pty.openpty()
    fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 200, 0, 0))
    words = (sys.executable, "-m", "cantools", "monitor", str(DBC_PATH), "-i", "socketcan", "-c", "vcan0")
    ends = {"stdin": follower, "stdout": follower, "stderr": follower}
    screen = subprocess.Popen(words, env=os.environ | {"TERM": "xterm"}, **ends)
    try:
        wait_for(1)
        drawn = ""
        for _ in range(100):
            frame = State(Kind.TRIP, 3, 7, 1, 0, 0, 0).encode()
            subprocess.run(["cansend", "vcan0", f"{frame.id:03X}#{frame.data.hex()}"], check=True)
            if select.select([leader], [], [], 0.2)[0]:
                drawn += os.read(leader, 1 << 16).decode(errors="replace")
            if "TRIP_03" in drawn and "pole_a" in drawn:
                return
        raise AssertionError(drawn)
    finally:
        screen.kill()
        screen.wait()
        os.close(leader)
        os.close(follower)


def test_our_monitor_counts_every_frame_and_every_refusal(captured: Captured) -> None:
    messages = {m["id"]: m for m in captured.monitor["messages"]}
    seen = captured.run.frames()
    for number in (0x010, 0x101, 0x300, 0x700):
        assert messages[number]["frames"] == sum(f.frame.id == number for f in seen), hex(number)
    assert messages[0x011]["rejected"] == {"crc": 1, "length": 1}
    assert messages[0x010]["sender"] == "RELAY_00" and messages[0x010]["checks"] == "ok"
    assert messages[0x7EE]["rejected"] == {"unknown_id": 1}
    assert messages[0x100]["content"].startswith("poles none")
    assert captured.monitor["dropped"] == 0
    assert 0 < captured.monitor["load"] < 1


@pytest.mark.parametrize("name", LOGS)
def test_a_live_capture_reads_back(captured: Captured, name: str) -> None:
    """By python-can's readers, and frame by frame what the run's own log has."""
    live = [(m.arbitration_id, bytes(m.data)) for m in captured.messages(name) if not m.is_remote_frame]
    own = [(f.frame.id, f.frame.data) for f in captured.run.frames()]
    assert len(own) > 100
    extra = Counter(live) - Counter(own)  # what the user's breaker sent when the run was over
    assert not Counter(own) - Counter(live)
    assert {identifier for identifier, _ in extra} <= {0x100}


@pytest.mark.slow
@pytest.mark.faultloop_can("socketcan:vcan0")
def test_the_users_breaker_among_processes(faultloop_bus: FaultloopBus) -> None:
    """Plant, relays and the other breaker are processes; this one is the user's."""
    words = (sys.executable, "examples/my_breaker.py", "socketcan", "vcan0", "--pace", "0.1")
    breaker = subprocess.Popen(words)
    try:
        wait_for(1)
        scenario = ROOT / "scenarios" / "ag-zone1.toml"
        run = faultloop_bus.run(scenario, pace=0.1, without=["QA"], overrides=["can.fd=true"], processes=True)
        assert run.trip("RB", zone=1).opened_ms is not None
        assert run.trips[0].relay == "RA"
        assert run.frames("BREAKER_STATUS", number=0)[-1].poles == ""
        assert run.frames("SAMPLED_VALUES", number=0)
    finally:
        breaker.kill()
        breaker.wait()
