"""PDIF: line differential; the currents of all ends, phase by phase, at the same instant.

Eight times a cycle each end measures its currents by a full-cycle Fourier filter, the same at all ends
whatever the distance part uses (what an adaptive estimator adds it adds at each end at its own moment, and it
does not cancel: false by thousands of amperes), takes its share of what the line charges from them, and sends
them with their time.  Where the sets of all ends for one instant are there, the rules decide
(`faultloop.relay.differential`): each phase, and the negative- and zero-sequence currents of the ends, which
load does not weaken.

- How well the ends are aligned is measured with every set (`faultloop.nodes.sets`): where ways differ, delays
  vary, or the time is lost and the channel stands in for it (`time_lost`), the rules are the harder ones.
- A trip needs `confirm` sets in a row.  A set that is missing is not guessed: two are passed over, after more
  the count begins anew.
- When the currents change while their sum stays below a tenth of that, the fault is outside; for `external_s`
  the rules are harder, three times as many sets are needed, and the sequence elements rest.
- A current that is missing (open CT) takes its phase out at every end (`faultloop.relay.changes`).  Charging
  is taken off with the voltage of this end; an end that has none says so, and the others take its share, too.
- Each set says by which rule it is meant (a hash of what both ends must agree on); a set of another
  line, or of other settings, is refused before it gets here, and so is one that is old, or twice there.
- A trip is told to the others, which then trip, too (`transfer`): an end that has all currents decides.
"""

from __future__ import annotations

import json
import math
from binascii import crc_hqx
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from faultloop.config.tables import Milliseconds, NonNegative, Positive, Seconds, Table
from faultloop.jit import njit
from faultloop.relay.changes import watch_circuits, watch_outside
from faultloop.relay.differential import RULE, operates
from faultloop.relay.far_ends import BRIDGED, STILL, tell
from faultloop.relay.functions.function import Function
from faultloop.relay.functions.psch import type_of
from faultloop.relay.memory import A2, A
from faultloop.relay.quantities import Record, indicate, publish, request_trip
from faultloop.relay.recent import LENGTH

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

PER_CYCLE = 8
"""Sets in a cycle."""
SLOTS = BRIDGED * PER_CYCLE
"""Sets that are kept: two cycles, and so the longest delay that is bridged."""
REMOTES = 2
NO_SET = -1
NEVER = NO_SET - PER_CYCLE
"""No set's number is a cycle after it."""
UNBALANCED = 0.05
"""I2 or I0 over I1, at every end that carries more than the pickup: below it unbalance is an error's."""
LOST_SETS = 2
"""In a row, that are passed over: neither for a fault nor against it.  A spell that is too short for a trip
has no more sets when some of them are lost; and two spells are one only where all sets between them are."""

SET = np.dtype(
    [
        ("index", "i8"),  # number of the eighth of a cycle; NO_SET
        ("valid", "i8"),  # mask of phases
        ("bare", "i8"),  # 1: charging is not taken off
        ("i", "c16", (3,)),
        ("charging", "c16", (3,)),  # of this end's share of the line, own sets only
    ],
    align=True,
)
REMOTE = np.dtype(
    [
        ("number", "i8"),  # of the relay; in the order of the node's sources
        ("transfers", "i8"),  # sets in a row that say that this end shall trip
        ("synchronized", "i8"),
        ("since", "i8"),  # samples since its last set
        ("held", "i8"),  # 1: the time is lost, and the channel stands in for it
        ("holds", "i8"),  # how often that has begun
        ("switches", "i8"),  # other paths, and clocks that have jumped
        ("jumps", "i8"),
        ("ways_us", "f8"),  # by how much the way there takes longer than the way here
        ("vary_us", "f8"),  # mean deviation of the round trip
        ("trip_us", "f8"),
        ("clock_us", "f8"),  # its clock against this one's
        ("late_us", "f8"),  # the last set
        ("set", SET, (SLOTS,)),
    ],
    align=True,
)


