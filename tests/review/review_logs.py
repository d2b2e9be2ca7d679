"""Logs whose every number is known: sinusoids and phasors written down, no plant and no relay."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from faultloop.io.can.frames import Heartbeat, State
from faultloop.io.can.table import Kind
from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.review.summary import summarize
from faultloop.review.text import tables

RATE, F0 = 4800, 50.0
START_NS = 1_577_836_800_000_000_000
FAULT_NS, DECIDED, RECEIVED_NS, OPENED_NS = (
    100_260_416,
    580,
    121_100_000,
    (160_000_001, 163_000_003, 162_000_002),
)
BITS = ("PDIS1", "PDIS2", "RDIR1.DirFwd", "PHS1.AG", "PTRC1")
SQUARE = np.array([[-5.0, 0], [20, 0], [20, 50], [-5, 50], [-5, 0]])
BEFORE = np.array([127e3, 127e3, 127e3, 400, 400, 400]) * np.exp(
    1j * np.radians([30, -90, 150, 20, -100, 140])
)
FAULT = np.array([80e3, 126e3, 125e3, 4000, 380, 390]) * np.exp(
    1j * np.radians([28, -91, 151, -50, -98, 141])
)
LOOP_OHM = 3.5 + 16j

SCENARIO = {
    "scenario": {"name": "known", "duration_s": 0.4},
    "system": {"frequency_hz": 50},
    "fault": [{"name": "F1", "line": "AB", "at_pu": 0.4, "type": "AG", "resistance_ohm": 1.0}],
    "relay": [{"name": "R1", "line": "AB", "breaker": "Q1"}],
}
SETTINGS = {
    "relay": {"frequency_hz": 50, "ohms": "secondary", "ct_ratio": 1000.0, "vt_ratio": 2000.0},
    "line": {"z1_ohm": [3.0, 20.0]},
}


def times(n: int) -> np.ndarray:
    return np.arange(n) * 1_000_000_000 // RATE


def rows(n: int) -> dict[str, np.ndarray]:
    """Steady before the fault and in it; the estimates step over at once, the samples have a known peak."""
    t = times(n)
    fault = t >= FAULT_NS
    phasors = np.where(fault[:, None], FAULT, BEFORE)
    phasors[t >= max(OPENED_NS)] = np.concatenate([BEFORE[:3], np.zeros(3)])
    turn = np.exp(2j * np.pi * F0 * t / 1e9)
    samples = np.sqrt(2) * np.real(phasors * turn[:, None])
    if n > 600:
        samples[600, 3] = -9000.0
    loops = np.full((n, 12), np.nan)
    loops[:, 0], loops[:, 1] = np.where(fault, LOOP_OHM.real, 317.0), np.where(fault, LOOP_OHM.imag, 4.0)
    pairs = np.stack([phasors.real, phasors.imag], axis=2).reshape(n, 12)
    count = np.arange(n)
    during = (count >= 540) & (count < 800)
    pickup = np.where(during, 0b01110, 0).astype(np.uint64)
    pickup[(count >= 560) & during] |= np.uint64(0b10001)
    operate = np.where((count >= DECIDED) & during, 0b10001, 0).astype(np.uint64)
    return {
        "t_ns": t,
        "counts": count,
        "samples": samples,
        "phasors": np.column_stack([pairs, np.full(n, 50.0), np.zeros(n)]),
        "loops": loops,
        "pickup": pickup,
        "operate": operate,
    }


def write_log(path: Path, n: int = 1920, *, truth: bool = True, nan: bool = False, relay: str = "R1") -> Path:
    """A closed-loop run with one relay; without ``truth`` what a replay leaves."""
    metadata: dict[str, Any] = {"settings": {relay: json.dumps(SETTINGS)}}
    if truth:
        metadata["scenario"] = {"name": "known", "json": json.dumps(SCENARIO)}
    with LogWriter(path, START_NS, metadata) as log:
        log.add_relay(relay, BITS, {"PDIS1": (SQUARE, SQUARE), "PDIS2": (1.4 * SQUARE, np.empty((0, 2)))})
        block = rows(n)
        if nan:
            for name in ("samples", "phasors", "loops"):
                block[name][:] = np.nan
        log.relay_block(relay, *block.values())
        if not nan:
            _trip(log, relay, n)
        if truth:
            _plant(log, n)
    return path


def _trip(log: LogWriter, relay: str, n: int) -> None:
    at = int(times(n)[DECIDED]) if n > DECIDED else None
    if at is None:
        return
    trip = {"function": "PDIS1", "zone": 1, "loop": "AG", "poles": 7, "sample_count": DECIDED}
    log.message(f"/relay/{relay}/trips", at, "Trip", **trip)
    for level, text in ((3, "PTRC1 Tr poles ABC zone 1 loop AG"), (2, "RFLO1 fault AG at 0.401 of the line")):
        log.message(f"/relay/{relay}/events", at, "foxglove.Log", level=level, message=text, name=relay)


def _plant(log: LogWriter, n: int) -> None:
    closed = {"pole_a": True, "pole_b": True, "pole_c": True}
    log.message("/breaker/Q1", 0, "BreakerStatus", **closed)
    beat = Heartbeat(0, 5, 0, 0, 0).encode()
    log.message("/can", 1_000, "CanFrame", id=beat.id, data=beat.data, direction="tx", sender="R1")
    log.message("/can", 2_000, "CanFrame", id=0x7FF, data=b"\x01", direction="rx")
    if n <= DECIDED:
        return
    log.message("/plant/faults", FAULT_NS, "FaultState", fault=0, on=True, type="AG")
    # A command of another relay at the same breaker, after the decision and before this relay's own frame.
    log.message("/breaker/Q1", RECEIVED_NS - 50_000, "BreakerStatus", command="open", **closed)
    frame = State(Kind.TRIP, 0, 7, 2, 0, 1, 0).encode()
    log.message("/can", RECEIVED_NS, "CanFrame", id=frame.id, data=frame.data, direction="tx", sender="R1")
    log.message("/breaker/Q1", RECEIVED_NS, "BreakerStatus", command="open", **closed)
    for t_ns, pole in sorted(zip(OPENED_NS, ("pole_a", "pole_b", "pole_c"), strict=True)):
        closed[pole] = False
        log.message("/breaker/Q1", t_ns, "BreakerStatus", **closed)
    log.message("/plant/faults", 300_000_000, "FaultState", fault=0, on=False, type="AG")


def check_tables(printed: str, log: Path) -> None:
    """Every cell of every table of a log's review is whole on its line, as a terminal then wraps it."""
    lines = printed.splitlines()
    shown = list(tables(summarize(open_log(log))))
    assert len(shown) >= 3
    for title, columns, rows in shown:
        first = next(k for k, line in enumerate(lines) if line.rstrip() == title)
        assert all(column.removeprefix(">") in lines[first + 1] for column in columns)
        for line, cells in zip(lines[first + 2 :], rows, strict=False):
            assert all(cell in line for cell in cells), (line, cells)
