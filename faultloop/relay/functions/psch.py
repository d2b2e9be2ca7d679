"""PSCH: pilot schemes; both ends of a line decide together.

Each end says by its pilot signal what its own zones see, pole by pole:

======  ==========================================  ====================================================
type    it sends                                    it trips, beside its zones
======  ==========================================  ====================================================
putt    while `send_zone`, underreaching, starts    received, and `pilot_zone` starts
pott    while `pilot_zone` starts, not in reverse   received of every end, and `pilot_zone` starts
dcb     while a fault is behind, not ahead          `pilot_zone` for `coordination_ms` with nothing received
dutt    while `send_zone` starts                    received of any end, whatever it sees itself
dtt     nothing by the pilot signal                 a transferred trip
======  ==========================================  ====================================================

Signal and zone must be together for `coincidence_ms`: beside a strong source a fault behind looks ahead for a
moment, and the other end does see it ahead.  A fault that was behind for `reverse_pickup_ms` blocks sending
and tripping for `reverse_hold_ms` after it has gone: when the parallel line's first breaker opens the
current turns, and the two ends do not see that at the same moment (in dcb it goes on blocking the far end).

An end that sees nothing, as its source is weak or its breaker open, sends what it receives back: the echo,
once for each signal, at once with the breaker open, else after `echo_delay_ms` without a start.  With
``weak_infeed = "echo-and-trip"`` it trips too, the poles whose voltage is low.  One that has been without a
voltage or a current for a while sees nothing of a fault behind it either: it sends none back, and in dcb it
blocks.

A trip may be transferred by a message of its own (`transfer`), which is taken when two frames agree.

A channel that is silent sends nothing, so permissive schemes fall back on their zones' delays, and dcb trips
beyond the line: ``LosOfGrd`` says so.  A signal that stays while nothing is seen here is told, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from faultloop.config.tables import Milliseconds, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.events import Event, Names
from faultloop.relay.functions.function import Function
from faultloop.relay.memory import is_unbalanced, positive_sequence, size2
from faultloop.relay.quantities import Record, indicate, publish, request_trip

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

TYPES = ("putt", "pott", "dcb", "dutt", "dtt")
PUTT, POTT, DCB, DUTT, DTT = range(len(TYPES))
OFF, ECHO, ECHO_AND_TRIP = range(3)
ANSWERED = -1
LINE_END_OPEN_MS = 50.0
"""So long a breaker is open before its relay's echo does not wait."""
UNEXPECTED_MS = 200.0
"""So long a signal may be received while nothing starts here."""
BLIND_MS = 100.0
"""So long an input is missing before an end is blind: what goes with the fault may be the fault's."""
FALLEN = 0.95
"""Of the voltage before: what is balanced and leaves more of it is no fault."""
Zone = Annotated[int, Field(ge=1)]


class Psch(Table):
    """``[psch]``: the scheme; both ends have the same `type`, and a ``[[channel]]`` between them."""

    type: Literal["putt", "pott", "dcb", "dutt", "dtt"]
    """Permissive under- or overreaching, blocking, direct underreaching, or transferred trips alone."""
    pilot_zone: Zone = 2
    """Overreaching, forward: what is compared with the signal."""
    send_zone: Zone = 1
    """Underreaching, forward: whose start is sent in putt and dutt."""
    pilot: Literal["zone", "direction"] = "zone"
    """"direction": any fault ahead, while it is there, in place of `pilot_zone`."""
    pole_bits: bool = True
    """The signal says which poles; without it, all whatever the fault, and trips are three-pole."""
    coincidence_ms: Milliseconds = 4.0
    """So long signal and zone are there together before a trip."""
    rx_pickup_ms: Milliseconds = 0.0
    """So long the signal is there before it counts."""
    coordination_ms: Milliseconds = 10.0
    """Of dcb: what the blocking signal may take; above the channel's delay and jitter."""
    reverse_pickup_ms: Milliseconds = 20.0
    """A fault that was behind for so long ..."""
    reverse_hold_ms: Milliseconds = 60.0
    """... blocks for so long after it has gone; 0: it does not."""
    send_hold_ms: Milliseconds = 100.0
    """A signal that a trip goes with lasts at least so long."""
    weak_infeed: Literal["off", "echo", "echo-and-trip"] = "off"
    """What an end does that sees nothing of a fault: sends the signal back, trips by low voltage too."""
    echo_delay_ms: Milliseconds = 10.0
    """From the signal to its echo."""
    echo_ms: Milliseconds = 100.0
    """So long an echo lasts at most."""
    echo_lockout_ms: Milliseconds = 250.0
    """No echo until nothing was received for so long."""
    weak_voltage_pu: Annotated[float, Field(gt=0, lt=1)] = 0.7
    """Of the nominal voltage (`relay.nominal_kv`): below it a phase of a weak end trips."""
    transfer: bool = False
    """Every trip is transferred to the far end, and such trips are taken; dtt does without saying so."""
    channel_alarm_ms: Milliseconds = 100.0
    """So long a channel is silent before ``LosOfGrd``."""

    @model_validator(mode="after")
    def _echo(self) -> Psch:
        if self.weak_infeed != "off" and self.type != "pott":
            raise ValueError(f'weak_infeed is of type = "pott"; "{self.type}" has no use for an echo')
        if self.reverse_hold_ms and self.reverse_pickup_ms > 1000:
            raise ValueError("reverse_pickup_ms must be at most 1000 where reverse_hold_ms is set")
        return self


