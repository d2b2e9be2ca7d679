"""The six shared records, each played into a relay: what is known, what its own relay did, what ours did.

    python bench/records.py [--records FOLDER] [--estimator METHOD] [--keep]

Channels as `faultloop channels` finds them; settings of scenarios/settings.  What is known is what the README
of the records says; the times of the record's relay are those of its digital channels.
"""

from __future__ import annotations

import argparse
import cmath
import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

from results import keep

import faultloop
from faultloop.io.comtrade import read_comtrade
from faultloop.loop.outcome import pole_names
from faultloop.loop.replay import ReplayResult
from faultloop.relay import load_settings

ROOT = Path(__file__).resolve().parents[1]
SETTINGS = ROOT / "scenarios" / "settings"
PEAK = ",".join(
    f"{slot}={place}*1.41421356"
    for slot, place in zip(("va", "vb", "vc", "ia", "ib", "ic"), (5, 6, 7, 0, 1, 2), strict=True)
)
ZONE_1 = "1_ступень_ДЗ_ШДЭ_2802_2СШ-110_ВЛ_ВЛ62"
NEVER = "never"


@dataclass(frozen=True)
class Played:
    """One record: how it is played, and pairs of (what, the record's channel, our bit or event)."""

    folder: str
    file: str
    mapping: str | None
    why: str
    known: str
    pairs: tuple[tuple[str, str | None, str], ...]
    without: tuple[str, ...] = ()


RECORDS = (
    Played(
        "sel311l-c-g", "1991-ascii-sel.cfg", PEAK, "found; x sqrt 2, as the record's peaks are RMS values",
        "C-G, location 0.84; 51G 0.0531, 67P1 0.0615, Z2G 0.0740, not Z1G; trip 0.0656 by 87L of both ends",
        (("51G", "51G", "PTOC1.Str"), ("67P1", "67P1", "PTOC2.Str"), ("Z2G", "Z2G", "PDIS4.Str"),
         ("Z1G", "Z1G", "PDIS2.Str"), ("trip", "TRIP", "PTRC1.Tr")),
    ),
    Played(
        "osc-swing-110kv", "2.cfg", "bay=ВЛ62", "by the bay's name",
        "out of step, balanced; zone 1 operated at 1.470 and should have been blocked",
        (("RPSB blocks", None, "RPSB1 power swing"), ("zone 1", ZONE_1, "PDIS1.Op")),
    ),
    Played(
        "osc-swing-110kv", "2.cfg", "bay=ВЛ62,ia=31*-1,ib=32*-1,ic=33*-1", "the same, currents' sign turned",
        "without our RPSB", (("zone 1", ZONE_1, "PDIS1.Op"),), without=("rpsb",),
    ),
    Played(
        "b-g-500kv-reclose", "cfg_file.CFG", "bay=Ⅱ回", "by the bay's name",
        "B-G on circuit II at 0.100, one-pole trip 0.115, reclosed 0.968 and 1.469",
        (("trip", "某某Ⅱ回主二B相跳闸", "PTRC1.Tr"),),
    ),
    Played(
        "b-g-500kv-reclose", "cfg_file.CFG", "bay=Ⅰ回", "by the bay's name",
        "circuit I is healthy and must not trip", (("trip", None, "PTRC1.Tr"),),
    ),
    Played(
        "b-c-to-abc-110kv", "two_phase_fault.cfg", None, "found",
        "B-C at 0.176, A-B-C at 0.400; Z of B-C 1.70 ohm at 50 degrees; no digital channels",
        (("trip", None, "PTRC1.Tr"),),
    ),
    Played(
        "breaker-failure-30kv", "NOR-T2_osc1.cfg", "52b=01-52b 31.5", "found; 52b by its name",
        "trip 0.980, 52b 1.028 while the current stays, breaker-failure trip 1.140, cleared about 1.19",
        (("trip", "IN1>2 Trip", "PTRC1.Tr"), ("breaker failure", "Bfail1 Trip 3ph", "RBRF1.OpEx")),
    ),
    Played(
        "transformer-inrush", "transformer_inrush.cfg", "bay=ВН", "by the side's name; no voltages in it",
        "no line protection should trip", (("trip", None, "PTRC1.Tr"),),
    ),
)  # fmt: skip


def theirs(record: Path, channel: str | None) -> str:
    """When a digital channel first changed [s]."""
    if channel is None:
        return "-"
    found = read_comtrade(record)
    one = next(c for c in found.status if c.name.strip() == channel)
    changed = (one.values != one.values[0]).nonzero()[0]
    return f"{found.t_ns[changed[0]] / 1e9:.4f}" if len(changed) else NEVER


def ours(result: ReplayResult, bit: str) -> str:
    """When one of our bits, by name, or an event, by its beginning, was first there [s]."""
    name, _, kind = bit.partition(".")
    if " " in bit:
        told = next((e.t_ns for e in result.events if e.text.startswith(bit)), None)
    elif name == "PTRC1":
        told = result.trips[0].t_ns if result.trips else None
    elif kind == "Op":
        told = result.first_operate_ns.get(name)
    else:
        told = result.first_pickup_ns.get(name if kind == "Str" else bit)
    return NEVER if told is None else f"{told / 1e9:.4f}"


def measured(log: Path, at_s: float) -> str:
    """The B-C loop of the log, ohm."""
    loops = faultloop.open_log(log).loops("replay")
    row = (loops["t_ns"] / 1e9).searchsorted(at_s)
    z = complex(loops["bc_r"][row], loops["bc_x"][row])
    return f"B-C loop at {at_s:g} s {abs(z):.2f} ohm at {math.degrees(cmath.phase(z)):.0f} degrees"


def played(record: Played, folder: Path, log: Path, estimator: str | None) -> tuple[str, str]:
    """Plays one: its title, and what came of it."""
    path = folder / record.folder / record.file
    overrides = [] if estimator is None else [f'estimator.method="{estimator}"']
    settings = load_settings(SETTINGS / f"{record.folder}.toml", overrides)
    settings = settings.model_copy(update=dict.fromkeys(record.without))
    result = faultloop.replay(path, settings, mapping=record.mapping, log=log)
    parts = []
    for what, channel, bit in record.pairs:
        own = theirs(path, channel)
        parts.append(f"{what} {ours(result, bit)}" + ("" if own == "-" else f" ({own})"))
    if result.trips:
        trip = result.trips[0]
        parts.append(f"{trip.function} {trip.loop} poles {pole_names(trip.poles)}")
    if result.fault_location == result.fault_location:
        parts.append(f"location {result.fault_location:.3f}")
    if record.folder.startswith("b-c"):
        parts.append(measured(log, 0.25))
    by = "" if estimator is None else f" by {estimator}"
    title = f"Record {record.folder}{by}, channels {record.why}. Known: {record.known}."
    title += " Ours (the record's relay), s"
    return title, "; ".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--records", type=Path, default=os.environ.get("FAULTLOOP_RECORDS"))
    parser.add_argument("--estimator", help="in place of the settings' own")
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.py")
    given = parser.parse_args()
    folder = Path(given.records or ROOT.parent / "shared" / "records")
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        for number, record in enumerate(RECORDS):
            row = played(record, folder, Path(temporary) / f"{number}.mcap", given.estimator)
            rows.append(row)
            print(f"{row[0]}:\n    {row[1]}")
    if given.keep:
        keep("A run explains itself", rows, beside=True)


if __name__ == "__main__":
    main()
