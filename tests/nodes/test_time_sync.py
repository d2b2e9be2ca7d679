"""The time of a bus: clocks that follow SYNC and follow-up, against the closed form of their error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from faultloop.config.time_sync import TimeSync
from faultloop.errors import InputError
from faultloop.io.can.frames import Frame, Rejection, decode
from faultloop.io.can.frames import TimeSync as Message
from faultloop.loop.scenario import Scenario
from faultloop.nodes.clock import FOREVER
from faultloop.nodes.master import TimeMaster
from faultloop.nodes.node import Node
from faultloop.nodes.relay import RelayNode
from faultloop.nodes.time_sync import clock_first, has_time_first
from faultloop.study.suites.schemes.network import single_line

MS, SECOND = 1_000_000, 1_000_000_000
FRAME_NS = 230_000


def slave(number: int, clock: tuple[int, int] = (0, 0), deaf_ns: int = FOREVER, **table: Any) -> RelayNode:
    node = RelayNode(number, None, [], 1.0, 0.0)
    node.set_clock(*clock, deaf_ns)
    node.follow_time(TimeSync(**table), 7 + number, deaf_ns)
    return node


def error_us(node: Node, t_ns: int) -> float:
    """Of a node's clock."""
    return clock_first(node.nodes.node, t_ns) - t_ns / 1000


