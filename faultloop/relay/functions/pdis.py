"""PDIS: distance zones.

Each zone measures how deep the fault lies in it, m, as a part of its reach
(`faultloop.relay.zone_depth`); it is inside where m < 1.  A zone without delay asks the samples, too
(`faultloop.relay.loop_fit`).
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from faultloop.config.tables import ComplexOhm, Milliseconds, Positive, Table
from faultloop.jit import njit
from faultloop.relay.characteristics import CROSS, MEMORY_POLARIZED, OFFSET, OUTSIDE, OWN, QUAD, SELF
from faultloop.relay.functions.function import Function, Polygon
from faultloop.relay.loop_fit import SHORTEST
from faultloop.relay.quantities import DEFAULT_CURRENT_A, LOOPS, Record, publish, request_trip
from faultloop.relay.unknown_vt import PHASORS_CYCLES, is_believed, is_believed_centred, weakness
from faultloop.relay.voltages import loops_of
from faultloop.relay.zone_depth import ALONE, BY_PHASORS, DOUBT, PHASORS_BEHIND, zone_depth

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

MAX_ZONES = 16
_POLARIZATION = {"self": SELF, "cross": CROSS, "memory": MEMORY_POLARIZED}
_DIRECTION = {"forward": 1, "reverse": -1, "none": 0}
_LOOPS = {"all": 0b111111, "ground": 0b000111, "phase": 0b111000}

HYSTERESIS = 1.05
FALLS = 12.0
"""How much a sample outside takes from what those inside have counted: as much as one deep inside."""
EARLY, YOUNG, STAYS = 8.0, 4.0, 0.5
"""How much what the fit leaves counts against the depth: behind a transformer that is not known to be ideal,
and while samples from before the fault are in its window, which means smooth over; in the first cycle inside;
of what counts then (`DOUBT`) the part that does however long it is inside.  Two means leave half of what one
does of noise, and the depth is no better for it: with 2 one of 56 faults on the parallel line was inside at
first (bench/security.py, seed 4711, case 28)."""
WHOLE = 3.0
"""In place of `YOUNG` from a cycle and a quarter on: what rings with another frequency has hardly a part in m
over a window so long."""
MIDDLE = 0.77
"""Up to here a sample counts eight times: three quarters of the reach, and what the capacitance adds.  With
0.8 zone 1 started for the SEL-311L's record, whose fault lies beyond it."""
SIXTEENTH = 16
"""Part of a cycle for which the fit must stand alone before a zone starts by it."""
POINTS = 73


class Pdis(Table):
    """``[[pdis]]``: one distance zone."""

    zone: int = Field(ge=1, le=99)
    """Its number; several tables may be of one zone, for ground and phase loops."""
    direction: Literal["forward", "reverse", "none"] = "forward"
    """Into the line, away from it, or both."""
    characteristic: Literal["mho", "quad"] = "mho"
    """A circle, or a quadrilateral."""
    polarization: Literal["self", "cross", "memory", "loop"] | None = None
    """Of a mho; "memory" where not given.  "loop" is a quad's, for faults that inverters feed: by the loop's
    own current; by the fault's, without load, where not given."""
    loops: Literal["all", "ground", "phase"] = "all"
    """Which loops it measures."""
    reach_pu: Positive | None = None
    """Of the line's positive-sequence impedance."""
    reach_ohm: Positive | None = None
    """In place of ``reach_pu``."""
    angle_deg: Annotated[float, Field(gt=0, le=90)] | None = None
    """Of the reach; the line's angle where not given."""
    resistive_reach_ohm: Positive | None = None
    """Of a quad: fault resistance of each phase (half the arc between two phases)."""
    resistive_reach_ground_ohm: Positive | None = None
    """Of a quad: fault resistance to ground; ``resistive_reach_ohm`` where not given."""
    tilt_deg: Annotated[float, Field(ge=-20, le=20)] = 3.0
    """Of a quad: how far the reactance line falls towards the resistive side."""
    residual_compensation_factor: ComplexOhm | None = None
    """k0; (z0 - z1) / (3 z1) of the line where not given."""
    delay_ms: Milliseconds = 0.0
    """From start to operate."""
    delay_phase_ms: Milliseconds | None = None
    """The same of faults between phases; ``delay_ms`` where not given."""
    delay_ground_ms: Milliseconds | None = None
    """The same of one-phase faults; ``delay_ms`` where not given."""
    minimum_current_a: Positive | None = None
    """Of the loop current (phase-phase, or compensated); 20 A primary where not given."""
    minimum_residual_current_a: Positive | None = None
    """Of 3I0, ground loops only; 20 A primary where not given."""
    security_cycles: Annotated[float, Field(ge=0, le=5)] = 1.0
    """How long a fault close to the reach must stay inside before the zone starts; deep inside, a tenth."""

    @model_validator(mode="after")
    def _whole(self) -> Pdis:
        if (self.reach_pu is None) == (self.reach_ohm is None):
            raise ValueError("give either reach_pu (of the line) or reach_ohm")
        if self.characteristic == "quad":
            if self.resistive_reach_ohm is None:
                raise ValueError('characteristic = "quad" needs resistive_reach_ohm')
            if self.polarization not in (None, "loop"):
                raise ValueError(f'polarization = "{self.polarization}" belongs to characteristic = "mho"')
        elif self.resistive_reach_ohm is not None or self.resistive_reach_ground_ohm is not None:
            raise ValueError('resistive_reach_ohm belongs to characteristic = "quad"')
        elif self.polarization == "loop":
            raise ValueError('polarization = "loop" belongs to characteristic = "quad"')
        return self


