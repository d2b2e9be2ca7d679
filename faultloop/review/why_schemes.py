"""What pilot scheme, breaker failure and reclosing did, or what they waited for.

They answer what other functions and the far end do, so what is told is what of it was there, and when.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from faultloop.relay.functions.psch import DCB, DTT, DUTT, TYPES
from faultloop.review.facts import Event
from faultloop.review.rows import Span
from faultloop.review.survey import survey
from faultloop.review.why_stages import Facts, Verdict

SCHEMES = ("PSCH", "RBRF", "RREC")


def judge_scheme(facts: Facts, events: Sequence[Event]) -> tuple[Verdict, int | None] | None:
    """What it came to, and when it operated [ns]; None of one that was not asked.

    Of a pilot scheme only where it did not operate: else `sequence` stands in its trip.
    """
    match facts.one.function.name:
        case "PSCH":
            return _pilot(facts), None
        case "RBRF":
            return _breaker_failure(facts, events)
    return _reclosing(facts, events)


def sequence(facts: Facts) -> str:
    """Of a pilot scheme what it sent and received: ``pott, sent from 7.7 ms, received from 17.4 ms``."""
    parts = [TYPES[int(facts.constants["type"])]]
    for bit, word in (("ProTx", "sent"), ("ProRx", "received"), ("WeiOp", "weak infeed")):
        spans = _since(facts, [f"{facts.one.name}.{bit}"])
        parts += [f"{word} from {_ms(facts, spans[0][0])}"] if spans else []
    return ", ".join(parts)


def _pilot(facts: Facts) -> Verdict:
    name, c = facts.one.name, facts.constants
    kind, said = int(c["type"]), sequence(facts)
    received = _since(facts, [f"{name}.ProRx"])
    own = ["RDIR1.DirFwd"] if c["by_direction"] else [f"PDIS{k + 1}.Str" for k in _places(int(c["pilot"]))]
    ahead = _since(facts, own)
    silent = "; the channel was silent (LosOfGrd)" if _since(facts, [f"{name}.LosOfGrd"]) else ""
    if kind == DTT:
        return Verdict("no-signal", None, f"{said}: no trip was transferred{silent}")
    if kind == DUTT:
        return Verdict("no-signal", None, f"{said}: nothing was received{silent}")
    zone = "a fault ahead" if c["by_direction"] else "its pilot zone"
    if not ahead:
        came = "" if received else ", and nothing was received"
        return Verdict(
            "no-start" if received else "quiet", None, f"{said}: {zone} did not start{came}{silent}"
        )
    said += f", {zone} from {_ms(facts, ahead[0][0])}"
    if _since(facts, [f"{name}.RvABlk"]):
        return Verdict("blocked", None, f"{said}: blocked, as a fault was behind (RvABlk)")
    if kind == DCB and received:
        return Verdict("blocked", None, f"{said}: the other end's signal blocks it")
    if kind != DCB and not received:
        return Verdict("no-signal", None, f"{said}: nothing was received{silent}")
    limit = "coordination_ms" if kind == DCB else "coincidence_ms, or not of the same poles"
    return Verdict("timer", None, f"{said}: not for {limit}{silent}")


def _breaker_failure(facts: Facts, events: Sequence[Event]) -> tuple[Verdict, int | None] | None:
    name = facts.one.name
    started, failed = facts.started, _since(facts, [f"{name}.OpEx"])
    if not started:
        return None
    said = f"started {_ms(facts, started[0][0])} by the trip"
    again = _since(facts, [f"{name}.OpIn"])
    said += f", tripped again {_ms(facts, again[0][0])}" if again else ""
    if failed:
        told = next((e.text for e in events if e.text.startswith(f"{name} OpEx:")), "")
        poles = told.partition(": ")[2] or "current still flows: breaker failure"
        text = f"{said}; {poles}; the breakers around were told {_ms(facts, failed[0][0])} (OpEx)"
        return Verdict("operated", None, text), failed[0][0]
    off = started[-1][1]
    if off is None:
        return Verdict(
            "timer", None, f"{said}; current still flowed at the log's end, before backup_ms"
        ), None
    return Verdict("timer", None, f"{said}; the current was gone {_ms(facts, off)}, before backup_ms"), None


def _reclosing(facts: Facts, events: Sequence[Event]) -> tuple[Verdict, int | None] | None:
    name = facts.one.name
    own = [(e.t_ns, e.text.removeprefix(f"{name} ")) for e in events if e.text.startswith(f"{name} ")]
    own = [(t_ns, text) for t_ns, text in own if t_ns >= facts.zero and text != "Rdy"]
    closed = _since(facts, [f"{name}.Op"])
    if not own and not closed:
        return None
    text = "; ".join(f"{_ms(facts, t_ns)} {text}" for t_ns, text in own)
    if closed:
        return Verdict("operated", None, text), closed[0][0]
    if any(text.startswith("Lockout") for _, text in own):
        return Verdict("blocked", None, text), None
    return Verdict("timer", None, f"{text}; the log ends before it closes"), None


def _places(mask: int) -> Iterable[int]:
    return (k for k in range(mask.bit_length()) if mask >> k & 1)


def _since(facts: Facts, bits: Iterable[str]) -> list[Span]:
    """When any of these was on, since the fault's inception, by time."""
    spans = survey(facts.log, facts.known.name).spans
    found = [span for bit in bits for span in spans.get(bit, []) if span[1] is None or span[1] > facts.zero]
    return sorted(found, key=lambda span: span[0])


def _ms(facts: Facts, t_ns: int) -> str:
    return f"{(t_ns - facts.zero) / 1e6:.1f} ms"
