"""Why a relay tripped, and why each function that did not operate did not.

Of a trip: the depth with which the zone saw the fault, by which voltage it was polarized, when it started
and how long its timer ran.  Of a zone that did not operate: the condition that stopped it, sample by sample
in the order in which the relay asks (ready? a current that changed? enough of it? the type, the direction,
a blocking, the depth, how long it stays, the confirmation in time, the timer), and of these the one that
held for longest in the second half of the fault's time.  A blocking counts as the cause only where the
fault would have been inside without it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.io.mcap_reader import Log
from faultloop.relay.characteristics import CROSS, MEMORY_POLARIZED, OFFSET, OWN, QUAD, SELF
from faultloop.relay.functions.lphd import CAUSES as NOT_READY
from faultloop.relay.functions.phs import LOOP_MASK
from faultloop.relay.layout import Instance
from faultloop.relay.quantities import FAULTS, LOOPS
from faultloop.relay.zone_depth import PHASORS_BEHIND
from faultloop.review import why_stages
from faultloop.review.facts import Summary, Told, TripFacts
from faultloop.review.retrace import Retraced, retrace
from faultloop.review.survey import survey
from faultloop.review.why_schemes import SCHEMES, judge_scheme, sequence
from faultloop.review.why_stages import Cause
from faultloop.review.why_zone import Zone, judge_zone

STARTING = ("PDIS", "PDIF", "PSOF", "PIOC", "PTOC", "PTUV", "PTOV", "PTUF", "PTOF", "PFRC")
"""The functions that a person expects to operate, and asks of."""
POLARIZED = {
    SELF: "its own voltage",
    CROSS: "the other phases' voltage",
    MEMORY_POLARIZED: "V1 from before the fault",
    OFFSET: "nothing (a circle about the origin)",
    QUAD: "the fault's current",
    OWN: "the loop's own current",
}


@dataclass(frozen=True)
class Reason(Told):
    """Why a function operated, or did not."""

    relay: str
    """Whose function it is."""
    function: str
    """As in the log, `PDIS1`."""
    loop: str
    """The loop that is told of, `AG`, `BC`; empty where there is none."""
    t_ns: int
    """When it did what is told; of one that did not operate, the last sample judged [ns since the start]."""
    operated: bool
    """Whether it operated."""
    m: float | None
    """Depth of the fault as a part of the zone's reach (of a stage: its quantity over the pickup); None where
    there is none."""
    timer_ms: float | None
    """How long it had been started."""
    cause: Cause
    """What let it operate, or what kept it."""
    text: str
    """The whole in words."""


CAUSES = get_args(Cause)


def why(log: Log, summary: Summary, relay: str | None = None, function: str | None = None) -> list[Reason]:
    """Reasons of all functions of all relays, or of those asked for, trips first.

    Raises InputError for a name that is not there, and where the log has too little to tell.
    """
    names = list(summary.relays)
    if relay is not None and relay not in names:
        raise InputError(f"there is no relay '{relay}'; {nearest(relay, names)}", key="--relay")
    found: list[Reason] = []
    for name in names if relay is None else [relay]:
        found += _of_relay(log, summary, name, function)
    return found


def _of_relay(log: Log, summary: Summary, name: str, wanted: str | None) -> list[Reason]:
    known, trips = retrace(log, name), summary.relays[name].trips
    tripped = {trip.function: [one for one in trips if one.function == trip.function] for trip in trips}
    asked = (*STARTING, *SCHEMES)
    those = [one for one in known.instances if one.function.name in asked or one.name in tripped]
    if wanted is not None:
        names = [one.name for one in those]
        if wanted not in names:
            what = f"relay '{name}' has no function '{wanted}' to tell of; {nearest(wanted, names)}"
            raise InputError(what, key="--function")
        those = [one for one in those if one.name == wanted]
    found = [
        (reason, one.name not in tripped)
        for one in those
        for reason in _reasons(log, summary, known, one, name, tripped.get(one.name, []))
    ]
    if wanted is not None and not found:
        end_ns = summary.relays[name].last_ns or 0
        text = f"{wanted}: it did not start, and nothing asked it to"
        return [Reason(name, wanted, "", end_ns, False, None, None, "quiet", text)]
    found.sort(key=lambda pair: (pair[1], 0 if pair[1] else pair[0].t_ns))
    return [reason for reason, _ in found]


def _reasons(
    log: Log, summary: Summary, known: Retraced, one: Instance, name: str, trips: Sequence[TripFacts]
) -> Iterator[Reason]:
    """Of each trip; of a function without one, why it operated or did not."""
    spans = survey(log, name).spans
    zero = summary.inception.zero_ns
    operated = [span for span in spans.get(f"{one.name}.Op", []) if span[1] is None or span[1] > zero]
    started = [span for span in spans.get(f"{one.name}.Str", []) if span[1] is None or span[1] > zero]
    rows = window(summary, known, name)
    facts = why_stages.Facts(log, one, known, zero, rows, _span(summary, name), started)
    for k, trip in enumerate(trips):
        before = trip.decided_ns < zero  # as in a swing: its own start and operate are before it, too
        on = [spans.get(f"{one.name}.{bit}", []) for bit in ("Op", "Str")] if before else [operated, started]
        # by an element that has a bit of its own, as PDIF1.NgOp, where none of these is on
        at_ns = next((on for on, _ in reversed(on[0]) if on <= trip.decided_ns), trip.decided_ns)
        begun = next((on for on, _ in reversed(on[1]) if on <= at_ns), at_ns)
        own = replace(facts, span_ns=(begun, at_ns), started=on[1])
        yield _operated(name, facts if k == 0 and not before else own, at_ns, trip)
    if one.function.name in SCHEMES and (one.function.name != "PSCH" or not (trips or operated)):
        found = judge_scheme(facts, [event for event in summary.events if event.source == name])
        if found is not None:
            verdict, at_ns = found
            end_ns = at_ns if at_ns is not None else facts.span_ns[1]
            text = f"{one.name}: {verdict.text}"
            yield Reason(name, one.name, "", end_ns, at_ns is not None, None, None, verdict.cause, text)
        return
    if trips:
        return
    if operated:
        yield _operated(name, facts, operated[0][0], None)
        return
    if one.function.name != "PDIS":
        verdict = why_stages.judge(facts)
        if verdict is None:
            return
        loop = ""
    else:
        zone = Zone(facts, truth(summary))
        verdict, loop = judge_zone(zone), zone.called
    end = int(known.t_ns[facts.rows[-1]]) if len(facts.rows) else zero
    text = f"{one.name}: {verdict.text}"
    yield Reason(name, one.name, loop, end, False, verdict.m, facts.timer_ms(end), verdict.cause, text)


def _operated(name: str, facts: why_stages.Facts, at_ns: int, trip: TripFacts | None) -> Reason:
    """``at_ns``: when it operated; a zone that stands may trip further poles later, by another loop."""
    one, known, zero = facts.one, facts.known, facts.zero
    start = next((on for on, off in reversed(facts.started) if on <= at_ns), at_ns)
    decided_ns = at_ns if trip is None else max(trip.decided_ns, at_ns)
    row = int(np.searchsorted(known.t_ns, decided_ns))
    m, loop, how = None, "" if trip is None else trip.loop, ""
    if one.function.name == "PDIS" and row < len(known.t_ns):
        place = known.constants["pdis"][one.number]
        fault = int(known.shared["fault"][row])
        loop = loop or FAULTS[fault]
        of = [k for k in range(6) if LOOP_MASK[fault] >> k & 1 and int(place["loops"]) >> k & 1]
        m = why_stages.middle(known.zones["m"][row, one.number, of]) if of else None
        polarized = POLARIZED[int(place["characteristic"])]
        how = "" if m is None else f" {hyphened(loop)} {m:.2f} of reach, polarized by {polarized};"
        begun = min(int(np.searchsorted(known.t_ns, start)), row)
        if np.isfinite(alone := float(known.zones["alone"][begun, one.number])):
            by_phasors = "" if m is None else f" ({m:.2f} by phasors, which ring)"
            how, m = f" {hyphened(loop)} {alone:.2f} of reach by the samples alone{by_phasors};", alone
    elif one.function.name == "PSCH":
        how = f" {sequence(facts)};"
    elif (measured := why_stages.measured(facts)) is not None:
        m, how = measured
        how = f" {how};"
    waited = (at_ns - start) / 1e6
    if facts.started:
        text = f"{one.name}:{how} started {ms(start, zero)}, operated {ms(at_ns, zero)}"
        text += f" after {waited:.1f} ms" if waited > 0 else ", at once"
    else:
        text = f"{one.name}:{how} operated {ms(at_ns, zero)}"
    if trip is None:
        text += "; the trip was another's" if facts.trips else "; its operate trips nothing"
    else:
        text += f"; tripped poles {trip.poles}"
        text += f" at {ms(decided_ns, zero)}" if decided_ns > at_ns else ""
    return Reason(name, one.name, loop, decided_ns, True, m, waited, "operated", text)


def window(summary: Summary, known: Retraced, name: str) -> NDArray[np.int64]:
    """Rows of what is to be explained: from the inception to the fault's end, else as long as there is
    something; without a fault all of them."""
    zero = summary.inception.t_ns
    if zero is None:
        return np.arange(len(known.t_ns))
    end = fault_end_ns(summary, name)
    inside = (known.t_ns >= zero) & (known.t_ns < (np.iinfo(np.int64).max if end is None else end))
    rows = np.flatnonzero(inside)
    later = np.flatnonzero(known.t_ns >= zero)
    return rows if len(rows) else later


def fault_end_ns(summary: Summary, name: str) -> int | None:
    """When a relay no longer saw the fault; None where it did to the log's end.

    Its own breaker's first pole opened, of those that all did; of a relay that tripped nothing, all that
    others tripped were open.  Behind a breaker that failed, and from far away, the fault is seen for longer
    than until the first pole opens somewhere.  Of a record, which has neither breaker nor fault: its elements
    had reset.
    """
    own, zero = summary.relays[name], summary.inception.zero_ns
    trips = [trip for trip in own.trips if trip.decided_ns >= zero]
    times = [fault.off_ns for fault in summary.faults]
    ends = [] if not times or None in times else [max(t for t in times if t is not None)]
    if trips:
        # by the first trip that its breaker followed whole; else by what opened after the last
        whole = [min(trip.poles_opened_ns.values()) for trip in trips if trip.opened_ns is not None]
        last = trips[-1].decided_ns
        beside = [t for t in _openings(summary) if t > last]
        ends += whole[:1] or beside[-1:]
    else:
        others = [
            next((t for t in one.trips if t.decided_ns >= zero), None) for one in summary.relays.values()
        ]
        opened = [trip.opened_ns for trip in others if trip is not None]
        ends += [max(t for t in opened if t is not None)] if opened and None not in opened else []
    if not ends and summary.inception.source != "plant":
        resets = [
            e.last_off_ns for e in own.elements if e.name.endswith(".Str") and _after(e.last_off_ns, zero)
        ]
        ends += [] if not resets or None in resets else [max(t for t in resets if t is not None)]
    return min((t for t in ends if t > zero), default=None)


def _after(t_ns: int | None, zero: int) -> bool:
    return t_ns is None or t_ns > zero


def _openings(summary: Summary) -> list[int]:
    return sorted(o.t_ns for breaker in summary.breakers.values() for o in breaker.operations if o.opened)


def _span(summary: Summary, name: str) -> tuple[int, int]:
    """The same as times [ns]."""
    own = summary.relays[name]
    first, last = own.first_ns or 0, (own.last_ns or 0) + 1
    start = first if summary.inception.t_ns is None else summary.inception.t_ns
    return start, min(last, fault_end_ns(summary, name) or last)


def truth(summary: Summary) -> str | None:
    """The type of the first fault, as the plant applied it."""
    return summary.faults[0].type if summary.faults else None


def hyphened(loop: str) -> str:
    """A loop as a person writes it: ``A-G``."""
    return "-".join(loop) if loop in LOOPS else loop


def ms(t_ns: int, zero: int) -> str:
    return f"{(t_ns - zero) / 1e6:.1f} ms"


def at_instant(
    log: Log, summary: Summary, name: str, at_ms: float, function: str | None = None
) -> dict[str, Any]:
    """What a relay knew at an instant [ms from the inception]: its state, and each zone's depths.

    Raises InputError where there is nothing to explain at that instant.
    """
    if name not in summary.relays:
        raise InputError(f"there is no relay '{name}'; {nearest(name, list(summary.relays))}", key="--relay")
    known, t_ns = retrace(log, name), summary.inception.zero_ns + round(at_ms * 1e6)
    row = int(np.searchsorted(known.t_ns, t_ns, side="right")) - 1
    step_ns = 1e9 / known.settings.relay.sampling_hz
    zones = [one for one in known.instances if one.function.name == "PDIS"]
    if function is not None and function not in (names := [one.name for one in zones]):
        raise InputError(f"'{name}' has no zone '{function}'; {nearest(function, names)}", key="--function")
    first_ns, last_ns = summary.relays[name].first_ns, summary.relays[name].last_ns
    if first_ns is None or last_ns is None or not first_ns - step_ns <= t_ns <= last_ns + step_ns:
        span = [(t or 0) - summary.inception.zero_ns for t in (first_ns, last_ns)]
        told = f"the log of relay '{name}' goes from {span[0] / 1e6:.2f} to {span[1] / 1e6:.2f} ms"
        raise InputError(told, key="--at")
    found: dict[str, Any] = {"relay": name, "t_ns": t_ns, "text": "at rest: nothing changed, nothing blocked"}
    if row < 0 or t_ns - known.t_ns[row] > 1.5 * step_ns:
        return found | {"zones": []}
    q = known.shared[row]
    found |= {
        "t_ns": int(known.t_ns[row]),
        "ready": bool(q["ready"]),
        "type": FAULTS[int(q["fault"])],
        "released": [loop for k, loop in enumerate(LOOPS) if int(q["released"]) >> k & 1],
        "direction": {1: "forward", -1: "reverse"}.get(int(q["direction"]), "unknown"),
        "power_swing": bool(q["swing"]),
        "fuse_failure": bool(q["fuse_failure"]),
        "polarizing_v": abs(complex(q["polarizing"])),
        "disturbed_ms": float(q["age"]) * step_ns / 1e6 if q["disturbed"] else None,
    }
    cause = int(q["cause"])
    told = [] if q["ready"] else [f"not ready: {NOT_READY[cause] if cause < len(NOT_READY) else ''}"]
    told += [] if found["disturbed_ms"] is None else [f"disturbed for {found['disturbed_ms']:.1f} ms"]
    told += [f"type {found['type'] or 'unknown'}", f"direction {found['direction']}"]
    told += ["power swing"] * found["power_swing"] + ["fuse failure"] * found["fuse_failure"]
    told += [f"polarizing V1 {found['polarizing_v'] / 1e3:.1f} kV"]
    these = [one for one in zones if function in (None, one.name)]
    return found | {"text": ", ".join(told), "zones": [_zone_at(known, one, row, step_ns) for one in these]}


def _zone_at(known: Retraced, one: Instance, row: int, step_ns: float) -> dict[str, Any]:
    z, c = known.zones[row, one.number], known.constants["pdis"][one.number]
    own = [k for k in range(6) if int(c["loops"]) >> k & 1]
    blocked = bool(int(known.shared["blocked_zones"][row]) >> one.number & 1)
    timer, delay, inside = (float(z[key]) * step_ns / 1e6 for key in ("timer", "delay", "inside"))
    alone = float(z["alone"])
    if z["operate"]:
        text = "operates"
    elif z["pickup"]:
        text = f"started, timer {timer:.1f} of {delay:.0f} ms"
    elif blocked:
        text = "blocked"
    elif z["waits"]:
        text = f"inside for {inside:.1f} ms, to be confirmed in time ({float(z['confirmed']):.2f}, below 1)"
    elif inside:
        text = f"inside for {inside:.1f} ms"
    elif np.isfinite(alone):
        text = f"inside by the samples alone ({alone:.2f})"
    else:
        at_once = delay * known.settings.relay.frequency_hz < 1e3
        far = at_once and any(float(z["m"][k]) < -PHASORS_BEHIND for k in own)
        text = "not inside, or too far behind" if far else "not inside"
    return {
        "function": one.name,
        "m": {LOOPS[k]: float(z["m"][k]) for k in own if np.isfinite(z["m"][k])},
        "m_by_samples": alone if np.isfinite(alone) else None,
        "polarized_by": POLARIZED[int(c["characteristic"])],
        "blocked": blocked,
        "inside_ms": inside,
        "waits_for_confirmation": bool(z["waits"]),
        "started": bool(z["pickup"]),
        "timer_ms": timer,
        "delay_ms": delay,
        "operated": bool(z["operate"]),
        "text": text,
    }
