"""Zones that cannot protect together, or may not be meant so, are told, with key and what would be right."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import faultloop
from faultloop.cli import call
from faultloop.relay import RelaySettings
from faultloop.relay.coordination import load_doubts

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
HEAD = {"relay": {"frequency_hz": 50}, "line": {"z1_ohm": [3.0, 30.0], "z0_ohm": [12.0, 90.0]}}
ZONE1 = {"zone": 1, "reach_pu": 0.85}
ZONE2 = {"zone": 2, "reach_pu": 1.25, "delay_ms": 350.0}


def settings(*zones: dict[str, Any], **tables: Any) -> RelaySettings:
    return RelaySettings.from_dict({**HEAD, **tables, "pdis": list(zones)})


@pytest.mark.parametrize(
    ("changed", "key", "words"),
    [
        (
            {"reach_pu": 0.5},
            "pdis[2].reach_pu",
            "is 0.5 of the line and zone 1 (pdis[1]) reaches 0.85",
        ),
        ({"reach_pu": None, "reach_ohm": 20.0}, "pdis[2].reach_ohm", "20 of zone 2 is 0.663 of the line"),
        ({"angle_deg": 20.0}, "pdis[2].reach_pu", "1.25 of zone 2 is 0.542"),
        ({"zone": 3, "reach_pu": 0.7}, "pdis[2].reach_pu", "a zone of a higher number reaches farther"),
    ],
)
def test_a_higher_zone_that_reaches_less_far_is_told(changed: dict[str, Any], key: str, words: str) -> None:
    zone = {name: value for name, value in (ZONE2 | changed).items() if value is not None}
    (doubt,) = settings(ZONE1, zone).doubts
    assert doubt.key == key
    assert words in doubt.text


def test_a_zone_extension_is_beyond_the_line_and_meant() -> None:
    extension = {"zone": 5, "reach_pu": 1.3}
    assert [doubt.key for doubt in settings(ZONE1, ZONE2, extension).doubts] == [
        "pdis[3].reach_pu",
        "pdis[3].delay_ms",
    ]
    assert settings(ZONE1, ZONE2, extension, rrec={"extension_zone": 5}).doubts == []


@pytest.mark.parametrize(
    ("first", "second", "key"),
    [
        ({"delay_ms": 400.0}, {}, "pdis[2].delay_ms"),
        ({"delay_ms": 100.0}, {"delay_ground_ms": 0.0}, "pdis[2].delay_ground_ms"),
        ({"delay_ms": 100.0}, {"delay_phase_ms": 0.0}, "pdis[2].delay_phase_ms"),
    ],
)
def test_a_higher_zone_that_trips_sooner_is_told(
    first: dict[str, Any], second: dict[str, Any], key: str
) -> None:
    found = settings(ZONE1 | first, ZONE2 | second).doubts
    assert [doubt.key for doubt in found if "waits at least as long" in doubt.text] == [key]


def test_what_is_in_order_is_meant() -> None:
    """Other directions, other loops, the same zone in two shapes, zones that do not trip, none at all."""
    reverse = {"zone": 3, "reach_pu": 0.5, "direction": "reverse", "delay_ms": 600.0}
    offset = {"zone": 4, "reach_pu": 0.3, "direction": "none", "delay_ms": 1000.0}
    ground = {"zone": 1, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": 10.0}
    assert not settings(ZONE1, ground | {"loops": "ground"}, ZONE2, reverse, offset).doubts
    assert not settings(ZONE1 | {"loops": "phase"}, {"zone": 2, "reach_pu": 0.7, "loops": "ground"}).doubts
    assert not settings(ZONE2, {"zone": 3, "reach_pu": 0.4}, ptrc={"zones": [2]}).doubts
    assert not settings().doubts


@pytest.mark.parametrize(
    ("zone", "key"),
    [
        ({"reach_pu": 1.2}, "pdis[1].reach_pu"),
        ({"reach_pu": None, "reach_ohm": 31.0}, "pdis[1].reach_ohm"),
        ({"reach_pu": 1.2, "delay_ms": 90.0}, "pdis[1].reach_pu"),
        ({"reach_pu": 1.2, "delay_ms": 300.0, "delay_ground_ms": 0.0}, "pdis[1].reach_pu"),
        ({"residual_compensation_factor": [1.3, 0.0]}, "pdis[1].residual_compensation_factor"),
        ({"reach_pu": 1.2, "direction": "none"}, "pdis[1].reach_pu"),
    ],
)
def test_a_zone_beyond_the_line_that_does_not_wait_is_told(zone: dict[str, Any], key: str) -> None:
    given = {name: value for name, value in (ZONE1 | zone).items() if value is not None}
    (doubt,) = settings(given).doubts
    assert doubt.key == key
    assert "beyond the line" in doubt.text
    assert "0.8 of the line is usual" in doubt.text


@pytest.mark.parametrize(
    ("zone", "told"),
    [
        (
            {"reach_pu": 1.0},
            "pdis[1].reach_pu: 1 of the line of zone 1 trips after 0 ms for faults beyond the line, with an "
            "error of 5 %; 0.8 of the line is usual, or a delay of 300 ms, or a zone that is not in "
            "ptrc.zones",
        ),
        (
            {"direction": "none"},
            'pdis[1].direction: "none" of zone 1 trips after 0 ms for faults behind the relay, too; '
            '"forward" is usual, or a delay of 300 ms, or a zone that is not in ptrc.zones',
        ),
        (
            {"residual_compensation_factor": [-1.0, 0.0]},
            "pdis[1].residual_compensation_factor: lets the ground loops reach 0 of the line, not 0.85; the "
            "line's own is [0.67, -0.033]",
        ),
    ],
)
def test_a_zone_that_errors_or_no_direction_make_unselective_is_told(zone: dict[str, Any], told: str) -> None:
    (doubt,) = settings(ZONE1 | zone).doubts
    assert f"{doubt.key}: {doubt.text}" == told
    assert not settings(ZONE1 | zone | {"delay_ms": 300.0, "residual_compensation_factor": None}).doubts


def test_a_zone_beyond_the_line_that_waits_or_does_not_trip_is_meant() -> None:
    assert not settings(ZONE1, ZONE2).doubts
    assert not settings(ZONE1, ZONE2 | {"delay_ms": 0.0}, ptrc={"zones": [1], "pilot_zone": 2}).doubts
    assert not settings(ZONE1 | {"reach_pu": 1.2, "direction": "reverse"}).doubts


@pytest.mark.parametrize(
    ("zone", "load", "limit"),
    [
        # the chord of a circle of 1.25 x 30.15 ohm at 84.29 degrees along 30 degrees is 22.0 ohm
        ({}, 21.5 * np.exp(1j * np.pi / 6), 0.8 * 21.5 / np.cos(np.radians(84.2894 - 30)) / 30.1496),
        ({"characteristic": "quad", "resistive_reach_ohm": 40.0}, 30 + 5j, 24.0),
        ({"direction": "none"}, -30 + 5j, 0.8 * abs(-30 + 5j) / 30.1496),
    ],
)
def test_a_zone_that_holds_the_load_is_told_and_what_would_be_clear_of_it(
    zone: dict[str, Any], load: complex, limit: float
) -> None:
    (doubt,) = load_doubts(settings(ZONE2 | zone), load)
    assert "holds the load" in doubt.text
    assert f"below {limit:.3g} " in doubt.text
    key = doubt.key.removeprefix("pdis[1].")
    clear = settings(ZONE2 | zone | {key: float(f"{limit:.3g}")})
    assert not load_doubts(clear, load)


def test_a_load_beside_every_zone_is_none_inside() -> None:
    chosen = settings(ZONE1, ZONE2, {"zone": 4, "reach_pu": 3.0, "loops": "ground", "delay_ms": 900.0})
    assert not load_doubts(chosen, 23 * np.exp(1j * np.pi / 6))
    assert not load_doubts(chosen, complex(-20, -8))


@pytest.mark.parametrize(
    ("zones", "zload", "told"),
    [
        # the circle of 0.85 x 30.15 ohm at 84.29 degrees is 25.63 cos(84.29 - 30) = 14.96 ohm at 30 degrees
        (
            [ZONE1, ZONE2],
            {"resistance_ohm": 12.0},
            "zload.resistance_ohm: 12 is inside zone 1 (pdis[1]), which reaches 14.9 ohm within 30 degrees: "
            "a three-phase fault with an arc there does not trip; above 14.9 it is clear of it",
        ),
        (
            [{"zone": 1, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": 20.0}],
            {"resistance_ohm": 16.0, "angle_deg": 20.0},
            "zload.resistance_ohm: 16 is inside zone 1 (pdis[1]), which reaches 22 ohm within 20 degrees: a "
            "three-phase fault with an arc there does not trip; above 22 it is clear of it",
        ),
        (
            [ZONE2, {"zone": 3, "reach_pu": 0.8, "direction": "reverse"}],
            {"resistance_ohm": 22.0, "reverse_resistance_ohm": 10.0},
            "zload.reverse_resistance_ohm: 10 is inside zone 3 (pdis[2]), which reaches 14.1 ohm within 30 "
            "degrees: a three-phase fault with an arc there does not trip; above 14.1 it is clear of it",
        ),
        ([ZONE1, ZONE2], {"resistance_ohm": 15.0}, None),
        ([ZONE1 | {"loops": "ground"}], {"resistance_ohm": 5.0}, None),
        ([ZONE1 | {"delay_ms": 300.0}], {"resistance_ohm": 5.0}, None),
    ],
)
def test_an_area_of_loads_inside_a_zone_without_delay_is_told(
    zones: list[dict[str, Any]], zload: dict[str, Any], told: str | None
) -> None:
    found = [f"{doubt.key}: {doubt.text}" for doubt in settings(*zones, zload=zload).doubts]
    assert found == ([told] if told else [])


def test_a_load_that_is_cut_out_is_held_by_no_zone() -> None:
    far = {"zone": 3, "reach_pu": 4.8, "delay_ms": 900.0}
    load = complex(47.0, 17.1)
    (doubt,) = load_doubts(settings(ZONE1, far), load)
    assert doubt.key == "pdis[2].reach_pu"
    assert not load_doubts(settings(ZONE1, far, zload={"resistance_ohm": 40.0}), load)
    (doubt,) = load_doubts(settings(ZONE1, far, zload={"resistance_ohm": 55.0}), load)
    assert doubt.key == "pdis[2].reach_pu"


def test_a_swings_box_around_the_load_is_told() -> None:
    boxes = {"outer_resistance_ohm": 100.0, "inner_resistance_ohm": 80.0}
    load = 50 * np.exp(1j * np.radians(20))
    (doubt,) = load_doubts(settings(ZONE1, rpsb=boxes, zload={"resistance_ohm": 40.0}), load)
    assert f"{doubt.key}: {doubt.text}" == (
        "rpsb.outer_resistance_ohm: 100 holds the load of 50 ohm at 20 degrees, where no swing is found; "
        "below 36 it is clear of it"
    )
    clear = boxes | {"outer_resistance_ohm": 36.0, "inner_resistance_ohm": 20.0}
    assert not load_doubts(settings(ZONE1, rpsb=clear), load)


def zones_of(tmp_path: Path, text: str) -> list[str]:
    """Arguments of a run of the shipped scenario with these zones in place of its settings' own."""
    head = (SCENARIOS / "settings" / "ab-mho.toml").read_text(encoding="utf-8").split("[[pdis]]")[0]
    path = tmp_path / "mine.toml"
    path.write_text(head + text, encoding="utf-8")
    scenario = tmp_path / "mine-scenario.toml"
    body = (
        (SCENARIOS / "ag-zone1.toml").read_text(encoding="utf-8").replace("settings/ab-mho.toml", "mine.toml")
    )
    scenario.write_text(body, encoding="utf-8")
    return [str(scenario), str(path)]


