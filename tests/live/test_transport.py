"""A transport that an installed package brings: the example, over the loopback interface."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.io.can.frames import Frame
from faultloop.io.can.socketcan import open_link
from faultloop.io.can.transport import open_bus

PACES = (0.2, 0.05, 0.0125)
LATE_MS = 50.0


def may_open_raw_sockets() -> bool:
    try:
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0).close()
    except (OSError, AttributeError):
        return False
    return True


pytestmark = pytest.mark.skipif(not may_open_raw_sockets(), reason="needs raw sockets (Linux, root)")


@pytest.fixture
def package(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The example's package, as pip would have installed it."""
    folder = root / "examples" / "ethernet_transport"
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    info = tmp_path / "faultloop_ethernet-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: 1.0\n")
    group = "faultloop.transports"
    points = "\n".join(f"{name} = {value}" for name, value in project["entry-points"][group].items())
    (info / "entry_points.txt").write_text(f"[{group}]\n{points}\n")
    for path in (folder, tmp_path):
        monkeypatch.syspath_prepend(str(path))
    inherited = os.environ.get("PYTHONPATH")
    paths = [str(tmp_path), str(folder), *([inherited] if inherited else [])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    return folder


FRAMES = [
    Frame(0x40, bytes(range(8))),
    Frame(0x180, bytes(range(48)), fd=True, brs=True),
    Frame(0x1ABCDEF0, b"\x01", extended=True),
    Frame(0x41, b""),
]


def test_frames_go_over_ethernet_and_nobody_hears_himself(package: Path) -> None:
    here, there = open_link("ethernet:lo", fd=True), open_link("ethernet:lo", fd=True, identifiers=[0x180])
    with open_bus("ethernet", "lo", fd=True) as third:
        for frame in FRAMES:
            here.send(frame)
        assert [frame for _, frame in there.receive(1.0)] == [FRAMES[1]]
        heard = [third.recv(1.0) for _ in FRAMES]
        assert [m and (m.arbitration_id, bytes(m.data)) for m in heard] == [(f.id, f.data) for f in FRAMES]
        assert here.receive(0.0) == []
    assert (here.sent, there.received, here.dropped) == (4, 1, 0)
    here.close()
    there.close()


@pytest.mark.parametrize(
    ("can", "words"),
    [("ethernet:nosuch0", "nosuch0.*cannot be opened"), ("ethernt:lo", "did you mean 'ethernet'")],
)
def test_what_is_not_there_is_one_line(root: Path, package: Path, can: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        faultloop.run(root / "scenarios" / "ag-zone1.toml", can=can, keep=False)


def test_processes_trip_over_ethernet_as_simulated(root: Path, package: Path, tmp_path: Path) -> None:
    """In a program of its own: the nodes' fork server has the environment in which it was started."""
    program = f"""
from pathlib import Path
from faultloop.live.supervisor import run_processes
for pace in {PACES}:
    result = run_processes(Path({str(root / "scenarios" / "ag-zone1.toml")!r}), can="ethernet:lo", pace=pace,
                           log=Path({str(tmp_path / "run.mcap")!r}))
    if max(late.greatest * pace for late in result.pacing.latency.values()) < {LATE_MS}:
        break
for trip in result.trips:
    print(trip.relay, trip.function, trip.poles, trip.sample_count, trip.received_ns is not None)
"""
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    simulated = faultloop.run(root / "scenarios" / "ag-zone1.toml")
    wanted = [f"{t.relay} {t.function} {t.poles} {t.sample_count} True" for t in simulated.trips]
    assert sorted(done.stdout.splitlines()) == sorted(wanted)
    assert len(wanted) >= 2
