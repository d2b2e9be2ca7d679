"""Relay functions by the thousand: fuse failures, power swings, faults in both, breaker failures.

It tells what tripped that must not, and how long the others took.

    python bench/functions.py [--cases N] [--seed S] [--method METHOD] WHAT

WHAT is one of change, fuse, swing, swing-fault, swing-outside, swing-after, breaker, cost.

Networks of two sources of 0.3 to 3 times those of ``tests/relay/network.py``. `change`: the angle between
the sources changes by 5 to 30 degrees, at once or within 300 ms; 30 to 150 ms after that began there is a
fault of any type in the first 80 % of the line, at the bus behind, or in the last 8 %; the relay has no RPSB.
`fuse`: one, two or three voltages are lost under load of -20 to 20 degrees; the load changes, then a fault of
any type in the first 80 % of the line or none, then (without a fault) the voltages are back. `swing`: slips
of 0.5 to 7 Hz and stable swings of 0.5 to 3 Hz up to 140 degrees; `swing-fault`: with a bolted fault of any
type within 80 %, at any time after the first 60 ms; `swing-outside`: with one, in four of ten of 1 to 40 ohm,
at the bus behind or in the last 8 % of the line, which goes 150 ms later; `swing-after`: with one from the
same places that stands for 60 to 200 ms and makes the swing, stable or not, which goes on after it.
`breaker`: a fault's
current of 1.5 to 100 times RBRF's limit, with offset, is tripped; the poles open at their zeros 30 to 60 ms
later, and their cores go on with up to half of the crest, of either sign, for 30 to 100 ms; in a third of the
cases a pole stays closed: OpEx must come then and only then, and the detector be off within 15 ms of the last
zero. `cost`: microseconds of CPU a sample, all functions against none, and `fourier` alone, in one run.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from faultloop.relay import Relay, RelaySettings
from tests.relay import swings
from tests.relay.network import TYPES, Network, play, settings_dict

FS, LIMIT_MS, RESET_MS = 4800, 60.0, 15.0
ZONES = [
    {"zone": 1, "reach_pu": 0.85},
    {"zone": 2, "reach_pu": 1.3, "delay_ms": 300.0},
    {"zone": 3, "reach_pu": 0.6, "direction": "reverse", "delay_ms": 600.0},
    {"zone": 4, "reach_pu": 0.85, "characteristic": "quad", "resistive_reach_ohm": 15.0},
]
BOXES = {"outer_resistance_ohm": 45.0, "inner_resistance_ohm": 22.0}
EMERGENCY = [
    {"pickup_a": 1700.0, "delay_ms": 60.0, "when": "fuse-failure"},
    {"quantity": "residual", "pickup_a": 300.0, "delay_ms": 60.0, "when": "fuse-failure"},
    {"quantity": "negative-sequence", "pickup_a": 200.0, "delay_ms": 60.0, "when": "fuse-failure"},
]
ALL: dict[str, Any] = {
    "tvtr": {},
    "rpsb": BOXES,
    "zload": {"resistance_ohm": 60.0},
    "pioc": [{"pickup_a": 2e4, "direction": "forward"}],
    "ptoc": [{"pickup_a": 2e4, "curve": "iec-normal-inverse", "direction": "forward"}, *EMERGENCY],
    "ptuv": [{"start_v": 60e3}],
    "ptov": [{"start_v": 200e3}],
    "ptuf": [{"start_hz": 47.0}],
    "ptof": [{"start_hz": 53.0}],
    "pfrc": [{"start_hz_per_s": 5.0}],
}


def relay(network: Network, method: str, **tables: Any) -> Relay:
    given: dict[str, Any] = settings_dict(network, ZONES, estimator={"method": method})
    given["relay"]["nominal_kv"] = 230
    return Relay(RelaySettings.from_dict(given | tables))


def draw(rng: np.random.Generator) -> Network:
    near, far = np.exp(rng.uniform(np.log(0.3), np.log(3), 2))
    return Network(
        zs1=(1 + 12j) * near, zs0=(1.5 + 15j) * near, zr1=(1.5 + 18j) * far, zr0=(3 + 30j) * far,
        angle_deg=float(rng.uniform(-20, 20)),
    )  # fmt: skip


def trips(r: Relay, x: np.ndarray) -> list[float]:
    return [event.sample_count / FS for event in play(r, x) if event.trip]


def judge(found: list[float], start_s: float | None) -> tuple[str, float]:
    """A verdict, and milliseconds from the fault to the trip."""
    if any(start_s is None or at < start_s for at in found):
        return "wrong trip", np.nan
    if start_s is None:
        return "right", np.nan
    return ("right", 1000 * (found[0] - start_s)) if found else ("no trip", np.inf)


def fuse(rng: np.random.Generator, method: str) -> tuple[str, float]:
    network = draw(rng)
    lost = np.array([rng.random(3) < 0.5])[0] if rng.random() < 0.8 else np.ones(3, bool)
    lost[rng.integers(3)] = True
    load = network.solve()
    changed = Network(
        **{**vars(network), "angle_deg": network.angle_deg * float(rng.uniform(0.5, 1.3))}
    ).solve()
    at_s, change_s = 0.3 + float(rng.uniform(0, 0.02)), 0.3 + float(rng.uniform(0.03, 0.5))
    blank = np.r_[np.where(lost, 0.0, 1.0), np.ones(3)]
    stages, start_s = [(0.0, load), (at_s, load * blank), (change_s, changed * blank)], None
    if rng.random() < 0.5:
        start_s = change_s + float(rng.uniform(0.03, 0.5))
        stages.append((start_s, network.solve(str(rng.choice(TYPES)), float(rng.uniform(0.02, 0.8))) * blank))
    else:
        stages.append((change_s + float(rng.uniform(0.03, 0.5)), changed))
    x = network.samples(stages, stages[-1][0] + 0.4)
    return judge(trips(relay(network, method, tvtr={}, rpsb=BOXES, ptoc=EMERGENCY), x), start_s)


def change(rng: np.random.Generator, method: str) -> tuple[str, float]:
    """The load changes, then a fault within that; what is outside may not trip within 250 ms."""
    network, begins_s = draw(rng), 0.3 + float(rng.uniform(0, 0.02))
    takes_s = 0.0 if rng.random() < 0.4 else float(rng.uniform(0, 0.3))
    start_s, kind = begins_s + float(rng.uniform(0.03, 0.15)), str(rng.choice(TYPES))
    t = np.arange(round((start_s + 0.25) * FS)) / FS - begins_s
    by = float(rng.uniform(5, 30)) * rng.choice([-1, 1])
    angle = network.angle_deg + by * np.clip(t / max(takes_s, 1e-9), 0, 1)
    where = str(rng.choice(["inside", "inside", "behind", "beyond"]))
    places = {"inside": (0.02, 0.8), "behind": (-1.0, -1.0), "beyond": (0.92, 1.0)}
    at = float(rng.uniform(*places[where]))
    found = trips(relay(network, method), swings.samples(network, angle, kind, at, start_s))
    verdict, ms = judge(found, start_s)
    if where == "inside":
        return verdict, ms
    return (f"trip, {where}" if found else "right"), np.nan


def outside(rng: np.random.Generator, method: str) -> tuple[str, float]:
    """No zone may trip: neither for the fault, nor for the swing after it has gone."""
    network = draw(rng)
    hz = float(np.exp(rng.uniform(np.log(0.5), np.log(7))))
    if rng.random() < 0.6:
        angle = swings.slipping(network, hz, 0.3 + max(1.2 / hz, 0.6), load_deg=float(rng.choice([-20, 20])))
    else:
        hz = min(hz, 3.0)
        angle = swings.stable(network, hz, float(rng.uniform(60, 140)), 0.3 + max(1.2 / hz, 0.6))
        angle *= rng.choice([-1, 1])
    start_s, kind = float(rng.uniform(0.36, len(angle) / FS - 0.15)), str(rng.choice(TYPES))
    at = -1.0 if rng.random() < 0.5 else float(rng.uniform(0.92, 1.0))
    ohm = 0.0 if rng.random() < 0.6 else float(np.exp(rng.uniform(0.0, np.log(40.0))))
    x = swings.samples(network, angle, kind, at, start_s, resistance=ohm, end_s=start_s + 0.15)
    where = f"{'behind' if at < 0 else 'beyond'}, {'resistance' if ohm else 'bolted'}"
    return (f"trip, {where}" if trips(relay(network, method, rpsb=BOXES), x) else "right"), np.nan


def accelerated(rng: np.random.Generator, begins_s: float, stands_s: float) -> np.ndarray:
    """Angle between the sources [degrees], at every sample, until 1.2 s after a fault that lets one
    side accelerate (all its power lost, H of 1.5 to 10 s): it comes back, or goes on to a slip of up to
    7 Hz."""
    rate = math.pi * 50 / float(np.exp(rng.uniform(np.log(1.5), np.log(10))))  # rad/s^2
    seconds = begins_s + stands_s + 1.2
    t = np.arange(round(seconds * FS)) / FS - begins_s
    gone = np.maximum(t - stands_s, 0.0)
    angle = 0.5 * rate * np.clip(t, 0.0, stands_s) ** 2
    slip, load = rate * stands_s, math.radians(rng.uniform(10, 40))
    if rng.random() < 0.5:
        most = max(2.2 - load - angle[-1], 0.1)  # stable to some 125 degrees
        turn = max(2 * math.pi * float(rng.uniform(0.5, 3.0)), slip / most)
        angle += slip / turn * np.sin(turn * gone)
    else:
        final = max(2 * math.pi * float(np.exp(rng.uniform(np.log(0.5), np.log(7)))), slip)
        tau = float(rng.uniform(0.1, 0.5))
        angle += final * gone - (final - slip) * tau * (1 - np.exp(-gone / tau))
    return np.degrees(load + angle) * rng.choice([-1, 1])


def after(rng: np.random.Generator, method: str) -> tuple[str, float]:
    """The fault makes the swing, and goes.  No zone may trip."""
    network = draw(rng)
    begins_s, stands_s = 0.3 + float(rng.uniform(0, 0.02)), float(rng.uniform(0.06, 0.2))
    degrees = accelerated(rng, begins_s, stands_s)
    kind, at = str(rng.choice(TYPES)), -1.0 if rng.random() < 0.5 else float(rng.uniform(0.92, 1.0))
    ohm = 0.0 if rng.random() < 0.6 else float(np.exp(rng.uniform(0.0, np.log(40.0))))
    x = swings.samples(network, degrees, kind, at, begins_s, resistance=ohm, end_s=begins_s + stands_s)
    where = f"{'behind' if at < 0 else 'beyond'}, {'resistance' if ohm else 'bolted'}"
    found = trips(relay(network, method, rpsb=BOXES), x)
    if not found:
        return "right", np.nan
    return f"trip {'in' if found[0] < begins_s + stands_s else 'after'} it, {where}", np.nan


def swing(rng: np.random.Generator, method: str, fault: bool = False) -> tuple[str, float]:
    network = draw(rng)
    hz = float(np.exp(rng.uniform(np.log(0.5), np.log(7))))
    if rng.random() < 0.5:
        angle = swings.slipping(network, hz, 0.3 + max(1.6 / hz, 0.8), load_deg=float(rng.choice([-20, 20])))
    else:
        hz = min(hz, 3.0)
        angle = swings.stable(network, hz, float(rng.uniform(60, 140)), 0.3 + max(1.6 / hz, 0.8))
        angle *= rng.choice([-1, 1])
    start_s = float(rng.uniform(0.36, len(angle) / FS - 0.12)) if fault else None
    given: dict[str, Any] = {}
    if start_s is not None:
        given = {"kind": str(rng.choice(TYPES)), "at": float(rng.uniform(0.02, 0.8)), "start_s": start_s}
    x = swings.samples(network, angle, **given)
    return judge(trips(relay(network, method, rpsb=BOXES), x), start_s)


def breaker(rng: np.random.Generator, method: str) -> tuple[str, float]:
    """The time is the detector's, from the last zero to its reset."""
    limit, tripped_s = 200.0, 0.1
    t = np.arange(round(0.5 * FS)) / FS
    kind = rng.choice(["A", "BC", "ABC"])
    stuck = -1 if rng.random() < 2 / 3 else int(rng.choice(["ABC".index(p) for p in kind]))
    x, zeros = np.zeros((len(t), 6)), []
    x[:, :3] = 1e5 * np.cos(2 * np.pi * (50 * t[:, None] - np.arange(3) / 3))
    for phase in ("ABC".index(p) for p in kind):
        rms, angle = limit * float(np.exp(rng.uniform(np.log(1.5), np.log(100)))), rng.uniform(0, 2 * np.pi)
        since, tau = t - tripped_s + 0.02, float(rng.uniform(0.03, 0.1))
        wave = np.cos(2 * np.pi * 50 * since + angle) - rng.random() * np.cos(angle) * np.exp(-since / tau)
        wave *= math.sqrt(2) * rms * (since >= 0)
        if phase != stuck:
            opens = tripped_s + float(rng.uniform(0.03, 0.06))
            zero = int(np.flatnonzero((np.diff(np.sign(wave)) != 0) & (t[1:] > opens))[0]) + 1
            left = float(rng.choice([-1, 1]) * rng.uniform(0, 0.5)) * np.abs(wave).max()
            core = np.exp(-np.arange(len(t) - zero) / FS / float(rng.uniform(0.03, 0.1)))
            wave[:zero] += left * np.exp((np.arange(zero) - zero) / FS / 0.005) * (since[:zero] >= 0)
            wave[zero:] = left * core
            zeros.append(zero)
        x[:, 3 + phase] = wave
    stage = {"pickup_a": 1.2 * limit, "confirm_ms": 5.0}
    r = relay(Network(), method, pioc=[stage], rbrf={"current_a": limit, "backup_ms": 120.0})
    started, ordered, done = [], False, 0
    bit, opex = r.bits.index("RBRF1"), r.bits.index("RBRF1.OpEx")
    while done < len(x):
        m = r.advance(x[done:])
        started += ((r.pickup >> np.uint64(bit)) & np.uint64(1)).tolist()
        ordered |= bool(((r.pickup >> np.uint64(opex)) & np.uint64(1)).any())
        done += m
    if stuck >= 0:
        return ("right" if ordered else "no back-trip"), np.nan
    if not any(started):
        return "not started", np.nan
    reset_ms = 1e3 * (int(np.flatnonzero(started)[-1]) + 1 - max(zeros)) / FS
    return ("false back-trip" if ordered else "right" if reset_ms <= RESET_MS else "late reset"), reset_ms


