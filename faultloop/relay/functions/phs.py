"""PHS: which loop the fault is in, from what the fault added.

PHS is no logical node of IEC 61850-7-4, which has none for phase selection: it is an extension.

Phase-phase changes contain no zero sequence; with equal positive- and negative-sequence networks they
depend on r = dI2 / dI1 alone, and so not on load, fault resistance or infeed:

    A-G     r = 1                    |d_bc| = 0, |d_ab| = |d_ca|
    B-C     r = -1                   |d_bc| = 2 |d_ab| = 2 |d_ca|
    B-C-G   r = -Z0 / (Z0 + Z2)      |d_bc| greatest, the others more than half of it
    A-B-C   r = 0                    all equal, no negative or zero sequence

The measure is |dV|^2 + |Z1|^2 |dI|^2: behind a strong source the current carries it, behind a weak one the
voltage does, for a forward or reverse fault alike.  The changes are against the memory's reference, so an
open pole or a load is not taken for a fault.  Ge Yaozhong (1996) and Benmouyal and Mahseredjian (2001)
select by superimposed phase-phase currents; the voltage term is ours, for weak infeed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

from numpy.typing import NDArray
from pydantic import Field

from faultloop.config.tables import Positive, Table
from faultloop.jit import njit
from faultloop.relay import swing
from faultloop.relay.currents import blocked_loops
from faultloop.relay.functions.function import Function
from faultloop.relay.line_fit import pairs_alike
from faultloop.relay.memory import A2, A, current_limit2, positive_sequence, size2, weight
from faultloop.relay.quantities import LOOPS, Record, indicate, sequences
from faultloop.relay.voltages import ALL_PHASES, loops_of

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

STILL = 0.08
"""Of the whole change, within a sixteenth of a cycle."""
SIDE_COSINE = 0.6
"""Of the angle between a phase's drop and its voltage before: nearer to square, and its side is not known."""
LASTS = 8
"""Part of a cycle for which the phasors must stand still to say for good that something has changed behind:
an estimator that begins anew, as at each surge of a line that rings, holds them for a twelfth (nine faults in
273,000 within 76 % of the line, all on lines that ring, never started zone 1; bench/security.py, seed
91001)."""
TAKES_PART = 0.3
"""Of the greatest change of a phase voltage and of a phase current: less, and the phase is healthy ..."""
OWN_DROP = 0.2
"""... unless along the line that current drops so much of the phase's own change of voltage: beside a fault
close in, the one behind is fed from the line's far end."""
FALLS = 0.5
"""Cosine of the angle between a voltage's change and its fall."""
LEAST_GROUND = 0.3
"""Of the negative sequence: so much zero sequence tells the phase of a fault to ground ..."""
AGREE = 0.866
"""... within 30 degrees of that phase's negative sequence: their angle's cosine."""
LOWEST = 0.8
"""Of the other two phases' voltages: below it one is the faulted phase's, where a line that is energised
takes as much charge as a weak source feeds the fault."""
LOOP_MASK = (0, 1, 2, 4, 8, 16, 32, 56)
"""Loops released by fault type."""
TYPE_OF_PHASES = (0, 1, 2, 4, 3, 6, 5, 7)
"""Fault type by the mask of its phases."""
PHASES_OF_TYPE = (0, 1, 2, 4, 3, 6, 5, 7)
"""And the mask by the type."""
PHASE_TURN = (complex(1), A2, A)


class Phs(Table):
    """``[phs]``: fault detection and phase selection on superimposed quantities."""

    pickup_current_a: Positive | None = None
    """A change of a phase current that is a disturbance; 10 A primary where not given."""
    pickup_current_pu: Annotated[float, Field(gt=0, lt=1)] = 0.1
    """The same, of the positive-sequence load current; the greater one holds."""
    pickup_voltage_pu: Annotated[float, Field(gt=0, lt=1)] = 0.08
    """A change of a phase voltage that is a disturbance, of the voltage before."""
    single_phase_ratio: Annotated[float, Field(gt=0, lt=0.5)] = 0.3
    """One-phase where the healthy pair's change is below this part of the greatest."""
    three_phase_unbalance: Annotated[float, Field(gt=0, lt=0.5)] = 0.2
    """Three-phase where the changes of negative and zero sequence are below this part of the positive."""


def values(settings: RelaySettings, table: Phs) -> dict[str, Any]:
    """One phase or two (pickups and three phases are shared: `faultloop.relay.quantities`)."""
    return {"single_phase": table.single_phase_ratio}


