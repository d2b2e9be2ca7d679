"""Two parallel lines, one of them faulted: by the exact sequence network, by the plant, by the relay.

A-G without resistance at a part x of line L1, no load.  Line L2 is in service, or open and earthed at both
ends; B has a source or none.  A ground loop of L1's relay at A then measures, by the closed form,

    V / (Ia + 3 k0 I0) = x Z1 (1 + 3 kM Ip0 / (Ia + 3 k0 I0)),    kM = Z0m / (3 Z1)
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelaySettings
from faultloop.study.suites.functions.two_ended import phasors, record

KM = 100.0
SOURCE = (2 + 20j, 3 + 15j)
Z1, Z0, ZM = (0.03 + 0.3j) * KM, (0.25 + 1.0j) * KM, (0.2 + 0.6j) * KM
REACH = 0.8
FAULT_S, END_S = 0.1, 0.45
CASES = {
    "in service, B open": (False, False),
    "in service, B fed": (True, False),
    "earthed, B open": (False, True),
    "earthed, B fed": (True, True),
}
"""Whether B is fed, whether L2 is earthed."""


def apparent(x: float, fed: bool, earthed: bool) -> tuple[complex, complex]:
    """What the loop measures over Z1, and Ip0 / I0 at A: nodal analysis of each sequence, 1 A at the fault.

    Nodes A, B, F and, beside F, M on L2; an earthed line is between two nodes of no voltage.
    """
    x = min(max(x, 1e-6), 1 - 1e-6)
    v1, i1, _ = _sequence(x, fed, SOURCE[0], Z1, 0j, earthed)
    v0, i0, beside = _sequence(x, fed, SOURCE[1], Z0, ZM, earthed)
    loop = 2 * i1 + i0 + (Z0 - Z1) / Z1 * i0
    # bolted: the voltages at the fault add up to nothing, so what is at A against the fault is what counts
    return (2 * v1 + v0) / loop / Z1, beside / i0


def _sequence(
    x: float, fed: bool, source: complex, own: complex, mutual: complex, earthed: bool
) -> tuple[complex, complex, complex]:
    """Voltage of A against the fault, current of L1 at A, and of L2, when 1 A is drawn at F."""
    size = 4
    y = np.zeros((size, size), complex)
    y[0, 0] += 1 / source
    if fed:
        y[1, 1] += 1 / source
    ground = np.zeros(size)
    a, b, f, m = np.eye(size)
    for part, ends1, ends2 in (
        (x, (a, f), (ground if earthed else a, m)),
        (1 - x, (f, b), (m, ground if earthed else b)),
    ):
        admittance = np.linalg.inv(part * np.array([[own, mutual], [mutual, own]]))
        across = np.array([ends1[0] - ends1[1], ends2[0] - ends2[1]])
        y += across.T @ admittance @ across
    v = np.linalg.solve(y, -f)
    admittance = np.linalg.inv(x * np.array([[own, mutual], [mutual, own]]))
    first = np.array([a - f, (ground if earthed else a) - m])
    currents = admittance @ first @ v
    return v[0] - v[2], currents[0], currents[1]


def scenario(x: float, fed: bool, earthed: bool) -> Scenario:
    """The same as tables of a plant: lines of series impedance alone."""
    per_km = {"r1": 0.03, "x1": 0.3, "r0": 0.25, "x0": 1.0}
    line = {"from": "A", "to": "B", "length_km": KM, "model": "rl"}
    line |= {f"{key}_ohm_per_km": value for key, value in per_km.items()}
    z1, z0 = ([z.real, z.imag] for z in SOURCE)
    data: dict[str, Any] = {
        "scenario": {"name": "parallel lines", "duration_s": 2.0},
        "system": {"frequency_hz": 50, "base_kv": 220},
        "source": [
            {"name": f"S{bus}", "bus": bus, "z1_ohm": z1, "z0_ohm": z0} for bus in ("AB" if fed else "A")
        ],
        "line": [{"name": "L1", **line}, {"name": "L2", **line}],
        "mutual": [{"lines": ["L1", "L2"], "r0m_ohm_per_km": 0.2, "x0m_ohm_per_km": 0.6}],
        "relay": [{"name": f"R{n}", "line": f"L{n}", "end": "from", "settings": "none.toml"} for n in (1, 2)],
        "fault": [{"name": "F", "line": "L1", "at_pu": x, "type": "AG", "start_s": FAULT_S}],
    }
    if earthed:
        data["breaker"] = [
            {"name": f"Q{end}", "line": "L2", "end": end, "closed": False} for end in ("from", "to")
        ]
        data["fault"] += [
            {"name": f"E{at}", "line": "L2", "at_pu": float(at), "type": "ABCG", "start_s": 0.0}
            for at in (0, 1)
        ]
    return Scenario.from_dict(data)


def samples(x: float, fed: bool, earthed: bool) -> tuple[NDArray[np.float64], int]:
    """(n, 10) what L1's relay measures, with the residual current of L2's relay; samples a second.

    The current transformer of an earthed line is beyond the earthing switch, and sees nothing.
    """
    plant = Plant(scenario(x, fed, earthed))
    rows = record(plant, round(END_S * plant.sampling_hz))[0]
    wide = np.full((len(rows), 10), np.nan)
    wide[:, :6], wide[:, 9] = rows[:, 0], rows[:, 1, 3:].sum(axis=1)
    return wide, plant.sampling_hz


def measured(x: float, fed: bool, earthed: bool) -> tuple[complex, complex]:
    """What the loop measures over Z1 by the plant's last cycle, without compensation and with."""
    rows, hz = samples(x, fed, earthed)
    p = phasors(np.nan_to_num(rows), 0, hz)
    current = p[3] + (Z0 - Z1) / (3 * Z1) * p[3:6].sum()
    return p[0] / current / Z1, p[0] / (current + ZM / (3 * Z1) * p[9]) / Z1


