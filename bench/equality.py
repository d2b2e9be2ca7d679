"""A campaign's case, `run` and the log of `run` say the same: random cases over what a scenario may have.

    python bench/equality.py [CASES] [--seed N] [--first N]

Each case is run three times: by `faultloop.run` with a log, by `run` without one, and by `Cases`.  Trips,
faults, events (of one instant in any order), positions, frames, bus load, locations: to the nanosecond and
bit.  The first difference ends it, with status 3 and the number of the case.
"""

from __future__ import annotations

import argparse
import copy
import tempfile
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import faultloop
from faultloop.loop.case import Cases
from faultloop.loop.outcome import Cast, Fold, outcome_of
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings

SCENARIOS = Path(__file__).resolve().parents[1] / "scenarios"
BASE = tomllib.loads((SCENARIOS / "ag-zone1.toml").read_text(encoding="utf-8"))
TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG")
ESTIMATORS = ("kalman-bank", "fourier", "half-fourier", "cosine", "rls")
NODES = ("RA", "RB", "QA", "QB")
STATES = ("trip", "pilot", "breaker_status", None)
DURATION_S = 0.2
KEY = "000102030405060708090a0b0c0d0e0f"
ELEMENT = """
def overcurrent(state, x, out):
    out[0] = out[1] = abs(x[6]) > 2500.0


def counting(state, x, out):
    state[0] += 1.0
    out[0] = state[0] > 300.0
"""


def draw_fault(rng: np.random.Generator) -> dict[str, Any]:
    """Somewhere on the line, at any time, for ever or not."""
    fault: dict[str, Any] = {
        "line": "AB",
        "at_pu": float(rng.uniform(0.02, 0.98)),
        "type": str(rng.choice(TYPES)),
        "start_s": float(rng.uniform(0.02, 0.15)),
        "resistance_ohm": float(rng.choice([0.0, 1.0, 10.0])),
    }
    if rng.random() < 0.4:
        fault["duration_s"] = float(rng.uniform(0.005, 0.1))
    return fault


def draw_bus_fault(rng: np.random.Generator) -> dict[str, Any]:
    """Anything that can befall the bus."""
    kinds = ("loss", "corruption", "delay", "duplication", "reordering", "bit_error", "babbling", "forging")
    kind = str(rng.choice([*kinds, "bus_off", "restart"]))
    fault: dict[str, Any] = {"kind": kind, "start_s": float(rng.uniform(0.0, 0.15))}
    node, chance = str(rng.choice(NODES)), {"probability": float(rng.uniform(0.05, 0.6))}
    match kind:
        case "babbling":
            return fault | {"identifier": int(rng.integers(0, 0x7FF)), "rate_hz": 500.0}
        case "forging":
            content = str(rng.choice(["random", "replayed", "crafted"]))
            return fault | {"node": "RA", "message": "trip", "rate_hz": 200.0, "content": content}
        case "bus_off" | "restart":
            return fault | {"node": node, "duration_s": float(rng.uniform(0.001, 0.05))}
        case "delay":
            chance |= {"delay_ms": float(rng.uniform(0, 3)), "jitter_ms": 1.0}
    message = rng.choice(np.array(STATES, object))
    fault |= chance | ({"message": message} if message else {"node": node})
    return fault | ({"duration_s": float(rng.uniform(0.01, 0.1))} if rng.random() < 0.5 else {})


def draw_settings(rng: np.random.Generator, folder: Path, estimators: tuple[str, ...]) -> RelaySettings:
    """Of a relay: its scheme, its estimator, and a user's own element."""
    name = "ab-single-pole" if rng.random() < 0.3 else "ab-mho"
    data = tomllib.loads((SCENARIOS / "settings" / f"{name}.toml").read_text(encoding="utf-8"))
    data["estimator"] = {"method": str(rng.choice(estimators))}
    if rng.random() < 0.2:
        function = str(rng.choice(["overcurrent", "counting"]))
        data["element"] = [{"name": "OWN", "function": f"own.py:{function}", "state": [0.0], "trip": False}]
    return RelaySettings.from_dict(data, path=folder / "own.toml")


