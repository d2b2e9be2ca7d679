"""Poles: they open at a current zero and leave no trace of the method; they close; commands."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.plant import Plant, PlantState
from tests.plant.record import now_ns, record
from tests.plant.reference import BASE_KV, SOURCES, build

PEAK = BASE_KV * 1e3 * np.sqrt(2 / 3)
BREAKERS = [
    {"name": "QA", "line": "L", "end": "from", "operate_ms": 20.0, "close_ms": 30.0},
    {"name": "QB", "line": "L", "end": "to", "operate_ms": 25.0, "close_ms": 30.0},
]
STEPWISE = {"sampling_hz": 19200, "steps_per_sample": 1}


def faulted(model: str, kind: str = "AG", **tables: object) -> Plant:
    fault = {"name": "F", "line": "L", "at_pu": 0.45, "type": kind, "start_s": 0.02, "resistance_ohm": 1.0}
    return Plant(build(model, **{"system": STEPWISE, "breaker": BREAKERS, "fault": [fault], **tables}))


def natural_step(plant: Plant, before: PlantState) -> np.ndarray:
    """(relays, 3) currents one step after ``before``, had no pole been waiting for its zero."""
    after = plant.save()
    plant.restore(before._replace(armed=np.zeros_like(before.armed), actions=()))
    plant.advance(1)
    currents = plant.samples[0, :, 3:].copy()
    plant.restore(after)
    return currents


@pytest.mark.parametrize("model", ["rl", "pi", "bergeron"])
@pytest.mark.parametrize("kind", ["AG", "BC", "ABC"])
def test_a_pole_never_interrupts_a_finite_current(model: str, kind: str) -> None:
    """It opens in the step in which its current would have crossed zero, where that is, and not before its
    operate time; from the next step on there is none at all."""
    plant = faulted(model, kind)
    record(plant, 600)
    sent = now_ns(plant)
    for breaker in ("QA", "QB"):
        plant.command(breaker, "open", 7, sent)
    closed, opened = [7, 7], np.zeros((2, 3), dtype=bool)
    last = plant.samples[-1, :, 3:].copy()
    while not opened.all():
        before = plant.save()
        plant.advance(1)
        now, changes = plant.samples[0, :, 3:].copy(), plant.changes
        assert np.all(now[opened] == 0.0)
        for change in changes:
            natural = natural_step(plant, before)
            assert change.t_ns >= sent + (20_000_000, 25_000_000)[change.index]
            for pole in range(3):
                if (closed[change.index] & ~change.value) >> pole & 1:
                    i, j = last[change.index, pole], natural[change.index, pole]
                    opened[change.index, pole] = True
                    share = change.t_ns * 19200 / 10**9 - (plant.sample_count - 2)
                    if abs(i) > 1e-6:
                        assert i * j <= 0
                        if change.t_ns == changes[0].t_ns:  # the second in a step sees the first's effect
                            assert abs(i + share * (j - i)) < 1e-3 * abs(i - j)
                    else:
                        assert share == pytest.approx(0, abs=2e-5)
            closed[change.index] = change.value
        last = now
    x, _ = record(plant, 400)
    assert np.all(x[..., 3:] == 0.0)


def test_after_an_inductive_circuit_opens_the_voltages_are_at_once_those_of_the_sources() -> None:
    """Without capacitance the transient recovery voltage jumps to the EMF; a trapezoidal rule left alone
    would swing about it for ever, and a chopped current would show as a spike."""
    plant = faulted("rl", "ABCG")
    record(plant, 600)
    plant.command("QA", "open", 7, now_ns(plant))
    x, changes = record(plant, 1200)
    last = -(-changes[-1].t_ns * 19200 // 10**9) - 600
    step = np.arange(600, 600 + len(x))
    angle = 2 * np.pi * 50 * step / 19200 + np.radians(SOURCES["A"][0])
    emf = PEAK * np.cos(angle[:, None] - 2 * np.pi / 3 * np.arange(3))
    assert np.abs(x[last:, 0, :3] - emf[last:]).max() < 1e-3 * PEAK
    assert np.abs(x[:, 0, :3]).max() < 1.5 * PEAK  # the neutral shifts while one pole still conducts


def test_no_chatter_in_a_line_that_lost_both_ends() -> None:
    plant = faulted("pi", "BC")
    record(plant, 600)
    for breaker in ("QA", "QB"):
        plant.command(breaker, "open", 7, now_ns(plant))
    record(plant, 1500)
    line = []
    for _ in range(40):
        plant.advance(1)
        line.append(plant.probe.terminal_voltage("L", "from"))
    swing = np.diff(np.array(line), axis=0)
    alternating = np.abs(np.diff(swing, axis=0)) > 1.9 * np.maximum(np.abs(swing[1:]), np.abs(swing[:-1]))
    assert not np.any(alternating & (np.abs(swing[1:]) > 1e-3 * PEAK))


@pytest.mark.parametrize("model", ["rl", "pi", "bergeron"])
def test_recovery_voltage_stays_physical(model: str) -> None:
    """No more than twice the crest of the system voltage across the line or the bus, the bound of a single
    undamped oscillation about it, with 1.3 for the healthy phases' shift."""
    plant = faulted(model, "AG")
    record(plant, 600)
    for breaker in ("QA", "QB"):
        plant.command(breaker, "open", 7, now_ns(plant))
    x, _ = record(plant, 3000)
    assert np.abs(x[..., :3]).max() < 2 * 1.3 * PEAK


