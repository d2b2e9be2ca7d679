"""Type tests of the distance relay in the style of IEC 60255-121: docs/distance-suite.md."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import pyarrow as pa

from faultloop.errors import InputError
from faultloop.study.report import Report
from faultloop.study.suites.distance.section import Section
from faultloop.study.suites.distance.sweep import Sweep, run_sweeps

PARTS = {
    "static-accuracy": "static_accuracy",
    "operate-time": "operate_time",
    "sir-contours": "sir_contours",
    "transient-overreach": "transient_overreach",
    "cvt": "cvt",
    "directional": "directional",
    "frequency": "frequency",
    "harmonics": "harmonics",
    "noise": "noise",
    "ct-saturation": "ct_saturation",
    "line-lengths": "line_lengths",
    "breaker-opening": "breaker_opening",
    "energising": "energising",
    "evolving": "evolving",
    "double-infeed": "double_infeed",
    "estimators": "estimators",
}
"""The module of each, in ``sections``."""
TAKES = ("workers", "keep")


def module_of(part: str) -> Section:
    """The module of a part."""
    return cast("Section", import_module(f"faultloop.study.suites.distance.sections.{PARTS[part]}"))


def run(
    parts: Sequence[str],
    *,
    quick: bool,
    progress: Callable[[float], Any],
    workers: int = 1,
    keep: Path | None = None,
) -> list[Report]:
    """One report for each part.

    Parameters
    ----------
    workers : processes; 1 runs in this one.
    keep : a folder for the campaigns' Parquet files; what is there is not run again.
    """
    sweeps: dict[str, dict[str, Sweep]] = {part: module_of(part).sweeps(quick) for part in parts}
    together = {name: sweep for own in sweeps.values() for name, sweep in own.items()}
    folder = tempfile.TemporaryDirectory(prefix="faultloop-suite-") if keep is None else nullcontext(keep)
    with folder as place:
        Path(place).mkdir(parents=True, exist_ok=True)
        tables = run_sweeps(together, Path(place), workers, progress)
    return [_report(part, own, tables, quick) for part, own in sweeps.items()]


def _report(part: str, sweeps: Mapping[str, Sweep], tables: Mapping[str, pa.Table], quick: bool) -> Report:
    """Of one part; a case that could not be run costs its own report only."""
    report = Report(f"distance-{part}", module_of(part).TITLE)
    if quick:
        report.text.append("Quick: few of the cases.")
    try:
        rows = {name: sweep.rows(tables[name]) for name, sweep in sweeps.items()}
        module_of(part).fill(report, rows)
    except InputError as error:
        report.failed = str(error)
    report.text.append(f"{sum(sweep.cases for sweep in sweeps.values())} cases.")
    return report