ELEMENT = """
from numba import njit

@njit
def step(state, x, out):  # a voltage that is low for 20 ms
    low = x[0] * x[0] + x[1] * x[1] < 8e4**2
    state[0] = state[0] + 1.0 if low else 0.0
    out[0] = 1.0 if low else 0.0
    out[1] = 1.0 if state[0] > 96.0 else 0.0
"""


def cost(method: str) -> None:
    """The chain without and with every other function, and with a user's beside them."""
    with tempfile.TemporaryDirectory() as folder:
        own = Path(folder) / "own.py"
        own.write_text(ELEMENT, encoding="utf-8")
        _cost(method, {"name": "OWN1", "function": f"{own}:step", "state": [0.0]})


def _cost(method: str, element: dict[str, Any]) -> None:
    network = Network()
    load = network.samples([(0.0, network.solve())], 10.0)
    load += np.random.default_rng(1).normal(0, 1, load.shape) * ([50.0] * 3 + [1.0] * 3)
    figures = {}
    rows = (
        (f"{method}, none", method, {}),
        (f"{method}, all", method, ALL),
        ("and a user's", method, ALL | {"element": [element]}),
        ("fourier, none", "fourier", {}),
    )
    for name, estimator, tables in rows:
        play(relay(network, estimator, **tables), load[:FS], 1000)
        spans = []
        for _ in range(7):
            r = relay(network, estimator, **tables)
            started = time.process_time()
            play(r, load, 1000)
            spans.append((time.process_time() - started) / len(load) * 1e6)
        figures[name] = float(np.median(spans))
        print(f"{name:20s} {figures[name]:6.2f} us a sample (best {min(spans):.2f})")
    for name in (f"{method}, all", "and a user's"):
        print(f"{name}, over fourier's: {figures[name] / figures['fourier, none']:.2f}")


