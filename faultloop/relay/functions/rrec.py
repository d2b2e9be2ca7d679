"""RREC: automatic reclosing.

A trip by one of the functions that start it (those without delay) opens poles; when they are open a dead
time runs, in which the arc's channel loses its charge; then the breaker is told to close, over the bus as it
was told to open.  A fault that is still there trips again: another shot, as long as there is one, or lockout.
A fault that grows while one pole is open becomes a three-pole shot.  Three poles are closed only when RSYN,
where it is there, releases.

    READY -> TRIPPED -> DEAD -> WAIT -> CLOSING -> RECLAIM -> READY
                                                 else LOCKOUT, until closed for long enough

While a shot is under way or the breaker is not ready every trip is three-pole (``q.three_pole``), and a zone
that reaches beyond the line because a reclosing would follow (``extension_zone``) rests.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from faultloop.config.tables import Milliseconds, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.events import Event, Names, poles_text
from faultloop.relay.functions.function import BitsOf, Function
from faultloop.relay.quantities import Record, indicate

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

SHOTS = 8
LEAST_RECLAIM_MS = 100.0
"""A fault that is still there has been tripped for again by then, in a zone without delay."""
READY, TRIPPED, DEAD, WAIT, CLOSING, RECLAIM, LOCKOUT = range(7)
OPENED, DELAYED, LAST, GREW, STAYS, NO_RELEASE, NO_VOLTAGE, STILL_OPEN, MOVED, FAILED = range(10)
CAUSES = (
    "the breaker is open",
    "trip by a function that is not reclosed after",
    "that was the last shot",
    "three poles are tripped, and there is no dead time for them",
    "the breaker has not opened",
    "no release by RSYN1",
    "RSYN1 has no voltage of the breaker's other side",
    "the breaker has not closed",
    "a pole has moved by itself in the dead time",
    "breaker failure",
)
"""Of a lockout, by these numbers."""


class Rrec(Table):
    """``[rrec]``: automatic reclosing."""

    dead_one_pole_ms: Milliseconds | None = None
    """After a one-pole trip, from open to the command to close; the first shot."""
    dead_three_pole_ms: tuple[Milliseconds, ...] = Field(default=(300.0,), strict=False, max_length=SHOTS)
    """After a three-pole trip, one for each shot; empty: lockout after every three-pole trip."""
    reclaim_ms: Milliseconds = 5000.0
    """So long after closing a trip counts as the same fault; and so long the breaker must be closed to be
    ready again.  At least 100 ms and the longest delay of the zones that start it."""
    starts: tuple[str, ...] | None = Field(default=None, strict=False)
    """Functions after whose trip is reclosed, such as ["PDIS1"]; the zones without delay and the pilot
    scheme where not given."""
    open_wait_ms: Milliseconds = 300.0
    """From the trip: the breaker must say that it is open."""
    close_pulse_ms: Milliseconds = 200.0
    """The longest that the command to close lasts; the breaker must say that it is closed."""
    release_wait_ms: Milliseconds = 2000.0
    """The longest that a three-pole reclosing waits for RSYN."""
    extension_zone: Annotated[int, Field(ge=1)] | None = None
    """Zone extension: the zone of that number, without delay and beyond the line, is there only while the
    relay is ready to reclose."""


def starters(settings: RelaySettings, table: Rrec) -> tuple[str, ...]:
    """Names of the functions after whose trip is reclosed."""
    if table.starts is not None:
        return table.starts
    zones = (
        f"PDIS{place}"
        for place, zone in enumerate(settings.pdis, 1)
        if zone.delay_ms == 0 and not zone.delay_phase_ms and not zone.delay_ground_ms
    )
    return (*zones, *(("PSCH1",) if settings.psch is not None else ()))


def values(settings: RelaySettings, table: Rrec) -> dict[str, Any]:
    """Times in samples; the mask of zones that it extends, by place in the settings."""
    zones = [zone.zone for zone in settings.pdis]
    dead = [settings.samples(ms) for ms in table.dead_three_pole_ms]
    return {
        "starts": BitsOf(starters(settings, table), "rrec.starts"),
        "one_pole": -1 if table.dead_one_pole_ms is None else settings.samples(table.dead_one_pole_ms),
        "three_pole": dead + [0] * (SHOTS - len(dead)),
        "shots": len(dead),
        "reclaim": settings.samples(table.reclaim_ms),
        "open_wait": settings.samples(table.open_wait_ms),
        "pulse": settings.samples(table.close_pulse_ms),
        "release_wait": settings.samples(table.release_wait_ms),
        "asks": settings.rsyn is not None,
        "extended": sum(1 << k for k, zone in enumerate(zones) if zone == table.extension_zone),
    }


def longest_delay_ms(settings: RelaySettings, table: Rrec) -> float:
    """Of the zones that start it."""
    starting = starters(settings, table)
    delays = [
        max(zone.delay_ms, zone.delay_phase_ms or 0.0, zone.delay_ground_ms or 0.0)
        for place, zone in enumerate(settings.pdis, 1)
        if f"PDIS{place}" in starting
    ]
    return max(delays, default=0.0)


def check(settings: RelaySettings) -> None:
    """One-pole dead times and one-pole trips go together; the zone that is extended is there."""
    table = settings.rrec
    one_pole = settings.ptrc.mode == "single-pole"
    if one_pole and table.dead_one_pole_ms is None:
        what = 'missing: ptrc.mode = "single-pole" opens one pole, which must be closed again; such as 800'
        raise InputError(what, key="rrec.dead_one_pole_ms")
    if not one_pole and table.dead_one_pole_ms is not None:
        what = 'no pole is tripped alone; leave it out, or say ptrc.mode = "single-pole"'
        raise InputError(what, key="rrec.dead_one_pole_ms")
    if not one_pole and not table.dead_three_pole_ms:
        raise InputError(
            "there is no shot; give at least one dead time, such as [300]", key="rrec.dead_three_pole_ms"
        )
    least = LEAST_RECLAIM_MS + longest_delay_ms(settings, table)
    if table.reclaim_ms < least:
        what = (
            f"is {table.reclaim_ms:g}: a fault that is still there would be a new one, and reclosed after "
            f"without end; at least {least:g}, some seconds as a rule"
        )
        raise InputError(what, key="rrec.reclaim_ms")
    if table.extension_zone is not None:
        zones = list(dict.fromkeys(zone.zone for zone in settings.pdis))
        if table.extension_zone not in zones:
            listed = ", ".join(map(str, zones)) or "none"
            what = f"there is no zone {table.extension_zone}; zones: {listed}"
            raise InputError(what, key="rrec.extension_zone")
        names = [f"PDIS{k}" for k, zone in enumerate(settings.pdis, 1) if zone.zone == table.extension_zone]
        unheard = [name for name in names if name not in starters(settings, table)]
        if unheard:
            what = f"no reclosing follows a trip of {unheard[0]}; name it in rrec.starts, or give it no delay"
            raise InputError(what, key="rrec.extension_zone")


@njit
def go(q: Record, w: Record, state: int) -> None:
    """Into another state."""
    w.state = state
    w.age = 0
    q.close_poles = w.poles if state == CLOSING else 0
    if state == READY:
        w.shot = 0
    q.notices += 1
    w.count += 1


@njit
def lock(q: Record, w: Record, cause: int) -> None:
    """No reclosing until the breaker has been closed for long enough."""
    w.cause = cause
    go(q, w, LOCKOUT)


@njit
def tripped(q: Record, c: Record, w: Record) -> None:
    """A trip, or more poles of it, at this sample."""
    if w.state == LOCKOUT:
        w.age = 0
        return
    if not (c.starts >> np.uint64(q.request.bit)) & np.uint64(1):
        lock(q, w, DELAYED)
        return
    if w.state == READY or w.state >= CLOSING:
        w.poles = 0
    before, w.poles = w.poles, w.poles | q.poles
    if w.poles == 7:
        if c.shots == 0:
            lock(q, w, GREW if before else LAST)
            return
        if w.shot >= c.shots:
            lock(q, w, LAST)
            return
    go(q, w, TRIPPED)


@njit
def wait_open(q: Record, c: Record, w: Record) -> None:
    """The breaker is to open."""
    if not q.closed & w.poles:
        go(q, w, DEAD)
    elif w.age > c.open_wait:
        lock(q, w, STAYS)


@njit
def wait_dead(q: Record, c: Record, w: Record) -> None:
    """The dead time, and then for the release."""
    if 7 & ~q.closed != w.poles:
        lock(q, w, MOVED)
        return
    if w.state == DEAD:
        dead = c.three_pole[min(w.shot, SHOTS - 1)] if w.poles == 7 else c.one_pole
        if w.age < dead:
            return
        w.state = WAIT  # which is nothing to tell
        w.age = 0
    if not q.poles and (w.poles != 7 or not c.asks or q.release > 0):
        w.shot += 1
        go(q, w, CLOSING)
    elif w.age > c.release_wait:
        lock(q, w, NO_VOLTAGE if q.release < 0 else NO_RELEASE)


@njit
def wait_closed(q: Record, c: Record, w: Record) -> None:
    """The breaker is to close."""
    if q.closed == 7:
        go(q, w, RECLAIM)
    elif w.age > c.pulse:
        lock(q, w, STILL_OPEN)


@njit
def wait_sound(q: Record, c: Record, w: Record) -> None:
    """The breaker is to be closed, with nothing tripped."""
    if q.closed != 7 or q.poles:
        w.age = 0
        if w.state == RECLAIM or w.state == READY:
            lock(q, w, OPENED)
    elif w.state != READY and w.age >= c.reclaim:
        go(q, w, READY)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample.  It comes after the trip logic."""
    w.age += 1
    grown = q.poles & ~w.last
    w.last = q.poles
    if grown and q.request.made:
        tripped(q, c, w)
    elif q.back_trip and w.state != LOCKOUT:
        lock(q, w, FAILED)
    elif w.state == TRIPPED:
        wait_open(q, c, w)
    elif w.state == DEAD or w.state == WAIT:
        wait_dead(q, c, w)
    elif w.state == CLOSING:
        wait_closed(q, c, w)
    else:
        wait_sound(q, c, w)
    q.three_pole = 1 if w.state != READY and w.state != TRIPPED else 0
    q.rests = 0 if w.state == READY else c.extended
    indicate(q, c.bit, w.state != READY and w.state != LOCKOUT)
    indicate(q, c.bit + 1, w.state == READY)
    indicate(q, c.bit + 2, w.state == LOCKOUT)
    q.operate |= np.uint64(w.state == CLOSING) << np.uint64(c.bit)


