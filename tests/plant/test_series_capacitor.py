"""A bank in a line, against complex impedances and against an ODE solver."""

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

SOURCE, LINE = 2 + 20j, 6 + 40j
OMEGA = 100 * np.pi
PEAK = 220e3 * np.sqrt(2 / 3)


def radial(bank: dict[str, Any], **tables: Any) -> dict[str, Any]:
    """A source, a line of 100 km that ends in the open, a relay with its VT on the bus."""
    z, per_km = [SOURCE.real, SOURCE.imag], LINE / 100
    return {
        "scenario": {"name": "series compensation", "duration_s": 4.0},
        "system": {"frequency_hz": 50, "base_kv": 220},
        "source": [{"name": "S", "bus": "A", "z1_ohm": z, "z0_ohm": z}],
        "line": [
            {
                "name": "L",
                "from": "A",
                "to": "B",
                "length_km": 100,
                "model": "rl",
                "r1_ohm_per_km": per_km.real,
                "x1_ohm_per_km": per_km.imag,
                "r0_ohm_per_km": per_km.real,
                "x0_ohm_per_km": per_km.imag,
            }
        ],
        "series_capacitor": [{"line": "L", "at_pu": 0.0} | bank],
        "relay": [{"name": "R", "line": "L", "end": "from", "settings": "none.toml"}],
    } | tables


def fault(position: float, kind: str = "ABC") -> list[dict[str, Any]]:
    return [{"name": "F", "line": "L", "at_pu": position, "type": kind, "start_s": 0.0}]


# FIELD-primary, section 5, per unit of the source's voltage: degree of compensation, position; V and I of the
# relay as magnitude and angle, None where the sheet has none
INVERSION = [
    (0.3, 0.0, (1.4552, -166.0), (0.1213, -76.0)),
    (0.3, 0.25, (0.1363, -132.1), None),
    (0.3, 0.5, (0.3004, -10.4), None),
    (0.3, 1.0, (0.5885, -2.6), None),
    (0.7, 0.0, None, (0.1213, 76.0)),
    (0.7, 0.25, (4.48, -115.0), None),
    (0.7, 0.8, (0.2505, -34.4), None),
]


@pytest.mark.parametrize("breaker", [False, True])
@pytest.mark.parametrize(("degree", "position", "voltage", "current"), INVERSION)
def test_voltage_and_current_inversion(
    degree: float,
    position: float,
    voltage: tuple[float, float] | None,
    current: tuple[float, float] | None,
    breaker: bool,
    measured: Measured,
) -> None:
    xc = degree * LINE.imag
    tables = {"breaker": [{"name": "Q", "line": "L", "end": "from"}]} if breaker else {}
    plant = Plant(Scenario.from_dict(radial({"x_ohm": xc}, fault=fault(position), **tables)))
    x = phasors(record(plant, 3 * 4800)[0], 0, 4800)[0] / PEAK
    z = position * LINE - 1j * xc
    i = 1 / (SOURCE + z)
    assert x[0] == pytest.approx(i * z, abs=0.002 * abs(i * z))
    assert x[3] == pytest.approx(i, abs=0.002 * abs(i))
    measured("error of the current", 100 * abs(x[3] / i - 1), "%")
    for found, printed in ((x[0], voltage), (x[3], current)):
        if printed is not None:
            size, angle = printed
            assert abs(found) == pytest.approx(size, rel=0.01)
            assert abs(np.angle(found * np.exp(-1j * np.radians(angle)), deg=True)) < 0.3


def test_subsynchronous_beat(measured: Measured) -> None:
    """f0 sqrt(Xc / (Xs + x XL)) = 28.87 Hz, half compensated, fault at the far end; damped 28.68."""
    x = record(Plant(Scenario.from_dict(radial({"x_ohm": 20.0}, fault=fault(1.0)))), 2400)[0][:, 0, 3]
    k = np.arange(len(x))
    steady = np.stack([np.cos(OMEGA * k / 4800), np.sin(OMEGA * k / 4800)], axis=1)
    tail = slice(96, None)
    decay = np.exp(-k / 4800 * 8 / (2 * 60 / OMEGA))
    best = min(
        np.arange(20.0, 40.0, 0.05),
        key=lambda f: np.linalg.lstsq(
            np.column_stack(
                [
                    steady,
                    decay * np.cos(2 * np.pi * f * k / 4800),
                    decay * np.sin(2 * np.pi * f * k / 4800),
                ]
            )[tail],
            x[tail],
            rcond=None,
        )[1][0],
    )
    measured("error of the beat of 28.68 Hz", abs(best - 28.68), "Hz")
    assert best == pytest.approx(28.68, abs=0.06)


