"""GOOSE: the messages of nodes as streams with numbers of their own, and back."""

from __future__ import annotations

import math
import struct
from collections import Counter
from dataclasses import replace
from datetime import timedelta
from itertools import pairwise
from random import Random
from typing import Any

import pytest

from faultloop.config.bus_fault import BusFault
from faultloop.errors import InputError
from faultloop.io.can.faults import SenderFaults
from faultloop.io.can.frames import (
    Differential,
    Frame,
    Heartbeat,
    Measurements,
    Page,
    Rejection,
    State,
    decode,
    ticks,
)
from faultloop.io.can.table import PLANT_NODE, STATE_KINDS, Kind
from faultloop.io.iec61850.gateway import Gateway
from faultloop.io.iec61850.streams import BLOCKS, Station, ied_names
from faultloop.nodes.breaker import BreakerNode
from faultloop.nodes.goose import Publisher, Repetition, Subscriber
from tests.io.process_bus import MS, START_NS, station

goose = pytest.importorskip("open61850.goose")

TRIP = Kind.TRIP + 0


def gateways(**options: Any) -> tuple[Gateway, Gateway]:
    """Of a publisher and of a subscriber."""
    return Gateway(station(**options), start_ns=START_NS), Gateway(station(**options), start_ns=START_NS)


def passed(out: Gateway, into: Gateway, frame: Frame, t_ns: int, late_ns: int = 10_000) -> list[Any]:
    return [decode(f) for data in out.encode(frame, t_ns) for f in into.decode(data, t_ns + late_ns)]


def pdu_of(data: bytes) -> Any:
    return goose.decode_goose_frame(data, strict=True)[1]


def altered(data: bytes, **fields: Any) -> bytes:
    frame, pdu = goose.decode_goose_frame(data)
    return goose.encode_goose_frame(
        replace(pdu, **fields), dst_mac=frame.dst_mac, src_mac=frame.src_mac, app_id=frame.app_id
    )


@pytest.mark.parametrize("kind", STATE_KINDS)
@pytest.mark.parametrize("test", [False, True])
def test_every_mask_of_poles_comes_through(kind: Kind, test: bool) -> None:
    for poles in range(8):
        out, into = gateways()
        sent = State(kind, 1, poles, 1, 0, 0, ticks(5 * MS), test)
        assert passed(out, into, sent.encode(), 5 * MS) == [sent]


def test_measurements_and_heartbeats_come_through() -> None:
    out, into = gateways()
    beat = Heartbeat(PLANT_NODE, 5, 3, 70, 0xFFFF_FFF0)
    assert passed(out, into, beat.encode(), 0) == [beat]
    for page, values in ((Page.VOLTAGE, (63500.0, 0.0, 100.0)), (Page.FREQUENCY, (49.98, -0.25, math.nan))):
        (got,) = passed(out, into, Measurements(0, page, values, 9).encode(), 0)
        assert (got.number, got.page) == (0, page)
        assert got.values == pytest.approx(values, rel=1e-3, nan_ok=True)


def test_numbers_time_and_life_are_those_of_iec_61850_8_1() -> None:
    """A change at once under a new stNum with sqNum 0 and its time; repetitions from 2 ms on, doubled to the
    heartbeat, each allowed to live for longer than the next one takes."""
    out, _ = gateways(heartbeat_ms=100)
    publisher = Publisher(Kind.TRIP, 0, repetition=Repetition(heartbeat_ns=100 * MS))
    seen = []
    for step in range(40_000):
        t_ns = step * 20_000
        if step == 30_000:
            publisher.set(5, t_ns)
        frame = publisher.poll(t_ns)
        if frame is not None:
            seen += [(t_ns, pdu_of(data)) for data in out.encode(frame, t_ns)]
    assert [(p.st_num, p.sq_num) for _, p in seen[:3]] == [(1, 0), (1, 1), (1, 2)]
    second = [(t, p) for t, p in seen if p.st_num == 2]
    assert [p.sq_num for _, p in second] == list(range(len(second)))
    assert [round((b - a) / MS) for (a, _), (b, _) in pairwise(second)][:6] == [2, 4, 8, 16, 32, 64]
    since = [p.timestamp.timestamp() - START_NS / 1e9 for _, p in second]
    assert since == pytest.approx([0.6] * len(second), abs=1e-6)
    for (a, p), (b, _) in pairwise(second):
        assert (b - a) / MS < p.time_allowed_to_live <= 2 * (b - a) / MS + 3
    assert [value.value for value in second[0][1].all_data[:4]] == [True, True, False, True]
    assert {p.conf_rev for _, p in seen} == {1}
    assert not any(p.nds_com or p.simulation for _, p in seen)


