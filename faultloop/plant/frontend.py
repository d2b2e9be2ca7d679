"""From primary values to a relay's samples: anti-aliasing low-pass, noise, analog-to-digital converter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.config.place import FrontEnd
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.plant.component import PlantTables

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
    filtered: NDArray[np.bool_]
    """(1,) whether any relay has a low-pass, so that every step must be delivered"""
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
    rate: float,
) -> FrontEnds:
    """Their constants.  ``bus`` and ``terms`` (row, sign) say where relay i measures; ``rate`` in steps/s."""
    count = len(tables.relay)
    settings = [relay.front_end or tables.front_end for relay in tables.relay]
    lowpass = np.zeros((count, SECTIONS, 5))
    for i, s in enumerate(settings):
        if s.antialias_hz:
            rows = _butterworth(s, rate, f"relay[{tables.relay[i].name}].front_end.antialias_hz")
            lowpass[i, : len(rows)] = rows
    sections = [s.antialias_order // 2 if s.antialias_hz else 0 for s in settings]
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
        filtered=np.array([any(sections)]),
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


def settle(
    front: FrontEnds, z: NDArray[np.float64], x: NDArray[np.complex128], angle: float
) -> NDArray[np.complex128]:
    """Adds to the filter states ``z`` (relays, 6, SECTIONS, 2) what an eternal sinusoid leaves in them before
    step 0: ``x`` (relays, 6) its peak phasors at step 0, ``angle`` [rad] its turn per step.  Returns the
    phasors behind the filters."""
    back = np.exp(-1j * angle)
    behind = x.copy()
    for i, count in enumerate(front.sections):
        signal = x[i]
        for s in range(count):
            b0, b1, b2, a1, a2 = front.lowpass[i, s]
            out = signal * (b0 + b1 * back + b2 * back**2) / (1 + a1 * back + a2 * back**2)
            second = (b2 * signal - a2 * out) * back
            z[i, :, s, 0] += ((b1 * signal - a1 * out) * back + second * back).real
            z[i, :, s, 1] += second.real
            signal = out
        behind[i] = signal
    return behind


@njit
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


@njit
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
