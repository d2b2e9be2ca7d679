"""What line differential tells of the other ends: sets that do not come, ways and clocks that change."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from faultloop.relay.events import Event, Names

BRIDGED = 2
"""Cycles for which sets are kept."""
STILL = 0.9
"""Of ``asymmetry_ms``: so much has to be left before the rules are no longer the harder ones."""


def tell(names: Names, was: Any, now: Any) -> Iterator[Event]:
    """Sets that do not come, and what becomes of ways and clocks."""
    if now["losses"] != was["losses"]:
        text = f"PDIF1 ChBlk: no currents of the other end at the same time, {why_not(names, now)}; "
        yield Event(names.sample, "warning", text + "the function is out, zones are not")
    for before, far in zip(was["remote"], now["remote"], strict=True):
        who = f"relay number {far['number']}"
        if far["switches"] > before["switches"]:
            text = f"PDIF1: another path to {who}: {far['trip_us'] / 1e3:.2f} ms there and back"
            yield Event(names.sample, "warning", f"{text}, its ways differ by {far['ways_us'] / 1e3:.2f} ms")
        if far["jumps"] > before["jumps"]:
            text = (
                f"PDIF1: the clock here or of {who} has jumped, they differ by {far['clock_us'] / 1e3:.2f} ms"
            )
            yield Event(names.sample, "warning", text)
        if far["holds"] > before["holds"]:
            text = f"PDIF1 ChAsym: this end or {who} has lost the time, and the round trip stands in for it"
            yield Event(names.sample, "warning", f"{text}; the rules are the harder ones")
    if now["harder"] and not was["harder"] and not any(now["remote"]["held"]):
        text = f"PDIF1 ChAsym: {doubts(names, now)}; the rules are the harder ones"
        yield Event(names.sample, "warning", text)


def doubts(names: Names, now: Any) -> str:
    """Of the end whose ways differ or vary most, which of the two they do, or both."""
    far = max(now["remote"], key=lambda one: max(abs(one["ways_us"]), 2 * one["vary_us"]))
    differ, vary = abs(far["ways_us"]), 2 * far["vary_us"]
    table = names.settings.pdif
    limit_us = min(1e3 * STILL * table.asymmetry_ms if table is not None else 0.0, max(differ, vary))
    sizes = (("differ", differ), ("vary", vary))
    found = [f"{what} by {size / 1e3:.2f} ms" for what, size in sizes if size >= limit_us]
    return f"the ways to relay number {far['number']} and back {' and '.join(found)}"


def why_not(names: Names, now: Any) -> str:
    """Why there is nothing to compare."""
    table = names.settings.pdif
    bridged_ms = 1e3 * BRIDGED / names.settings.relay.frequency_hz
    for k, far in enumerate(now["remote"][: now["remotes"]]):
        who = f"relay number {far['number']}"
        if now["out_of_time"] >> k & 1:
            if table is not None and table.alignment == "channel":
                return f"as the round trip to {who} is not known"
            if abs(far["clock_us"]) > 1000.0:
                return f"as the clocks here and of {who} differ by {far['clock_us'] / 1e3:.2f} ms"
            return f"as this end or {who} has lost the time"
        if far["late_us"] > 1e3 * bridged_ms:
            return f"as those of {who} take {far['late_us'] / 1e3:.1f} ms, of {bridged_ms:g} that are bridged"
    return "as none is accepted"
