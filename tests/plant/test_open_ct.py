"""A current transformer whose circuit opens."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant

SAMPLES = 480


def scenario(**keys: object) -> Scenario:
    line = {
        "name": "AB", "from": "A", "to": "B", "length_km": 100.0, "model": "rl",
        "r1_ohm_per_km": 0.03, "x1_ohm_per_km": 0.3, "r0_ohm_per_km": 0.3, "x0_ohm_per_km": 1.0,
    }  # fmt: skip
    source = {"z1_ohm": [1.0, 14.0], "z0_ohm": [1.0, 14.0]}
    return Scenario.from_dict({
        "scenario": {"name": "open", "duration_s": 0.1},
        "system": {"frequency_hz": 50, "base_kv": 220.0},
        "source": [
            {"name": "SA", "bus": "A", "angle_deg": 10.0} | source,
            {"name": "SB", "bus": "B"} | source,
        ],
        "line": [line],
        "relay": [{"name": "R", "line": "AB", "end": "from", "settings": "r.toml", "ct": "C"}],
        "ct": [{"name": "C", "ratio": [1000.0, 1.0]} | keys],
    })  # fmt: skip


def sampled(**keys: object) -> np.ndarray:
    plant = Plant(scenario(**keys))
    assert plant.advance(SAMPLES) == SAMPLES
    return plant.samples[:, 0].copy()


@pytest.mark.parametrize("model", ["ideal", "saturating"])
def test_no_current_in_its_phases_while_it_is_open(model: str) -> None:
    more = {"model": model}
    if model == "saturating":
        more |= {"vs_v": 400.0, "burden_ohm": [2.0, 0.5]}  # type: ignore[dict-item]
    whole = sampled(**more)
    got = sampled(**more, open_at_s=0.02, open_for_s=0.05, open_phases="CA")
    first, last = 96, 336
    np.testing.assert_array_equal(got[:, :3], whole[:, :3])
    np.testing.assert_array_equal(got[:, 4], whole[:, 4])
    for phase in (3, 5):
        assert not got[first:last, phase].any()
        np.testing.assert_array_equal(got[:first, phase], whole[:first, phase])
        np.testing.assert_array_equal(got[last:, phase], whole[last:, phase])
    assert np.abs(whole[:, 3]).max() > 100


def test_what_begins_later_has_what_is_left_of_it() -> None:
    own = scenario(open_at_s=0.02, open_for_s=0.05)
    ct = own.ct[0]  # type: ignore[attr-defined]
    assert ct.beginning_at(0.03, own).open_for_s == pytest.approx(0.04)
    assert ct.beginning_at(0.03, own).open_at_s == 0.0
    assert ct.beginning_at(0.01, own).open_at_s == pytest.approx(0.01)
    assert ct.beginning_at(0.01, own).open_for_s == pytest.approx(0.05)
    assert ct.beginning_at(0.08, own).open_at_s is None


@pytest.mark.parametrize(
    ("keys", "key", "what"),
    [
        ({"open_phases": "A"}, "ct[C]", "open_for_s and open_phases need open_at_s"),
        ({"open_at_s": 0.1}, "ct[C].open_at_s", "0.1 is not before the end of the run (duration_s = 0.1)"),
        (
            {"open_at_s": 0.0, "open_phases": "AC"},
            "ct[C].open_phases",
            "input should be 'A', 'B', 'C', 'AB', 'BC', 'CA' or 'ABC', not 'AC'",
        ),
    ],
)
def test_wrong_input(keys: dict[str, object], key: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        Plant(scenario(**keys))
    assert (error.value.key, error.value.what) == (key, what)