def check(settings: RelaySettings) -> None:
    """The zones are there and look ahead; a voltage that is low is one of a known nominal voltage."""
    table = settings.psch
    if table is None or table.type == "dtt":
        return
    wanted = []
    if table.type != "dutt" and table.pilot == "zone":
        wanted.append(("pilot_zone", table.pilot_zone))
    if table.type in ("putt", "dutt"):
        wanted.append(("send_zone", table.send_zone))
    for key, number in wanted:
        found = [zone for zone in settings.pdis if zone.zone == number]
        if not found:
            listed = ", ".join(str(z) for z in dict.fromkeys(zone.zone for zone in settings.pdis)) or "none"
            raise InputError(f"there is no zone {number}; zones: {listed}", key=f"psch.{key}")
        if any(zone.direction != "forward" for zone in found):
            raise InputError(f"zone {number} is not forward, as a pilot zone must be", key=f"psch.{key}")
    if table.weak_infeed == "echo-and-trip" and settings.relay.nominal_kv is None:
        raise InputError("missing; weak_voltage_pu is a part of it", key="relay.nominal_kv")


def values(settings: RelaySettings, table: Psch) -> dict[str, Any]:
    """Masks of zones, times in samples, the weak voltage squared."""

    def places(wanted: Any) -> int:
        return sum(1 << place for place, zone in enumerate(settings.pdis) if wanted(zone))

    def samples(key: str) -> int:
        return settings.samples(getattr(table, key))

    nominal_v = (settings.relay.nominal_kv or 0.0) * 1e3 / math.sqrt(3)
    return {
        "type": TYPES.index(table.type),
        "pilot": places(lambda zone: zone.zone == table.pilot_zone),
        "send": places(lambda zone: zone.zone == table.send_zone),
        "reverse": places(lambda zone: zone.direction == "reverse"),
        "by_direction": table.pilot == "direction",
        "pole_bits": table.pole_bits,
        "coincidence": samples("coincidence_ms"),
        "rx_pickup": samples("rx_pickup_ms"),
        "coordination": samples("coordination_ms"),
        "reverse_pickup": samples("reverse_pickup_ms"),
        "reverse_hold": samples("reverse_hold_ms"),
        "send_hold": samples("send_hold_ms"),
        "weak_infeed": ("off", "echo", "echo-and-trip").index(table.weak_infeed),
        "echo_delay": samples("echo_delay_ms"),
        "echo": samples("echo_ms"),
        "echo_lockout": samples("echo_lockout_ms"),
        "weak_voltage2": (table.weak_voltage_pu * nominal_v) ** 2,
        "transfer": table.transfer or table.type == "dtt",
        "channel_alarm": samples("channel_alarm_ms"),
        "line_end_open": settings.samples(LINE_END_OPEN_MS),
        "unexpected": settings.samples(UNEXPECTED_MS),
        "blind": settings.samples(BLIND_MS),
    }


@njit
def poles_of(fault: int) -> int:
    """Mask of the phases of a fault's type (0 for none: all)."""
    if 1 <= fault <= 3:
        return 1 << (fault - 1)
    if fault == 4:
        return 3
    if fault == 5:
        return 6
    return 5 if fault == 6 else 7