class Pdif(Table):
    """``[pdif]``: line differential; the other ends have the same, and a ``[[channel]]`` to this one."""

    pickup_a: Positive
    """Of the differential current of a phase; above what the line charges, or 0.2 of the nominal current."""
    characteristic: Literal["alpha", "percentage"] = "alpha"
    """The alpha plane, or a percentage with two slopes."""
    alpha_ratio: Annotated[float, Field(gt=1, le=100)] = 6.0
    """R of the alpha plane."""
    alpha_angle_deg: Annotated[float, Field(ge=90, lt=360)] = 195.0
    """The whole restraining sector."""
    slope1: Annotated[float, Field(ge=0.1, le=2)] = 0.3
    """Of the percentage: |sum| over half the sum of magnitudes ..."""
    slope2: Annotated[float, Field(ge=0.1, le=2)] = 1.5
    """... and beyond `knee_a`."""
    knee_a: Positive | None = None
    """Ten times the pickup where not given."""
    negative_a: Positive | None = None
    """Pickup of the negative-sequence element; half that of a phase where not given."""
    zero_a: Positive | None = None
    """The same of the zero-sequence element."""
    sequence: bool = True
    """Whether these two are there: faults of high resistance under load."""
    sequence_ms: Milliseconds = 20.0
    """So long they must last."""
    confirm: Annotated[int, Field(ge=1, le=16)] = 3
    """Sets in a row, 8 a cycle, that a trip needs; up to two that are missing are passed over."""
    external_s: Seconds = 1.0
    """So long after a fault outside has begun the rules are harder; 0: never."""
    open_ct: Literal["block", "trip"] = "block"
    """A phase whose current one end has lost while nothing else changed: "block" takes it out at every end,
    and the sequence elements; with "trip" a load above the pickup trips."""
    b1_us: NonNegative | None = None
    """Of the whole line, positive sequence: with it charging is taken off; that of ``[line]`` where not
    given, 0: it stays."""
    b0_us: NonNegative | None = None
    """Zero sequence."""
    transfer: bool = True
    """A trip of this function trips every end."""
    identification: Annotated[str, Field(max_length=32)] = ""
    """Of the line; what both ends are told must be the same."""
    alignment: Literal["global", "channel"] = "global"
    """By a time that all ends have, or by the channel's round trip: both ways are taken for equally long."""
    time_lost: Literal["block", "hold"] = "block"
    """Where an end has lost the time of all: out, or on by the round trip with the ways' difference of
    before."""
    asymmetry_ms: Milliseconds = 1.5
    """Ways that differ by more, and delays that vary so much, are told, and the rules are the harder ones."""
    channel_alarm_ms: Milliseconds = 100.0
    """So long without a set of an end before ``ChBlk`` is told."""

    @model_validator(mode="after")
    def _slopes(self) -> Pdif:
        if self.slope2 < self.slope1:
            raise ValueError(f"slope2 must be at least slope1, {self.slope1:g}")
        return self


AGREED = (
    "pickup_a", "characteristic", "alpha_ratio", "alpha_angle_deg", "slope1", "slope2", "knee_a",
    "negative_a", "zero_a", "sequence", "confirm", "open_ct", "alignment", "time_lost", "b1_us", "b0_us",
    "transfer", "identification",
)  # fmt: skip
"""What all ends must have alike."""


def susceptances_us(settings: RelaySettings, table: Pdif) -> dict[str, float]:
    """Of the whole line [uS]: the table's, or those of ``[line]``."""
    given = {key: (getattr(table, key), getattr(settings.line, key)) for key in ("b1_us", "b0_us")}
    return {key: (line or 0.0) if own is None else own for key, (own, line) in given.items()}


BY_CHANNEL, HOLDS = 1 << 16, 1 << 17


def agreement(settings: RelaySettings) -> int:
    """Hash of what all ends must have alike, 16 bits, with `BY_CHANNEL` where that aligns, `HOLDS` where it
    does while the time is lost; 0: no table."""
    table = settings.pdif
    if table is None:
        return 0
    agreed = table.model_dump(include=set(AGREED)) | susceptances_us(settings, table)
    said = [agreed[key] for key in AGREED] + [settings.relay.frequency_hz, settings.relay.ohms]
    own = crc_hqx(json.dumps(said).encode(), 0xFFFF) or 1
    own |= BY_CHANNEL if table.alignment == "channel" else 0
    return own | (HOLDS if table.time_lost == "hold" else 0)


