"""Who is on the bus of a scenario: relays and breakers by number, in the scenario's order."""

from __future__ import annotations

from faultloop.config.channel import linked
from faultloop.io.can.authentication import PLAIN, CmacSeal, Seal
from faultloop.io.can.keys import load_keys
from faultloop.io.can.table import PLANT_NODE, Kind
from faultloop.nodes.breaker import BreakerNode
from faultloop.nodes.clock import FOREVER
from faultloop.nodes.follower import BreakerFollower
from faultloop.nodes.master import TimeMaster
from faultloop.nodes.refusals import Report, unheard
from faultloop.nodes.relay import RelayNode, published
from faultloop.nodes.tables import BusTables


def seal(scenario: BusTables, start_ns: int = 0) -> Seal:
    """The seal of a node that starts at run time `start_ns` [ns]; each node needs one of its own.

    Raises InputError where the key file cannot be used.
    """
    path = scenario.keys_path
    if path is None:
        return PLAIN
    senders = {
        kind + i: place.name
        for i, place in enumerate(scenario.relay)
        for kind in (*published(True, bool(place.back_trip)), Kind.DIFFERENTIAL)
    }
    senders |= {Kind.BREAKER_STATUS + i: breaker.name for i, breaker in enumerate(scenario.breaker)}
    keys = load_keys(path, dict.fromkeys(senders.values()))
    by_identifier = {identifier: keys[name] for identifier, name in senders.items()}
    return CmacSeal(by_identifier, scenario.scenario.start_ns, start_ns)


def relay_node(
    scenario: BusTables, number: int, report: Report = unheard, *, start_ns: int = 0, agreement: int = 0
) -> RelayNode:
    """The node of relay `number`: its partners are the relays at the line's other end, and those that a
    ``[[channel]]`` links to it.

    A node that restarts within a run has `start_ns`, the run time of that [ns].
    """
    place = scenario.relay[number]
    partners = [
        i for i, other in enumerate(scenario.relay) if other.line == place.line and other.end != place.end
    ]
    names = [breaker.name for breaker in scenario.breaker]
    numbers = {other.name: i for i, other in enumerate(scenario.relay)}
    breaker = None if place.breaker is None else names.index(place.breaker)
    node = RelayNode(
        number,
        breaker,
        partners,
        scenario.can.heartbeat_s,
        scenario.can.measurements_hz,
        report,
        seal=seal(scenario, start_ns),
        start_ns=start_ns,
        confirmations=scenario.can.confirmations,
        linked=[numbers[name] for name in linked(scenario.channel, place.name)],
        back_trips=bool(place.back_trip),
        agreement=agreement,
    )
    deaf_ns = FOREVER
    for clock in scenario.clock:
        if clock.node == place.name:
            offset_ns, ppb, lost_ns = clock.numbers
            deaf_ns = FOREVER if lost_ns is None else lost_ns
            node.set_clock(offset_ns, ppb, deaf_ns)
    if scenario.time_sync is not None:
        node.follow_time(scenario.time_sync, _seed_of_time(scenario, number), deaf_ns)
    return node


def time_master(scenario: BusTables, report: Report = unheard, *, start_ns: int = 0) -> TimeMaster | None:
    """The node that tells the time; None where none is told."""
    if scenario.time_sync is None:
        return None
    return TimeMaster(scenario.time_sync, _seed_of_time(scenario, PLANT_NODE), report, start_ns=start_ns)


def _seed_of_time(scenario: BusTables, number: int) -> int:
    """Of the jitter of a node's stamps."""
    return (scenario.scenario.seed * 1_000_003 + (1 << 32) + number) % 2**64


def commanders(scenario: BusTables, number: int) -> tuple[list[int], list[int]]:
    """Numbers of the relays that may command a breaker, and of those that open it for another's failure."""
    name = scenario.breaker[number].name
    own = [i for i, place in enumerate(scenario.relay) if place.breaker == name]
    return own, [i for i, place in enumerate(scenario.relay) if name in place.back_trip]


def breaker_node(
    scenario: BusTables, number: int, closed: int, report: Report, *, start_ns: int = 0
) -> BreakerNode:
    """The node of breaker `number`: every relay that names the breaker may command it, and one that
    names it in ``back_trip`` opens it when its own has failed."""
    relays, backed_up = commanders(scenario, number)
    return BreakerNode(
        number,
        relays,
        closed,
        scenario.can.heartbeat_s,
        report,
        seal=seal(scenario, start_ns),
        start_ns=start_ns,
        confirmations=scenario.can.confirmations,
        backed_up=backed_up,
    )


def breaker_follower(
    scenario: BusTables, number: int, closed: int, report: Report, *, start_ns: int = 0
) -> BreakerFollower:
    """What the plant hears of breaker `number`."""
    return BreakerFollower(
        number,
        closed,
        scenario.can.heartbeat_s,
        report,
        seal=seal(scenario, start_ns),
        start_ns=start_ns,
        confirmations=scenario.can.confirmations,
    )
