"""A user's own record, from CSV or COMTRADE, through the papers' filters.

    from faultloop.study.own_data import disturbances, read_series, synchrophasors

    record = read_series("voltages.csv")                       # or .cfg, .cff
    found = synchrophasors(record, ("va", "vb", "vc"), "p-class", frequency_hz=50.0)
    events = disturbances(record, "va", "MSTUKF", frequency_hz=50.0).starts_s

Generators: `faultloop.study.papers.ckmc.generator`.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.io.comtrade import read_comtrade
from faultloop.relay.estimators import CHANNELS, FREQUENCY, ROCOF, ROW, make_estimator, run_estimator
from faultloop.study.papers.mstukf.cases import FADING, OMEGA, PHASE, TRACKS, Setting, track

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

TIMES = ("t", "time", "t_s", "time_s", "seconds")
UNEVEN = 0.01  # of an interval: what rounded times may be off


@dataclass(frozen=True)
class Series:
    """Columns of equal length at one sampling rate.

    names : of the columns.  values : (n, columns).  sampling_hz : samples per second.  start_s : time of the
    first.  file : where they are from.
    """

    names: tuple[str, ...]
    values: Array
    sampling_hz: float
    start_s: float
    file: Path

    @property
    def t_s(self) -> Array:
        """(n,) [s]."""
        return self.start_s + np.arange(len(self.values)) / self.sampling_hz

    def column(self, name: str) -> Array:
        """(n,).  Raises InputError for one that is not there."""
        if name not in self.names:
            there = nearest(name, self.names) if self.names else "it has none but the time"
            raise InputError(f"no column '{name}': {there}", file=self.file)
        return np.ascontiguousarray(self.values[:, self.names.index(name)])


def read_series(path: Path | str) -> Series:
    """Read a record.

    Parameters
    ----------
    path : a .csv whose first row has the columns' names, one of them t, time, t_s, time_s or seconds with
        evenly spaced times [s]; or a COMTRADE .cfg or .cff of one rate, whose channels become primary.

    Raises InputError for what is not there, no number, unevenly sampled, or shorter than two samples.
    """
    path = Path(path)
    if path.suffix.lower() in (".cfg", ".cff"):
        return _from_comtrade(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot be read as CSV: {error}", file=path) from error
    names = tuple(name.strip() for name in rows[0]) if rows else ()
    known = [name for name in names if name.lower() in TIMES]
    if not known:
        raise InputError(
            f"needs a first row of names, one of them a time in seconds: {', '.join(TIMES)}", file=path
        )
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"the name '{twice[0]}' stands twice in the first row", file=path)
    values = np.array([_numbers(row, names, path, line) for line, row in enumerate(rows[1:], 2)])
    place = names.index(known[0])
    sampling_hz = _rate(values[:, place] if len(values) else np.empty(0), path)
    others = tuple(name for name in names if name != known[0])
    return Series(others, np.delete(values, place, axis=1), sampling_hz, float(values[0, place]), path)


def _numbers(row: Sequence[str], names: Sequence[str], path: Path, line: int) -> list[float]:
    if len(row) != len(names):
        raise InputError(f"{len(row)} cells, but {len(names)} names", file=path, key=f"line {line}")
    found = []
    for name, text in zip(names, row, strict=True):
        try:
            found.append(float(text) if text.strip() else math.nan)
        except ValueError as error:
            raise InputError(f"'{text}' is no number", file=path, key=f"line {line}, {name}") from error
    return found


def _rate(t: Array, path: Path) -> float:
    """Samples per second of evenly spaced times; whole where they are within rounding of that."""
    if len(t) < 2:
        raise InputError("needs at least two samples", file=path)
    span = float(t[-1] - t[0])
    if not 0 < span < math.inf:
        raise InputError("its times do not rise", file=path)
    even = t[0] + span * np.arange(len(t)) / (len(t) - 1)
    off = np.abs(t - even) * (len(t) - 1) / span
    if not off.max() <= 0.5 + UNEVEN or np.diff(t).min() <= 0:
        first = int(np.argmax(off)) + 2
        raise InputError(f"the times are not evenly spaced: see line {first}", file=path)
    hz = (len(t) - 1) / span
    return float(round(hz)) if abs(hz - round(hz)) * span < 0.5 and round(hz) > 0 else hz


def _from_comtrade(path: Path) -> Series:
    record = read_comtrade(path)
    if len(record) < 2 or not record.analog:
        raise InputError("needs two samples of an analog channel at least", file=path)
    first, *others = record.stretches
    if others:
        rates = ", ".join(f"{rate.hz:g}" for rate in record.stretches)
        raise InputError(f"has stretches of {rates} Hz: one sampling rate is needed", file=path)
    factors = [c.to_primary if math.isfinite(c.to_primary) else 1.0 for c in record.analog]
    values = np.column_stack([c.values * factor for c, factor in zip(record.analog, factors, strict=True)])
    return Series(tuple(record.analog_names), values, first.hz, 0.0, path)


@dataclass(frozen=True)
class Synchrophasors:
    """One row a sample, at the time it refers to.

    t_s : (n,).  phasors : (n, k) RMS against cos(2 pi f0 t) of the record's time.  frequency_hz,
    rocof_hz_per_s : (n,) of the first three columns' positive sequence; NaN until they are known.
    """

    t_s: Array
    phasors: Complex
    frequency_hz: Array
    rocof_hz_per_s: Array


def synchrophasors(
    series: Series, columns: Sequence[str], method: str = "p-class", *, frequency_hz: float, **parameters: Any
) -> Synchrophasors:
    """Any of the relay's estimators over up to six columns of a record.

    Parameters
    ----------
    columns : names, voltages first: frequency is that of the first three, or of one alone.
    method, parameters : as in a relay's settings (docs/estimators.md).

    Raises InputError for more than six columns, one that is not there, and as the estimator does.
    """
    if not 1 <= len(columns) <= CHANNELS:
        raise InputError(f"{len(columns)} columns: one to {CHANNELS} are needed", key="columns")
    sampling_hz = round(series.sampling_hz)
    if sampling_hz != series.sampling_hz:
        raise InputError(
            f"{series.sampling_hz:.6g} samples a second: should be a whole number", file=series.file
        )
    estimator = make_estimator(method, sampling_hz, frequency_hz, **parameters)
    samples = np.zeros((len(series.values), CHANNELS))
    for place, name in enumerate(columns):
        samples[:, place] = series.column(name)
    rows = np.empty((len(samples), ROW))
    run_estimator(estimator.step, estimator.state.copy(), samples, rows)
    t = series.t_s - estimator.delay_samples / sampling_hz
    turn = np.exp(-2j * np.pi * frequency_hz * series.start_s)
    phasors = rows[:, : 2 * CHANNELS].copy().view(np.complex128)[:, : len(columns)] * turn
    return Synchrophasors(t, phasors, rows[:, FREQUENCY], rows[:, ROCOF])


@dataclass(frozen=True)
class Disturbances:
    """A waveform as a fundamental, odd harmonics and a frequency.

    t_s : (n,).  amplitudes : (n, 4) of harmonics 1, 3, 5, 7, in the record's unit.  phase_rad : (n,) of the
    fundamental's sine.  frequency_hz, fading_factor : (n,).  starts_s : when the factor rises above one.
    """

    t_s: Array
    amplitudes: Array
    phase_rad: Array
    frequency_hz: Array
    fading_factor: Array
    starts_s: Array


def disturbances(
    series: Series,
    column: str,
    method: str = "MSTUKF",
    *,
    frequency_hz: float,
    softening: float = 8.0,
    peak: float | None = None,
) -> Disturbances:
    """The filters of seed paper 001, as they are written, over one voltage of a record.

    Parameters
    ----------
    method : EKF, UKF, STF, STUKF, MSTUKF, or "MSTUKF, ours".
    softening : beta: residuals up to sqrt(beta R) count as noise, R = 0.001 of the squared peak.
    peak : the nominal one, in the record's unit; not given, that of the first two cycles.

    Raises InputError for an unknown method or column, a parameter that is not positive, fewer than 16 samples
    a cycle, or a record that is zero at the start or not a number somewhere.
    """
    if method not in TRACKS:
        raise InputError(f"unknown filter '{method}': {nearest(method, tuple(TRACKS))}", key="method")
    values = series.column(column)
    for key, value in (("frequency_hz", frequency_hz), ("softening", softening)):
        if not 0 < value < math.inf:
            raise InputError(f"{value!r} should be positive", key=key)
    cycle = series.sampling_hz / frequency_hz
    if cycle < 16:
        raise InputError(
            f"{cycle:.3g} samples per cycle: 16 are needed for the seventh harmonic", file=series.file
        )
    if peak is None:
        peak = float(np.abs(values[: math.ceil(2 * cycle)]).max())
    if not 0 < peak < math.inf or not np.isfinite(values).all():
        raise InputError(f"'{column}' is zero at the start, or not a number somewhere", file=series.file)
    found = track(Setting(method, softening), values / peak, series.sampling_hz, frequency_hz)
    raised = found[:, FADING] > 1.0
    rises = np.flatnonzero(raised[1:] & ~raised[:-1]) + 1
    return Disturbances(
        series.t_s,
        peak * found[:, :4],
        found[:, PHASE],
        found[:, OMEGA] / (2.0 * np.pi),
        found[:, FADING],
        series.t_s[rises],
    )
