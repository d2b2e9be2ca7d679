"""Inverters and their transformers: what is refused; the outcomes are cases of `suite functions`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from faultloop.errors import InputError
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.study.suites.functions.two_ended import network

INVERTER = {"name": "I", "bus": "B", "rated_mva": 100.0, "power_mw": 50.0}


def built(**tables: Any) -> Plant:
    return Plant(Scenario.from_dict(network("rl", **tables)))


@pytest.mark.parametrize(
    ("tables", "key", "what"),
    [
        (
            {"inverter": [INVERTER | {"bus": "C"}]},
            "inverter[I].bus",
            "there is no bus 'C'; known: A, B",
        ),
        (
            {"inverter": [INVERTER | {"power_mw": 130.0}]},
            "inverter[I]",
            "power_mw is more than its current limit allows, 120 MW",
        ),
        (
            {"inverter": [INVERTER | {"rated_mva": 1e5, "power_mw": 9e4}]},
            "inverter[I].power_mw",
            "the network cannot take this power; give less, or a stronger network",
        ),
        (
            {"inverter": [INVERTER | {"rated_mva": 2000.0, "power_mw": 1800.0}]},
            "inverter[I].power_mw",
            "its bus would be at 0.87 per unit, below 0.9; give less, or a stronger network",
        ),
        (
            {"transformer": [{"name": "T", "bus": "B", "delta_bus": "B", "rated_mva": 50.0, "x_pu": 0.1}]},
            "transformer[T].delta_bus",
            "is the star side's bus, too; give the delta side one of its own",
        ),
    ],
)
def test_what_is_wrong_is_named(tables: dict[str, Any], key: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        built(**tables)
    assert ((error.value.key or "").startswith(key), error.value.what) == (True, what)


def test_a_source_of_another_frequency_leaves_an_inverter_no_steady_state() -> None:
    data = network("rl", inverter=[INVERTER])
    data["source"][0]["frequency_hz"] = 49.0
    with pytest.raises(InputError) as error:
        Plant(Scenario.from_dict(data))
    assert error.value.key == "source[A].frequency_hz"
    assert "source 'A' has a frequency of its own" in error.value.what


def test_an_inverter_alone_on_an_island_is_refused() -> None:
    data = network("rl", inverter=[INVERTER | {"bus": "Y"}])
    data["line"].append({**data["line"][0], "name": "M", "from": "X", "to": "Y"})
    with pytest.raises(InputError) as error:
        Plant(Scenario.from_dict(data))
    assert error.value.key == "line[M].from"
    assert "bus 'X' reaches no source" in error.value.what


def test_an_inverter_behind_open_breakers_is_refused(tmp_path: Path) -> None:
    """Not for its power, and without a warning of numpy's; the file is named."""
    data = network("rl", inverter=[INVERTER | {"bus": "Y"}])
    data["line"].append({**data["line"][0], "name": "M", "from": "B", "to": "Y"})
    data["breaker"] = [{"name": "Q", "line": "M", "end": "from", "closed": False}]
    with pytest.raises(InputError) as error:
        Plant(Scenario.from_dict(data, path=tmp_path / "x.toml"))
    assert error.value.key == "inverter[I].bus"
    assert (error.value.file or "").endswith("x.toml")
    assert "bus 'Y' reaches no source through closed breakers" in error.value.what
