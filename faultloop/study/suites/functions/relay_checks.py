"""What the tables in ``cases/`` ask of the functions' kernels: from a case's input to what is compared."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from faultloop.relay import swing_rule
from faultloop.relay.functions import ptoc
from faultloop.relay.functions.pioc import PIOC
from faultloop.relay.functions.ptoc import PTOC
from faultloop.relay.functions.rbrf import RBRF
from faultloop.relay.functions.rsyn import RSYN
from faultloop.relay.functions.zload import ZLOAD
from faultloop.study.suites.functions.kernel import TURN, Kernel

Case = dict[str, Any]
VOLTS, AMPERES = 50e3, 1000.0
SAMPLING = 4800
MULTIPLES, PARTS = (2.0, 5.0, 10.0), (0.0, 0.5, 0.9)
"""Of the pickup: operating, and on the disc's way back."""
LONGEST_S = 2.0


def direction_borders(given: Case) -> Case:
    """From where to where phase A's current starts a forward stage, in degrees ahead of its own voltage."""
    k = Kernel(PIOC, {"pickup_a": 100.0, "direction": "forward"} | given["stage"])
    voltage = np.array(TURN) if given["stage"].get("quantity", "phase") == "phase" else -np.eye(3)[0]
    inside = []
    for degree in np.arange(-180.0, 180.0, 0.5):
        current = np.array([AMPERES * cmath.exp(1j * math.radians(degree)), 0, 0])
        k.step(np.concatenate([VOLTS * voltage, current]))
        if k.q["pickup"]:
            inside.append(degree)
    return {"from_deg": min(inside), "to_deg": max(inside)}


def setting_rule(given: Case) -> Case:
    """Of power-swing blocking."""
    total, outer = given["total_ohm"], given["outer_ohm"]
    inner, following = swing_rule.setting_rule(total, outer, given["slip_hz"], given["crossing_ms"] / 1000)
    ratio = inner / outer
    return {
        "outer_deg": swing_rule.angle_deg(total, outer),
        "inner_deg": swing_rule.angle_deg(total, inner),
        "inner_ohm": inner,
        "ratio": ratio,
        "next_ms": 1000 * following,
        "load_deg": swing_rule.load_angle_deg(given.get("load_deg", 25.0), ratio),
    }


def crossing(given: Case) -> Case:
    """Milliseconds from one distance to another, at several slips."""
    total = given["total_ohm"]
    first, second = (swing_rule.angle_deg(total, ohm) for ohm in given["between_ohm"])
    return {
        "first_deg": first,
        "second_deg": second,
        "ms": [1000 * (second - first) / (360 * slip) for slip in given["slip_hz"]],
    }


def load_borders(given: Case) -> Case:
    """Ohms at which a load of an angle begins to be one, outwards; 0 where it never is."""
    k = Kernel(ZLOAD, given["table"])
    found = []
    for degree in given["angles_deg"]:
        ohms = np.arange(1.0, 120.0, 0.25)
        blocked = []
        for ohm in ohms:
            z = ohm * cmath.exp(1j * math.radians(degree))
            k.step(np.concatenate([VOLTS * TURN, VOLTS / z * TURN]))
            blocked.append(bool(k.q["pickup"]))
        found.append(float(ohms[blocked][0]) if any(blocked) else 0.0)
    return {"ohm": found}


def curve(given: Case) -> Case:
    """Seconds of the kernel fed with M, with a time multiplier that makes a quarter of a second of it, over
    that (of its equation where the least multiplier still makes more than `LONGEST_S`); of the way back by
    the equation."""
    times = []
    for multiple in MULTIPLES:
        whole = equation(given["curve"])[0](multiple)
        share = max(float(f"{0.25 / whole:.3g}"), 0.01)
        k = Kernel(PTOC, {"pickup_a": AMPERES, "curve": given["curve"], "time_multiplier": share})
        times.append(whole if whole * share > LONGEST_S else time_to_operate(k, multiple) / share)
    return {"times_s": times, "resets_s": [equation(given["curve"])[1](multiple) for multiple in PARTS]}


