"""A babbling node: what it does to the time of a trip, against the worst case of the bus.

Two relays trip at about the same time, each for its own breaker; the trip of the second, whose identifier is
the higher, is timed.  The babbler has the highest or the lowest priority and loads the bus from 10 to 100 %.
"""

from __future__ import annotations

from random import Random
from typing import Any

import numpy as np

from faultloop.config.bus_fault import BusFault
from faultloop.io.can.bus import SECOND_NS, SimulatedBus
from faultloop.nodes import FOREVER, BreakerNode, RelayNode
from faultloop.nodes.attacker import BabblingNode
from faultloop.nodes.goose import Repetition
from faultloop.nodes.refusals import unheard
from faultloop.study.diagram import Curve, Diagram
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.bus.response_times import Message, longest_bits, response_ns

MS = 1_000_000
BITRATE = 500_000
BIT_NS = SECOND_NS // BITRATE
FRAME_NS = longest_bits(8) * BIT_NS
TRIALS = {False: 500, True: 20}
PATIENCE_NS = 60 * MS
HIGHEST, LOWEST = 0x000, 0x7FF
LOADS = tuple(range(10, 101, 10))


def report(quick: bool) -> Report:
    """500 trips for each priority and load; quick: 20."""
    trials = TRIALS[quick]
    done = Report("babbling", f"A babbling node, {trials} trips for each load")
    done.text = [
        "500 kbit/s; load: as many of the longest frames (135 bits) as fill so much of the bus, with random "
        "data, so that less of it is really taken. Trip time: from the relay's decision to the breaker's "
        "command. The second of two relays that trip within 1 ms, each frame repeated after 2, 4, ... ms. "
        "The babbler's controller has one buffer: a frame for which it is not free is not offered.",
    ]
    longest: dict[str, list[float]] = {}
    for name, identifier in (("highest", HIGHEST), ("lowest", LOWEST)):
        rows = []
        for load in LOADS:
            times, taken = trip_times_ms(identifier, load, trials)
            bound = bound_ms(identifier, load)
            never = int(np.sum(~np.isfinite(times)))
            rows.append((load, 100 * taken, float(np.median(times)), float(times.max()), bound, never))
            if bound is not None:
                what = f"{name} priority, {load} %: longest trip time"
                done.checks.append(Check(what, float(times.max()), bound, "ms"))
        done.tables.append(_table(name, rows))
        longest[name] = [row[3] for row in rows]
    drowned, _ = trip_times_ms(HIGHEST, 200, trials)
    share = 100 * float(np.mean(~np.isfinite(drowned)))
    done.checks.append(Check("highest priority, offered twice what the bus carries: trips lost", share, 100.0,
                             "%", at_least=True))  # fmt: skip
    done.text.append(
        "A babbler of the highest priority that offers more than the bus carries keeps every trip off it: no "
        "protocol above the bus helps, only a guardian at the node or a second bus."
    )
    done.diagrams = [_diagram(longest)]
    return done


def _table(name: str, rows: list[Any]) -> Table:
    shown = [(*row[:4], "none" if row[4] is None else row[4], row[5]) for row in rows]
    columns = (">load %", ">taken %", ">median", ">longest", ">worst case", ">never")
    note = (
        "Worst case: Davis et al. (2007), all frames as long as can be; none where babbler and both trips "
        "fill the bus. Never: trips that had not come after 60 ms."
    )
    return Table(f"Babbler of the {name} priority: trip time [ms]", columns, shown, note)


def bound_ms(identifier: int, load: int) -> float | None:
    """Worst-case response time of the second relay's trip frame [ms]; None where there is none.

    Its reception comes four bits before the end of its intermission, where the analysis ends.
    """
    babbler = Message("babbler", FRAME_NS, round(1e9 / rate_hz(load)))
    first_trip = Message("trip 0", FRAME_NS, Repetition().first_ns)
    trip = Message("trip 1", FRAME_NS, Repetition().first_ns)
    others = Message("others", FRAME_NS, 1000 * MS)
    messages = [first_trip, trip, others]
    messages.insert(0 if identifier == HIGHEST else 3, babbler)
    bound = response_ns(messages, messages.index(trip), BIT_NS)
    return None if bound is None else (bound - 4 * BIT_NS) / MS


