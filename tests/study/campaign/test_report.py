"""A campaign's report: its figures from rows made by hand, drawn and told."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import faultloop
from faultloop.cli import call
from faultloop.study.campaign.figures import (
    _middle,
    _told,
    diagrams,
    shots,
    telling_keys,
    times_by_position,
    wrong_answers,
)
from faultloop.study.campaign.parts import KEY
from faultloop.study.campaign.record import fingerprint, record_of
from faultloop.study.campaign.report import changes, report_of, worst_of
from faultloop.study.campaign.results import Results
from faultloop.study.campaign.summary import summary_of
from faultloop.study.campaign.table import arrow, schema_of, started

Tables = dict[str, Any]


def by_hand(folder: Path, tables: Tables, name: str, delay_ms: float = 0.0) -> Path:
    """A campaign's file whose rows are a formula: tripped after 10 ms + 20 ms times the position, and
    wrong beyond 0.8, where RA does not trip.
    """
    campaign = faultloop.Campaign.from_dict(tables, path=folder / "c.toml")
    schema = schema_of(campaign.plan, ["RA", "RB"])
    rows = []
    for number in range(campaign.cases):
        values = campaign.plan.values(number)
        row = started(number, values)
        x = values["fault.F1.at_pu"]
        row |= {"fault_ns": 100_000_000, "verdict": "right", "RB.tripped": False, "RA.tripped": x < 0.8}
        if x < 0.8:
            row["RA.received_ns"] = 100_000_000 + round((10 + 20 * x + delay_ms * (x > 0.5)) * 1e6)
        else:
            row |= {"verdict": "wrong", "reason": "RA: trip expected for a fault inside: no trip"}
        rows.append(row)
    record = record_of(campaign.plan)
    text = json.dumps(record | {"fingerprint": fingerprint(record)}).encode()
    path = folder / name
    pq.write_table(arrow(schema, rows).replace_schema_metadata({KEY: text}), path)
    return path


@pytest.fixture
def results(folder: Path, tables: Tables) -> Results:
    tables["vary"][0] = {"key": "fault.F1.at_pu", "range": [0.05, 0.95, 10]}
    return Results(by_hand(folder, tables, "x.parquet"))


def test_times_by_position(results: Results) -> None:
    diagram = times_by_position(results, "RA")
    assert diagram is not None
    median, slowest = diagram.curves
    (limit,) = diagram.limits
    x = np.arange(0.05, 1.0, 0.1)
    assert np.allclose(np.asarray(median.x), x)
    expected = np.where(x < 0.8, 10 + 20 * x, np.nan)  # there none was tripped
    assert np.allclose(np.asarray(median.y), expected, equal_nan=True)
    assert np.allclose(np.asarray(slowest.y), expected, equal_nan=True)
    assert limit.name == "within 60 ms"
    assert times_by_position(results, "RB") is None


def test_shots_are_where_the_impedance_is(results: Results) -> None:
    """z1 = 6 + j40 ohm, 1 ohm in each phase: A-G at x z1 + 1 / (1 + k0), B-C at x z1 + (1 + 1) / 2."""
    place = results.shot_ohm("RA")
    assert place is not None
    k0 = ((24 + 120j) - (6 + 40j)) / (3 * (6 + 40j))
    x = results.numbers("fault.F1.at_pu")
    ground = results.are("fault.F1.type", "AG")
    assert np.allclose(place[ground], x[ground] * (6 + 40j) + 1 / (1 + k0))
    assert np.allclose(place[~ground], x[~ground] * (6 + 40j) + 1)
    other = results.shot_ohm("RB")
    assert other is not None
    assert np.allclose(other[~ground], (1 - x[~ground]) * (6 + 40j) + 1)
    diagram = shots(results, "RA")
    assert diagram is not None
    points = {curve.name: np.size(curve.x) for curve in diagram.curves if curve.kind == "points"}
    assert points == {"tripped": 16, "wrong": 4}
    assert "PDIS1" in {curve.name for curve in diagram.curves}  # its loops to ground and between phases alike
    assert results.wrong_of("RA").sum() == 4
    assert not results.wrong_of("RB").any()
    cases = {curve.name: curve.told[1] for curve in diagram.curves if curve.told is not None}
    assert np.array_equal(cases["wrong"], [16, 17, 18, 19])


def test_a_fault_on_another_line_is_not_drawn_on_this_one(folder: Path, tables: Tables) -> None:
    """Of RA, on AB, no shot and no time of faults on CD; zones that vary are the first case's."""
    scenario = (folder / "base.toml").read_text(encoding="utf-8")
    line = scenario[scenario.index("[[line]]") : scenario.index("[[breaker]]")]
    (folder / "base.toml").write_text(f"{scenario}\n{line.replace('AB', 'CD')}", encoding="utf-8")
    tables["vary"] += [
        {"key": "fault.F1.line", "values": ["AB", "CD"]},
        {"key": "relay.RA.pdis.1.reach_pu", "values": [0.8, 0.9]},
    ]
    tables["judge"] = [{"relay": "RA", "where": "inside", "trip": True}]
    results = Results(by_hand(folder, tables, "lines.parquet"))
    own = results.are("fault.F1.line", "AB")
    place, diagram = results.shot_ohm("RA"), shots(results, "RA")
    assert place is not None and diagram is not None and own.sum() * 2 == len(own)
    assert np.array_equal(np.isfinite(place.real), own)
    assert sum(np.size(curve.x) for curve in diagram.curves if curve.kind == "points") == own.sum()
    assert "zones of the first case" in {curve.name for curve in diagram.curves}
    times = times_by_position(results, "RA")
    assert times is not None and times.note is not None and "with the fault on its line" in times.note