@njit
def is_energised(g: Record, q: Record) -> bool:
    """Whether the line carried nothing before: what it takes now, load and charge, is in the change, too.
    With a phase whose voltage is missing the sequences tell nothing."""
    if q.proven != ALL_PHASES:
        return False
    limit, reference = current_limit2(g, q.memory.reference), q.memory.reference
    return max(size2(reference[3]), size2(reference[4]), size2(reference[5])) < limit


@njit
def sequences_agree(g: Record, change: NDArray, phase: int) -> bool:
    """Whether zero and negative sequence of this phase have one angle, as in its fault to ground, or in that
    of the other two; in one of this phase and another they are 120 degrees apart, less the angle of a
    resistance to ground, which makes the zero sequence small."""
    turned = PHASE_TURN[phase].conjugate()
    v2, i2 = turned * change[2], turned * change[5]
    z2 = size2(g.z1)
    zero, negative = size2(change[0]) + z2 * size2(change[3]), size2(v2) + z2 * size2(i2)
    common = change[0] * v2.conjugate() + z2 * change[3] * i2.conjugate()
    return zero > LEAST_GROUND**2 * negative and common.real > AGREE * abs(common)


@njit
def is_lowest(x: NDArray, phase: int) -> bool:
    """Whether this phase's voltage is well below the others'."""
    others = min(size2(x[(phase + 1) % 3]), size2(x[(phase + 2) % 3]))
    return size2(x[phase]) < LOWEST**2 * others


@njit
def is_one_phase(
    g: Record, q: Record, c: Record, change: NDArray, phase: int, pairs: tuple[float, float, float]
) -> bool:
    """By the squared changes of the ``pairs``: that of the healthy phases first, then those with this phase.

    What a line takes that is energised is of positive sequence, and in the healthy pair's change alone.
    Where the other two sequences, which have nothing of it, agree, that need be no more than the least, or
    this phase's voltage the lowest.
    """
    healthy, least = pairs[0], min(pairs[1], pairs[2])
    if healthy < c.single_phase**2 * least:
        return True
    if not (is_energised(g, q) and sequences_agree(g, change, phase)):
        return False
    return healthy < least or is_lowest(q.x, phase)


@njit
def classify(g: Record, q: Record, c: Record, d: NDArray, change: NDArray) -> int:
    """Fault type 1 .. 7 from the change of the phasors."""
    z2 = size2(g.z1)
    ab = size2(d[0] - d[1]) + z2 * size2(d[3] - d[4])
    bc = size2(d[1] - d[2]) + z2 * size2(d[4] - d[5])
    ca = size2(d[2] - d[0]) + z2 * size2(d[5] - d[3])
    zero = size2(change[0]) + z2 * size2(change[3])
    positive = size2(change[1]) + z2 * size2(change[4])
    negative = size2(change[2]) + z2 * size2(change[5])
    limit = g.three_phase**2 * positive
    if negative < limit and zero < limit:
        return 7
    if zero > 0.01 * positive:  # a tenth: there is ground in it, so it may be one phase
        if is_one_phase(g, q, c, change, 0, (bc, ab, ca)):
            return 1
        if is_one_phase(g, q, c, change, 1, (ca, ab, bc)):
            return 2
        if is_one_phase(g, q, c, change, 2, (ab, bc, ca)):
            return 3
    if ab >= bc and ab >= ca:
        return 4
    return 5 if bc >= ca else 6


@njit
def classify_without_load(g: Record, q: Record, c: Record) -> int:
    """The type if the load had gone: the currents as they are, the voltages' change."""
    d, change = q.memory.work, q.work
    for k in range(3):
        d[k], d[3 + k] = q.d[k], q.x[3 + k]
        change[k], change[3 + k] = q.change[k], q.sequence[3 + k]
    return classify(g, q, c, d, change)


@njit
def side(g: Record, q: Record, phase: int) -> int:
    """Where a phase's own fault is: 1 ahead, -1 behind, 0 not known, or the phase is healthy.

    By the change of its current alone, against its voltage before: the residual current has the other phases'
    faults in it.
    """
    before = PHASE_TURN[phase] * positive_sequence(q.memory.reference)
    dv, drop = q.d[phase], g.z1 * q.d[3 + phase]
    voltage2 = current2 = 0.0
    for k in range(3):
        voltage2 = max(voltage2, size2(q.d[k]))
        current2 = max(current2, size2(q.d[3 + k]))
    small = size2(q.d[3 + phase]) < TAKES_PART**2 * current2 and size2(drop) < OWN_DROP**2 * size2(dv)
    if small or size2(dv) < TAKES_PART**2 * voltage2:
        return 0
    if -(dv * before.conjugate()).real < FALLS * math.sqrt(size2(dv) * size2(before)):
        return 0
    along, most = (drop * before.conjugate()).real, math.sqrt(size2(drop) * size2(before))
    if along > SIDE_COSINE * most:
        return 1
    return -1 if along < -SIDE_COSINE * most else 0


