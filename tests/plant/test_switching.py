"""``[[breaker]] closed`` and ``[[switching]]``: what a scenario has a breaker do by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.loop.scenario import Scenario
from faultloop.nodes import with_followed_breakers
from faultloop.plant import Plant
from tests.examples import scenario
from tests.plant.record import now_ns, record
from tests.plant.reference import BASE_KV, build

BREAKERS = [{"name": "QA", "line": "L", "end": "from"}, {"name": "QB", "line": "L", "end": "to"}]


def switched(
    *operations: dict[str, Any], closed: bool = True, model: str = "bergeron", **tables: Any
) -> Plant:
    """A line between two sources, its breaker at A as told."""
    breakers = [BREAKERS[0] | {"closed": closed}, BREAKERS[1]]
    own = [{"breaker": "QA", **operation} for operation in operations]
    return Plant(build(model, breaker=breakers, switching=own, **tables))


@pytest.mark.parametrize("model", ["rl", "pi", "bergeron"])
def test_an_open_breaker_is_in_the_steady_state(model: str) -> None:
    """No current through it, each side at its own source's voltage, from the first sample on; with it closed
    again the run is the one that begins closed."""
    plant = switched(closed=False, model=model)
    x, changes = record(plant, 960)
    assert not changes and plant.closed("QA") == 0 and plant.closed("QB") == 7
    assert np.abs(x[:, 0, 3:]).max() == 0.0
    assert np.abs(x[:96] - x[-96:]).max() < 1e-9 * np.abs(x).max()
    assert np.abs(x[:, 0, :3]).max() == pytest.approx(BASE_KV * 1e3 * np.sqrt(2 / 3), rel=1e-3)


def test_a_pole_opens_at_the_first_zero_after_the_instant_and_closes_at_it() -> None:
    plant = switched(
        {"operation": "open", "poles": "BC", "at_s": 0.03}, {"operation": "close", "poles": "B", "at_s": 0.08}
    )
    _, changes = record(plant, 480)
    assert [(c.kind, c.index) for c in changes] == [("pole", 0)] * 3
    assert [c.value for c in changes] in ([5, 1, 3], [3, 1, 3])
    assert all(30_000_000 <= c.t_ns <= 40_000_000 for c in changes[:2])
    assert changes[2].t_ns == 80_000_000


def test_a_trip_does_not_take_back_what_is_planned() -> None:
    """A command to open cancels a close that was commanded, not one that the scenario makes later."""
    plant = switched({"operation": "close", "at_s": 0.2})
    record(plant, 100)
    plant.command("QA", "open", 7, now_ns(plant))
    _, changes = record(plant, 1000)
    assert [c.value for c in changes][-1] == 7
    assert changes[-1].t_ns == 200_000_000


def test_a_breaker_of_somebody_elses_does_its_own_switching() -> None:
    own = Scenario.from_dict(scenario(switching=[{"breaker": "QA", "operation": "open", "at_s": 0.1}]))
    assert with_followed_breakers(own, frozenset({"QA"})).switching == ()
    assert with_followed_breakers(own, frozenset({"QB"})).switching == own.switching


def test_a_run_that_begins_later_has_the_rest() -> None:
    operations = [{"breaker": "QA", "operation": "open", "at_s": at} for at in (0.01, 0.1)]
    later = Scenario.from_dict(scenario(switching=operations)).beginning_at(0.04)
    assert [s.at_s for s in later.switching] == [pytest.approx(0.06)]


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (
            {"breaker": "QX", "operation": "open", "at_s": 0.1},
            r"switching\[S1\].breaker: there is no breaker 'QX'",
        ),
        (
            {"breaker": "QA", "operation": "shut", "at_s": 0.1},
            r"switching\[S1\].operation: .*'open' or 'close'",
        ),
        (
            {"breaker": "QA", "operation": "open", "at_s": 9.0},
            r"switching\[S1\].at_s: 9 is not before the end",
        ),
        (
            {"breaker": "QA", "operation": "open", "at_s": 0.1, "poles": "AA"},
            r"switching\[S1\].poles: .*'ABC'",
        ),
    ],
)
def test_wrong_switching(item: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Scenario.from_dict(scenario(switching=[{"breaker": "QA", "operation": "open", "at_s": 0.1} | item]))


def test_a_breaker_does_not_open_and_close_at_once() -> None:
    one = {"breaker": "QA", "operation": "open", "at_s": 0.1}
    with pytest.raises(
        InputError, match=r"switching\[S1\].at_s: switching 'S2' is to close breaker 'QA' then"
    ):
        Scenario.from_dict(scenario(switching=[one, one | {"operation": "close"}]))
    for other in ({"poles": "B"}, {"at_s": 0.11}, {"breaker": "QB"}):
        Scenario.from_dict(scenario(switching=[one | {"poles": "A"}, one | {"operation": "close"} | other]))


@pytest.mark.parametrize(
    ("item", "message"),
    [
        ({"name": "P", "bus": "C", "mw": 1.0}, r"load\[P\].bus: there is no bus 'C'"),
        ({"name": "P", "bus": "B", "mw": -1.0}, r"load\[P\].mw: input should be greater than or equal to 0"),
        ({"name": "P", "bus": "B", "mw": 0.0}, r"load\[P\]: mw and mvar are both zero"),
        (
            {"name": "P", "bus": "B", "mw": 1.0, "connection": "star"},
            r"load\[P\].connection: .*'wye' or 'delta'",
        ),
    ],
)
def test_wrong_loads(item: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Scenario.from_dict(scenario(load=[{"name": "P", "bus": "B", "mw": 1.0} | item]))


def test_a_line_is_energised_in_the_closed_loop(root: Path, tmp_path: Path) -> None:
    """The breaker's status on the bus and in the log is open until it closes, and no relay trips."""
    breakers = [b | {"closed": b["name"] != "QA"} for b in scenario()["breaker"]]
    data = scenario(
        breaker=breakers, switching=[{"breaker": "QA", "operation": "close", "at_s": 0.1}], fault=[]
    )
    result = faultloop.run(
        Scenario.from_dict(data, path=root / "scenarios" / "energising.toml"), log=tmp_path / "run.mcap"
    )
    assert result.trips == []
    log = faultloop.open_log(tmp_path / "run.mcap")
    states = [state for state in log.breaker_states if state.topic == "/breaker/QA"]
    assert [(s.pole_a, s.pole_b, s.pole_c) for s in states] == [(False,) * 3, (True,) * 3]
    assert states[1].t_ns - states[0].t_ns == 100_000_000