def equation(name: str) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Of a curve, as the kernel has it, without a multiplier: times [s] to operate and of the way back."""
    c = Kernel(PTOC, {"pickup_a": AMPERES, "curve": name}).c
    return partial(ptoc.operating_time, c), partial(ptoc.reset_time, c)


def disc(given: Case) -> Case:
    """When a disc operates under currents that change, from the start."""
    table = {"pickup_a": AMPERES, "reset": "disc"} | {key: given[key] for key in ("curve", "time_multiplier")}
    k = Kernel(PTOC, table)
    spent = 0.0
    for multiple, seconds in given["steps"]:
        k.step(currents(multiple), count=round(seconds * SAMPLING))
        spent += seconds
    return {"operates_s": spent + time_to_operate(k, given["last"])}


def currents(multiple: float) -> np.ndarray:
    """Six phasors: a multiple of the pickup in all phases."""
    return np.concatenate([np.zeros(3), multiple * AMPERES * TURN])


def time_to_operate(k: Kernel, multiple: float, limit_s: float = 2 * LONGEST_S) -> float:
    """Seconds from now; infinite where it does not."""
    for n in range(int(limit_s * SAMPLING)):
        k.step(currents(multiple) if n == 0 else None)
        if k.w["operated"].any():
            return n / SAMPLING
    return math.inf


def reset_of_the_detector(given: Case) -> Case:
    """RBRF: worst time from the last zero of a current with offset and subsidence to the detector's reset,
    and whether it was on while the current flowed."""
    worst, held = 0.0, True
    for degree in range(0, 360, 90):
        wave, zero = opened(given, math.radians(degree))
        on = detector(wave)
        held &= all(on[192 : zero - 24])
        worst = max(worst, (np.flatnonzero(on)[-1] + 1 - zero) / SAMPLING)
    return {"reset_ms": 1000 * worst, "held": "yes" if held else "no"}


def detector(wave: np.ndarray) -> list[int]:
    """Whether RBRF sees the current of phase A flow, at every sample, tripped from the first one."""
    k = Kernel(RBRF, {"current_a": 200.0, "backup_ms": 1000.0})
    recent, on = k.q["recent"], []
    for i in wave:
        recent["head"] = (recent["head"] + 1) % len(recent["value"])
        recent["value"][recent["head"]] = 0.0
        recent["value"][recent["head"], 3] = i
        k.step(poles=1)
        on.append(int(k.q["pickup"]) & 1)
    return on


def opened(given: Case, angle: float) -> tuple[np.ndarray, int]:
    """A fault's current that is cut at its last zero; what the core has taken by then it gives back."""
    t = np.arange(round(0.14 * SAMPLING)) / SAMPLING
    wave = np.cos(2 * np.pi * 50 * t + angle) - given["offset"] * np.cos(angle) * np.exp(-t / 0.05)
    wave *= math.sqrt(2) * given["rms_a"]
    zero = int(np.flatnonzero(np.diff(np.sign(wave)))[-1]) + 1
    size = given["left"] * np.abs(wave).max()
    tail = np.arange(round(0.2 * SAMPLING)) / SAMPLING
    taken = size * np.exp((np.arange(zero) - zero) / SAMPLING / 0.005)
    return np.r_[wave[:zero] + taken, size * np.exp(-tail / given["tau_s"])], zero


def synchrocheck(given: Case) -> Case:
    """What RSYN says at the end of 0.6 s of two voltages, each [per unit, Hz, degrees], bus and line."""
    k = Kernel(RSYN, {"nominal_v": VOLTS, "close_ms": 0.0} | given.get("table", {}))
    t = np.arange(round(0.6 * SAMPLING)) / SAMPLING
    shift = -2 * np.pi / 3 * np.arange(3)
    bus, line = (
        math.sqrt(2) * pu * VOLTS * np.cos(2 * np.pi * hz * t[:, None] + math.radians(degrees) + shift)
        for pu, hz, degrees in (given["bus"], given["line"])
    )
    for n in range(len(t)):
        k.q["sample"][:3], k.q["across"] = bus[n], line[n]
        k.q["memory"]["seen"] = n
        k.step()
    bits = [name for bit, name in enumerate(RSYN.bits) if int(k.q["pickup"]) >> bit & 1]
    return {"says": " ".join(bits) or "nothing", "slip_hz": float(k.w["slip"])}


CHECKS: dict[str, Callable[[Case], Case]] = {
    "direction-borders": direction_borders,
    "setting-rule": setting_rule,
    "crossing": crossing,
    "load-borders": load_borders,
    "curve": curve,
    "disc": disc,
    "detector": reset_of_the_detector,
    "synchrocheck": synchrocheck,
}