def test_numbers_have_32_bits_where_those_on_can_have_8() -> None:
    out, into = gateways()
    told = []
    for n in range(600):  # states
        told.append(
            pdu_of(out.encode(State(Kind.TRIP, 0, n & 1, (n + 1) & 0xFF, 0, n % 15, n).encode())[0]).st_num
        )
    for n in range(1, 1000):  # repetitions of the last one
        frame = State(Kind.TRIP, 0, 1, 600 & 0xFF, (n - 1) % 255 + 1, n % 15, 600 + n).encode()
        told.append(pdu_of(out.encode(frame)[0]).sq_num)
    assert told == [*range(1, 601), *range(1, 1000)]
    assert not into.refused


FAULTS = {
    "loss": {"probability": 0.2},
    "delay": {"probability": 0.2, "delay_ms": 1.0, "jitter_ms": 4.0},
    "duplication": {"probability": 0.2, "copies": 2},
    "reordering": {"probability": 0.1},
}
STEP_NS = MS // 10


def taken(seed: int, kinds: tuple[str, ...], apart_ns: int) -> tuple[list[tuple[int, int]], ...]:
    """When which state is taken, over CAN and over GOOSE; and which there are, each as long at least."""
    random = Random(seed)
    stage = SenderFaults(seed, [BusFault(name=k, kind=k, **FAULTS[k]) for k in kinds], "RA")  # type: ignore[arg-type]
    repetition = Repetition(heartbeat_ns=50 * MS)
    publisher = Publisher(Kind.TRIP, 0, repetition=repetition)
    out, into = gateways(heartbeat_ms=50)
    by_can, by_goose = Subscriber(repetition), Subscriber(repetition)
    late: list[tuple[int, Frame]] = []
    found: tuple[list[tuple[int, int]], ...] = ([], [], [])
    changed_ns = 0
    for step in range(10_000):
        t_ns = step * STEP_NS
        if random.random() < 0.008 and t_ns - changed_ns > apart_ns:
            changed_ns = t_ns
            publisher.set(random.choice((0, 1, 7)), t_ns)
            found[2].append((t_ns, publisher.poles))
        frame = publisher.poll(t_ns)
        late += [] if frame is None else stage.send(t_ns, frame)
        due = sorted((item for item in late if item[0] <= t_ns), key=lambda item: item[0])
        late = [item for item in late if item[0] > t_ns]
        for _, what in due:
            for place, (subscriber, messages) in enumerate(
                ((by_can, [decode(what)]), (by_goose, passed(out, into, what, t_ns, 0)))
            ):
                for message in messages:
                    assert isinstance(message, State)
                    if subscriber.receive(message, t_ns) is True:
                        found[place].append((t_ns, message.poles))
    assert by_can.poles == by_goose.poles == publisher.poles
    return found


