"""An arc at the fault, against an ODE solver and against the fundamental of a rectangle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultloop.errors import InputError
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from tests.measured import Measured
from tests.plant.record import record
from tests.plant.reference import phasors
from tests.plant.test_series_capacitor import LINE, OMEGA, PEAK, SOURCE, radial

VOLTS = 20e3


def plant(**fault: Any) -> Plant:
    """Half of the line, with equal impedances in all sequences: three circuits of their own."""
    data = radial({"x_ohm": 1.0})
    del data["series_capacitor"]
    given = {"name": "F", "line": "L", "at_pu": 0.5, "type": "ABCG", "arc_kv": VOLTS / 1e3}
    return Plant(Scenario.from_dict(data | {"fault": [given | fault]}))


def test_the_current_is_an_ode_solvers(measured: Measured) -> None:
    x = record(plant(start_s=0.0), 960)[0][:, 0]
    z = SOURCE + 0.5 * LINE
    r, l = z.real, z.imag / OMEGA

    def slope(t: float, y: np.ndarray, phase: int) -> list[float]:
        e = PEAK * np.cos(OMEGA * t - phase * 2 * np.pi / 3)
        arc = VOLTS * np.sign(y[0]) * (abs(y[0]) / 1e3) ** (1 / 40)
        return [(e - r * y[0] - arc) / l]

    t = np.arange(960) / 4800
    for phase in range(3):
        exact = solve_ivp(slope, (0, t[-1]), [0.0], "LSODA", t, args=(phase,), rtol=1e-8, max_step=2e-5).y[0]
        error = np.abs(x[:, 3 + phase] - exact).max() / np.abs(exact).max()
        measured("error of the current", 100 * error, "% of the peak")
        assert error < 0.005


@pytest.mark.parametrize("kind", ["AB", "BC", "ABC"])
def test_arcs_that_only_see_each_other_are_refused(kind: str) -> None:
    """Phase by phase they find no current: the fault would not be there."""
    with pytest.raises(
        InputError, match=f"fault\\[F\\]: arc_kv belongs to a fault to ground: .* take {kind}G"
    ):
        plant(type=kind, start_s=0.0)


def test_a_relay_measures_the_fundamental_of_a_rectangle_as_resistance() -> None:
    """4 U / pi in phase with the current, beside half the line."""
    x = phasors(record(plant(start_s=0.0), 3 * 4800)[0], 0, 4800)[0]
    arc = x[0] / x[3] - 0.5 * LINE
    size = VOLTS * (abs(x[3]) / 1e3) ** (1 / 40)
    assert arc.real == pytest.approx(4 / np.pi * size / abs(x[3]), rel=0.02)
    assert abs(arc.imag) < 0.05 * arc.real


def test_before_it_burns_nothing_flows_and_its_angle_is_that_of_the_voltage_before_it() -> None:
    one = plant(type="AG", angle_deg=90.0, after_s=0.1)
    rows, changes = record(one, 600)
    (change,) = (c for c in changes if c.kind == "fault")
    assert OMEGA * change.t_ns / 1e9 % (2 * np.pi) == pytest.approx(
        0, abs=0.02
    )  # v_a = cos(w t): at its crest
    assert np.abs(rows[:480, 0, 3:]).max() < 1e-3
