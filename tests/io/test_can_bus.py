"""The model of the bus: frame lengths bit by bit and by hand, arbitration, times."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.errors import InputError
from faultloop.io.can.bus import SimulatedBus
from faultloop.io.can.frames import Frame
from faultloop.io.can.length import FD_LENGTHS, INTERMISSION, wire_length

reproducible = settings(derandomize=True, deadline=None)
CLASSIC = st.builds(
    lambda identifier, extended, data: Frame(identifier if extended else identifier >> 18, data, extended),
    st.integers(0, 2**29 - 1) | st.sampled_from([0, 2**29 - 1]),
    st.booleans(),
    st.binary(max_size=8) | st.integers(0, 8).map(bytes),
)
FD = st.builds(
    lambda identifier, extended, fill, length, brs: Frame(
        identifier if extended else identifier >> 18, (fill * 64)[:length], extended, True, brs
    ),
    st.integers(0, 2**29 - 1) | st.just(0),
    st.booleans(),
    st.binary(min_size=1, max_size=64),
    st.sampled_from(FD_LENGTHS),
    st.booleans(),
)


def stuffed(bits: str) -> tuple[str, bool]:
    """Bits with stuff bits put in, and whether one is due after the last: the rule, written plainly."""
    out, run = "", ""
    for bit in bits:
        if len(run) == 5:
            run = "1" if run[0] == "0" else "0"
            out += run
        run = run + bit if bit == run[:1] else bit
        out += bit
    return out, len(run) == 5


def crc15(bits: str) -> str:
    """CAN's CRC by long division of the message polynomial, as ISO 11898-1 states it."""
    remainder = [int(bit) for bit in bits] + [0] * 15
    divisor = [int(bit) for bit in f"{0xC599:016b}"]  # x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1
    for place in range(len(bits)):
        if remainder[place]:
            for k, bit in enumerate(divisor):
                remainder[place + k] ^= bit
    return "".join(map(str, remainder[-15:]))


def identifier_bits(frame: Frame) -> str:
    if frame.extended:
        return "0" + f"{frame.id >> 18:011b}" + "11" + f"{frame.id & 0x3FFFF:018b}" + "0"
    return "0" + f"{frame.id:011b}" + "0" + "0"


def data_bits(frame: Frame) -> str:
    return "".join(f"{byte:08b}" for byte in frame.data)


@reproducible
@given(CLASSIC)
def test_classic_length_bit_by_bit(frame):
    reserved = "00" if frame.extended else "0"
    bits = identifier_bits(frame) + reserved + f"{len(frame.data):04b}" + data_bits(frame)
    sent, due = stuffed(bits + crc15(bits))
    assert wire_length(frame) == (len(sent) + due + 1 + 1 + 1 + 7, 0)


