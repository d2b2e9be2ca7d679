"""Pilot schemes at both ends of a line: each case with what is expected of each relay."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from faultloop.study.diagram import Curve, Diagram
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.schemes import bus, cases
from faultloop.study.suites.schemes.network import COLUMNS, Bench, Case, Expected, Row

BUS = "Load and latency on the bus"
PARTS = {name: title for name, (title, _) in cases.PARTS.items()} | {"bus": BUS}
MOST_ROWS = 60
"""In a table; of more, those that are wrong, and how many are right."""


def run(parts: Sequence[str], *, quick: bool, progress: Callable[[float], Any]) -> list[Report]:
    """One report for each part."""
    bench = Bench()
    reports = []
    for place, part in enumerate(parts):
        if part == "bus":
            reports.append(bus.report(BUS, list(cases.on_the_bus()), bench))
            progress((place + 1) / len(parts))
            continue
        title, make = cases.PARTS[part]
        todo = list(make(quick))
        rows: list[Row] = []
        for number, case in enumerate(todo):
            rows += bench.run(case)
            progress((place + (number + 1) / len(todo)) / len(parts))
        report = report_of(part, title + (", quick" if quick else ""), rows)
        if part == "reversal":
            _without_guard(report, bench, quick)
        reports.append(report)
    return reports


def report_of(name: str, title: str, rows: Sequence[Row]) -> Report:
    """Rows as a table, how many are wrong, and the times."""
    report = Report(name, title)
    shown = [row.cells for row in (rows if len(rows) <= MOST_ROWS else [r for r in rows if not r.right])]
    if len(shown) < len(rows):
        report.text = [
            f"{len(rows)} rows, {sum(row.right for row in rows)} right; only wrong ones are listed."
        ]
    report.tables = [Table(title, COLUMNS, shown)] if shown else []
    report.checks = [
        Check(
            f"{title}: wrong of {len(rows)}", float(sum(not row.right for row in rows)), 0.0, cases=len(rows)
        )
    ]
    timed = [row for row in rows if math.isfinite(row.ms)]
    if timed:
        curves = []
        for colour, relay in enumerate(dict.fromkeys(row.relay for row in timed)):
            own = [(n, row) for n, row in enumerate(timed, 1) if row.relay == relay]
            told = ("case", [row.case for _, row in own])
            x, y = [n for n, _ in own], [row.ms for _, row in own]
            curves.append(Curve(relay, x, y, "points", colour, told=told))
        report.diagrams = [
            Diagram(
                f"{title}: trips", "row that trips", "from the fault to the breaker [ms]", curves,
                y_range=(0.0, None), wide=True,
            )
        ]  # fmt: skip
    return report


def _without_guard(report: Report, bench: Bench, quick: bool) -> None:
    """The same reversals without the guard: how many trip the healthy line, by the channel's delay."""
    counts: Counter[tuple[float, float]] = Counter()
    totals: Counter[tuple[float, float]] = Counter()
    nobody = {"R2A": Expected(False), "R2B": Expected(False)}
    for delay, load, tables in cases.reversals(quick):
        rows = bench.run(Case("", tables, cases.guarded(0.0), nobody))
        counts[delay, load] += any(not row.right for row in rows)
        totals[delay, load] += 1
    report.tables.append(
        Table(
            "Healthy line tripped without the guard",
            (">channel [ms]", ">load [degrees]", ">reversals", ">tripped"),
            [(*key, totals[key], counts[key]) for key in totals],
            "A directional pilot, no time of coincidence; with a guard of 20/60 ms none, above. Breakers of "
            "40 and 60 ms: the reversal lasts for 20 ms, and for what the channel delays A's trip by. The "
            "direction takes 25 to 30 ms to turn; R2B's does not where line 2 takes over a load to B.",
        )
    )
    if quick:  # of a few none may
        return
    report.checks.append(
        Check(
            "Reversals that trip the healthy line without a guard, channel of 20 ms",
            float(sum(counts[key] for key in counts if key[0] == max(cases.REVERSAL_CHANNELS_MS))),
            1.0,
            at_least=True,
        )
    )
