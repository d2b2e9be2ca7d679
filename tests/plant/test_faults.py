"""When and where faults begin and end, several of them, and Kirchhoff's current law through all of it."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.plant import Plant
from tests.plant.record import record
from tests.plant.reference import build, phasors, solve


def fault(name: str, kind: str, **more: object) -> dict[str, object]:
    return {"name": name, "line": "L", "at_pu": 0.45, "type": kind, "start_s": 0.02, **more}


@pytest.mark.parametrize(
    ("kind", "phases"), [("BG", (1, None)), ("CA", (2, 0)), ("BCG", (1, None)), ("ABC", (0, None))]
)
@pytest.mark.parametrize("angle", [0.0, 60.0, 245.0])
def test_point_on_wave(kind: str, phases: tuple[int, int | None], angle: float) -> None:
    tables = {"system": {"sampling_hz": 19200, "steps_per_sample": 1}}
    event = fault("F", kind, angle_deg=angle, after_s=0.013)
    del event["start_s"]
    plant = Plant(build("bergeron", fault=[event], **tables))
    _, changes = record(plant, 1000)
    start = changes[0].t_ns * 1e-9
    assert 0.013 <= start < 0.0331
    quiet = Plant(build("bergeron", fault=[fault("F", kind, start_s=1.0)], **tables))
    wave = []
    for _ in range(384):
        quiet.advance(1)
        v = quiet.probe.voltage("L@0.45")
        wave.append(v[phases[0]] - (v[phases[1]] if phases[1] is not None else 0.0))
    phasor = phasors(np.array(wave)[:, None, None], 0, 19200).item()
    # cos phase + 90 degrees is the angle from the rising zero; a step is 0.94 degrees
    found = np.degrees(np.angle(phasor * np.exp(2j * np.pi * 50 * start))) + 90
    assert abs((found - angle + 180) % 360 - 180) < 0.5


def test_a_fault_between_steps_is_snapped_and_said() -> None:
    plant = Plant(build("rl", fault=[fault("F", "AG", start_s=0.0200301)]))
    assert plant.notes == ["fault F: begins at 20.052083 ms, the step nearest to 20.030100 ms"]
    _, changes = record(plant, 200)
    assert changes[0].t_ns == 385 * 10**9 // 19200


@pytest.mark.parametrize("kind", ["AG", "BC", "ABC", "CAG"])
def test_a_removed_fault_leaves_the_state_before_it(kind: str) -> None:
    event = fault("F", kind, duration_s=0.0503)
    plant = Plant(build("bergeron", fault=[event]))
    x, changes = record(plant, 96 * 40)
    assert [c.value for c in changes] == [1, 0]
    assert 0.0 <= changes[1].t_ns * 1e-9 - 0.0703 < 0.0201  # at the last phase's current zero
    assert np.abs(phasors(x, 0, 4800) - phasors(x[:96], 0, 4800)).max() < 0.02 * np.abs(x[:96]).max()
    assert np.abs(plant.probe.fault_current("F")).max() == 0.0


def test_a_fault_evolves() -> None:
    """A phase to ground, 30 ms later the two others, at the same point: in the end as a three-phase fault."""
    plant = Plant(build("bergeron", fault=[fault("F1", "AG"), fault("F2", "BCG", start_s=0.05)]))
    x, changes = record(plant, 2900)
    assert [(c.kind, c.index, c.value) for c in changes] == [("fault", 0, 1), ("fault", 1, 1)]
    exact = solve("bergeron", 0.45, "ABCG")
    assert np.abs(phasors(x, 0, 4800) / exact - 1).max() < 0.003


def test_one_point_given_in_two_ways_is_one() -> None:
    """0.1 + 0.2 per unit and 36 of 120 km differ in the last bit."""
    events = [fault("F1", "AG", at_pu=0.1 + 0.2), fault("F2", "BCG", at_km=36.0, at_pu=None)]
    del events[1]["at_pu"]
    x, _ = record(Plant(build("bergeron", fault=events)), 2900)
    assert np.abs(phasors(x, 0, 4800) / solve("bergeron", 0.3, "ABCG") - 1).max() < 0.003


def test_two_faults_at_once_at_different_points_and_at_a_bus() -> None:
    events = [
        fault("F1", "AG"),
        fault("F2", "BG", at_pu=0.8),
        {"name": "F3", "bus": "B", "type": "CG", "start_s": 0.02, "resistance_ohm": 30.0},
    ]
    plant = Plant(build("rl", fault=events))
    _, changes = record(plant, 400)
    assert [c.index for c in changes] == [0, 1, 2] and len({c.t_ns for c in changes}) == 1
    probe = plant.probe
    total = probe.line_current("L", "from") + probe.line_current("L", "to")
    into = probe.fault_current("F1") + probe.fault_current("F2")
    assert np.abs(into).min(initial=np.inf, where=[True, True, False]) > 100
    assert np.abs(total - into).max() < 1e-6 * np.abs(into).max()  # an R-L line has no other way out
    at_b = probe.source_current("B") - probe.line_current("L", "to") - probe.fault_current("F3")
    assert np.abs(at_b).max() < 1e-6 * np.abs(into).max()


@pytest.mark.parametrize(("position", "end"), [(0.0, 0), (1.0, 1)])
@pytest.mark.parametrize("breakers", [False, True])
def test_a_fault_at_a_line_end_is_in_the_relay_current(position: float, end: int, breakers: bool) -> None:
    both = [{"name": f"Q{e}", "line": "L", "end": e} for e in ("from", "to")]
    event = fault("F", "ABCG", at_pu=position)
    plant = Plant(build("bergeron", fault=[event], breaker=both if breakers else []))
    x, _ = record(plant, 2900)
    exact = solve("bergeron", position, "ABCG")
    assert np.abs(phasors(x, 0, 4800)[end, 3:] / exact[end, 3:] - 1).max() < 1e-3


def test_currents_balance_at_every_step_of_a_fault_and_its_clearing() -> None:
    tables = {
        "system": {"sampling_hz": 19200, "steps_per_sample": 1},
        "breaker": [{"name": "Q", "line": "L", "end": "from", "operate_ms": 5.0}],
    }
    plant = Plant(build("rl", fault=[fault("F", "BCG", duration_s=0.03)], **tables))
    worst = 0.0
    for k in range(1200):
        if k == 500:
            plant.command("Q", "open", 7, (plant.sample_count - 1) * 10**9 // 19200)
        plant.advance(1)
        probe = plant.probe
        out = probe.fault_current("F")
        error = probe.line_current("L", "from") + probe.line_current("L", "to") - out
        at_a = probe.source_current("A") - probe.line_current("L", "from")
        worst = max(worst, np.abs(error).max(), np.abs(at_a).max())
    assert worst < 1e-2  # leakage of 1 Gohm and rounding of kiloamperes behind 1e-4 ohm


def test_two_frequencies() -> None:
    sources = build().model_dump(by_alias=True)["source"]
    slow = [{k: v for k, v in s.items() if v is not None} for s in sources]
    slow[1]["frequency_hz"] = 47.3
    plant = Plant(build("bergeron", source=slow))
    x, _ = record(plant, 4800)
    t = np.arange(4800) / 4800
    waves = [f(2 * np.pi * hz * t) for hz in (50.0, 47.3) for f in (np.cos, np.sin)]
    basis = np.stack(waves, axis=1)
    flat = x.reshape(4800, 12)
    fit = np.linalg.lstsq(basis, flat, rcond=None)[0]
    assert np.abs(basis @ fit - flat).max(axis=0).max() < 1e-9 * np.abs(flat).max()
    assert np.hypot(fit[2], fit[3]).min() > 0.01 * np.hypot(fit[0], fit[1]).min()
