"""A node from the command line to its end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Literal

from faultloop.config.bus_fault import BusFault
from faultloop.errors import InputError, nearest
from faultloop.io.can.socketcan import open_link
from faultloop.io.can.table import PLANT_NODE, Kind
from faultloop.io.can.transport import check_bit_rates
from faultloop.live.process import Node, Supervision, run_node
from faultloop.loop.inputs import changes_of, divided
from faultloop.loop.recording import check_log_path, versions
from faultloop.loop.scenario import Scenario, load_scenario

Role = Literal["plant", "relay", "breaker", "attacker"]
ATTACKERS = ("babbling", "forging")
TIME = Kind.HEARTBEAT + PLANT_NODE


def check_pace(pace: float) -> None:
    """InputError unless it can be a pace."""
    if not 0 < pace < math.inf:
        raise InputError(f"must be greater than 0 and finite, not {pace:g}", key="--pace")


def bus_of(scenario: Scenario, can: str | None) -> str:
    """``INTERFACE:CHANNEL``: as asked for, or the scenario's; InputError where its bit rate is another."""
    bus = can if can is not None else f"{scenario.can.interface}:{scenario.can.channel}"
    interface, _, channel = bus.partition(":")
    if interface == "socketcan" and channel:
        check_bit_rates(channel, scenario.can.bitrate, scenario.can.data_bitrate)
    return bus


def attackers(scenario: Scenario) -> list[BusFault]:
    """The faults on the bus that are nodes of their own."""
    return [fault for fault in scenario.bus_fault if fault.kind in ATTACKERS]


def number_of(scenario: Scenario, role: Role, name: str | None) -> int:
    """A relay's or breaker's number; InputError where the scenario has none of the name."""
    if role == "plant":
        if name is not None:
            raise InputError(f"there is one plant, without a name; '{name}' is not needed", key="NAME")
        return 0
    items = {"relay": scenario.relay, "breaker": scenario.breaker, "attacker": attackers(scenario)}[role]
    names = [item.name for item in items]
    if name is None:
        raise InputError(f"say which {role}: {', '.join(names) or 'the scenario has none'}", key="NAME")
    if name not in names:
        raise InputError(
            f"there is no {role} '{name}'; {nearest(name, names)}", file=scenario.path, key="NAME"
        )
    return names.index(name)


def make_node(
    scenario: Scenario, role: Role, number: int, closed: int | None = None, settings: Sequence[str] = ()
) -> tuple[Node, list[int]]:
    """The node, and the identifiers that it listens to; ``settings`` overrides those of a relay's file."""
    # A process loads what it needs: a breaker has no use for the kernels of plant and relay.
    if role == "plant":
        from faultloop.live import plant

        return plant.PlantProcess(scenario), plant.identifiers(scenario)
    if role == "relay":
        from faultloop.live import relay

        return relay.RelayProcess(scenario, number, settings), relay.identifiers(scenario, number)
    if role == "attacker":
        from faultloop.live import attacker

        return attacker.AttackerProcess(scenario, number), attacker.identifiers(scenario, number)
    from faultloop.live import breaker

    return breaker.BreakerProcess(scenario, number, closed), breaker.identifiers(scenario, number)


@dataclass(frozen=True)
class NodeOptions:
    """What ``faultloop node`` is told.

    Attributes
    ----------
    name : of the relay or breaker; None for the plant.
    can : ``"INTERFACE:CHANNEL"`` in place of the scenario's.
    closed : a breaker's mask of poles that are closed when its process starts; None: as the scenario says.
    """

    role: Role
    scenario: Path
    name: str | None = None
    can: str | None = None
    pace: float = 1.0
    log: Path | None = None
    overrides: tuple[str, ...] = ()
    closed: int | None = None


def run_role(options: NodeOptions, supervision: Supervision | None = None) -> bool:
    """Run one node until the scenario's end; False if it was told to stop before."""
    own, of_settings = divided(options.overrides)
    scenario = load_scenario(options.scenario, own)
    check_pace(options.pace)
    number = number_of(scenario, options.role, options.name)
    if options.log is not None:
        check_log_path(options.log)
    # The bus first: it is wrong more often than the rest, and found at once.
    bus = bus_of(scenario, options.can)
    open_link(bus, fd=True, scenario=scenario).close()
    changes = changes_of(of_settings, options.name or "", [place.name for place in scenario.relay])
    node, wanted = make_node(scenario, options.role, number, options.closed, changes)
    link = open_link(bus, fd=True, identifiers=[*wanted, TIME], scenario=scenario)
    metadata = {
        "node": {"role": options.role, "name": node.name, "pace": f"{options.pace:g}"},
        "versions": versions(),
    }
    return run_node(
        node,
        link,
        scenario,
        options.pace,
        log=options.log,
        supervision=supervision,
        metadata=metadata,
        leads=options.role == "plant",
    )


def run_supervised(connection: Connection, options: NodeOptions) -> None:
    """A node whose supervisor holds the other end of `connection`: what a process runs."""
    supervision = Supervision(connection, options.name or options.role)
    try:
        run_role(options, supervision)
    except InputError as error:
        supervision.tell({"failed": str(error)})
        raise SystemExit(2) from None
    except Exception as error:
        supervision.tell({"failed": f"{type(error).__name__}: {error}"})
        raise