def rate_hz(load: int) -> float:
    """Frames per second of the longest kind that load the bus with `load` %."""
    return load / 100 * 1e9 / FRAME_NS


def trip_times_ms(identifier: int, load: int, trials: int) -> tuple[np.ndarray, float]:
    """Trip time of each trial [ms], infinite where it did not come, and the load that was really there."""
    outcomes = [trip_time_ns(identifier, load, trial) for trial in range(trials)]
    times = np.array([ns / MS if ns >= 0 else np.inf for ns, _ in outcomes])
    return times, float(np.mean([taken for _, taken in outcomes]))


def trip_time_ns(identifier: int, load: int, seed: int) -> tuple[int, float]:
    """Of one trial [ns], -1 where it did not come; and the bus's load since the babbler began."""
    random = Random(f"babbling {identifier} {load} {seed}")
    first_ns = random.randrange(300 * MS, 400 * MS)
    trips_ns = [first_ns, first_ns + random.randrange(1 * MS)]
    relays = [RelayNode(i, i, (), 1.0, 10.0) for i in range(2)]
    breakers = [BreakerNode(i, [i], 7, 1.0, unheard) for i in range(2)]
    start_s = first_ns / 1e9 - random.uniform(8e-3, 10e-3)
    babbler = BabblingNode(
        BusFault(name="B", kind="babbling", identifier=identifier, rate_hz=rate_hz(load), start_s=start_s),
        f"{seed}",
    )
    bus = SimulatedBus(BITRATE)
    nodes = (*relays, *breakers)
    decided = [FOREVER, FOREVER]
    begun_ns, busy_ns = round(start_s * 1e9), -1  # the bus's work before the babbler began

    def taken(t_ns: int) -> float:
        return (bus.load.busy_ns - busy_ns) / (t_ns - begun_ns)

    while True:
        arrival = bus.next_event_ns()
        now = min(babbler.next_ns, *trips_ns, *(node.next_ns for node in nodes), arrival or FOREVER)
        if now > first_ns + PATIENCE_NS:
            return -1, taken(now)
        if busy_ns < 0 and now >= begun_ns:
            busy_ns = bus.load.busy_ns
        for t_ns, frame, sender in bus.advance(now):
            for node in nodes:
                command = node.receive(t_ns, frame) if node is not sender else None
                if node is breakers[1] and command:
                    return t_ns - decided[1], taken(t_ns)
        for i, relay in enumerate(relays):
            if now >= trips_ns[i]:
                decided[i], trips_ns[i] = trips_ns[i], FOREVER
                relay.set(now, 7, 0, 0)
        for node in nodes:
            for frame in node.poll(now):
                bus.submit(now, frame, node)
        for frame in babbler.poll(now):
            if not bus.waiting_from(babbler):
                bus.submit(now, frame, babbler)


def _diagram(longest: dict[str, list[float]]) -> Diagram:
    """Over the load; the bound beside."""
    curves = []
    for colour, ((name, times), identifier) in enumerate(
        zip(longest.items(), (HIGHEST, LOWEST), strict=True)
    ):
        there = [time if np.isfinite(time) else np.nan for time in times]
        bounds = np.array([bound_ms(identifier, load) for load in LOADS], np.float64)  # None: NaN
        curves += [
            Curve(f"{name} priority", LOADS, there, colour=colour),
            Curve(f"{name} priority: worst case", LOADS, bounds, colour=colour, dash="dot"),
        ]
    title = "Longest trip time beside a babbler"
    return Diagram(title, "load of the babbler [%]", "trip time [ms]", curves, y_range=(0.0, None), wide=True)