def values(settings: RelaySettings, table: Pdif) -> dict[str, Any]:
    """The rules in primary amperes; times in samples and sets; the line's susceptances [S]."""
    pickup = settings.amperes(table.pickup_a, 0.0)
    common = {
        "alpha": table.characteristic == "alpha",
        "ratio": table.alpha_ratio,
        "half_angle_cos": math.cos(math.radians(table.alpha_angle_deg) / 2),
        "slope1": table.slope1,
        "slope2": table.slope2,
        "knee": settings.amperes(table.knee_a, 10 * pickup),
    }
    rule = np.zeros(3, RULE)
    for k, own in enumerate((pickup, settings.amperes(table.negative_a, pickup / 2),
                             settings.amperes(table.zero_a, pickup / 2))):  # fmt: skip
        for key, value in (common | {"pickup": own, "alpha": common["alpha"] or k > 0}).items():
            rule[k][key] = value
    return {
        "rule": rule,
        "sequence": table.sequence,
        "sequence_sets": max(round(table.sequence_ms * 1e-3 * PER_CYCLE * settings.relay.frequency_hz), 1),
        "confirm": table.confirm,
        "external": settings.samples(table.external_s * 1e3),
        "open_blocks": table.open_ct == "block",
        **{key.removesuffix("_us"): 1e-6 * value for key, value in susceptances_us(settings, table).items()},
        "transfer": table.transfer,
        "per_cycle": PER_CYCLE,
        "by_channel": table.alignment == "channel",
        "asymmetry_us": table.asymmetry_ms * 1e3,
        "channel_alarm": settings.samples(table.channel_alarm_ms),
        "hash": agreement(settings) & 0xFFFF,
    }


@njit
def fourier(g: Record, q: Record, channel: int, turn: complex) -> complex:
    """Full-cycle phasor of a channel of the recent samples, RMS, against cos(2 pi f0 t); ``turn`` is
    e^(j w0 t) of the newest one."""
    r = q.recent
    step = complex(math.cos(g.turn_per_value), math.sin(g.turn_per_value))
    phase = turn.conjugate()
    total = 0j
    for k in range(g.values):
        total += r.value[(r.head - k) % LENGTH, channel] * phase
        phase *= step
    return total * (math.sqrt(2.0) / g.values)


@njit
def measure(g: Record, q: Record, c: Record, w: Record, index: int) -> None:
    """The own set of this instant."""
    t = q.number / g.sampling
    angle = 2 * math.pi * g.frequency * (t - math.floor(t))
    turn = complex(math.cos(angle), math.sin(angle))
    own = w.own[index % SLOTS]
    own.index = index
    own.valid = 7 & ~q.missing if c.open_blocks else 7
    own.bare = 1 if q.fuse_failure else 0
    charges = c.b1 > 0.0
    if charges:
        va, vb, vc = fourier(g, q, 0, turn), fourier(g, q, 1, turn), fourier(g, q, 2, turn)
        v0 = (va + vb + vc) / 3
        share = 1j / (1 + max(w.remotes, 1))  # half of it, of three ends a third
        own.charging[0] = share * (c.b1 * (va - v0) + c.b0 * v0)
        own.charging[1] = share * (c.b1 * (vb - v0) + c.b0 * v0)
        own.charging[2] = share * (c.b1 * (vc - v0) + c.b0 * v0)
    for phase in range(3):
        own.i[phase] = fourier(g, q, 3 + phase, turn)
        if charges and not own.bare:
            own.i[phase] -= own.charging[phase]


@njit
def complete(w: Record, index: int) -> bool:
    """Whether every end's set of an instant is there."""
    if w.own[index % SLOTS].index != index or w.remotes == 0:
        return False
    there = 0
    for k in range(w.remotes):
        there += w.remote[k].set[index % SLOTS].index == index
    return there == w.remotes


@njit
def gathered(c: Record, w: Record, index: int, phase: int, out: Any) -> None:
    """The currents of a phase of all ends, (1 + remotes,) into ``out``; charging that a remote end could not
    take off is taken off here."""
    own = w.own[index % SLOTS]
    out[0] = own.i[phase]
    for k in range(w.remotes):
        far = w.remote[k].set[index % SLOTS]
        out[1 + k] = far.i[phase]
        if far.bare and not own.bare and c.b1 > 0.0:
            out[1 + k] -= own.charging[phase]


