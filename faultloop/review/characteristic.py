"""A zone's characteristic in the R-X plane as it is at an instant, with what polarizes it then.

A mho's comparator, |arg((Zr I - V) / Vp)| < 90 degrees, is in the plane of Z = V / I the circle over the
diameter from Zr to -Zs with Zs = (Vp - V) / I: polarized by the loop's own voltage it passes the origin, by
the memory or the other phases' voltage it grows by the source behind (Wedepohl 1965).  A quadrilateral's
borders are the lines m = 1 and |R| = the resistive reach; m and R are linear in Z, with the directions of
the currents that polarize them then, so the borders tilt with the load.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.io.mcap_reader import Log
from faultloop.relay.characteristics import (
    CROSS,
    CROSS_GROUND,
    CROSS_PHASE,
    NEGATIVE,
    OFFSET,
    OWN,
    POSITIVE,
    QUAD,
    SELF,
    SELF_OFFSET,
)
from faultloop.relay.loop_fit import FIRST, SECOND
from faultloop.review.retrace import Retraced, retrace

REMEMBERED = 10
"""Numbers of a row: V1 that polarizes, three currents from before (re, im each), frequency [Hz], fault type,
to which 8 is added while the memory holds."""
Complexes = NDArray[np.complex128]
_TURN = np.exp(2j * np.pi / 3 * np.arange(3))
_CIRCLE = np.exp(2j * np.pi * np.linspace(0, 1, 181))  # a memory-polarized one may be large
BEHIND, SLOPE = 0.15, 0.27
"""How far a quadrilateral reaches behind: m, and m for the resistance over the reach (`quad_depth`)."""


def characteristic(g: Any, c: Any, q: Any, x: Complexes, loop: int) -> Complexes:
    """Closed polygon of a zone [ohm, primary]; empty where it has none.

    Parameters
    ----------
    g, c : shared constants and the zone's (`faultloop.relay.layout.CONSTANTS`).
    q : ``faultloop.relay.explain.SHARED`` of the instant, in a disturbance.
    x : (6,) phasors then.
    loop : 0 to 5, AG .. CA.
    """
    v, i = _loop(x, loop), _current(x, loop, complex(c["k0"]))
    if abs(i) == 0 or not np.isfinite(abs(v) + abs(i)):
        return np.empty(0, np.complex128)
    reach = complex(c["reach"])
    reach = complex(reach.real, reach.imag * float(q["frequency"]) / float(g["frequency"]))
    if c["characteristic"] >= QUAD:
        return _quad(g, c, q, x, loop, reach, i)
    if c["characteristic"] == OFFSET:
        return reach * _CIRCLE
    behind = -(_polarizing(c, q, x, loop, v, reach * i) - v) / i
    return _circle(reach, behind)


def _circle(reach: complex, behind: complex) -> Complexes:
    """Over the diameter from ``reach`` to ``behind``; without the part where the drop along the reach is
    against the polarizing voltage, beyond the line through ``behind`` across the reach: no depth there.
    """
    points = (reach + behind) / 2 + (reach - behind) / 2 * _CIRCLE
    across = 1j * reach / abs(reach)
    chord = (across.conjugate() * (reach - behind)).real
    along = (across.conjugate() * (points - behind)).real.clip(min(chord, 0), max(chord, 0))
    against = (reach.conjugate() * (points - behind)).real < 0
    return np.where(against, behind + across * along, points)


def _loop(x: Complexes, loop: int) -> complex:
    return complex(x[loop] if loop < 3 else x[FIRST[loop]] - x[SECOND[loop]])


def _current(x: Complexes, loop: int, k0: complex) -> complex:
    residual = k0 * complex(x[3:].sum()) if loop < 3 else 0
    return _loop(x[3:], loop) + residual


def _polarizing(c: Any, q: Any, x: Complexes, loop: int, v: complex, drop: complex) -> complex:
    if c["characteristic"] == SELF:
        return v + SELF_OFFSET * drop
    if c["characteristic"] == CROSS:
        others = (
            CROSS_GROUND * (x[(loop + 1) % 3] - x[(loop + 2) % 3])
            if loop < 3
            else CROSS_PHASE * x[(loop + 2) % 3]
        )
        return complex(others) + SELF_OFFSET * drop
    return complex(POSITIVE[loop]) * complex(q["polarizing"])


def _quad(g: Any, c: Any, q: Any, x: Complexes, loop: int, reach: complex, i: complex) -> Complexes:
    if c["characteristic"] == OWN:
        polarizing, fault = i, i / (1 + complex(c["k0"])) if loop < 3 else i
    else:
        polarizing, fault = _fault_currents(g, q, x, loop, i)
    tilted = polarizing * complex(c["tilt"]).conjugate()
    along, beside = i * tilted.conjugate(), reach.conjugate()
    if abs(tilted) == 0 or abs(fault) == 0:
        return np.empty(0, np.complex128)
    # Im(Z along) = m Im(Zr along), Im(Z Zr*) = r Im(If (Zr I)*) / |I|^2
    rows = np.array([[along.imag, along.real], [beside.imag, beside.real]])
    scale = np.array([(reach * along).imag, (fault * (reach * i).conjugate()).imag / abs(i) ** 2])
    if abs(np.linalg.det(rows)) < 1e-9 * np.abs(rows).max() ** 2:
        return np.empty(0, np.complex128)
    limit = float(c["resistive_ground"] if loop < 3 else c["resistive_phase"])
    low = -BEHIND - SLOPE * limit / abs(reach)
    corners = [(1, -limit), (1, limit), (low, limit), (-BEHIND, 0), (low, -limit), (1, -limit)]
    if c["direction"] == 0:
        corners = [(1, -limit), (1, limit), (-1, limit), (-1, -limit), (1, -limit)]
    points = np.linalg.solve(rows, (np.array(corners) * scale).T)
    return points[0] + 1j * points[1]


def _fault_currents(g: Any, q: Any, x: Complexes, loop: int, i: complex) -> tuple[complex, complex]:
    """As `faultloop.relay.functions.pdis.fault_currents`."""
    currents = x[3:]
    i0, i1, i2 = (complex(z) / 3 for z in (currents.sum(), currents @ _TURN, currents @ _TURN.conj()))
    negative = complex(NEGATIVE[loop]) * i2
    if loop < 3:
        if abs(i2) < float(g["minimum_unbalance"]) * abs(i1):
            return 3 * i0, 1.5 * i0
        return negative, 1.5 * (negative + i0)
    if q["age"] <= g["memory"]:
        change = _loop(currents - q["reference"][3:], loop)
        return change, change
    return (negative, 2 * negative) if q["fault"] != 7 else (i, i)


def remembered(known: Retraced, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, 10) at these times, in order; NaN where there is no disturbance.  Of what is not kept at every
    sample the one before stands."""
    out = np.full((len(t_ns), REMEMBERED), np.nan)
    if not len(known.t_ns) or not len(t_ns):
        return out
    place = (np.searchsorted(known.t_ns, t_ns, side="right") - 1).clip(min=0)
    q = known.shared[place]
    lasts_ns = (known.step - 1) * 1e9 / known.settings.relay.sampling_hz
    old_ns = t_ns - known.t_ns[place]
    stands = (old_ns >= 0) & (old_ns <= lasts_ns + 0.5)
    rows = np.flatnonzero(stands & (q["disturbed"] > 0) & (q["fuse_failure"] == 0))
    q = q[rows]
    holds = q["age"] <= int(known.constants["shared"]["memory"])
    polarizing: Complexes = q["polarizing"]
    out[rows, 0], out[rows, 1] = np.real(polarizing), np.imag(polarizing)
    out[rows, 2:8] = np.ascontiguousarray(q["reference"][:, 3:]).view(np.float64)
    out[rows, 8], out[rows, 9] = q["frequency"], q["fault"] + 8 * holds
    return out


