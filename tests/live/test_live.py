"""The nodes of a real bus without one: their time, their samples, their logs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.io.can.frames import Frame, SampledValues, decode
from faultloop.io.mcap_reader import MOST_NS, Log
from faultloop.io.mcap_writer import LogWriter
from faultloop.live.clock import SECOND_NS, RunClock
from faultloop.live.merge import STRETCH_NS, merge
from faultloop.live.stream import WAITS, BesideStream, SampleStream, quantised
from faultloop.live.supervisor import run_processes
from faultloop.loop.pacing import Deadlines, Percentiles
from faultloop.loop.scenario import Scenario
from faultloop.nodes.plant import PlantNode
from tests.live.in_one_process import OneProcess

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
HZ, CYCLE = 4800, 96


def sample(count: int, value: float = 1.0) -> Frame:
    return SampledValues(0, count, (value,) * 6, count & 0xFF).encode()


def at(count: int) -> int:
    return count * SECOND_NS // HZ


def fed(stream: SampleStream, counts: list[int]) -> list[bool]:
    return [stream.receive(at(count), sample(count, float(count))) for count in counts]


def test_samples_come_as_unbroken_rows():
    stream = SampleStream(HZ, CYCLE)
    assert all(fed(stream, list(range(5))))
    ((first, rows),) = stream.take()
    assert first == 0
    assert rows[:, 0].tolist() == [0, 1, 2, 3, 4]
    assert stream.take() == []
    fed(stream, [5, 6])
    ((first, rows),) = stream.take()
    assert (first, len(rows)) == (5, 2)


def test_a_short_gap_is_bridged_by_a_straight_line_and_counted():
    stream = SampleStream(HZ, CYCLE)
    fed(stream, [0, 1, 4])
    ((_, rows),) = stream.take()
    assert rows[:, 3].tolist() == [0, 1, 2, 3, 4]
    assert (stream.lost, stream.bridged) == (2, 2)


def test_after_a_long_gap_rows_begin_anew_at_a_whole_cycle():
    stream = SampleStream(HZ, CYCLE)
    fed(stream, [0, 1, *range(10, CYCLE + 2)])
    (first, _), (second, rows) = stream.take()
    assert (first, second) == (0, CYCLE)
    assert rows[:, 0].tolist() == [CYCLE, CYCLE + 1]
    assert stream.lost == 8
    assert stream.bridged == 0


def test_what_is_no_new_valid_sample_is_refused_and_counted():
    stream = SampleStream(HZ, CYCLE)
    fed(stream, [0, 1, 2])
    good = sample(3)
    damaged = good._replace(data=good.data[:-1] + bytes([good.data[-1] ^ 1]))
    bad = [damaged, good._replace(data=good.data[:-1]), sample(2), sample(3, math.nan), sample(3 + 2 * HZ)]
    for frame in bad:
        assert not stream.receive(at(3), frame)
    assert stream.rejected == len(bad)
    assert stream.receive(at(3), good)


def test_the_parallel_lines_residual_current_goes_with_the_sample_of_its_number():
    """What `sample` makes has its value in all six channels: 3 i0 is three times it."""
    own, beside = SampleStream(HZ, CYCLE), BesideStream(HZ, CYCLE)
    fed(own, [0, 1, 2])
    for k in (0, 1):
        beside.receive(at(k), sample(k, 10.0 * k))
    ((first, rows),) = beside.join(own.take())
    assert (first, rows[:, 0].tolist(), rows[:, -1].tolist()) == (0, [0, 1], [0, 30])
    assert np.isnan(rows[:, 6:9]).all()
    assert beside.join(own.take()) == []  # sample 2 waits
    beside.receive(at(2), sample(2, 20.0))
    ((first, rows),) = beside.join(own.take())
    assert (first, rows[:, -1].tolist()) == (2, [60])
    fed(own, list(range(3, 3 + WAITS + 2)))  # the other is silent: two have waited long enough
    ((first, rows),) = beside.join(own.take())
    assert (first, len(rows)) == (3, 2) and np.isnan(rows[:, -1]).all()
    fed(own, [3 + WAITS + 2])
    ((first, rows),) = beside.join(own.take())
    assert (first, len(rows)) == (5, 1)


def test_the_clock_runs_at_its_pace_and_names_whole_microseconds():
    clock = RunClock(1_000, 5_000, 0.25)
    assert clock.at(1_000 + 4 * SECOND_NS) == SECOND_NS
    assert clock.at(0) == -250
    scenario = faultloop.load_scenario(SCENARIOS / "ag-zone1.toml")
    now = RunClock.starting_now()
    assert now.started(scenario).scenario.start_ns == now.start_ns


def test_a_deadline_is_missed_where_a_sample_comes_after_the_next_is_due():
    late = Deadlines(at(1))
    for k, by in enumerate((0, at(1), at(1) + 1, 5 * at(1))):
        late.note(at(k), at(k) + by)
    assert late.missed == 2
    wall = Percentiles.of(late.late_ns, pace=0.5)
    assert (wall.count, wall.greatest) == (4, pytest.approx(10 * at(1) / 1e6))


def test_logs_are_merged_in_order_of_time_and_a_killed_ones_is_recovered(tmp_path):
    start_ns = 10**18
    early = LogWriter(tmp_path / "RX.mcap", start_ns)
    early.add_relay("RX", ["PDIS1"], {})  # ended before its first sample
    early.close()
    whole = LogWriter(tmp_path / "RA.mcap", start_ns)
    killed = LogWriter(tmp_path / "QA.mcap", start_ns)
    for k in range(10):
        for writer, name, t_ns in ((whole, "RA", k * 10**9), (killed, "QA", k * 10**9 + 5)):
            writer.message(f"/breaker/{name}", t_ns, "BreakerStatus", command="", pole_a=True)
    whole.close()
    killed.abort()  # as it is after kill -9
    logs = [tmp_path / f"{name}.mcap" for name in ("RA", "QA", "RB", "RX")]
    notes = merge(logs, tmp_path / "all.mcap", start_ns, {}, {})
    assert [note.partition("'")[0] for note in notes] == ["QA", "RB left no log"]
    states = faultloop.open_log(tmp_path / "all.mcap").breaker_states
    assert [s.t_ns for s in states] == sorted(s.t_ns for s in states)
    assert [s.source for s in states[:4]] == ["RA", "QA", "RA", "QA"]
    assert len(states) == 20


def test_long_logs_are_merged_in_stretches(tmp_path, monkeypatch):
    """All rows and messages of both, in order, with no more than a stretch of a log in memory."""
    start_ns, rate, seconds = 10**18, 100, 33
    count = np.arange(rate * seconds)
    t_ns = count * SECOND_NS // rate
    for name, later in (("RA", 0), ("RB", 7 * SECOND_NS + 1)):  # the second node's log begins later
        with LogWriter(tmp_path / f"{name}.mcap", start_ns + later) as log:
            log.add_relay(name, ["PDIS1"], {})
            for second in range(seconds):
                part = slice(second * rate, (second + 1) * rate)
                own, words = count[part, None].astype(float), np.zeros(rate, np.uint64)
                columns = (own.repeat(6, 1), own.repeat(14, 1), own.repeat(12, 1), words, words)
                log.relay_block(name, t_ns[part], count[part], *columns)
                log.message(f"/relay/{name}/events", int(t_ns[part][-1]), "foxglove.Log", message=str(second))
    asked, array = [], Log.array

    def noted(log, topic, *span):
        found = array(log, topic, *span)
        if not span or span[1] < MOST_NS:  # `Log.last_ns` reads in windows of its own
            asked.append(len(found))
        return found

    monkeypatch.setattr(Log, "array", noted)
    merge([tmp_path / "RA.mcap", tmp_path / "RB.mcap"], tmp_path / "all.mcap", start_ns, {}, {})
    monkeypatch.undo()
    assert max(asked) * SECOND_NS / rate <= STRETCH_NS
    whole = faultloop.open_log(tmp_path / "all.mcap")
    for name, later in (("RA", 0), ("RB", 7 * SECOND_NS + 1)):
        rows = whole.samples(name)
        np.testing.assert_array_equal(rows["t_ns"], t_ns + later)
        np.testing.assert_array_equal(rows["ic"], count)
        np.testing.assert_array_equal(whole.loops(name)["ca_x"], count)
    assert [e.message for e in whole.events if "RB" in e.topic] == [str(k) for k in range(seconds)]
    assert [e.t_ns for e in whole.events] == sorted(e.t_ns for e in whole.events)


def plant_node(scenario: Scenario, first: int, changes: list[tuple[int, str, int, int]]) -> PlantNode:
    return PlantNode(scenario, first, lambda *_: None, lambda *change: changes.append(change))


def values(frames: list[Frame]) -> list[tuple[float, ...]]:
    return [m.values for f in frames if isinstance(m := decode(f), SampledValues) and m.number == 0]


def test_a_plant_that_joins_late_goes_on_with_the_same_waves():
    """The waves of a network that was never interrupted, to a frame's resolution; and the fault to come."""
    scenario = faultloop.load_scenario(SCENARIOS / "ag-zone1.toml", ["fault.F1.after_s=0.3"])
    first, n = 10 * CYCLE, 5 * CYCLE
    node, whole = plant_node(scenario, 0, []), []
    changes: list[tuple[int, str, int, int]] = []
    late, joined = plant_node(scenario, first, changes), []
    for count in range(0, first + n, 16):
        whole += values(node.poll(at(count + 15)))
        joined += values(late.poll(at(count + 15)))
    assert node.sample_count == late.sample_count == len(whole) == first + n
    # Where one's rounding is up and the other's down: one step of 10 mV or 1 mA.
    difference = np.abs(np.array(whole[first:]) - np.array(joined)).max(axis=0)
    assert (difference <= [0.0101] * 3 + [0.00101] * 3).all()
    for count in range(first + n, round(0.31 * HZ), 16):
        late.poll(at(count))
    ((t_ns, kind, number, value),) = changes
    assert (kind, number, value) == ("fault", 0, 1)
    assert t_ns == pytest.approx(0.3e9, abs=1e6)


