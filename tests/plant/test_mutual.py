"""Two circuits coupled in the zero sequence, against exact solutions that know nothing of the plant."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from faultloop.errors import InputError
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from tests.measured import Measured
from tests.plant.record import record
from tests.plant.reference import A, fault_admittance, phase_matrix, phasors

KM = 100.0
SOURCE = (2 + 20j, 3 + 15j)
PER_KM = {"r1": 0.03, "x1": 0.3, "b1": 3.8, "r0": 0.25, "x0": 1.0, "b0": 2.6}
MUTUAL = {"r0m_ohm_per_km": 0.2, "x0m_ohm_per_km": 0.6}
B0M = 0.9


def parallel(model: str, *, fed: bool = True, opposite: bool = False, **tables: Any) -> dict[str, Any]:
    """Sources at A and, where ``fed``, B; lines L1 and L2 between them; relays at A on both."""
    per_km = {f"{k}_{'us' if k[0] == 'b' else 'ohm'}_per_km": v for k, v in PER_KM.items()}
    if model == "rl":
        per_km = {k: v for k, v in per_km.items() if k[0] != "b"}
    line = {"length_km": KM, "model": model, **per_km}
    ends = {"from": "B", "to": "A"} if opposite else {"from": "A", "to": "B"}
    z1, z0 = ([z.real, z.imag] for z in SOURCE)
    buses = {"A": 0.0, "B": -15.0} if fed else {"A": 0.0}
    data: dict[str, Any] = {
        "scenario": {"name": "parallel", "duration_s": 3.0},
        "system": {"frequency_hz": 50, "base_kv": 220},
        "source": [
            {"name": f"S{bus}", "bus": bus, "z1_ohm": z1, "z0_ohm": z0, "angle_deg": angle}
            for bus, angle in buses.items()
        ],
        "line": [{"name": "L1", "from": "A", "to": "B", **line}, {"name": "L2", **ends, **line}],
        "mutual": [{"lines": ["L1", "L2"], **MUTUAL}],
        "relay": [
            {"name": "R1", "line": "L1", "end": "from", "settings": "none.toml"},
            {"name": "R2", "line": "L2", "end": "to" if opposite else "from", "settings": "none.toml"},
        ],
    }
    return data | tables


def settled(data: dict[str, Any], seconds: float = 1.2) -> np.ndarray:
    plant = Plant(Scenario.from_dict(data))
    return phasors(record(plant, round(seconds * plant.sampling_hz))[0], 0, plant.sampling_hz)


# FIELD-primary, section 5: exact sequence network, A-G bolted on L1 without load, apparent impedance of the
# ground loop over that of the line: position, source at B, L2 open and earthed at both ends.
APPARENT = {
    (0.5, False, False): 0.5641 - 0.0084j,
    (0.5, True, False): 0.5,
    (0.5, False, True): 0.4417 + 0.0122j,
    (0.5, True, True): 0.5,
    (0.8, False, False): 1.0052 - 0.0269j,
    (0.8, True, False): 0.8470 - 0.0042j,
    (0.8, False, True): 0.6509 + 0.0313j,
    (0.8, True, True): 0.7451 + 0.0134j,
    (1.0, False, False): 1.3848 - 0.0504j,
    (1.0, True, False): 1.2360 - 0.0312j,
    (1.0, False, True): 0.7670 + 0.0490j,
    (1.0, True, True): 0.8206 + 0.0445j,
}


@pytest.mark.parametrize("opposite", [False, True])
@pytest.mark.parametrize(("where", "expected"), APPARENT.items())
def test_reach_of_the_ground_loop(
    where: tuple[float, bool, bool], expected: complex, opposite: bool, measured: Measured
) -> None:
    position, fed, earthed = where
    fault = [{"name": "F", "line": "L1", "at_pu": position, "type": "AG", "start_s": 0.0}]
    data = parallel("rl", fed=fed, opposite=opposite)
    data["source"] = [source | {"angle_deg": 0.0} for source in data["source"]]
    if earthed:
        data["breaker"] = [
            {"name": f"Q{end}", "line": "L2", "end": end, "closed": False} for end in ("from", "to")
        ]
        fault += [
            {"name": f"E{at}", "line": "L2", "at_pu": float(at), "type": "ABCG", "start_s": 0.0}
            for at in (0, 1)
        ]
    x = settled(data | {"fault": fault}, 1.6)
    z1, z0, zm = complex(0.03, 0.3), complex(0.25, 1.0), complex(0.2, 0.6)
    v, i, i0, beside = x[0, 0], x[0, 3], x[0, 3:].sum() / 3, x[1, 3:].sum() / 3
    compensated = i + (z0 - z1) / z1 * i0
    measured("error of what the loop sees", abs(v / compensated / (z1 * KM) - expected), "of the line")
    assert v / compensated / (z1 * KM) == pytest.approx(expected, abs=2e-4)
    if not earthed:  # the parallel line's residual current makes the loop see the place, exactly
        assert v / (compensated + zm / z1 * beside) / (z1 * KM) == pytest.approx(position, abs=1e-4)


def exact(model: str, position: float, kind: str, b0m: float, begin: float) -> np.ndarray:
    """(2, 6) peak phasors at A of L1 and L2: six-phase line by the matrix exponential of its equations
    (coupled from ``begin`` on, per unit), phase-domain nodal analysis, the fault as an admittance."""
    omega_less = 1e-6j

    def blocks(own: tuple[complex, complex], mutual: complex) -> np.ndarray:
        m = phase_matrix(mutual, 0)
        return np.block([[phase_matrix(*own), m], [m, phase_matrix(*own)]])

    own = (complex(PER_KM["r0"], PER_KM["x0"]), complex(PER_KM["r1"], PER_KM["x1"]))
    shunt = (omega_less * PER_KM["b0"], omega_less * PER_KM["b1"])

    def chain(km: float, coupled: bool) -> np.ndarray:
        z = blocks(own, complex(*MUTUAL.values()) if coupled else 0)
        y = blocks(shunt, -omega_less * b0m if coupled else 0)
        if model == "rl":
            y = np.zeros_like(y)
        return expm(np.block([[np.zeros((6, 6)), -z], [-y, np.zeros((6, 6))]]) * km)

    def stretch(start: float, end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Admittances of a stretch: of its start, between, of its end (by symmetry of each uniform part)."""
        t = np.eye(12, dtype=complex)
        for a, b, coupled in ((0.0, begin, False), (begin, 1.0, True)):
            low, high = max(a, start), min(b, end)
            if high > low:
                t = chain((high - low) * KM, coupled) @ t
        p, q, r, s = t[:6, :6], t[:6, 6:], t[6:, :6], t[6:, 6:]
        inverse = np.linalg.inv(q)  # v2 = p v1 + q i1, i2 = r v1 + s i1
        return -inverse @ p, inverse, np.stack([s @ inverse @ p - r, -s @ inverse])

    nodes = 15  # A, B; F on L1 and the place beside it on L2
    y = np.zeros((nodes, nodes), dtype=complex)
    at = {"A": [0, 1, 2] * 2, "B": [3, 4, 5] * 2, "F": [6, 7, 8, 9, 10, 11]}
    first = None
    for a, b, (start, end) in (("A", "F", (0.0, position)), ("F", "B", (position, 1.0))):
        own_y, between, far = stretch(start, end)
        if first is None:
            first = own_y, between
        for rows, columns, part in (
            (at[a], at[a], own_y),
            (at[a], at[b], between),
            (at[b], at[a], far[0]),
            (at[b], at[b], far[1]),
        ):
            sign = 1.0
            np.add.at(y, np.ix_(rows, columns), sign * part)
    injected = np.zeros(nodes, dtype=complex)
    ys = phase_matrix(1 / SOURCE[1], 1 / SOURCE[0])
    for bus, angle in (("A", 0.0), ("B", -15.0)):
        rows = at[bus][:3]
        y[np.ix_(rows, rows)] += ys
        emf = 220e3 * np.sqrt(2 / 3) * np.exp(1j * np.radians(angle)) * np.array([1, A**2, A])
        injected[rows] += ys @ emf
    y[12:, 12:] = np.eye(3)
    f = at["F"][:3]
    z = np.linalg.inv(y)
    v = z @ injected
    yf = fault_admittance(kind, 1.0, 1e-9)
    v = v - z[:, f] @ np.linalg.solve(np.eye(3) + yf @ z[np.ix_(f, f)], yf @ v[f])
    assert first is not None
    i = first[0] @ v[at["A"]] + first[1] @ v[at["F"]]
    return np.stack([np.concatenate([v[:3], i[:3]]), np.concatenate([v[:3], i[3:]])])


