"""What is on a bus, by identifier: counts, rates, the newest content, what its protection says, bus load."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from faultloop.errors import InputError
from faultloop.io.can.authentication import read
from faultloop.io.can.bus import SECOND_NS
from faultloop.io.can.dbc import message_name, sender_name
from faultloop.io.can.frames import (
    Differential,
    Frame,
    Heartbeat,
    Measurements,
    Message,
    Page,
    Rejection,
    SampledValues,
    State,
    TimeSync,
)
from faultloop.io.can.length import INTERMISSION, wire_length
from faultloop.io.can.table import BY_IDENTIFIER, STATE_KINDS, TICK_NS
from faultloop.nodes.goose import Subscriber

if TYPE_CHECKING:
    from cantools.database.can import Database
    from cantools.database.can import Message as DbcMessage

STATES = {0: "boot-up", 4: "stopped", 5: "operational", 127: "pre-operational"}


@dataclass(slots=True)
class Row:
    """One identifier: the frames so far."""

    identifier: int
    extended: bool
    name: str
    sender: str
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    rate_hz: float = 0.0
    """In the newest lap."""
    rejected: Counter[Rejection] = field(default_factory=Counter)
    lost: int = 0
    """Frames missed, by the counter."""
    pages: dict[int, Message | Frame] = field(default_factory=dict)
    """The newest content; of a multiplexed message, of each page."""
    subscriber: Subscriber | None = None
    checked: bool = False
    """Its content is protected: CRC and counter."""
    sealed: bool = False
    """Authenticated frames, whose tag nobody checks here."""
    lap_count: int = 0
    next_counter: int | None = None


class BusMonitor:
    """Takes frames with the time of their arrival, and keeps one `Row` for each identifier.

    Parameters
    ----------
    bitrate, data_bitrate : of the bus [bit/s], for its load.
    database : names and content by this DBC, and no check of what it knows nothing of: CRC, counter,
        repetition.  Where not given: faultloop's own messages, checked.
    pace : run time that passes in a second of wall time; load and repetition are of the run's time.
    """

    def __init__(
        self,
        bitrate: int = 500_000,
        data_bitrate: int = 2_000_000,
        database: Database | None = None,
        pace: float = 1.0,
    ) -> None:
        for key, value in (("--bitrate", bitrate), ("--data-bitrate", data_bitrate)):
            if value <= 0:
                raise InputError(f"{value} bit/s is not a bit rate: it must be positive", key=key)
        self.bitrate = bitrate
        self.data_bitrate = data_bitrate
        if not 0 < pace < math.inf:
            raise InputError(f"must be greater than 0 and finite, not {pace:g}", key="--pace")
        self.pace = pace
        self.rows: dict[tuple[int, bool], Row] = {}
        self.frames = 0
        self.load = 0.0
        """Part of the newest lap in which the bus was busy, 0 to 1."""
        self._by_dbc = _messages(database)
        self._busy_ns = self._lap_busy_ns = 0
        self._begin_ns: int | None = None
        self._lap_ns = 0

    def take(self, t_ns: int, frame: Frame) -> None:
        """A frame that arrived at `t_ns`."""
        if self._begin_ns is None:
            self.begin(t_ns)
        key = (frame.id, frame.extended)
        row = self.rows.get(key)
        if row is None:
            row = self.rows[key] = self._new_row(frame, t_ns)
        row.count += 1
        row.last_ns = t_ns
        self.frames += 1
        nominal, data = wire_length(frame)
        self._busy_ns += (nominal + INTERMISSION) * SECOND_NS // self.bitrate
        self._busy_ns += data * SECOND_NS // self.data_bitrate
        if self._by_dbc is not None:
            row.pages[0] = frame
        else:
            _check(row, round(t_ns * self.pace), frame)

    def begin(self, t_ns: int) -> None:
        """From when on rates and load count."""
        self._begin_ns = self._lap_ns = t_ns

    def lap(self, t_ns: int) -> None:
        """Rates and load since the last lap; publishers that should have been heard by now."""
        passed = (t_ns - self._lap_ns) / SECOND_NS
        for row in self.rows.values():
            if passed > 0:
                row.rate_hz = (row.count - row.lap_count) / passed
            row.lap_count = row.count
            if row.subscriber is not None:
                row.subscriber.supervise(round(t_ns * self.pace))
        if passed > 0:
            self.load = (self._busy_ns - self._lap_busy_ns) / (passed * self.pace * SECOND_NS)
        self._lap_ns, self._lap_busy_ns = t_ns, self._busy_ns

    def whole(self, t_ns: int) -> None:
        """Rates and load since the beginning."""
        self._lap_ns = self._begin_ns if self._begin_ns is not None else t_ns
        self._lap_busy_ns = 0
        for row in self.rows.values():
            row.lap_count = 0
        self.lap(t_ns)

    def sorted_rows(self) -> list[Row]:
        """By priority."""
        return [self.rows[key] for key in sorted(self.rows)]

    def content(self, row: Row) -> str:
        """What the newest frame says."""
        if self._by_dbc is None:
            return "; ".join(_told(row.pages[page]) for page in sorted(row.pages))
        frame = row.pages[0]
        assert isinstance(frame, Frame)
        found = self._by_dbc.get((row.identifier, row.extended))
        if found is None:
            return frame.data.hex(" ")
        from cantools.database.errors import DecodeError

        try:
            values = found.decode(frame.data)
        except DecodeError as error:
            return f"{frame.data.hex(' ')} ({error})".strip()
        return " ".join(f"{name}={value}" for name, value in dict(values).items())

    def _new_row(self, frame: Frame, t_ns: int) -> Row:
        name = sender = ""
        found = None
        if self._by_dbc is not None:
            message = self._by_dbc.get((frame.id, frame.extended))
            if message is not None:
                name, sender = message.name, ", ".join(message.senders)
        elif not frame.extended and frame.id in BY_IDENTIFIER:
            found = BY_IDENTIFIER[frame.id]
            name, sender = message_name(*found), sender_name(*found)
        row = Row(frame.id, frame.extended, name, sender, first_ns=t_ns)
        if found is not None and found[0] in STATE_KINDS:
            # An observer that comes and goes has no clock in common with the run.
            row.subscriber, row.checked = Subscriber(max_age_ns=None, test=True), True
        return row


def rejections(row: Row) -> Counter[Rejection]:
    """Frames that a receiver refuses, by cause."""
    return row.rejected if row.subscriber is None else row.rejected + row.subscriber.rejected


def lost(row: Row) -> int:
    """Frames missed, by the counter."""
    return row.lost if row.subscriber is None else row.subscriber.lost


def state_of(row: Row) -> str:
    """What the protection of a row's frames says, in a few words."""
    words = [f"{count} {cause.value}" for cause, count in rejections(row).items()]
    words += [f"{lost(row)} lost"] if lost(row) else []
    words += ["tag not checked"] if row.sealed else []
    words += ["silent"] if row.subscriber is not None and row.subscriber.alarm else []
    return ", ".join(words) or ("ok" if row.checked else "")


