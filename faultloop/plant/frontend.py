"""From primary values to a relay's samples: instrument transformers, anti-aliasing low-pass, noise,
analog-to-digital converter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from faultloop.config.place import FrontEnd
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.ct import FLUX, Ct, Cts, ct_constants, ct_step, settle_ct
from faultloop.plant.instrument import open_circuits, open_step
from faultloop.plant.vt import MODES, Vt, Vts, settle_vt, vt_constants, vt_step

C = TypeVar("C", bound=Component)

SECTIONS = 2
"""Second-order sections of the longest low-pass."""


class FrontEnds(NamedTuple):
    """Where every relay measures and what its front end does."""

    bus: NDArray[np.int64]
    """(relays,) row of v"""
    pointer: NDArray[np.int64]
    """(relays + 1,) first term of each relay's current"""
    term: NDArray[np.int64]
    """(terms,) row of current"""
    sign: NDArray[np.float64]
    ct: Cts
    opened: NDArray[np.int64]
    """(circuits, 4) of transformers that open (`faultloop.plant.instrument.open_circuits`)"""
    vt: Vts
    stepped: NDArray[np.bool_]
    """(1,) whether any relay has a low-pass or a transformer that is not ideal, so that every step must be
    delivered"""
    lowpass: NDArray[np.float64]
    """(relays, SECTIONS, 5) b0 b1 b2 a1 a2"""
    sections: NDArray[np.int64]
    """(relays,) sections in use"""
    seed: NDArray[np.uint64]
    """(relays,)"""
    noise: NDArray[np.float64]
    """(relays, 6) RMS"""
    lsb: NDArray[np.float64]
    """(relays, 6) one code; 0: no converter"""
    codes: NDArray[np.float64]
    """(relays,) of either polarity: 2^(bits - 1)"""