@njit
def type_of(poles: int) -> int:
    """The type of a fault of these phases."""
    if poles == 1 or poles == 2:
        return poles
    if poles == 4:
        return 3
    if poles == 3:
        return 4
    if poles == 6:
        return 5
    return 6 if poles == 5 else 7


@njit
def guard(q: Record, c: Record, w: Record, behind: bool) -> bool:
    """Whether a fault is behind, or was, long enough and shortly ago."""
    w.behind = w.behind + 1 if behind else 0
    if w.behind > 0 and w.behind >= c.reverse_pickup:
        w.guard = c.reverse_hold
    elif not behind and w.guard > 0:
        w.guard -= 1
    return behind or w.guard > 0


@njit
def echo(c: Record, w: Record, rx: int, seen: bool) -> bool:
    """Whether what is received is sent back: once for each signal, and never one that a start answers."""
    waited = w.received > (0 if w.open > c.line_end_open else c.echo_delay)
    if rx == 0:
        w.echo = 0
        w.lockout = max(w.lockout - 1, 0)
    elif seen:
        w.echo = ANSWERED
    elif w.echo > 0:
        w.echo -= 1
        if w.echo == 0:
            w.echo = ANSWERED
    elif w.echo == 0 and w.lockout == 0 and c.weak_infeed != OFF and waited:
        w.echo = c.echo
        w.lockout = c.echo_lockout
    return w.echo > 0


@njit
def weak(q: Record, c: Record) -> int:
    """Mask of phases whose voltage is low."""
    poles = 0
    if not q.fuse_failure and q.settled:
        for phase in range(3):
            if size2(q.x[phase]) < c.weak_voltage2:
                poles |= 1 << phase
    return poles


@njit
def is_blind(q: Record, c: Record, w: Record) -> bool:
    """Whether a voltage or a current has been missing for a while; with the breaker open none is needed."""
    missing = q.fuse_failure or q.missing or q.vanished or q.proven != 7
    w.blind = w.blind + 1 if missing and w.open <= c.line_end_open else 0
    return w.blind > c.blind


@njit
def watch_channel(q: Record, c: Record, w: Record, rx: int, seen: bool) -> None:
    """Counts for how long the channel is silent, and a signal there while nothing starts here; tells both."""
    w.silent = 0 if q.linked else w.silent + 1
    w.lonely = w.lonely + 1 if rx and not seen and not q.disturbed else 0
    if w.silent == c.channel_alarm + 1:
        w.losses += 1
        q.notices += 1
    if w.lonely == c.unexpected + 1:
        w.strangers += 1
        q.notices += 1


