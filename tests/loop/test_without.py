"""A run without one of its breakers: whoever publishes its status on the bus is the breaker."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import faultloop
from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.io.can.frames import Frame, State, decode
from faultloop.io.can.table import Kind
from faultloop.io.can.transport import open_bus, to_message
from faultloop.loop.scenario import load_scenario
from faultloop.nodes.goose import Publisher, Subscriber

AG = Path(__file__).resolve().parents[2] / "scenarios" / "ag-zone1.toml"
START_NS = load_scenario(AG).scenario.start_ns
MS = 1_000_000


class Device:
    """Breaker QA (number 0) by itself: opens `operate_ms` after relay RA's trip; it acts between blocks."""

    def __init__(self, channel: str, operate_ms: float | None, forged: bool = False) -> None:
        self.bus = open_bus(channel=channel)
        self.operate_ms = operate_ms
        self.forged = forged
        self.trip, self.status = Subscriber(), Publisher(Kind.BREAKER_STATUS, 0, poles=7)
        self.opens_ns: int | None = None
        self.opened_ns: int | None = None
        self.now_ns = 0

    def act(self, part: float) -> None:
        self.now_ns = round(part * 0.4e9)
        while (message := self.bus.recv(0)) is not None:
            state = decode(Frame(message.arbitration_id, bytes(message.data)))
            if not isinstance(state, State) or (state.kind, state.number) != (Kind.TRIP, 0):
                continue
            new = self.trip.receive(state, round(message.timestamp * 1e9) - START_NS)
            if new is True and state.poles and self.operate_ms is not None:
                self.opens_ns = self.now_ns + round(self.operate_ms * MS)
        if self.opens_ns is not None and self.opens_ns <= self.now_ns and self.opened_ns is None:
            self.opened_ns = self.now_ns
            self.status.set(0, self.now_ns)
        frame = self.status.poll(self.now_ns)
        if frame is not None:
            frame = frame._replace(data=bytes(8)) if self.forged else frame
            self.bus.send(to_message(frame, self.now_ns))


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> Iterator[str]:
    yield request.node.nodeid


def run_with(device: Device, channel: str) -> faultloop.Result:
    try:
        # as in real time the blocks are short, but nobody is waited for
        return faultloop.run(
            AG, can=f"virtual:{channel}", without=["QA"], progress=device.act, pace=1e6, keep=True
        )
    finally:
        device.bus.shutdown()


def test_the_plant_follows_the_status_of_somebody_elses_breaker(channel: str) -> None:
    device = Device(channel, operate_ms=20)
    result = run_with(device, channel)
    trip = next(t for t in result.trips if t.relay == "RA")
    own = next(t for t in faultloop.run(AG).trips if t.relay == "RA")
    assert trip.received_ns == own.received_ns  # the frame is on the same bus at the same time
    assert device.opened_ns is not None and trip.opened_ns is not None
    # the device's own 20 ms, not the scenario's 40; then the poles' current zeros
    assert 0 < trip.opened_ns - device.opened_ns < 12 * MS
    assert own.opened_ns is not None and trip.opened_ns < own.opened_ns - 8 * MS
    assert any(e.source == "QA" and e.text == "status open, poles ABC" for e in result.events)
    assert result.held


def test_a_device_that_does_not_answer_leaves_its_poles_closed(channel: str) -> None:
    result = run_with(Device(channel, operate_ms=None), channel)
    trips = {t.relay: t for t in result.trips}
    assert trips["RA"].received_ns is not None and trips["RA"].opened_ns is None
    assert trips["RB"].opened_ns is not None  # the other end is the simulation's own
    rows = result.samples("RA")
    assert abs(rows["ia"][-200:]).max() > 1000


def test_a_status_that_fails_its_check_moves_nothing(channel: str) -> None:
    result = run_with(Device(channel, operate_ms=5, forged=True), channel)
    assert next(t for t in result.trips if t.relay == "RA").opened_ns is None
    assert any(e.source == "QA" and "refused: wrong CRC" in e.text for e in result.events)


@pytest.mark.parametrize(
    ("name", "words"),
    [("QAA", r"no breaker 'QAA': did you mean 'QA'\?"), ("RA", "'RA' is a relay; .*: QA, QB")],
)
def test_a_wrong_name(name: str, words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        faultloop.run(AG, without=[name])
    assert call(["run", str(AG), "--log", str(tmp_path / "x.mcap"), "--without", name]) == 2
    assert "--without" in capsys.readouterr().err
