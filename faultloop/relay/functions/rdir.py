"""RDIR: the direction of a fault, for every type and position, with the voltage gone too.

First comes the energy of the change (`faultloop.relay.energy`): its sign is right at every moment, while
phasors still ring.  It stands until something else is seen for a cycle, with phasors that stand still,
and not in the first two cycles: then the fault has changed sides, or what was switched is no single fault.
The power of the change must go the other way meanwhile, and its energy fall below what it was before: a
network that resonates near the nominal frequency looks capacitive, and its impedance then is that of a fault
on the other side; and what rings gives back again and again what it has taken.  That, and where the energy
has no sign, is judged by impedance.  Where PHS tells a fault ahead from one behind in other phases, the
direction is that of the one ahead.

What a fault adds to a sequence network has V / I = -Zs of the source behind for a forward fault, and
plus the impedance of the line and the source ahead for a reverse one; half the line's impedance lies between
the two however strong the sources are (Roberts and Guzman 1993, for the negative sequence).  Load does not
enter it, and it is greatest where the loop's own voltage is zero.  So the measure is

    z = Re(sum V (I e^(j arg Z1))*) / sum |I|^2

- in the first two cycles over the change of positive and of negative sequence: every fault has the first,
  and each is weighted by its current, so that a transient's share of negative sequence does not decide;
- then over the negative sequence alone, which needs no memory; where it is too small beside load, over the
  zero sequence with the line's Z0;
- for a balanced fault that lasts longer, the positive-sequence voltage, for the first four cycles with a
  fifth of the remembered one mixed in so that it does not vanish, against the current: forward within
  -15 .. 115 degrees, reverse opposite.  Later the sources may have slipped since, and what is remembered says
  nothing against a direction: where no voltage is left the last one stands, and so it does, as the type of
  the fault, once they are seen to slip (RPSB).

Inverters.  All of this takes the network on the other side of the fault for passive, with voltages of its own
that stay; a converter is neither, and the angle of what it feeds is its control's.  But it feeds little.  A
fault behind the relay changes voltages and currents in the ratio of the impedance ahead, one ahead in that of
the source behind: with nothing but inverters on one side, a ratio above every one that the other side can
have (``source_ohm``) is theirs, so the fault is on the other side of the relay, whatever the angles say.
Below it the current comes from the synchronous side, for which the above holds.  Only magnitudes of positive
and negative sequence are in it, so neither a resistance at the fault nor the transformer's zero sequence is.

Why not the loop voltage with memory for everything: with load and fault resistance its angle wanders, and
during the estimator's transient it starts from the load's direction; sequence changes are the safer evidence
where they exist.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.energy import POWER, STAYS_CYCLES
from faultloop.relay.functions.function import Function
from faultloop.relay.memory import positive_sequence, size2, weight
from faultloop.relay.quantities import Record, indicate
from faultloop.relay.standing import standing_place
from faultloop.relay.swing import BALANCED

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

MEMORY_SHARE = 0.2
AS_BEFORE = 2
ALL_POLES = 7
YOUNG_CYCLES = 2
TURNED = 0.01
"""Of the apparent power of the change: so much of it must go the other way."""
STILL = 0.05
"""Of the whole change, within a sixteenth of a cycle."""
_AWAY = {"none": 0, "behind": 1, "ahead": -1}
"""Where a fault is that only inverters feed through the relay's place."""
SOURCE_MARGIN = 1.25
GROUND_IN_SWING = 0.5
"""Of the least unbalance: above it I0 tells the side of a fault in a swing."""
AT_THE_RELAY = 0.01
"""Of the line: nearer to the relay a place by impedance alone has no side."""


class Rdir(Table):
    """``[rdir]``: the directional element and the memory that it, the zones and the phase selection share."""

    memory_ms: Milliseconds = 200.0
    """How long the pre-fault voltage polarizes; it then fades into the present one within 100 ms."""
    minimum_angle_deg: Annotated[float, Field(ge=0, le=45)] = 15.0
    """Forward reaches this far below the resistive axis ..."""
    maximum_angle_deg: Annotated[float, Field(ge=90, le=165)] = 115.0
    """... and up to here, in the positive-sequence element."""
    z2_forward_pu: Annotated[float, Field(ge=-1, le=1)] = 0.5
    """Forward where the negative-sequence impedance is below this part of the line's."""
    z2_reverse_pu: Annotated[float, Field(ge=-1, le=2)] = 0.6
    """Reverse where it is above this one."""
    minimum_unbalance: Annotated[float, Field(gt=0, lt=1)] = 0.1
    """Of I2 (or I0) over I1: below it the positive-sequence element decides."""
    inverters: Literal["none", "behind", "ahead"] = "none"
    """The side on which, at times, nothing but inverters feeds a fault."""
    source_ohm: Positive | None = None
    """With it: the greatest positive-sequence impedance that the other side can have, as the relay sees it:
    the sources behind, or (inverters behind) the line with all that is ahead."""

    @model_validator(mode="after")
    def _order(self) -> Rdir:
        if (self.inverters == "none") != (self.source_ohm is None):
            raise ValueError('inverters = "behind" or "ahead" and source_ohm go together')
        if self.z2_reverse_pu <= self.z2_forward_pu:
            raise ValueError("z2_reverse_pu must be above z2_forward_pu")
        return self


