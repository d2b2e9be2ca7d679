"""What the validation tables ask of the functions: from a case's input to the values to compare."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from faultloop.relay.functions import rpsb
from faultloop.relay.functions.pioc import PIOC
from faultloop.relay.functions.zload import ZLOAD
from tests.relay.functions.kernel import TURN, Kernel

Case = dict[str, Any]
VOLTS, AMPERES = 50e3, 1000.0


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
    inner, following = rpsb.setting_rule(total, outer, given["slip_hz"], given["crossing_ms"] / 1000)
    ratio = inner / outer
    return {
        "outer_deg": rpsb.angle_deg(total, outer),
        "inner_deg": rpsb.angle_deg(total, inner),
        "inner_ohm": inner,
        "ratio": ratio,
        "next_ms": 1000 * following,
        "load_deg": rpsb.load_angle_deg(given.get("load_deg", 25.0), ratio),
    }


def crossing(given: Case) -> Case:
    """Milliseconds from one distance to another, at several slips."""
    total = given["total_ohm"]
    first, second = (rpsb.angle_deg(total, ohm) for ohm in given["between_ohm"])
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


CHECKS: dict[str, Callable[[Case], Case]] = {
    "direction-borders": direction_borders,
    "setting-rule": setting_rule,
    "crossing": crossing,
    "load-borders": load_borders,
}
