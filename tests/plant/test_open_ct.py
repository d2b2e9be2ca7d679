"""A transformer whose circuit to the relay opens."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant

SAMPLES = 480


def scenario(table: str, **keys: object) -> Scenario:
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
        "relay": [{"name": "R", "line": "AB", "end": "from", "settings": "r.toml", table: "T"}],
        table: [{"name": "T", "ratio": [1000.0, 1.0]} | keys],
    })  # fmt: skip


def sampled(table: str, **keys: object) -> np.ndarray:
    plant = Plant(scenario(table, **keys))
    assert plant.advance(SAMPLES) == SAMPLES
    return plant.samples[:, 0].copy()


SATURATING = {"model": "saturating", "vs_v": 400.0, "burden_ohm": [2.0, 0.5]}
CVT = {"model": "cvt", "circuit": "P1"}


@pytest.mark.parametrize(
    ("table", "first", "more"), [("ct", 3, {}), ("ct", 3, SATURATING), ("vt", 0, {}), ("vt", 0, CVT)]
)
def test_nothing_in_its_phases_while_it_is_open(table: str, first: int, more: dict[str, object]) -> None:
    whole = sampled(table, **more)
    got = sampled(table, **more, open_at_s=0.02, open_for_s=0.05, open_phases="CA")
    begins, ends = 96, 336
    for channel in set(range(6)) - {first, first + 2}:
        np.testing.assert_array_equal(got[:, channel], whole[:, channel])
    for channel in (first, first + 2):
        assert not got[begins:ends, channel].any()
        np.testing.assert_array_equal(got[:begins, channel], whole[:begins, channel])
        np.testing.assert_array_equal(got[ends:, channel], whole[ends:, channel])
    assert np.abs(whole[:, first]).max() > 100


def test_what_begins_later_has_what_is_left_of_it() -> None:
    own = scenario("ct", open_at_s=0.02, open_for_s=0.05)
    ct = own.ct[0]  # type: ignore[attr-defined]
    assert ct.beginning_at(0.03, own).open_for_s == pytest.approx(0.04)
    assert ct.beginning_at(0.03, own).open_at_s == 0.0
    assert ct.beginning_at(0.01, own).open_at_s == pytest.approx(0.01)
    assert ct.beginning_at(0.01, own).open_for_s == pytest.approx(0.05)
    assert ct.beginning_at(0.08, own).open_at_s is None


@pytest.mark.parametrize("table", ["ct", "vt"])
def test_its_defaults_may_be_written(table: str) -> None:
    """As in the scenario that a log has, which `why` and `replay` read."""
    written = scenario(table).model_dump(by_alias=True)
    assert written[table][0]["open_at_s"] is None
    assert written[table][0]["open_phases"] == "ABC"
    assert Scenario.from_dict(written) == scenario(table)


@pytest.mark.parametrize(
    ("keys", "key", "what"),
    [
        ({"open_phases": "A"}, "{table}[T]", "open_for_s and open_phases need open_at_s"),
        (
            {"open_at_s": 0.1},
            "{table}[T].open_at_s",
            "0.1 is not before the end of the run (duration_s = 0.1)",
        ),
        (
            {"open_at_s": 0.0, "open_phases": "AC"},
            "{table}[T].open_phases",
            "input should be 'A', 'B', 'C', 'AB', 'BC', 'CA' or 'ABC', not 'AC'",
        ),
    ],
)
@pytest.mark.parametrize("table", ["ct", "vt"])
def test_wrong_input(table: str, keys: dict[str, object], key: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        Plant(scenario(table, **keys))
    assert (error.value.key, error.value.what) == (key.format(table=table), what)
