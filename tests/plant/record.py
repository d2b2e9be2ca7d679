"""Runs a plant and keeps what it gives."""

from __future__ import annotations

from faultloop.plant import Plant
from faultloop.study.suites.functions.two_ended import record

__all__ = ["now_ns", "record"]


def now_ns(plant: Plant) -> int:
    """Time of the last sample."""
    return (plant.sample_count - 1) * 10**9 // plant.sampling_hz