@pytest.mark.parametrize("name", ["ag-zone1", "single-pole-trip", "zone2-remote-end", "reverse-fault"])
def test_nodes_decide_as_the_simulation_does(name):
    """Samples go through frames, to 10 mV and 1 mA, and breakers move on their own: it is the same trip."""
    scenario = faultloop.load_scenario(SCENARIOS / f"{name}.toml")
    simulated = faultloop.run(scenario).trips
    wanted = sorted((t.relay, t.function, t.zone, t.loop, t.poles, t.sample_count) for t in simulated)
    assert OneProcess(scenario).run() == wanted


@pytest.mark.parametrize("name", ["pott", "line-differential"])
def test_both_ends_decide_as_the_simulation_does(name):
    """Signals and currents of the far end go through the channel's queue in a process, too.  The bus takes no
    time here, and up to 0.6 ms in the simulation: three samples."""
    scenario = faultloop.load_scenario(SCENARIOS / f"{name}.toml")
    simulated = faultloop.run(scenario).trips
    wanted = sorted((t.relay, t.function, t.zone, t.loop, t.poles, t.sample_count) for t in simulated)
    got = OneProcess(scenario).run()
    assert [t[:5] for t in got] == [t[:5] for t in wanted]
    assert max(abs(a[5] - b[5]) for a, b in zip(got, wanted, strict=True)) <= 3