@njit
def watch_sides(g: Record, q: Record, w: Record) -> None:
    """Keep how long each phase's own fault has been on its side: in samples of phasors that stand still, as
    what rings can look like anything.  Of the memory's reference, and so for as long as it polarizes."""
    still = q.memory.drift < STILL**2 * weight(g, q.d)
    for phase in range(3):
        now = side(g, q, phase) if q.memory.age <= g.memory else 0
        w.stood[phase] = w.stood[phase] + still if now == w.side[phase] else 0
        w.side[phase] = now


@njit
def phases_at(g: Record, w: Record, of_side: int) -> int:
    """Mask of the phases whose own fault has been on this side for half a cycle."""
    mask = 0
    for phase in range(3):
        if w.side[phase] == of_side and 2 * w.stood[phase] >= g.cycle:
            mask |= 1 << phase
    return mask


@njit
def is_fed(q: Record, phases: int) -> bool:
    """Whether in one of these the current has risen and the voltage fallen since the first has settled."""
    before = q.second.reference
    for phase in range(3):
        fallen = size2(q.x[phase]) < size2(before[phase])
        risen = size2(q.x[3 + phase]) > size2(before[3 + phase])
        if (phases >> phase) & 1 and fallen and risen:
            return True
    return False


@njit
def watch_second(g: Record, q: Record, c: Record, w: Record) -> None:
    """Type and side of a second fault, by the change against what the first has settled to.

    Only one that takes in a further phase, and more current there, is a fault: what else changes then, the
    first one's clearing or an infeed that goes, has the first one's phases or takes the load away.  But
    whatever changes behind makes no fault ahead: zones without delay do not start by its phases.
    """
    s = q.second
    if not s.active:
        w.again = w.again_count = w.again_still = 0
        if s.settled:
            w.first, w.first_side = w.fault, q.direction
        return
    sequences(s.d, q.work)
    candidate = classify(g, q, c, s.d, q.work)
    if candidate != w.again:
        w.again = candidate
        w.again_count = 0
    still = q.memory.drift < STILL**2 * weight(g, s.d)
    w.again_still = w.again_still + 1 if still else 0
    w.again_count += 16 if still or candidate == 7 else 2
    first, now = PHASES_OF_TYPE[w.first], PHASES_OF_TYPE[candidate]
    if w.again_count < g.cycle:
        return
    lasts = LASTS * w.again_still >= g.cycle
    if s.energy.direction > 0:
        w.from_behind &= ~now
    elif s.energy.direction < 0 and w.first_side > 0 and lasts and g.ideal_vt:
        w.from_behind |= now
    if not is_fed(q, now & ~first):
        return
    if s.energy.direction > 0 and w.first_side < 0:
        w.ahead, w.aside = candidate, first & ~now
    elif s.energy.direction < 0 and w.first_side > 0:
        w.ahead, w.aside = w.first, now & ~first
    elif s.energy.direction > 0 and w.first_side > 0:
        w.before, w.also = w.first, candidate


@njit
def disputed(w: Record, candidate: int) -> bool:
    """Whether a fault of more phases may be two: one of its phases is ahead now, and one behind."""
    if candidate <= 3:
        return False
    ahead = behind = 0
    for phase in range(3):
        ahead += w.side[phase] > 0
        behind += w.side[phase] < 0
    return ahead > 0 and behind > 0


@njit
def select_in_swing(g: Record, q: Record, w: Record) -> None:
    """One sample of the phase selection in a swing, which itself changes all phases: no two faults are told
    apart.  A type stands for a quarter of a cycle, or by its loops for a sixteenth."""
    candidate = swing.fault_type(g, q)
    if candidate != w.candidate:
        w.candidate = candidate
        w.count = 0
    w.count += 16 if q.standing or candidate == 7 else 4
    if w.count >= g.cycle:
        w.fault = candidate


@njit
def forget(w: Record) -> None:
    """What is known of two faults."""
    w.crossed = w.behind = w.disputed = 0
    w.first = w.first_side = w.again = w.again_count = w.again_still = w.ahead = w.aside = 0
    w.before = w.also = w.from_behind = 0
    w.side[:] = 0


