"""The picture and the page of a log: they exist, show what they should, and leave nothing half-made."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.image import imread

from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.output_file import write_aside
from faultloop.review import page
from faultloop.review.page_data import content
from faultloop.review.plot import draw, shown_relays, write_png
from faultloop.review.summary import summarize
from faultloop.review.view import thinned, window_ms
from tests.review.page_content import drawn
from tests.review.review_logs import BITS, FAULT_NS, OPENED_NS, RECEIVED_NS, START_NS, rows, write_log


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(tmp_path_factory.mktemp("plot") / "known.mcap")


def odd_log(path: Path, kind: str) -> Path:
    if kind in ("no relay", "no samples", "one sample"):
        with LogWriter(path, START_NS) as log:
            if kind != "no relay":
                log.add_relay("R1", BITS)
            if kind == "one sample":
                log.relay_block("R1", *(array[:1] for array in rows(2).values()))
        return path
    return write_log(path, n=300 if kind == "short" else 1920, truth=kind != "replay", nan=kind == "nan")


def test_figure_shows_waves_zones_and_times(known: Path) -> None:
    log = open_log(known)
    figure = draw(log, summarize(log))
    voltage, current, timeline, plane, card = figure.axes
    assert [axes.get_ylabel() for axes in (voltage, current)] == ["voltage [kV]", "current [kA]"]
    wave = next(line for line in current.get_lines() if len(line.get_xdata()) > 100)
    assert np.min(wave.get_ydata()) == -9.0  # the peak, in kA
    labels = [label.get_text() for label in timeline.get_yticklabels()]
    assert labels == ["fault", "RDIR1", "PDIS1", "PDIS2", "PTRC1", "Q1"]
    texts = [text.get_text() for text in voltage.texts]
    assert f"trip {(RECEIVED_NS - FAULT_NS) / 1e6:.1f} ms" in texts
    assert f"poles open {(max(OPENED_NS) - FAULT_NS) / 1e6:.1f} ms" in texts
    assert {"PDIS1", "PDIS2", "AG  40.0 %"} <= {text.get_text() for text in plane.texts}
    (x0, x1), (y0, y1) = plane.get_xlim(), plane.get_ylim()
    assert x0 < 1.4 * -5 and x1 > 1.4 * 20 and y1 > 1.4 * 50 and y0 < 0
    assert any("16.38 Ω" in text.get_text() for text in card.texts)


def test_png(known: Path, tmp_path: Path) -> None:
    log = open_log(known)
    write_png(log, summarize(log), tmp_path / "a.png")
    image = imread(tmp_path / "a.png")
    assert image.shape[:2] == (1100, 1120)
    assert len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > 100  # not blank
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize("kind", ["no relay", "no samples", "one sample", "short", "nan", "replay"])
def test_odd_logs(tmp_path: Path, kind: str) -> None:
    log = open_log(odd_log(tmp_path / "odd.mcap", kind))
    summary = summarize(log)
    write_png(log, summary, tmp_path / "odd.png")
    page.write_html(log, summary, tmp_path / "odd.html")
    assert (tmp_path / "odd.png").stat().st_size > 1000


def test_at_most_three_relays_those_that_tripped_first() -> None:
    def relay(*trips: int, samples: int = 1) -> SimpleNamespace:
        return SimpleNamespace(samples=samples, trips=[SimpleNamespace(decided_ns=t) for t in trips])

    relays = {"A": relay(), "B": relay(50), "C": relay(40), "D": relay(30), "E": relay(60, samples=0)}
    assert shown_relays(SimpleNamespace(relays=relays)) == ["B", "C", "D"]  # type: ignore[arg-type]


def test_window_is_around_the_fault(known: Path) -> None:
    start, stop = window_ms(summarize(open_log(known)))
    assert start == -40.0
    assert stop == pytest.approx((max(OPENED_NS) - FAULT_NS) / 1e6 + 40)


def test_thinned_keeps_the_peaks_and_gaps() -> None:
    y = np.sin(np.arange(100_000) / 7.0)
    y[54_321], y[200:20_000] = 9.0, np.nan
    keep = thinned(y, 1000)
    assert len(keep) <= 1002
    assert np.nanmax(y[keep]) == 9.0 and np.nanmin(y[keep]) == np.nanmin(y[keep])
    assert np.isnan(y[keep]).any()
    assert (np.diff(keep) > 0).all() and keep[0] == 0 and keep[-1] == len(y) - 1
    np.testing.assert_array_equal(thinned(y, 100_000), np.arange(100_000))


@pytest.mark.parametrize(("option", "name"), [("--png", "a.jpg"), ("--html", "a"), ("--png", "no/a.png")])
def test_wrong_path_is_one_line(
    known: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, name: str
) -> None:
    assert call(["review", str(known), option, str(tmp_path / name)]) == 2
    error = capsys.readouterr().err
    assert (
        error.count("\n") == 1 and name in error and ("must end in" in error or "cannot be written" in error)
    )
    assert list(tmp_path.iterdir()) == []


def test_folder_in_the_way(known: Path, tmp_path: Path) -> None:
    (tmp_path / "a.png").mkdir()
    log = open_log(known)
    with pytest.raises(InputError, match="cannot be written"):
        write_png(log, summarize(log), tmp_path / "a.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_folder_in_the_way_is_refused_before_the_work(tmp_path: Path) -> None:
    """A suite runs for minutes: `--html` onto a folder is not to be found out at its end."""
    (tmp_path / "a.html").mkdir()
    with pytest.raises(InputError, match="a folder"), write_aside(tmp_path / "a.html", ".html"):
        pytest.fail("the work has begun")


def test_no_line_is_drawn_across_a_gap(tmp_path: Path) -> None:
    """Samples miss in the fault's window, and far from it, where the page's waves are thinned."""
    path, block = tmp_path / "gap.mcap", rows(48_000)
    there = np.ones(48_000, bool)
    there[[*range(600, 700), *range(30_000, 31_000)]] = False
    with LogWriter(path, START_NS) as log:
        log.add_relay("R1", BITS)
        log.relay_block("R1", *(array[there] for array in block.values()))
        log.message("/plant/faults", FAULT_NS, "FaultState", fault=0, on=True, type="AG")
    opened = open_log(path)
    summary = summarize(opened)
    edges = [((block["t_ns"][k] - FAULT_NS) / 1e6, (block["t_ns"][k + n] - FAULT_NS) / 1e6)
             for k, n in ((599, 101), (29_999, 1001))]  # fmt: skip
    ms, samples = drawn(content(opened, summary)["relays"][0])
    for start, stop in edges:
        assert np.isnan(samples[(ms > start) & (ms < stop)]).any(axis=0).all()
    voltage = draw(opened, summary).axes[0]
    for line in voltage.get_lines()[:3]:
        x, y = np.array(line.get_xdata()), np.array(line.get_ydata())
        assert np.isnan(y[(x > edges[0][0]) & (x < edges[0][1])]).any()


def test_names_are_no_markup(tmp_path: Path) -> None:
    """A relay may be called anything that a foreign log says."""
    log = open_log(write_log(tmp_path / "x.mcap", truth=False, relay="<script>alert(1)<"))
    page.write_html(log, summarize(log), tmp_path / "x.html")
    assert "<script>alert" not in (tmp_path / "x.html").read_text(encoding="utf-8")
