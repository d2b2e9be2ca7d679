"""What a run comes to, from its messages alone: trips on their way, faults, positions of breakers, events.

This is the only place that derives it.  A run folds its messages as they are made, a review those of a log,
processes those of their merged logs: so all three say the same of the same messages.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.authentication import read
from faultloop.io.can.frames import Frame, State
from faultloop.io.can.table import BY_IDENTIFIER, Kind
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import (
    BREAKER_STATUS,
    CAN_FRAME,
    EVENT,
    FAULT_STATE,
    LEVELS,
    POLES,
    TRIP,
    source_of,
)
from faultloop.loop.recorded import recorded_scenario
from faultloop.loop.scenario import Scenario

_NAMES = {kind: kind.name for kind in Kind}
"""An enumeration's own look-up takes five times as long."""


def pole_names(mask: int) -> str:
    """A mask of poles as a person writes it: ``A``, ``BC``, ``ABC``."""
    return "".join(pole for bit, pole in enumerate(POLES) if mask >> bit & 1)


@dataclass
class TripReport:
    """One trip: decided by the relay at `t_ns`, received by its breaker at `received_ns` (None: never)."""

    relay: str
    function: str
    """`PDIS1`."""
    zone: int
    """0 for what has none."""
    loop: str
    """`AG`, `BC`; empty for what has none."""
    poles: int
    """Mask: A = 1, B = 2, C = 4."""
    sample_count: int
    """The deciding sample's number."""
    t_ns: int
    breaker: str | None
    received_ns: int | None = None
    opened_ns: int | None = None
    """When the last commanded pole was open."""
    received_by: Literal["breaker", "CAN frame"] | None = None
    """Whose word `received_ns` is: the breaker's, or, of a device that logs nothing here, the frame's."""
    poles_opened_ns: dict[str, int] = field(default_factory=dict)
    """When each commanded pole was open, of those that were."""

    @property
    def pole_names(self) -> str:
        """`ABC`."""
        return pole_names(self.poles)


@dataclass(frozen=True)
class FaultChange:
    """A fault applied or removed, as the plant did it."""

    fault: str
    type: str
    """`AG`, `BCG` ..."""
    on: bool
    """Applied, or removed."""
    t_ns: int
    """When, from the start."""


@dataclass(frozen=True)
class EventText:
    """A line of the event list."""

    t_ns: int
    """When, from the start."""
    source: str
    """Who says it."""
    level: str
    """debug, info, warning, error or fatal."""
    text: str
    """What."""


class Position(NamedTuple):
    """A breaker's closed poles at `t_ns`, and the command it has taken then, if any, and whose."""

    t_ns: int
    closed: int
    command: str
    relay: str


class Cast(NamedTuple):
    """Who is who in the messages of a run.

    breakers : the breaker that each relay trips, in the order of the relays' numbers on the bus.
    faults : names, by the number that the plant gives them.
    foreign : breakers that are devices of somebody else's, whose word nobody logs: they have a trip when its
        frame is on the bus.  None where that is not known (logs of version 0.1.0): those that never said a
        word of a command.
    """

    breakers: Mapping[str, str | None]
    faults: Sequence[str]
    foreign: Collection[str] | None = ()

    @classmethod
    def of_scenario(cls, scenario: Scenario, without: Collection[str] = ()) -> Cast:
        """`without`: names of the nodes that somebody else's devices stand in for."""
        breakers = {place.name: place.breaker for place in scenario.relay}
        return cls(breakers, [fault.name for fault in scenario.fault], frozenset(without))

    @classmethod
    def of_log(cls, log: Log) -> Cast:
        """From what the run has put into its log; relays by name alone where it has put nothing."""
        scenario, without = recorded_scenario(log), log.metadata.get("scenario", {}).get("without")
        breakers = {place["name"]: place.get("breaker") for place in scenario["relay"]}
        return cls(
            breakers or dict.fromkeys(log.relays),
            [fault.get("name", "") for fault in scenario["fault"]],
            None if without is None else frozenset(without.splitlines()),
        )


@dataclass
class Outcome:
    """What happened.

    Attributes
    ----------
    trips, faults, events : in order of time.
    positions : of each breaker, by name, in order of time.
    can_frames : how many were on the bus, by the kind's name (``TRIP``), ``unknown`` for others.
    """

    trips: list[TripReport]
    faults: list[FaultChange]
    events: list[EventText]
    positions: dict[str, list[Position]]
    can_frames: dict[str, int]

    @property
    def fault_start_ns(self) -> int | None:
        """When the first fault was applied."""
        return next((change.t_ns for change in self.faults if change.on), None)