def tell(names: Names, was: np.void, now: np.void) -> Iterator[Event]:
    """Each step of the sequence."""
    if now["count"] == was["count"]:
        return
    state, shot, poles = int(now["state"]), int(now["shot"]), poles_text(int(now["poles"]))
    level = "warning" if state == LOCKOUT else "info"
    text = {
        READY: "Rdy",
        TRIPPED: f"Str shot {shot + 1}, poles {poles}",
        DEAD: f"poles {poles} are open: the dead time begins",
        CLOSING: f"Op close poles {poles}, shot {shot}",
        RECLAIM: f"poles {poles} are closed: the reclaim time begins",
        LOCKOUT: f"Lockout: {CAUSES[int(now['cause'])]}",
    }[state]
    yield Event(names.sample, level, f"RREC1 {text}")


RREC = Function(
    name="RREC",
    settings=Rrec,
    step=step,
    constants=(
        ("starts", "u8"),  # mask of bits
        ("one_pole", "i8"),  # -1: none
        ("three_pole", "i8", (SHOTS,)),
        ("shots", "i8"),
        ("reclaim", "i8"),
        ("open_wait", "i8"),
        ("pulse", "i8"),
        ("release_wait", "i8"),
        ("asks", "i8"),
        ("extended", "i8"),
    ),
    values=values,
    state=(
        ("state", "i8"),
        ("age", "i8"),  # samples in it
        ("shot", "i8"),  # reclosings so far
        ("poles", "i8"),  # of this shot
        ("last", "i8"),  # poles tripped at the sample before
        ("cause", "i8"),  # of the lockout
        ("count", "i8"),  # of what was told
    ),
    bits=("", "Rdy", "Lockout"),
    told=False,  # the sequence is
    tell=tell,
    check=check,
)
