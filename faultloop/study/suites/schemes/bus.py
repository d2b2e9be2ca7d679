"""What both ends put on their bus: load and latency of each message on the bus model, against computed ones.

Latency is from what is told - the instant of a set of currents, the sending of a state, each in its frame -
to the end of the frame on the bus.  Its bound is that of worst-case response-time analysis (Davis, Burns,
Bril, Lukkien 2007) over all that is on the bus, each frame as long as bit stuffing can make it and as often
as its sender may send it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from faultloop.io.can.authentication import read
from faultloop.io.can.frames import Differential, Frame, State
from faultloop.io.can.length import INTERMISSION, wire_length
from faultloop.io.can.table import BY_IDENTIFIER, TICK_NS, Kind
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.bus.response_times import Message, longest_bits, response_ns
from faultloop.study.suites.schemes.network import Bench, Case

MS, SECOND_NS = 1_000_000, 1_000_000_000
LONGEST_FD_NS = 241_000
"""Of a CAN FD frame of 32 bytes at 500 kbit/s and 2 Mbit/s, stuffed as it can be, intermission included."""
FIRST_REPETITION_NS = 2 * MS
SETS_PER_S = 400.0
PAGES = 3
"""Frames of measurements, sent together."""
MOST_FD_BUS, LEAST_SHARE = 0.10, 0.85
"""Of the bus that the sets of one end may take, and of the longest frame that the mean one has at least."""


class Seen(NamedTuple):
    """A frame on the bus: when its end was there, and whose it is."""

    t_ns: int
    sender: str
    frame: Frame


class _Frames:
    """A sink that keeps the frames."""

    def __init__(self) -> None:
        self.seen: list[Seen] = []

    def add_relay(self, name: str, bits: Sequence[str], characteristics: Any = None) -> None: ...

    def relay_block(self, *_: Any) -> None: ...

    def close(self) -> None: ...

    def abort(self) -> None: ...

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        if message_name == "CanFrame":
            frame = Frame(fields["id"], bytes(fields["data"]), fields["extended"], fields["fd"], fields["fd"])
            self.seen.append(Seen(t_ns, fields["sender"], frame))


def report(title: str, cases: Sequence[Case], bench: Bench) -> Report:
    """A table for each case."""
    done = Report("bus", title)
    done.text = [
        "500 kbit/s, and 2 Mbit/s in the data phase of CAN FD. Load: of the whole run. Bound: the longest "
        "that a frame takes when all that is on this bus is offered at once, and as soon again as it may be; "
        "none where the first repetitions of all states, 2 ms apart for ever, would fill the bus."
    ]
    for case in cases:
        sink = _Frames()
        outcome = bench.outcome(case, [sink])
        run_ns = round(case.scenario["scenario"]["duration_s"] * SECOND_NS)
        _one(done, case, sink.seen, run_ns, outcome.bus_load)
    return done


def _one(done: Report, case: Case, seen: Sequence[Seen], run_ns: int, load: float) -> None:
    own = {"bitrate": 500_000, "data_bitrate": 2_000_000} | case.scenario.get("can", {})
    by_id: dict[int, list[Seen]] = defaultdict(list)
    for one in seen:
        by_id[one.frame.id].append(one)
    streams = _streams(sorted(by_id))
    bit_ns = SECOND_NS // own["bitrate"]
    messages = [message for _, message in streams]
    rows = []
    for identifier, frames in sorted(by_id.items()):
        kind, _ = BY_IDENTIFIER[identifier]
        places = [k for k, (of, _) in enumerate(streams) if of == identifier]
        bound_ns = response_ns(messages, places[-1], bit_ns)
        part = sum(_time_ns(f.frame, own) for f in frames) / run_ns
        late = np.array([ms for f in frames if (ms := _latency_ms(f)) is not None])
        cells = [*np.quantile(late, (0.5, 0.99)).tolist(), float(late.max())] if len(late) else ["", "", ""]
        bound = float("nan") if bound_ns is None else bound_ns / MS
        rows.append((kind.name, frames[0].sender, len(frames), 100 * part, *cells, bound))
        if len(late) and bound_ns is not None:
            what = f"{case.name}: {kind.name} of {frames[0].sender}, longest"
            done.checks.append(Check(what, float(late.max()), bound + TICK_NS / MS, "ms"))
        if kind is Kind.DIFFERENTIAL:
            most = SETS_PER_S * LONGEST_FD_NS / SECOND_NS
            what = f"{case.name}: load by the sets of {frames[0].sender}"
            done.checks.append(Check(f"{what}, over the longest frames'", part / most, 1.0))
            done.checks.append(Check(f"{what}, of the bus", part, MOST_FD_BUS))
    columns = (
        "message",
        "sender",
        ">frames",
        ">load [%]",
        ">median [ms]",
        ">99 of 100",
        ">longest",
        ">bound",
    )
    note = f"The bus is busy {100 * load:.1f} % of the time."
    done.tables.append(Table(case.name, columns, rows, note))


def _streams(identifiers: Sequence[int]) -> list[tuple[int, Message]]:
    """What the analysis takes, by priority, with the identifier of each."""
    bit_ns = SECOND_NS // 500_000
    out = []
    for identifier in identifiers:
        kind, _ = BY_IDENTIFIER[identifier]
        time_ns, period_ns, count = longest_bits(8) * bit_ns, FIRST_REPETITION_NS, 1
        if kind is Kind.DIFFERENTIAL:
            time_ns, period_ns = LONGEST_FD_NS, round(SECOND_NS / SETS_PER_S)
        elif kind is Kind.MEASUREMENTS:
            period_ns, count = SECOND_NS // 10, PAGES
        elif kind is Kind.TIME_SYNC:
            period_ns, count = SECOND_NS // 10, 2
        elif kind is Kind.HEARTBEAT:
            period_ns = SECOND_NS
        out += [(identifier, Message(f"{kind.name}", time_ns, period_ns)) for _ in range(count)]
    return out


def _time_ns(frame: Frame, can: dict[str, Any]) -> float:
    nominal, data = wire_length(frame)
    return ((nominal + INTERMISSION) / can["bitrate"] + data / can["data_bitrate"]) * SECOND_NS


def _latency_ms(one: Seen) -> float | None:
    """From what a frame tells to its end on the bus; None where it has no time."""
    message = read(one.frame)
    if isinstance(message, Differential):
        return (one.t_ns - message.time * 1000) / MS
    if isinstance(message, State):
        return (one.t_ns - message.time * TICK_NS) / MS
    return None
