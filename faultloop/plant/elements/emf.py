"""A balanced voltage behind its series impedance, a branch from the element's own node to the bus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from faultloop.jit import njit
from faultloop.plant.elements import HALF_ROOT_3, Floats, Ints
from faultloop.plant.elements.series_rl import SeriesRL

BLOCK = 32
"""Steps between exact sines; within a block the phasor turns by a table: random access and no drift."""


@dataclass(frozen=True)
class Emf:
    """``behind`` is its impedance: from the node of the voltage itself to a bus."""

    behind: SeriesRL
    amplitude: float
    """Phase to ground, peak [V]."""
    frequency_hz: float
    phase: float
    """Of phase A against cos(2 pi f t) [rad], when the run begins."""
    swing: tuple[tuple[float, float], ...] = ()
    """Times [s], ascending, and how far the phase then has moved [rad]: on straight lines between them, and
    nowhere before the first and after the last."""


class Emfs(NamedTuple):
    """Constants of all.  Their voltages are the last rows of ``v``, their branches the first branches."""

    wave: Floats
    """(sources, 3) amplitude [V peak], frequency [Hz], phase [rad]"""
    turn: Floats
    """(sources, BLOCK, 2) cos, sin of the angle turned in k steps"""
    rate: Floats
    """(1,) steps per second"""
    first_point: Ints
    """(sources + 1,) first row of ``swing`` of each source"""
    swing: Floats
    """(points, 2) time [steps], how far the phase has moved [rad]"""


def emf_constants(emfs: Sequence[Emf], rate: int) -> Emfs:
    """Of a circuit's sources; ``rate`` in steps per second."""
    turn = np.arange(BLOCK) * 2 * np.pi * (1 / rate)
    angles = np.array([emf.frequency_hz for emf in emfs])[:, None] * turn
    return Emfs(
        wave=np.array([[e.amplitude, e.frequency_hz, e.phase] for e in emfs]),
        turn=np.stack([np.cos(angles), np.sin(angles)], axis=-1),
        rate=np.array([float(rate)]),
        first_point=np.cumsum([0, *(len(emf.swing) for emf in emfs)]).astype(np.int64),
        swing=np.array([(t * rate, x) for emf in emfs for t, x in emf.swing]).reshape(-1, 2),
    )


@njit(forceinline=True)
def renew_emf(emfs: Emfs, kept: Floats, v: Floats, step: int) -> None:
    """Voltages of a step into their rows of v; ``kept`` (sources, 3) is cos and sin at the first step of a
    block, and that block's number."""
    block, turn = step // BLOCK, step % BLOCK
    for s in range(emfs.wave.shape[0]):
        if emfs.first_point[s + 1] > emfs.first_point[s]:
            angle = emf_angle(emfs, s, float(step)) + swing_angle(emfs, s, float(step))
            put_emf(emfs, v, s, math.cos(angle), math.sin(angle))
            continue
        if kept[s, 2] != block:
            angle = emf_angle(emfs, s, float(block * BLOCK))
            kept[s, 0], kept[s, 1] = math.cos(angle), math.sin(angle)
            kept[s, 2] = block
        c, d = kept[s, 0], kept[s, 1]
        e, f = emfs.turn[s, turn, 0], emfs.turn[s, turn, 1]
        put_emf(emfs, v, s, c * e - d * f, d * e + c * f)


@njit
def exact_emf(emfs: Emfs, v: Floats, time: float) -> None:
    """Voltages at any time [steps] into their rows of v."""
    for s in range(emfs.wave.shape[0]):
        angle = emf_angle(emfs, s, time) + swing_angle(emfs, s, time)
        put_emf(emfs, v, s, math.cos(angle), math.sin(angle))


@njit(forceinline=True)
def emf_angle(emfs: Emfs, s: int, time: float) -> float:
    """Phase A's angle at a time [steps]; whole cycles are taken out first, so it never loses digits."""
    rate = emfs.rate[0]
    return 2 * math.pi * ((emfs.wave[s, 1] * time % rate) / rate) + emfs.wave[s, 2]


@njit
def swing_angle(emfs: Emfs, s: int, time: float) -> float:
    """How far a source's phase has moved at a time [steps]."""
    first, last = emfs.first_point[s], emfs.first_point[s + 1] - 1
    if last < first:
        return 0.0
    if time <= emfs.swing[first, 0]:
        return emfs.swing[first, 1]
    for k in range(first, last):
        t, u = emfs.swing[k, 0], emfs.swing[k + 1, 0]
        if time < u:
            return emfs.swing[k, 1] + (emfs.swing[k + 1, 1] - emfs.swing[k, 1]) * (time - t) / (u - t)
    return emfs.swing[last, 1]


@njit(forceinline=True)
def put_emf(emfs: Emfs, v: Floats, s: int, re: float, im: float) -> None:
    """Three balanced phases."""
    row = v.shape[0] - emfs.wave.shape[0] + s
    amplitude = emfs.wave[s, 0]
    v[row, 0] = amplitude * re
    v[row, 1] = amplitude * (HALF_ROOT_3 * im - 0.5 * re)
    v[row, 2] = -amplitude * (HALF_ROOT_3 * im + 0.5 * re)
