"""What the functions share: one record of constants, and one of quantities, filled first at every sample.

A function's kernel is ``step(g, q, c, w)``: ``g`` of type ``CONSTANTS`` (the same for all), ``q`` of type
``QUANTITIES`` (measured first, and where the functions publish what others need), its own constants ``c``
and its own state ``w``.  Functions meet only in ``q``: a later one in `faultloop.relay.functions.FUNCTIONS`
reads what an earlier one published at the same sample, an earlier one what a later one published at the
sample before.

Phasors are complex RMS, primary, in the order va vb vc ia ib ic, against cos(2 pi f0 t).  Loops are numbered
AG BG CG AB BC CA = 0 .. 5; a fault type is 0 for none, 1 .. 6 for one of these loops, 7 for ABC.  (Kernels
under njit bake these numbers in.)
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay import currents, cvt, energy, lost_voltages, memory, recent, second, unsampled, voltages
from faultloop.relay.energy import ENERGY
from faultloop.relay.memory import A2, MEMORY, MEMORY_CYCLES, SNAPSHOTS, A, size2, third
from faultloop.relay.recent import RECENT, SQRT2
from faultloop.relay.saturation import has_any_collapsed
from faultloop.relay.second import SECOND

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

Record = Any
"""A NumPy structured scalar: inside a kernel its fields are attributes."""

WIDE = 10
"""Channels of a relay that also measures the breaker's other side and the parallel line: va vb vc ia ib ic,
va vb vc there, 3 i0; NaN for what there is none of."""
LOOPS = ("AG", "BG", "CG", "AB", "BC", "CA")
FAULTS = ("", *LOOPS, "ABC")
THREE_PHASE = 7
ALL_POLES = 7
REFERENCE_CYCLES = 1.25  # longer than the slowest estimator takes to show a disturbance
FADE_MS = 100.0
DEFAULT_CURRENT_A = 20.0
LIKE_A_FAULT = 1.5
AT_ITS_ANGLE = 0.8
SHARE = 0.85
"""Of the parallel line's residual current the own one must be above, or it is the healthy line's."""
TRANSITS = 6
"""Along the line, by a wave, to and fro three times."""
INDUCTANCE_H_PER_KM, LIGHT_KM_PER_S = 1.2e-3, 3e5
GONE = 0.05
"""A current is gone whose samples are below this part of its phasor."""

CONSTANTS = np.dtype(
    [
        ("frequency", "f8"),  # nominal [Hz]
        ("sampling", "f8"),  # [Hz]
        ("cycle", "i8"),  # samples in a nominal cycle
        ("snapshot", "i8"),  # samples between two snapshots of the memory
        ("snapshots", "i8"),  # how many of the ring are used
        ("lag", "i8"),  # how many snapshots ago the reference was taken
        ("settling", "i8"),  # samples until the memory may begin
        ("settled", "i8"),  # samples until the estimator has settled
        ("lumped", "i8"),  # samples of a disturbance until the line is a resistance and an inductance
        ("stride", "i8"),  # samples in a value of the recent ones
        ("values", "i8"),  # recent values in a cycle
        ("turn_per_value", "f8"),  # [rad]
        ("rotor", "c16"),  # e^(j w0 t) from a sample to the next
        ("z1", "c16"),  # of the line [ohm]
        ("z0", "c16"),
        ("b1", "f8"),  # of the line [S]; 0: not told
        ("b0", "f8"),
        ("mutual", "c16"),  # z0m / (3 z1) with the parallel line; 0: not compensated
        ("mutual_in_time", "f8"),  # z0m / (z0 - z1), of which the small imaginary part is left out
        ("minimum_voltage", "f8"),  # phase to ground; below it a line is dead [V]
        ("minimum_current", "f8"),  # below it a loop's impedance is not defined [A]
        ("minimum_unbalance", "f8"),  # of I2 or I0 over I1
        ("open_current", "f8"),  # a pole below it is open [A]
        ("pickup_current", "f8"),  # a change that is a disturbance [A] ...
        ("pickup_current_pu", "f8"),  # ... or of the load current
        ("pickup_voltage_pu", "f8"),
        ("three_phase", "f8"),  # negative and zero sequence of a change that is balanced, over the positive
        ("ideal_vt", "i8"),  # the voltage transformer has no transient of its own
        ("in_front", "i8"),  # the voltages are those in front of one whose circuit is known, by its inverse
        ("inverse", "f8", (cvt.CONSTANTS,)),
        ("memory", "i8"),  # samples for which the voltage before polarizes
        ("fade", "i8"),  # samples in which it then fades
    ],
    align=True,
)

REQUEST = np.dtype(
    [
        ("made", "i8"),
        ("bit", "i8"),  # of the function that wants the trip
        ("fault", "i8"),  # the type it trips for
        ("three_pole", "i8"),  # whatever the fault and the trip mode
    ],
    align=True,
)

QUANTITIES = np.dtype(
    [
        # measured; the first four are the 26 numbers that a plain step of the user's sees
        ("x", "c16", (6,)),  # phasors
        ("frequency", "f8"),  # [Hz]; NaN while unknown
        ("rocof", "f8"),  # [Hz/s]
        ("loops", "f8", (12,)),  # r and x of AG BG CG AB BC CA [ohm]; NaN where not defined
        ("sample", "f8", (6,)),  # va vb vc ia ib ic, instantaneous
        ("across", "f8", (3,)),  # va vb vc of the breaker's other side; NaN: there is none
        ("beside", "f8"),  # 3 i0 of the parallel line; NaN: there is none
        ("mutual", "c16"),  # what it adds to the current of a ground loop
        ("inverse", "f8", (cvt.STATE,)),
        ("recent", RECENT),  # the samples of the last cycle and a half
        ("turn", "c16"),  # e^(j w0 t) of the sample
        ("settled", "i8"),  # the estimator has settled: phasors are measurements
        ("sequence", "c16", (6,)),  # v0 v1 v2 i0 i1 i2
        ("closed", "i8"),  # mask of closed poles, as reported
        ("received", "i8"),  # mask of poles for which any far end sends its pilot signal
        ("received_all", "i8"),  # and for which every one does
        ("transferred", "i8"),  # mask of poles that a far end trips here
        ("linked", "i8"),  # every channel works
        ("number", "i8"),  # of the sample, since the run's start
        ("was_closed", "i8"),
        ("dead", "i8"),  # mask of poles without current, by the samples and by the breaker
        ("proven", "i8"),  # mask of phases whose voltage can be relied on
        ("loaded", "i8"),  # a pole has carried current since there were voltages without
        (
            "lost",
            "i8",
        ),  # snapshots in a row of closed poles with neither voltage nor current, not loaded before
        ("voltageless", "i8", (3,)),  # samples in a row without voltage, of each phase
        ("current_then", "c16", (3,)),  # current of the phase when that began
        ("voltage2_then", "f8", (3,)),  # and its voltage, squared
        ("quiet_then", "i8", (3,)),  # there was no disturbance yet
        ("moving_then", "i8", (3,)),  # there was one, and phasors were on their way
        ("gone_with", "i8"),  # mask of phases whose voltage has gone with the current in this disturbance
        ("residual", "f8", (3,)),  # sum, since then, of how its samples differ from it
        ("residual2", "f8", (3,)),  # and of the squares
        ("left", "f8", (3,)),  # mean of what its samples leave of its phasor, before that
        ("left2", "f8", (3,)),  # and of the squares
        ("suspected", "i8"),  # mask of phases whose voltage has gone and their current has not changed
        ("missing", "i8"),  # mask of phases whose current is missing
        ("vanished", "i8"),  # all three have gone at one moment
        ("without", "i8", (6,)),  # samples in a row of which there is no value; below 0: since a gap
        ("bridged", "i8"),  # mask of phases whose voltage was proven before one
        # the memory, and what is new against it
        ("memory", MEMORY),
        ("sound", "i8"),  # nothing looks like a fault; judged only while the memory is not ready
        ("ready", "i8"),  # the memory can be relied on
        ("disturbed", "i8"),  # there is a change against it, since memory.age samples
        ("fed", "i8"),  # a current has changed too, and not only a voltage
        ("energy", ENERGY),  # what the change has brought, and its direction
        ("second", SECOND),  # a change against the state that the disturbance has settled to
        ("d", "c16", (6,)),  # the change of the phasors, while disturbed
        ("change", "c16", (6,)),  # its sequence components
        ("work", "c16", (6,)),  # of one calculation
        # published by functions; cleared before each sample where marked *
        ("fault", "i8"),  # PHS: the fault's type
        ("crossed", "i8"),  # PHS: the type is of the fault ahead, and there is another behind
        ("behind", "i8"),  # PHS: mask of phases whose own fault is behind
        ("from_behind", "i8"),  # PHS: mask of phases in which something behind has changed since the fault
        ("both", "i8"),  # PHS: there are two faults ahead, and each loop counts by itself
        ("released", "i8"),  # PHS: mask of the loops that may start
        ("direction", "i8"),  # RDIR: 1 forward, -1 reverse, 0 unknown
        ("polarizing", "c16"),  # RDIR: positive-sequence polarizing voltage, while disturbed
        ("swing_fault", "i8"),  # RPSB: a fault in a swing: 1; its change no longer known: 2, balanced 3
        ("slides", "i8"),  # RPSB: the sources have begun to slip in this fault, and with them the reference
        ("standing", "i8"),  # RPSB: mask of loops that stand still in a swing, as a piece of the line
        ("fuse_failure", "i8"),  # TVTR: the voltages cannot be relied on
        ("blocked_loops", "i8"),  # * mask of loops that no distance zone may use
        ("blocked_zones", "i8"),  # * mask of distance zones, by place in the settings, that are blocked
        ("zone_started", "i8"),  # * PDIS: a distance zone has started
        ("was_started", "i8"),  # the same at the sample before
        ("zones", "i8"),  # * PDIS: mask of zones, by place in the settings, that have started
        ("last_zones", "i8"),  # the same at the sample before
        ("inside", "i8"),  # * PDIS: the fault is inside a zone, started or not yet
        ("started", "i8"),  # * any function has started
        ("request", REQUEST),  # * the first wish of this sample to trip
        ("release", "i8"),  # RSYN: 1 three poles may be closed, -1 it has no second voltage
        ("three_pole", "i8"),  # RREC: every trip is three-pole
        ("rests", "i8"),  # RREC: mask of distance zones that rest while no reclosing would follow
        # outputs; OUTPUTS names them
        ("poles", "i8"),  # PTRC: mask of poles to trip
        ("close_poles", "i8"),  # mask of poles to close
        ("pilot", "i8"),  # * mask of poles of the pilot signal to the far end
        ("transfer", "i8"),  # * mask of poles to trip at the far end
        ("back_trip", "i8"),  # RBRF: mask of poles that the breakers around are to open
        ("phasors", "i8"),  # PDIF: sets that it has measured; counts on
        ("notices", "i8"),  # something to tell has happened; counts on
        ("changed", "i8"),  # samples of this block at which a bit changed
        ("held", "i8"),  # a trip stood when the sample came
        ("pickup", "u8"),  # * bits
        ("operate", "u8"),  # *
        ("last_pickup", "u8"),  # the bits of the sample before
        ("last_operate", "u8"),
    ],
    align=True,
)

INPUTS = ("closed", "received", "received_all", "transferred", "linked")
"""Neighbouring fields, as are these:"""
OUTPUTS = ("poles", "close_poles", "pilot", "transfer", "back_trip", "phasors", "notices", "changed")


def constants(settings: RelaySettings, settling_samples: int) -> dict[str, Any]:
    """The shared constants by name, in primary values and samples."""
    relay, rdir, phs = settings.relay, settings.rdir, settings.phs
    cycle = relay.sampling_hz / relay.frequency_hz
    stride = recent.stride(relay.sampling_hz, relay.frequency_hz)
    snapshot = math.ceil(MEMORY_CYCLES * cycle / SNAPSHOTS)
    return {
        "frequency": relay.frequency_hz,
        "sampling": relay.sampling_hz,
        "cycle": round(cycle),
        "snapshot": snapshot,
        "snapshots": math.ceil(MEMORY_CYCLES * cycle / snapshot),
        "lag": math.ceil(REFERENCE_CYCLES * cycle / snapshot),
        # A recursive estimator forgets its start slowly; the memory waits for a steady voltage anyway.
        "settling": max(min(settling_samples, math.ceil(1.25 * cycle)), 1),
        "settled": settling_samples,
        "lumped": math.ceil(TRANSITS * _travel_time_s(settings) * relay.sampling_hz),
        "stride": stride,
        "values": round(cycle / stride),
        "turn_per_value": 2 * math.pi * stride / cycle,
        "rotor": cmath.rect(1.0, 2 * math.pi / cycle),
        "z1": settings.z1_ohm,
        "z0": settings.z0_ohm,
        "b1": (settings.line.b1_us or 0.0) * 1e-6,
        "b0": (settings.line.b0_us or 0.0) * 1e-6,
        "mutual": settings.z0m_ohm / (3 * settings.z1_ohm),
        "mutual_in_time": _mutual_in_time(settings),
        "minimum_voltage": _minimum_voltage(settings),
        "minimum_current": _minimum_current(settings),
        "minimum_unbalance": rdir.minimum_unbalance,
        "open_current": settings.amperes(settings.ptrc.open_current_a, DEFAULT_CURRENT_A),
        "pickup_current": settings.amperes(phs.pickup_current_a, DEFAULT_CURRENT_A / 2),
        "pickup_current_pu": phs.pickup_current_pu,
        "pickup_voltage_pu": phs.pickup_voltage_pu,
        "three_phase": phs.three_phase_unbalance,
        "ideal_vt": settings.vt.kind is not None,
        "in_front": settings.inverse_vt is not None,
        "inverse": cvt.no_inverse() if settings.inverse_vt is None else settings.inverse_vt,
        "memory": settings.samples(rdir.memory_ms),
        "fade": max(settings.samples(FADE_MS), 1),
    }


def _travel_time_s(settings: RelaySettings) -> float:
    """Of a wave along the line, from its reactance: overhead lines have about the same inductance per km."""
    inductance_h = settings.z1_ohm.imag / (2 * math.pi * settings.relay.frequency_hz)
    return inductance_h / INDUCTANCE_H_PER_KM / LIGHT_KM_PER_S


def _mutual_in_time(settings: RelaySettings) -> float:
    """Of the parallel line's residual current, beside the own one."""
    z0m = settings.z0m_ohm
    return (z0m / (settings.z0_ohm - settings.z1_ohm)).real if z0m else 0.0