def test_map_of_wrong_answers(results: Results) -> None:
    diagram = wrong_answers(results, None)
    assert diagram is not None and diagram.surface is not None
    assert (diagram.x_label, diagram.y_label) == ("fault.F1.at_pu", "fault.F1.type")
    assert np.array_equal(diagram.surface.z, [[0.0] * 8 + [100.0] * 2] * 2)
    assert list(diagram.surface.y) == ["AG", "BC"]
    assert diagram.surface.texts() == [[""] * 8 + ["1/1"] * 2] * 2
    turned = wrong_answers(results, ("fault.F1.type", "fault.F1.at_pu"))
    assert turned is not None and turned.surface is not None
    assert np.array_equal(turned.surface.z, diagram.surface.z.T)


def test_names_of_a_map_are_apart() -> None:
    """A plot would put two of one name into one column."""
    assert _told(np.array([0.2, 0.5, 30.0])) == ["0.2", "0.5", "30"]
    assert _told(np.array([49.991, 49.999, 50.007])) == ["49.99", "50", "50.01"]


def test_the_keys_that_tell_the_most(folder: Path, tables: Tables) -> None:
    """Position decides here, and comes first although it is varied last."""
    tables["vary"] = [
        {"key": "fault.F1.resistance_ohm", "values": [0.0, 1.0, 2.0]},
        tables["vary"][1],
        {"key": "fault.F1.at_pu", "range": [0.05, 0.95, 10]},
    ]
    assert telling_keys(Results(by_hand(folder, tables, "x.parquet")))[0] == "fault.F1.at_pu"


def test_tables(results: Results) -> None:
    report = report_of(results)
    assert report.text == ["20 cases: 16 right, 4 wrong, 0 unjudged, 0 failed"]
    times, reasons = report.tables
    (worst,) = worst_of(results).tables
    assert times.rows[0][:3] == ["RA", 16, 4]
    assert times.rows[0][-1] == pytest.approx(10 + 20 * 0.75)
    assert list(reasons.rows) == [["RA: trip expected for a fault inside", "no trip", 4]]
    assert [row[0] for row in worst.rows[:6]] == [16, 17, 18, 19, 14, 15]
    assert worst.rows[0][-1] == f"faultloop campaign-case {results.path} 16"


