"""What kept a distance zone from operating."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.characteristics import QUAD
from faultloop.relay.functions.lphd import CAUSES as NOT_READY
from faultloop.relay.functions.lphd import CURRENT as CURRENT_MISSING
from faultloop.relay.functions.lphd import MISSING, READY, VANISHED
from faultloop.relay.functions.pdis import MAX_ZONES
from faultloop.relay.functions.phs import LOOP_MASK
from faultloop.relay.quantities import FAULTS, LOOPS
from faultloop.relay.zone_depth import PHASORS_BEHIND
from faultloop.review.why_stages import Cause, Facts, Verdict

NONE, SETTLE, UNFED, CURRENT, TYPE, LOOP, SIDE = range(7)
FUSE, SWING, REACH, STAY, CONFIRM, TIMER, SILENT, BEHIND = range(7, 15)
CAUSE: dict[int, Cause] = {
    NONE: "quiet",
    SETTLE: "not-settled",
    UNFED: "minimum-current",
    CURRENT: "minimum-current",
    TYPE: "phase-selection",
    LOOP: "blocked",
    SIDE: "direction",
    FUSE: "fuse-failure",
    SWING: "power-swing",
    REACH: "reach",
    STAY: "not-settled",
    CONFIRM: "not-settled",
    TIMER: "timer",
    SILENT: "blocked",
    BEHIND: "direction",
}
ALL_LOOPS = 0b111111
TRUE_LOOPS = {"ABG": "AB", "BCG": "BC", "CAG": "CA", "ABCG": "ABC"}


@dataclass(frozen=True)
class Zone:
    """A zone, the fault's time, and the loop by which it is judged."""

    facts: Facts
    truth: str | None

    @cached_property
    def fault(self) -> int:
        """Type: the true one; else the relay's, for as long as it was; 0 for none."""
        if self.truth is not None:
            return FAULTS.index(TRUE_LOOPS.get(self.truth, self.truth))
        types = self.shared["fault"][self.shared["unmeasured"] != ALL_LOOPS]
        return int(np.bincount(types[types > 0], minlength=1).argmax()) if (types > 0).any() else 0

    @cached_property
    def loops(self) -> list[int]:
        """The loops of the type that the zone measures."""
        mask = LOOP_MASK[self.fault] if self.fault else ALL_LOOPS
        own = int(self.c["loops"])
        return [k for k in range(6) if mask & own & 1 << k]

    @property
    def called(self) -> str:
        """The loop's name; empty where nothing happened."""
        if self.fault or not self.loops or not len(self.facts.rows):
            return FAULTS[self.fault]
        return LOOPS[self.nearest]

    @cached_property
    def nearest(self) -> int:
        """Of its loops the one with the smallest depth."""
        m = np.where(np.isfinite(self.z["m"]), self.z["m"], np.inf)
        return min(self.loops, key=lambda k: float(np.median(m[:, k])))

    @cached_property
    def judged(self) -> list[int]:
        """Columns of the depth that is told: of one loop, or of the three of a three-phase fault."""
        return self.loops if self.fault else [self.nearest]

    @property
    def shared(self) -> NDArray[np.void]:
        return self.facts.known.shared[self.facts.rows]

    @property
    def z(self) -> NDArray[np.void]:
        return self.facts.known.zones[self.facts.rows, self.facts.one.number]

    @property
    def c(self) -> np.void:
        return self.facts.known.constants["pdis"][self.facts.one.number]

    @cached_property
    def m(self) -> NDArray[np.float64]:
        """(n,) depth; infinite where it cannot be told."""
        if not self.judged:
            return np.full(len(self.facts.rows), np.inf)
        return _middles(np.where(np.isnan(self.z["m"]), np.inf, self.z["m"])[:, self.judged])

    @cached_property
    def stages(self) -> NDArray[np.int64]:
        """(n,) what stopped it at each sample: the first that did, in the order in which the relay asks."""
        q, z, c = self.shared, self.z, self.c
        mask = sum(1 << k for k in self.judged)
        inside = (self.m < 1) | (z["alone"] < 1)
        relay = self.facts.known.settings.relay
        delay = c["delay_ground" if self.judged and max(self.judged) < 3 else "delay_phase"]
        at_once = delay * relay.frequency_hz < relay.sampling_hz
        enough = np.any(z["current"][:, self.judged] >= 1, axis=1)
        if self.judged and max(self.judged) < 3:
            enough &= z["residual"] >= 1
        blocked = (q["blocked_zones"] >> self.facts.one.number & 1).astype(bool)
        wrong = (q["direction"] != c["direction"]) & (c["direction"] != 0)
        opposite = (q["direction"] == -c["direction"]) & (c["direction"] != 0)
        unreleased = (q["released"] & mask) == 0
        # of a phase that cannot be measured, or cut out as a load: not by the type
        out = ((q["unmeasured"] | q["blocked_loops"]) & mask) == mask
        behind = np.array([_behind(b) for b in range(8)])[q["behind"]] & mask if c["direction"] > 0 else 0
        conditions = [
            (z["operate"] > 0, SILENT),
            (z["pickup"] > 0, TIMER),
            (q["ready"] == 0, SETTLE),
            (blocked & inside & (q["fuse_failure"] > 0), FUSE),
            (blocked & inside, SWING),
            ((q["disturbed"] == 0) | (q["unmeasured"] == ALL_LOOPS), NONE),  # at rest, or nothing flows
            (q["fed"] == 0, UNFED),
            (opposite, SIDE),
            (~enough, CURRENT),
            (~inside, REACH),
            (at_once & (self.m < -PHASORS_BEHIND), BEHIND),
            (out, LOOP),
            (unreleased, TYPE),
            ((behind & mask) == mask if mask else np.zeros(len(q), bool), SIDE),
            (wrong, SIDE),
            (z["waits"] > 0, CONFIRM),
        ]
        return np.select([on for on, _ in conditions], [stage for _, stage in conditions], STAY)

    @cached_property
    def stage(self) -> int:
        """The one that held for longest in the second half of the time; a block before what is quiet."""
        stages = self.stages
        active = stages[stages != NONE]
        if not len(active):
            return NONE
        late = active[len(active) // 2 :]
        if self.truth is None:
            late = active  # without a fault there is no time that ends with it
            for stage in (TIMER, FUSE, SWING):
                if (late == stage).any():
                    return stage
        return int(np.bincount(late).argmax())

    @property
    def at(self) -> NDArray[np.intp]:
        """Rows at which that was so."""
        return np.flatnonzero(self.stages == self.stage)


def _middles(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sort(columns, axis=1)[:, 1] if columns.shape[1] == 3 else columns.min(axis=1)


def _behind(phases: int) -> int:
    """Loops of a mask of phases."""
    pairs = ((0,), (1,), (2,), (0, 1), (1, 2), (2, 0))
    return sum(1 << k for k, pair in enumerate(pairs) if any(phases >> p & 1 for p in pair))


def judge_zone(zone: Zone) -> Verdict:
    """Why it did not operate."""
    facts = zone.facts
    if zone.facts.one.number >= MAX_ZONES or not len(facts.rows):
        return Verdict("quiet", None, "nothing happened: no disturbance, no blocking")
    if not zone.loops:
        kinds = "ground" if int(zone.c["loops"]) == 0b111 else "phase"
        return Verdict(
            "phase-selection", None, f"measures {kinds} loops only; the fault is {FAULTS[zone.fault]}"
        )
    stage, at = zone.stage, zone.at
    if stage == NONE:
        return _quiet(zone)
    m = float(np.median(zone.m[at]))
    called = "-".join(zone.called) if zone.called in LOOPS else zone.called
    told = m if np.isfinite(m) else None
    where = f"{called or 'any loop'}" + ("" if told is None else f" {m:.2f} of reach")
    if told is None and stage == SIDE:
        where += " on the other side"
    cause, text = CAUSE[stage], _TEXTS[stage](zone, at)
    uncharged = np.median(_middles(zone.z["uncharged"][at][:, zone.judged])) if zone.judged else np.inf
    if stage == REACH and uncharged < 1:
        text = f"beyond its reach with the line's charging, b1_us and b0_us ({uncharged:.2f} by R and X)"
    elif stage == REACH and _by_resistance(zone, at):
        cause, text = "resistance", "outside by resistance" + _parts(zone, at)
    return Verdict(cause, told, f"{where}, {text}")


def _quiet(zone: Zone) -> Verdict:
    """Nothing changed, or the relay was blind to it: what LPHD said for most of the time."""
    causes = zone.shared["cause"][zone.shared["cause"] != READY]
    if 2 * len(causes) > len(zone.facts.rows):
        text = _BLIND.get(int(np.bincount(causes).argmax()))
        if text is not None:
            return Verdict("blocked", None, f"LPHD: {text}")
    return Verdict("quiet", None, "nothing happened: no disturbance, no blocking")


def _by_resistance(zone: Zone, at: NDArray[np.intp]) -> bool:
    """Whether the fault is within the reach along the reactance line, and so outside beside it."""
    x = _middles(zone.z["x"][at][:, zone.judged])
    return bool(np.median(np.where(np.isfinite(x), x, np.inf)) < 1)


def _parts(zone: Zone, at: NDArray[np.intp]) -> str:
    x = float(np.median(_middles(zone.z["x"][at][:, zone.judged])))
    r = float(np.median(_middles(np.abs(zone.z["r"][at][:, zone.judged]))))
    ground = max(zone.judged) < 3
    text = f" ({x:.2f} of reach along the reactance line"
    if zone.c["characteristic"] >= QUAD:
        limit = float(zone.c["resistive_ground" if ground else "resistive_phase"])
        return f"{text}, {r:.3g} of {limit:.3g} ohm)"
    return f"{text}, {r:.3g} ohm)"


def _unsettled(zone: Zone, at: NDArray[np.intp]) -> str:
    causes = zone.shared["cause"][at]
    cause = int(np.bincount(causes).argmax())
    return "the relay was not ready: " + (NOT_READY[cause] if cause < len(NOT_READY) else "no reference")


def _too_little(zone: Zone, at: NDArray[np.intp]) -> str:
    current = float(np.median(zone.z["current"][at][:, zone.judged].max(axis=1)))
    limit = float(zone.c["minimum_current"])
    if current < 1:
        return f"its current {current * limit:.3g} A is below minimum_current_a, {limit:.3g} A"
    residual, limit = float(np.median(zone.z["residual"][at])), float(zone.c["minimum_residual"])
    return f"3I0 {residual * limit:.3g} A is below minimum_residual_current_a, {limit:.3g} A"


def _unselected(zone: Zone, at: NDArray[np.intp]) -> str:
    types = zone.shared["fault"][at]
    fault = int(np.bincount(types).argmax())
    if fault == 0:
        return "inside, but the phase selection had no type yet"
    return f"inside, but the phase selection said {FAULTS[fault]} and released its loops"


def _unmeasured(zone: Zone, at: NDArray[np.intp]) -> str:
    mask = sum(1 << k for k in zone.judged)
    if np.median((zone.shared["unmeasured"][at] & mask) == mask) > 0.5:
        return "inside, but a voltage or current of its phases is missing, or its pole is dead"
    return "inside, but ZLOAD takes it for a load"


def _side(zone: Zone, at: NDArray[np.intp]) -> str:
    directions = zone.shared["direction"][at]
    said = {1: "forward", -1: "reverse", 0: "no direction"}[int(np.sign(np.median(directions)))]
    until = zone.facts.known.t_ns[zone.facts.rows[at[-1]]] - zone.facts.zero
    end = "" if at[-1] >= len(zone.facts.rows) - 2 else f" until {until / 1e6:.0f} ms"
    return f"blocked: RDIR {said}{end}"


def _fuse(zone: Zone, at: NDArray[np.intp]) -> str:
    return "inside, but TVTR has found a fuse failure"


def _swing(zone: Zone, at: NDArray[np.intp]) -> str:
    if zone.shared["swing"][at].any():
        return "inside, but RPSB has found a power swing"
    return "inside, but RPSB waits: the impedance still moves fast inside its outer box"


def _reach(zone: Zone, at: NDArray[np.intp]) -> str:
    return "beyond its reach"


def _far_behind(zone: Zone, at: NDArray[np.intp]) -> str:
    return f"behind the relay by more than {PHASORS_BEHIND:g} of its reach, where no fault ahead is"


def _stay(zone: Zone, at: NDArray[np.intp]) -> str:
    step_ms = 1e3 / zone.facts.known.settings.relay.sampling_hz
    stayed = float(zone.z["inside"][at].max()) * step_ms
    if (zone.z["alone"][at] < 1).mean() > 0.5:
        return "inside by the samples alone, but not for long enough"
    return f"inside for {stayed:.1f} ms only: so near the border it must stay longer (security_cycles)"


def _confirm(zone: Zone, at: NDArray[np.intp]) -> str:
    doubted = zone.z["confirmed"][at]
    if np.isinf(doubted).mean() > 0.5:
        return "inside, but behind so weak a source it waits for the voltage transformer's transient to go"
    depth = float(np.median(doubted))
    return f"inside, but in time (depth and what the fit leaves) it was {depth:.2f}, not below 1"


def _timer(zone: Zone, at: NDArray[np.intp]) -> str:
    step_ms = 1e3 / zone.facts.known.settings.relay.sampling_hz
    timer, delay = (float(zone.z[key][at].max()) * step_ms for key in ("timer", "delay"))
    left = "the fault was gone" if at[-1] >= len(zone.facts.rows) - 2 else "it reset"
    return f"started, and its timer was at {timer:.0f} of {delay:.0f} ms when {left}"


def _unfed(zone: Zone, at: NDArray[np.intp]) -> str:
    return "no current has changed by more than the pickups of [phs]"


def _silent(zone: Zone, at: NDArray[np.intp]) -> str:
    return "operated, but [ptrc] zones does not let it trip"


_BLIND = {
    MISSING: "voltages cannot be relied on, and loops with their phases measure nothing",
    CURRENT_MISSING: "the current of a phase is missing, and its loops and those to ground measure nothing",
    VANISHED: "all currents went at one moment, and nothing is measured",
}
_TEXTS = {
    SETTLE: _unsettled, UNFED: _unfed, CURRENT: _too_little, TYPE: _unselected, LOOP: _unmeasured,
    SIDE: _side, FUSE: _fuse, SWING: _swing, REACH: _reach,
    STAY: _stay, CONFIRM: _confirm, TIMER: _timer, SILENT: _silent, BEHIND: _far_behind,
}  # fmt: skip