def values(settings: RelaySettings, table: Rdir) -> dict[str, Any]:
    """The borders of forward and reverse."""
    return {
        "sector_low": cmath.rect(1.0, -math.radians(table.minimum_angle_deg)),
        "sector_high": cmath.rect(1.0, math.radians(table.maximum_angle_deg)),
        "z2_forward": table.z2_forward_pu,
        "z2_reverse": table.z2_reverse_pu,
        "away": _AWAY[table.inverters],
        "source": SOURCE_MARGIN * (table.source_ohm or 0.0) * settings.ohm_ratio,
    }


def check(settings: RelaySettings) -> None:
    """What is ahead of a relay with inverters behind has the line in it."""
    table, line = settings.rdir, abs(settings.z1_ohm) / settings.ohm_ratio
    if table.inverters == "behind" and (table.source_ohm or 0.0) <= line:
        what = (
            f"must be the whole line, {line:.4g} ohm, with what is ahead of it, as the inverters are behind;"
            f" not {table.source_ohm:g}"
        )
        raise InputError(what, key="rdir.source_ohm")


@njit
def fed_by_inverters(g: Record, q: Record, c: Record, w: Record) -> int:
    """1 where the change is that of a source weaker than any of the synchronous side, -1 where it is not,
    0 while neither has stood for an eighth of a cycle."""
    d = q.change
    voltage2, current2 = size2(d[1]) + size2(d[2]), size2(d[4]) + size2(d[5])
    now = 1 if voltage2 > c.source**2 * current2 else -1
    w.fed_for = w.fed_for + 1 if now == w.fed else 1
    w.fed = now
    return now if 8 * w.fed_for >= g.cycle else 0


@njit
def polarizing_voltage(g: Record, q: Record) -> complex:
    """Positive-sequence polarizing voltage: the memory while it holds, fading into the present one."""
    m = q.memory
    v1 = q.sequence[1]
    remembered = positive_sequence(m.reference)
    if q.swing_fault or q.slides:
        return v1  # the one before has moved
    if m.age <= g.memory:
        return remembered
    if m.age >= g.memory + g.fade:
        return v1
    part = (m.age - g.memory) / g.fade
    return (1 - part) * remembered + part * v1


@njit
def projection(v: complex, i: complex, line: complex) -> float:
    """Re(V (I e^(j arg Z))*) |Z|, and so |I|^2 |Z| times the part of V / I along the line's angle."""
    axis = i * line
    return v.real * axis.real + v.imag * axis.imag


@njit
def by_impedance(c: Record, power: float, current2: float, line: complex) -> int:
    """1 forward, -1 reverse, 0 between, from the sums of `projection` and of |I|^2, and the line."""
    z = power / (current2 * size2(line))
    if z < c.z2_forward:
        return 1
    return -1 if z > c.z2_reverse else 0


@njit
def by_sector(c: Record, v: complex, i: complex) -> int:
    """1 where v leads i by an angle within the forward sector, -1 within the opposite one, else 0."""
    z = v * i.conjugate()
    low = z.imag * c.sector_low.real - z.real * c.sector_low.imag
    high = z.imag * c.sector_high.real - z.real * c.sector_high.imag
    if low >= 0 and high <= 0:
        return 1
    return -1 if low < 0 and high > 0 else 0


@njit
def agreed(g: Record, q: Record, c: Record, by_place: int) -> int:
    """The side by a place, but where I2 says the other one; an open pole's I2 says nothing."""
    i1, i2 = q.sequence[4], q.sequence[5]
    if q.closed != ALL_POLES or size2(i2) < g.minimum_unbalance**2 * size2(i1):
        return by_place
    by_current = by_impedance(c, projection(q.sequence[2], i2, g.z1), size2(i2), g.z1)
    return 0 if by_current == -by_place else by_place