def _messages(database: Database | None) -> dict[tuple[int, bool], DbcMessage] | None:
    if database is None:
        return None
    return {(message.frame_id, message.is_extended_frame): message for message in database.messages}


def _check(row: Row, t_ns: int, frame: Frame) -> None:
    message = read(frame)
    if isinstance(message, Rejection):
        row.rejected[message] += 1
        row.pages.setdefault(0, frame)
        if isinstance(row.pages[0], Frame):
            row.pages[0] = frame
        return
    if isinstance(message, State) and row.subscriber is not None:
        row.sealed |= frame.fd
        if isinstance(row.subscriber.receive(message, t_ns), Rejection):
            return
    elif isinstance(message, TimeSync):
        row.checked = True
    elif isinstance(message, (SampledValues, Measurements, Differential)):
        row.checked |= not isinstance(message, Measurements)  # which have no CRC of ours
        if row.next_counter is not None:
            row.lost += (message.counter - row.next_counter) % 256
        row.next_counter = (message.counter + 1) % 256
    row.pages[message.page.value if isinstance(message, Measurements) else 0] = message


def _told(message: Message | Frame) -> str:
    if isinstance(message, State):
        poles = "".join(p for bit, p in enumerate("ABC") if message.poles >> bit & 1) or "none"
        test = " test" if message.test else ""
        seconds = message.time * TICK_NS / 1e9
        return f"poles {poles}{test}  st {message.st_num} sq {message.sq_num}  t {seconds:.5f} s"
    if isinstance(message, SampledValues):
        v, i = message.values[:3], message.values[3:]
        kilovolts = " ".join(f"{x / 1e3:.2f}" for x in v)
        return f"#{message.sample_count}  v {kilovolts} kV  i {' '.join(f'{x:.1f}' for x in i)} A"
    if isinstance(message, Measurements):
        return _page(message)
    if isinstance(message, Heartbeat):
        state = STATES.get(message.state, str(message.state))
        alarms = f" alarms {message.alarms:#x}" if message.alarms else ""
        return f"{state}{alarms}  rejected {message.rejected}  t {message.time * TICK_NS / 1e9:.5f} s"
    if isinstance(message, Differential):
        test = " test" if message.test else ""
        currents = " ".join(f"{abs(i):.1f}" for i in message.currents)
        return f"i {currents} A{test}  t {message.time / 1e6:.6f} s"
    if isinstance(message, TimeSync):
        if not message.follow_up:
            return f"SYNC {message.sequence}  {message.time} s"
        return f"follow-up {message.sequence}  {message.overflow & 3} s + {message.time} ns"
    return message.data.hex(" ")


def _page(message: Measurements) -> str:
    a, b, c = message.values
    if message.page is Page.VOLTAGE:
        return f"v {a / 1e3:.2f} {b / 1e3:.2f} {c / 1e3:.2f} kV"
    if message.page is Page.CURRENT:
        return f"i {a:.0f} {b:.0f} {c:.0f} A"
    location = "" if c != c else f" fault at {c:.3f}"
    return f"f {a:.3f} Hz {b:+.2f} Hz/s{location}"