def test_open_and_close_again() -> None:
    plant = faulted("bergeron", fault=[])
    normal, _ = record(plant, 384)
    plant.command("QA", "open", 7, now_ns(plant))
    record(plant, 2000)
    assert plant.closed("QA") == 0
    sent = now_ns(plant)
    plant.command("QA", "close", 7, sent)
    _, changes = record(plant, 700)
    assert [(c.kind, c.index, c.value) for c in changes] == [("pole", 0, 7)]
    assert 0 <= changes[0].t_ns - sent - 30_000_000 < 10**9 / 19200 + 1
    record(plant, 384 * 30 - plant.sample_count % 384)
    again, _ = record(plant, 384)
    assert np.abs(again - normal).max(axis=(0, 1))[:3].max() < 1e-3 * PEAK
    assert np.abs(again - normal).max(axis=(0, 1))[3:].max() < 1e-2 * np.abs(normal[..., 3:]).max()


def test_one_pole_opens_alone() -> None:
    plant = faulted("bergeron")
    record(plant, 600)
    plant.command("QA", "open", 1, now_ns(plant))
    x, changes = record(plant, 1500)
    assert [(c.index, c.value) for c in changes] == [(0, 6)]
    assert np.all(x[-384:, 0, 3] == 0) and np.abs(x[-384:, 0, 4]).max() > 10


def test_a_repeated_trip_does_not_delay_and_an_open_cancels_a_close() -> None:
    plant, other = faulted("bergeron"), faulted("bergeron")
    for p in (plant, other):
        record(p, 600)
        p.command("QA", "open", 7, now_ns(p))
    one, _ = record(plant, 1300)
    record(other, 20)
    other.command("QA", "open", 7, now_ns(other))
    two, _ = record(other, 1280)
    assert np.array_equal(one[20:], two)
    plant.command("QA", "close", 7, now_ns(plant))
    record(plant, 100)
    plant.command("QA", "open", 7, now_ns(plant))
    _, changes = record(plant, 1000)
    assert changes == [] and plant.closed("QA") == 0


def test_wrong_commands() -> None:
    plant = faulted("rl")
    plant.advance(100)
    with pytest.raises(InputError, match="did you mean 'QA'"):
        plant.command("QAA", "open", 7, now_ns(plant))
    with pytest.raises(ValueError, match="too late"):
        plant.command("QA", "open", 7, now_ns(plant) - 1)
    with pytest.raises(ValueError, match="mask"):
        plant.command("QA", "open", 8, now_ns(plant))
    with pytest.raises(ValueError, match="n >= 1"):
        plant.advance(0)
