"""Where a fault is, seen from a relay: from the network's graph alone."""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from math import inf
from typing import Any

from faultloop.config.campaign import Where
from faultloop.loop.scenario import Scenario


def first_fault(scenario: Scenario) -> Any:
    """The one that begins first (of those with ``angle_deg``: may begin); None without any."""
    return min(scenario.fault, key=lambda f: f.after_s if f.start_s is None else f.start_s, default=None)


def where_of(scenario: Scenario, relay: Any) -> Where:
    """Where the scenario's first fault is, seen from ``relay`` (one of `scenario.relay`).

    inside: on the relay's line, between its ends.  behind: at its own bus, or nearer to it than to the far
    one by the ways that do not pass the line.  beyond: at the far bus, nearer to it, or on a parallel line.
    """
    fault = first_fault(scenario)
    if fault is None:
        return "none"
    lines = {line.name: line for line in scenario.line}
    own_line = lines[relay.line]
    own, far = own_line.from_bus, own_line.to_bus
    if relay.end == "to":
        own, far = far, own
    if fault.line is None:
        places = {fault.bus: 0.0}
    else:
        line = lines[fault.line]
        x = fault.position(line)
        if fault.line == relay.line:
            x = x if relay.end == "from" else 1 - x
            return "inside" if 0 < x < 1 else "behind" if x == 0 else "beyond"
        size = abs(line.z1_ohm)
        if 0 < x < 1 and {line.from_bus, line.to_bus} == {own, far}:
            return "beyond"
        places = {line.from_bus: x * size, line.to_bus: (1 - x) * size}
        if x in (0, 1):
            places = {line.from_bus if x == 0 else line.to_bus: 0.0}
    others = [line for line in scenario.line if {line.from_bus, line.to_bus} != {own, far}]
    nearest = {bus: _distance(places, bus, others) for bus in (own, far)}
    return "behind" if nearest[own] <= nearest[far] and nearest[own] < inf else "beyond"


def _distance(places: dict[Any, float], goal: str, lines: Iterable[Any]) -> float:
    """The smallest impedance from the fault to a bus along lines (Dijkstra, 1959) [ohm]."""
    ways: dict[str, list[tuple[str, float]]] = {}
    for line in lines:
        for a, b in ((line.from_bus, line.to_bus), (line.to_bus, line.from_bus)):
            ways.setdefault(a, []).append((b, abs(line.z1_ohm)))
    queue = [(distance, bus) for bus, distance in places.items()]
    heapq.heapify(queue)
    done: set[str] = set()
    while queue:
        distance, bus = heapq.heappop(queue)
        if bus == goal:
            return distance
        if bus not in done:
            done.add(bus)
            for other, length in ways.get(bus, ()):
                heapq.heappush(queue, (distance + length, other))
    return inf
