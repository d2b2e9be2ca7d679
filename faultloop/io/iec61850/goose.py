"""GOOSE streams (IEC 61850-8-1, clause 18 and annex A): messages out, messages in.

State messages keep the numbers of their stream: `Publication` widens the 8 bits that a frame on CAN has to
32, whatever order they come in (a fault may delay or double them), and `Subscription` narrows them, with a
counter and a time of sending that GOOSE has not, for `faultloop.nodes.goose` to judge, which both share.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from faultloop.io.can.e2e import P01_COUNTERS
from faultloop.io.can.frames import Heartbeat, Measurements, State, ticks
from faultloop.io.can.table import TICK_NS
from faultloop.io.iec61850.data_set import Refused, check_types, poles_of, told, values_of
from faultloop.io.iec61850.streams import CONF_REV, MS, Station, Stream

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
NUMBERS = 2**32 - 1
"""stNum and sqNum go from 1 to this, and then from 1 again."""
JUMP = 2
"""What a state number that does not continue is told as: the subscriber waits for a further message."""
TIME_QUALITY = 0x0A
"""Of `t`: synchronised, ten bits of the fraction are accurate (1 ms)."""
NOT_A_TIME = 0x60
"""Bits of it: clock failure, clock not synchronised."""
MAX_AGE_NS = 1000 * MS
REMEMBERED = 8
"""States of which the time of change is kept, for their late messages."""


class Numbers(NamedTuple):
    """What the header of a state's message says beside its stream."""

    st_num: int
    sq_num: int
    changed_ns: int
    """Run time of the change [ns]."""


