"""Whether the distance zones of a settings file can protect together.

Doubted, and told with the key and what would be right: a zone of a higher number that reaches less far, or
trips sooner, than one of a lower number in the same direction and loops; a next zone that is not sure of the
line's end; a zone that reaches beyond the line, or behind the relay, and does not wait for what protects
there; a ground loop that measures next to nothing; a zone that holds the load, or an area of loads that takes
in a part of a zone without delay, or a swing's box around the load; that no zone trips, a PSOF that takes
other things for a fault, an estimator that is none for zones.  Each may be meant - by a study, or by somebody
who numbers zones in another way - so nothing is refused.  Only zones that trip count: one that
starts a scheme may reach where it likes.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from faultloop.relay.estimators.protection import refusal
from faultloop.relay.functions import zload
from faultloop.relay.functions.function import Polygon
from faultloop.relay.functions.pdis import Pdis, polygons, reach_ohm
from faultloop.relay.swing_rule import inner_ohm, reaches

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

SELECTIVE_MS = 100.0
"""Less than this and a zone does not wait for a fault beyond the line to be cleared there."""
AT_MOST = 0.95
"""Of the line: a zone without delay, as transformers and the line's data have errors of 5 %."""
AT_LEAST = 1.05
"""Of the line: a zone that is sure of its end, for the same errors."""
LEAST_OF_GROUND = 0.5
"""Of its phase loops' reach: what a zone's ground loops reach at least."""
FARTHEST_PSOF = 3.0
"""Of the line: what PSOF reaches at most, to be sure of its end behind a strong infeed there."""
CLEAR_OF_LOAD = 0.8
"""Of the load's impedance: a zone that reaches less far along it is clear of it."""
SAME = 1e-3


class Doubt(NamedTuple):
    """What settings say that may not be meant: the key, what it does, and what would be right."""

    key: str
    text: str


class Zone(NamedTuple):
    """A zone that trips; ``key`` of its table, ``along`` the line it reaches (per unit), its delays
    for faults to ground and between phases, infinite for loops that it has not; its shape for the latter."""

    key: str
    table: Pdis
    along: float
    delays: tuple[float, float]
    shape: Polygon

    @property
    def reach_key(self) -> str:
        return f"{self.key}.{'reach_ohm' if self.table.reach_pu is None else 'reach_pu'}"


def doubts(settings: RelaySettings) -> list[Doubt]:
    """What the zones are set to do that may not be meant."""
    extended = None if settings.rrec is None else settings.rrec.extension_zone  # beyond the line, and meant
    zones = [zone for zone in settings.tripping_zones if zone.table.zone != extended]
    found = [
        *_beyond(settings, zones),
        *_short_of_the_end(zones),
        *_under_load_area(settings),
        *_beside_the_zones(settings),
    ]
    for one, other in combinations(zones, 2):
        near, far = sorted((one, other), key=lambda zone: zone.table.zone)
        if near.table.zone != far.table.zone and near.table.direction == far.table.direction:
            found += _out_of_order(near, far)
    return found


def load_doubts(settings: RelaySettings, load_ohm: complex) -> list[Doubt]:
    """Zones that hold a load whose impedance is ``load_ohm`` at the relay, into the line, primary."""
    found = [] if settings.rpsb is None else list(_box_around(settings, load_ohm))
    if settings.zload is not None and zload.is_in_area(settings, settings.zload, load_ohm):
        return found  # its loops are blocked
    for zone in settings.tripping_zones:
        if math.isfinite(zone.delays[1]) and _inside(load_ohm, zone.shape):
            found.append(Doubt(*_clear_of(settings, zone, load_ohm)))
    return found


def tripping_zones(settings: RelaySettings) -> list[Zone]:
    """Those that trip, of a settings file."""
    chosen = settings.ptrc.zones
    return [
        _zone(settings, f"pdis[{number}]", table)
        for number, table in enumerate(settings.pdis, start=1)
        if chosen is None or table.zone in chosen
    ]


def _zone(settings: RelaySettings, key: str, table: Pdis) -> Zone:
    ground, phase = (
        table.delay_ms if own is None else own for own in (table.delay_ground_ms, table.delay_phase_ms)
    )
    delays = (ground if table.loops != "phase" else math.inf, phase if table.loops != "ground" else math.inf)
    return Zone(key, table, along(settings, table, settings.z1_ohm), delays, polygons(settings, table)[1])


def along(settings: RelaySettings, table: Pdis, line: complex) -> float:
    """How far a zone reaches for bolted faults, per unit of a line of that impedance, primary: to where its
    circle, or its reactance line, crosses it."""
    reach = reach_ohm(settings, table)
    if table.characteristic == "mho":
        return abs(reach / line) * math.cos(cmath.phase(reach) - cmath.phase(line))
    tilt = cmath.rect(1.0, math.radians(table.tilt_deg))
    return (reach * tilt).imag / (line * tilt).imag


