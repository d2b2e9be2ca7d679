"""What a scenario and its relays' settings must agree on, told as one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from faultloop.errors import InputError
from faultloop.loop.inputs import Agreement, load_inputs
from faultloop.loop.scenario import Scenario

AG = Path(__file__).resolve().parents[2] / "scenarios" / "ag-zone1.toml"
RA: dict[str, Any] = {
    "relay": {"frequency_hz": 50, "sampling_hz": 4800},
    "line": {"z1_ohm": [3.0, 30.0], "z0_ohm": [12.0, 90.0]},
}


def scenario(**front: float) -> Scenario:
    """The shipped one, whose first relay's inputs have noise."""
    return Scenario.read(AG, [f"relay.RA.front_end.{key}={value}" for key, value in front.items()])


@pytest.mark.parametrize(
    ("front", "tables", "key", "what"),
    [
        (
            {"current_noise_a": 30.0},
            {"ptoc": [{"pickup_a": 500.0}, {"pickup_a": 20.0}]},
            "ptoc[2].pickup_a",
            "20 is not above the noise of relay 'RA', 30 A primary (front_end.current_noise_a): it would "
            "start by itself; above 30",
        ),
        (
            {"current_noise_a": 30.0},
            {"pioc": [{"pickup_a": 30.0}]},
            "pioc[1].pickup_a",
            "30 is not above the noise of relay 'RA', 30 A primary (front_end.current_noise_a): it would "
            "start by itself; above 30",
        ),
        (
            {"current_noise_a": 30.0},
            {"rbrf": {"current_a": 25.0}},
            "rbrf.current_a",
            "25 is not above the noise of relay 'RA', 30 A primary (front_end.current_noise_a): it would "
            "start by itself; above 30",
        ),
        (
            {"voltage_noise_v": 900.0},
            {"ptov": [{"start_v": 800.0}]},
            "ptov[1].start_v",
            "800 is not above the noise of relay 'RA', 900 V primary (front_end.voltage_noise_v): it would "
            "start by itself; above 900",
        ),
        (
            {"current_noise_a": 30.0},
            {
                "relay": {"ohms": "secondary", "ct_ratio": 120.0, "vt_ratio": 2000.0},
                "pioc": [{"pickup_a": 0.2}],
            },
            "pioc[1].pickup_a",
            "0.2 is not above the noise of relay 'RA', 30 A primary (front_end.current_noise_a): it would "
            "start by itself; above 0.25",
        ),
    ],
)
def test_a_pickup_below_the_noise_is_refused(
    front: dict[str, float], tables: dict[str, Any], key: str, what: str
) -> None:
    given = RA | tables | {"relay": RA["relay"] | tables.get("relay", {})}
    with pytest.raises(InputError) as error:
        load_inputs(scenario(**front), {"RA": given})
    assert (error.value.key, error.value.what) == (key, what)
    load_inputs(scenario(), {"RA": given})


def test_what_is_not_the_last_case_s_is_looked_at_again() -> None:
    inputs, agreement = load_inputs(scenario()), Agreement()
    low = load_inputs(scenario(), {"RA": RA | {"pioc": [{"pickup_a": 20.0}]}}).settings
    agreement.check(scenario(), inputs.settings)
    agreement.check(scenario(), low)
    noisy = scenario(current_noise_a=30.0)
    agreement.check(noisy, inputs.settings)
    for settings, refused in ((low, "pioc[1].pickup_a"), (inputs.settings, None), (low, "pioc[1].pickup_a")):
        if refused is None:
            agreement.check(noisy, settings)
            continue
        for _ in range(2):
            with pytest.raises(InputError) as error:
                agreement.check(noisy, settings)
            assert error.value.key == refused
