"""Layouts for viewers, the view that they need, and what a notebook shows of a log."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap_protobuf.reader import read_protobuf_messages

from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.io import notebook
from faultloop.io.layouts import foxglove
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.review.rows import relay_rows
from tests.review.review_logs import BEFORE, DECIDED, FAULT, RATE, START_NS, times, write_log

Capture = pytest.CaptureFixture[str]
PANELS = {"Plot", "StateTransitions", "Log", "RawMessages"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return open_log(write_log(tmp_path_factory.mktemp("layout") / "known.mcap"))


@pytest.fixture(scope="module")
def made(log: Log) -> Path:
    folder = log.path.parent
    options = [
        "--foxglove",
        folder / "f.json",
        "--plotjuggler",
        folder / "p.xml",
        "--view",
        folder / "v.mcap",
    ]
    assert call(["layout", str(log.path), *map(str, options)]) == 0
    return folder


def test_the_view_has_what_the_log_says(log: Log, made: Path) -> None:
    """Every 12th sample and each change of a bit: sizes, degrees against va, booleans."""
    seen = list(read_protobuf_messages(made / "v.mcap"))
    assert {one.topic for one in seen} == {"/relay/R1/view"}
    rows = relay_rows(log, "R1")
    at = {int(one.log_time_ns) - START_NS: one.proto_msg for one in seen}
    number = np.searchsorted(rows.t_ns, sorted(at))
    assert (rows.t_ns[number] == sorted(at)).all()
    assert set(range(0, len(rows), 12)) <= set(number.tolist())
    changes = np.flatnonzero((np.diff(rows.pickup) != 0) | (np.diff(rows.operate) != 0)) + 1
    assert set(changes.tolist()) <= set(number.tolist())
    assert len(number) <= len(rows) // 12 + 1 + len(changes)
    first, decided = at[0], at[int(times(len(rows))[DECIDED])]
    assert [first.va_mag, first.ic_mag] == pytest.approx([127e3, 400.0])
    assert [first.va_deg, first.vb_deg, first.ia_deg] == pytest.approx([0.0, -120.0, -10.0])
    v = FAULT[:3]
    turn = np.exp(2j * np.pi / 3)
    assert decided.v0_mag == pytest.approx(abs(v.sum()) / 3)
    assert decided.v1_mag == pytest.approx(abs(v[0] + turn * v[1] + turn**2 * v[2]) / 3)
    assert decided.v2_mag == pytest.approx(abs(v[0] + turn**2 * v[1] + turn * v[2]) / 3)
    assert [first.PDIS1_Str, first.PTRC1_Tr] == [False, False]
    assert [decided.PDIS1_Op, decided.PTRC1_Tr, decided.RDIR1_DirFwd] == [True, True, True]
    assert abs(BEFORE[0]) == pytest.approx(first.va_mag)


def _panels(tree: dict) -> list[dict]:
    if tree["type"] == "panel":
        return [tree]
    inner = [tab["content"] for tab in tree["tabs"]] if tree["type"] == "tabs" else []
    inner += [item["content"] for item in tree.get("items", [])]
    return [panel for one in inner for panel in _panels(one)]


def test_a_foxglove_layout_shows_topics_and_fields_that_are_there(log: Log, made: Path) -> None:
    tree = json.loads((made / "f.json").read_text())
    assert (tree["version"], tree["content"]["type"]) == (1, "tabs")
    panels = _panels(tree["content"])
    assert {panel["panelType"] for panel in panels} == PANELS
    view = {field.name for field in next(read_protobuf_messages(made / "v.mcap")).proto_msg.DESCRIPTOR.fields}
    fields = {f"/relay/R1/view.{name}" for name in view}
    for topic in ("/relay/R1/samples", "/relay/R1/loops"):
        fields |= {f"{topic}.{name}" for name in log.array(topic).dtype.names or ()}
    paths = [path for panel in panels for path in panel["config"].get("paths", [])]
    assert len(paths) > 30
    assert {path["value"] for path in paths} <= fields
    lanes = next(panel for panel in panels if panel["panelType"] == "StateTransitions")
    assert "/relay/R1/view.PDIS1_Op" in {path["value"] for path in lanes["config"]["paths"]}
    axes = [p["config"]["xAxisPath"]["value"] for p in panels if "xAxisPath" in p["config"]]
    assert axes[0] == "/relay/R1/loops.ag_r" and set(axes) <= fields
    told = [p["config"]["topicToRender"] for p in panels if p["panelType"] == "Log"]
    assert told == [topic for topic in log.topics if topic.endswith("/events")]


def test_a_plotjuggler_layout_has_its_tabs_and_curves(log: Log, made: Path) -> None:
    root = ET.parse(made / "p.xml").getroot()
    assert (root.tag, root.get("pj4_version")) == ("root", "4")
    assert [tab.get("tab_name") for tab in root.iter("Tab")] == ["R1", "R1 R-X"]
    curves = {(curve.get("topic"), curve.get("field")) for curve in root.iter("curve")}
    wanted = {("samples", "ia"), ("view", "va_mag"), ("view", "PDIS1_Op")}
    assert {(f"/relay/R1/{topic}", field) for topic, field in wanted} <= curves
    plane = next(plot for plot in root.iter("plot") if plot.get("mode") == "XYPlot")
    ways = [[c.get(k) for k in ("x_topic", "x_field", "y_topic", "y_field")] for c in plane]
    loops = "/relay/R1/loops"
    assert len(ways) == 6 and ways[0] == [loops, "ag_r", loops, "ag_x"]
    assert [plane[0].get(k) for k in ("curve_x", "curve_y")] == [f"{loops}/ag_r", f"{loops}/ag_x"]
    named = [c for plot in root.iter("plot") if plot.get("mode") == "TimeSeries" for c in plot.iter("curve")]
    assert all(c.get("name") == f"{c.get('topic')}/{c.get('field')}" for c in named)
    known = {name for topic in (loops, "/relay/R1/samples") for name in log.array(topic).dtype.names or ()}
    assert {field for way in ways for field in way[1::2]} <= known
    ids = [e.get("id") for e in root.iter() if e.get("id") is not None]
    assert len(set(ids)) == len(ids)
    for splitter in root.iter("DockSplitter"):
        assert int(splitter.get("count", "0")) == len(list(splitter))
    for info in root.iter("fileInfo"):
        told = json.loads(info.findtext("plugin") or "")
        assert told["filepath"] == info.get("filename")
        asked = info.find("plugin/parameters")
        assert asked is not None and loops in (asked.get("selected_topics") or "").split(";")
    files = [one.get("filename") for one in root.iter("fileInfo")]
    assert files == [str(log.path), str(made / "v.mcap")]


def test_a_layout_of_nothing_is_one_line(log: Log, tmp_path: Path, capsys: Capture) -> None:
    assert call(["layout", str(log.path)]) == 2
    told = "faultloop: layout: give --foxglove F.json, --plotjuggler F.xml or --view V.mcap\n"
    assert capsys.readouterr().err == told
    empty = tmp_path / "empty.mcap"
    with LogWriter(empty, 0):
        pass
    assert call(["layout", str(empty), "--view", str(tmp_path / "v.mcap")]) == 2
    told = f"faultloop: {empty}: no relay has phasors and elements: there is nothing to view\n"
    assert capsys.readouterr().err == told
    assert not (tmp_path / "v.mcap").exists()


def test_a_notebook_shows_a_log(log: Log) -> None:
    assert repr(log) == "<Log known.mcap: known, relays R1, 9 topics>"
    shown = log._repr_html_()
    assert "<td>PDIS1</td>" in shown and "PTRC1 Tr poles ABC" in shown
    figure = log.plot()
    assert [axes.get_ylabel() for axes in figure.axes] == ["voltage [kV]", "current [kA]"]
    assert len(figure.axes[0].lines) == 3 + 2  # and fault and trip


def test_a_notebooks_texts_are_apart_and_above_the_waves(log: Log) -> None:
    """Fault and trips a few ms apart, and one at the end; of two relays each has its own alone."""
    rows = log.samples("R1")
    end_ns = int(rows["t_ns"][-1])
    near = [(200_000_000, "fault"), (203_000_000, "R1 PDIS1"), (205_000_000, "R1 PDIS2")]
    marks = [*near, (206_000_000, "R2 PDIS1"), (end_ns, "R1 PTOC1")]
    figure = notebook.figure({"R1": rows, "R2": rows}, marks)
    figure.draw_without_rendering()
    first, second = figure.axes[:2]
    assert [text.get_text() for text in first.texts] == ["fault", "PDIS1", "PDIS2", "PTOC1"]
    assert [text.get_text() for text in second.texts] == ["fault", "PDIS1"]
    boxes = [text.get_window_extent() for text in first.texts]
    whole = first.get_window_extent()
    for n, box in enumerate(boxes):
        assert box.y0 >= whole.y1 and box.x1 < whole.x1 + 5
        assert not any(box.overlaps(other) for other in boxes[:n])


def test_a_log_as_a_data_frame(log: Log) -> None:
    frame = log.to_pandas("R1")
    rows = relay_rows(log, "R1")
    assert len(frame) == len(rows)
    assert frame.index[48] == pytest.approx(48 / RATE, abs=1e-9)
    np.testing.assert_array_equal(frame["ia"], rows.samples[:, 3])
    np.testing.assert_array_equal(frame["va_re"], rows.phasors[:, 0].real)
    assert frame["PDIS1.Op"].dtype == bool and frame["PDIS1.Op"].to_numpy().argmax() == DECIDED
    with pytest.raises(InputError, match="no relay 'R9'"):
        log.to_pandas("R9")


def test_a_review_in_secondary_values(log: Log, capsys: Capture) -> None:
    """1000 A and 2000 V over 1."""
    assert call(["review", str(log.path), "--secondary"]) == 0
    out = capsys.readouterr().out
    assert "Phasors: RMS secondary" in out and "[ohm, secondary]" in out
    assert "63.5 V" in out and "4.0 A" in out  # 127 kV, 4000 A
    assert "1.75" in out and "8.00" in out  # 3.5 + 16j ohm, over 2000 / 1000
    assert call(["review", str(log.path), "--secondary", "--json"]) == 2
    assert capsys.readouterr().err == "faultloop: --secondary: --json is in primary values, as the log is\n"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "--again: give two logs, or one and --again"),
        (["--again", "x.mcap"], "--again: give two logs, or one and --again"),
    ],
)
def test_diff_again_needs_one_log(log: Log, arguments: list[str], told: str, capsys: Capture) -> None:
    assert call(["diff", str(log.path), *arguments]) == 2
    assert capsys.readouterr().err == f"faultloop: {told}\n"


def test_a_log_that_cannot_be_run_again_says_so(log: Log, capsys: Capture) -> None:
    assert call(["diff", str(log.path), "--again"]) == 2
    told = f"faultloop: {log.path}: has no attachment scenario.toml: it cannot be run again\n"
    assert capsys.readouterr().err == told


def test_no_panel_is_of_a_topic_that_the_log_has_not(make_arrays: Callable[..., Any], tmp_path: Path) -> None:
    """A replay's log has no frames."""
    with LogWriter(tmp_path / "r.mcap", START_NS) as out:
        out.add_relay("R1", ["PDIS1"])
        out.relay_block("R1", *make_arrays(100))
    log = open_log(tmp_path / "r.mcap")
    text = json.dumps(foxglove(log))
    assert '"/can"' not in text
    named = set(re.findall(r'"topic(?:Path|ToRender)": "([^"]*)"', text))
    assert named <= set(log.topics)


def test_a_picture_of_many_samples_keeps_every_peak(log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notebook, "POINTS", 100)
    whole = log.samples("R1")
    drawn = log.plot("R1").axes[0].lines
    assert len(drawn[0].get_xdata()) < 2 * len(whole) / 4
    for line, name in zip(drawn, ("va", "vb", "vc"), strict=False):
        y = np.asarray(line.get_ydata())
        assert (y.min(), y.max()) == (whole[name].min() / 1e3, whole[name].max() / 1e3)


def test_a_frame_of_a_part_and_one_that_no_memory_is_for(log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas")
    frame = log.to_pandas("R1", from_ns=10_000_000, to_ns=20_000_000)
    assert frame.index[0] >= 0.01
    assert frame.index[-1] < 0.02
    monkeypatch.setattr(notebook, "FRAME_BYTES", 1000)
    with pytest.raises(InputError, match=r"samples of R1 are a frame of .* GB: give from_ns and to_ns"):
        log.to_pandas("R1")
    log.to_pandas("R1", from_ns=0)
