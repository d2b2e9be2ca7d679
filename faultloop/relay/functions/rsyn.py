"""RSYN: synchrocheck, before three poles are closed.

The relay's own voltage is on one side of the breaker, ``[[relay]] synchro_vt`` gives it that of the other.
All of them pass the same filter: turned by e^(-j w0 t) and smoothed by three first-order stages.  What it
leaves at twice the frequency is a ripple, so the slip is taken over whole cycles, of the angle between the
two phases A.  A side is live or dead by all three phases.

Released is what holds for ``hold_ms``: both live, and differing by less than the limits in magnitude,
frequency, and angle (where it will be when the contacts make); or one side dead where that is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.events import Event, Names
from faultloop.relay.functions.function import Function
from faultloop.relay.quantities import Record, indicate, nominal_turn

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

SMOOTHING_CYCLES = 1.0
"""Time constant of each of the three stages: a tenth is left of a step after 5.3 cycles, 1 in 2000 of 2 f."""
SLIP_CYCLES = 5
STAGES = 3
IN_STEP = 8
CAUSES = {1: "the line is dead", 2: "the bus is dead", 4: "both sides are dead"}
ENERGISES = {"none": 0, "line": 1, "bus": 2, "either": 3, "both": 7}


class Rsyn(Table):
    """``[rsyn]``: synchrocheck, with ``synchro_vt`` of the relay's place."""

    difference_pu: Annotated[float, Field(gt=0, le=1)] = 0.15
    """Largest difference of the two magnitudes, per unit of nominal."""
    angle_deg: Annotated[float, Field(gt=0, le=90)] = 20.0
    """Largest angle between them, where it will be when the contacts make."""
    slip_hz: Annotated[float, Field(gt=0, le=2)] = 0.2
    """Largest difference of their frequencies."""
    close_ms: Milliseconds = 80.0
    """Time of the breaker to close, in which the angle goes on at the slip."""
    hold_ms: Milliseconds = 100.0
    """So long it must all hold."""
    live_pu: Annotated[float, Field(gt=0, le=1)] = 0.8
    """Above it a side is live, per unit of nominal ..."""
    dead_pu: Annotated[float, Field(gt=0, le=1)] = 0.3
    """... below it dead."""
    energise: Literal["none", "line", "bus", "either", "both"] = "none"
    """What may be closed without synchronism: a dead line from a live bus, a live line to a dead bus,
    either of these, or also two dead sides."""
    voltage_at: Literal["bus", "line"] = "bus"
    """Which side the relay's own voltage is of, as in its place in the scenario."""
    nominal_v: Positive | None = None
    """Phase to ground; of ``relay.nominal_kv`` where not given."""


def values(settings: RelaySettings, table: Rsyn) -> dict[str, Any]:
    """Limits in volts RMS of a phase, degrees, hertz; times in samples."""
    kv = settings.relay.nominal_kv
    nominal = 1000 * kv / math.sqrt(3) if kv is not None else 0.0
    nominal = settings.volts(table.nominal_v, nominal)
    return {
        "difference": table.difference_pu * nominal,
        "angle": table.angle_deg,
        "slip": table.slip_hz,
        "close_s": table.close_ms / 1000,
        "hold": settings.samples(table.hold_ms),
        "live": table.live_pu * nominal,
        "dead": table.dead_pu * nominal,
        "energises": ENERGISES[table.energise],
        "own_is_line": table.voltage_at == "line",
        "keeps": math.exp(-settings.relay.frequency_hz / (SMOOTHING_CYCLES * settings.relay.sampling_hz)),
    }


def check(settings: RelaySettings) -> None:
    """The nominal voltage is known; dead is below live."""
    table = settings.rsyn
    if table.nominal_v is None and settings.relay.nominal_kv is None:
        raise InputError("missing; give it, or relay.nominal_kv", key="rsyn.nominal_v")
    if table.dead_pu >= table.live_pu:
        raise InputError(f"must be below live_pu, {table.live_pu:g}", key="rsyn.dead_pu")


@njit
def smooth(c: Record, w: Record, side: int, values: NDArray, turn: complex) -> None:
    """The phasors of one side, RMS: the last stage."""
    for phase in range(3):
        value = values[phase] * turn
        for stage in range(STAGES):
            w.stage[side, phase, stage] += (1 - c.keeps) * (value - w.stage[side, phase, stage])
            value = w.stage[side, phase, stage]


