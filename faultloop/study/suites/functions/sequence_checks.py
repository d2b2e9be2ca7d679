"""Sequences of a shipped scenario in the closed loop: what a relay tells, and what it sends on the bus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from faultloop.io.can.frames import Frame, State, decode
from faultloop.io.can.table import Kind
from faultloop.loop.recording import MemorySink
from faultloop.loop.runner import run
from faultloop.loop.scenario import load_scenario

Case = dict[str, Any]
PACKAGE = Path(__file__).resolve().parents[3]
COMMANDS = (Kind.TRIP, Kind.CLOSE, Kind.BREAKER_FAILURE)
TOLD = ("RREC1", "RBRF1 OpEx")


class Messages(MemorySink):
    """Keeps the rare messages of a run: time, name, fields."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: list[tuple[int, str, dict[str, Any]]] = []

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        self.kept.append((t_ns, message_name, {"topic": topic} | fields))


def shipped(name: str) -> Path:
    """A scenario of the repository, or of the wheel that carries it along."""
    carried = PACKAGE / "starter"
    return (carried if carried.is_dir() else PACKAGE.parent) / "scenarios" / f"{name}.toml"


def sequence(given: Case) -> Case:
    """Events of RREC and RBRF of one relay, its commands on the bus as "CLOSE 7", the poles at the end."""
    scenario = load_scenario(shipped(given["scenario"]), given.get("overrides", ()))
    sink = Messages()
    result = run(scenario, sinks=[sink])
    relay = given["relay"]
    number = [place.name for place in scenario.relay].index(relay)
    events = [e.text for e in result.events if e.source == relay and e.text.startswith(TOLD)]
    last, commands, poles = dict.fromkeys(COMMANDS, 0), [], {}
    for _, kind, fields in sink.kept:
        if kind == "BreakerStatus":
            open_poles = "".join(p for p in "ABC" if not fields[f"pole_{p.lower()}"])
            poles[fields["topic"].rpartition("/")[2]] = f"{open_poles} open" if open_poles else "closed"
        if kind != "CanFrame":
            continue
        state = decode(Frame(fields["id"], fields["data"], fields["extended"], fields["fd"]))
        if isinstance(state, State) and state.kind in COMMANDS and state.number == number:
            if state.poles != last[state.kind]:
                commands.append(f"{state.kind.name} {state.poles}")
            last[state.kind] = state.poles
    at_the_end = ", ".join(f"{name} {where}" for name, where in sorted(poles.items()))
    return {"events": events, "commands": commands, "poles": at_the_end}


CHECKS: dict[str, Callable[[Case], Case]] = {"sequence": sequence}