BEYOND = "[[pdis]]\nzone = 1\nreach_pu = 1.3\n[[pdis]]\nzone = 3\nreach_pu = 80.0\ndelay_ms = 900\n"


def test_check_and_run_tell_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, own = zones_of(tmp_path, BEYOND)
    assert call(["check", own, "--json"]) == 0
    (beyond,) = json.loads(capsys.readouterr().out)["warnings"]
    assert beyond.startswith(f"{own}: pdis[1].reach_pu: 1.3 of the line")
    assert call(["check", scenario, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["warnings"]
    assert any("pdis[2].reach_pu: 80 of zone 3 holds the load" in text for text in told), told
    result = faultloop.run(scenario)
    assert list(result.warnings) == told


ZONE4 = {"zone": 4, "reach_pu": 2.0, "delay_ms": 1000.0}


@pytest.mark.parametrize(
    ("zones", "told"),
    [
        (
            [ZONE1, ZONE2 | {"reach_pu": 0.95}, ZONE4],
            "a fault at its end waits 1000 ms for zone 4; 1.2 of the",
        ),
        (
            [ZONE1, ZONE2 | {"reach_pu": 1.0}],
            "1 of the line is not beyond it, with an error of 5 %: a fault at",
        ),
        ([ZONE1, ZONE2 | {"delay_ground_ms": 50.0}], "beyond the line"),
        ([ZONE1, ZONE2 | {"reach_pu": 1.06}], None),
        ([ZONE1], None),
        ([ZONE2 | {"reach_pu": 0.95}], None),
        ([ZONE1, ZONE2 | {"reach_pu": 0.95, "direction": "reverse"}, ZONE4], None),
    ],
)
def test_a_next_zone_that_is_not_sure_of_the_line_s_end(
    zones: list[dict[str, Any]], told: str | None
) -> None:
    found = settings(*zones).doubts
    assert len(found) == (told is not None), found
    assert all(doubt.key == "pdis[2].reach_pu" and str(told) in doubt.text for doubt in found), found


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ({"ptrc": {"zones": []}}, "ptrc.zones: []: no zone trips, of [1, 2]; name those that do"),
        ({"psof": {"delay_ms": 0.0}}, "psof.delay_ms: 0 is shorter than the estimator's window"),
        (
            {"psof": {"reach_pu": 10.0}},
            "psof.reach_pu: 10 of the line takes a fault far beyond it, or a load",
        ),
        (
            {"estimator": {"method": "ekf", "unsafe": True}},
            "estimator.method: 'ekf' is none for distance zones, taken as unsafe = true: it has no state for",
        ),
    ],
)
def test_what_stands_beside_the_zones_is_told(tables: dict[str, Any], told: str) -> None:
    (doubt,) = settings(ZONE1, ZONE2, **tables).doubts
    assert f"{doubt.key}: {doubt.text}".startswith(told)