@pytest.mark.parametrize("begin", [0.0, 0.3])
@pytest.mark.parametrize("kind", ["AG", "BCG", "BC"])
@pytest.mark.parametrize(
    ("model", "b0m"), [("rl", 0.0), ("pi", 0.0), ("pi", B0M), ("bergeron", 0.0), ("bergeron", B0M)]
)
def test_against_the_six_phase_line(
    model: str, kind: str, b0m: float, begin: float, measured: Measured
) -> None:
    """Voltages and currents of both circuits, without breakers, so that shares of a capacitance at the ends
    count as the line's; 0.2 % of the largest."""
    position = 0.6
    mutual = {"lines": ["L1", "L2"], **MUTUAL, "b0m_us_per_km": b0m}
    if begin:
        mutual |= {"from_km": [begin * KM, begin * KM], "direction": "same"}
    fault = {
        "name": "F",
        "line": "L1",
        "at_pu": position,
        "type": kind,
        "start_s": 0.0,
        "resistance_ohm": 1.0,
    }
    ours = settled(parallel(model, mutual=[mutual], fault=[fault]))
    expected = exact(model, position, kind, b0m, begin)
    for part in (slice(0, 3), slice(3, 6)):
        error = np.abs(ours[:, part] - expected[:, part]).max() / np.abs(expected[:, part]).max()
        measured("difference from the six-phase line", 100 * error, "%")
        assert error < 2e-3


