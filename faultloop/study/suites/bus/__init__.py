"""CAN as a real bus: one module a part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from faultloop.study.report import Report

PARTS = {
    "fuzz": "fuzz",
    "loss": "loss",
    "babbling": "babbling",
    "response-times": "response",
}


def run(parts: Sequence[str], *, quick: bool, progress: Callable[[float], Any]) -> list[Report]:
    """One report for each part; each module has ``report(quick) -> Report``."""
    reports = []
    for place, part in enumerate(parts):
        module = import_module(f"faultloop.study.suites.bus.{PARTS[part]}")
        reports.append(module.report(quick))
        progress((place + 1) / len(parts))
    return reports
