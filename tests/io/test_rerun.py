"""The rerun stream, read back with rerun's own reader, and rerun's MCAP loader on our log."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from faultloop.errors import InputError
from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.messages import values
from faultloop.io.rerun_rare import MOST_HELD
from faultloop.io.rerun_sink import RerunSink, log_to_rerun
from faultloop.io.rerun_view import tick_step
from tests.load import load

START_NS = 1_577_836_800_000_000_000


class Recording:
    """Columns of an .rrd file by entity, in time order."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader

        self.chunks: dict[str, list[Any]] = {}
        for chunk in RrdReader(str(path)).stream().to_chunks():
            if not chunk.is_static:
                self.chunks.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())

    def column(self, entity: str, name: str) -> tuple[np.ndarray, list[Any]]:
        """Times [ns] on the timeline ``time``, and the values."""
        times = [batch["time"].cast(pa.int64()).to_numpy() for batch in self.chunks[entity]]
        rows = [value for batch in self.chunks[entity] for value in batch[name].to_pylist()]
        order = np.argsort(np.concatenate(times), kind="stable")
        return np.concatenate(times)[order], [rows[place] for place in order]


@pytest.fixture(scope="module")
def recording(log_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("rerun") / "run.rrd"
    log_to_rerun(open_log(log_path), str(path))
    assert [file.name for file in path.parent.iterdir()] == ["run.rrd"]
    return Recording(path)


@pytest.mark.parametrize("relay", ["R1", "R2"])
def test_waveforms_come_back(recording: Recording, log_path: Path, relay: str) -> None:
    log = open_log(log_path)
    for entity, columns in (("voltage", slice(0, 3)), ("current", slice(3, 6))):
        t_ns, rows = recording.column(f"/relay/{relay}/{entity}", "Scalars:scalars")
        np.testing.assert_array_equal(t_ns, log.samples(relay)["t_ns"])
        np.testing.assert_array_equal(np.array(rows), values(log.samples(relay))[:, columns] / 1e3)


def test_clock_is_the_scenario_time(recording: Recording) -> None:
    batch = recording.chunks["/relay/R1/voltage"][0]
    clock = batch["clock"].cast(pa.int64()).to_numpy()
    np.testing.assert_array_equal(clock - batch["time"].cast(pa.int64()).to_numpy(), START_NS)
    from_fault = batch["from fault"].cast(pa.int64()).to_numpy()
    np.testing.assert_array_equal(batch["time"].cast(pa.int64()).to_numpy() - from_fault, 50_000_000)


def test_states_are_the_bits_changes(recording: Recording, log_path: Path) -> None:
    log = open_log(log_path)
    elements = log.elements("R1")
    t_ns, states = recording.column("/state/R1/PDIS2", "StateChange:state")
    operate, pickup = elements["operate"] >> np.uint64(1) & 1, elements["pickup"] >> np.uint64(1) & 1
    expected = [["Op"] if o else ["Str"] if p else [None] for o, p in zip(operate, pickup, strict=True)]
    at = dict(zip(t_ns.tolist(), states, strict=True))
    shown: Any = [None]
    for row, t in enumerate(elements["t_ns"].tolist()):
        shown = at.get(t, shown)
        assert shown == expected[row]


def test_rare_messages_are_shown(recording: Recording) -> None:
    assert recording.column("/state/breaker/B1", "StateChange:state")[1] == [["closed"]]
    t_ns, states = recording.column("/state/fault/0", "StateChange:state")
    assert (t_ns.tolist(), states) == ([50_000_000], [["AG"]])
    t_ns, texts = recording.column("/events", "TextLog:text")
    assert t_ns.tolist() == [90_000_000] * 2
    assert [text[0].split("ms  ")[1] for text in texts] == ["R1: Trip: Ü", "R1: trip PDIS1 zone 1 AG"]
    assert [level[0] for level in recording.column("/events", "TextLog:level")[1]] == ["WARNING"] * 2
    frames = [text[0].split("ms  ")[1] for text in recording.column("/can", "TextLog:text")[1]]
    assert frames == ["010  [8]  00 01 02 03 04 05 06 07  R1", "1ABCDEFF  [0]"]


def test_a_records_own_channels_have_lanes_where_they_change(tmp_path: Path) -> None:
    log = tmp_path / "x.mcap"
    with LogWriter(log, START_NS) as writer:
        for number, name in enumerate(("TRIP A", "spare")):
            writer.message("/record/digital", 0, "RecordDigital", number=number, name=name)
        for t_ns, on in ((40_000_000, True), (90_000_000, False)):
            writer.message("/record/digital", t_ns, "RecordDigital", number=0, name="TRIP A", on=on)
    log_to_rerun(open_log(log), str(tmp_path / "x.rrd"))
    recording = Recording(tmp_path / "x.rrd")
    (lane,) = [entity for entity in recording.chunks if entity.startswith("/state/record")]
    t_ns, states = recording.column(lane, "StateChange:state")
    assert (t_ns.tolist(), states) == ([0, 40_000_000, 90_000_000], [[None], ["on"], [None]])
    assert "TRIP" in lane


def test_what_is_said_without_samples_is_sent_as_it_comes(tmp_path: Path) -> None:
    """A log of millions of events, or of a breaker's changes, is not held in memory; none is lost."""
    sink = RerunSink(str(tmp_path / "x.rrd"), START_NS)
    count = 3 * MOST_HELD // 2 + 1
    for k in range(count):
        sink.message("/relay/R1/events", k, "foxglove.Log", name="R1", message=str(k))
        sink.message("/breaker/Q1", k, "BreakerStatus", pole_a=bool(k % 2))
        held = [*sink._rare.texts.values(), *sink._rare.lanes.values()]
        assert sum(map(len, held)) < MOST_HELD
    sink.close()
    recording = Recording(tmp_path / "x.rrd")
    t_ns, texts = recording.column("/events", "TextLog:text")
    np.testing.assert_array_equal(t_ns, np.arange(count))
    assert [text[0].split("R1: ")[1] for text in texts] == [str(k) for k in range(count)]
    _, states = recording.column("/state/breaker/Q1", "StateChange:state")
    assert [state[0] for state in states] == ["A closed" if k % 2 else "open" for k in range(count)]


def test_a_relay_without_samples_is_told(tmp_path: Path) -> None:
    """As in a log of what was said alone, or another tool's: the rest is shown."""
    with LogWriter(tmp_path / "x.mcap", START_NS) as writer:
        writer.message("/relay/R1/events", 7, "foxglove.Log", name="R1", message="here")
    log = open_log(tmp_path / "x.mcap")
    log_to_rerun(log, str(tmp_path / "x.rrd"))
    t_ns, _ = Recording(tmp_path / "x.rrd").column("/events", "TextLog:text")
    assert t_ns.tolist() == [7]
    assert "no curves of R1: /relay/R1/samples" in log.warnings[0]


def test_curves_break_where_samples_miss(tmp_path: Path, make_arrays: Callable[..., Any]) -> None:
    sink = RerunSink(str(tmp_path / "x.rrd"), 0)
    sink.add_relay("R1", ["PDIS1"])
    t_ns = np.delete(np.arange(600) * 10**9 // 4800, slice(300, 400))
    n = len(t_ns)
    parts = (np.zeros((n, 6)), np.zeros((n, 14)), np.zeros((n, 12)), *np.zeros((2, n), np.uint64))
    for rows in (slice(0, 300), slice(300, None)):
        sink.relay_block("R1", t_ns[rows], np.arange(n)[rows], *(part[rows] for part in parts))
        sink.flush()
    sink.close()
    shown, values = Recording(tmp_path / "x.rrd").column("/relay/R1/voltage", "Scalars:scalars")
    (gap,) = np.flatnonzero(np.isnan(np.array(values)).all(axis=1))
    assert t_ns[299] < shown[gap] < t_ns[300] and len(shown) == n + 1


def test_loci_are_the_loops_inside_the_picture(tmp_path: Path, make_arrays: Callable[..., Any]) -> None:
    t_ns, count, samples, phasors, loops, pickup, operate = make_arrays(480)
    loops = np.full_like(loops, np.nan)
    loops[:, 4] = np.linspace(0, 9, 480)  # CG
    loops[:, 5] = 2.0
    loops[200:280, 4] = 1e6
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    sink = RerunSink(str(tmp_path / "x.rrd"), 0)
    sink.add_relay("R", ["PDIS1"], {"PDIS1": (square, square / 2)})
    for part in range(0, 480, 24):
        block = slice(part, part + 24)
        sink.relay_block("R", *(a[block] for a in (t_ns, count, samples, phasors, loops, pickup, operate)))
    sink.close()
    recording = Recording(tmp_path / "x.rrd")
    assert "/relay/R/plane/locus/AG" not in recording.chunks
    times, strips = recording.column("/relay/R/plane/locus/CG", "LineStrips2D:strips")
    steps = np.array([strip[0] for strip in strips])
    assert 45 < len(steps) < 60  # 600 a second of 83 ms in the picture
    ends = loops[np.searchsorted(t_ns, times)][:, 4:6]
    np.testing.assert_allclose(steps[:, 1], ends, rtol=1e-6)
    joined = np.abs(steps[1:, 0] - steps[:-1, 1]).max(axis=1) < 1e-6
    assert (~joined).sum() == 1  # but for the gap, every step begins where the one before it ended
    times, points = recording.column("/relay/R/plane/now/CG", "Points2D:positions")
    assert [] in points and points[-1] != []


@pytest.mark.parametrize(
    ("target", "says"),
    [
        ("nonsense", "known: spawn, serve, FILE.rrd"),
        ("no folder/x.rrd", "cannot be written"),
        ("rerun+http://127.0.0.1:{port}/proxy", "no viewer answers"),
    ],
)
def test_wrong_targets(target: str, says: str, tmp_path: Path) -> None:
    with socket.socket() as unused:  # bound, and not listening
        unused.bind(("127.0.0.1", 0))
        target = target.format(port=unused.getsockname()[1])
        begin = time.monotonic()
        with pytest.raises(InputError, match=says):
            RerunSink(str(tmp_path / target) if target.endswith(".rrd") else target, 0)
        assert time.monotonic() - begin < 30  # it does not wait for a viewer for ever


def test_aborted_file_keeps_its_part_name(tmp_path: Path) -> None:
    sink = RerunSink(str(tmp_path / "x.rrd"), 0)
    sink.message("/breaker/B", 0, "BreakerStatus", pole_a=True)
    sink.abort()
    assert [path.name for path in tmp_path.iterdir()] == ["x.rrd.part"]


def test_served_stream_reaches_a_client(
    make_arrays: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    monkeypatch.setattr("faultloop.io.rerun_target.GRPC_PORT", port)
    sink = RerunSink("serve", 0)
    assert sink.url == f"rerun+http://127.0.0.1:{port}/proxy"
    sink.add_relay("R", [])
    sink.relay_block("R", *make_arrays(300))
    sink.close()
    socket.create_connection(("127.0.0.1", port), timeout=5).close()  # it serves on


def test_tick_steps() -> None:
    assert [tick_step(reach) for reach in (0.05, 1, 9, 40, 80, 333)] == [0.01, 0.2, 2, 10, 20, 50]


def rerun(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """rerun's command line, with a configuration of its own in which analytics are off."""
    import rerun_cli

    program = Path(rerun_cli.__file__).with_name("rerun.exe" if sys.platform == "win32" else "rerun")
    environment = os.environ | {"XDG_CONFIG_HOME": str(folder), "NO_COLOR": "1"}
    subprocess.run([program, "analytics", "disable"], env=environment, check=True, capture_output=True)
    return subprocess.run(
        [program, *arguments], env=environment, capture_output=True, encoding="utf-8", check=False
    )


def test_reruns_mcap_loader_takes_our_log(log_path: Path, tmp_path: Path) -> None:
    checked = rerun("mcap", "check", str(log_path), folder=tmp_path)
    assert checked.returncode == 0, checked.stderr
    lines = [line for line in checked.stdout.splitlines() if " /" in line and line.split()[0].isalpha()]
    assert len(lines) == 14 and all(line.startswith("ok") for line in lines), checked.stdout
    converted = rerun("mcap", "convert", str(log_path), "-o", str(tmp_path / "x.rrd"), folder=tmp_path)
    assert converted.returncode == 0, converted.stderr
    from rerun.chunk import RrdReader

    rows: dict[str, int] = {}
    voltages: list[float] = []
    for chunk in RrdReader(str(tmp_path / "x.rrd")).stream().to_chunks():
        if not chunk.is_static:
            rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
            if chunk.entity_path == "/relay/R1/samples":
                messages = chunk.to_record_batch()["faultloop.SampledValues:message"].to_pylist()
                voltages += [message[0]["va"] for message in messages]
    log = open_log(log_path)
    for topic in log.topics:
        if len(log.array(topic)):
            assert rows[topic] >= len(log.array(topic)), topic
    np.testing.assert_array_equal(voltages, log.samples("R1")["va"])


@pytest.mark.slow
@pytest.mark.skipif(
    not list(Path("/usr/share/vulkan/icd.d").glob("*.json")), reason="no Vulkan driver: mesa-vulkan-drivers"
)
def test_viewer_shows_everything(
    log_path: Path, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A headless viewer: no view complains, and curves and zones are in the picture."""
    from PIL import Image

    rerun("--version", folder=tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    bench = load("bench/rerun_view.py")
    log_to_rerun(open_log(log_path), str(tmp_path / "run.rrd"))
    assert bench.screenshot(tmp_path / "run.rrd", tmp_path / "shot.png", 100.0) == []
    picture = np.asarray(Image.open(tmp_path / "shot.png").convert("RGB")).reshape(-1, 3).astype(int)
    for color in ((0xFF, 0x8A, 0x3C), (0x4F, 0xA8, 0xE8), (0x4F, 0xD1, 0xC5)):  # phases A, C; zone 1
        assert (np.abs(picture - color).max(axis=1) < 24).sum() > 50, color


def test_a_trip_is_told_once(tmp_path: Path) -> None:
    """By the trip, and not by the relay's line of it too."""
    sink = RerunSink(str(tmp_path / "x.rrd"), 0)
    text = "PTRC1 Tr poles ABC zone 1 loop AG"
    sink.message("/relay/R1/events", 1, "foxglove.Log", level=3, message=text, name="R1")
    sink.message("/relay/R1/trips", 1, "Trip", function="PDIS1", zone=1, loop="AG", poles=7, sample_count=1)
    assert [line[1].split("ms  ")[1] for line in sink._rare.texts["events"]] == ["R1: trip PDIS1 zone 1 AG"]
    sink.close()
