"""The rows of IEC/IEEE 60255-118-1:2018 for reports at the nominal frequency (50 or 60 per second).

Each test yields `Outcome`s: a figure beside its limit.  Limits by row are TVE [%], FE [Hz], RFE [Hz/s]; NaN
where the standard sets none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from faultloop.study.suites.synchrophasor.measure import SAMPLING_HZ, Errors, Subject, errors, step_response
from faultloop.study.suites.synchrophasor.signals import Tone, Wave, modulated, ramp, steady, step

NONE = math.nan
Triple = tuple[float, float, float]

WATCHED_S = 0.5  # of a steady signal, after settling
RAMP_RATE = 1.0  # Hz/s
STEP_PHASES = 4  # points on the wave, over a sixth of a cycle: the balanced set repeats itself after it


@dataclass(frozen=True)
class PerformanceClass:
    """What a class asks for at the reporting rate Fs = f0.

    Attributes
    ----------
    span_hz : frequency range about f0, and of the ramp.
    magnitudes : of nominal.
    harmonic : part of the fundamental.
    excluded_reports : at each end of the ramp.
    interference : limits of the out-of-band row, or None: the class has none.
    modulation_hz : greatest modulating frequency.
    step_limits : errors within which a response has ended.
    response : the times allowed for it, in periods of f0 (of Fs, the same here).
    overshoot : [% of the step].
    latency_reports : reports from the time stamp to the report, noted beside the figure only.
    """

    name: str
    span_hz: float
    magnitudes: tuple[float, ...]
    harmonic: float
    excluded_reports: int
    modulation_hz: float
    frequency: Triple
    harmonics: Triple
    interference: Triple | None
    modulation: Triple
    ramp: Triple
    step_limits: Triple
    response: Triple
    overshoot: float
    latency_reports: int


P = PerformanceClass(
    name="P",
    span_hz=2.0,
    magnitudes=(0.8, 0.9, 1.0, 1.1, 1.2),
    harmonic=0.01,
    excluded_reports=2,
    modulation_hz=2.0,
    frequency=(1.0, 0.005, 0.4),
    harmonics=(1.0, 0.005, 0.4),
    interference=None,
    modulation=(3.0, 0.06, 2.3),
    ramp=(1.0, 0.01, 0.4),
    step_limits=(1.0, 0.005, 0.4),
    response=(2.0, 4.5, 6.0),
    overshoot=5.0,
    latency_reports=2,
)
M = PerformanceClass(
    name="M",
    span_hz=5.0,
    magnitudes=(0.1, 0.3, 0.6, 0.9, 1.2),
    harmonic=0.1,
    excluded_reports=7,
    modulation_hz=5.0,
    frequency=(1.0, 0.005, 0.1),
    harmonics=(1.0, 0.025, NONE),
    interference=(1.3, 0.01, NONE),
    modulation=(3.0, 0.3, 14.0),
    ramp=(1.0, 0.01, 0.2),
    step_limits=(1.0, 0.005, 0.1),
    response=(7.0, 14.0, 14.0),
    overshoot=10.0,
    latency_reports=7,
)
CLASSES = {"p": P, "m": M}


@dataclass(frozen=True)
class Outcome:
    """A figure of a row, the worst of its cases."""

    row: str
    quantity: str
    value: float
    limit: float
    unit: str


QUANTITIES = (("TVE", "%"), ("FE", "Hz"), ("RFE", "Hz/s"))


def judge(row: str, found: Iterator[Errors], limits: Triple) -> list[Outcome]:
    """The worst errors over a row's cases against its limits; NaN in any is NaN."""
    worst = np.zeros(3)
    for case in found:
        worst = np.maximum(worst, [case.tve.max(), case.fe.max(), case.rfe.max()])
    return [
        Outcome(row, quantity, float(value), limit, unit)
        for (quantity, unit), value, limit in zip(QUANTITIES, worst, limits, strict=True)
        if not math.isnan(limit)
    ]


def watch(subject: Subject, waves: Iterator[Wave]) -> Iterator[Errors]:
    """Steady signals, each for half a second after settling."""
    for wave in waves:
        yield errors(subject, wave, subject.settle_s + WATCHED_S)


def grid(first: float, last: float, count: int, quick: bool) -> np.ndarray:
    """``count`` values from the first to the last; its ends and its middle where quick."""
    return np.linspace(first, last, 3 if quick else count)


def frequency_range(subject: Subject, kind: PerformanceClass, quick: bool) -> list[Outcome]:
    """f0 +- 2 Hz (P) or +- 5 Hz (M)."""
    f0 = subject.frequency_hz
    offsets = grid(-kind.span_hz, kind.span_hz, 21, quick)
    waves = (steady(f0, float(offset)) for offset in offsets)
    return judge(
        f"frequency {-kind.span_hz:+g} to {kind.span_hz:+g} Hz", watch(subject, waves), kind.frequency
    )


def magnitude_range(subject: Subject, kind: PerformanceClass, quick: bool) -> list[Outcome]:
    """80 (M: 10) to 120 % of nominal."""
    f0 = subject.frequency_hz
    sizes = kind.magnitudes[:: 4 if quick else 1]
    waves = (steady(f0, magnitude=size) for size in sizes)
    row = f"magnitude {100 * sizes[0]:g} to {100 * sizes[-1]:g} %"
    return judge(row, watch(subject, waves), (1.0, NONE, NONE))


