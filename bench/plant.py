"""The plant alone: steps per second beside DPsim's, and cost per step against the number of buses.

    python bench/plant.py

The same three-node circuit in both, at the same step and in one run: a source, its impedance, a pi line of
one section, a resistive load.  DPsim (PyPI ``dpsim``) runs without loggers, with each of its solvers, once by
``run()`` and once step by step by ``next()``; the plant gives a relay its samples.  Each figure is the best
of several alternating runs.  Then two sections between two sources, and networks of 3 to 100 buses.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant

RATE = 20_000
"""Steps per second: 50 us."""
STEPS = 100_000
ROUNDS = 7
OMEGA = 2 * np.pi * 50
KM = 60.0
LOAD_OHM = 200.0


def main() -> None:
    """Prints the three comparisons."""
    against_dpsim()
    print()
    model_costs()
    print()
    transformer_costs()
    print()
    against_buses()


def against_dpsim() -> None:
    """Steps per second of the same circuit in both."""
    plant = Plant(three_nodes())
    plant.advance(10)
    runs: dict[str, Callable[[], float]] = {"faultloop Plant.advance": lambda: advance(plant, STEPS // 4)}
    try:
        import dpsimpy
    except ImportError:
        print("DPsim is not installed here: pip install 'dpsim>=1.4'")
    else:
        for solver in ("KLU", "SparseLU", "DenseLU"):
            implementation = getattr(dpsimpy.DirectLinearSolverImpl, solver, None)
            if implementation is not None:
                runs[f"DPsim run(), {solver}"] = lambda i=implementation: dpsim(i, stepped=False)
                runs[f"DPsim next(), {solver}"] = lambda i=implementation: dpsim(i, stepped=True)
    best = dict.fromkeys(runs, np.inf)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), quiet():
        for _ in range(ROUNDS):
            for name, run in runs.items():
                best[name] = min(best[name], run() / STEPS)
    ours = best["faultloop Plant.advance"]
    print(f"three nodes, {1e6 / RATE:.0f} us")
    for name, seconds in best.items():
        print(
            f"  {name:24}{1e6 * seconds:8.3f} us/step {1e-3 / seconds:8.0f} k/s   ratio {seconds / ours:6.2f}"
        )


def model_costs() -> None:
    """Two sections between two sources (three buses), no relay and two relays behind breakers."""
    print("two sections between two sources, 4 steps per sample")
    for model in ("rl", "pi", "bergeron"):
        bare, full = (Plant(two_sections(model, relays)) for relays in (False, True))
        costs = [best_cost(plant, STEPS // 4) / 4 for plant in (bare, full)]
        print(
            f"  {model:10} three buses {1e6 * costs[0]:6.3f} us/step; "
            f"with two breakers and two relays {1e6 * costs[1]:6.3f} us/step"
        )


def transformer_costs() -> None:
    """Three relays at one line end behind nothing, a low-pass, a CT, a CVT, all of them.

    The plants take turns, and each is told as a ratio to the first."""
    variants = {
        "ideal": {},
        "low-pass": {"front_end": {"antialias_hz": 1500.0}},
        "ct": {"ct": "T"},
        "cvt": {"vt": "V"},
        "ct, cvt, low-pass": {"ct": "T", "vt": "V", "front_end": {"antialias_hz": 1500.0}},
    }
    plants = {name: Plant(three_relays(place)) for name, place in variants.items()}
    for plant in plants.values():
        plant.advance(10)
    best = dict.fromkeys(plants, np.inf)
    for _ in range(ROUNDS):
        for name, plant in plants.items():
            best[name] = min(best[name], advance(plant, STEPS // 4) / STEPS)
    print("three relays at two Bergeron sections")
    for name, seconds in best.items():
        print(f"  {name:20}{1e6 * seconds:8.3f} us/step   ratio {seconds / best['ideal']:5.2f}")


def three_relays(place: dict[str, Any]) -> Scenario:
    """With transformers that they may name; a fault from the start on saturates the core in every cycle."""
    relay = {"line": "L", "end": "from", "settings": "none.toml"} | place
    core = {"name": "T", "ratio": [1000, 1], "model": "saturating", "vs_v": 10.0, "burden_ohm": [5.0, 1.0]}
    return scenario(
        source=[source("A"), source("B") | {"angle_deg": -20.0}],
        line=[line("L", "A", "B", "bergeron", 200.0)],
        fault=[{"name": "F", "line": "L", "at_pu": 0.5, "type": "AG", "start_s": 0.0}],
        relay=[relay | {"name": f"R{i}"} for i in range(3)],
        ct=[core],
        vt=[{"name": "V", "ratio": [220e3, 110.0], "model": "cvt", "circuit": "A2"}],
    )


def against_buses() -> None:
    """A chain of lines, a source at every tenth bus."""
    print("chains of lines, us/step (and per bus)")
    for model, sections in (("rl", None), ("pi", 1), ("pi", 10), ("bergeron", None)):
        row = [f"  {model + (f' x{sections}' if sections else ''):10}"]
        for buses in (3, 10, 30, 100):
            plant = Plant(chain(model, sections, buses))
            cost = 1e6 * best_cost(plant, max(200, 40_000 // buses)) / 4
            row.append(f"{buses:4} buses {cost:7.2f} ({cost / buses:5.3f})")
        print("".join(row))


def best_cost(plant: Plant, samples: int) -> float:
    """Least wall time per sample [s]."""
    plant.advance(10)
    return min(advance(plant, samples) / samples for _ in range(ROUNDS))


def advance(plant: Plant, samples: int) -> float:
    """Wall time of so many samples [s]."""
    start = time.perf_counter()
    done = plant.advance(samples)
    assert done == samples
    return time.perf_counter() - start


def three_nodes() -> Scenario:
    """Source, bus A, pi line, bus B with a load (a three-phase fault from the beginning)."""
    return scenario(
        system={"frequency_hz": 50, "base_kv": 220, "sampling_hz": RATE // 4},
        relay=[{"name": "R", "line": "L", "end": "from", "settings": "none.toml"}],
        source=[source("A")],
        line=[line("L", "A", "B", "pi", KM) | {"sections": 1}],
        fault=[{"name": "load", "bus": "B", "type": "ABCG", "start_s": 0.0, "resistance_ohm": LOAD_OHM}],
    )


def two_sections(model: str, relays: bool) -> Scenario:
    """A line of 200 km cut half-way by a fault that comes after the bench."""
    ends = [("A", "from"), ("B", "to")] if relays else []
    return scenario(
        source=[source("A"), source("B") | {"angle_deg": -20.0}],
        line=[line("L", "A", "B", model, 200.0)],
        fault=[{"name": "F", "line": "L", "at_pu": 0.5, "type": "AG", "start_s": 9e3}],
        breaker=[{"name": f"Q{bus}", "line": "L", "end": end} for bus, end in ends],
        relay=[{"name": f"R{bus}", "line": "L", "end": end, "settings": "none.toml"} for bus, end in ends],
    )


def chain(model: str, sections: int | None, buses: int) -> Scenario:
    """Bus after bus."""
    lines = [line(f"L{i}", f"B{i}", f"B{i + 1}", model, 60.0) for i in range(buses - 1)]
    if sections is not None:
        lines = [item | {"sections": sections} for item in lines]
    return scenario(source=[source(f"B{i}") for i in range(0, buses, 10)], line=lines)


def scenario(**tables: Any) -> Scenario:
    header = {"name": "bench", "duration_s": 1e4}
    return Scenario.from_dict({"scenario": header, "system": {"frequency_hz": 50, "base_kv": 220}} | tables)


def source(bus: str) -> dict[str, Any]:
    return {"name": bus, "bus": bus, "z1_ohm": [1.0, 14.0], "z0_ohm": [2.0, 11.0]}


def line(name: str, start: str, end: str, model: str, km: float) -> dict[str, Any]:
    item = {"name": name, "from": start, "to": end, "model": model, "length_km": km}
    item |= {"r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.4, "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.2}
    return item if model == "rl" else item | {"b1_us_per_km": 2.8, "b0_us_per_km": 1.8}


def dpsim(solver: Any, stepped: bool) -> float:
    """Wall time of `STEPS` steps in DPsim [s], without its set-up where it can be left out (``next()``)."""
    import dpsimpy
    from dpsimpy import emt

    def three(zero: float, positive: float) -> np.ndarray:
        return np.eye(3) * positive + (zero - positive) / 3

    ground = emt.SimNode.gnd
    n1, n2, n3 = (emt.SimNode(name, dpsimpy.PhaseType.ABC) for name in ("n1", "n2", "n3"))
    emf = emt.ph3.VoltageSource("emf")
    emf.set_parameters(dpsimpy.Math.single_phase_variable_to_three_phase(220e3 + 0j), 50)
    emf.connect([ground, n1])
    behind, pi = emt.ph3.PiLine("behind"), emt.ph3.PiLine("pi")
    behind.set_parameters(three(2.0, 1.0), three(11.0, 14.0) / OMEGA)
    behind.connect([n1, n2])
    pi.set_parameters(
        three(0.24, 0.06) * KM, three(1.2, 0.4) * KM / OMEGA, three(1.8e-6, 2.8e-6) * KM / OMEGA
    )
    pi.connect([n2, n3])
    load = emt.ph3.Resistor("load")
    load.set_parameters(np.eye(3) * LOAD_OHM)
    load.connect([ground, n3])
    simulation = dpsimpy.Simulation("bench", dpsimpy.LogLevel.off)
    simulation.set_system(dpsimpy.SystemTopology(50, [ground, n1, n2, n3], [emf, behind, pi, load]))
    simulation.set_domain(dpsimpy.Domain.EMT)
    simulation.set_direct_solver_implementation(solver)
    simulation.set_time_step(1 / RATE)
    simulation.set_final_time(STEPS / RATE)
    if not stepped:
        start = time.perf_counter()
        simulation.run()
        return time.perf_counter() - start
    simulation.start()
    start = time.perf_counter()
    for _ in range(STEPS):
        simulation.next()
    seconds = time.perf_counter() - start
    simulation.stop()
    return seconds


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Without what DPsim's C++ writes to the terminal."""
    with Path(os.devnull).open("w", encoding="utf-8") as sink:
        kept = os.dup(1), os.dup(2)
        os.dup2(sink.fileno(), 1)
        os.dup2(sink.fileno(), 2)
        try:
            yield
        finally:
            for target, descriptor in enumerate(kept, 1):
                os.dup2(descriptor, target)
                os.close(descriptor)


if __name__ == "__main__":
    main()