def values(settings: RelaySettings, table: Pdis) -> dict[str, Any]:
    """A zone in primary values and samples."""
    k0, phase = table.residual_compensation_factor, table.resistive_reach_ohm or 0.0
    trips = settings.ptrc.zones
    return {
        "direction": _DIRECTION[table.direction],
        "characteristic": _characteristic(table),
        "loops": _LOOPS[table.loops],
        "reach": reach_ohm(settings, table) * (-1 if table.direction == "reverse" else 1),
        "k0": settings.residual_compensation_factor if k0 is None else complex(*k0),
        "tilt": cmath.rect(1.0, math.radians(table.tilt_deg)),
        "resistive_phase": phase * settings.ohm_ratio,
        "resistive_ground": _given(table.resistive_reach_ground_ohm, phase) * settings.ohm_ratio,
        "delay_phase": settings.samples(_given(table.delay_phase_ms, table.delay_ms)),
        "delay_ground": settings.samples(_given(table.delay_ground_ms, table.delay_ms)),
        "minimum_current": settings.amperes(table.minimum_current_a, DEFAULT_CURRENT_A),
        "minimum_residual": settings.amperes(table.minimum_residual_current_a, DEFAULT_CURRENT_A),
        "security": table.security_cycles * settings.relay.sampling_hz / settings.relay.frequency_hz,
        "charged": charged_part(settings, table),
        "trips": trips is None or table.zone in trips,
        "pilot": table.zone == settings.ptrc.pilot_zone,
    }


