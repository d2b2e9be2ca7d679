"""The five papers' cases: one module a paper, in ``faultloop.study.papers``.

An input that one of them lacks costs its own report only: it then says what is missing, and does not hold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from faultloop.errors import InputError
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
        try:
            reports.append(module.report(quick))
        except InputError as error:
            reports.append(Report(part, f"Seed paper's part {part}", failed=str(error)))
        progress((place + 1) / len(parts))
    return reports
