"""The example of a user's own breaker node does what it says."""

from __future__ import annotations

import threading
from pathlib import Path
from types import ModuleType

import can
import pytest

import faultloop
from faultloop.io.can.frames import Frame, State, decode
from faultloop.io.can.table import Kind
from faultloop.io.can.transport import open_bus
from faultloop.nodes.goose import Subscriber
from tests.load import load


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return load("examples/my_breaker.py")


class Sent:
    """A bus that keeps what is sent."""

    def __init__(self) -> None:
        self.states: list[State] = []

    def send(self, message: can.Message) -> None:
        state = decode(Frame(message.arbitration_id, bytes(message.data)))
        assert isinstance(state, State)
        self.states.append(state)


def message(state: State, broken: bool = False) -> can.Message:
    frame = state.encode()
    data = bytes([frame.data[0] ^ broken, *frame.data[1:]])
    return can.Message(arbitration_id=frame.id, data=data, is_extended_id=False)


def test_it_acts_on_good_new_frames_only_and_once(example: ModuleType) -> None:
    bus = Sent()
    breaker = example.MyBreaker(bus, operate_s=0.0)
    idle = State(Kind.TRIP, 0, 0, 1, 0, 0, 1000)
    trip = State(Kind.TRIP, 0, 7, 2, 0, 1, 2000)
    for refused in (message(trip, broken=True), message(trip._replace(test=True))):
        breaker.receive(refused)
        assert breaker.last is None and breaker.opens is None
    breaker.receive(message(idle))
    breaker.poll()
    breaker.receive(message(trip._replace(time=900)))  # a replay: not later than what was accepted
    breaker.receive(message(trip._replace(counter=0)))  # the counter stands still
    breaker.receive(message(trip._replace(number=1)))  # another relay's
    assert breaker.opens is None
    breaker.receive(message(trip))
    breaker.poll()
    assert [s.poles for s in bus.states] == [7, 0]
    breaker.receive(message(trip._replace(sq_num=1, counter=2, time=2200)))  # a repetition
    assert breaker.opens is None


def test_what_it_publishes_is_accepted(example: ModuleType) -> None:
    bus = Sent()
    breaker = example.MyBreaker(bus)
    breaker.receive(message(State(Kind.TRIP, 0, 0, 1, 0, 0, 0)))
    subscriber = Subscriber()
    for ms in range(3000):
        breaker.clock = ms / 1e3  # ahead of the clock itself: as if the time had passed
        breaker.poll()
    taken = [subscriber.receive(s, s.time * 10_000) for s in bus.states]
    assert taken == [True] + [False] * (len(taken) - 1)
    assert 10 <= len(taken) <= 13  # 0, 2, 6, 14, ... 1022, 2022 ms
    assert subscriber.lost == 0 and subscriber.restarts == 0


def test_it_takes_a_breakers_place_in_a_run(example: ModuleType, root: Path) -> None:
    channel = "test-my-breaker"
    ended = threading.Event()
    with open_bus(channel=channel) as bus:
        breaker = example.MyBreaker(bus, pace=0.25)

        def serve() -> None:
            while not ended.is_set():
                breaker.step()

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            scenario = root / "scenarios" / "ag-zone1.toml"
            result = faultloop.run(scenario, can=f"virtual:{channel}", pace=0.25, without=["QA"])
        finally:
            ended.set()
            thread.join(10)
    trip = next(t for t in result.trips if t.relay == "RA")
    assert breaker.closed == set()
    assert trip.received_ns is not None and trip.opened_ns is not None
    assert trip.opened_ns > trip.received_ns
    assert any(e.source == "QA" and e.text == "status open, poles ABC" for e in result.events)


def test_thirty_lines_do_it_too(faultloop_bus, root: Path) -> None:
    thirty = load("examples/breaker_in_30_lines.py")
    breaker = thirty.Breaker(faultloop_bus.open(), pace=0.25)
    faultloop_bus.serve(breaker.step)
    run = faultloop_bus.run(root / "scenarios" / "ag-zone1.toml", pace=0.25, without=["QA"])
    assert run.trip("RA", within_ms=30).opened_ms > 30
    assert breaker.status.poles == 0
    assert run.frames("BREAKER_STATUS", number=0)[-1].poles == ""