@reproducible
@given(FD)
def test_fd_length_bit_by_bit(frame):
    arbitration = identifier_bits(frame) + "10" + ("1" if frame.brs else "0")
    rest = "0" + f"{FD_LENGTHS.index(len(frame.data)):04b}" + data_bits(frame)
    nominal = len(stuffed(arbitration)[0])
    data = len(stuffed(arbitration + rest)[0]) - nominal
    crc = 17 if len(frame.data) <= 16 else 21
    crc_field = "".join("s" + "x" * 4 for _ in range((4 + crc) // 4)) + "s" + "x" * ((4 + crc) % 4)
    data += len(crc_field) + 1
    footer = 1 + 1 + 7
    expected = (nominal + footer, data) if frame.brs else (nominal + data + footer, 0)
    assert wire_length(frame) == expected


def test_hand_worked_frame_without_data():
    """Identifier 0x000, no data: 19 zeros, whose CRC is 15 more zeros, since zero divides by anything.

    34 zeros go out.  A stuff bit follows the fifth; it starts a run of its own, so the next five zeros count
    anew: stuff bits after zeros 5, 10, 15, 20, 25, 30: 6 of them, 40 bits, and 10 more that are not stuffed.
    """
    assert wire_length(Frame(0x000, b"")) == (34 + 6 + 10, 0)


def test_hand_worked_frame_with_one_bit():
    """Identifier 0x001, no data: the message polynomial is x^7, so its CRC is x^22 modulo the generator.

    x^15 is 4599; times x, reduced by C599 where it overflows: 4EAB, 58CF, 7407, 2D97, 5B2E, 73C5, 2213.
    SOF and ID: 11 zeros, stuff bits after the 5th and 10th, then 1.  RTR, IDE, r0, DLC: 7 zeros, a stuff bit
    after the 5th.  CRC 010 0010 0001 0011: no five equal.  34 bits, 3 stuff bits, 10 that are not stuffed.
    """
    assert crc15("0" * 11 + "1" + "0" * 7) == f"{0x2213:015b}"
    assert wire_length(Frame(0x001, b"")) == (34 + 3 + 10, 0)


def test_hand_worked_fd_frame():
    """Identifier 0x000, FD with bit rate switch, one byte 0x00.

    Nominal: SOF, 11 zeros, RRS, IDE: 14 zeros, stuff bits after the 5th and 10th, then FDF 1, res 0, BRS 1:
    14 + 2 + 3 = 19.  Data rate: ESI 0, DLC 0001, then eight zeros with a stuff bit after the fifth: 14, then
    stuff count 4, CRC 17, six fixed stuff bits, CRC delimiter: 28.  Nominal again: ACK 2, end of frame 7.
    """
    assert wire_length(Frame(0x000, b"\x00", fd=True, brs=True)) == (19 + 9, 14 + 28)
    # With data 0x1F... the five ones end the data field: the dynamic stuff bit gives way to the fixed one.
    assert wire_length(Frame(0x000, b"\x1f", fd=True, brs=True)) == (19 + 9, 13 + 28)


@pytest.mark.parametrize(
    ("frame", "bits"),
    [
        (Frame(0x123, bytes(8)), 125),
        (Frame(0x010, bytes.fromhex("1122334455667788")), 115),
        (Frame(0x000, b"", extended=True), 74),
        (Frame(0x000, b"\x01"), 61),
        (Frame(0x1ABCDEF0, b"\xff" * 8, extended=True), 146),
    ],
)
def test_lengths_that_can_utils_counts(frame, bits):
    """As `canbusload -e` of can-utils 2020.11 printed them for these frames, intermission included."""
    assert wire_length(frame).nominal + INTERMISSION == bits


def test_published_bounds():
    # Davis, Burns, Bril, Lukkien (2007), eq. 1: at most (g + 8 s + 13 + floor((g + 8 s - 1) / 4)) bits,
    # intermission included, g = 34 (11-bit) or 54 (29-bit identifiers): 135 and 160 bits for 8 bytes.
    for extended, g in ((False, 34), (True, 54)):
        for size in range(9):
            bound = g + 8 * size + 13 + (g + 8 * size - 1) // 4
            for identifier in (0, 0x78F, 0x7C0):
                for fill in (0x00, 0x0F, 0x3C, 0x78, 0x87, 0xC3, 0xFF):
                    wire = wire_length(Frame(identifier, bytes([fill] * size), extended)).nominal
                    assert g + 8 * size + 13 <= wire + INTERMISSION <= bound
    worst_ns = 135 * 1_000_000_000 // 500_000
    assert worst_ns == 270_000


def test_the_worst_pattern_comes_near_the_bound():
    lengths = [
        wire_length(Frame(identifier, bytes([first] + [second] * 7))).nominal + INTERMISSION
        for identifier in (0x000, 0x78, 0x3C1, 0x7C1)
        for first in range(256)
        for second in (0x0F, 0x1E, 0x3C, 0x78, 0xF0, 0xE1, 0xC3, 0x87)
    ]
    assert 130 <= max(lengths) <= 135


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (Frame(0x800, b""), "11 bits"),
        (Frame(1 << 29, b"", True), "29 bits"),
        (Frame(1, bytes(9)), "0 to 8"),
        (Frame(1, bytes(9), fd=True), "12, 16"),
        (Frame(1, b"", brs=True), "bit rate switch"),
    ],
)
def test_impossible_frames_are_refused(frame, words):
    with pytest.raises(InputError, match=words):
        SimulatedBus().submit(0, frame)


def bit_ns(bus: SimulatedBus, bits: int) -> int:
    return bits * 1_000_000_000 // bus.bitrate