def front_ends(
    tables: PlantTables,
    bus: Sequence[int],
    terms: Sequence[Sequence[tuple[int, float]]],
    others: Sequence[tuple[int, int]],
    rate: float,
) -> FrontEnds:
    """Their constants.  ``bus`` and ``terms`` (row, sign) say where relay i measures, ``others`` (relay,
    row) the voltages of breakers' other sides, which pass a front end like that of their relay; ``rate`` in
    steps/s."""
    owners = [*tables.relay, *(tables.relay[i] for i, _ in others)]
    bus, terms = [*bus, *(row for _, row in others)], [*terms, *([] for _ in others)]
    count = len(owners)
    settings = [relay.front_end or tables.front_end for relay in owners]
    lowpass = np.zeros((count, SECTIONS, 5))
    for i, s in enumerate(settings):
        if s.antialias_hz:
            rows = _butterworth(s, rate, f"relay[{owners[i].name}].front_end.antialias_hz")
            lowpass[i, : len(rows)] = rows
    sections = [s.antialias_order // 2 if s.antialias_hz else 0 for s in settings]
    own_cts, own_vts = _named(tables, "ct", Ct), _named(tables, "vt", Vt)
    opened = open_circuits([*own_cts, *own_vts], rate)
    cts = ct_constants(own_cts, float(tables.system.frequency_hz), rate)
    vts = vt_constants(own_vts, float(tables.system.frequency_hz), rate)
    flat = [term for relay in terms for term in relay]
    rated_peak = tables.system.base_kv * 1e3 * math.sqrt(2 / 3)
    noise = [[s.voltage_noise_v] * 3 + [s.current_noise_a] * 3 for s in settings]
    codes = [2.0 ** (s.adc_bits - 1) if s.adc_bits else 0.0 for s in settings]
    scale = [
        [s.voltage_full_scale_v or 2 * rated_peak] * 3 + [s.current_full_scale_a or 0.0] * 3 for s in settings
    ]
    lsb = [[x / n if n else 0.0 for x in row] for row, n in zip(scale, codes, strict=True)]
    seeds = np.random.SeedSequence(tables.scenario.seed).generate_state(max(count, 1), np.uint64)[:count]
    return FrontEnds(
        bus=np.array(bus, dtype=np.int64),
        pointer=np.cumsum([0, *(len(t) for t in terms)]).astype(np.int64),
        term=np.array([row for row, _ in flat], dtype=np.int64),
        sign=np.array([sign for _, sign in flat], dtype=np.float64),
        ct=cts,
        opened=opened,
        vt=vts,
        stepped=np.array([any(sections) or len(cts.relay) > 0 or len(vts.relay) > 0 or len(opened) > 0]),
        lowpass=lowpass,
        sections=np.array(sections, dtype=np.int64),
        seed=seeds.astype(np.uint64),
        noise=np.array(noise, dtype=np.float64).reshape(count, 6),
        lsb=np.array(lsb, dtype=np.float64).reshape(count, 6),
        codes=np.array(codes, dtype=np.float64),
    )


def _butterworth(settings: FrontEnd, rate: float, key: str) -> NDArray[np.float64]:
    """(sections, 5) b0 b1 b2 a1 a2: the bilinear transformation, exact at the -3 dB frequency, of pole pairs
    with quality 1 / (2 sin((2 i + 1) pi / 2 n))."""
    if settings.antialias_hz >= 0.45 * rate:
        raise InputError(
            f"{settings.antialias_hz:g} Hz is too near half the plant's {rate:g} steps per second; at most "
            f"{0.45 * rate:g} (or more system.steps_per_sample)",
            key=key,
        )
    order = settings.antialias_order
    k = math.tan(math.pi * settings.antialias_hz / rate)
    rows = []
    for i in range(order // 2):
        damping = 2 * k * math.sin((2 * i + 1) * math.pi / (2 * order))
        scale = 1 / (1 + damping + k * k)
        gain = k * k * scale
        rows.append([gain, 2 * gain, gain, 2 * (k * k - 1) * scale, (1 - damping + k * k) * scale])
    return np.array(rows)


def _named(tables: PlantTables, key: str, kind: type[C]) -> list[tuple[int, C]]:
    """The transformers of that kind that relays name, each with the relay's number."""
    return [
        (i, tables.find(kind, name, f"relay[{relay.name}].{key}"))
        for i, relay in enumerate(tables.relay)
        if (name := getattr(relay, key)) is not None
    ]


class Analog(NamedTuple):
    """What the front ends remember from step to step, views of the plant's buffer."""

    ct: NDArray[np.float64]
    """(cts, 3, 2) flux linkage [V s], secondary current [A]"""
    vt: NDArray[np.float64]
    """(vts, 3, modes + 1, 2) modes, and the last input [V]"""
    lowpass: NDArray[np.float64]
    """(relays, 6, SECTIONS, 2)"""


def analog_shapes(front: FrontEnds) -> dict[str, tuple[int, ...]]:
    """Of `Analog`."""
    return {
        "ct": (len(front.ct.relay), 3, 2),
        "vt": (len(front.vt.relay), 3, MODES + 1, 2),
        "lowpass": (len(front.bus), 6, SECTIONS, 2),
    }


def settle(
    front: FrontEnds, state: Analog, x: NDArray[np.complex128], angle: float
) -> NDArray[np.complex128]:
    """Adds to ``state`` what an eternal sinusoid leaves in it before step 0.

    ``x`` (relays, 6) are its peak phasors at step 0, ``angle`` [rad] its turn per step.  Returns the phasors
    behind the front ends."""
    back = np.exp(-1j * angle)
    behind = x.copy()
    settle_ct(front.ct, state.ct, behind, angle)
    settle_vt(front.vt, state.vt, behind, angle)
    for i, count in enumerate(front.sections):
        signal = behind[i].copy()
        for s in range(count):
            b0, b1, b2, a1, a2 = front.lowpass[i, s]
            out = signal * (b0 + b1 * back + b2 * back**2) / (1 + a1 * back + a2 * back**2)
            second = (b2 * signal - a2 * out) * back
            state.lowpass[i, :, s, 0] += ((b1 * signal - a1 * out) * back + second * back).real
            state.lowpass[i, :, s, 1] += second.real
            signal = out
        behind[i] = signal
    return behind


def magnetize(front: FrontEnds, state: Analog, tables: PlantTables) -> None:
    """Adds the cores' remanence to the settled state.

    Raises InputError where the load alone saturates one."""
    hz = float(tables.system.frequency_hz)
    cores = [(i, ct) for i, ct in _named(tables, "ct", Ct) if ct.model == "saturating"]
    for k, (_, ct) in enumerate(cores):
        load = np.abs(state.ct[k, :, FLUX]).max()
        if load > ct.flux_at_vs(hz):
            raise InputError(
                f"the load alone needs {load / ct.flux_at_vs(hz):.2g} times the flux at vs_v; "
                "give a higher vs_v, a higher ratio or a smaller burden",
                key=ct.key("vs_v"),
            )
        state.ct[k, :, FLUX] += ct.remanence_pu * ct.flux_at_vs(hz)


@njit(forceinline=True)
def measure(
    front: FrontEnds, v: NDArray[np.float64], current: NDArray[np.float64], x: NDArray[np.float64]
) -> None:
    """Primary values of every relay into ``x`` (relays, 6)."""
    for i in range(front.bus.shape[0]):
        for p in range(3):
            x[i, p] = v[front.bus[i], p]
            total = 0.0
            for t in range(front.pointer[i], front.pointer[i + 1]):
                total += front.sign[t] * current[front.term[t], p]
            x[i, 3 + p] = total


@njit
def transform(front: FrontEnds, state: Analog, step: int, x: NDArray[np.float64]) -> None:
    """One step of everything that remembers, in place."""
    ct_step(front.ct, state.ct, x)
    vt_step(front.vt, state.vt, x)
    open_step(front.opened, step, x)
    lowpass(front, state.lowpass, x)


@njit
def lowpass(front: FrontEnds, z: NDArray[np.float64], x: NDArray[np.float64]) -> None:
    """One step of every filter, in place (transposed direct form II)."""
    for i in range(x.shape[0]):
        for s in range(front.sections[i]):
            b0, b1, b2, a1, a2 = front.lowpass[i, s]
            for c in range(6):
                value = x[i, c]
                out = b0 * value + z[i, c, s, 0]
                z[i, c, s, 0] = b1 * value - a1 * out + z[i, c, s, 1]
                z[i, c, s, 1] = b2 * value - a2 * out
                x[i, c] = out


@njit(forceinline=True)
def convert(front: FrontEnds, number: int, x: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Sample ``number`` of every relay: noise, quantization, clipping."""
    for i in range(x.shape[0]):
        for c in range(6):
            value = x[i, c]
            if front.noise[i, c] > 0.0:
                value += front.noise[i, c] * normal(front.seed[i], np.uint64(8 * number + c))
            if front.lsb[i, c] > 0.0:
                code = np.rint(value / front.lsb[i, c])
                value = front.lsb[i, c] * min(max(code, -front.codes[i]), front.codes[i] - 1.0)
            out[i, c] = value


@njit
def convert_block(front: FrontEnds, first: int, x: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Samples from number ``first`` on; ``x`` and ``out`` (n, relays, 6)."""
    for k in range(x.shape[0]):
        convert(front, first + k, x[k], out[k])


@njit
def normal(seed: np.uint64, counter: np.uint64) -> float:
    """A standard normal number, a function of seed and counter alone (Box and Muller, 1958): a sample's noise
    is the same whatever was computed before it, in blocks of any size."""
    first = mix(seed + np.uint64(2) * counter)
    second = mix(seed + np.uint64(2) * counter + np.uint64(1))
    radius = math.sqrt(-2.0 * math.log((np.float64(first >> np.uint64(11)) + 1.0) * 2.0**-53))
    return radius * math.cos(2.0 * math.pi * np.float64(second >> np.uint64(11)) * 2.0**-53)


@njit
def mix(counter: np.uint64) -> np.uint64:
    """SplitMix64's output for the counter's state (G. L. Steele et al., OOPSLA 2014)."""
    z = (counter + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
