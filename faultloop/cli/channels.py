"""``faultloop channels``"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from faultloop.io.comtrade.record import Record


def command(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="COMTRADE .cfg or .cff, or a log .mcap.")],
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """The channels of a record, and which of them a replay would take, and why."""
    from faultloop.cli.output import print_json
    from faultloop.io.comtrade import read_comtrade

    if record.suffix.lower() == ".mcap":
        found = _of_log(record)
    else:
        found = _of_record(record, read_comtrade(record))
    if json:
        print_json(found)
    else:
        _print(found)
    return 0


def _of_log(path: Path) -> dict[str, Any]:
    from faultloop.io.mcap_reader import open_log

    relays = open_log(path).relays
    return {"record": str(path), "relays": [{"name": name, "map": f"relay={name}"} for name in relays]}


def _of_record(path: Path, record: Record) -> dict[str, Any]:
    from faultloop.io.comtrade.bays import bay_of, bays_of
    from faultloop.io.comtrade.select import slots_of

    slots = slots_of(record)
    counts = {slot: sum(own == slot for own, _ in slots) for slot, _ in slots}
    analog = []
    for place, (channel, (slot, label)) in enumerate(zip(record.analog, slots, strict=True)):
        several = f"; one of {counts[slot]} that it could be" if slot and counts[slot] > 1 else ""
        alone = "" if slot or not label.is_phase else ", without the other two"
        analog.append(
            {
                "index": place,
                "name": channel.name,
                "unit": channel.unit,
                "phase": channel.phase,
                "circuit": channel.circuit,
                "bay": bay_of(channel) if label.is_phase else "",
                "scale": channel.scale,
                "ratio": list(channel.ratio) if channel.ratio != (0.0, 0.0) else None,
                "slot": slot or None,
                "why": label.why + several + alone,
            }
        )
    return {
        "record": str(path),
        "station": record.station,
        "device": record.device,
        "revision": record.revision,
        "encoding": record.encoding,
        "frequency_hz": record.frequency_hz or None,
        "samples": len(record),
        "duration_s": float(record.t_ns[-1]) / 1e9 if len(record) else 0.0,
        "rates": [{"hz": rate.hz, "last_sample": rate.stop} for rate in record.stretches[:100]],
        "analog": analog,
        "digital": [_digital(record, place) for place in range(len(record.status))],
        "bays": [
            {"name": bay.name, "channels": bay.places, "voltages": bay.why, "map": bay.mapping}
            for bay in bays_of(record)
        ],
        "notes": record.notes,
    }


def _digital(record: Record, place: int) -> dict[str, Any]:
    import numpy as np

    channel = record.status[place]
    changes = np.flatnonzero(np.diff(channel.values)) + 1
    return {
        "index": place,
        "name": channel.name,
        "normal": channel.normal,
        "at_start": bool(channel.values[0]) if len(channel.values) else None,
        "changes": len(changes),
        "first_change_s": float(record.t_ns[changes[0]]) / 1e9 if len(changes) else None,
    }


def _print(found: dict[str, Any]) -> None:
    from rich.text import Text

    from faultloop.cli.output import console, table

    out = console()
    if "relays" in found:
        out.print(table("Relays", ["name", "--map"], [(r["name"], r["map"]) for r in found["relays"]]))
        return
    rates = ", then ".join(f"{rate['hz']:g} Hz" for rate in found["rates"][:6]) or "no samples"
    head = f": {found['station']} {found['device']}, {found['revision']}, {found['samples']} samples, "
    stated = "not stated" if found["frequency_hz"] is None else f"{found['frequency_hz']:g} Hz"
    head += f"{found['duration_s']:.6g} s at {rates}; line frequency {stated}"
    out.print(Text(Path(found["record"]).name, style="bold"), head, sep="")
    for note in found["notes"]:
        out.print(note, style="dim")
    rows = [
        (c["index"], c["name"], c["unit"], c["scale"] or "-", _ratio(c["ratio"]), c["slot"] or "-", c["why"])
        for c in found["analog"]
    ]
    out.print(table("\nAnalog channels", [">index", "name", "unit", "P/S", "ratio", "as", "why"], rows))
    rows = [
        (d["index"], d["name"], "on" if d["at_start"] else "off", d["changes"], _seconds(d["first_change_s"]))
        for d in found["digital"]
    ]
    if rows:
        columns = [">index", "name", "at start", ">changes", ">first, s"]
        out.print(table("\nDigital channels", columns, rows))
    rows = [
        (place, bay["name"] or "-", bay["voltages"], bay["map"]) for place, bay in enumerate(found["bays"])
    ]
    if rows:
        title = "\nBays: --map bay=NAME, or bay=PLACE" if len(rows) > 1 else "\nBays"
        out.print(table(title, [">place", "name", "voltages", "the same as --map"], rows))


def _ratio(ratio: list[float] | None) -> str:
    return "-" if ratio is None else f"{ratio[0]:g}/{ratio[1]:g}"


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"