def _out_of_order(near: Zone, far: Zone) -> Iterator[Doubt]:
    """Of two zones in one direction, ``far`` of the higher number."""
    common = [k for k in (0, 1) if math.isfinite(near.delays[k]) and math.isfinite(far.delays[k])]
    if not common:
        return
    names = f"zone {far.table.zone}", f"zone {near.table.zone} ({near.key})"
    if far.along < near.along * (1 - SAME):
        what = f"of {names[0]} is {far.along:.3g} of the line and {names[1]} reaches {near.along:.3g}"
        given = far.table.reach_ohm if far.table.reach_pu is None else far.table.reach_pu
        yield Doubt(far.reach_key, f"{given:g} {what}; a zone of a higher number reaches farther")
    for k in common:
        if far.delays[k] < near.delays[k]:
            own = ("delay_ground_ms", "delay_phase_ms")[k]
            key = f"{far.key}.{'delay_ms' if getattr(far.table, own) is None else own}"
            what = f"{far.delays[k]:g} of {names[0]} is sooner than the {near.delays[k]:g} of {names[1]}"
            yield Doubt(key, f"{what}; a zone of a higher number waits at least as long")
            return


def _beyond(settings: RelaySettings, zones: list[Zone]) -> Iterator[Doubt]:
    for zone in zones:
        soonest, ground = min(zone.delays), _along_ground(settings, zone)
        key = f"{zone.key}.residual_compensation_factor"
        if ground < LEAST_OF_GROUND * zone.along:
            own = settings.residual_compensation_factor
            what = f"lets the ground loops reach {ground:.3g} of the line, not {zone.along:.3g}"
            yield Doubt(key, f"{what}; the line's own is [{own.real:.3g}, {own.imag:.3g}]")
        if soonest >= SELECTIVE_MS:
            continue
        trips = f"of zone {zone.table.zone} trips after {soonest:g} ms for faults"
        wait = "a delay of 300 ms, or a zone that is not in ptrc.zones"
        if zone.table.direction == "reverse":
            continue
        right = f"0.8 of the line is usual, or {wait}"
        if zone.along > AT_MOST:
            error = "" if zone.along > 1.0 else ", with an error of 5 %"
            yield Doubt(
                zone.reach_key, f"{zone.along:.3g} of the line {trips} beyond the line{error}; {right}"
            )
        elif ground > 1.0:
            what = f"lets the ground loops reach {ground:.3g} of the line, which {trips} beyond the line"
            yield Doubt(key, f"{what}; {right}")
        elif zone.table.direction == "none":
            what = f'"none" {trips} behind the relay, too; "forward" is usual, or {wait}'
            yield Doubt(f"{zone.key}.direction", what)


def _short_of_the_end(zones: list[Zone]) -> Iterator[Doubt]:
    """The next zone after those without delay, where neither is sure of the line's end: a fault there waits
    for the one after it, or does not trip."""
    ahead = [zone for zone in zones if zone.table.direction == "forward"]
    for k in (0, 1):
        at_once = [zone.along for zone in ahead if zone.delays[k] < SELECTIVE_MS]
        later = sorted((z for z in ahead if SELECTIVE_MS <= z.delays[k] < math.inf), key=lambda z: z.along)
        if at_once and later and max(at_once) < later[0].along < AT_LEAST:
            zone, rest = later[0], [z for z in later if z.along >= AT_LEAST]
            waits = (
                f"waits {rest[0].delays[k]:g} ms for zone {rest[0].table.zone}" if rest else "does not trip"
            )
            what = f"{zone.along:.3g} of the line is not beyond it, with an error of 5 %"
            yield Doubt(zone.reach_key, f"{what}: a fault at its end {waits}; 1.2 of the line is usual")
            return


def _beside_the_zones(settings: RelaySettings) -> Iterator[Doubt]:
    """What they are measured by, whether they trip, and what trips without them."""
    method, psof = settings.estimator.method, settings.psof
    reason = refusal(method)
    if reason is not None and settings.pdis:
        what = f"'{method}' is none for distance zones, taken as unsafe = true: {reason}"
        yield Doubt("estimator.method", f"{what}; 'kalman-bank' is safe")
    if settings.pdis and not settings.tripping_zones and settings.psch is None:
        numbers = sorted({zone.zone for zone in settings.pdis})
        yield Doubt(
            "ptrc.zones", f"[]: no zone trips, of {numbers}; name those that do, or leave it out for all"
        )
    cycle_ms = 1e3 / settings.relay.frequency_hz
    if psof.trip and psof.delay_ms < cycle_ms:
        what = f"{psof.delay_ms:g} is shorter than the estimator's window and an inrush's first peak"
        yield Doubt("psof.delay_ms", f"{what}: energising may trip without a fault; 25 is usual")
    if psof.trip and psof.reach_pu > FARTHEST_PSOF:
        what = f"{psof.reach_pu:g} of the line takes a fault far beyond it, or a load, for one on it"
        yield Doubt("psof.reach_pu", f"{what}; 1.2 is usual")


