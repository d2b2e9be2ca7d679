"""The distance suite: its cases are what they say, its times a run's, its oracle the network's."""

from __future__ import annotations

import numpy as np
import pytest

import faultloop
from faultloop.study.campaign.where import where_of
from faultloop.study.suites import run_suite
from faultloop.study.suites.distance import PARTS, section
from faultloop.study.suites.distance.network import Network
from faultloop.study.suites.distance.rows import Rows, Times
from faultloop.study.suites.distance.sweep import Sweep, run_sweeps


@pytest.mark.parametrize("part", list(PARTS))
def test_a_part_runs_reduced_and_says_so(part: str) -> None:
    (report,) = run_suite("distance", [part], quick=True)
    assert report.text[0] == "Quick: few of the cases."
    assert report.tables and report.diagrams and report.checks
    assert all(np.isfinite(check.limit) for check in report.checks)
    assert all(diagram.plotly().data for diagram in report.diagrams)


def test_the_rows_are_what_a_run_of_the_case_says(tmp_path) -> None:
    network = Network(sir=5.0)
    sweep = Sweep(
        network, {"MHO": network.settings(network.mho())}, {"at": [0.2, 0.7], "type": ["AG", "ABC"]}
    )
    rows = run_sweeps({"two": sweep}, tmp_path, 1, lambda part: None)["two"]
    assert len(rows) == sweep.cases == 4
    plan = sweep.plan("two")
    for number in range(4):
        case = plan.case(number)
        result = faultloop.run(case.scenario, settings=case.settings, keep=False)
        trip = result.trips[0]
        assert trip.received_ns == rows["MHO.received_ns"][number]
        ms = (trip.received_ns - result.faults[0].t_ns) / 1e6
        assert rows.times("MHO").values[number] == pytest.approx(ms, abs=1e-9)


@pytest.mark.parametrize("part", list(PARTS))
def test_the_place_of_every_fault_is_what_the_network_says(part: str) -> None:
    """`depth` comes from lengths; the campaign's own oracle from the graph."""
    for name, sweep in section(part).sweeps(True).items():
        plan = sweep.plan(name)
        table_keys = sweep.vary
        columns = {
            key: np.array([plan.values(n)[_key(key)] for n in range(plan.cases)]) for key in table_keys
        }
        depth = sweep.depth(Rows(columns, plan.cases))
        depth = np.broadcast_to(depth, plan.cases)
        for number in {0, plan.cases // 2, plan.cases - 1}:
            scenario = plan.case(number).scenario
            d = depth[number]
            told = "none" if np.isnan(d) else "behind" if d < 0 else "beyond" if d >= 1 else "inside"
            if d == 0:  # at A, but on the line's side of the current transformer
                continue
            assert where_of(scenario, scenario.relay[0]) == told


def _key(name: str) -> str:
    from faultloop.study.suites.distance.sweep import KEYS

    return KEYS.get(name, name)


def test_times_with_missed_operations() -> None:
    times = Times(np.array([10.0, 20.0, np.inf, 12.0]))
    assert times.missed == 1
    assert times.figures == (10.0, 12.0, np.inf, np.inf)
    assert times.within(12.0) == 50.0
    assert np.isnan(Times(np.empty(0)).at(0.5))


def test_a_suite_that_takes_no_workers_refuses_them() -> None:
    with pytest.raises(faultloop.InputError, match="takes none"):
        run_suite("bus", quick=True, workers=2)