@pytest.mark.parametrize("kinds", [(), *((kind,) for kind in FAULTS), ("loss", "delay")], ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_a_subscriber_takes_the_same_from_goose_as_from_can(seed: int, kinds: tuple[str, ...]) -> None:
    """No delay here is so long that a state is overtaken by the next one."""
    by_can, by_goose, states = taken(seed, kinds, 10 * MS)
    assert by_can == by_goose
    assert len(by_can) > len(states) / 2 > 10


@pytest.mark.parametrize("seed", range(4))
def test_under_all_faults_together_every_state_that_lasts_is_taken(seed: int) -> None:
    """One that a newer one overtakes is over for GOOSE, and may be taken from CAN, whose messages have a
    time."""
    by_can, by_goose, states = taken(seed, tuple(FAULTS), 0)
    changes = [change for before, change in pairwise([(0, 0), *states]) if change[1] != before[1]]
    for (t_ns, poles), (until_ns, _) in pairwise([*changes, (1000 * MS, 0)]):
        if until_ns - t_ns > 40 * MS:
            for found in (by_can, by_goose):
                last = [p for at, p in found if at < until_ns][-1]
                assert last == poles


def test_a_publisher_that_begins_again_is_heard_after_one_more_message() -> None:
    into = gateways()[1]
    subscriber = Subscriber()
    accepted = []
    for begins, poles in ((0, 0), (400, 1)):
        out = gateways()[0]
        publisher = Publisher(Kind.TRIP, 0, poles, begins * MS)
        for t in range(begins, begins + 300):
            frame = publisher.poll(t * MS)
            for got in [] if frame is None else passed(out, into, frame, t * MS):
                if subscriber.receive(got, t * MS + 10_000) is True:
                    accepted.append((t, got.poles))
    assert accepted == [(0, 0), (402, 1)]
    assert subscriber.restarts == 1


def test_a_recording_played_to_a_subscriber_is_old() -> None:
    """One that has heard the stream goes by the numbers; one that has not, by the time of the change and the
    age that the message can have."""
    out, into = gateways()
    publisher = Publisher(Kind.TRIP, 0)
    recorded: list[bytes] = []
    subscriber = Subscriber()
    for t in range(3000):
        publisher.set(7 if 100 <= t < 200 else 0, t * MS)
        frame = publisher.poll(t * MS)
        for data in [] if frame is None else out.encode(frame, t * MS):
            recorded.append(data)
            for f in into.decode(data, t * MS):
                message = decode(f)
                assert isinstance(message, State)
                subscriber.receive(message, t * MS)
    tripping = [data for data in recorded if pdu_of(data).all_data[0].value]
    assert len(tripping) == 6
    fresh, heard = gateways()[1], into
    unheard = Subscriber(start_ns=3000 * MS)
    for t, data in enumerate(tripping, 3001):
        for gateway, own in ((heard, subscriber), (fresh, unheard)):
            for f in gateway.decode(data, t * MS):
                message = decode(f)
                assert isinstance(message, State)
                assert isinstance(own.receive(message, t * MS), Rejection)
    assert subscriber.poles == 0
    assert unheard.poles is None


def test_simulated_messages_count_for_whom_they_are_meant_and_then_no_others() -> None:
    real, simulated = (
        Gateway(station(), start_ns=START_NS),
        Gateway(station(simulation=True), start_ns=START_NS),
    )
    frame = State(Kind.TRIP, 0, 0, 1, 0, 0, 0).encode()
    ordinary, under_test = (
        Gateway(station(), start_ns=START_NS),
        Gateway(station(accept_simulation=True), start_ns=START_NS),
    )
    (shown,), (played,) = real.encode(frame), simulated.encode(frame)
    assert len(ordinary.decode(shown, 0)) == 1
    assert ordinary.decode(played, 0) == []
    assert ordinary.refused == Counter({"simulated": 1})
    assert len(under_test.decode(shown, 0)) == 1
    assert len(under_test.decode(played, 0)) == 1
    assert under_test.decode(shown, 0) == []
    assert under_test.refused == Counter({"not simulated, as its stream is": 1})
    assert played[22] & 0x80 and not shown[22] & 0x80


def _with_bits(place: int, value: bytes) -> Any:
    def change(pdu: Any) -> dict[str, Any]:
        data = list(pdu.all_data)
        data[place] = replace(data[place], value=value)
        return {"all_data": data}

    return change


@pytest.mark.parametrize(
    ("kind", "change", "cause"),
    [
        (Kind.TRIP, {"gocb_ref": "RXLD0/LLN0$GO$gcbTrip"}, "another gocbRef"),
        (Kind.TRIP, {"dat_set": "RALD0/LLN0$dsOther"}, "another datSet"),
        (Kind.TRIP, {"go_id": None}, "another goID"),
        (Kind.TRIP, {"conf_rev": 2}, "another confRev"),
        (Kind.TRIP, {"nds_com": True}, "needs commissioning (ndsCom)"),
        (Kind.TRIP, {"st_num": 0}, "stNum or sqNum out of its range"),
        (Kind.TRIP, lambda p: {"all_data": p.all_data[:-1], "num_dat_set_entries": 4},
         "another number of entries in the data set"),
        (Kind.TRIP, {"num_dat_set_entries": 4}, "malformed (not conformant)"),
        (Kind.TRIP, lambda p: {"all_data": [p.all_data[-1], *p.all_data[1:]]},
         "PTRC1.Tr.general is no BOOLEAN"),
        (Kind.TRIP, lambda p: {"all_data": [replace(p.all_data[0], value=True), *p.all_data[1:]]},
         "general and phases contradict each other"),
        (Kind.TRIP, _with_bits(4, b"\x40\x00"), "quality is not good"),
        (Kind.BREAKER_STATUS, _with_bits(2, b"\xc0"), "a position is bad-state"),
        (Kind.BREAKER_STATUS, _with_bits(3, b"\xc0\x00"), "quality is not good"),
    ],
)  # fmt: skip
def test_what_does_not_count_is_refused_by_its_cause(kind: Kind, change: Any, cause: str) -> None:
    out, into = gateways()
    (data,) = out.encode(State(kind, 0, 0, 1, 0, 0, 0).encode())
    wrong = altered(data, **(change(pdu_of(data)) if callable(change) else change))
    assert into.decode(wrong, 0) == []
    assert into.refused == Counter({cause: 1})


def test_a_pole_between_its_positions_is_where_it_was() -> None:
    out, into = gateways()
    first, second = (
        State(Kind.BREAKER_STATUS, 0, poles, 1 + n, 0, n, n).encode() for n, poles in enumerate((3, 4))
    )
    into.decode(out.encode(first)[0], 0)
    moving = altered(out.encode(second)[0], **_with_bits(2, b"\x00")(pdu_of(out.encode(second)[0])))
    (frame,) = into.decode(moving, 10_000)
    message = decode(frame)
    assert isinstance(message, State)
    assert message.poles == 0b110  # A open, B still closed, C closed


def test_a_clock_that_is_not_set_does_not_order_messages() -> None:
    out, into = gateways()
    frames = [State(Kind.TRIP, 0, n, 1 + n, 0, n, 100 * n).encode() for n in range(2)]
    subscriber = Subscriber()
    for n, frame in enumerate(frames):
        (data,) = out.encode(frame)
        pdu = pdu_of(data)
        data = altered(data, timestamp=pdu.timestamp - timedelta(days=n), time_quality=0x20)
        for f in into.decode(data, 100 * MS + n * MS):
            message = decode(f)
            assert isinstance(message, State)
            assert subscriber.receive(message, 100 * MS + n * MS) is True


def mutations(count: int, seed: int) -> Counter[str]:
    """Messages with random faults in their bytes, played between good ones to a breaker in service.

    Half of them are of the quiescent trip and close streams, as they are or at a later time; the others of a
    position. Returns what became of them.
    """
    random = Random(seed)
    out, into = gateways()
    told: Counter[str] = Counter()
    breaker = BreakerNode(0, [0], 7, 1.0, lambda *_: None)
    publishers = [Publisher(kind, 0) for kind in (Kind.TRIP, Kind.CLOSE)]
    good: list[bytes] = []
    t_ns = 0
    for n in range(count):
        t_ns += random.randrange(1, 3 * MS)
        for publisher in publishers:
            frame = publisher.poll(t_ns)
            if frame is not None:
                good = [*good[-3:], *out.encode(frame, t_ns)]
                for f in into.decode(good[-1], t_ns):
                    assert breaker.receive(t_ns, f) is None
        data = bytearray(random.choice(good))
        for _ in range(random.choice((1, 1, 2, 3, 8))):
            place = random.randrange(len(data))
            match random.randrange(5):
                case 0:
                    data[place] ^= 1 << random.randrange(8)
                case 1:
                    data[place] = random.randrange(256)
                case 2:
                    del data[place : place + random.randrange(1, 9)]
                case 3:
                    data[place:place] = random.randbytes(random.randrange(1, 9))
                case _:
                    data[place:] = data[place:][: random.randrange(8)]
            if not data:
                break
        taken = into.decode(bytes(data), t_ns)
        told["taken" if taken else "not taken"] += 1
        for f in taken:
            if breaker.receive(t_ns, f) is not None:
                told["acted upon"] += 1
        if n % 1000 == 0:
            into.decode(struct.pack("!6s6sHHHHH", b"", b"", 0x88B8, 0x8010, 8, 0, 0), t_ns)
    return told


def test_mutated_messages_neither_trip_nor_crash() -> None:
    told = mutations(4_000, 1)
    assert told["acted upon"] == 0
    assert told["not taken"] > 2_000 < told.total()


@pytest.mark.slow
def test_100_000_mutated_messages_neither_trip_nor_crash() -> None:
    told = mutations(100_000, 2)
    assert told["acted upon"] == 0
    assert told.total() == 100_000


def test_names_are_those_that_scl_takes() -> None:
    assert ied_names(["R-1", "R.1", "21", "RA"]) == ["R_1", "R_1_2", "N21", "RA"]
    one = Station(("R.1", "R-1"), ("Q",), named=True)
    refs = [stream.control for stream in one.streams()]
    assert len(set(refs)) == len(refs)
    addresses = [(s.address.destination, s.address.app_id) for s in Station().streams()]
    assert len(set(addresses)) == len(addresses) == len({a for _, a in addresses})
    # Line differential's phasors are of CAN FD alone: between the ends of a line there is no process bus; and
    # on a process bus the time comes by PTP (IEC 61850-9-3).
    of_can = {Kind.SAMPLED_VALUES, Kind.DIFFERENTIAL, Kind.TIME_SYNC}
    assert {block.kind for block in BLOCKS} == set(Kind) - of_can


def test_what_goose_does_not_carry_is_one_line() -> None:
    out, _ = gateways()
    with pytest.raises(InputError, match=r"GOOSE carries no frame 0x010 \(Rejection\.LENGTH\)"):
        out.encode(Frame(0x010, b"", False))
    with pytest.raises(InputError, match=r"GOOSE carries no frame 0x041 \(Differential\)"):
        out.encode(Differential(1, 0, (1 + 0j, 0j, 0j)).encode())
    with pytest.raises(InputError, match="the scenario has no publisher of TRIP 5"):
        out.encode(State(Kind.TRIP, 5, 0, 1, 0, 0, 0).encode())
