"""How a run and a replay are told to a person and to a program."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.text import Text

from faultloop.cli.output import console, table
from faultloop.loop.outcome import pole_names
from faultloop.loop.result import Result, delay_ms

if TYPE_CHECKING:  # it brings scipy.signal and pandas, 2 s that a run has no use for
    from faultloop.loop.replay import ReplayResult


def result_as_dict(result: Result) -> dict[str, Any]:
    """For ``--json``: what a script asks of a run."""
    start = result.fault_start_ns
    return {
        "scenario": result.scenario.scenario.name,
        "held": result.held,
        "interrupted": result.interrupted,
        "simulated_s": result.simulated_s,
        "wall_s": result.wall_s,
        "log": None if result.log is None else str(result.log),
        "faults": [
            {"fault": f.fault, "type": f.type, "on": f.on, "t_s": f.t_ns / 1e9} for f in result.faults
        ],
        "trips": [
            {
                "relay": t.relay,
                "function": t.function,
                "zone": t.zone,
                "loop": t.loop,
                "poles": t.pole_names,
                "sample_count": t.sample_count,
                "decided_s": t.t_ns / 1e9,
                "breaker": t.breaker,
                "received_s": None if t.received_ns is None else t.received_ns / 1e9,
                "opened_s": None if t.opened_ns is None else t.opened_ns / 1e9,
                "trip_time_ms": delay_ms(t, start),
            }
            for t in result.trips
        ],
        "fault_locations_pu": result.fault_locations,
        "can": {"frames": result.can_frames, "load": result.bus_load},
        "pacing": None if result.pacing is None else asdict(result.pacing),
        "died": list(result.died),
        "warnings": list(result.warnings),
        "expectations": [
            {"relay": v.expect.relay, "trip": v.expect.trip, "held": v.held, "why": v.why}
            for v in result.expectations
        ],
        "events": [
            {"t_s": e.t_ns / 1e9, "source": e.source, "level": e.level, "text": e.text} for e in result.events
        ],
    }


def print_result(result: Result) -> None:
    """The run in a screenful."""
    out = console()
    name = result.scenario.scenario.name
    out.print(
        Text(name, style="bold"), f": {result.simulated_s:g} s simulated in {result.wall_s:.2f} s", sep=""
    )
    for warning in result.warnings:
        out.print(f"warning: {warning}", style="yellow", markup=False)
    out.print(table("Events", [">ms", "from", "what"], event_rows(result)))
    start = result.fault_start_ns
    rows = []
    for t in result.trips:
        after = delay_ms(t, start)
        rows.append(
            (
                t.relay,
                t.function,
                t.loop,
                t.pole_names,
                "-" if after is None else f"{after:.2f}",
                "-" if t.opened_ns is None else f"{(t.opened_ns - (start or 0)) / 1e6:.2f}",
                _percent(result.fault_locations.get(t.relay)),
            )
        )
    columns = ["relay", "function", "loop", "poles", ">trip ms", ">open ms", ">location"]
    if rows:
        out.print()
        out.print(table("Trips (from the fault's start to the breaker's receiving the frame)", columns, rows))
    else:
        out.print("\nNo trip.")
    if result.expectations:
        out.print()
        held = [Text("held", "green") if v.held else Text("NOT HELD", "red") for v in result.expectations]
        rows = [
            (h, v.expect.relay, "trip" if v.expect.trip else "no trip", v.why)
            for h, v in zip(held, result.expectations, strict=True)
        ]
        out.print(table("Expectations", ["", "relay", "expected", "what happened"], rows))
    load = "" if result.bus_load is None else f", bus load {100 * result.bus_load:.1f} %"
    out.print(f"\n{result.can_frames} CAN frames{load}")
    if result.pacing is not None:
        for line in result.pacing.lines():
            out.print(line)
    if result.died:
        out.print(f"ended before the run did: {', '.join(result.died)}", style="red")
    if result.interrupted:
        out.print(f"interrupted at {result.simulated_s:g} s", style="yellow")
    if result.log is not None:
        out.print(f"log: {result.log}")


def event_rows(result: Result) -> list[tuple[str, str, str]]:
    """Events as rows of a table."""
    return [(f"{e.t_ns / 1e6:.2f}", e.source, e.text) for e in result.events]


def _percent(part: float | None) -> str:
    return "-" if part is None or part != part else f"{100 * part:.1f} %"


def print_replay(result: ReplayResult) -> None:
    """The replay in a screenful."""
    out = console()
    duration = f": {result.duration_ns / 1e9:g} s played into the relay"
    out.print(Text(result.record.name, style="bold"), duration, sep="")
    for note in result.notes:
        out.print(note, style="dim", markup=False)
    for warning in result.warnings:
        out.print(f"warning: {warning}", style="yellow", markup=False)
    told = {*result.notes, *result.warnings}
    rows = [(f"{e.t_ns / 1e6:.2f}", e.text) for e in result.events if e.text not in told]
    out.print(table("\nEvents", [">ms", "what"], rows))
    out.print()
    for t in result.trips:
        out.print(
            f"trip: {t.function} (zone {t.zone}) loop {t.loop} poles {pole_names(t.poles)}"
            f" at {t.t_ns / 1e6:.2f} ms"
        )
    if not result.trips:
        out.print("no trip")
    out.print(f"fault location: {_percent(result.fault_location)} of the line")
    if result.interrupted:
        out.print("interrupted before the record's end", style="yellow")
    if result.log is not None:
        out.print(f"log: {result.log}")