def _minimum_voltage(settings: RelaySettings) -> float:
    """A tenth of the nominal voltage, or a volt where that is not known."""
    relay = settings.relay
    if relay.nominal_kv is not None:
        return 100.0 * relay.nominal_kv / math.sqrt(3)
    return 1.0 if relay.vt_ratio is None else relay.vt_ratio


def _minimum_current(settings: RelaySettings) -> float:
    """The least of the zones' minimum currents [A]."""
    given = [settings.amperes(zone.minimum_current_a, DEFAULT_CURRENT_A) for zone in settings.pdis]
    return min(given, default=DEFAULT_CURRENT_A)


def clear(q: NDArray[np.void]) -> None:
    """The quantities of a relay that has seen nothing."""
    q["closed"] = q["was_closed"] = 7
    q["linked"] = 1  # until something is missed
    q["across"] = q["beside"] = np.nan


@njit
def sequences(x: NDArray[np.complex128], out: NDArray[np.complex128]) -> None:
    """v0 v1 v2 i0 i1 i2 of six phasors, phase A (Fortescue)."""
    for k in (0, 3):
        a, b, c = x[k], x[k + 1], x[k + 2]
        out[k] = third(a + b + c)
        out[k + 1] = third(a + A * b + A2 * c)
        out[k + 2] = third(a + A2 * b + A * c)