def operates(x: float, fed: bool, earthed: bool, compensated: bool) -> bool:
    """Whether zone 1, of 80 % and 100 ms, does."""
    line = {"z1_ohm": [Z1.real, Z1.imag], "z0_ohm": [Z0.real, Z0.imag]}
    if compensated:
        line["z0m_ohm"] = [ZM.real, ZM.imag]
    settings = RelaySettings.from_dict(
        {
            "relay": {"frequency_hz": 50, "nominal_kv": 220},
            "estimator": {"method": "fourier"},
            "line": line,
            "vt": {"kind": "ideal"},
            "pdis": [{"zone": 1, "reach_pu": REACH, "delay_ms": 100.0}, {"zone": 2, "reach_pu": 3.0}],
            "ptrc": {"zones": [1]},
        }
    )
    rows, hz = samples(x, fed, earthed)
    relay = Relay(settings)
    before = rows[: round(FAULT_S * hz) // 96 * 96]
    relay.warm_up(np.tile(before[-96:], (50, 1)))
    rows, done = rows[len(before) :], 0
    while done < len(rows):
        done += relay.advance(np.ascontiguousarray(rows[done:]))
        if any(event.trip is not None for event in relay.events):
            return True
    return False


def reach(fed: bool, earthed: bool, compensated: bool, steps: int = 7) -> float:
    """How far along the line zone 1 operates, to within 2^-steps of half the line; 1.0: beyond it."""
    low, high = 0.5, 1.0
    if operates(high, fed, earthed, compensated):
        return high
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (middle, high) if operates(middle, fed, earthed, compensated) else (low, middle)
    return (low + high) / 2


def expected_reach(fed: bool, earthed: bool, compensated: bool) -> float:
    """The place at which the closed form's reactance is that of the reach; 1.0: beyond the line."""
    if compensated and not earthed:
        return REACH
    places = np.linspace(0.5, 1.0, 501)
    depth = [(apparent(float(x), fed, earthed)[0] * Z1).imag / Z1.imag for x in places]
    inside = np.flatnonzero(np.array(depth) < REACH)
    return float(places[inside[-1]]) if len(inside) else 0.5