@njit
def ends(w: Record, side: int) -> tuple[float, float]:
    """Least and greatest of a side's three magnitudes."""
    a, b, c = (
        abs(w.stage[side, 0, STAGES - 1]),
        abs(w.stage[side, 1, STAGES - 1]),
        abs(w.stage[side, 2, STAGES - 1]),
    )
    return min(a, b, c), max(a, b, c)


@njit
def slip(g: Record, w: Record, between: complex) -> float:
    """Of the own side against the other [Hz], over the last whole cycles; it is renewed once a cycle."""
    w.tick += 1
    if w.tick >= g.cycle:
        w.tick = 0
        w.place = (w.place + 1) % SLIP_CYCLES
        turned = between * w.before[w.place].conjugate()
        w.before[w.place] = between
        seconds = SLIP_CYCLES * g.cycle / g.sampling
        w.slip = math.atan2(turned.imag, turned.real) / (2 * math.pi * seconds)
    return w.slip


@njit
def energises(c: Record, line: tuple[float, float], bus: tuple[float, float]) -> int:
    """Which side is dead, or both, where that is allowed: one of `ENERGISES`; else 0."""
    if line[1] < c.dead and bus[1] < c.dead:
        return c.energises & 4
    if line[1] < c.dead and bus[0] > c.live:
        return c.energises & 1
    return c.energises & 2 if bus[1] < c.dead and line[0] > c.live else 0


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample."""
    if np.isnan(q.across[0]):  # there is none
        q.release = -1
        w.age = 0
        return
    turn = math.sqrt(2.0) * nominal_turn(g, q.memory.seen).conjugate()
    smooth(c, w, 0, q.sample, turn)
    smooth(c, w, 1, q.across, turn)
    own, other = w.stage[0, 0, STAGES - 1], w.stage[1, 0, STAGES - 1]
    between = own * other.conjugate()
    rate = slip(g, w, between)
    angle = math.degrees(math.atan2(between.imag, between.real)) + 360 * rate * c.close_s
    angle = (angle + 180) % 360 - 180
    one, two = ends(w, 0), ends(w, 1)
    live = one[0] > c.live and two[0] > c.live
    difference = abs(abs(own) - abs(other))
    differs, turned, slips = difference > c.difference, abs(angle) > c.angle, abs(rate) > c.slip
    dead = energises(c, one, two) if c.own_is_line else energises(c, two, one)
    why = dead if dead else IN_STEP if live and not (differs or turned or slips) else 0
    w.age = w.age + 1 if why != 0 and why == w.why else 0
    w.why = why
    released = w.age > c.hold
    if released != (q.release > 0):
        w.angle = angle
        w.count += 1
        q.notices += 1
    q.release = released
    indicate(q, c.bit, released)
    indicate(q, c.bit + 1, live and differs)
    indicate(q, c.bit + 2, live and turned)
    indicate(q, c.bit + 3, live and slips)


def tell(names: Names, was: np.void, now: np.void) -> Iterator[Event]:
    """The release and its cause, and its end."""
    if now["count"] != was["count"]:
        why = int(now["why"])
        if not why:
            yield Event(names.sample, "info", "RSYN1 Rel reset")
        else:
            text = f"in step, {now['angle']:.0f} degrees" if why == IN_STEP else CAUSES[why]
            yield Event(names.sample, "info", f"RSYN1 Rel: {text}")


RSYN = Function(
    name="RSYN",
    settings=Rsyn,
    step=step,
    constants=(
        ("difference", "f8"),
        ("angle", "f8"),
        ("slip", "f8"),
        ("close_s", "f8"),
        ("hold", "i8"),
        ("live", "f8"),
        ("dead", "f8"),
        ("energises", "i8"),
        ("own_is_line", "i8"),
        ("keeps", "f8"),
    ),
    values=values,
    state=(
        ("stage", "c16", (2, 3, STAGES)),  # side, phase
        ("before", "c16", (SLIP_CYCLES,)),  # product of the two phasors, a cycle apart
        ("place", "i8"),
        ("tick", "i8"),
        ("slip", "f8"),
        ("age", "i8"),
        ("why", "i8"),  # it may be closed
        ("angle", "f8"),  # at the release [degrees]
        ("count", "i8"),
    ),
    bits=("Rel", "VInd", "AngInd", "HzInd"),
    told=False,  # the release is
    tell=tell,
    check=check,
)