def test_a_frame_is_received_one_bit_before_its_end():
    bus, frame = SimulatedBus(500_000), Frame(0x10, bytes(8))
    bus.submit(1000, frame, "r")
    length = wire_length(frame).nominal
    due = 1000 + bit_ns(bus, length - 1)
    assert bus.next_event_ns() == due
    assert bus.advance(due - 1) == []
    assert bus.advance(due) == [(due, frame, "r")]
    assert bus.next_event_ns() is None


def test_bit_rate_switch():
    frame = Frame(0x180, bytes(range(32)), fd=True, brs=True)
    nominal, data = wire_length(frame)
    bus = SimulatedBus(500_000, 4_000_000)
    assert bus.duration_ns(frame) == nominal * 2000 + data * 250
    assert data > 32 * 8 + 4 + 21 + 7 + 1


def test_arbitration_and_intermission():
    bus = SimulatedBus(500_000)
    low, trip, status = Frame(0x700, bytes(8)), Frame(0x010, bytes(8)), Frame(0x100, bytes(8))
    bus.submit(0, low)
    bus.submit(10_000, status)
    bus.submit(20_000, trip)  # later than the status, but it wins when the bus gets idle
    got = bus.advance(10_000_000)
    assert [delivery.frame for delivery in got] == [low, trip, status]
    first, second, third = (wire_length(delivery.frame).nominal for delivery in got)
    start = bit_ns(bus, first + 3)
    assert got[1].t_ns == start + bit_ns(bus, second - 1)
    assert got[2].t_ns == start + bit_ns(bus, second + 3 + third - 1)
    assert bus.load.longest_wait_ns[0x010] == start - 20_000
    assert bus.load.over(10_000_000) == pytest.approx(bit_ns(bus, first + second + third + 9) / 10_000_000)


def test_base_format_beats_extended_with_the_same_first_bits():
    bus = SimulatedBus()
    base, extended = Frame(0x123, b"\x01"), Frame(0x123 << 18, b"\x02", True)
    bus.submit(0, extended)
    bus.submit(0, base)
    assert [delivery.frame for delivery in bus.advance(10**7)] == [base, extended]


def test_same_identifier_goes_in_order_of_submission():
    bus = SimulatedBus()
    frames = [Frame(0x123, bytes([n])) for n in range(5)]
    for n, frame in enumerate(frames):
        bus.submit(0, frame, n)
    assert [delivery.frame for delivery in bus.advance(10**7)] == frames


def test_a_frame_of_higher_priority_at_the_same_instant_still_wins():
    bus = SimulatedBus()
    bus.submit(5000, Frame(0x700, b""))
    assert bus.advance(5000) == []
    bus.submit(5000, Frame(0x010, b""))
    assert [delivery.frame.id for delivery in bus.advance(10**7)] == [0x010, 0x700]
    with pytest.raises(ValueError, match="but the bus is at"):
        bus.submit(0, Frame(0x010, b""))


SCHEDULE = st.lists(
    st.tuples(st.integers(0, 3_000_000), st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=20
)


@reproducible
@given(SCHEDULE, st.lists(st.integers(20_000, 900_000), min_size=1, max_size=10))
def test_same_arrivals_whatever_the_steps(schedule, steps):
    schedule = sorted(schedule)
    at_once = SimulatedBus()
    for t_ns, identifier, data in schedule:
        at_once.submit(t_ns, Frame(identifier, data))
    expected = at_once.advance(10**9)
    assert len(expected) == len(schedule)

    stepped, got, now, i = SimulatedBus(), [], 0, 0
    pending = list(schedule)
    while pending or stepped.next_event_ns() is not None:
        until = now + steps[i % len(steps)]
        i += 1
        while pending and pending[0][0] < until:
            t_ns, identifier, data = pending.pop(0)
            stepped.submit(t_ns, Frame(identifier, data))
        state = stepped.save()
        ahead = stepped.advance(until + 10**6)
        stepped.restore(state)
        block = stepped.advance(until)
        assert ahead[: len(block)] == block or pending
        got += block
        now = until
    assert got == expected
    assert stepped.load == at_once.load
    gaps = [later.t_ns - earlier.t_ns for earlier, later in pairwise(got)]
    assert all(gap >= 47 * 2000 for gap in gaps)  # no two frames overlap
