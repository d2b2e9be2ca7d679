"""A campaign's row, its case, `run` and the log of `run` say the same: random scenarios of all kinds.

    python bench/equality.py [CASES] [--seed N] [--first N] [--rows N] [--seconds S] [--workers N]
        [--results FILE] [--keep]

Scenarios are drawn, and of each a campaign of N rows (20), so many that there are CASES rows (10,000).  Each
scenario is run three times: by `faultloop.run` with a log, by `run` without one and with nothing kept from
the runs before, and by `Cases`.  Trips, faults, events (of one instant in any order), positions, frames, bus
load, locations: to the nanosecond and bit.  The campaign varies it (each second one leaves the network as it
is, so that its cases go on from each other's beginning), and each row, as it is read back from the Parquet
file, is what `run` of that case, begun with nothing kept, and its log say.

What each scenario came to is a line of FILE (in logs/, named by the sources of the loop), and is not run
again: the same command goes on.  At the end it tells how many rows had what in them, and each difference,
with status 3.
"""

# ruff: noqa: E402
from __future__ import annotations

import argparse
import copy
import json
import math
import os
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

for key in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(key, "1")  # a worker for each core

import numpy as np
import pyarrow.parquet as pq

import faultloop
from faultloop.config.toml_text import toml_text
from faultloop.jit import source_digest
from faultloop.loop.case import Cases, give_back
from faultloop.loop.outcome import Cast, Fold, TripReport, outcome_of
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings

ROOT = Path(__file__).resolve().parents[1]
SCENARIOS, LINES = ROOT / "scenarios", ROOT / "logs" / f"equality-{source_digest('loop')[:12]}.jsonl"
BASE = tomllib.loads((SCENARIOS / "ag-zone1.toml").read_text(encoding="utf-8"))
TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG")
ESTIMATORS = ("kalman-bank", "fourier", "half-fourier", "cosine", "rls")
NODES = ("RA", "RB", "QA", "QB")
STATES = ("trip", "pilot", "breaker_status", None)
DURATION_S = 0.2
KEY = "000102030405060708090a0b0c0d0e0f"
ELEMENT = """
from numba import njit


def overcurrent(state, x, out):
    out[0] = out[1] = abs(x[6]) > 2500.0


def counting(state, x, out):
    state[0] += 1.0
    out[0] = state[0] > 300.0


fast_overcurrent, fast_counting = njit(overcurrent), njit(counting)
"""
PLAIN = 0.05
"""Of the users' elements that are Python: a row with one takes 4 s, and others 0.3."""


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


def draw_settings(rng: np.random.Generator, estimators: tuple[str, ...]) -> dict[str, Any]:
    """Of a relay: its scheme, its estimator, and a user's own element."""
    name = "ab-single-pole" if rng.random() < 0.3 else "ab-mho"
    data = tomllib.loads((SCENARIOS / "settings" / f"{name}.toml").read_text(encoding="utf-8"))
    data["estimator"] = {"method": str(rng.choice(estimators)), "unsafe": True}
    if rng.random() < 0.2:
        function = str(rng.choice(["overcurrent", "counting"]))
        function = function if rng.random() < PLAIN else f"fast_{function}"
        data["element"] = [{"name": "OWN", "function": f"own.py:{function}", "state": [0.0], "trip": False}]
    return data