def _given(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


def _characteristic(zone: Pdis) -> int:
    if zone.characteristic == "quad":
        return OWN if zone.polarization == "loop" else QUAD
    if zone.direction == "none":
        return OFFSET
    return _POLARIZATION[zone.polarization or "memory"]


def reach_ohm(settings: RelaySettings, zone: Pdis) -> complex:
    """A zone's reach, primary [ohm], with its angle; the direction is not in it."""
    if zone.reach_pu is not None:
        size = zone.reach_pu * abs(settings.z1_ohm)
    else:
        size = float(zone.reach_ohm or 0.0) * settings.ohm_ratio
    angle = cmath.phase(settings.z1_ohm) if zone.angle_deg is None else math.radians(zone.angle_deg)
    return cmath.rect(size, angle)


def charged_part(settings: RelaySettings, zone: Pdis) -> float:
    """The reach as a part of the line where its charging counts: a forward zone that ends on it; else 0."""
    part = abs(reach_ohm(settings, zone)) / abs(settings.z1_ohm)
    told = settings.line.b1_us is not None
    return part if told and zone.direction == "forward" and part < 1 else 0.0


@njit
def security_step(m: float) -> float:
    """How much one sample inside counts; a zone starts at ``security`` (a cycle): in the last tenth of the
    reach a fault must stay inside for one, which outlasts the swing that an offset gives the impedance."""
    if m < 0.5:
        return 12.0
    if m < MIDDLE:
        return 8.0
    return 2.0 if m < 0.9 else 1.0


@njit
def reset_zone(w: Record) -> None:
    """Back to rest."""
    w.counter = 0.0
    w.inside = w.alone = 0
    w.fault = 0
    w.outside = 0
    w.pickup = 0
    w.operate = 0
    w.timer = 0


@njit
def delay(c: Record, fault: int) -> int:
    """Of the zone for a type of fault [samples]."""
    return c.delay_ground if fault <= 3 else c.delay_phase


@njit
def doubt(g: Record, q: Record, w: Record) -> float:
    """How much what the fit leaves counts; infinite while the voltage cannot be trusted (`unknown_vt`).

    After a cycle inside less and less: what rings has gone by then, and what stays - noise, an offset that a
    transformer has added - says nothing against the depth; but behind a weak source, where the phasors decide
    in the end (`unknown_vt`).
    """
    ratio = weakness(g, q)
    if ratio > 0.0:
        if w.inside >= PHASORS_CYCLES * g.cycle:
            return BY_PHASORS
        return DOUBT if is_believed(g, q, ratio) or is_believed_centred(g, q, ratio) else np.inf
    early = not g.ideal_vt or 10 * q.memory.age < SHORTEST * g.cycle
    young = EARLY if early else WHOLE if 4 * q.memory.age >= 5 * g.cycle else YOUNG
    return young if w.inside < g.cycle else DOUBT * max(g.cycle / w.inside, STAYS)


@njit
def stands_alone(g: Record, q: Record, c: Record) -> bool:
    """Whether the fit may, in a zone that operates as it starts: neither in a swing, where it has no
    characteristic, nor behind a voltage transformer that is not known."""
    return delay(c, q.fault) == 0 and g.ideal_vt and not q.swing_fault


@njit
def step_zone(g: Record, q: Record, c: Record, w: Record, mask: int) -> None:
    """One sample of a zone in a disturbance: start, timer, operate."""
    at_once = delay(c, q.fault) < g.cycle
    least = -PHASORS_BEHIND if at_once and not w.pickup else -np.inf
    if weakness(g, q) > 0.0:
        least *= 2.0
    m = zone_depth(g, q, c, mask, BY_PHASORS, least)
    if w.pickup:
        w.outside = w.outside + 1 if m > HYSTERESIS else 0
        if w.outside * 8 >= g.cycle:
            reset_zone(w)
            return
        w.timer += 1
        if q.fault != 0:
            w.fault = q.fault
    else:
        if q.fault != w.fault:
            w.counter = 0.0
            w.inside = w.alone = 0
            w.fault = q.fault
        w.inside = w.inside + 1 if m < 1 else 0
        alone = OUTSIDE
        if m >= MIDDLE and (m < 1 or w.counter > 0.0) and stands_alone(g, q, c):
            alone = zone_depth(g, q, c, mask, ALONE, least)
        w.alone = w.alone + 1 if m >= 1 and alone < 1 else 0
        m = min(m, alone)
        if m < 1:
            w.counter += security_step(m)
        else:
            w.counter = max(w.counter - FALLS, 0.0)
        if m >= 1 or w.counter < c.security or 0 < SIXTEENTH * w.alone < g.cycle:
            return
        if at_once:
            if q.memory.age < g.lumped:
                return
            left = doubt(g, q, w)
            if left == np.inf or zone_depth(g, q, c, mask, left, least) >= 1:
                return
        w.pickup = 1
        w.outside = 0
        w.timer = 0
    w.operate = w.timer >= delay(c, w.fault)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of a zone; a change of voltage alone (a fuse, a fault far away) leaves it as it is."""
    if not q.disturbed:
        reset_zone(w)
        return
    if q.fed:
        mask = q.released & c.loops & ~q.blocked_loops
        if c.direction > 0:  # of two faults the one behind is in no loop that looks ahead
            mask &= ~loops_of(q.behind)
            if delay(c, q.fault) < g.cycle:
                mask &= ~loops_of(q.from_behind)
        step_zone(g, q, c, w, 0 if (q.blocked_zones >> c.number) & 1 else mask)
        q.zone_started |= w.pickup
    q.inside |= w.counter > 0
    q.pilot |= w.pickup & c.pilot
    q.zones |= w.pickup << c.number
    publish(q, c.bit, w.pickup, w.operate)
    if w.operate and c.trips:
        request_trip(q, c.bit, w.fault, 0)


def polygons(settings: RelaySettings, zone: Pdis) -> tuple[Polygon, Polygon]:
    """Closed polygons (k, 2) of (r, x) for ground loops and for phase loops, primary ohm; empty if unused.

    For people to look at: a mho is drawn self-polarized (polarized by memory or across it grows towards the
    source behind), a quadrilateral without load flow.
    """
    empty = np.empty((0, 2))
    ground, phase = _polygon(settings, zone, True), _polygon(settings, zone, False)
    return ground if zone.loops != "phase" else empty, phase if zone.loops != "ground" else empty


def _polygon(settings: RelaySettings, zone: Pdis, ground: bool) -> Polygon:
    reach = reach_ohm(settings, zone)
    if zone.characteristic == "mho":
        turn = np.exp(2j * np.pi * np.linspace(0, 1, POINTS))
        points = reach * turn if zone.direction == "none" else reach / 2 * (1 + turn)
    else:
        points = _quad(settings, zone, reach, ground)
    if zone.direction == "reverse":
        points = -points
    return np.column_stack([points.real, points.imag])


def _quad(settings: RelaySettings, zone: Pdis, reach: complex, ground: bool) -> NDArray[np.complex128]:
    resistance = (zone.resistive_reach_ohm or 0.0) * settings.ohm_ratio
    if ground:
        if zone.resistive_reach_ground_ohm is not None:
            resistance = zone.resistive_reach_ground_ohm * settings.ohm_ratio
        # In the loop's plane a resistance to ground is divided by 1 + k0 (no infeed from the far end).
        resistance /= abs(1 + settings.residual_compensation_factor)
    slope = math.tan(math.radians(zone.tilt_deg))
    along = complex(1 - slope * reach.real / reach.imag, -slope)  # the reactance line, per ohm of resistance
    right, left = reach + resistance * along, reach - resistance * along
    if zone.direction == "none":
        return np.array([right, left, -right, -left, right])
    low, border = np.exp(1j * np.radians([-settings.rdir.minimum_angle_deg, settings.rdir.maximum_angle_deg]))
    if _cross(left, border) > 0:  # the left blinder comes first; it goes down to the directional border
        corners = [left, left - reach * _cross(left, border) / _cross(reach, border)]
    else:
        corners = [reach - along * _cross(reach, border) / _cross(along, border)]
    below = low * _cross(resistance, reach) / _cross(low, reach)  # where the right blinder ends
    return np.array([0j, below, right, *corners, 0j])


def _cross(a: complex, b: complex) -> float:
    """Positive where b is to the left of a."""
    return a.real * b.imag - a.imag * b.real


def detail(on: frozenset[str]) -> str:
    """Faulted loops - as a type where they are one - and direction of a start."""
    loops = [loop for loop in LOOPS if f"PHS1.{loop}" in on]
    text = "ABC" if loops == ["AB", "BC", "CA"] else " ".join(loops)
    direction = "forward" if "RDIR1.DirFwd" in on else "reverse" if "RDIR1.DirRev" in on else ""
    return f"{text} {direction}".strip()


PDIS = Function(
    name="PDIS",
    settings=Pdis,
    step=step,
    constants=(
        ("direction", "i8"),
        ("characteristic", "i8"),
        ("loops", "i8"),  # mask
        ("reach", "c16"),  # negative for reverse
        ("k0", "c16"),
        ("tilt", "c16"),
        ("resistive_phase", "f8"),
        ("resistive_ground", "f8"),
        ("delay_phase", "i8"),
        ("delay_ground", "i8"),
        ("minimum_current", "f8"),
        ("minimum_residual", "f8"),
        ("charged", "f8"),  # the reach as a part of the line whose charging counts; 0: it does not
        ("security", "f8"),  # what the security counter must reach
        ("trips", "i8"),
        ("pilot", "i8"),
    ),
    values=values,
    state=(
        ("counter", "f8"),
        ("inside", "i8"),  # samples in a row
        ("alone", "i8"),  # samples in a row at which the fit stands alone
        ("fault", "i8"),  # the type it started with
        ("outside", "i8"),
        ("pickup", "i8"),
        ("operate", "i8"),
        ("timer", "i8"),
    ),
    most=MAX_ZONES,
    detail=detail,
    polygons=polygons,
)