def harmonics(subject: Subject, kind: PerformanceClass, quick: bool) -> list[Outcome]:
    """One harmonic at a time, 2nd to 50th, of the phase sequence that its order gives it.  There is no
    anti-aliasing filter before the samples, so orders above fs / (2 f0) fold back."""
    f0 = subject.frequency_hz
    orders = (2, 3, 4, 5, 7, 25, 50) if quick else range(2, 51)
    waves = (steady(f0, tone=Tone(order * f0, kind.harmonic, order, 0.3)) for order in orders)
    return judge(f"harmonics {100 * kind.harmonic:g} %, 2 to 50", watch(subject, waves), kind.harmonics)


def interfering_frequencies(f0: float, quick: bool) -> list[float]:
    """10 Hz to f0 - Fs / 2 and f0 + Fs / 2 to 2 f0, Fs = f0."""
    below = np.arange(10.0, 0.5 * f0 + 0.5, 5.0 if quick else 1.0)
    above = np.arange(1.5 * f0, 2.0 * f0 + 0.5, 10.0 if quick else 1.0)
    return [*below.tolist(), *above.tolist()]


def out_of_band(subject: Subject, kind: PerformanceClass, quick: bool) -> list[Outcome]:
    """A positive-sequence tone of 10 % outside f0 +- Fs / 2, at f0 and f0 +- Fs / 20."""
    if kind.interference is None:
        return []
    f0 = subject.frequency_hz
    waves = (
        steady(f0, offset, tone=Tone(hz, 0.1, 1, 0.3))
        for offset in (0.0, -0.05 * f0, 0.05 * f0)
        for hz in interfering_frequencies(f0, quick)
    )
    return judge("out of band 10 %", watch(subject, waves), kind.interference)


def modulation(subject: Subject, kind: PerformanceClass, quick: bool) -> list[Outcome]:
    """Magnitude by 10 %, then angle by 0.1 rad, up to 2 Hz (P) or 5 Hz (M); at least a period of each."""
    f0 = subject.frequency_hz
    rates = [float(rate) for rate in grid(0.2 * kind.modulation_hz, kind.modulation_hz, 9, quick)]

    def found(magnitude: float, angle: float) -> Iterator[Errors]:
        for rate in rates:
            wave = modulated(f0, rate, magnitude=magnitude, angle=angle)
            yield errors(subject, wave, subject.settle_s + max(WATCHED_S, 1.0 / rate))

    upto = f"to {kind.modulation_hz:g} Hz"
    return [
        *judge(f"magnitude modulation {upto}", found(0.1, 0.0), kind.modulation),
        *judge(f"angle modulation {upto}", found(0.0, 0.1), kind.modulation),
    ]


def ramps(subject: Subject, kind: PerformanceClass, quick: bool) -> list[Outcome]:
    """+1 and -1 Hz/s over the frequency range; the reports at its ends left out."""
    start = subject.settle_s + 0.1
    length = 2.0 * kind.span_hz / RAMP_RATE
    excluded = kind.excluded_reports / subject.frequency_hz

    def found() -> Iterator[Errors]:
        for rate in (RAMP_RATE,) if quick else (RAMP_RATE, -RAMP_RATE):
            wave = ramp(subject.frequency_hz, kind.span_hz, rate, start)
            every = errors(subject, wave, start + length + subject.delay_s)
            inside = (every.t > start + excluded) & (every.t < start + length - excluded)
            yield Errors(*(part[inside] for part in vars(every).values()))

    return judge(f"ramp 1 Hz/s over {2 * kind.span_hz:g} Hz", found(), kind.ramp)


def steps(subject: Subject, kind: PerformanceClass, quick: bool) -> list[Outcome]:
    """+-10 % of magnitude and +-10 degrees, at several points on the wave."""
    outcomes = []
    for name, size in (("magnitude", 0.1), ("angle", math.radians(10.0))):
        worst = np.zeros(5)
        for signed in (size,) if quick else (size, -size):
            for place in range(1 if quick else STEP_PHASES):
                phase = math.pi / 3.0 * place / STEP_PHASES
                worst = np.maximum(worst, _one_step(subject, kind, name, signed, phase))
        row = f"{name} step " + ("10 %" if name == "magnitude" else "10 deg")
        period = 1000.0 / subject.frequency_hz
        limits = [*(cycles * period for cycles in kind.response), 0.25 * period, kind.overshoot]
        names = ("TVE response", "FE response", "RFE response", "delay", "overshoot")
        for quantity, value, limit in zip(names, worst, limits, strict=True):
            unit = "%" if quantity == "overshoot" else "ms"
            outcomes.append(Outcome(row, quantity, float(value), limit, unit))
    return outcomes


def _one_step(subject: Subject, kind: PerformanceClass, name: str, size: float, phase: float) -> list[float]:
    at = subject.settle_s + 0.3 + 0.5 / SAMPLING_HZ  # between two samples
    wave = step(subject.frequency_hz, at, phase=phase, **{name: size})
    found = errors(subject, wave, at + 0.8)
    stepped = (
        np.abs(found.phasor) - 1.0 if name == "magnitude" else np.angle(found.phasor * np.exp(-1j * phase))
    )
    response = step_response(found, at, stepped / size, kind.step_limits)
    times = (response.tve_s, response.fe_s, response.rfe_s, response.delay_s)
    return [*(1000.0 * time for time in times), response.overshoot]


Test = Callable[[Subject, PerformanceClass, bool], list[Outcome]]
TESTS: tuple[Test, ...] = (
    frequency_range,
    magnitude_range,
    harmonics,
    out_of_band,
    modulation,
    ramps,
    steps,
)


def class_tests(subject: Subject, kind: PerformanceClass, quick: bool) -> list[Outcome]:
    """Every row of a class."""
    return [outcome for test in TESTS for outcome in test(subject, kind, quick)]