def test_samples_are_rounded_as_a_frame_does():
    random = np.random.default_rng(1)
    rows = random.normal(0, 1e5, (50, 6))
    through = np.array([decode(SampledValues(0, 1, tuple(row)).encode()).values for row in rows.tolist()])  # type: ignore[union-attr]
    assert np.abs(quantised(rows) - through).max() < 1e-9


BIT_ERROR = """
[[bus_fault]]
kind = "bit_error"
node = "RA"
"""


def test_what_is_wrong_is_said_before_any_process_is_started(tmp_path):
    path = SCENARIOS / "ag-zone1.toml"
    log = tmp_path / "x.mcap"
    for arguments, said in (
        ({"can": "virtual:x"}, "ends where its process does"),
        ({"can": "nonsense"}, "not INTERFACE:CHANNEL"),
        ({"can": "socketcan:nope9"}, "no CAN interface|of Linux"),
        ({"can": "sockitcan:vcan0"}, "no CAN interface 'sockitcan'"),
        ({"pace": 0.0}, "greater than 0"),
        ({"without": ["RX"]}, "no node 'RX'"),
        ({"without": ["plant"]}, "has no end"),
    ):
        with pytest.raises(InputError, match=said):
            run_processes(path, log=log, **({"can": "socketcan:nope9"} | arguments))  # type: ignore[arg-type]
    text = path.read_text(encoding="utf-8").replace('"settings/', f'"{SCENARIOS.as_posix()}/settings/')
    wire = tmp_path / "wire.toml"
    wire.write_text(text + BIT_ERROR, encoding="utf-8")
    with pytest.raises(InputError, match="no wire"):
        run_processes(wire, can="socketcan:nope9", log=log)
    assert list(tmp_path.iterdir()) == [wire]
