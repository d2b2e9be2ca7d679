"""The nodes' logic without a bus: frames in, frames and commands out."""

from __future__ import annotations

from faultloop.io.can.frames import Frame, Rejection, State, decode
from faultloop.io.can.table import Kind
from faultloop.nodes import BreakerNode, RelayNode

MS = 1_000_000


def relay_node(number: int = 0) -> RelayNode:
    return RelayNode(number, breaker=0, partners=[1], heartbeat_s=1.0, measurements_hz=10.0)


def breaker_node(reports: list[str] | None = None) -> BreakerNode:
    said = [] if reports is None else reports
    return BreakerNode(
        0, relays=[0], closed=7, heartbeat_s=1.0, report=lambda t, level, text: said.append(text)
    )


def states(frames: list[Frame], kind: Kind) -> list[State]:
    messages = [decode(f) for f in frames]
    return [m for m in messages if isinstance(m, State) and m.kind == kind]


def test_a_trip_is_sent_at_once_repeated_and_obeyed_once() -> None:
    relay, breaker = relay_node(), breaker_node()
    for frame in relay.poll(0):
        assert breaker.receive(1000, frame) is None
    relay.set(100 * MS, trip=7, close=0, pilot=0)
    assert relay.next_ns <= 100 * MS
    commands, sent, t = [], 0, 100 * MS
    while t < 400 * MS:
        for frame in relay.poll(t):
            if frame.id == Kind.TRIP:
                sent += 1
            if (command := breaker.receive(t, frame)) is not None:
                commands.append((t, command.operation, command.poles))
        t += MS
    assert commands == [(100 * MS, "open", 7)]
    assert sent >= 7  # at 0, 2, 6, 14, 30, 62, 126, 254 ms


def test_a_lost_first_frame_does_not_lose_the_trip() -> None:
    relay, breaker = relay_node(), breaker_node()
    for frame in relay.poll(0):
        breaker.receive(0, frame)
    relay.set(100 * MS, trip=1, close=0, pilot=0)
    relay.poll(100 * MS)  # lost
    commands = [breaker.receive(102 * MS, f) for f in relay.poll(102 * MS)]
    assert [c.poles for c in commands if c is not None] == [1]


def test_a_breaker_refuses_and_says_why() -> None:
    said: list[str] = []
    breaker = breaker_node(said)
    good = State(Kind.TRIP, 0, 7, 1, 0, 0, 0).encode()
    broken = Frame(good.id, bytes([good.data[0] ^ 1]) + good.data[1:])
    assert breaker.receive(0, broken) is None
    assert said == [f"frame 0x010 refused: {Rejection.CRC.value}"]
    assert breaker.rejected == {Rejection.CRC: 1}
    other = State(Kind.TRIP, 5, 7, 1, 0, 0, 0).encode()  # of a relay that does not command it
    assert breaker.receive(0, other) is None
    assert breaker.rejected == {Rejection.CRC: 1}


def test_the_relay_follows_its_breaker_and_its_partner() -> None:
    relay, breaker = relay_node(), breaker_node()
    assert relay.breaker_closed == 7
    for frame in breaker.poll(0):
        relay.receive(0, frame)
    breaker.set(50 * MS, 6)
    changed = [relay.receive(50 * MS, f) for f in states_as_frames(breaker.poll(50 * MS))]
    assert any(changed)
    assert relay.breaker_closed == 6
    partner = relay_node(1)
    for frame in partner.poll(0):
        relay.receive(60 * MS, frame)
    partner.set(70 * MS, 0, 0, 1)
    for frame in partner.poll(70 * MS):
        relay.receive(70 * MS, frame)
    assert relay.pilot_received == 1


def states_as_frames(frames: list[Frame]) -> list[Frame]:
    return [f for f in frames if isinstance(decode(f), State)]


def test_measurements_come_in_three_pages() -> None:
    relay = relay_node()
    relay.measured[:] = 0.0
    relay.measured[0] = 127e3
    relay.poll(0)
    frames = [f for f in relay.poll(100 * MS) if f.id & ~0xF == Kind.MEASUREMENTS]
    assert len(frames) == 3
    assert {f.data[0] for f in frames} == {0, 1, 2}
