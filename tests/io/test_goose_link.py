"""GOOSE and Sampled Values on an Ethernet interface: a pair of virtual ones, and another stack at its other
end."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from faultloop.errors import InputError
from faultloop.io.can.frames import Heartbeat, SampledValues, State, decode, ticks
from faultloop.io.can.link import Link, TimedLink
from faultloop.io.can.socketcan import open_link
from faultloop.io.can.table import PLANT_NODE, Kind
from faultloop.io.can.transport import open_bus, open_transport
from faultloop.io.iec61850.ethernet import filter_of
from faultloop.io.iec61850.link import GooseLink
from faultloop.io.iec61850.streams import Station
from faultloop.live.clock import RunClock
from faultloop.nodes.breaker import BreakerNode
from tests.io.process_bus import MS, START_NS, station
from tests.veth import needs_veth, veth_pair

pytest.importorskip("open61850")


@pytest.fixture
def pair() -> Iterator[tuple[str, str]]:
    with veth_pair() as names:
        yield names


class At:
    """A run's clock that shows one time."""

    start_ns = START_NS

    def __init__(self, t_ns: int) -> None:
        self.t_ns = t_ns

    def at(self, monotonic_ns: int) -> int:
        return self.t_ns


def link(
    interface: str, identifiers: list[int] | None = None, t_ns: int = 5 * MS, **options: Any
) -> GooseLink:
    opened = GooseLink(interface, identifiers, station(**options))
    assert isinstance(opened, TimedLink)
    opened.attend(At(t_ns))
    return opened


def heard(link: Link, count: int, within_s: float = 5.0) -> list[Any]:
    """What comes, up to `count` messages."""
    messages: list[Any] = []
    until = time.monotonic() + within_s
    while len(messages) < count and time.monotonic() < until:
        messages += [decode(frame) for _, frame in link.receive(0.05)]
    return messages


TRIP = State(Kind.TRIP, 0, 5, 1, 0, 0, ticks(5 * MS))
POSITION = State(Kind.BREAKER_STATUS, 1, 7, 1, 0, 0, ticks(5 * MS))
SAMPLE = SampledValues(1, 20, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), 20, 2)


@needs_veth
def test_messages_go_over_the_wire_and_nobody_hears_himself(pair: tuple[str, str]) -> None:
    here, there = link(pair[0]), link(pair[1], [Kind.BREAKER_STATUS + 1, Kind.SAMPLED_VALUES + 1])
    beside = link(pair[0])  # of another process on the same interface
    for message in (TRIP, POSITION, SAMPLE):
        here.send(message.encode())
    assert heard(there, 2) == [POSITION, SAMPLE]
    assert heard(beside, 3) == [TRIP, POSITION, SAMPLE]
    assert here.receive(0.05) == there.receive(0.05) == []
    assert (here.sent, there.received, here.errors, there.dropped, here.retries) == (3, 2, 0, 0, 0)
    for own in (here, there, beside):
        own.close()


@needs_veth
def test_the_loopback_interface_gives_each_message_once() -> None:
    here, there = link("lo"), link("lo")
    here.send(TRIP.encode())
    assert heard(there, 2, 0.3) == [TRIP]
    here.close()
    there.close()


@needs_veth
def test_a_run_shows_its_messages_and_takes_in_those_of_others(pair: tuple[str, str]) -> None:
    """At the run's time, which is that of its model of the bus, not of the wall clock."""

    class Can:
        interface, channel, bitrate, data_bitrate, fd = "goose", pair[0], 500_000, 2_000_000, False

    other = GooseLink(pair[1], None, Station())
    other.attend(At(0))
    with open_transport(Can(), start_ns=START_NS) as bus:
        bus.submit(0, TRIP._replace(time=0).encode(), "RA")
        bus.advance(MS)
        assert heard(other, 1) == [TRIP._replace(time=0)]
        other.send(POSITION._replace(time=ticks(MS)).encode())
        time.sleep(0.1)
        bus.advance(MS)
        (received,) = bus.advance(3 * MS)
        assert decode(received.frame) == POSITION._replace(time=ticks(MS))
    with open_bus("goose", pair[0]) as third:
        other.send(TRIP._replace(st_num=2, poles=0, counter=1).encode())
        message = third.recv(2.0)
        assert message is not None
        assert message.arbitration_id == Kind.TRIP
    other.close()


