"""Topologies: meshes, many buses, cascades; the block factorization; networks that have no solution."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.plant import Plant
from faultloop.plant.build import circuit_of
from faultloop.plant.elements.bergeron import Wave, lagrange
from faultloop.plant.elements.line_constants import LineConstants
from faultloop.plant.factor import elimination_order, factorize, solve, symbolic
from faultloop.plant.network import Model
from tests.plant.record import record
from tests.plant.reference import LINE, build, network


def line(name: str, start: str, end: str, model: str = "rl", km: float = 40.0) -> dict[str, Any]:
    return network(model)["line"][0] | {"name": name, "from": start, "to": end, "length_km": km}


def test_block_factorization_solves() -> None:
    """Against a dense solver, on a random mesh whose blocks fill in."""
    random = np.random.default_rng(7)
    count = 12
    pairs = [(i, int(random.integers(0, i))) for i in range(1, count)]
    pairs += [tuple(random.choice(count, 2, replace=False).tolist()) for _ in range(9)]
    place = {bus: i for i, bus in enumerate(elimination_order(count, pairs))}
    pairs = [(place[i], place[j]) for i, j in pairs]
    structure = symbolic(count, pairs)
    dense = np.zeros((count, 3, count, 3))
    for i in range(count):
        dense[i, :, i] += np.eye(3) * 0.1
    for i, j in pairs:
        a = random.normal(size=(3, 3))
        y = a @ a.T
        dense[i, :, i] += y
        dense[j, :, j] += y
        dense[i, :, j] -= y
        dense[j, :, i] -= y
    diagonal = np.array([dense[i, :, i].ravel() for i in range(count)])
    columns = np.repeat(np.arange(count), np.diff(structure.pointer))
    lower = np.array([dense[j, :, i].ravel() for i, j in zip(columns, structure.row, strict=True)])
    factorize(structure, diagonal, lower)
    model = Model(circuit_of(build("rl")))
    injected = random.normal(size=(count, 3))
    y = injected.copy()
    factor = model.factor(())._replace(inverse=diagonal, lower=lower)
    solve(structure, factor, y)
    exact = np.linalg.solve(dense.reshape(3 * count, -1), injected.ravel()).reshape(count, 3)
    assert np.abs(y - exact).max() < 1e-10 * np.abs(exact).max()


@pytest.mark.parametrize("km", [15.6, 18.0, 25.0, 38.0, 55.0, 71.0])
def test_interpolation_adds_no_resistance(km: float) -> None:
    """A lossless section stays lossless (linear interpolation would turn its admittance by up to 0.2 %)."""
    omega = 2 * np.pi * 50
    constants = LineConstants(
        np.zeros(2), np.array([1.2, 0.4]) / omega, np.array([1.8e-6, 2.8e-6]) / omega, 50.0
    )
    wave = Wave.of(constants, km, 1 / 19200)
    for y in wave.admittances(omega / 19200):
        assert np.abs(y.real / y.imag).max() < 2e-5


def test_taps_never_amplify() -> None:
    """The interpolated delay's gain is at most one at every frequency, whatever the travel time."""
    omega = np.linspace(0, np.pi, 400)
    constants = LineConstants(np.zeros(2), np.array([3e-3, 1e-3]), np.array([8e-9, 1.2e-8]), 50.0)
    for delay in np.linspace(1.001, 5, 160):
        km = delay * 1e-5 / constants.travel_time(1.0)[1]
        wave = Wave.of(constants, km, 1e-5)
        taps = wave.newest[:, None] + np.arange(4)
        gain = np.abs(np.exp(-1j * omega[:, None, None] * taps) * wave.weights).max()
        response = (wave.weights * np.exp(-1j * omega[:, None, None] * taps)).sum(axis=-1)
        assert np.abs(response).max() < 1 + 1e-12 and gain > 0
        assert (wave.weights * taps).sum(axis=1) == pytest.approx(wave.delay)
    assert lagrange(1.0, 4) == pytest.approx([0, 1, 0, 0])


@pytest.mark.parametrize("model", ["rl", "pi", "bergeron"])
def test_a_ring_of_buses_starts_steady(model: str) -> None:
    names = [f"B{i}" for i in range(8)]
    lines = [line(f"L{i}", names[i], names[(i + 1) % 8], model, 30.0 + 7 * i) for i in range(8)]
    lines.append(line("chord", "B1", "B5", model, 90.0))
    sources = network()["source"]
    sources[0]["bus"], sources[1]["bus"] = "B0", "B3"
    relays = [{"name": f"R{i}", "line": f"L{i}", "end": "from", "settings": "x.toml"} for i in range(8)]
    plant = Plant(build(model, line=lines, source=sources, relay=relays))
    x, _ = record(plant, 1920)
    assert np.abs(x[:96] - x[-96:]).max() < 1e-9 * np.abs(x).max()


def test_parallel_lines_share_equally() -> None:
    lines = [line(name, "A", "B", "bergeron", 120.0) for name in ("L1", "L2")]
    relays = [
        {"name": f"R{n}{e}", "line": n, "end": e, "settings": "x.toml"}
        for n in ("L1", "L2")
        for e in ("from", "to")
    ]
    x, _ = record(Plant(build(line=lines, relay=relays)), 96)
    assert np.abs(x[:, 0] - x[:, 2]).max() < 1e-9 * np.abs(x).max()
    assert np.abs(x[:, 0, 3]).max() > 10