def zones(known: Retraced) -> dict[str, dict[str, Any]]:
    """Of each distance zone what its characteristic is drawn from, primary."""
    found = {}
    for one in known.instances:
        if one.function.name != "PDIS":
            continue
        c = known.constants["pdis"][one.number]
        pair = {key: [float(c[key].real), float(c[key].imag)] for key in ("reach", "k0", "tilt")}
        found[one.name] = pair | {
            "shape": int(c["characteristic"]),
            "direction": int(c["direction"]),
            "loops": int(c["loops"]),
            "ground": float(c["resistive_ground"]),
            "phase": float(c["resistive_phase"]),
        }
    return found


def characteristics_at(
    log: Log, relay: str, t_ns: int, loop: int, x: Complexes
) -> dict[str, NDArray[np.float64]]:
    """Polygons (k, 2) of the zones at an instant with a disturbance, for phasors x (6,); none where the log
    does not tell."""
    try:
        known = retrace(log, relay)
    except InputError:
        return {}
    row = int(np.searchsorted(known.t_ns, t_ns))
    if row >= len(known.t_ns) or known.t_ns[row] != t_ns or not known.shared["disturbed"][row]:
        return {}
    g, found = known.constants["shared"], {}
    for one in known.instances:
        if one.function.name == "PDIS":
            c = known.constants["pdis"][one.number]
            if int(c["loops"]) >> loop & 1:
                points = characteristic(g, c, known.shared[row], x, loop)
                found[one.name] = np.column_stack([points.real, points.imag])
    return {name: points for name, points in found.items() if len(points)}
