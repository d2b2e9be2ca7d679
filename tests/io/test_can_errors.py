"""Error frames and fault confinement on the bus model, worked by hand in bits."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from faultloop.config.bus_fault import BusFault
from faultloop.io.can.bus import SimulatedBus
from faultloop.io.can.confinement import Controller, StateChange
from faultloop.io.can.faults import WireErrors
from faultloop.io.can.frames import Frame

BIT = 2000  # ns, at 500 kbit/s
# Six times 000001, 0000 and the end: 50 bits, see test_can_bus.py.  Bit 20 is the third zero of a group:
# turned over, the flag has to bring six zeros for the receivers to see it (12 bits of flags), and a recessive
# flag five ones (11).  Bit 23 is the group's stuff bit: turned over, the sixth zero, all flag at once (6).
EMPTY = Frame(0x000, b"")
LOW = Frame(0x001, b"")  # 47 bits; bit 20 likewise: 12


class Scripted:
    """Hits the transmissions that `hits` says, by their number and sender, in the bit at `place`."""

    def __init__(self, hits: Callable[[int, object], bool], place: int = 20) -> None:
        self.hits, self.place, self.count = hits, place, 0

    def hit(self, t_ns: int, frame: Frame, sender: object, bits: int) -> int | None:
        self.count += 1
        return self.place if self.hits(self.count, sender) else None


def first(count: int) -> Scripted:
    return Scripted(lambda n, _: n <= count)


def received_bits(bus: SimulatedBus) -> list[tuple[object, float]]:
    return [(sender, t_ns / BIT) for t_ns, _, sender in bus.advance(10**12)]


@pytest.mark.parametrize(("place", "flags"), [(20, 12), (23, 6)])
def test_one_error_costs_what_was_sent_flags_delimiter_and_intermission(place, flags):
    bus = SimulatedBus(errors=Scripted(lambda n, _: n == 1, place))
    bus.submit(0, EMPTY, "a")
    again = place + 1 + flags + 8 + 3
    assert received_bits(bus) == [("a", again + 49)]
    assert bus.load.errors == 1
    assert bus.load.busy_ns == (again + 50 + 3) * BIT
    assert bus.controllers["a"].tec == 7  # 8, then one less for the frame that went through


def test_an_error_in_the_very_last_bit_brings_the_frame_twice():
    """Receivers take a frame one bit before its sender does: where that bit is hit, it is sent again."""
    bus = SimulatedBus(errors=Scripted(lambda n, _: n == 1, 49))
    bus.submit(0, EMPTY, "a")
    assert received_bits(bus) == [("a", 49), ("a", 50 + 6 + 8 + 3 + 49)]
    bus = SimulatedBus(errors=Scripted(lambda n, _: n == 1, 48))
    bus.submit(0, EMPTY, "a")
    assert received_bits(bus) == [("a", 49 + 6 + 8 + 3 + 49)]


def test_a_frame_of_higher_priority_goes_before_the_retransmission():
    bus = SimulatedBus(errors=first(1))
    bus.submit(0, LOW, "low")
    bus.submit(10 * BIT, EMPTY, "high")
    assert received_bits(bus) == [("high", 44 + 49), ("low", 44 + 53 + 46)]
    assert (bus.controllers["high"].rec, bus.controllers["low"].rec) == (0, 0)  # 1, and one less; none


def test_an_fd_frame_is_cut_in_its_data_phase_and_flagged_at_the_nominal_rate():
    """18 nominal bits, to BRS; ESI 0, DLC 1 1: the second one turned over is a zero; after five bits more of
    the sender's flag, at the data rate, the receivers have six, and flag, too."""
    frame = Frame(0x180, bytes(range(32)), fd=True, brs=True)
    bus = SimulatedBus(500_000, 2_000_000, first(1))
    bus.submit(0, frame, "a")
    again = 18 * BIT + 3 * 500 + 5 * 500 + (6 + 8 + 3) * BIT
    assert bus.advance(10**9)[0].t_ns == again + bus.duration_ns(frame) - BIT


def test_error_passive_after_sixteen_then_suspended():
    """16 times 21 + 12 + 8 + 3 = 44 bits, TEC 128; then 8 more bits before the frame is tried again."""
    bus = SimulatedBus(errors=first(17))
    bus.submit(0, EMPTY, "a")
    passive = 15 * 44 + 21
    seventeenth = 16 * 44 + 8
    assert received_bits(bus) == [("a", seventeenth + 21 + 11 + 8 + 3 + 8 + 49)]
    assert bus.changes == [StateChange(passive * BIT, "a", "error-passive")]
    assert bus.controllers["a"].tec == 17 * 8 - 1


def test_others_use_what_an_error_passive_node_leaves():
    bus = SimulatedBus(errors=first(16))
    bus.submit(0, EMPTY, "passive")
    bus.submit(16 * 44 * BIT, LOW, "other")  # a lower priority, but it may begin 8 bits earlier
    assert received_bits(bus) == [("other", 704 + 46), ("passive", 704 + 50 + 49)]
    # 128 - 1: error-active again with the frame's end
    assert bus.changes[-1] == StateChange((704 + 50 + 50) * BIT, "passive", "error-active")


def off_at_bits() -> int:
    """16 active tries of 44 bits, 15 passive ones of 43, each with 8 bits suspended before it; after 8 more
    the 32nd is cut after 21 bits: TEC 256."""
    return 16 * 44 + 15 * (8 + 43) + 8 + 21


def test_bus_off_after_thirty_two_errors_and_back_after_128_times_11_bits():
    bus = SimulatedBus(errors=first(32))
    bus.submit(0, EMPTY, "a")
    delimiter = off_at_bits() + 11
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
    delimiter = off_at_bits() + 11
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
    assert bus.load.frames.total() == 2000
    assert len(got) == 2001  # one was hit in its last bit
    assert bus.controllers["b"].tec == 0
    assert bus.controllers["b"].rec <= 2
    # each of a's 1000 frames is tried until it goes: 1 / 0.9 times in the mean
    assert errors.hits["B1"] == bus.load.errors == pytest.approx(111, abs=4 * 11.1)


def test_who_is_bus_off_hears_nothing_until_it_is_back():
    bus = SimulatedBus(errors=first(32))
    bus.submit(0, EMPTY, "a")
    back = (off_at_bits() + 11 + 128 * 11) * BIT
    for t_ns, off in ((off_at_bits() * BIT - 30 * BIT, False), (back - 1, True), (back, False)):
        bus.advance(t_ns)
        assert bus.bus_off(t_ns) == (frozenset({"a"}) if off else frozenset())


def test_a_receiver_that_hears_128_errors_is_error_passive_until_it_hears_a_frame():
    one = Controller(BIT)
    for _ in range(127):
        one.heard_error()
    assert one.state == "error-active"
    for _ in range(73):
        one.heard_error()
    assert (one.state, one.rec) == ("error-passive", 200)
    one.heard_frame()
    assert (one.state, one.rec) == ("error-active", 127)  # the standard: a value from 119 to 127


def test_receivers_count_errors_too():
    bus = SimulatedBus(errors=Scripted(lambda n, sender: sender == "a" and n <= 11))
    bus.submit(0, EMPTY, "b")
    bus.submit(0, LOW, "a")
    received_bits(bus)
    assert (bus.controllers["a"].tec, bus.controllers["b"].rec) == (10 * 8 - 1, 10 - 1)