@njit
def in_swing(g: Record, q: Record, c: Record) -> int:
    """What this sample says of a fault in a swing, in which nothing from before is known: by the place of a
    loop that stands still, else by the negative and zero sequence, of a balanced one by its impedance."""
    v0, v1, v2, i0, i1, i2 = q.sequence
    if q.standing:
        m, left = standing_place(g, q)
        if abs(m) > max(AT_THE_RELAY, left):
            return agreed(g, q, c, 1 if m > 0.0 else -1)
        if q.swing_fault == BALANCED:
            return 0
    if q.swing_fault == BALANCED:
        return by_sector(c, v1, i1) if size2(v1) > AT_THE_RELAY**2 * size2(g.z1 * i1) else 0
    least = g.minimum_unbalance**2 * size2(i1)
    if size2(i2) > least:
        return by_impedance(c, projection(v2, i2, g.z1), size2(i2), g.z1)
    if size2(i0) > GROUND_IN_SWING**2 * least:  # I0 is no image of the slip in the estimate, as I2 may be
        return by_impedance(c, projection(v0, i0, g.z0), size2(i0), g.z0)
    return 0


@njit
def indication(g: Record, q: Record, c: Record, w: Record) -> int:
    """What this sample says: 1 forward, -1 reverse, 0 nothing, 2 as before."""
    if q.swing_fault:
        return in_swing(g, q, c)
    d = q.change
    first = projection(d[1], d[4], g.z1) + projection(d[2], d[5], g.z1)
    current2 = size2(d[4]) + size2(d[5])
    floor = (0.1 * g.minimum_current) ** 2
    if q.memory.age <= 2 * g.cycle and current2 > floor:
        return by_impedance(c, first, current2, g.z1)
    v0, v1, v2, i0, i1, i2 = q.sequence
    if q.closed != 7:  # with a pole open only what the fault added tells
        v0, i0, v2, i2 = d[0], d[3], d[2], d[5]
    least = max(g.minimum_unbalance**2 * size2(i1), floor)
    if q.fault != 7 and size2(i2) > least:
        return by_impedance(c, projection(v2, i2, g.z1), size2(i2), g.z1)
    if q.fault <= 3 and size2(i0) > least:
        return by_impedance(c, projection(v0, i0, g.z0), size2(i0), g.z0)
    if size2(i1) < g.minimum_current**2 / 4:
        return 0
    v = (1 - MEMORY_SHARE) * v1 + MEMORY_SHARE * q.polarizing
    if w.direction and q.memory.age > STAYS_CYCLES * g.cycle:
        v = v1  # the sources may have slipped since: what they were says nothing against what was decided
    if size2(v) > 0.01**2 * size2(positive_sequence(q.memory.reference)):
        return by_sector(c, v, i1)
    return AS_BEFORE


@njit
def agree(w: Record) -> None:
    """Nothing speaks against the energy: the sums begin anew."""
    w.contrary = 0
    w.power = w.apparent = 0.0


@njit
def watch_floor(g: Record, q: Record, w: Record) -> None:
    """While nothing speaks against the energy: keep the least of it, counted to its own side, of the last one
    to two cycles."""
    e = q.energy
    sent = -e.direction * (e.before[POWER] + e.now[POWER])
    w.floor_age += 1
    if w.floor_age >= g.cycle:
        w.floor_age = 0
        w.floor_before, w.floor = w.floor, sent
    w.floor = min(w.floor, sent)


@njit
def has_gone_back(q: Record, w: Record) -> bool:
    """Whether the energy is below what it was before something spoke against it: what rings takes back what
    it has been given, again and again, and no more."""
    e = q.energy
    return -e.direction * (e.before[POWER] + e.now[POWER]) < min(w.floor_before, w.floor)


@njit
def stands_still(g: Record, q: Record) -> bool:
    """Whether the phasors move by less than a twentieth of what has changed since before the disturbance."""
    return q.memory.drift < STILL**2 * weight(g, q.d)


@njit
def contradicts(g: Record, q: Record, w: Record, candidate: int) -> bool:
    """Whether another direction than the energy's has stood for a cycle, with phasors that stand still whose
    power goes that way."""
    if candidate in (0, q.energy.direction) or not stands_still(g, q):
        agree(w)
        watch_floor(g, q, w)
        return False
    w.contrary += 1
    power = voltage2 = current2 = 0.0
    for k in range(3):
        power += (q.d[k] * q.d[3 + k].conjugate()).real
        voltage2 += size2(q.d[k])
        current2 += size2(q.d[3 + k])
    w.power += power
    w.apparent += math.sqrt(voltage2 * current2)
    return w.contrary >= g.cycle and w.power * candidate < -TURNED * w.apparent and has_gone_back(q, w)