def _under_load_area(settings: RelaySettings) -> Iterator[Doubt]:
    """Zones without delay of which the area of loads takes in a part: a three-phase fault with an arc there
    does not trip."""
    table: Any = settings.zload
    if table is None:
        return
    for side, key in ((1, "resistance_ohm"), (-1, "reverse_resistance_ohm")):
        least = (table.reverse_resistance_ohm if side < 0 else None) or table.resistance_ohm
        for zone in settings.tripping_zones:
            if zone.delays[1] >= SELECTIVE_MS or zone.table.direction == ("forward", "reverse")[side > 0]:
                continue
            reach = _reach_within(zone.shape, side, math.radians(table.angle_deg)) / settings.ohm_ratio
            if reach > least:
                what = (
                    f"{least:g} is inside zone {zone.table.zone} ({zone.key}), which reaches {reach:.3g} ohm "
                    f"within {table.angle_deg:g} degrees: a three-phase fault with an arc there does not trip"
                )
                given = key if getattr(table, key) is not None else "resistance_ohm"
                yield Doubt(f"zload.{given}", f"{what}; above {reach:.3g} it is clear of it")
                break


def _reach_within(polygon: Any, side: int, half: float) -> float:
    """The farthest [ohm] that a polygon's border goes within ``half`` [rad] of the resistive axis, ahead
    (1) or behind (-1)."""
    corners = polygon[:, 0] + 1j * polygon[:, 1]
    steps = np.linspace(0.0, 1.0, 50)[:, None]
    border = side * (corners[:-1] * (1 - steps) + corners[1:] * steps).ravel()
    within = border[np.abs(np.angle(border)) <= half]
    return float(np.abs(within).max(initial=0.0))


def _box_around(settings: RelaySettings, load: complex) -> Iterator[Doubt]:
    """A swing's outer box that the load is in: what lasts there is no swing."""
    table: Any = settings.rpsb
    turned = load * settings.z1_ohm.conjugate() / abs(settings.z1_ohm)
    along, beside = turned.real, abs(turned.imag)
    outer = table.outer_resistance_ohm * settings.ohm_ratio
    forward, reverse = reaches(settings, table)
    apart = outer - inner_ohm(settings, table) * settings.ohm_ratio
    if beside < outer and -reverse - apart < along < forward + apart:
        limit = CLEAR_OF_LOAD * beside / settings.ohm_ratio
        what = (
            f"{table.outer_resistance_ohm:g} holds the load of {abs(load):.4g} ohm at "
            f"{math.degrees(cmath.phase(load)):.0f} degrees, where no swing is found"
        )
        yield Doubt("rpsb.outer_resistance_ohm", f"{what}; below {limit:.3g} it is clear of it")


def _along_ground(settings: RelaySettings, zone: Zone) -> float:
    """The same of its ground loops for a one-phase fault fed from here alone (I1 = I2 = I0)."""
    given = zone.table.residual_compensation_factor
    if given is None or not math.isfinite(zone.delays[0]):
        return zone.along
    return zone.along * abs((1 + complex(*given)) / (1 + settings.residual_compensation_factor))


def _inside(z: complex, polygon: Any) -> bool:
    """Whether a closed polygon (k, 2) goes around a point."""
    if not len(polygon):
        return False
    corners = polygon[:, 0] + 1j * polygon[:, 1] - z
    turn = np.angle(corners[1:] / corners[:-1]).sum()
    return bool(abs(turn) > math.pi)


def _clear_of(settings: RelaySettings, zone: Zone, load: complex) -> tuple[str, str]:
    """The key of what reaches into the load, and what would be right."""
    table, size, angle = zone.table, abs(load), cmath.phase(load)
    what = f"of zone {table.zone} holds the load of {size:.4g} ohm at {math.degrees(angle):.0f} degrees"
    if table.characteristic == "quad":
        limit = CLEAR_OF_LOAD * abs(load.real) / settings.ohm_ratio
        text = f"{table.resistive_reach_ohm:g} {what}; below {limit:.3g} it is clear of it"
        return f"{zone.key}.resistive_reach_ohm", text
    reach = reach_ohm(settings, table) * (-1 if table.direction == "reverse" else 1)
    if table.direction != "none":  # the chord of the circle along the load
        size /= math.cos(angle - cmath.phase(reach))
    unit = settings.ohm_ratio if table.reach_pu is None else abs(settings.z1_ohm)
    given = table.reach_ohm if table.reach_pu is None else table.reach_pu
    text = (
        f"{given:g} {what}; below {CLEAR_OF_LOAD * size / unit:.3g} it is clear of it, as a quadrilateral is"
    )
    return zone.reach_key, text