def draw_primary(rng: np.random.Generator, data: dict[str, Any]) -> None:
    """What the network may have besides the line, and the relays' transformers."""
    match rng.choice(["line", "line", "parallel", "capacitor"]):
        case "parallel":
            data["line"].append(data["line"][0] | {"name": "CD"})
            data["mutual"] = [{"lines": ["AB", "CD"], "r0m_ohm_per_km": 0.18, "x0m_ohm_per_km": 0.65}]
        case "capacitor":
            bank = {"line": "AB", "at_pu": float(rng.choice([0.0, 0.5, 1.0])), "x_ohm": 16.0, "mov_kv": 60.0}
            data["series_capacitor"] = [bank]
    if rng.random() < 0.2:
        data["load"] = [{"name": "P", "bus": "B", "mw": 80.0, "mvar": 20.0}]
    if rng.random() < 0.2:
        own = {"ratio": [1000, 1], "model": "saturating", "vs_v": 200.0, "burden_ohm": [4.0, 0.0]}
        data["ct"] = [own | {"name": "TA", "rw_ohm": 4.0, "remanence_pu": float(rng.uniform(0.0, 0.8))}]
        data["relay"][0]["ct"] = "TA"
    if rng.random() < 0.2:
        circuit = str(rng.choice(["P1", "A2"]))
        data["vt"] = [{"name": "TV", "ratio": [220_000, 110], "model": "cvt", "circuit": circuit}]
        data["relay"][0]["vt"] = "TV"


def draw(
    number: int, seed: int, folder: Path, estimators: tuple[str, ...] = ESTIMATORS
) -> tuple[Scenario, dict[str, RelaySettings]]:
    """Case `number`: it depends on the seed, its number and the estimators alone; `folder`: of `prepare`."""
    data, settings = drawn(number, seed, folder, estimators)
    own = {name: RelaySettings.from_dict(one, path=folder / "own.toml") for name, one in settings.items()}
    return Scenario.from_dict(data, path=SCENARIOS / "x.toml"), own