def run(
    nodes: Sequence[Any],
    until_ns: int,
    look: Callable[[int], None] = lambda t_ns: None,
    befall: Callable[[int, Frame], Sequence[Frame]] = lambda t_ns, frame: [frame],
) -> None:
    """Each frame waits for up to 3 ms for the bus, and has ended everywhere at once; ``look`` each 5 ms."""
    wire: list[tuple[int, Frame]] = []
    t_ns, sent = 0, 0
    while t_ns <= until_ns:
        for due_ns, frame in [item for item in wire if item[0] <= t_ns]:
            for got in befall(due_ns, frame):
                for node in nodes:
                    node.take(due_ns, got)
        wire = [item for item in wire if item[0] > t_ns]
        for node in nodes:
            for frame in node.poll(t_ns) if node.next_ns <= t_ns else ():
                if frame.id == 0x0F0:
                    sent += 1
                    wire.append((t_ns + FRAME_NS + (sent * 7 % 31) * MS // 10, frame))
        if t_ns % (5 * MS) == 0:
            look(t_ns)
        due = [item[0] for item in wire] + [node.next_ns for node in nodes]
        t_ns = min([t for t in due if t > t_ns] + [t_ns // (5 * MS) * 5 * MS + 5 * MS])


@pytest.mark.parametrize(
    ("period_s", "jitter_us", "ppm"),
    [(0.1, 0.0, 100), (0.1, 1.0, 100), (0.1, 10.0, 100), (1.0, 1.0, 100), (0.1, 100.0, 0)],
)
def test_the_error_is_two_jitters_and_what_drifts_in_a_period(
    period_s: float, jitter_us: float, ppm: float
) -> None:
    """However long a frame waits for the bus: 2 j + ppm (period + wait)."""
    table: dict[str, Any] = {"period_s": period_s, "jitter_us": jitter_us, "jump_us": 1000.0}
    clocks = (0, 0), (123_456_789, round(ppm * 1000)), (-90_000_000, round(-ppm * 1000))
    slaves = [slave(n, clock, **table) for n, clock in enumerate(clocks)]
    seen: list[float] = []

    def look(t_ns: int) -> None:
        if t_ns > 20 * MS:
            seen.extend(abs(error_us(node, t_ns)) for node in slaves)

    run([TimeMaster(TimeSync(**table), 1), *slaves], 4 * SECOND, look)
    # 0.5 us: the clock is read in whole microseconds
    assert max(seen) <= 2 * jitter_us + ppm * (period_s + 0.008) + 0.5
    assert max(seen) >= 0.9 * ppm * period_s
    assert all(has_time_first(node.nodes.node, 4 * SECOND) for node in slaves)


def test_before_the_first_follow_up_there_is_no_time() -> None:
    node = slave(0, (5 * MS, 0))
    assert not has_time_first(node.nodes.node, 0)
    run([TimeMaster(TimeSync(), 1), node], 10 * MS)
    assert has_time_first(node.nodes.node, 10 * MS)


def test_a_time_that_is_not_told_any_more_is_lost_after_its_timeout() -> None:
    table: dict[str, Any] = {"timeout_s": 0.25, "out_at_s": 1.05}
    node = slave(0, (0, 100_000), **table)
    lost: list[int] = []

    def look(t_ns: int) -> None:
        if t_ns > 20 * MS and not has_time_first(node.nodes.node, t_ns):
            lost.append(t_ns)

    run([TimeMaster(TimeSync(**table), 1), node], 2 * SECOND, look)
    assert 1.25 < lost[0] / SECOND < 1.27
    assert 90 < error_us(node, 2 * SECOND) < 105  # 100 ppm since the last one


def test_one_that_hears_none_any_more() -> None:
    node = slave(0, deaf_ns=500 * MS)
    run([TimeMaster(TimeSync(), 1), node], 1 * SECOND)
    assert not has_time_first(node.nodes.node, 1 * SECOND)


def test_a_time_that_jumps_is_refused_until_it_has_stood() -> None:
    """And who has not heard of it has none by the time that it is taken."""
    table: dict[str, Any] = {"step_at_s": 1.05, "step_us": 50_000.0}
    hears, heard_not = slave(0, **table), slave(1, **table)
    master = TimeMaster(TimeSync(**table), 1)
    times: dict[str, list[int]] = {"none": [], "new": [], "both": []}

    def look(t_ns: int) -> None:
        if t_ns < 20 * MS:
            return
        new = error_us(hears, t_ns) > 40_000
        has = has_time_first(hears.nodes.node, t_ns)
        if not has:
            times["none"].append(t_ns)
        if new and has:
            times["new"].append(t_ns)
            if has_time_first(heard_not.nodes.node, t_ns) and error_us(heard_not, t_ns) < 40_000:
                times["both"].append(t_ns)

    class Deaf:
        """Hears nothing from the step on."""

        next_ns = FOREVER

        def take(self, t_ns: int, frame: Frame) -> None:
            if t_ns < 1.05 * SECOND:
                heard_not.take(t_ns, frame)

        def poll(self, t_ns: int) -> list[Frame]:
            return []

    run([master, hears, Deaf()], 2 * SECOND, look)
    assert 1.1 < times["none"][0] / SECOND < 1.11
    assert times["none"][-1] < times["new"][0]
    assert 1.44 < times["new"][0] / SECOND < 1.56
    assert not times["both"]
    assert hears.rejected[Rejection.JUMP] >= 3


@pytest.mark.parametrize(
    "kind", ["replayed", "again", "follow-up of another", "other domain", "corrupted", "lost"]
)
def test_what_is_not_the_masters_sets_no_clock(kind: str) -> None:
    old: list[Frame] = []

    def befall(t_ns: int, frame: Frame) -> Sequence[Frame]:
        message = decode(frame)
        assert isinstance(message, Message)
        old.append(frame)
        if t_ns < 300 * MS:
            return [frame]
        if kind == "replayed":  # a whole pair of a while ago, after the true follow-up
            return [frame, old[0], old[1]] if message.follow_up else [frame]
        if kind == "again":  # the same SYNC, before its follow-up, and the follow-up, too
            return [frame, frame]
        if kind == "follow-up of another":
            return [frame, message._replace(sequence=(message.sequence + 5) % 16).encode()]
        if kind == "other domain":
            return [frame, message._replace(domain=3, time=5).encode()]
        if kind == "corrupted":
            return [frame, frame._replace(data=bytes((*frame.data[:7], frame.data[7] ^ 1)))]
        return [] if message.follow_up and message.sequence % 2 else [frame]

    node = slave(0, (0, 50_000))
    worst: list[float] = []
    run(
        [TimeMaster(TimeSync(), 1), node],
        2 * SECOND,
        lambda t_ns: worst.append(abs(error_us(node, t_ns))),
        befall,
    )
    assert max(worst[4:]) < 50 * (0.2 if kind == "lost" else 0.1) * 1.1 + 1
    refused = {
        "replayed": Rejection.JUMP,
        "again": Rejection.SEQUENCE,
        "corrupted": Rejection.CRC,
        "follow-up of another": Rejection.SEQUENCE,
    }
    if kind in refused:
        assert node.rejected[refused[kind]] > 10


@pytest.mark.parametrize(
    ("table", "why"),
    [
        ({"period_s": 1.0, "timeout_s": 0.5}, "time_sync: timeout_s must be above period_s, 1 s, not 0.5"),
        ({"out_for_s": 0.5}, "time_sync: out_for_s needs out_at_s"),
        ({"step_us": 5.0}, "time_sync: step_at_s and step_us go together"),
    ],
)
def test_bad_input_is_one_line(table: dict[str, float], why: str) -> None:
    with pytest.raises(InputError) as error:
        Scenario.from_dict(single_line(time_sync=table))
    assert str(error.value) == why
