"""The distance suite: its cases are what they say, its times a run's, its oracle the network's."""

from __future__ import annotations

import numpy as np
import pytest

import faultloop
from faultloop.loop.case import Cases
from faultloop.loop.recording import MemorySink
from faultloop.study.campaign.where import where_of
from faultloop.study.diagram import Curve, Diagram, Surface, write_png
from faultloop.study.suites import run_suite
from faultloop.study.suites.distance import PARTS, module_of
from faultloop.study.suites.distance.closed_form import measured, resistance_at
from faultloop.study.suites.distance.network import Network
from faultloop.study.suites.distance.rows import Rows, Times
from faultloop.study.suites.distance.sections import ct_saturation
from faultloop.study.suites.distance.security import wrong
from faultloop.study.suites.distance.sweep import KEYS, Sweep, run_sweeps


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
    rows = sweep.rows(run_sweeps({"two": sweep}, tmp_path, 1, lambda part: None)["two"])
    assert len(rows) == sweep.cases == 4
    plan = sweep.plan("two")
    for number in range(4):
        case = plan.case(number)
        result = faultloop.run(case.scenario, settings=case.settings, keep=False)
        trip = result.trips[0]
        assert trip.received_ns is not None
        assert trip.received_ns == rows["MHO.received_ns"][number]
        ms = (trip.received_ns - result.faults[0].t_ns) / 1e6
        assert rows.times("MHO").values[number] == pytest.approx(ms, abs=1e-9)


@pytest.mark.parametrize("part", list(PARTS))
def test_the_place_of_every_fault_is_what_the_network_says(part: str) -> None:
    """`depth` comes from lengths; the campaign's own oracle from the graph."""
    for name, sweep in module_of(part).sweeps(True).items():
        plan = sweep.plan(name)
        table_keys = sweep.vary
        columns = {
            key: np.array([plan.values(n)[KEYS.get(key, key)] for n in range(plan.cases)])
            for key in table_keys
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


@pytest.mark.slow  # two processes that start
def test_two_workers_find_what_one_does() -> None:
    one, two = (run_suite("distance", ["evolving"], quick=True, workers=n)[0].as_dict() for n in (1, 2))
    assert one == two


def test_times_with_missed_operations() -> None:
    times = Times(np.array([10.0, 20.0, np.inf, 12.0]))
    assert times.missed == 1
    assert times.figures == (10.0, 12.0, np.inf, np.inf)
    assert times.within(12.0) == 50.0
    assert np.isnan(Times(np.empty(0)).at(0.5))


def test_a_case_that_cannot_be_run_costs_its_own_report_only(monkeypatch) -> None:
    """A core that the load alone saturates: told, and the other part is there."""
    real = ct_saturation.transformer
    monkeypatch.setattr(ct_saturation, "transformer", lambda vs, remanence: real(0.01 * vs, remanence))
    monkeypatch.setattr(ct_saturation, "voltage_for", lambda *what: 100.0)
    bad, good = run_suite("distance", ["ct-saturation", "evolving"], quick=True)
    assert "the load alone needs" in bad.failed and not bad.held
    assert not good.failed and good.tables


def test_a_suite_that_takes_no_workers_refuses_them() -> None:
    with pytest.raises(faultloop.InputError, match="takes none"):
        run_suite("bus", quick=True, workers=2)


@pytest.mark.parametrize("kind", ["AG", "BC", "ABC"])
def test_the_closed_form_is_what_the_plant_settles_to(kind: str) -> None:
    """Two independent ways to the same loop: sequence networks, and the plant with a full-cycle DFT."""
    network = Network(sir=5.0, model="rl", far_sir=None, beyond_km=0.0, angle_deg=0.0, duration_s=0.4)
    own = {"R": network.settings(network.mho(delay_ms=1e5), estimator={"method": "fourier"})}
    fault = {"line": "AB", "at_pu": 0.5, "type": kind, "resistance_ohm": 7.0}
    case = Sweep(network, own, {"angle": [0.0]}, fault).plan("one").case(0)
    sink = MemorySink()
    Cases().prepare(case.scenario, case.settings).run([sink])
    row = sink.array("R", "phasors")[-1]
    v, i = (np.array([complex(row[f"{q}{p}_re"], row[f"{q}{p}_im"]) for p in "abc"]) for q in "vi")
    loop = measured(network, kind, 0.5, 7.0)
    k0 = (network.z0_ohm - network.z1_ohm) / (3 * network.z1_ohm)
    z = v[0] / (i[0] + k0 * i.sum()) if kind == "AG" else (v[1] - v[2]) / (i[1] - i[2])
    assert z == pytest.approx(loop.voltage / loop.current, rel=2e-3)
    assert abs(v[0] if kind == "AG" else v[1] - v[2]) == pytest.approx(abs(loop.voltage), rel=2e-3)


def test_the_boundary_of_a_mho_is_on_its_circle() -> None:
    """Behind a source of next to no impedance the polarizing voltage is the loop's own: the static circle."""
    network = Network(sir=1e-6)
    for place in (0.1, 0.4, 0.7):
        r = resistance_at(network, "mho", "ABC", 0.8, place)
        centre = 0.4 * network.z1_ohm
        assert abs(place * network.z1_ohm + r - centre) == pytest.approx(abs(centre), rel=1e-4)


def test_the_core_saturates_when_it_is_told_to() -> None:
    for ms in (3.0, 7.0):
        vs = ct_saturation.voltage_for(ms, 0.0, 4000.0, 6.67)
        got = ct_saturation.time_to_saturation_ms(vs, 0.0, 4000.0, 6.67)
        assert got == pytest.approx(ms, abs=2e3 / ct_saturation.STEPS_PER_S)
        assert ct_saturation.voltage_for(ms, 0.5, 4000.0, 6.67) > vs  # remanence wants a higher knee


def test_wrong_operations_are_counted_by_place() -> None:
    depth = np.array([-0.5, -1e-6, 0.0, 0.83, 0.84, 0.99, 1.0, 1.4])
    tripped = np.ones(8, bool)
    rows = Rows({"depth": depth, **{f"{r}.tripped": tripped for r in ("MHO", "FWD", "REV")}}, 8)
    assert [(w.cases, w.operated) for w in wrong(rows)] == [(2, 2), (2, 2), (2, 2), (2, 2), (6, 6)]


def test_a_diagram_is_drawn_alike(tmp_path) -> None:
    surface = Surface([1, 2], [0.5, 1.0], np.array([[1.0, np.nan], [3.0, 4.0]]), [1.0, 5.0])
    diagrams = [
        Diagram(
            "curves", "x", "y", [Curve("a", [1, 2], [3, 4]), Curve("b", [1, 2], [1, 2], "band", upper=[2, 3])]
        ),
        Diagram("surface", "x", "y", surface=surface),
    ]
    write_png("both", diagrams, tmp_path / "d.png")
    assert (tmp_path / "d.png").read_bytes()[:4] == b"\x89PNG"
    assert [len(diagram.plotly().data) for diagram in diagrams] == [2, 1]