@njit
def sequence_of(c: Record, w: Record, index: int, which: int, out: Any, first: Any) -> bool:
    """Negative (1) or zero (2) sequence of every end into ``out``; whether they are more than what errors
    of the positive sequence (into ``first``) leave."""
    more = True
    for k in range(1 + w.remotes):
        s = w.own[index % SLOTS] if k == 0 else w.remote[k - 1].set[index % SLOTS]
        a, b, d = s.i[0], s.i[1], s.i[2]
        out[k] = (a + A2 * b + A * d) / 3 if which == 1 else (a + b + d) / 3
        first[k] = (a + A * b + A2 * d) / 3
        if abs(first[k]) > c.rule[0].pickup and abs(out[k]) < UNBALANCED * abs(first[k]):
            more = False
    return more


@njit
def compare(c: Record, w: Record, index: int) -> None:
    """The currents of all ends against those of a cycle before, where that set was complete, too."""
    slot, ends = index % PER_CYCLE, 1 + w.remotes
    known = w.past_index[slot] == index - PER_CYCLE
    for phase in range(3):
        gathered(c, w, index, phase, w.currents)
        for k in range(ends):
            w.before[phase, k] = w.past[phase, slot, k]
            w.change[phase, k] = w.currents[k] - w.past[phase, slot, k]
            w.past[phase, slot, k] = w.currents[k]
    w.past_index[slot] = index
    if known and c.external:
        watch_outside(c, w, ends)
    if known and c.open_blocks:
        watch_circuits(c, w, ends)


@njit
def judge(c: Record, w: Record, index: int) -> None:
    """The rules on a complete set: counts for each phase and for the two sequence elements."""
    n = 1 + w.remotes
    compare(c, w, index)
    valid = w.own[index % SLOTS].valid & ~w.opened[0]
    for k in range(w.remotes):
        valid &= w.remote[k].set[index % SLOTS].valid & ~w.opened[1 + k]
    outside, secure = w.external > 0, w.external > 0 or w.harder != 0
    for phase in range(3):
        gathered(c, w, index, phase, w.currents)
        beyond = (valid >> phase) & 1 and operates(c.rule[0], w.currents, n, secure)
        w.count[phase] = w.count[phase] + 1 if beyond else 0
    for which in range(1, 3):
        beyond = False
        if c.sequence and valid == 7 and not outside:
            more = sequence_of(c, w, index, which, w.currents, w.first)
            beyond = more and operates(c.rule[which], w.currents, n, secure)
        w.count[2 + which] = w.count[2 + which] + 1 if beyond else 0
    w.last = index
    w.age = 0


@njit
def reset(w: Record) -> None:
    """What was counted is not of sets in a row."""
    for k in range(5):
        w.count[k] = 0


