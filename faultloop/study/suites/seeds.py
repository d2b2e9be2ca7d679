"""The five papers' cases: one module a paper, in ``faultloop.study.papers``.

What one of them lacks (an input that is missing, unreadable or makes no network) costs its own report only:
it then says so, and does not hold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np

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
        try:
            module = import_module(f"faultloop.study.papers.{PARTS[part]}")
            reports.append(module.report(quick))
        except (InputError, OSError, ImportError, np.linalg.LinAlgError) as error:
            reports.append(Report(part, f"Seed paper's part {part}", failed=" ".join(str(error).split())))
        progress((place + 1) / len(parts))
    return reports