@pytest.mark.parametrize(
    "tables",
    [
        {"ptrc": {"zones": [1]}},
        {"ptrc": {"zones": [], "pilot_zone": 2}, "psch": {"type": "pott"}},
        {"psof": {"delay_ms": 20.0, "reach_pu": 1.5}},
        {"psof": {"delay_ms": 0.0, "reach_pu": 10.0, "trip": False}},
        {"estimator": {"method": "fourier", "unsafe": True}},
    ],
)
def test_what_may_stand_beside_the_zones_is_not(tables: dict[str, Any]) -> None:
    assert settings(ZONE1, ZONE2, **tables).doubts == []


CVT = '[[vt]]\nname = "V"\nratio = [220000, 110]\nmodel = "cvt"\n'


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        ('circuit = "P9"', "vt[V].circuit", "'P1', 'P2', 'A1' or 'A2'"),
        ('circuit = "P1"\nburden_va = -5', "vt[V].burden_va", "greater than or equal to 0"),
        ("circuit = {ce_nf = 0.0, rf_ohm = 1.0}", "vt[V].circuit", "greater than 0"),
        ("circuit = {ce_nf = 100.0}", "vt[V].circuit", "rf_ohm"),
        ("", "vt[V]", "needs circuit"),
    ],
)
def test_a_capacitive_transformer_that_is_none_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, key: str, words: str
) -> None:
    scenario, _ = zones_of(tmp_path, "")
    path = Path(scenario)
    path.write_text(path.read_text(encoding="utf-8") + CVT + text + "\n", encoding="utf-8")
    for command in ("check", "run"):
        assert call([command, scenario]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert f"{scenario}: {key}" in error, error
        assert words in error