class Fold:
    """Takes messages (it is a sink of a run, too) and gives what they come to.

    Messages of one topic must come in order of time, topics in any order.

    Parameters
    ----------
    cast : who is who.
    texts : whether the outcome's `events` are wanted.
    """

    wants_blocks = False

    def __init__(self, cast: Cast, *, texts: bool = True) -> None:
        self._cast = cast
        self.wants_texts = texts
        self._trips: list[TripReport] = []
        self._faults: list[FaultChange] = []
        self._events: list[EventText] = []
        self._positions: dict[str, list[Position]] = {}
        self._frames: dict[str, list[tuple[int, int]]] = {name: [] for name in cast.breakers}
        """Time and poles of the trip frames of each relay that open something."""
        self._kinds: dict[str, int] = {}

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        """A rare message, as the table of messages has it."""
        match message_name:
            case "CanFrame":
                self._take_frame(t_ns, **fields)
            case "Trip":
                relay = source_of(topic)
                self._trips.append(
                    TripReport(relay=relay, t_ns=t_ns, breaker=self._cast.breakers.get(relay), **fields)
                )
            case "BreakerStatus":
                self._take_position(source_of(topic), t_ns, **fields)
            case "FaultState":
                number, names = int(fields["fault"]), self._cast.faults
                name = names[number] if number < len(names) else str(number)
                self._faults.append(FaultChange(name, fields["type"], fields["on"], t_ns))
            case "foxglove.Log":
                level = LEVELS[fields["level"]].lower() if fields["level"] < len(LEVELS) else "info"
                name = fields["name"] or source_of(topic)
                self._events.append(EventText(t_ns, name, level, fields["message"]))

    def _take_position(
        self,
        breaker: str,
        t_ns: int,
        command: str,
        relay: str = "",
        *,
        pole_a: bool,
        pole_b: bool,
        pole_c: bool,
    ) -> None:
        closed = pole_a | pole_b << 1 | pole_c << 2
        self._positions.setdefault(breaker, []).append(Position(t_ns, closed, command, relay))

    def _take_frame(
        self, t_ns: int, *, id: int, data: bytes, extended: bool, fd: bool, **_unused: str
    ) -> None:
        kind, number = self._count(id, extended, 1)
        if kind is not Kind.TRIP or number >= len(self._frames):
            return
        state = read(Frame(id, data, extended, fd))
        if isinstance(state, State) and state.poles:
            list(self._frames.values())[number].append((t_ns, state.poles))

    def count_frames(self, counts: NDArray[np.int64]) -> None:
        """In place of the frames themselves: how many there were, by identifier, at last of extended ones."""
        there = np.flatnonzero(counts)
        for identifier, count in zip(there.tolist(), counts[there].tolist(), strict=True):
            self._count(identifier, identifier == len(counts) - 1, count)

    def _count(self, identifier: int, extended: bool, count: int) -> tuple[Kind | None, int]:
        kind, number = BY_IDENTIFIER.get(identifier, (None, 0))
        name = "unknown" if kind is None or extended else _NAMES[kind]
        self._kinds[name] = self._kinds.get(name, 0) + count
        return kind, number

    def outcome(self) -> Outcome:
        """What the messages so far come to."""
        for trip in self._trips:
            self._follow(trip)
        return Outcome(
            sorted(self._trips, key=lambda trip: trip.t_ns),
            self._faults,
            sorted(self._events, key=lambda event: event.t_ns),
            self._positions,
            {kind: self._kinds[kind] for kind in (*Kind.__members__, "unknown") if kind in self._kinds},
        )

    def _follow(self, trip: TripReport) -> None:
        """A trip on its way: received by its breaker, its poles open."""
        if trip.breaker is None:
            return
        told = self._positions.get(trip.breaker, [])
        frame_ns = next(
            (t for t, poles in self._frames[trip.relay] if t >= trip.t_ns and poles & trip.poles), None
        )
        if self._is_foreign(trip.breaker, told):
            trip.received_ns, trip.received_by = frame_ns, "CAN frame"
        else:
            # a log of version 0.1.0 does not say whom the breaker obeyed: not before its frame was there
            unsigned_ns = trip.t_ns if frame_ns is None else frame_ns
            trip.received_ns = next(
                (
                    p.t_ns
                    for p in told
                    if p.command == "open"
                    and (p.relay == trip.relay if p.relay else p.t_ns >= unsigned_ns)
                    and p.t_ns >= trip.t_ns
                ),
                None,
            )
            trip.received_by = "breaker"
        if trip.received_ns is None:
            trip.received_by = None
            return
        for position in told:
            if position.t_ns >= trip.received_ns:
                for pole in pole_names(trip.poles & ~position.closed):
                    trip.poles_opened_ns.setdefault(pole, position.t_ns)
        if len(trip.poles_opened_ns) == len(trip.pole_names):
            trip.opened_ns = max(trip.poles_opened_ns.values())

    def _is_foreign(self, breaker: str, told: Sequence[Position]) -> bool:
        foreign = self._cast.foreign
        return breaker in foreign if foreign is not None else all(not p.command for p in told)

    # -- a sink takes these, too; nothing follows from them -------------------------------------------------

    def add_relay(self, name: str, bits: Sequence[str], characteristics: object = None) -> None:
        """Nothing: `Cast` has the relays."""

    def relay_block(self, *_: Any) -> None:
        """Nothing: samples are no messages."""

    def close(self) -> None:
        """Nothing to close."""

    def abort(self) -> None:
        """Nothing to undo."""


def outcome_of(log: Log, cast: Cast | None = None, *, texts: bool = True) -> Outcome:
    """What the messages in a log come to; who is who is in the log, unless `cast` says it.  ``texts``: with
    the outcome's `events`.

    Raises InputError where its content is damaged.
    """
    fold = Fold(Cast.of_log(log) if cast is None else cast, texts=texts)
    for message in (TRIP, BREAKER_STATUS, FAULT_STATE, CAN_FRAME, *([EVENT] if texts else [])):
        for entry in log.walk(message):
            fold.message(entry.topic, entry.t_ns, message.name, **entry.fields)
    return fold.outcome()
