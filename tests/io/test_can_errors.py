"""Error frames and fault confinement on the bus model, worked by hand in bits."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from faultloop.busfault import BusFault
from faultloop.io.can.bus import SimulatedBus
from faultloop.io.can.confinement import StateChange, WireError
from faultloop.io.can.faults import WireErrors
from faultloop.io.can.frames import Frame
from faultloop.io.can.length import wire_length

BIT = 2000  # ns, at 500 kbit/s
EMPTY = Frame(0x000, b"")  # 50 bits, see test_can_bus.py
LOW = Frame(0x001, b"")  # 47 bits


class Scripted:
    """Hits the transmissions that `hits` says, by their number and sender, after 21 bits, flags of 6 bits."""

    def __init__(self, hits: Callable[[int, object], bool], flag_bits: int = 6) -> None:
        self.hits, self.flag_bits, self.count = hits, flag_bits, 0

    def hit(self, t_ns: int, frame: Frame, sender: object, bits: int) -> WireError | None:
        self.count += 1
        return WireError(21, self.flag_bits) if self.hits(self.count, sender) else None


def first(count: int) -> Scripted:
    return Scripted(lambda n, _: n <= count)


def received_bits(bus: SimulatedBus) -> list[tuple[object, float]]:
    return [(sender, t_ns / BIT) for t_ns, _, sender in bus.advance(10**12)]


@pytest.mark.parametrize("flag_bits", [6, 12])
def test_one_error_costs_what_was_sent_flags_delimiter_and_intermission(flag_bits):
    bus = SimulatedBus(errors=Scripted(lambda n, _: n == 1, flag_bits))
    bus.submit(0, EMPTY, "a")
    again = 21 + flag_bits + 8 + 3
    assert received_bits(bus) == [("a", again + 49)]
    assert bus.load.errors == 1
    assert bus.load.busy_ns == (again + 50 + 3) * BIT
    assert bus.controllers["a"].tec == 7  # 8, then one less for the frame that went through


def test_a_frame_of_higher_priority_goes_before_the_retransmission():
    bus = SimulatedBus(errors=first(1))
    bus.submit(0, LOW, "low")
    bus.submit(10 * BIT, EMPTY, "high")
    assert received_bits(bus) == [("high", 38 + 49), ("low", 38 + 53 + 46)]


def test_an_fd_frame_is_cut_in_proportion_and_flagged_at_the_nominal_rate():
    frame = Frame(0x180, bytes(range(32)), fd=True, brs=True)
    bus = SimulatedBus(500_000, 2_000_000, first(1))
    bus.submit(0, frame, "a")
    bits, whole = sum(wire_length(frame)), bus.duration_ns(frame)
    cut = whole * 21 // bits
    assert bus.advance(10**9)[0].t_ns == cut + (6 + 8 + 3) * BIT + whole - BIT


def test_error_passive_after_sixteen_then_longer_flags_and_suspended():
    """16 times 21 + 6 + 8 + 3 = 38 bits, TEC 128; then 8 more bits before the frame is tried again."""
    bus = SimulatedBus(errors=first(17))
    bus.submit(0, EMPTY, "a")
    passive = 15 * 38 + 21
    # the 17th: the passive flag of 6 recessive bits, then the others' of 6 dominant ones
    seventeenth = 16 * 38 + 8
    assert received_bits(bus) == [("a", seventeenth + 21 + 12 + 8 + 3 + 8 + 49)]
    assert bus.changes == [StateChange(passive * BIT, "a", "error-passive")]
    assert bus.controllers["a"].tec == 17 * 8 - 1


def test_others_use_what_an_error_passive_node_leaves():
    bus = SimulatedBus(errors=first(16))
    bus.submit(0, EMPTY, "passive")
    bus.submit(16 * 38 * BIT, LOW, "other")  # a lower priority, but it may begin 8 bits earlier
    assert received_bits(bus) == [("other", 608 + 46), ("passive", 608 + 50 + 49)]
    # 128 - 1: error-active again with the frame's end
    assert bus.changes[-1] == StateChange((608 + 50 + 50) * BIT, "passive", "error-active")


def off_at_bits() -> int:
    """16 active tries of 38 bits, 15 passive ones of 52, 8 bits suspended before the first of those, then the
    32nd is cut after 21 bits: TEC 256."""
    return 16 * 38 + 8 + 15 * 52 + 21


def test_bus_off_after_thirty_two_errors_and_back_after_128_times_11_bits():
    bus = SimulatedBus(errors=first(32))
    bus.submit(0, EMPTY, "a")
    delimiter = off_at_bits() + 12
    back = delimiter + 128 * 11
    assert received_bits(bus) == [("a", back + 49)]
    assert bus.changes[1:] == [
        StateChange(off_at_bits() * BIT, "a", "bus-off"),
        StateChange(back * BIT, "a", "error-active"),
    ]
    assert bus.controllers["a"].tec == 0


def test_on_a_busy_bus_each_frame_gives_one_sequence_only():
    """After a frame 1 + 7 + 3 recessive bits: 11; another frame begins at once, so no more are counted."""
    bus = SimulatedBus(errors=Scripted(lambda _, sender: sender == "a"))
    bus.submit(0, EMPTY, "a")
    bus.advance((off_at_bits() + 1) * BIT)
    others = 100
    for _ in range(others):
        bus.submit(bus.now_ns, LOW, "b")
    bus.errors = None
    delimiter = off_at_bits() + 12
    # the error frame's delimiter and intermission: the first sequence; then 50 bits for each frame, one each
    last_run = delimiter + 11 + others * 50 - 11
    back = last_run + (128 - others) * 11
    assert received_bits(bus)[-1] == ("a", back + 49)


def test_saved_and_restored_with_its_errors():
    faults = [BusFault(name="B1", kind="bit_error", probability=0.5)]
    bus = SimulatedBus(errors=WireErrors(1, faults))
    for i in range(50):
        bus.submit(i * BIT, EMPTY, "a")
    bus.advance(5000 * BIT)
    state = bus.save()
    first_time = bus.advance(10**9), bus.load, bus.changes
    bus.restore(state)
    assert (bus.advance(10**9), bus.load, bus.changes) == first_time


def test_errors_by_probability_cost_nobody_a_frame():
    errors = WireErrors(1, [BusFault(name="B1", kind="bit_error", probability=0.1, node="a")])
    bus = SimulatedBus(errors=errors)
    for i in range(2000):
        bus.submit(i * 100 * BIT, EMPTY._replace(id=i % 7), "a" if i % 2 else "b")
    got = received_bits(bus)
    assert len(got) == 2000
    assert set(bus.controllers) == {"a"}
    # each of a's 1000 frames is tried until it goes: 1 / 0.9 times in the mean
    assert errors.hits["B1"] == bus.load.errors == pytest.approx(111, abs=4 * 11.1)
