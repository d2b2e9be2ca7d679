"""Line differential: each case with what is expected of each end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from faultloop.study.report import Check, Report
from faultloop.study.suites.differential import cases
from faultloop.study.suites.schemes import report_of
from faultloop.study.suites.schemes.network import Bench, Row

PARTS = {name: title for name, (title, _) in cases.PARTS.items()}
MEDIAN_MS, SLOWEST_MS = 12.0, 30.0


def run(parts: Sequence[str], *, quick: bool, progress: Callable[[float], Any]) -> list[Report]:
    """One report for each part."""
    bench = Bench()
    reports = []
    for place, part in enumerate(parts):
        title, make = cases.PARTS[part]
        todo = list(make(quick))
        rows: list[Row] = []
        for number, case in enumerate(todo):
            rows += bench.run(case)
            progress((place + (number + 1) / len(todo)) / len(parts))
        report = report_of(part, title + (", quick" if quick else ""), rows)
        if part == "internal":
            times = sorted(row.ms for row in rows)
            median = times[len(times) // 2]
            report.checks.append(
                Check("Median, with a channel of 0.24 ms on the bus", median, MEDIAN_MS, "ms")
            )
            report.checks.append(Check("Slowest", times[-1], SLOWEST_MS, "ms"))
        reports.append(report)
    return reports
