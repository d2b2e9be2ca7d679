"""Validation of the functions and components: every case of ``cases/`` as a row, and diagrams."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from faultloop.errors import InputError
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.functions import diagrams, inverter_network
from faultloop.study.suites.functions.cases import Case, Compared, cases_of

PARTS = {
    "curves": "Inverse-time overcurrent: curves, resets, the disc",
    "functions": "Protection functions, their kernels alone",
    "components": "Components of the primary system",
    "inverters": "Protection elements with faults that inverters feed",
    "parallel-lines": "Ground loops of parallel lines, without compensation and with",
    "sequences": "Reclosing and breaker failure in the closed loop",
}
DIAGRAMS: dict[str, Callable[[bool], list[Any]]] = {
    "curves": diagrams.curves,
    "inverters": inverter_network.diagrams,
    "parallel-lines": diagrams.parallel,
    "functions": diagrams.functions,
}
TABLES: dict[str, Callable[[bool], Table]] = {"inverters": inverter_network.table}
COLUMNS = ("", "of", "case", "what", "expected", "got", "tolerance", ">off, of it", "origin")
MOST_DIGITS = 6


def run(parts: Sequence[str], *, quick: bool, progress: Callable[[float], Any]) -> list[Report]:
    """One report for each part."""
    total = sum(len(list(cases_of(part))) for part in parts)
    done, reports = 0, []
    for part in parts:
        report = Report(f"functions-{part}", PARTS[part])
        try:
            rows = []
            for case in cases_of(part):
                compared = case.compared()
                rows += [(case, one) for one in compared]
                done += 1
                progress(done / total)
            fill(report, rows)
            if part in TABLES:
                report.tables.append(TABLES[part](quick))
            report.diagrams += DIAGRAMS[part](quick) if part in DIAGRAMS else []
        except InputError as error:
            report.failed = str(error)
        reports.append(report)
    return reports


def fill(report: Report, rows: Sequence[tuple[Case, Compared]]) -> None:
    """A row for everything that is compared, and a check for what each table is of."""
    origins = list(dict.fromkeys(case.origin for case, _ in rows))
    shown = [
        (
            "held" if one.held else "MISSED",
            case.of,
            case.name,
            one.key,
            told(one.expected),
            told(one.got),
            "the same" if one.tolerance is None else str(one.tolerance),
            one.off,
            f"[{origins.index(case.origin) + 1}]",
        )
        for case, one in rows
    ]
    note = " ".join(f"[{number}] {origin}." for number, origin in enumerate(origins, 1))
    report.tables.append(Table("Cases", COLUMNS, shown, note))
    for of in dict.fromkeys(case.of for case, _ in rows):
        own = [one for case, one in rows if case.of == of]
        what = f"{of}: largest difference in {len(own)} comparisons, of the tolerance"
        report.checks.append(Check(what, max(one.off for one in own), 1.0))


def told(value: Any) -> str:
    """As a table shows it: numbers with six digits."""
    if isinstance(value, list | tuple):
        return ", ".join(told(one) for one in value)
    return f"{value:.{MOST_DIGITS}g}" if isinstance(value, float | int) else str(value)
