"""Ground loops of parallel lines: what the tables in ``cases/`` ask."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from faultloop.study.suites.functions import parallel_lines

Case = dict[str, Any]


def loop(given: Case) -> Case:
    """What the ground loop measures, per unit of the line, by the plant and by this suite's closed form."""
    x, fed, earthed = given["x"], given["fed"], given["earthed"]
    plain, compensated = parallel_lines.measured(x, fed, earthed)
    closed = parallel_lines.apparent(x, fed, earthed)[0]
    return {
        "plant": [plain.real, plain.imag],
        "closed_form": [closed.real, closed.imag],
        "compensated": [compensated.real, compensated.imag],
    }


def reach(given: Case) -> Case:
    """How far zone 1 of 80 % operates, by the relay."""
    return {"reach_pu": parallel_lines.reach(given["fed"], given["earthed"], given["compensated"])}


CHECKS: dict[str, Callable[[Case], Case]] = {"parallel-loop": loop, "parallel-reach": reach}
