"""The time before a run: the same wherever a fault is, and it leads into the run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from faultloop.loop.case import Cases
from faultloop.loop.scenario import load_scenario
from faultloop.loop.warm import history
from faultloop.plant import Plant
from faultloop.relay import Relay

AG = Path(__file__).resolve().parents[2] / "scenarios" / "ag-zone1.toml"


def test_the_same_bits_wherever_the_fault_is() -> None:
    first, other = (history(load_scenario(AG, [f"fault.F1.at_pu={at_pu}"])) for at_pu in (0.1, 0.7))
    assert np.array_equal(first, other)


@pytest.mark.parametrize("model", ["bergeron", "pi"])
def test_it_leads_into_the_run(model: str) -> None:
    """A line in two sections, with a fault's node between, is the whole line but for its charging current:
    lumped resistances and capacitances are elsewhere."""
    scenario = load_scenario(AG, [f"line.AB.model={model!r}"])
    before, own = history(scenario), Plant(scenario).history(4800)
    limit = {"bergeron": 1e-4, "pi": 2e-3}[model]
    for channels in (slice(0, 3), slice(3, 6)):
        step = np.abs(before - own)[:, :, channels].max()
        assert step < limit * np.abs(own[:, :, channels]).max()


def test_a_state_is_made_once_for_all_places(monkeypatch: pytest.MonkeyPatch) -> None:
    cases, runs = Cases(), []
    whole = Relay.warm_up

    def counted(relay: Relay, samples: np.ndarray) -> None:
        runs.append(relay.name)
        whole(relay, samples)

    monkeypatch.setattr(Relay, "warm_up", counted)
    short = ["scenario.duration_s=0.11", "fault.F1.after_s=0.02"]
    for more in (["fault.F1.at_pu=0.3"], ["fault.F1.at_pu=0.6"], ["scenario.seed=7"]):
        cases.prepare(load_scenario(AG, [*short, *more])).run()
    assert sorted(runs) == ["RA", "RB"]
    cases.prepare(load_scenario(AG, [*short, "source.SA.voltage_pu=1.01"])).run()
    assert sorted(runs) == ["RA", "RA", "RB", "RB"]