@needs_veth
def test_before_the_time_is_known_the_plant_tells_it_and_not_its_samples(pair: tuple[str, str]) -> None:
    here, there = (
        link(pair[0]),
        GooseLink(pair[1], [Kind.SAMPLED_VALUES + 1, Kind.HEARTBEAT + PLANT_NODE], station()),
    )
    beat = Heartbeat(PLANT_NODE, 5, 0, 0, 777)
    here.send(SAMPLE.encode())
    here.send(beat.encode())
    assert heard(there, 1) == [beat]
    assert there.receive(0.05) == []
    there.close()
    foreign = GooseLink(pair[1], [Kind.SAMPLED_VALUES + 1], station(heartbeat_ms=20))
    time.sleep(0.06)  # 2.5 heartbeats without one of a plant
    here.send(SAMPLE._replace(sample_count=4021).encode())
    assert [m.sample_count for m in heard(foreign, 1)] == [21]
    foreign.close()
    here.close()


@needs_veth
@pytest.mark.parametrize(
    ("channel", "words"),
    [
        ("goose:nosuch0", r"^nosuch0: no network interface of this name"),
        ("goose:", r"^--can: 'goose:' is not INTERFACE:CHANNEL"),
        ("gose:lo", r"no CAN interface 'gose'.*did you mean 'goose'"),
    ],
)
def test_what_is_not_there_is_one_line(channel: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        open_link(channel, fd=True)


@needs_veth
def test_an_interface_that_is_down_is_one_line(pair: tuple[str, str]) -> None:
    subprocess.run(["ip", "link", "set", pair[0], "down"], check=True)
    with pytest.raises(InputError, match=rf"^{pair[0]}: the interface is down: ip link set {pair[0]} up$"):
        open_link(f"goose:{pair[0]}", fd=True)


def test_without_the_extra_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open61850", None)
    words = r"^--can: GOOSE and Sampled Values need open61850: pip install 'faultloop\[iec61850\]'$"
    with pytest.raises(InputError, match=words):
        open_link("goose:lo", fd=True)


@needs_veth
def test_a_monitor_without_a_scenario_sees_every_rate_and_name(pair: tuple[str, str]) -> None:
    here, there = link(pair[0], sampling_hz=12800), open_link(f"goose:{pair[1]}", fd=True)
    for n in range(8):
        here.send(SAMPLE._replace(sample_count=12_000 + n).encode())
    here.send(TRIP.encode())
    *samples, trip = heard(there, 9)
    assert [m.sample_count for m in samples] == [12_000 + n for n in range(8)]
    assert (trip.number, trip.poles) == (0, 5)
    here.close()
    there.close()


def passes(program: list[tuple[int, int, int, int]], data: bytes) -> bool:
    """Classic BPF, as far as it is used."""
    place, word = 0, 0
    while True:
        code, true, false, value = program[place]
        place += 1
        if code == 0x28:
            if value + 2 > len(data):
                return False
            word = int.from_bytes(data[value : value + 2], "big")
        elif code == 0x15:
            place += true if word == value else false
        elif code == 0x05:
            place += value
        else:
            return value > 0


def test_the_filter_passes_what_is_wanted_with_a_tag_and_without() -> None:
    program = filter_of((0x88B8, 0x88BA), (0x8010, 0x0041, 0x4001))
    for tag in (b"", b"\x81\x00\x80\x00"):
        for ether_type in (0x88B8, 0x88BA, 0x88B9, 0x0800):
            for app_id in (0x8010, 0x0041, 0x4001, 0x4000):
                data = bytes(12) + tag + ether_type.to_bytes(2, "big") + app_id.to_bytes(2, "big") + bytes(8)
                assert passes(program, data) is (ether_type in (0x88B8, 0x88BA) and app_id != 0x4000)
    assert not passes(program, bytes(13))


# -- another stack at the other end: libiec61850, in a process of its own ------------------------------------

needs_libiec61850 = pytest.mark.skipif(
    importlib.util.find_spec("pyiec61850") is None, reason="needs-libiec61850: pip install pyiec61850-ng"
)


def foreign(*arguments: str) -> subprocess.Popen[str]:
    """The other stack's program; its first line says that it is there."""
    program = Path(__file__).with_name("foreign_goose.py")
    process = subprocess.Popen([sys.executable, program, *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert json.loads(process.stdout.readline()) == "ready"
    return process


def told(process: subprocess.Popen[str]) -> list[dict[str, Any]]:
    out, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    return [json.loads(line) for line in out.splitlines()]


@needs_veth
@needs_libiec61850
def test_another_stack_takes_our_goose(pair: tuple[str, str]) -> None:
    other = foreign("hear", pair[1], "RALD0/LLN0$GO$gcbTrip", str(0x8010), "3")
    here = link(pair[0])
    states = [
        TRIP._replace(poles=0, time=0),
        TRIP._replace(st_num=2, counter=1),
        TRIP._replace(st_num=2, sq_num=1, counter=2),
    ]
    for state in states:
        here.send(state.encode())
        time.sleep(0.1)  # it takes what comes at once for one
    got = told(other)
    here.close()
    # not whether each is valid: that ends after live_ms, sooner than a busy machine may ask
    assert [(m["st_num"], m["sq_num"], m["error"]) for m in got] == [(1, 0, 0), (2, 0, 0), (2, 1, 0)]
    assert [m["live_ms"] for m in got] == [6, 6, 10]
    assert {(m["go_id"], m["data_set"], m["conf_rev"], m["test"], m["needs_commissioning"]) for m in got} == {
        ("RATrip", "RALD0/LLN0$dsTrip", 1, False, False)
    }
    assert [m["values"] for m in got] == [[False] * 4 + [0], *[[True, True, False, True, 0]] * 2]
    assert [m["changed_ms"] - START_NS // MS for m in got] == [0, 5, 5]


@needs_veth
@needs_libiec61850
def test_another_stacks_goose_trips_our_breaker(pair: tuple[str, str]) -> None:
    clock = RunClock.starting_now()
    here = GooseLink(pair[0], [Kind.TRIP], station())
    here.attend(clock)
    breaker = BreakerNode(0, [0], 7, 1.0, lambda *_: None)
    other = foreign("say", pair[1], "RALD0/LLN0$GO$gcbTrip", "RALD0/LLN0$dsTrip", "RATrip", str(0x8010))
    told(other)
    commands = []
    until = time.monotonic() + 1.0
    while time.monotonic() < until:
        commands += [breaker.receive(clock.at(at), frame) for at, frame in here.receive(0.05)]
    here.close()
    assert here.refused == {}
    assert [(c.operation, c.poles) for c in commands if c is not None] == [("open", 5)]
    assert len(commands) == 5


@needs_veth
@needs_libiec61850
def test_another_stack_takes_our_sampled_values(pair: tuple[str, str]) -> None:
    other = foreign("see", pair[1], str(0x4001), "6")
    here = link(pair[0], sampling_hz=4800)
    for n in range(6):
        here.send(SAMPLE._replace(sample_count=4796 + n).encode())
        time.sleep(0.05)
    got = told(other)
    here.close()
    assert [(m["sv_id"], m["count"], m["conf_rev"]) for m in got] == [
        ("RB_MUMU0101", (4796 + n) % 4800, 1) for n in range(6)
    ]
    assert got[0]["values"] == [4000, 0, 5000, 0, 6000, 0, 15000, 0x2000, 100, 0, 200, 0, 300, 0, 600, 0x2000]


@needs_veth
@needs_libiec61850
def test_another_stacks_sampled_values_are_measured(pair: tuple[str, str]) -> None:
    here = link(pair[0], [Kind.SAMPLED_VALUES + 1], t_ns=2000 * MS)
    other = foreign("sample", pair[1], "RB_MUMU0101", str(0x4001), "5")
    told(other)
    got = heard(here, 5)
    here.close()
    assert [m.sample_count for m in got] == [8000 + n for n in range(5)]
    assert got[3].values == pytest.approx((0.04 * 3, 0.05 * 3, 0.06 * 3, 0.003, 0.006, 0.009))