def draw(
    number: int, seed: int, folder: Path, estimators: tuple[str, ...] = ESTIMATORS
) -> tuple[Scenario, dict[str, RelaySettings]]:
    """Case `number`: it depends on the seed, its number and the estimators alone; `folder`: of `prepare`."""
    rng = np.random.default_rng([seed, number])
    data = copy.deepcopy(BASE) | {"expect": []}
    data["scenario"] |= {"duration_s": DURATION_S, "seed": int(rng.integers(1000))}
    data["fault"] = [draw_fault(rng) for _ in range(rng.choice([0, 1, 1, 1, 2, 3]))]
    if len(data["fault"]) > 1 and rng.random() < 0.5:  # evolving: at the first one's place
        data["fault"][1]["at_pu"] = data["fault"][0]["at_pu"]
    data["bus_fault"] = [draw_bus_fault(rng) for _ in range(rng.choice([0, 0, 0, 1, 2, 3]))]
    data["can"] = {
        "heartbeat_s": float(rng.choice([0.02, 0.1, 1.0])),
        "measurements_hz": float(rng.choice([0.0, 10.0, 100.0])),
        "confirmations": int(rng.choice([1, 1, 1, 2])),
        "fd": bool(rng.random() < 0.4),
    }
    if data["can"]["fd"] and rng.random() < 0.5:
        data["can"]["keys"] = str(folder / "keys.toml")
    if rng.random() < 0.3:
        data["front_end"] = {"antialias_hz": 1200.0, "voltage_noise_v": 50.0, "current_noise_a": 1.0}
    for breaker in data["breaker"]:
        breaker["operate_ms"] = float(rng.choice([0.0, 20.0, 40.0]))
    settings = {name: draw_settings(rng, folder, estimators) for name in ("RA", "RB")}
    return Scenario.from_dict(data, path=SCENARIOS / "x.toml"), settings


def prepare(folder: Path) -> None:
    """The files that cases name."""
    (folder / "own.py").write_text(ELEMENT, encoding="utf-8")
    (folder / "keys.toml").write_text(f'default = "{KEY}"\n', encoding="utf-8")
    (folder / "keys.toml").chmod(0o600)


def differences(
    scenario: Scenario, settings: dict[str, RelaySettings], cases: Cases, folder: Path
) -> list[str]:
    """What a log, a run and a case do not say alike; empty where all agree."""
    logged = faultloop.run(scenario, settings=settings, log=folder / "case.mcap")
    fold = Fold(Cast.of_scenario(scenario))
    alone = faultloop.run(scenario, settings=settings, keep=False, sinks=[fold])
    case = cases.prepare(scenario, settings).run()
    said = fold.outcome()
    written = outcome_of(faultloop.open_log(folder / "case.mcap"))
    for outcome in (said, written, case):  # a log has its topics one after the other
        outcome.events.sort(key=lambda event: (event.t_ns, event.source, event.text))
    found = [
        f"{key}: {name}"
        for key in ("trips", "faults", "events", "positions", "can_frames")
        for name, other in (("log", written), ("case", case))
        if getattr(other, key) != getattr(said, key)
    ]
    for name, other in (("log", logged), ("case", case)):
        if other.bus_load != alone.bus_load:
            found.append(f"bus load: {name}")
        if repr(other.fault_locations) != repr(alone.fault_locations):
            found.append(f"locations: {name}")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("cases", type=int, nargs="?", default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    kept, tripped = Cases(), Counter[int]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        for number in range(options.first, options.first + options.cases):
            scenario, settings = draw(number, options.seed, folder)
            found = differences(scenario, settings, kept, folder)
            if found:
                print(f"case {number}: {', '.join(found)}")
                return 3
            tripped[len(faultloop.open_log(folder / "case.mcap").trips)] += 1
    told = ", ".join(f"{count} with {trips} trips" for trips, count in sorted(tripped.items()))
    print(f"{options.cases} cases, seed {options.seed}: log, run and case are the same; {told}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