def test_late_wrong_and_none(results: Results) -> None:
    """A median counts the cases without a trip; what came is told apart; the worst has no trip."""
    x = np.repeat([0.1, 0.5], 4)
    y = np.array([10, 20, 30, np.nan, 10, np.nan, np.nan, np.nan])
    centres, middle, worst = _middle(x, y)
    assert centres.tolist() == [0.1, 0.5]
    assert np.array_equal(middle, [30, np.nan], equal_nan=True)  # the upper of the two in the middle
    assert worst.tolist() == [30, 10]
    table = results.table.to_pydict()
    late = "after 80.9 ms, not within 60 ms (PDIS1 AG 80.9 ms)"
    table["reason"][16] = f"RA: trip expected for a fault inside: {late}"
    table["reason"][17] = "RA: no trip expected for a fault beyond: tripped: PDIS1 AG poles ABC 80.9 ms"
    table["RA.received_ns"][16] = 180_900_000
    results.table = pa.table(table, schema=results.table.schema)
    kinds = {tuple(row[:2]): row[2] for row in report_of(results).tables[1].rows}
    assert kinds == {
        ("RA: trip expected for a fault inside", "not within 60 ms"): 1,
        ("RA: no trip expected for a fault beyond", "tripped: PDIS1 AG poles ABC"): 1,
        ("RA: trip expected for a fault inside", "no trip"): 2,
    }
    assert [row[0] for row in worst_of(results).tables[0].rows[:5]] == [17, 18, 19, 16, 14]


def test_what_changed(folder: Path, tables: Tables, results: Results) -> None:
    new = Results(by_hand(folder, tables, "y.parquet", delay_ms=3.0))
    report = changes(new, results)
    assert report.text == [
        "6 of 20 cases changed: 0 became wrong, 0 right, 6 in time only, 0 in what tripped only"
    ]
    assert {row[0] for row in report.tables[0].rows} == {10, 11, 12, 13, 14, 15}
    assert report.tables[0].rows[0][3] in ("21.0 > 24.0", "23.0 > 26.0", "25.0 > 28.0")
    assert changes(results, results).text == [
        "0 of 20 cases changed: 0 became wrong, 0 right, 0 in time only, 0 in what tripped only"
    ]
    tables["vary"][0]["range"] = [0.05, 0.9, 10]
    with pytest.raises(faultloop.InputError, match=r"values of fault\.F1\.at_pu differ"):
        changes(Results(by_hand(folder, tables, "z.parquet")), results)


def test_page_picture_and_json(results: Results, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, picture = folder / "r.html", folder / "r.png"
    path = str(results.path)
    assert call(["campaign-report", path, path, "--html", str(page), "--png", str(picture), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [report["name"] for report in told["reports"]] == ["campaign", "changes", "worst", "setup"]
    assert told["written"] == [str(page), str(picture)]
    text = page.read_text(encoding="utf-8")
    for diagram in diagrams(results):
        assert diagram.title in text
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=.http", text)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert call(["campaign-report", path]) == 0
    assert "16 right, 4 wrong" in capsys.readouterr().out


def test_names_are_no_markup(folder: Path, tables: Tables) -> None:
    tables["campaign"]["name"] = "<script>alert(1)</script> [/bold]"
    path = by_hand(folder, tables, "x.parquet")
    page = folder / "r.html"
    assert call(["campaign-report", str(path), "--html", str(page)]) == 0
    assert "<script>alert(1)" not in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--map", "fault.F1.at_pu"], "KEY,KEY"),
        (["--map", "fault.F1.at_pu,fault.F1.typ"], "did you mean 'fault.F1.type'"),
        (["--html", "x.png"], ".html"),
        (["none.parquet"], "no such file"),
    ],
)
def test_wrong_arguments(
    results: Results, folder: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(["campaign-report", str(results.path), *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and words in err


def test_a_record_that_is_not_whole(results: Results, folder: Path) -> None:
    """Whatever is taken out of what the file tells of itself: one line."""
    table = pq.read_table(results.path)
    record = json.loads(table.schema.metadata[KEY])
    for key in ("scenario", "settings", "campaign"):
        for change in ({}, {key: {}}, {key: 3}, {key: {"x": 1}}):
            broken = {k: v for k, v in record.items() if k != key} | change
            path = folder / "broken.parquet"
            pq.write_table(table.replace_schema_metadata({KEY: json.dumps(broken).encode()}), path)
            with pytest.raises(faultloop.InputError):
                Results(path)


def test_summary_counts(results: Results) -> None:
    summary = summary_of(results.path, 0)
    assert (summary.cases, summary.right, summary.wrong, summary.errors) == (20, 16, 4, 0)