def drawn(
    number: int, seed: int, folder: Path, estimators: tuple[str, ...] = ESTIMATORS
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """The same as what a scenario's file and those of its relays' settings would parse to."""
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
    settings = {name: draw_settings(rng, estimators) for name in ("RA", "RB")}
    draw_primary(rng, data)
    return data, settings


def campaign(
    number: int, seed: int, folder: Path, rows: int, estimators: tuple[str, ...] = ESTIMATORS
) -> faultloop.Campaign:
    """Of `rows` cases of scenario `number`: what there is in it, varied."""
    data, settings = drawn(number, seed, folder, estimators)
    for relay in data["relay"]:
        relay["settings"] = f"{relay['name']}.toml"
        (folder / relay["settings"]).write_text(toml_text(settings[relay["name"]]), encoding="utf-8")
    (folder / "drawn.toml").write_text(toml_text(data), encoding="utf-8")
    same = number % 2 == 1
    """Its cases have one network, and go on from each other's beginning."""
    vary: list[dict[str, Any]] = [
        {"key": "scenario.seed", "values": [1, 22, 333, 4444]},
        {"key": "relay.RA.estimator.method", "values": list(estimators)},
        {"keys": ["relay.RA.pdis.1.reach_pu", "relay.RB.pdis.1.reach_pu"], "uniform": [0.5, 0.95]},
        {"key": "breaker.QA.operate_ms", "uniform": [0.0, 40.0]},
        {"key": "source.SB.angle_deg", "values": [-12.0, 5.0]},
        {"key": "can.fd", "values": [True, False]},
    ]
    if "keys" in data["can"]:
        vary[-1] = {"key": "can.confirmations", "values": [1, 2]}  # tags need CAN FD
    if same:
        vary = [{"key": "scenario.duration_s", "values": [0.15, 0.2]}]
    for place, fault in enumerate(data["fault"]):
        here = [n for n, other in enumerate(data["fault"]) if other["at_pu"] == fault["at_pu"]]
        if here[0] == place:  # those at one place stay together
            places = {"values": [0.1, 0.6]} if same else {"uniform": [0.03, 0.97]}
            vary.append({"keys": [f"fault.{n}.at_pu" for n in here], **places})
        vary.append({"key": f"fault.{place}.type", "values": list(TYPES)})
        vary.append({"key": f"fault.{place}.start_s", "uniform": [0.02, 0.15]})
        vary.append({"key": f"fault.{place}.resistance_ohm", "log_uniform": [0.1, 50.0]})
    head = {"name": f"{number}", "scenario": "drawn.toml", "sampling": "random", "cases": rows, "seed": seed}
    tables = {"campaign": head, "vary": vary, "judge": [{"relay": "RA", "trip": True, "within_ms": 60}]}
    return faultloop.Campaign.from_dict(tables, path=folder / "campaign.toml")


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
    give_back(Cases())  # as the first run of a thread
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


COLUMNS = {
    "function": "function", "zone": "zone", "loop": "loop", "poles": "pole_names", "decided_ns": "t_ns",
    "received_ns": "received_ns", "opened_ns": "opened_ns",
}  # fmt: skip


def row_differences(campaign: faultloop.Campaign, folder: Path) -> list[str]:
    """What the rows of a campaign, read back, do not say as `run` of their cases, and its log, do."""
    out = folder / "rows.parquet"
    out.unlink(missing_ok=True)
    campaign.run(out)
    found = []
    for row in pq.read_table(out).to_pylist():
        try:
            case = campaign.case(row["case"])
            give_back(Cases())
            done = faultloop.run(case.scenario, settings=case.settings, log=folder / "case.mcap", keep=False)
        except faultloop.InputError as error:
            if row["error"] is None or not str(error).startswith(row["error"]):
                found.append(f"row {row['case']}: {row['error']} is told, {error} is so")
            continue
        log = outcome_of(faultloop.open_log(folder / "case.mcap"))
        said = [("run", done.trips, done.fault_start_ns), ("log", log.trips, log.fault_start_ns)]
        for name, trips, fault_ns in said:
            expected = expected_cells(case.scenario, trips, fault_ns)
            if name == "run":
                for relay, place in done.fault_locations.items():
                    expected[f"{relay}.location_pu"] = place if math.isfinite(place) else None
            expected["error"] = None
            found += [
                f"row {row['case']}: {key} {row[key]!r}, {name} {value!r}"
                for key, value in expected.items()
                if repr(row[key]) != repr(value)
            ]
    return found


def expected_cells(scenario: Scenario, trips: list[TripReport], fault_ns: int | None) -> dict[str, Any]:
    """A row's cells but for the locations, by what `docs/campaigns.md` says of them."""
    cells: dict[str, Any] = {"fault_ns": fault_ns}
    for relay in scenario.relay:
        own = sorted((trip for trip in trips if trip.relay == relay.name), key=lambda trip: trip.t_ns)
        cells |= {f"{relay.name}.trips": len(own), f"{relay.name}.tripped": bool(own)}
        for column, name in COLUMNS.items():
            cells[f"{relay.name}.{column}"] = getattr(own[0], name) if own else None
    return cells


def features(scenario: Scenario, settings: dict[str, RelaySettings]) -> set[str]:
    """What there is in it, by name."""
    faults = scenario.fault
    found = {f"{len(faults)} faults", *(f"bus fault {fault.kind}" for fault in scenario.bus_fault)}
    found |= {f"estimator {own.estimator.method}" for own in settings.values()}
    has = {
        "evolving fault": len({fault.at_pu for fault in faults}) < len(faults),
        "fault with a duration": any(fault.duration_s is not None for fault in faults),
        "keys": scenario.keys_path is not None,
        "CAN FD": scenario.can.fd,
        "single-pole": any(own.ptrc.mode == "single-pole" for own in settings.values()),
        "user's element": any(own.element for own in settings.values()),
        "noise of the front end": scenario.front_end.voltage_noise_v > 0,
        "parallel line": len(scenario.line) > 1,
        "series capacitor": bool(scenario.series_capacitor),
        "load": bool(scenario.load),
        "CT that saturates": bool(scenario.ct),
        "CVT": bool(scenario.vt),
        "breakers without delay": any(breaker.operate_ms == 0 for breaker in scenario.breaker),
    }
    return found | {name for name, there in has.items() if there}


_kept = Cases()


def family(number: int, seed: int, rows: int, folder: Path) -> dict[str, Any]:
    """A scenario and its campaign: what differs, and how many rows have what."""
    folder = folder / str(os.getpid())
    folder.mkdir(exist_ok=True)
    prepare(folder)
    begin = time.process_time()
    scenario, settings = draw(number, seed, folder)
    found = differences(scenario, settings, _kept, folder)
    counts = Counter[str]()
    if rows:
        own = campaign(number, seed, folder, rows)
        found += row_differences(own, folder)
        for row in pq.read_table(folder / "rows.parquet").to_pylist():
            counts["rows"] += 1
            if row["error"] is not None:
                counts["rows that are impossible"] += 1
                continue
            case = own.case(row["case"])
            counts.update(features(case.scenario, case.settings))
            counts["trips"] += row["RA.trips"] + row["RB.trips"]
            counts["rows without a trip"] += not (row["RA.tripped"] or row["RB.tripped"])
    spent = round(time.process_time() - begin, 2)
    return {
        "seed": seed, "number": number, "rows": rows, "found": found, "cpu_s": spent, "counts": dict(counts),
    }  # fmt: skip


def told(lines: Iterable[dict[str, Any]]) -> tuple[str, str]:
    """What the lines of a file of results come to: the whole, and what the rows have in them."""
    lines = list(lines)
    counts = sum((Counter(line["counts"]) for line in lines), Counter[str]())
    rows, cpu_s = counts.pop("rows", 0), sum(line["cpu_s"] for line in lines)
    differ = sum(bool(line["found"]) for line in lines)
    whole = f"{len(lines)} scenarios and {rows} rows, {differ} scenarios with a difference"
    if rows:
        whole += f" ({cpu_s / rows:.2f} s of CPU a row)"
    return whole, ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))