@njit
def watch_ways(q: Record, c: Record, w: Record) -> None:
    """Keeps ``w.harder``: whether the ends are aligned well enough for the rules as they are set."""
    harder, found = 0, 0
    limit_us = STILL * c.asymmetry_us if w.harder else c.asymmetry_us
    for k in range(w.remotes):
        far = w.remote[k]
        found += far.switches + far.jumps + far.holds
        if far.held or abs(far.ways_us) > limit_us or 2.0 * far.vary_us > limit_us:
            harder = 1
    if harder != w.harder or found != w.found:
        q.notices += 1
    w.harder, w.found = harder, found


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample; before the trip logic."""
    index = (q.number * PER_CYCLE) * np.int64(g.frequency) // np.int64(g.sampling)
    if index != w.index and q.settled:
        w.index = index
        measure(g, q, c, w, index)
        q.phasors += 1  # and so it is sent
    if w.external > 0:
        w.external -= 1
        if w.external == 0:
            reset(w)  # fewer sets make a trip from now on
    watch_ways(q, c, w)
    blocked = w.out_of_time != 0
    # sets of the past that have become complete, in their order
    first = max(w.last + 1, w.index - SLOTS + 1)
    for k in range(first, w.index + 1):
        if complete(w, k) and not blocked:
            if k > w.last + 1 + LOST_SETS:
                reset(w)
            judge(c, w, k)
    if q.number == 0:
        w.age, w.silent = 0, 0  # before the run there was no other end
    w.age += 1
    if (
        w.age > 2 * g.cycle or blocked
    ):  # sets that are late come, some at once; those that are lost count above
        reset(w)
    poles = 0
    needed = 3 * c.confirm if w.external > 0 else c.confirm
    started = False
    for phase in range(3):
        started |= w.count[phase] > 0
        if w.count[phase] >= needed:
            poles |= 1 << phase
    negative = w.count[3] >= max(c.sequence_sets, needed)
    zero = w.count[4] >= max(c.sequence_sets, needed)
    told = 0
    for k in range(w.remotes):
        far = w.remote[k]
        far.since += 1
        if far.transfers >= 2 and far.since <= 2 * g.cycle:  # what is not said any more is over
            told = 7
    if poles:
        request_trip(q, c.bit, type_of(poles), 0)
    elif negative or zero or (told and c.transfer):
        request_trip(q, c.bit, q.fault, 1)
    w.trips = poles != 0 or negative or zero
    silent = w.age > c.channel_alarm
    if silent and not w.silent:
        w.losses += 1
        q.notices += 1
    w.silent = silent
    publish(q, c.bit, started, poles != 0)
    indicate(q, c.bit + 1, negative)
    indicate(q, c.bit + 2, zero)
    indicate(q, c.bit + 3, w.external > 0)
    indicate(q, c.bit + 4, silent or blocked)
    opened = w.opened[0]
    for k in range(w.remotes):
        opened |= w.opened[1 + k]
    indicate(q, c.bit + 5, opened != 0 or (7 & ~w.own[w.index % SLOTS].valid) != 0)
    indicate(q, c.bit + 6, told != 0)
    indicate(q, c.bit + 7, w.harder != 0)


def _no_sets() -> NDArray[np.void]:
    """(SLOTS,) SET: none of any instant, that of number 0 included."""
    sets = np.zeros(SLOTS, SET)
    sets["index"] = NO_SET
    return sets


def _no_remotes() -> NDArray[np.void]:
    remotes = np.zeros(REMOTES, REMOTE)
    remotes["set"] = _no_sets()
    return remotes


PDIF = Function(
    name="PDIF",
    settings=Pdif,
    step=step,
    constants=(
        ("rule", RULE, (3,)),  # phase, negative, zero sequence
        *((name, "i8") for name in ("sequence", "sequence_sets", "confirm", "external", "open_blocks")),
        ("b1", "f8"),
        ("b0", "f8"),
        ("transfer", "i8"),
        ("per_cycle", "i8"),  # for who hands the sets over
        ("by_channel", "i8"),
        ("asymmetry_us", "f8"),
        ("channel_alarm", "i8"),
        ("hash", "i8"),
    ),
    values=values,
    state=(
        ("index", "i8"),  # of the newest own set
        ("last", "i8"),  # of the newest complete one
        ("age", "i8"),  # samples since that
        ("external", "i8"),  # samples for which a fault outside is still known
        ("declared", "i8"),
        ("remotes", "i8"),
        ("out_of_time", "i8"),  # mask of the other ends with which there is no common time
        ("harder", "i8"),  # 1: the ends are not aligned well enough for the rules as they are set
        ("found", "i8"),  # paths and clocks that have changed
        ("trips", "i8"),
        ("silent", "i8"),
        ("losses", "i8"),
        ("count", "i8", (5,)),  # sets in a row outside the restraint: phases, negative, zero sequence
        ("jump", "i8", (3,)),  # 1: outside, 2: inside, while the currents are changed
        ("opened", "i8", (1 + REMOTES,)),  # masks of the phases whose current an end has lost, its own first
        ("back", "i8", (1 + REMOTES, 3)),  # sets for which such a phase has a current again
        ("past_index", "i8", (PER_CYCLE,)),  # of the complete set of an eighth of a cycle ...
        ("past", "c16", (3, PER_CYCLE, 1 + REMOTES)),  # ... its currents, one after the other
        ("before", "c16", (3, 1 + REMOTES)),  # those of a cycle ago
        ("change", "c16", (3, 1 + REMOTES)),  # and what has become of them
        ("currents", "c16", (1 + REMOTES,)),
        ("first", "c16", (1 + REMOTES,)),
        ("own", SET, (SLOTS,)),
        ("remote", REMOTE, (REMOTES,)),
    ),
    start={
        "index": NO_SET,
        "last": NO_SET,
        "past_index": np.full(PER_CYCLE, NO_SET - PER_CYCLE),
        "own": _no_sets(),
        "remote": _no_remotes(),
    },
    bits=("", "NgOp", "ResOp", "ExtFlt", "ChBlk", "OpnCT", "RxTr", "ChAsym"),
    tell=tell,
)