def test_source_by_impedance_ratio_takes_the_first_line_at_its_bus() -> None:
    sources = [{"name": "A", "bus": "A", "sir": 5.0, "z0_over_z1": 2.0}]
    circuit = circuit_of(build("rl", source=sources))
    z1 = complex(LINE["r1"], LINE["x1"]) * 120 * 5
    behind = circuit.branches[0]
    assert behind.r == pytest.approx([2 * z1.real, z1.real])
    assert behind.l * 2 * np.pi * 50 == pytest.approx([2 * z1.imag, z1.imag])


def test_a_bergeron_line_too_short_for_a_step_is_a_pi_and_says_so() -> None:
    plant = Plant(build("bergeron", line=[line("L", "A", "B", "bergeron", 10.0)]))
    (note,) = plant.notes
    assert note == (
        "line L from 0 to 1 pu (10 km): travel time 33.7 us is under one step of 52.1 us, so nominal-pi there"
    )


def test_a_long_bergeron_line_is_cascaded_until_its_losses_are_spread() -> None:
    """Open at its end, 500 km against the hyperbolic equations (Ferranti) for both sequences."""
    circuit = circuit_of(build("bergeron", line=[line("L", "A", "B", "bergeron", 500.0)]))
    assert 3 <= len(circuit.sections) <= 6
    equal, opposite = circuit.sections[0].wave.admittances(2 * np.pi * 50 / 19200)
    own, mutual = (equal + opposite) / 2, (opposite - equal) / 2  # i = own v - mutual v_other
    for mode, s in enumerate("01"):
        section = np.array([[own[mode], 1], [own[mode] ** 2 - mutual[mode] ** 2, own[mode]]]) / mutual[mode]
        whole = np.linalg.matrix_power(section, len(circuit.sections))
        z, y = complex(LINE["r" + s], LINE["x" + s]) * 500, 1e-6j * LINE["b" + s] * 500
        gamma, zc = np.sqrt(z * y), np.sqrt(z / y)
        exact = np.array([[np.cosh(gamma), zc * np.sinh(gamma)], [np.sinh(gamma) / zc, np.cosh(gamma)]])
        assert np.abs(whole / exact - 1).max() < 1e-3


def test_a_part_without_a_source_is_refused() -> None:
    lines = [line("L", "A", "B"), line("M", "C", "D")]
    with pytest.raises(InputError, match=r"line\[M\].from: bus 'C' reaches no source"):
        Plant(build("rl", line=lines))


def test_no_voltage_to_take_an_angle_of() -> None:
    """Two opposite sources: nothing half-way."""
    sources = [
        {"name": b, "bus": b, "angle_deg": a, "z1_ohm": [1, 10], "z0_ohm": [1, 10]}
        for b, a in (("A", 0), ("B", 180))
    ]
    fault = {"name": "F", "line": "L", "at_pu": 0.5, "type": "AG", "angle_deg": 0.0}
    with pytest.raises(InputError, match=r"fault\[F\].angle_deg: there is no voltage"):
        Plant(build("rl", source=sources, fault=[fault]))


def test_a_network_at_resonance_is_refused() -> None:
    """A lossless source reactance and a line's lossless capacitance tuned to each other."""
    own = network("pi")["line"][0] | {"r1_ohm_per_km": 0.0, "r0_ohm_per_km": 0.0, "sections": 1}
    b = LINE["b1"] * 120e-6 / 2
    x = LINE["x1"] * 120
    tuned = 1 / (b + 1 / (1 / b - x))
    source = {"name": "A", "bus": "A", "z1_ohm": [0.0, tuned], "z0_ohm": [0.0, tuned]}
    with pytest.raises(
        InputError, match=r"system.frequency_hz: at 50 Hz the network is at an undamped resonance"
    ):
        Plant(build("pi", line=[own], source=[source], system={"steps_per_sample": 200}))


def test_a_large_network_starts_steady() -> None:
    """More buses than the dense solution is for."""
    lines = [line(f"L{i}", f"B{i}", f"B{i + 1}", "pi", 60.0) | {"sections": 12} for i in range(20)]
    sources = network()["source"]
    sources[0]["bus"], sources[1]["bus"] = "B0", "B20"
    relays = [{"name": "R", "line": "L7", "end": "from", "settings": "x.toml"}]
    x, _ = record(Plant(build("pi", line=lines, source=sources, relay=relays)), 288)
    assert np.abs(x[:96] - x[-96:]).max() < 1e-9 * np.abs(x).max()


def test_a_source_too_fast_for_the_step_is_refused() -> None:
    source = network()["source"][0] | {"frequency_hz": 5000.0}
    with pytest.raises(InputError, match=r"source\[A\].frequency_hz: 5000 Hz is too high"):
        Plant(build("rl", source=[source]))


def test_faults_very_near_each_other_and_the_end() -> None:
    """Centimetres apart: nothing special, if the arithmetic holds."""
    at = (0.5, 0.5 + 1e-7, 1e-7)
    faults = [
        {"name": f"F{i}", "line": "L", "at_pu": p, "type": "AG", "start_s": 0.02, "resistance_ohm": 10.0}
        for i, p in enumerate(at)
    ]
    plant = Plant(build("bergeron", fault=faults))
    record(plant, 480)
    one, two = plant.probe.fault_current("F0")[0], plant.probe.fault_current("F1")[0]
    assert one == pytest.approx(two, rel=1e-4) and abs(one) > 100