def done(file: Path, seed: int, rows: int) -> list[dict[str, Any]]:
    """The lines of it that are whole."""
    lines = []
    for text in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
        try:
            line = json.loads(text)
        except ValueError:  # cut off by a kill
            continue
        if (line["seed"], line["rows"]) == (seed, rows):
            lines.append(line)
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("cases", type=int, nargs="?", default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rows", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=math.inf)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--results", type=Path, default=LINES)
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    options = parser.parse_args()
    until_s = time.monotonic() + options.seconds
    count = -(-options.cases // max(options.rows, 1))
    wanted = range(options.first, options.first + count)
    lines = [line for line in done(options.results, options.seed, options.rows) if line["number"] in wanted]
    todo = iter(sorted(set(wanted) - {line["number"] for line in lines}))
    memory = Path("/dev/shm")
    with (
        tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as name,
        ProcessPoolExecutor(options.workers, get_context("spawn")) as pool,
        options.results.open("a", encoding="utf-8") as file,
    ):
        running = set()
        while time.monotonic() < until_s:
            while len(running) < 2 * options.workers and (number := next(todo, None)) is not None:
                running.add(pool.submit(family, number, options.seed, options.rows, Path(name)))
            if not running:
                break
            future = next(as_completed(running))
            running.discard(future)
            lines.append(future.result())
            file.write(json.dumps(lines[-1]) + "\n")
            file.flush()
            for text in lines[-1]["found"]:
                print(f"scenario {lines[-1]['number']}: {text}", flush=True)
            if len(lines) % 25 == 0:
                print(f"{len(lines)} of {count} scenarios", file=sys.stderr, flush=True)
        for future in running:
            future.cancel()
    whole, content = told(lines)
    print(f"{whole}, seed {options.seed}: log, run, case and row are compared; rows with {content}")
    if options.keep and len(lines) == count:
        from results import keep

        keep(
            "Campaigns",
            [("A campaign's row, read back, `run` with nothing kept and its log", f"{whole}; {content}")],
        )
    return 3 if any(line["found"] for line in lines) else 0


if __name__ == "__main__":
    raise SystemExit(main())