def encode(
    station: Station, stream: Stream, values: list[Any], numbers: Numbers, start_ns: int, live_ms: int
) -> bytes:
    """An Ethernet frame, without its check sequence."""
    from open61850.goose import GoosePDU, encode_goose_frame

    options, address = station.options, stream.address
    pdu = GoosePDU(
        gocb_ref=stream.control,
        time_allowed_to_live=live_ms,
        dat_set=stream.data_set,
        go_id=stream.id,
        timestamp=EPOCH + timedelta(microseconds=(start_ns + numbers.changed_ns) // 1000),
        st_num=numbers.st_num,
        sq_num=numbers.sq_num,
        simulation=options.simulation,
        conf_rev=CONF_REV,
        nds_com=False,
        num_dat_set_entries=len(values),
        all_data=values,
        time_quality=TIME_QUALITY,
    )
    frame = encode_goose_frame(
        pdu,
        dst_mac=address.destination,
        src_mac=address.source,
        app_id=address.app_id,
        vlan_id=options.vlan_id,
        vlan_priority=options.vlan_priority,
    )
    return simulated(frame) if options.simulation else frame


def simulated(frame: bytes) -> bytes:
    """With the S bit of Reserved 1 (8-1 and 9-2, annex C), behind addresses, tag, EtherType, APPID and
    length."""
    return frame[:22] + bytes((frame[22] | 0x80,)) + frame[23:]


class Publication:
    """One stream that goes out.

    Parameters
    ----------
    station : whose settings the stream has.
    stream : which one.
    """

    def __init__(self, station: Station, stream: Stream) -> None:
        self._station, self._stream = station, stream
        self._newest: State | None = None
        self._time_ns = self._st = self._sq = 0
        self._changes: dict[int, int] = {}

    def frame(self, message: State | Measurements | Heartbeat, start_ns: int, now_ns: int) -> bytes:
        """The message as an Ethernet frame.

        Parameters
        ----------
        start_ns : time zero of the run [ns since 1970].
        now_ns : run time [ns]; that of a message that has none.
        """
        values = values_of(message)
        if isinstance(message, State):
            numbers = self._numbers(message)
            live_ms = self._station.allowed_to_live_ms(message.sq_num)
        else:  # each is a state of its own
            self._st = self._st % NUMBERS + 1
            if isinstance(message, Heartbeat):
                now_ns = self._run_time(message.time)
            numbers = Numbers(self._st, 0, now_ns)
            live_ms = -(-(2 * self._station.heartbeat_ns) // MS)
        return encode(self._station, self._stream, values, numbers, start_ns, live_ms)

    def _run_time(self, time: int) -> int:
        """Run time of a `time` signal [ns], which has 32 bits: the one nearest to the last."""
        last = self._time_ns // TICK_NS
        t_ns = (last + _difference(time, last, 1 << 32)) * TICK_NS
        self._time_ns = max(self._time_ns, t_ns)
        return t_ns

    def _numbers(self, m: State) -> Numbers:
        last, before_ns = self._newest, self._time_ns
        t_ns = self._run_time(m.time)
        step = 0 if last is None else _difference(m.st_num, last.st_num, 1 << 8)
        late = t_ns <= before_ns
        if last is None or (not late and (step < 0 or (step == 0 and m.sq_num == 0))):  # it began (again)
            self._st, self._sq, self._changes = 1, m.sq_num, {1: t_ns}
        elif step > 0:
            self._st, self._sq = self._st + step, m.sq_num
            self._changes[self._st] = t_ns
            self._changes.pop(self._st - REMEMBERED, None)
        elif step < 0:
            return self._told(self._st + step, m.sq_num, t_ns)
        else:
            sq = self._wide(m.sq_num, last.sq_num)
            if sq < self._sq:
                return self._told(self._st, sq, t_ns)
            self._sq = sq
        self._newest = m
        return self._told(self._st, self._sq, t_ns)

    def _told(self, st: int, sq: int, t_ns: int) -> Numbers:
        return Numbers((st - 1) % NUMBERS + 1, sq, self._changes.get(st, t_ns))

    def _wide(self, sq: int, last: int) -> int:
        """Sequence number of a repetition: 0, then 1 to 255 and 1 again become 0, 1, 2, ..."""
        if sq == 0 or last == 0:
            return sq
        return (self._sq + _difference(sq, last, 255) - 1) % NUMBERS + 1


class Subscription:
    """One stream that comes in.

    Parameters
    ----------
    station : whose names and settings the stream must have.
    stream : which one.

    Attributes
    ----------
    simulated : a simulated message has come, and they count: others do not.
    """

    def __init__(self, station: Station, stream: Stream) -> None:
        self._station, self._stream = station, stream
        self.simulated = False
        self._last: State | None = None
        self._st = self._sq = self._changed_ns = self._expires_ns = self._counter = 0

    def take(self, pdu: Any, start_ns: int, now_ns: int) -> State | Measurements | Heartbeat:
        """The message in a ``GoosePDU`` that came at run time `now_ns`; Refused where it does not count."""
        block = self._stream.block
        self._check(pdu)
        check_types(block.members, pdu.all_data)
        if any(member.type in ("INT32", "FLOAT32") for member in block.members):
            self._counter += 1
            return told(block, self._stream.number, pdu.all_data, self._counter)
        poles, test = poles_of(block, pdu.all_data, 0 if self._last is None else self._last.poles)
        return self._state(pdu, poles, test, start_ns, now_ns)

    def _check(self, pdu: Any) -> None:
        stream = self._stream
        if self._station.named:
            for found, wanted, what in (
                (pdu.gocb_ref, stream.control, "gocbRef"),
                (pdu.dat_set, stream.data_set, "datSet"),
                (pdu.go_id, stream.id, "goID"),
            ):
                if found != wanted:
                    raise Refused(f"another {what}")
        if pdu.conf_rev != CONF_REV:
            raise Refused("another confRev")
        if pdu.nds_com:
            raise Refused("needs commissioning (ndsCom)")
        if not 0 < pdu.st_num <= NUMBERS or not 0 <= pdu.sq_num <= NUMBERS:
            raise Refused("stNum or sqNum out of its range")
        if pdu.simulation and not self._station.options.accept_simulation:
            raise Refused("simulated")
        if self.simulated and not pdu.simulation:
            raise Refused("not simulated, as its stream is")
        if pdu.simulation and not self.simulated:
            self.simulated = True
            self._last = None  # another publisher, with numbers of its own

    def _state(self, pdu: Any, poles: int, test: bool, start_ns: int, now_ns: int) -> State:
        dated = not pdu.time_quality & NOT_A_TIME
        changed_ns = round((pdu.timestamp - EPOCH) / timedelta(microseconds=1)) * 1000 - start_ns
        sent_ns = _sent_ns(pdu, changed_ns, now_ns, dated, unheard=self._last is None)
        m = State(
            self._stream.block.kind, self._stream.number, poles,
            pdu.st_num & 0xFF, _narrow(pdu.sq_num), 0, ticks(sent_ns), test,
        )  # fmt: skip
        if self._last is None and now_ns - sent_ns > MAX_AGE_NS:
            return m  # it will be refused, and nothing is to be numbered after it
        if self._last is not None:
            later = changed_ns - self._changed_ns if dated else now_ns - self._expires_ns
            m = self._after(self._last, m, pdu, later if dated or later > 0 else 0)
            if m is None:
                return self._old(self._last, pdu, poles, test, changed_ns)
            if now_ns - sent_ns <= MAX_AGE_NS and _difference(m.time, self._last.time, 1 << 32) < 0:
                m = m._replace(time=self._last.time)
        self._last, self._st, self._sq, self._changed_ns = m, pdu.st_num, pdu.sq_num, changed_ns
        self._expires_ns = now_ns + pdu.time_allowed_to_live * MS
        return m

    def _after(self, last: State, m: State, pdu: Any, later: int) -> State | None:
        """The message with the numbers that follow those of the last one; None where it is not newer.

        `later` is positive where it tells of a later change, or comes after the last one's life without a
        clock; negative where its change is earlier.  A publisher that begins again has lower numbers and a
        later change; one whose clock was set back has higher numbers and an earlier change: both have to be
        borne out.
        """
        step, more = _difference(pdu.st_num, self._st, NUMBERS), pdu.sq_num - self._sq
        if step == 0 and later == 0 and more > 0:
            return m._replace(st_num=last.st_num, counter=(last.counter + more) % P01_COUNTERS)
        if step <= 0 and later <= 0:
            return None
        if step > 0:
            st = last.st_num + (step if later >= 0 and step < 128 else JUMP)
        else:
            st = last.st_num - JUMP
        gone = pdu.sq_num + 1
        counter = last.counter + gone + (gone % P01_COUNTERS == 0)
        return m._replace(st_num=st & 0xFF, counter=counter % P01_COUNTERS)

    def _old(self, last: State, pdu: Any, poles: int, test: bool, changed_ns: int) -> State:
        """A message from before the last one, or the same again: at no later time, so that the numbers
        decide."""
        step, more = _difference(pdu.st_num, self._st, NUMBERS), pdu.sq_num - self._sq
        counter = last.counter + (more if step == 0 else -1)
        time = last.time
        if pdu.sq_num == 0 and _difference(ticks(changed_ns), time, 1 << 32) < 0:
            time = ticks(changed_ns)
        return last._replace(
            poles=poles,
            st_num=last.st_num + max(step, -JUMP) & 0xFF,
            sq_num=_narrow(pdu.sq_num),
            counter=counter % P01_COUNTERS,
            time=time,
            test=test,
        )


def _sent_ns(pdu: Any, changed_ns: int, now_ns: int, dated: bool, *, unheard: bool) -> int:
    """Run time at which a message was sent, as far as it tells [ns].

    The first of a state was sent at the change.  Of a repetition the time is not known, and is taken to be
    that of its coming; but where nothing was heard of the stream before, it is no later than its age allows:
    between two of its messages no more time can have passed than this one is allowed to live.  So a recording
    is seen to be old.
    """
    if not dated:
        return now_ns
    if pdu.sq_num == 0:
        return changed_ns
    longest_ns = changed_ns + pdu.sq_num * pdu.time_allowed_to_live * MS
    return min(longest_ns, now_ns) if unheard else now_ns


def _narrow(sq_num: int) -> int:
    return (sq_num - 1) % 255 + 1 if sq_num else 0


def _difference(a: int, b: int, modulus: int) -> int:
    return (a - b + modulus // 2) % modulus - modulus // 2