@njit
def forget(w: Record) -> None:
    """Back to rest."""
    w.direction = w.candidate = w.count = w.against = w.changed = w.crossed = w.fed = w.fed_for = 0
    w.floor = w.floor_before = 0.0
    w.floor_age = 0
    agree(w)


@njit
def decide(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of the directional element, during a disturbance; with ``q.polarizing``.

    Given once the fault's type is known; one by impedance must stand for a sixteenth of a cycle, and another
    one than was given before only while phasors stand still.  On the side on which the energy has not been
    there is none until it has stood for a cycle: a current transformer that saturates in either half of a
    cycle gives back what it has let through, and leaves a current that leads by up to a right angle (2 of
    3,024 faults ahead started the reverse zone; part ct-saturation of the distance suite).  A line beside a
    faulted one of 256 km rang by 14 times what the fault changed in it; its energy had lost its sign, and
    zone 1 started (seed 80001 of bench/security.py, network 1944, fault 22, end 1).
    """
    q.polarizing = polarizing_voltage(g, q)
    if q.dead == ALL_POLES:  # an open line has no direction
        forget(w)
        return
    fed = fed_by_inverters(g, q, c, w) if c.away else -1
    if fed >= 0:  # by inverters, or not yet known
        w.count = 0
        agree(w)
        w.direction = c.away if fed and q.fault else 0
        return
    if q.slides and w.direction:
        return
    candidate = indication(g, q, c, w)
    if candidate == AS_BEFORE:
        return
    w.count = w.count + 1 if candidate == w.candidate else 1
    w.candidate = candidate
    opposed = candidate != 0 and candidate == -q.energy.given and not q.swing_fault
    w.against = w.against + 1 if opposed and stands_still(g, q) else 0
    if q.crossed:
        w.crossed = 1
    if q.memory.age <= YOUNG_CYCLES * g.cycle:
        w.changed = 0
        agree(w)
        watch_floor(g, q, w)
    elif contradicts(g, q, w, candidate):
        w.changed = 1
    w.changed |= w.crossed
    if q.fault == 0:
        return
    if q.crossed:
        w.direction = 1
    elif q.energy.direction != 0 and not w.changed:
        w.direction = q.energy.direction
    elif q.memory.age > g.cycle and w.count * 16 >= g.cycle and (w.direction == 0 or stands_still(g, q)):
        w.direction = 0 if opposed and not w.changed and w.against < g.cycle else candidate


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample; publishes ``q.direction`` and, while disturbed, ``q.polarizing``."""
    if q.disturbed and not q.fuse_failure:
        decide(g, q, c, w)
    else:
        forget(w)
    q.direction = w.direction
    indicate(q, c.bit, w.direction > 0)
    indicate(q, c.bit + 1, w.direction < 0)


RDIR = Function(
    name="RDIR",
    settings=Rdir,
    step=step,
    constants=(
        ("sector_low", "c16"),  # unit phasors at the borders of the forward sector
        ("sector_high", "c16"),
        ("z2_forward", "f8"),  # of the line's impedance
        ("z2_reverse", "f8"),
        ("away", "i8"),  # from the inverters: 1 ahead, -1 behind; 0 there are none
        ("source", "f8"),  # greatest impedance of the other side, with a margin [ohm]
    ),
    values=values,
    state=(
        ("direction", "i8"),
        ("candidate", "i8"),
        ("count", "i8"),
        ("against", "i8"),  # samples in a row of the side on which the energy has not been
        ("contrary", "i8"),  # samples in a row of something else than the energy's
        ("power", "f8"),  # sums over them: of the change's power ...
        ("apparent", "f8"),  # ... and of what it could be
        ("floor", "f8"),  # least energy to its own side, of this cycle's part so far ...
        ("floor_before", "f8"),  # ... and of the cycle before
        ("floor_age", "i8"),
        ("changed", "i8"),
        ("crossed", "i8"),  # there have been faults on both sides: the energy is that of two
        ("fed", "i8"),  # 1 by inverters, -1 by the synchronous side ...
        ("fed_for", "i8"),  # ... for so many samples
    ),
    always=True,
    bits=("DirFwd", "DirRev"),
    told=False,
    check=check,
)