@pytest.mark.parametrize("position", [0.0, 0.4])
def test_the_varistor_against_an_ode_solver(position: float, measured: Measured) -> None:
    """With equal sequence impedances a fault to earth of all phases is three circuits of their own."""
    bank = {"x_ohm": 28.0, "mov_kv": 60.0, "mov_ka": 5.0, "exponent": 30.0}
    x = record(Plant(Scenario.from_dict(radial(bank, fault=fault(position, "ABCG")))), 960)[0][:, 0]
    z = SOURCE + position * LINE
    r, l, c = z.real, z.imag / OMEGA, 1 / (OMEGA * 28.0)

    def slope(t: float, y: np.ndarray, phase: int) -> list[float]:
        e = PEAK * np.cos(OMEGA * t - phase * 2 * np.pi / 3)
        through = 5e3 * np.sign(y[1]) * (abs(y[1]) / 60e3) ** 30
        return [(e - r * y[0] - y[1]) / l, (y[0] - through) / c]

    t = np.arange(960) / 4800
    for phase in range(3):
        exact = solve_ivp(
            slope, (0, t[-1]), [0.0, 0.0], "LSODA", t, args=(phase,), rtol=1e-9, atol=1e-6, max_step=1e-4
        ).y
        error = np.abs(x[:, 3 + phase] - exact[0]).max() / np.abs(exact[0]).max()
        measured("error of the current with a varistor", 100 * error, "% of the peak")
        assert error < 0.005
        bus = exact[1] + position * (
            LINE.real * exact[0]
            + LINE.imag
            / OMEGA
            * (PEAK * np.cos(OMEGA * t - phase * 2 * np.pi / 3) - r * exact[0] - exact[1])
            / l
        )
        assert np.abs(x[1:, phase] - bus[1:]).max() < 0.01 * np.abs(bus).max()
        assert np.abs(exact[1]).max() > 55e3, "it conducts"


def test_against_goldsworthy() -> None:
    """D. L. Goldsworthy (1987): bank and varistor as R and X, by the current over that of the level."""
    xc, level = 28.0, 60.0
    bank = {"x_ohm": xc, "mov_kv": level, "mov_ka": 10.0, "exponent": 30.0}
    data = radial(bank, fault=fault(0.2, "ABCG"))
    plant = Plant(Scenario.from_dict(data))
    x = phasors(record(plant, 2 * 4800)[0], 0, 4800)[0]
    z = (x[0] / x[3] - 0.2 * LINE) / xc
    i = abs(x[3]) / (level * 1e3 / xc)
    r = 0.0745 + 0.49 * np.exp(-0.243 * i) - 35 * np.exp(-5 * i) - 0.6 * np.exp(-1.4 * i)
    reactance = 0.1010 - 0.005749 * i + 2.088 * np.exp(-0.8566 * i)
    assert i > 1.2
    assert z == pytest.approx(r - 1j * reactance, abs=0.06)


def test_in_the_middle_a_fault_is_on_its_side_towards_the_middle() -> None:
    for at, seen in ((0.3, 0.3 * LINE - 12j), (0.7, 0.7 * LINE)):
        data = radial({"x_ohm": 12.0, "at_pu": at}, fault=fault(at))
        x = phasors(record(Plant(Scenario.from_dict(data)), 3 * 4800)[0], 0, 4800)[0]
        assert x[0] / x[3] == pytest.approx(seen, abs=0.02)


def test_with_waves_and_a_coupled_circuit() -> None:
    """The steady state before a fault is one, and the bank carries the line's current."""
    data = radial({"x_ohm": 12.0, "at_pu": 0.5, "mov_kv": 100.0})
    waves = {"model": "bergeron", "b1_us_per_km": 3.0, "b0_us_per_km": 2.0}
    data["line"] = [data["line"][0] | waves, data["line"][0] | waves | {"name": "P"}]
    data["mutual"] = [{"lines": ["L", "P"], "r0m_ohm_per_km": 0.04, "x0m_ohm_per_km": 0.25}]
    data["source"].append(data["source"][0] | {"name": "T", "bus": "B", "angle_deg": -20.0})
    x = record(Plant(Scenario.from_dict(data)), 960)[0]
    assert np.abs(x[:96] - x[-96:]).max() < 1e-6 * np.abs(x).max()
    data["fault"] = fault(0.5, "AG")
    faulted = record(Plant(Scenario.from_dict(data)), 4800)[0]
    assert np.isfinite(faulted).all()
    assert np.abs(faulted[..., 3:]).max() < 20e3


@pytest.mark.parametrize(
    ("bank", "message"),
    [
        (
            {"x_ohm": 40.0},
            r"series_capacitor\[SC1\].x_ohm: 40 ohm in series overcompensate line 'L' of 40 ohm; give less",
        ),
        ({"x_ohm": 10.0, "line": "M"}, r"there is no line 'M'"),
        ({"x_ohm": 10.0, "at_pu": 1.1}, r"at_pu: input should be less than or equal to 1"),
        ({"x_ohm": -1.0}, r"x_ohm: input should be greater than 0"),
        ({"x_ohm": 10.0, "mov_kv": 0.0}, r"mov_kv: input should be greater than 0"),
    ],
)
def test_wrong_input(bank: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Scenario.from_dict(radial(bank))


def test_two_banks_and_a_varistor_that_load_makes_conduct() -> None:
    data = radial({"x_ohm": 10.0})
    data["series_capacitor"].append({"line": "L", "at_pu": 0.0, "x_ohm": 10.0})
    with pytest.raises(InputError, match="'SC1' is already at this place of 'L'"):
        Scenario.from_dict(data)
    data = radial({"x_ohm": 10.0, "mov_kv": 1.0})
    data["source"].append(data["source"][0] | {"name": "T", "bus": "B", "angle_deg": -30.0})
    with pytest.raises(InputError, match=r"mov_kv: 1 kV is less than a healthy network needs: .* at least"):
        Plant(Scenario.from_dict(data))