@njit
def is_there(g: Record, q: Record) -> bool:
    """Whether there is a fault still: a zone could measure what it has changed of a phase's current, and it
    is unbalanced or has taken of the voltage.  One that is gone leaves a change behind, a load that another
    line had, and with it the direction until that has stood still."""
    least, before = g.minimum_current**2, q.memory.reference
    if size2(q.d[3]) < least and size2(q.d[4]) < least and size2(q.d[5]) < least:
        return False
    if is_unbalanced(g, q.x, before):
        return True
    return size2(q.sequence[1]) < FALLEN**2 * size2(positive_sequence(before))


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample; after the zones, and before the trip logic."""
    known = q.disturbed != 0 and q.fed != 0
    behind = (q.zones & c.reverse) != 0 or (known and q.direction < 0)
    ahead = known and is_there(g, q) and q.direction > 0 if c.by_direction else (q.zones & c.pilot) != 0
    under = (q.zones & c.send) != 0
    blocked = guard(q, c, w, behind)
    own = poles_of(q.fault) if c.pole_bits else 7
    rx = q.received_all if c.type == POTT else q.received
    w.received = w.received + 1 if rx else 0
    w.open = w.open + 1 if q.closed == 0 else 0
    seen = ahead or behind or under
    watch_channel(q, c, w, rx, seen)
    blind = is_blind(q, c, w)

    # what it trips
    poles = 0
    if c.type == DCB:
        w.together = w.together + 1 if ahead and not blocked and not rx else 0
        if w.together > c.coordination:
            poles = own
    elif c.type == DUTT:
        w.together = w.together + 1 if rx else 0
        if w.together > c.rx_pickup:
            poles = rx
    elif c.type != DTT:
        common = own & rx if ahead and not blocked and w.received > c.rx_pickup else 0
        w.together = w.together + 1 if common else 0
        if w.together > c.coincidence:
            poles = common
    op = poles != 0
    weak_poles = 0
    back = echo(c, w, rx, seen or blocked or blind)
    if back and c.weak_infeed == ECHO_AND_TRIP:
        low = weak(q, c)
        w.low = w.low + 1 if low else 0
        if w.low > c.echo_delay and q.closed:
            weak_poles = rx & low if rx & low else 0
    else:
        w.low = 0
    if c.transfer and q.transferred:
        poles |= q.transferred
        op = True
    trip = poles | weak_poles
    if trip:
        request_trip(q, c.bit, type_of(trip), 0 if c.pole_bits else 1)

    # what it sends
    if op or (under and q.poles):
        w.hold = c.send_hold
        w.held = own
    elif w.hold > 0:
        w.hold -= 1
    sent = 0
    if c.type == POTT:
        sent = own if ahead and not blocked else 0
    elif c.type == PUTT or c.type == DUTT:
        sent = own if under and not behind else 0
    elif c.type == DCB:
        sent = 7 if blind or (blocked and (w.guard > 0 or not ahead)) else 0
    if c.type != DCB and c.type != DTT:
        if w.hold > 0 and not blocked:
            sent |= w.held
        if back:
            sent |= rx
    q.pilot |= sent
    if c.transfer and not q.transferred:  # what came from there does not go back
        q.transfer |= q.poles

    publish(q, c.bit, False, op)
    indicate(q, c.bit + 1, sent != 0)
    indicate(q, c.bit + 2, rx != 0 or (c.transfer and q.transferred != 0))
    indicate(q, c.bit + 3, blocked and c.type != DTT)
    indicate(q, c.bit + 4, back)
    indicate(q, c.bit + 5, weak_poles != 0)
    indicate(q, c.bit + 6, w.silent > c.channel_alarm)


def tell(names: Names, was: Any, now: Any) -> Iterator[Event]:
    """A channel that is lost, a signal that nothing explains."""
    if now["losses"] != was["losses"]:
        kind = names.settings.psch.type
        means = "trips beyond the line" if kind == "dcb" else "falls back on its zones"
        yield Event(names.sample, "warning", f"PSCH1 LosOfGrd: the channel is silent; the scheme {means}")
    if now["strangers"] != was["strangers"]:
        text = f"PSCH1 ProRx for {UNEXPECTED_MS:g} ms while nothing starts here: unexpected"
        yield Event(names.sample, "warning", text)


PSCH = Function(
    name="PSCH",
    settings=Psch,
    step=step,
    constants=(
        *((name, "i8") for name in ("type", "pilot", "send", "reverse", "by_direction", "pole_bits")),
        *((name, "i8") for name in ("coincidence", "rx_pickup", "coordination")),
        *((name, "i8") for name in ("reverse_pickup", "reverse_hold", "send_hold")),
        *((name, "i8") for name in ("weak_infeed", "echo_delay", "echo", "echo_lockout")),
        ("weak_voltage2", "f8"),
        *((name, "i8") for name in ("transfer", "channel_alarm", "line_end_open", "unexpected", "blind")),
    ),
    values=values,
    state=(
        ("behind", "i8"),  # samples for which a fault has been behind
        ("guard", "i8"),  # samples for which that still blocks
        ("received", "i8"),  # samples of the signal
        ("open", "i8"),  # samples for which the breaker has been open
        ("blind", "i8"),  # samples for which an input has been missing
        ("together", "i8"),  # samples of coincidence, or of none
        ("echo", "i8"),  # samples that it still lasts; ANSWERED: this signal has had its answer
        ("lockout", "i8"),  # samples without a signal until there is another echo
        ("low", "i8"),  # samples of a weak end's low voltage
        ("hold", "i8"),
        ("held", "i8"),
        ("silent", "i8"),
        ("lonely", "i8"),
        ("losses", "i8"),
        ("strangers", "i8"),
    ),
    bits=("", "ProTx", "ProRx", "RvABlk", "Echo", "WeiOp", "LosOfGrd"),
    tell=tell,
    check=check,
)