KINDS = {
    "change": change,
    "fuse": fuse,
    "swing": swing,
    "swing-fault": partial(swing, fault=True),
    "swing-outside": outside,
    "swing-after": after,
    "breaker": breaker,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=[*KINDS, "cost"])
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="kalman-bank")
    given = parser.parse_args()
    if given.what == "cost":
        cost(given.method)
        return
    verdicts: Counter[str] = Counter()
    times = []
    for case in range(given.cases):
        rng = np.random.default_rng([given.seed, case])
        verdict, ms = KINDS[given.what](rng, given.method)
        verdicts[verdict] += 1
        if not np.isnan(ms):
            times.append(ms)
        if verdict != "right" or (given.what in ("change", "swing-fault") and ms > LIMIT_MS):
            print(f"    case {case}: {verdict}, {ms:.1f} ms")
    print(f"{given.what}, {given.cases} cases, seed {given.seed}, {given.method}: {dict(verdicts)}")
    if times:
        late = np.array(times)
        shown = ", ".join(f"{p} % {np.percentile(late, p, method='lower'):.1f}" for p in (50, 90, 95, 99))
        limit = RESET_MS if given.what == "breaker" else LIMIT_MS
        within = f"{np.mean(late <= limit):.1%} within {limit:g} ms"
        print(f"{len(late)} times: {within}; {shown}, worst {late.max():.1f}")


if __name__ == "__main__":
    main()
