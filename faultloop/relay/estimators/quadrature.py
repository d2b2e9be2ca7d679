"""Design of a pair of FIR filters that gives the real and the imaginary part of a phasor.

Row k of a design is tap k, and tap 0 is the newest sample: time -k / fs.  A design's output is the local
phasor Z, RMS, of x(t) = sqrt(2) Re(Z exp(j 2 pi f0 t)) with t = 0 at the newest sample.
"""

from __future__ import annotations

import numpy as np

from faultloop.errors import InputError
from faultloop.relay.estimators.base import Array

# Harmonics up to this part of the sampling rate are modelled; nearer to the half of it their columns fade.
USABLE_BAND = 0.45


def fundamental(times: Array, frequency_hz: float) -> Array:
    """Columns that the parts of an RMS phasor multiply: sqrt(2) cos and -sqrt(2) sin, (n, 2)."""
    angle = 2.0 * np.pi * frequency_hz * times
    return np.sqrt(2.0) * np.column_stack([np.cos(angle), -np.sin(angle)])


def tap_times(taps: int, sampling_hz: int) -> Array:
    """Times of the taps [s], the newest at 0, (taps,)."""
    return -np.arange(taps) / sampling_hz


def fit(columns: Array) -> Array:
    """The rows of the pseudo-inverse that give the first two unknowns of a model, (taps, 2).

    Raises
    ------
    InputError : the window is shorter than the model's unknowns, or cannot tell them apart.
    """
    taps, unknowns = columns.shape
    if taps < unknowns:
        raise InputError(
            f"a window of {taps} samples is shorter than the {unknowns} unknowns of the model: "
            "lengthen the window or raise sampling_hz",
            key="window_cycles",
        )
    if np.linalg.cond(columns) > 1e6:
        raise InputError(
            f"a window of {taps} samples cannot tell the {unknowns} unknowns of the model apart: lengthen it",
            key="window_cycles",
        )
    return np.array(np.linalg.pinv(columns)[:2].T, order="C", dtype=np.float64)


def harmonic_rows(taps: int, sampling_hz: int, frequency_hz: float, orders: range) -> Array:
    """Least-squares fit of the fundamental together with the harmonics ``orders`` (0: direct), (taps, 2).

    With taps = fs / f0 and all orders the columns are orthogonal and this is the full-cycle DFT; with
    half of it and the odd orders, the half-cycle DFT.  With a fractional fs / f0 it keeps their exact
    zeros, at a noise gain within 0.3 % of the DFT's.
    """
    times = tap_times(taps, sampling_hz)
    columns = [fundamental(times, frequency_hz)]
    unknowns = 2
    for order in orders:
        new = 1 if order == 0 else 2
        if order == 1 or order * frequency_hz > USABLE_BAND * sampling_hz or unknowns + new > taps:
            continue
        unknowns += new
        columns.append(fundamental(times, order * frequency_hz)[:, :new])
    return fit(np.hstack(columns))


def calibrate(rows: Array, sampling_hz: int, frequency_hz: float) -> Array:
    """Mix the two rows so that a pure sinusoid at f0 gives its phasor exactly, (taps, 2).

    Any two filters whose outputs at f0 are not in phase can be calibrated so.
    """
    response = rows.T @ fundamental(tap_times(len(rows), sampling_hz), frequency_hz)
    return np.array(np.linalg.solve(response, rows.T).T, order="C", dtype=np.float64)


def full_cycle_rows(sampling_hz: int, frequency_hz: float) -> Array:
    """The full-cycle DFT, or the least-squares design nearest to it, (round(fs / f0), 2)."""
    taps = round(sampling_hz / frequency_hz)
    return harmonic_rows(taps, sampling_hz, frequency_hz, range(taps))
