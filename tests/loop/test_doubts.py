"""Settings that do not go with where the relay is: told, with the key and what would be right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from faultloop.loop.doubts import scenario_doubts
from faultloop.loop.inputs import load_inputs
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.plant.series_capacitor import SeriesCapacitor
from faultloop.plant.vt import Vt
from faultloop.relay import RelaySettings

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
OWN = {
    "relay": {"frequency_hz": 50, "nominal_kv": 220},
    "line": {"z1_ohm": [6.0, 40.0], "z0_ohm": [24.0, 120.0]},
    "pdis": [{"zone": 1, "reach_pu": 0.8}],
}


def doubts(
    tables: dict[str, Any], *overrides: str, of: dict[str, Any] | None = None, **changes: Any
) -> list[str]:
    """Of relay RA alone, whose place has ``changes``, in a scenario that has tables ``of`` its own."""
    scenario = Scenario.read(SCENARIOS / "ag-zone1.toml", overrides)
    own = RelaySettings.from_dict(OWN | {"ptrc": {}} | tables)
    place = scenario.relay[0].model_copy(update=changes)
    scenario = scenario.model_copy(update={"relay": (place,), **(of or {})})
    found = scenario_doubts(scenario, {"RA": own}, Plant(scenario))
    assert all(text.startswith("settings of relay 'RA': ") for text in found)
    return [text.removeprefix("settings of relay 'RA': ") for text in found]


@pytest.mark.parametrize(
    ("tables", "changes", "told"),
    [
        ({"rrec": {}}, {"breaker": None}, "rrec: needs breaker of relay 'RA' in the scenario"),
        ({"rbrf": {"current_a": 200.0}}, {"breaker": None}, "rbrf: needs breaker of relay 'RA'"),
        ({"rsyn": {}}, {}, "rsyn: needs synchro_vt of relay 'RA'"),
        (
            {"line": OWN["line"] | {"z0m_ohm": [10.0, 60.0]}},
            {},
            "line.z0m_ohm: needs parallel of relay 'RA' in the scenario",
        ),
        ({}, {"back_trip": ("QB",)}, "rbrf: missing: without it relay 'RA' never tells the breakers"),
        (
            {"rbrf": {"current_a": 200.0, "backup_ms": 60.0}},
            {},
            "rbrf.backup_ms: 60 is over before breaker 'QA' is done, and back-trips each time; above 75",
        ),
        (
            {"rbrf": {"current_a": 200.0}, "ptrc": {"mode": "single-pole"}},
            {},
            "rbrf.retrip_ms: 20 is over before breaker 'QA' is done, and opens three poles each time; above",
        ),
        ({"rrec": {"open_wait_ms": 0.0}}, {}, "rrec.open_wait_ms: 0 is over before breaker 'QA' is done"),
        (
            {"rrec": {"close_pulse_ms": 50.0}},
            {},
            "rrec.close_pulse_ms: 50 is over before breaker 'QA' is done, and ends in lockout each time; "
            "above 80",
        ),
        (
            {"relay": {"frequency_hz": 50, "nominal_kv": 220e3}},
            {},
            "relay.nominal_kv: 220000 is 1e+03 of what the scenario has, 220; see the unit, and relay.ohms",
        ),
        (
            {"line": {"z1_ohm": [0.06, 0.4], "z0_ohm": [24.0, 120.0]}},
            {},
            "line.z1_ohm: 0.06+0.4j, of 0.4045 in size, is 0.01 of what the scenario has, 40.45",
        ),
        (
            {"line": {"z1_ohm": [12.0, 80.0], "z0_ohm": [24.0, 120.0]}},
            {},
            "line.z1_ohm: [12, 80] is 100 % off what the scenario has, [6, 40]: zone 1 reaches 1.6 of that",
        ),
        (
            {"line": {"z1_ohm": [40.0, 6.0], "z0_ohm": [24.0, 120.0]}},
            {},
            "line.z1_ohm: [40, 6] is 119 % off what the scenario has, [6, 40]; give the line's own",
        ),
        (
            {"line": {"z1_ohm": [6.0, 40.0], "z0_ohm": [60.0, 290.0]}},
            {},
            "line.z0_ohm: [60, 290] is 142 % off what the scenario has, [24, 120]; give the line's own",
        ),
        (
            {"line": OWN["line"] | {"b1_us": 2.8, "b0_us": 1.8}},
            {},
            (
                "line.b1_us: 2.8 is 0.01 of what the scenario has, 280",
                "line.b0_us: 1.8 is 0.01 of what the scenario has, 180; see the unit",
            ),
        ),
        ({"pioc": [{"pickup_a": 200.0}]}, {}, "pioc[1].pickup_a: 200 is below the load"),
        ({"ptoc": [{"pickup_a": 200.0}]}, {}, "ptoc[1].pickup_a: 200 is below the load"),
        ({"psof": {"current_a": 50.0}}, {}, "psof.current_a: 50 is below the load that the run begins with"),
        ({"ptuv": [{"start_v": 180e3}]}, {}, "ptuv[1].start_v: 180000 is above what the run begins with"),
        ({"ptov": [{"start_v": 70.0}]}, {}, "ptov[1].start_v: 70 is below what the run begins with"),
        (
            {"ptuv": [{"start_v": 230e3, "quantity": "phase-phase"}]},
            {},
            "ptuv[1].start_v: 230000 is above what the run begins with",
        ),
    ],
)
def test_what_does_not_go_together_is_told(
    tables: dict[str, Any], changes: dict[str, Any], told: str | tuple[str, ...]
) -> None:
    expected = (told,) if isinstance(told, str) else told
    found = doubts(tables, **changes)
    assert len(found) == len(expected)
    assert all(text.startswith(one) for text, one in zip(found, expected, strict=True)), found


@pytest.mark.parametrize(
    ("own", "there", "told"),
    [
        (
            {"kind": "ideal"},
            {"circuit": "A1"},
            "vt.kind: \"ideal\", where the scenario's [[vt]] 'V' is capacitive",
        ),
        ({"kind": "cvt", "circuit": "A1"}, None, 'vt.kind: "cvt", where the scenario\'s one is ideal'),
        (
            {"kind": "cvt", "circuit": "P2"},
            {"circuit": "A1"},
            "vt.circuit: passes a voltage that differs by up to 40 % from that of the scenario's [[vt]] 'V'",
        ),
        (
            {"kind": "cvt", "circuit": "P2", "burden_va": 0.0},
            {"circuit": "P2"},
            "vt.circuit: passes a voltage",
        ),
        ({"kind": "cvt", "circuit": "A2", "burden_va": 50.0}, {"circuit": "A2"}, None),
        ({"kind": "cvt", "circuit": "P1"}, {"circuit": "P1"}, None),
        ({}, {"circuit": "A1"}, None),
        ({}, None, None),
    ],
)
def test_another_voltage_transformer_than_the_scenario_s(
    own: dict[str, Any], there: dict[str, Any] | None, told: str | None
) -> None:
    vt = () if there is None else (Vt(name="V", ratio=(220e3, 110.0), model="cvt", **there),)
    found = doubts({"vt": own}, of={"vt": vt}, vt=None if there is None else "V")
    assert len(found) == (told is not None), found
    assert all(text.startswith(str(told)) and "; " in text for text in found), found


def test_a_charging_where_the_scenario_s_line_has_none() -> None:
    line = OWN["line"] | {"b1_us": 280.0, "b0_us": 180.0}
    assert doubts({"line": line}) == []
    none = [f"line.AB.{key}" for key in ("b1_us_per_km=0", "b0_us_per_km=0", 'model="rl"')]
    found = doubts({"line": line}, *none)
    assert found[0] == "line.b1_us: 280, where the scenario's line has none; leave it out"
    assert len(found) == 2


def test_a_long_line_s_charging_that_is_not_told() -> None:
    long = {"z1_ohm": [15.0, 100.0], "z0_ohm": [60.0, 300.0]}
    sizes = ("line.AB.length_km=250", "fault.F1.at_pu=0.5")
    found = doubts({"line": long}, *sizes)
    assert found == [
        "line.b1_us: is not told, and zone 1 ends on a line of 250 km: a fault at its far bus behind a weak "
        "source may measure inside; give b1_us = 700, b0_us = 450"
    ]
    assert doubts({"line": long | {"b1_us": 700.0, "b0_us": 450.0}}, *sizes) == []
    assert doubts({"line": {"z1_ohm": [11.4, 76.0], "z0_ohm": [45.6, 228.0]}}, "line.AB.length_km=190") == []


def test_what_goes_together_is_not() -> None:
    tables = {
        "rrec": {},
        "rbrf": {"current_a": 200.0},
        "pioc": [{"pickup_a": 5000.0}, {"pickup_a": 200.0, "direction": "reverse"}],
        "psof": {"current_a": 3000.0},
        "ptoc": [{"pickup_a": 800.0}, {"pickup_a": 100.0, "quantity": "residual"}],
        "ptuv": [{"start_v": 100e3}, {"start_v": 170e3, "quantity": "phase-phase"}],
        "ptov": [{"start_v": 150e3}, {"start_v": 10e3, "quantity": "residual"}],
    }
    assert doubts(tables) == []
    assert doubts(tables, "breaker.QA.operate_ms=60000") == []  # one that fails, and is meant to


def test_a_line_as_near_as_its_data_may_be_is_that_of_the_scenario() -> None:
    assert doubts({"line": {"z1_ohm": [4.0, 44.0], "z0_ohm": [30.0, 105.0]}}) == []
    bank = SeriesCapacitor(name="SC1", line="AB", at_pu=0.5, x_ohm=20.0)
    compensated = {"z1_ohm": [6.0, 20.0], "z0_ohm": [24.0, 100.0]}
    assert doubts({"line": compensated}, of={"series_capacitor": (bank,)}) == []
    assert doubts({}, of={"series_capacitor": (bank,)}) == []


def test_secondary_values_are_told_in_secondary_ones() -> None:
    tables = {
        "relay": {"frequency_hz": 50, "ohms": "secondary", "ct_ratio": 1000.0, "vt_ratio": 2000.0},
        "line": {"z1_ohm": [3.0, 20.0], "z0_ohm": [12.0, 60.0]},
        "pioc": [{"pickup_a": 0.1}],
    }
    (text,) = doubts(tables)
    assert text.startswith("pioc[1].pickup_a: 0.1 is below the load that the run begins with, 0.")


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.toml")), ids=lambda path: path.stem)
def test_no_shipped_scenario_is_doubted(path: Path) -> None:
    """But for the estimator of one, which is not a safe one and says so."""
    inputs = load_inputs(path)
    found = scenario_doubts(inputs.scenario, inputs.settings, Plant(inputs.scenario))
    assert [text for text in found if "'adaptive-kalman' is none for distance zones" not in text] == []
    assert bool(found) == (path.stem == "lossy-bus")


def test_relays_that_share_a_file_are_told_once(tmp_path: Path) -> None:
    """But for what is of one of them, which is named."""
    own = RelaySettings.from_dict(
        OWN | {"ptrc": {"zones": []}, "psof": {"current_a": 361.5}}, path=tmp_path / "mine.toml"
    )
    scenario = Scenario.read(SCENARIOS / "ag-zone1.toml")
    found = scenario_doubts(scenario, {"RA": own, "RB": own}, Plant(scenario))
    assert [text.removeprefix(f"{tmp_path / 'mine.toml'}: ").split(":")[0] for text in found] == [
        "ptrc.zones",
        "psof.current_a",
    ]
    assert "(relay" not in found[0] and found[1].endswith("(relay 'RA')"), found