def test_the_steady_state_and_what_a_healthy_pair_does() -> None:
    """Nothing of the zero sequence is there before a fault: coupling changes nothing, and no mode grows."""
    samples = [record(Plant(Scenario.from_dict(data)), 4800)[0] for data in (parallel("bergeron"), alone())]
    assert np.abs(samples[0] - samples[1]).max() < 1e-6 * np.abs(samples[1]).max()


def alone() -> dict[str, Any]:
    data = parallel("bergeron")
    del data["mutual"]
    return data


def test_a_pair_is_passive() -> None:
    """After a short fault that both circuits carry, what rings dies away."""
    fault = {"name": "F", "line": "L1", "at_pu": 0.37, "type": "AG", "start_s": 0.05, "duration_s": 0.08}
    mutual = [
        {"lines": ["L1", "L2"], "r0m_ohm_per_km": 0.249, "x0m_ohm_per_km": 0.999, "b0m_us_per_km": 2.59}
    ]
    for model in ("pi", "bergeron"):
        x = record(Plant(Scenario.from_dict(parallel(model, mutual=mutual, fault=[fault]))), 12000)[0]
        late = x[-960:].reshape(-1, 96, 2, 6)
        residual = np.abs(late[..., 3:].sum(axis=-1)).max()
        assert residual < 1e-3 * np.abs(x[..., 3:]).max()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lines": ["L1", "L1"]}, "not coupled with itself"),
        ({"lines": ["L1", "L3"]}, r"mutual\[M1\].lines: there is no line 'L3'"),
        ({"lines": ["L1"]}, "at least 2 needed"),
        ({"x0m_ohm_per_km": 1.0}, r"x0m_ohm_per_km: 1 is not below the geometric mean .* 1$"),
        ({"r0m_ohm_per_km": 0.3}, r"r0m_ohm_per_km: 0.3 is not below"),
        ({"b0m_us_per_km": 2.6}, r"b0m_us_per_km: 2.6 is not below"),
        ({"length_km": 101.0}, r"length_km: from there 'L1' and 'L2' run side by side for 100 km at most"),
        ({"length_km": 1e-9}, r"length_km: 1e-09 km are no length beside lines of 100 and 100 km; at least"),
        ({"from_km": [10.0, 10.0]}, "from_km and direction belong together"),
        (
            {"from_km": [100.0, 10.0], "direction": "same"},
            r"from_km: 'L1' .* share no length from there; give",
        ),
        ({"from_km": [40.0, 0.0], "direction": "opposite"}, r"from_km: .* share no length from there; give"),
    ],
)
def test_wrong_input(change: dict[str, Any], message: str) -> None:
    data = parallel("bergeron")
    data["mutual"] = [data["mutual"][0] | change]
    with pytest.raises(InputError, match=message):
        Scenario.from_dict(data)


def test_lines_that_differ() -> None:
    data = parallel("bergeron")
    data["line"][1] |= {"x0_ohm_per_km": 1.1}
    with pytest.raises(InputError, match="need the same r0, x0 and b0"):
        Scenario.from_dict(data)
    data["line"][1] |= {"model": "pi"}
    with pytest.raises(InputError, match="need one model"):
        Scenario.from_dict(data)
    data["line"][0] |= {"model": "pi"}
    Scenario.from_dict(data)
    data["line"][1] |= {"from": "C", "to": "D"}
    data["source"].append(data["source"][0] | {"name": "SC", "bus": "C"})
    with pytest.raises(InputError, match="share no bus: say where"):
        Scenario.from_dict(data)


def test_three_circuits_on_one_tower_are_refused() -> None:
    data = parallel("pi")
    data["line"].append(data["line"][0] | {"name": "L3"})
    data["mutual"].append({"lines": ["L2", "L3"], **MUTUAL})
    with pytest.raises(InputError, match="'L2' is coupled there by 'M1' already"):
        Scenario.from_dict(data)
    half = {"from_km": [0.0, 0.0], "direction": "same", "length_km": 50.0}
    rest = {"from_km": [50.0, 50.0], "direction": "same"}
    data["mutual"] = [data["mutual"][0] | half, data["mutual"][1] | rest]
    Plant(Scenario.from_dict(data))
