"""Who is on the bus of a scenario: relays and breakers by number, in the scenario's order."""

from __future__ import annotations

from faultloop.nodes.breaker import BreakerNode, Report
from faultloop.nodes.relay import RelayNode
from faultloop.scenario import Scenario


def relay_node(scenario: Scenario, number: int) -> RelayNode:
    """The node of relay `number`: its partners are the relays at the line's other end."""
    place = scenario.relay[number]
    partners = [
        i for i, other in enumerate(scenario.relay) if other.line == place.line and other.end != place.end
    ]
    names = [breaker.name for breaker in scenario.breaker]
    breaker = None if place.breaker is None else names.index(place.breaker)
    return RelayNode(number, breaker, partners, scenario.can.heartbeat_s, scenario.can.measurements_hz)


def breaker_node(scenario: Scenario, number: int, closed: int, report: Report) -> BreakerNode:
    """The node of breaker `number`: every relay that names the breaker may command it."""
    name = scenario.breaker[number].name
    relays = [i for i, place in enumerate(scenario.relay) if place.breaker == name]
    return BreakerNode(number, relays, closed, scenario.can.heartbeat_s, report)
