"""Every check that a validation case may name: from its input to named values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from faultloop.study.suites.functions import (
    inverter_checks,
    parallel_checks,
    plant_checks,
    relay_checks,
    sequence_checks,
)

CHECKS: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    **plant_checks.CHECKS,
    **inverter_checks.CHECKS,
    **relay_checks.CHECKS,
    **sequence_checks.CHECKS,
    **parallel_checks.CHECKS,
}
