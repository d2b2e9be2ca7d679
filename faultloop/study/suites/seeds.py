"""The five papers' cases: one module a paper, in ``faultloop.study.papers``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from faultloop.study.report import Report

PARTS = {
    "adaptive-kalman": "adaptive_kalman",  # 000
    "mstukf": "mstukf",  # 001
    "taylor-kalman": "taylor_kalman",  # 002
    "ckmc": "ckmc",  # 003
    "rls": "rls",  # 004
}


def run(parts: Sequence[str], *, quick: bool, progress: Callable[[float], Any]) -> list[Report]:
    """One report for each paper; each module has ``report(quick) -> Report``."""
    reports = []
    for place, part in enumerate(parts):
        module = import_module(f"faultloop.study.papers.{PARTS[part]}")
        reports.append(module.report(quick))
        progress((place + 1) / len(parts))
    return reports