@njit
def select(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of the phase selection, during a disturbance.

    A type must stand for a sixteenth of a cycle while the phasors stand still, or for half a cycle while
    the estimator is still on its way to the fault's state: on the way each phase has its own transient,
    and a three-phase fault can look like a two-phase one.  Once settled, the type is changed only while
    something moves - a slow swing during a long fault is no new fault - and not where the far end's opening
    explains it, which takes the load away from the healthy phases.  What looks like several phases in turn is
    three-phase if the samples say so (`line_fit.pairs_alike`).

    Of two faults on two sides (cross-country) the change tells neither: the type is that of the phases ahead,
    as a loop on the line still measures its own.  What looks like that waits for up to a cycle, or zone 1
    would have tripped for both before.
    """
    candidate = classify(g, q, c, q.d, q.change)
    settled = w.fault != 0 and q.memory.age >= 2 * g.cycle
    if settled and candidate != w.fault and classify_without_load(g, q, c) == w.fault:
        candidate = w.fault
    unsure = 3 < candidate < 7 and not settled and (w.fault == 0 or w.fault == 7)
    if unsure and pairs_alike(g, q.recent, q.memory.age):
        candidate = 7
    if candidate != w.candidate:
        w.candidate = candidate
        w.count = 0
    still = q.memory.drift < STILL**2 * weight(g, q.d)
    w.count += 16 if still or candidate == 7 else 2
    watch_sides(g, q, w)
    w.disputed = w.disputed + 1 if disputed(w, candidate) else 0
    waits = 0 < w.disputed <= g.cycle
    w.behind = phases_at(g, w, -1)
    w.crossed = TYPE_OF_PHASES[phases_at(g, w, 1)] if w.behind else 0
    watch_second(g, q, c, w)
    if w.ahead:
        w.crossed, w.behind = w.ahead, w.aside
    if w.crossed:
        w.fault = w.crossed
    elif w.count >= g.cycle and not waits and (q.memory.moving or not settled):
        w.fault = candidate


@njit
def loops_of_both(first: int, second: int) -> int:
    """Mask of the loops of two faults ahead, by their types.  The phases of the first are held by it, and of
    a second one between them and others the change shows the others alone: so the pairs of a phase of the
    first and one of the second count, too."""
    mask = LOOP_MASK[first] | LOOP_MASK[second]
    held = PHASES_OF_TYPE[first]
    others = PHASES_OF_TYPE[second] & ~held
    for pair in range(3):
        one, other = 1 << pair, 1 << (pair + 1) % 3
        if (held & one and others & other) or (held & other and others & one):
            mask |= 8 << pair
    return mask


@njit
def released(q: Record, mask: int) -> int:
    """Of the loops that may start those without dead poles and what is missing.

    In the dead time of a single-pole trip a dead pole's loops see what the other phases induce.
    """
    if mask == 0:
        return 0
    return mask & ~loops_of(q.dead | q.missing | q.suspected | (7 & ~q.proven)) & ~blocked_loops(q)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample; publishes ``q.fault`` and ``q.released``."""
    if q.swing_fault > swing.YOUNG:
        forget(w)
        select_in_swing(g, q, w)
    elif q.slides and w.fault:
        pass  # another type than before is the swing's
    elif q.disturbed and not q.swing_fault:
        select(g, q, c, w)
    else:
        w.fault = w.candidate = w.count = 0
        forget(w)
    q.fault = w.fault
    q.crossed = w.crossed
    q.behind = w.behind
    q.from_behind = w.from_behind
    q.both = w.also != 0
    q.released = released(q, loops_of_both(w.before, w.also) if w.also else LOOP_MASK[w.fault])
    indicate(q, c.bit, q.released)


PHS = Function(
    name="PHS",
    settings=Phs,
    step=step,
    constants=(("single_phase", "f8"),),
    values=values,
    state=(
        ("fault", "i8"),
        ("candidate", "i8"),
        ("count", "i8"),
        ("side", "i8", (3,)),  # of each phase's own fault at this sample: 1 ahead, -1 behind
        ("stood", "i8", (3,)),  # samples of still phasors for which it has been there
        ("behind", "i8"),  # mask of phases, once it has stood
        ("disputed", "i8"),  # samples for which there may be one on each side
        ("crossed", "i8"),  # type of the fault ahead where there is one behind, too
        ("first", "i8"),  # type of the fault that has settled, and its direction
        ("first_side", "i8"),
        ("again", "i8"),  # type of what has changed since
        ("again_count", "i8"),
        ("again_still", "i8"),  # samples in a row with phasors that stand still
        ("ahead", "i8"),  # of the two the type of the one ahead, and the other one's phases
        ("aside", "i8"),
        ("before", "i8"),  # where both are ahead, the first's type and the second's
        ("also", "i8"),
        ("from_behind", "i8"),  # mask of phases that have changed from behind after a fault ahead
    ),
    always=True,
    bits=LOOPS,
    told=False,
)