@njit
def nominal_turn(g: Record, number: int) -> complex:
    """e^(j w0 t) of a sample; whole seconds are left out, so that it stays exact."""
    return cmath.rect(1.0, 2 * math.pi * g.frequency * ((number % g.sampling) / g.sampling))


@njit
def turn_on(g: Record, q: Record) -> None:
    """Keep `nominal_turn` of the sample: anew in each 64th, by its rotor from one to the next, within 1e-14
    (measured: 40 ns a sample less)."""
    q.turn = nominal_turn(g, q.memory.seen) if q.memory.seen % 64 == 0 else q.turn * g.rotor


@njit
def dead_poles(g: Record, q: Record) -> int:
    """Mask of poles whose current is gone, by its largest sample in a sixth of a cycle.

    The phasor decays for a filter's length after the current has ended, while the voltage of a line that is
    cut off falls, and the impedance runs through the zones.
    """
    mask = 0
    for phase in range(3):
        size = math.sqrt(size2(q.x[3 + phase]))
        limit = SQRT2 * max(g.open_current, GONE * size)
        if recent.largest_current(q.recent, phase, max(g.values // 6, 1)) < limit:
            mask |= 1 << phase
    return mask


@njit
def is_sound(g: Record, q: Record) -> bool:
    """Whether no loop looks like a fault: shorter than LIKE_A_FAULT of the line, ahead or behind, at its
    angle and
    not at a load's."""
    for loop in range(6):
        r, x = q.loops[2 * loop], q.loops[2 * loop + 1]
        size = math.sqrt(r * r + x * x)
        along = abs(r * g.z1.real + x * g.z1.imag)
        if size * size < LIKE_A_FAULT**2 * size2(g.z1) and along >= AT_ITS_ANGLE * size * abs(g.z1):
            return False
    return True


@njit
def watch_breaker(g: Record, q: Record) -> bool:
    """A pole that opens makes a new normal: the memory starts again a cycle later, blind until then."""
    opened = q.was_closed & ~q.closed
    q.was_closed = q.closed
    if opened and q.closed:
        q.memory.blind = g.cycle
    if q.memory.blind > 0:
        q.memory.blind -= 1
        q.memory.frozen = 0
        if q.memory.blind == 0:
            memory.fill(g, q.memory, q.x)
            if q.closed == 0:  # nothing, or a charge that leaves, on the line's side: there must be a voltage
                q.memory.ready = q.memory.steady = 0
    return q.memory.blind == 0 and q.memory.ready == 1


@njit
def compensate(g: Record, q: Record) -> None:
    """What the parallel line's residual current adds to a ground loop's: nothing on the healthy one of two
    lines, whose own is the smaller one; it would look for the fault nearer than it is."""
    beside, own = size2(q.recent.beside), 9 * size2(q.sequence[3])
    counts = size2(g.mutual) > 0.0 and own > SHARE**2 * beside
    q.mutual = g.mutual * q.recent.beside if counts else complex(0.0, 0.0)
    q.recent.mutual = g.mutual_in_time if counts else 0.0


@njit
def is_idle(q: Record) -> bool:
    """Whether nobody has done anything about the disturbance at the sample before."""
    return not (q.zone_started or q.held or q.swing_fault or q.slides)


@njit
def begin(g: Record, q: Record, sample: NDArray, row: NDArray, loops: NDArray) -> None:
    """Before the functions: what was measured, the memory, the change against it; publications cleared."""
    q.number += 1
    for k in range(6):
        q.x[k] = complex(row[2 * k], row[2 * k + 1])
    turn_on(g, q)
    turn = q.turn
    if g.in_front:
        cvt.restore(g.inverse, q.inverse, sample, q.sample)
        recent.instantaneous(q.sample, q.x, turn, q.sample)
    else:
        recent.instantaneous(sample, q.x, turn, q.sample)
    wide = sample.shape[0] == WIDE
    for k in range(3):
        q.across[k] = sample[6 + k] if wide else np.nan
    q.beside = sample[9] if wide else np.nan
    recent.keep(g, q.recent, q.sample, q.beside, turn)
    for k in range(12):
        q.loops[k] = loops[k]
    q.frequency = row[12]
    q.rocof = row[13]
    sequences(q.x, q.sequence)
    compensate(g, q)
    q.sound = q.memory.ready or is_sound(g, q)
    ready = memory.remember(g, q.memory, q.x, q.frequency, q.sound)
    q.settled = q.memory.seen > g.settled
    ready &= watch_breaker(g, q)
    energy.accumulate(q.energy, q.sample, q.memory.reference, turn)
    if q.memory.frozen == memory.ANEW:
        memory.freeze(q.memory)
    elif not q.memory.frozen:
        if ready and memory.differs(g, q.x, q.memory.reference):
            memory.freeze(q.memory)
    elif ready and is_idle(q) and memory.begins_anew(g, q.memory, q.x) and not has_any_collapsed(g, q.recent):
        memory.begin_anew(q.memory)
        energy.again(g, q.energy, q.recent, q.memory, turn)
    q.ready = ready
    q.disturbed = 1 if ready and q.memory.frozen == 1 else 0
    q.dead = 7 & ~q.closed
    if q.disturbed:
        q.dead |= dead_poles(g, q)
        energy.follow(g, q.energy)
        for k in range(6):
            q.d[k] = q.x[k] - q.memory.reference[k]
        sequences(q.d, q.change)
        q.memory.fed |= memory.current_differs(g, q.x, q.memory.reference)
        currents.watch_change(g, q)
        voltages.lose(g, q)
        second.follow(g, q, turn)
        q.loaded |= q.dead != ALL_POLES
    else:
        energy.rest(g, q.energy, ready)
        second.forget(q.second)
        if q.memory.tick == 0 and q.memory.seen > g.settling and q.memory.frozen != memory.ANEW:
            voltages.prove(g, q)
            currents.watch(g, q)
    lost_voltages.watch(g, q, sample)
    unsampled.watch(g, q, sample)
    q.fed = q.memory.fed if q.disturbed else 0
    forget(q)


@njit
def forget(q: Record) -> None:
    """Clear what the functions publish afresh at every sample."""
    q.held = q.poles != 0
    q.blocked_loops = 0
    q.blocked_zones = q.rests
    q.was_started = q.zone_started
    q.zone_started = 0
    q.inside = 0
    q.started = 0
    q.last_zones, q.zones = q.zones, 0
    q.pilot = 0
    q.transfer = 0
    q.request.made = 0
    q.pickup = 0
    q.operate = 0


@njit
def finish(g: Record, q: Record, words: NDArray[np.uint64]) -> None:
    """After the functions: end a disturbance that nobody needs any more; the bits of pickup and operate."""
    if q.disturbed and not q.zone_started and not q.held:
        memory.thaw(g, q.memory, q.x, q.frequency, q.fault, q.inside)
    words[0] = q.pickup
    words[1] = q.operate
    if q.pickup != q.last_pickup or q.operate != q.last_operate:
        q.changed += 1
        q.last_pickup = q.pickup
        q.last_operate = q.operate


@njit(forceinline=True)
def indicate(q: Record, bit: int, on: int) -> None:
    """A bit of pickup that is no start - a direction, a blocking - or several from there on, as a mask."""
    q.pickup |= np.uint64(on) << np.uint64(bit)


@njit(forceinline=True)
def publish(q: Record, bit: int, started: bool, operated: bool) -> None:
    """Start and operate of a protection function."""
    q.started |= 1 if started else 0
    q.pickup |= np.uint64(started) << np.uint64(bit)
    q.operate |= np.uint64(operated) << np.uint64(bit)


@njit
def request_trip(q: Record, bit: int, fault: int, three_pole: int) -> None:
    """Wish to trip for a fault of this type; the first function that asks is the one that trips."""
    if q.request.made == 0:
        q.request.made = 1
        q.request.bit = bit
        q.request.fault = fault
    else:
        three_pole |= q.request.three_pole
    q.request.three_pole = three_pole
