"""The arrays that the relay's kernels share: constants from the settings, zones, and the state.

Everything that changes while the relay runs is in one record of type ``STATE`` (plus the loops' and the
estimator's own): a checkpoint is a copy of it.  Phasors are complex RMS, primary, in the order
va vb vc ia ib ic, against cos(2 pi f0 t).  Loops are numbered AG BG CG AB BC CA = 0 .. 5; a fault type is
0 for none, 1 .. 6 for one of these loops, 7 for ABC.  (Kernels under njit bake these numbers in.)
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.settings import MAX_ZONES, Pdis, RelaySettings

LOOPS = ("AG", "BG", "CG", "AB", "BC", "CA")
FAULTS = ("", *LOOPS, "ABC")
THREE_PHASE = 7
SNAPSHOTS = 32
MEMORY_CYCLES = 2
REFERENCE_CYCLES = 1.25  # longer than the slowest estimator takes to show a disturbance

SELF, CROSS, MEMORY_POLARIZED, OFFSET, QUAD = range(5)
_POLARIZATION = {"self": SELF, "cross": CROSS, "memory": MEMORY_POLARIZED}
_DIRECTION = {"forward": 1, "reverse": -1, "none": 0}
_LOOPS = {"all": 0b111111, "ground": 0b000111, "phase": 0b111000}

DEFAULT_CURRENT_A = 20.0


def _record(*fields: tuple) -> np.dtype:
    return np.dtype(list(fields), align=True)


CONSTANTS = _record(
    ("frequency", "f8"),  # nominal [Hz]
    ("sampling", "f8"),  # [Hz]
    ("cycle", "i8"),  # samples in a nominal cycle
    ("snapshot", "i8"),  # samples between two snapshots of the memory
    ("snapshots", "i8"),  # how many of the ring are used
    ("lag", "i8"),  # how many snapshots ago the reference was taken
    ("settling", "i8"),  # samples until the estimator is right
    ("z1", "c16"),
    ("z0", "c16"),
    ("minimum_voltage", "f8"),
    ("pickup_current", "f8"),
    ("pickup_current_pu", "f8"),
    ("pickup_voltage_pu", "f8"),
    ("single_phase", "f8"),
    ("three_phase", "f8"),
    ("memory", "i8"),  # samples
    ("fade", "i8"),  # samples
    ("sector_low", "c16"),  # unit phasors at the borders of the forward sector
    ("sector_high", "c16"),
    ("z2_forward", "f8"),  # of the line's impedance
    ("z2_reverse", "f8"),
    ("minimum_unbalance", "f8"),
    ("minimum_current", "f8"),
    ("single_pole", "i8"),
    ("minimum_trip", "i8"),  # samples
    ("open_current", "f8"),
    ("takagi", "i8"),
    ("user_trip", "u8"),  # bit k: element k trips
)

ZONE = _record(
    ("zone", "i8"),
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
    ("security", "f8"),  # what the security counter must reach
    ("trips", "i8"),
    ("pilot", "i8"),
)

MEMORY = _record(
    ("ring", "c16", (SNAPSHOTS, 6)),
    ("ring_frequency", "f8", (SNAPSHOTS,)),
    ("head", "i8"),  # the newest snapshot
    ("tick", "i8"),  # samples since it
    ("seen", "i8"),  # samples since the start
    ("steady", "i8"),  # snapshots in a row at which the voltage stood still
    ("ready", "i8"),
    ("moving", "i8"),  # something changed within the last cycle
    ("drift", "f8"),  # size2 of the change of all phasors within the last snapshot
    ("frozen", "i8"),  # a disturbance: the reference is kept from before it
    ("fed", "i8"),  # a current has changed too, and not only a voltage
    ("age", "i8"),  # samples since
    ("calm", "i8"),  # samples in a row without a difference from the reference
    ("still", "i8"),  # samples in a row without movement, and outside every zone
    ("blind", "i8"),  # samples left after a pole opened
    ("frequency", "f8"),  # of the reference [Hz]
    ("rotor", "c16"),  # its turn per sample
    ("reference", "c16", (6,)),
)

SELECTION = _record(("fault", "i8"), ("candidate", "i8"), ("count", "i8"))

DIRECTION = _record(("direction", "i8"), ("candidate", "i8"), ("count", "i8"), ("polarizing", "c16"))

ZONE_STATE = _record(
    ("counter", "f8"),
    ("fault", "i8"),  # the type it started with
    ("outside", "i8"),
    ("pickup", "i8"),
    ("operate", "i8"),
    ("timer", "i8"),
)

TRIP = _record(
    ("poles", "i8"),
    ("timer", "i8"),
    ("zone", "i8"),  # index of the zone, -1 - k for user element k
    ("fault", "i8"),
    ("pilot", "i8"),
    ("count", "i8"),  # trips so far; a change is an event
)

LOCATION = _record(
    ("mean", "f8"),
    ("spread", "f8"),
    ("count", "i8"),
    ("best_spread", "f8"),
    ("value", "f8"),  # the answer, per unit of the line
    ("fault", "i8"),  # the type it is for; 0 between faults
    ("told", "i8"),  # faults located so far; a change is an event
)

STATE = _record(
    ("x", "c16", (6,)),  # phasors now
    ("d", "c16", (6,)),  # their change against the reference
    ("sequence", "c16", (6,)),  # v0 v1 v2 i0 i1 i2 now
    ("change", "c16", (6,)),  # the same of the change
    ("word", "u8", (2,)),  # pickup and operate bits now
    ("changed", "i8"),  # samples of the last block at which a bit changed
    ("closed", "i8"),  # mask of closed poles, as reported
    ("was_closed", "i8"),
    ("memory", MEMORY),
    ("selection", SELECTION),
    ("direction", DIRECTION),
    ("zone", ZONE_STATE, (MAX_ZONES,)),
    ("trip", TRIP),
    ("location", LOCATION),
)


def constants(settings: RelaySettings, settling_samples: int) -> NDArray[np.void]:
    """The settings as one ``CONSTANTS`` record, shape (1,), in primary values and samples."""
    c = np.zeros(1, CONSTANTS)
    relay, rdir, phs, ptrc = settings.relay, settings.rdir, settings.phs, settings.ptrc
    cycle = relay.sampling_hz / relay.frequency_hz

    def samples(ms: float) -> int:
        return round(ms * relay.sampling_hz / 1000)

    snapshot = math.ceil(MEMORY_CYCLES * cycle / SNAPSHOTS)
    voltage = 1.0 if relay.nominal_kv is None else 100.0 * relay.nominal_kv / math.sqrt(3)
    if relay.nominal_kv is None and relay.vt_ratio is not None:
        voltage *= relay.vt_ratio
    values = {
        "frequency": relay.frequency_hz,
        "sampling": relay.sampling_hz,
        "cycle": round(cycle),
        "snapshot": snapshot,
        "snapshots": math.ceil(MEMORY_CYCLES * cycle / snapshot),
        "lag": math.ceil(REFERENCE_CYCLES * cycle / snapshot),
        # A recursive estimator forgets its start slowly; the memory waits for a steady voltage anyway.
        "settling": max(min(settling_samples, math.ceil(1.25 * cycle)), 1),
        "z1": settings.z1_ohm,
        "z0": settings.z0_ohm,
        "minimum_voltage": voltage,
        "pickup_current": settings.amperes(phs.pickup_current_a, DEFAULT_CURRENT_A / 2),
        "pickup_current_pu": phs.pickup_current_pu,
        "pickup_voltage_pu": phs.pickup_voltage_pu,
        "single_phase": phs.single_phase_ratio,
        "three_phase": phs.three_phase_unbalance,
        "memory": samples(rdir.memory_ms),
        "fade": max(samples(100.0), 1),
        "sector_low": cmath.rect(1.0, -math.radians(rdir.minimum_angle_deg)),
        "sector_high": cmath.rect(1.0, math.radians(rdir.maximum_angle_deg)),
        "z2_forward": rdir.z2_forward_pu,
        "z2_reverse": rdir.z2_reverse_pu,
        "minimum_unbalance": rdir.minimum_unbalance,
        "minimum_current": minimum_current(settings),
        "single_pole": ptrc.mode == "single-pole",
        "minimum_trip": samples(ptrc.minimum_trip_ms),
        "open_current": settings.amperes(ptrc.open_current_a, DEFAULT_CURRENT_A),
        "takagi": settings.rflo.method == "takagi",
        "user_trip": sum(1 << k for k, element in enumerate(settings.element) if element.trip),
    }
    for key in CONSTANTS.names or ():
        c[key] = values[key]
    return c


def minimum_current(settings: RelaySettings) -> float:
    """Below it a loop's impedance is not defined: the least of the zones' minimum currents [A]."""
    given = [settings.amperes(z.minimum_current_a, DEFAULT_CURRENT_A) for z in settings.pdis]
    return min(given, default=DEFAULT_CURRENT_A)


def zones(settings: RelaySettings) -> NDArray[np.void]:
    """The zones as ``ZONE`` records, one per ``[[pdis]]``, in primary values and samples."""
    result = np.zeros(len(settings.pdis), ZONE)
    cycle = settings.relay.sampling_hz / settings.relay.frequency_hz
    for row, zone in zip(result, settings.pdis, strict=True):
        row["zone"] = zone.zone
        row["direction"] = _DIRECTION[zone.direction]
        row["characteristic"] = _characteristic(zone)
        row["loops"] = _LOOPS[zone.loops]
        row["reach"] = settings.reach_ohm(zone) * (-1 if zone.direction == "reverse" else 1)
        k0 = zone.residual_compensation_factor
        row["k0"] = settings.residual_compensation_factor if k0 is None else complex(*k0)
        row["tilt"] = cmath.rect(1.0, math.radians(zone.tilt_deg))
        phase = zone.resistive_reach_ohm or 0.0
        ground = phase if zone.resistive_reach_ground_ohm is None else zone.resistive_reach_ground_ohm
        row["resistive_phase"] = phase * settings.ohm_ratio
        row["resistive_ground"] = ground * settings.ohm_ratio
        for loops, delay in (("phase", zone.delay_phase_ms), ("ground", zone.delay_ground_ms)):
            ms = zone.delay_ms if delay is None else delay
            row[f"delay_{loops}"] = round(ms * settings.relay.sampling_hz / 1000)
        row["minimum_current"] = settings.amperes(zone.minimum_current_a, DEFAULT_CURRENT_A)
        row["minimum_residual"] = settings.amperes(zone.minimum_residual_current_a, DEFAULT_CURRENT_A)
        row["security"] = zone.security_cycles * cycle
        row["trips"] = settings.ptrc.zones is None or zone.zone in settings.ptrc.zones
        row["pilot"] = zone.zone == settings.ptrc.pilot_zone
    return result


def _characteristic(zone: Pdis) -> int:
    if zone.characteristic == "quad":
        return QUAD
    if zone.direction == "none":
        return OFFSET
    return _POLARIZATION[zone.polarization or "memory"]


def initial_state() -> NDArray[np.void]:
    """A ``STATE`` record, shape (1,), of a relay that has seen nothing."""
    s = np.zeros(1, STATE)
    s["closed"] = s["was_closed"] = 7
    s["location"]["value"] = np.nan
    return s
