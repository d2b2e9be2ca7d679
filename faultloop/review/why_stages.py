"""What kept a stage of current, voltage or frequency from operating: its quantity in the fault's time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from faultloop.io.mcap_reader import Log
from faultloop.relay.functions import overcurrent, ptoc, ptuv
from faultloop.relay.layout import Instance
from faultloop.review.retrace import Retraced
from faultloop.review.rows import Span, relay_rows

Cause = Literal[
    "operated",
    "reach",
    "resistance",
    "direction",
    "phase-selection",
    "timer",
    "minimum-current",
    "not-settled",
    "power-swing",
    "fuse-failure",
    "blocked",
    "pickup",
    "restraint",
    "no-signal",
    "no-start",
    "quiet",
]
CURRENTS, VOLTAGES, FREQUENCIES = ("PIOC", "PTOC"), ("PTUV", "PTOV"), ("PTUF", "PTOF")
OF_CURRENT = {
    overcurrent.PHASE: ("phases", "I"),
    overcurrent.RESIDUAL: ("residual", "3I0"),
    overcurrent.NEGATIVE: ("negative", "I2"),
}
OF_VOLTAGE = {
    ptuv.PHASE: ("phases", "V"),
    ptuv.PHASE_PHASE: ("pairs", "V"),
    ptuv.POSITIVE_SEQUENCE: ("positive", "V1"),
    ptuv.RESIDUAL: ("residual", "3V0"),
    ptuv.NEGATIVE_SEQUENCE: ("negative", "V2"),
}
_TURN = np.exp(2j * np.pi / 3 * np.arange(3))


@dataclass(frozen=True)
class Verdict:
    """A cause, the depth or the part of the pickup, and what a person reads."""

    cause: Cause
    m: float | None
    text: str


@dataclass(frozen=True, eq=False)
class Facts:
    """A function of a relay, and the time to be explained.

    Attributes
    ----------
    rows : of ``known``, in the fault's time.
    span_ns : that time [ns since the run's start].
    started : when it was started since the inception.
    trips : whether its operate is to trip.
    """

    log: Log
    one: Instance
    known: Retraced
    zero: int
    rows: NDArray[np.int64]
    span_ns: tuple[int, int]
    started: Sequence[Span]

    @property
    def constants(self) -> np.void:
        return self.known.constants[self.one.function.key][self.one.number]

    @property
    def trips(self) -> bool:
        names = self.constants.dtype.names or ()
        return "trips" not in names or bool(self.constants["trips"])

    def timer_ms(self, end_ns: int) -> float | None:
        """For how long it was started at its last start; None where it never was."""
        if not self.started:
            return None
        on, off = self.started[-1]
        return max(((end_ns if off is None else min(off, end_ns)) - on) / 1e6, 0.0)

    @property
    def fuse_failure(self) -> bool:
        return bool(len(self.rows)) and bool((self.known.shared["fuse_failure"][self.rows] > 0).mean() > 0.5)


def middle(m: NDArray[np.float64]) -> float | None:
    """Depth by the released loops: of three the middle one; None where it cannot be told."""
    m = np.sort(np.where(np.isnan(m), np.inf, m))
    found = float(m[1] if len(m) == 3 else m[0])
    return found if np.isfinite(found) else None


def measured(facts: Facts) -> tuple[float, str] | None:
    """Its quantity where it came nearest to operating, over the pickup; and as a text."""
    name, c = facts.one.function.name, facts.constants
    if name == "PDIF":
        return _differential(facts)
    if name == "PFRC":
        return _rate(facts)
    if name not in (*CURRENTS, *VOLTAGES, *FREQUENCIES):
        return None
    rows = relay_rows(facts.log, facts.known.name, *facts.span_ns)
    if not len(rows):
        return None
    if name in FREQUENCIES:
        f = rows.frequency[np.isfinite(rows.frequency)]
        if not len(f):
            return None
        found = float(f.min() if name == "PTUF" else f.max())
        return found / float(c["start"]), f"{found:.2f} Hz, set to {float(c['start']):.2f} Hz"
    if name in CURRENTS:
        (what, called), limit, of, unit = OF_CURRENT[int(c["quantity"])], float(c["pickup"]), "pickup", "A"
        found = float(np.nanmax(_sizes(rows.phasors[:, 3:], what).max(axis=1)))
    else:
        (what, called), limit, of, unit = OF_VOLTAGE[int(c["quantity"])], float(c["start"]), "start", "V"
        y = _sizes(rows.phasors[:, :3], what)
        low = name == "PTUV"
        size = y.max(axis=1) if bool(c["all"]) == low else y.min(axis=1)
        found = float(np.nanmin(size) if low else np.nanmax(size))
    part = found / limit
    return part, f"{called} {amount(found, unit)}, {part:.2f} of its {of}, {amount(limit, unit)}"


def amount(value: float, unit: str) -> str:
    """``86.3 V``, ``3.26 kA``, ``110 kV``."""
    return f"{value / 1e3:.4g} k{unit}" if value >= 1e3 else f"{value:.4g} {unit}"


def _rate(facts: Facts) -> tuple[float, str] | None:
    """The greatest rate over the stage's window, to its side."""
    c, (first_ns, end_ns) = facts.constants, facts.span_ns
    apart_s = float(c["window"]) * float(c["every"]) / facts.known.settings.relay.sampling_hz
    end_ns = max([end_ns, *(off for _, off in facts.started if off is not None)])
    rows = relay_rows(facts.log, facts.known.name, first_ns - round(apart_s * 1e9), end_ns)
    known = np.isfinite(rows.frequency)
    t, hz = (rows.t_ns[known] - first_ns) / 1e9, rows.frequency[known]
    later = t >= (t[0] + apart_s if len(t) else 0.0)
    if not later.any():
        return None
    rates = (hz[later] - np.interp(t[later] - apart_s, t, hz)) / apart_s
    found = float((np.abs(rates) if c["side"] == 0 else float(c["side"]) * rates).max())
    limit = float(c["start"])
    return found / limit, f"{found:.2f} Hz/s, set to {limit:.2f} Hz/s"


def _differential(facts: Facts) -> tuple[float, str] | None:
    """The greatest sum of all ends' currents."""
    all_, (first_ns, end_ns) = facts.known.compared, facts.span_ns
    rows = all_[(all_["t_ns"] >= first_ns) & (all_["t_ns"] <= end_ns)]
    if not len(rows):
        return None
    row, phase = np.unravel_index(int(np.argmax(rows["total"])), rows["total"].shape)
    total, bias = float(rows["total"][row, phase]), float(rows["bias"][row, phase])
    pickup = float(facts.constants["rule"][0]["pickup"])
    size = f"the ends' currents add up to {total:.4g} A in phase {'ABC'[phase]}, half their sizes to"
    return total / pickup, f"{size} {bias:.4g} A, pickup {pickup:.4g} A"


def _time(facts: Facts, m: float | None) -> str:
    """How long it takes: of an inverse curve at the greatest current; empty where it has none."""
    c, names = facts.constants, facts.constants.dtype.names or ()
    if facts.one.function.name == "PTOC":
        stage = SimpleNamespace(
            **{name: c[name].item() for name in ("kind", "k", "a", "c", "multiplier", "flat")}
        )
        seconds = ptoc.operating_time.py_func(stage, m) if m is not None and m > 1 else None
        at = "" if stage.kind == ptoc.DEFINITE else " at this current"
        return "" if seconds is None else f", {seconds * 1e3:.0f} ms{at},"
    if "delay" not in names:
        return ""
    return f", {float(c['delay']) * 1e3 / facts.known.settings.relay.sampling_hz:.0f} ms,"


def _sizes(x: NDArray[np.complex128], what: str) -> NDArray[np.float64]:
    """(n, k) sizes of what three phasors (n, 3) are taken as."""
    match what:
        case "phases":
            return np.abs(x)
        case "pairs":
            return np.abs(x - np.roll(x, -1, axis=1))
        case "residual":
            return np.abs(x.sum(axis=1, keepdims=True))
    turn = _TURN if what == "positive" else _TURN.conj()
    return np.abs((x @ turn)[:, None] / 3)


def judge(facts: Facts) -> Verdict | None:
    """Why it did not operate; None of a function that says nothing while it has not started."""
    found = measured(facts)
    m = None if found is None else found[0]
    where = "" if found is None else f"{found[1]}: "
    if facts.started:
        on, off = facts.started[-1]
        lasted = "still started at the end" if off is None else f"reset after {(off - on) / 1e6:.1f} ms"
        return Verdict("timer", m, f"{where}started, {lasted}, before its time{_time(facts, m)} had run")
    if facts.one.function.name == "PDIF" and found is None:
        return Verdict("blocked", None, "blocked: the currents of all ends were not there at the same time")
    if found is None or m is None:
        return None
    name, c = facts.one.function.name, facts.constants
    reached = m < 1 if name in ("PTUV", "PTUF") else m > 1
    if not reached:
        return Verdict("pickup", m, f"{where}its pickup was not reached")
    if name == "PDIF":
        return Verdict("restraint", m, f"{where}restrained: what flows through is no fault")
    if name in CURRENTS and c["emergency"] and not facts.fuse_failure:
        return Verdict("blocked", m, f"{where}an emergency stage, and no fuse has failed")
    if facts.fuse_failure:
        return Verdict("fuse-failure", m, f"{where}blocked: TVTR has found a fuse failure")
    if name in CURRENTS and c["direction"] != 0:
        set_to = "forward" if c["direction"] > 0 else "reverse"
        return Verdict("direction", m, f"{where}blocked: the current is not {set_to}")
    if name == "PTUV":
        return Verdict("blocked", m, f"{where}no voltage at all is no undervoltage (minimum_v)")
    return Verdict("not-settled", m, f"{where}not for long enough to start")
