"""An estimator under test: its rows beside the truth, and the errors that the standard defines.

Every sample's row is judged, not only those that would be reported: the worst that any phase of the reports
could show, and for steps the standard's equivalent-time sampling.  A row is time-stamped
`Estimator.delay_samples` before the sample that ended it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.estimators import FREQUENCY, ROCOF, ROW, Estimator, make_estimator, run_estimator
from faultloop.relay.loops import MEASURE_CONSTANTS, MEASURE_STATE, measure
from faultloop.study.suites.synchrophasor.signals import TURNS, Array, Wave

SAMPLING_HZ = 4800
SNAPSHOTS = 16  # per cycle, at which a relay evaluates the frequency that its estimator does not give


@dataclass(frozen=True)
class Subject:
    """An estimator under test; ``own_frequency``: it reports frequency, else a relay's is taken."""

    name: str
    estimator: Estimator
    frequency_hz: float
    own_frequency: bool

    @property
    def settle_s(self) -> float:
        """From the start until the rows count [s]: four times what a sinusoid takes to 0.1 %."""
        filters = self.estimator.settling_samples / SAMPLING_HZ
        return filters + 0.02 if self.estimator.delay_samples else 4.0 * filters + 0.05

    @property
    def delay_s(self) -> float:
        """From the time stamp to the row [s]."""
        return self.estimator.delay_samples / SAMPLING_HZ

    def rows(self, samples: Array) -> Array:
        """Phasor rows, the relay's frequency in them where the estimator has none, (n, 14)."""
        rows = np.empty((len(samples), ROW))
        run_estimator(self.estimator.step, self.estimator.state.copy(), samples, rows)
        if not self.own_frequency:
            measure(*self._relay(), rows, np.empty((len(rows), 12)))
        return rows

    def _relay(self) -> tuple[NDArray[np.void], NDArray[np.void]]:
        constants = np.zeros(1, MEASURE_CONSTANTS)
        snapshot = round(SAMPLING_HZ / self.frequency_hz / SNAPSHOTS)
        constants["frequency"] = self.frequency_hz
        constants["minimum_voltage"] = 1e-3
        constants["interval"] = snapshot / SAMPLING_HZ
        constants["snapshot"] = snapshot
        constants["snapshots"] = SNAPSHOTS
        constants["settling"] = self.estimator.settling_samples
        return constants, np.zeros(1, MEASURE_STATE)


def subject(method: str, frequency_hz: float) -> Subject:
    """The estimator of a method at its defaults, tried on a second of a sinusoid for a frequency."""
    estimator = make_estimator(method, SAMPLING_HZ, frequency_hz)
    trial = Subject(method, estimator, frequency_hz, True)
    t = np.arange(SAMPLING_HZ // 5) / SAMPLING_HZ
    wave = np.sqrt(2.0) * np.real(np.exp(2j * np.pi * frequency_hz * t)[:, None] * TURNS)
    own = bool(np.isfinite(trial.rows(np.ascontiguousarray(wave))[-1, FREQUENCY]))
    return Subject(method, estimator, frequency_hz, own)


@dataclass(frozen=True)
class Errors:
    """Of one test signal, at the times ``t`` [s], (n,): ``tve`` [%] the worst of six channels and the
    positive sequence, ``fe`` [Hz], ``rfe`` [Hz/s], and the positive sequence itself."""

    t: Array
    tve: Array
    fe: Array
    rfe: Array
    phasor: NDArray[np.complex128]


def errors(subject: Subject, wave: Wave, duration_s: float) -> Errors:
    """Run a subject over a signal of that length; its rows from settling to the end, time-stamped."""
    count = round(duration_s * SAMPLING_HZ)
    samples = wave.samples(np.arange(count) / SAMPLING_HZ, subject.frequency_hz)
    rows = subject.rows(samples)
    delay = subject.estimator.delay_samples
    first = round(subject.settle_s * SAMPLING_HZ)
    rows = rows[first:]
    t = np.arange(first - delay, count - delay) / SAMPLING_HZ
    truth = wave.phasor(t)
    found = rows[:, :12].copy().view(np.complex128) / TURNS
    sequence = found[:, :3].mean(axis=1)
    worst = np.maximum(np.abs(found - truth[:, None]).max(axis=1), np.abs(sequence - truth))
    return Errors(
        t,
        100.0 * worst / np.abs(truth),
        np.abs(rows[:, FREQUENCY] - wave.frequency(t)),
        np.abs(rows[:, ROCOF] - wave.rocof(t)),
        sequence,
    )


@dataclass(frozen=True)
class StepResponse:
    """Response times [s] of TVE, frequency and ROCOF, delay [s] and overshoot [% of the step]."""

    tve_s: float
    fe_s: float
    rfe_s: float
    delay_s: float
    overshoot: float


def step_response(
    found: Errors, at_s: float, progress: Array, limits: tuple[float, float, float]
) -> StepResponse:
    """Judge a step.

    Parameters
    ----------
    found : of a step signal.
    progress : (n,) the stepped quantity, 0 before and 1 after.
    limits : of TVE [%], FE [Hz] and RFE [Hz/s]: a response lasts from the first row beyond to the last.
    """
    tve_s, fe_s, rfe_s = (
        outside(error > limit) for error, limit in zip((found.tve, found.fe, found.rfe), limits, strict=True)
    )
    after = int(np.argmax(progress >= 0.5))
    slope = progress[after] - progress[after - 1]
    crossing = found.t[after] - (progress[after] - 0.5) / slope / SAMPLING_HZ
    beyond = max(progress.max() - 1.0, -progress.min(), 0.0)
    return StepResponse(tve_s, fe_s, rfe_s, abs(crossing - at_s), 100.0 * beyond)


def outside(beyond: NDArray[np.bool_]) -> float:
    """Time from the first to the last True, both counted [s]; infinite if the last row is True."""
    where = np.flatnonzero(beyond)
    if not len(where):
        return 0.0
    if where[-1] == len(beyond) - 1:
        return float("inf")
    return float(where[-1] - where[0] + 1) / SAMPLING_HZ
