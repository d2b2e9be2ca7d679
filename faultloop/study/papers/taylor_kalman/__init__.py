"""Seed paper 002: the ten-state Taylor Kalman synchrophasor at 200 to 400 Hz, its cases, and where it ends.

Wu Zhili, Zhao Qingsheng, Chen Huiying, Han Xiaoqing, Guo Hehong, "Research on a synchrophasor measurement
algorithm based on Kalman filtering at low sampling frequency" (Chinese), Power System Protection and Control,
2014 (15), pp. 94-99.

The paper's table 1 and its figures are missing from the text, so there is no published figure to set beside
ours but its statements: estimates "almost the same" as the truth for small deviations, not good enough at
-1 Hz and -1 Hz/s together; good within +-1 Hz, or +-2 Hz/s; an influence of the sampling rate that is small
from 200 to 400 Hz, 1e-3 in the ROCOF at 500 to 600 Hz and large above.  The limits that are checked are those
of synchrophasors, class P (1 %, 5 mHz, 0.4 Hz/s).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.estimators import FREQUENCY, ROCOF, ROW, make_estimator, run_estimator
from faultloop.relay.estimators.methods.taylor_kalman import UNKNOWNS
from faultloop.study.papers.published import Published, state
from faultloop.study.papers.taylor_kalman import figures
from faultloop.study.papers.taylor_kalman.as_written import (
    Form,
    as_they_are,
    least_squares,
    moved,
    wide,
    written_filter,
)
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.synchrophasor.signals import Array, Wave, constant

NOMINAL_HZ = 50.0
VOLTS = 220.0
PHASE = 0.5  # [rad]; the paper's is missing
PAPER_HZ = 200
WINDOW_MS = 50.0  # ten samples at 200 Hz; the paper has 40 to 60
JUDGED_S = (0.2, 0.35)  # the paper's figures end at 0.35 s
STEP_S = 0.2
STEP_RAD = np.pi / 6.0  # the paper's is missing
SAMPLING_RATES = (200, 300, 400, 500, 600, 800, 1200)
NOISE = 1e-4
LIMITS = (0.01 * VOLTS, 0.005, 0.4)
SETTLED_MS = 60.0  # "fast" is all the text says of the steps: the longest of its windows

STEADY = ((-0.2, -0.05), (-0.4, -0.25), (-0.6, -0.5), (-0.8, -0.75), (-1.0, -1.0))
COLUMNS = (">RMS [V]", ">frequency [Hz]", ">ROCOF [Hz/s]", ">phase [deg]")


def deviating(offset_hz: float, rate_hz_per_s: float) -> Wave:
    """Eq. 1: frequency f0 + x + y t."""
    x, y = offset_hz, rate_hz_per_s
    return Wave(
        constant(VOLTS),
        lambda t: PHASE + 2.0 * np.pi * x * t + np.pi * y * t**2,
        lambda t: NOMINAL_HZ + x + y * t,
        constant(y),
    )


def steady_tracks() -> dict[str, figures.Track]:
    """The five signals of figures 2 to 5 and what is found of them."""
    cases = {f"{x:g} Hz, {y:g} Hz/s": deviating(x, y) for x, y in STEADY}
    return {name: (wave, *run(wave, PAPER_HZ, JUDGED_S[1])) for name, wave in cases.items()}


def step_tracks() -> dict[str, figures.Track]:
    """The same of the steps and the ramp, over one second."""
    return {name: (wave, *run(wave, PAPER_HZ, 1.0)) for name, wave in STEPS.items()}


def stepped(volts: float, angle: float) -> Wave:
    """RMS to ``volts`` and angle by ``angle`` [rad] at 0.2 s."""
    return Wave(
        lambda t: np.where(t < STEP_S, VOLTS, volts),
        lambda t: PHASE + angle * (t >= STEP_S),
        constant(NOMINAL_HZ),
        constant(0.0),
    )


STEPS = {
    "220 to 190 V": stepped(190.0, 0.0),
    "phase by 30 deg": stepped(VOLTS, STEP_RAD),
    "ramp 0.05 Hz/s": deviating(0.0, 0.05),
}


def run(
    wave: Wave,
    sampling_hz: int,
    duration_s: float,
    noise: float = 0.0,
    window_ms: float = WINDOW_MS,
    start: str = "prior",
) -> tuple[Array, NDArray[np.complex128], Array]:
    """Times (n,), the phasor (n,) and the rows (n, 14) of one phase, alone in the six channels.

    ``noise`` is its standard deviation over the peak."""
    estimator = make_estimator("taylor-kalman", sampling_hz, NOMINAL_HZ, window_ms=window_ms, start=start)
    t = np.arange(round(duration_s * sampling_hz)) / sampling_hz
    samples = np.zeros((len(t), 6))
    samples[:, 0] = one_phase(wave, t, noise)
    rows = np.empty((len(t), ROW))
    run_estimator(estimator.step, estimator.state.copy(), samples, rows)
    return t, rows[:, 0] + 1j * rows[:, 1], rows


def one_phase(wave: Wave, t: Array, noise: float = 0.0) -> Array:
    """Samples of phase a [V], (n,)."""
    v = wave.samples(t, NOMINAL_HZ)[:, 0]
    return v + noise * np.sqrt(2.0) * VOLTS * np.random.default_rng(2).normal(size=len(t))


def worst_errors(
    wave: Wave, t: Array, phasor: NDArray[np.complex128], frequency: Array, rocof: Array
) -> tuple[float, float, float, float]:
    """Greatest errors from 0.2 to 0.35 s: RMS [V], frequency [Hz], ROCOF [Hz/s], phase [deg]."""
    k = (t >= JUDGED_S[0]) & (t <= JUDGED_S[1])
    truth = wave.phasor(t[k])
    return (
        float(np.abs(np.abs(phasor[k]) - np.abs(truth)).max()),
        float(np.abs(frequency[k] - wave.frequency(t[k])).max()),
        float(np.abs(rocof[k] - wave.rocof(t[k])).max()),
        float(np.degrees(np.abs(np.angle(phasor[k] / truth)).max())),
    )


def errors_of(wave: Wave, sampling_hz: int, noise: float = 0.0) -> tuple[float, float, float, float]:
    """`worst_errors` of the estimator."""
    t, phasor, rows = run(wave, sampling_hz, JUDGED_S[1] + 0.5 / sampling_hz, noise)
    return worst_errors(wave, t, phasor, rows[:, FREQUENCY], rows[:, ROCOF])


def steady_cases() -> tuple[Table, list[Check]]:
    """Figures 2 to 5: constant deviations and rates."""
    rows, checks = [], []
    for x, y in STEADY:
        for rate in (PAPER_HZ, 400, 4800):
            found = errors_of(deviating(x, y), rate)
            rows.append((f"{x:g} Hz, {y:g} Hz/s", rate, *found))
            if rate == PAPER_HZ:
                names = ("RMS", "frequency", "ROCOF")
                units = ("V", "Hz", "Hz/s")
                checks += [
                    Check(f"{x:g} Hz, {y:g} Hz/s at {rate} Hz: {name}", value, limit, unit)
                    for name, value, limit, unit in zip(names, found, LIMITS, units, strict=False)
                ]
    note = "The greatest error from 0.2 to 0.35 s. The window is 50 ms."
    title = "Constant deviation and rate (figures 2 to 5)"
    return Table(title, ("case", ">fs [Hz]", *COLUMNS), rows, note), checks


def written_errors(wave: Wave, sampling_hz: int, form: Form) -> tuple[float, float, float, float]:
    """`worst_errors` of the paper's filter."""
    t = np.arange(round(JUDGED_S[1] * sampling_hz) + 1) / sampling_hz
    return worst_errors(wave, t, *written_filter(one_phase(wave, t), sampling_hz, NOMINAL_HZ, form))


def over_process_noise(quick: bool) -> Table:
    """The filter as written, over its open Q, beside the one whose polynomial is moved."""
    rows = []
    for x, y in (STEADY[0], STEADY[-1]):
        wave = deviating(x, y)
        for q in (1e-4, 1.0, 1e4) if quick else 10.0 ** np.arange(-8, 11, 2):
            found = written_errors(wave, PAPER_HZ, Form(8, process_noise=float(q)))
            rows.append((f"{x:g} Hz, {y:g} Hz/s", f"as written, q = {q:g} V2", *found))
        rows.append((f"{x:g} Hz, {y:g} Hz/s", "origin moved", *errors_of(wave, PAPER_HZ)))
    note = (
        "A 40 ms window at 200 Hz is eight samples, less than the ten states: it lives on what is carried "
        "over. As written the states carried over are those of the old origin, and no Q mends that."
    )
    title = "As written, and with the origin moved, at 200 Hz"
    return Table(title, ("case", "filter", *COLUMNS), rows, note)


def windows_and_starts(quick: bool) -> Table:
    """Windows of 40 and 60 ms for both forms, with the start of section 2.2 and from nothing known."""
    rows = []
    noises = (1.0, 1e4) if quick else 10.0 ** np.arange(-6, 9, 1)
    for x, y in (STEADY[0], STEADY[-1]):
        wave = deviating(x, y)
        for rate in (PAPER_HZ, 400):
            for window_ms in (40.0, 60.0):
                window = round(1e-3 * window_ms * rate)
                memory = (window - 1.0) / (window + 1.0)
                for start, first in ((wide, 0), (least_squares, max(window, UNKNOWNS))):
                    written = [written_errors(wave, rate, Form(window, as_they_are, start, first, float(q)))
                               for q in noises]  # fmt: skip
                    best = int(np.argmin([found[1] for found in written]))
                    shifted = Form(window, moved, start, first, forgetting=memory)
                    begun = "section 2.2" if first else "wide"
                    where = (f"{x:g} Hz, {y:g} Hz/s", rate, window_ms, begun)
                    rows.append((*where, f"as written, best q = {noises[best]:g} V2", *written[best]))
                    rows.append((*where, "origin moved", *written_errors(wave, rate, shifted)))
    note = (
        "The start: least squares over the first window (ten samples at least), X0 = (H'H)^-1 H'Z and P0 = "
        "(H'H)^-1 R, or nothing known (P0 = 1e6 V2). Best q: that of the least error of the frequency. "
        "Origin moved: the polynomial about the new origin, and a memory of the window's length in place of "
        "q. From 0.2 s on the start is forgotten, and neither window nor start mends what section 2.3 "
        "carries over."
    )
    columns = ("case", ">fs [Hz]", ">window [ms]", "start", "filter", *COLUMNS)
    return Table("Windows of 40 and 60 ms, both forms, and the start of section 2.2", columns, rows, note)


def form_tracks(sampling_hz: int = 400) -> dict[str, tuple[Array, Array]]:
    """Times and errors of the frequency at -0.2 Hz and -0.05 Hz/s: windows of 40 and 60 ms, both forms, both
    starts."""
    wave = deviating(*STEADY[0])
    t = np.arange(round(JUDGED_S[1] * sampling_hz) + 1) / sampling_hz
    found = {}
    for window_ms in (40.0, 60.0):
        window = round(1e-3 * window_ms * sampling_hz)
        for title, carry, given in (
            ("as written", as_they_are, {"process_noise": 100.0}),
            ("origin moved", moved, {"forgetting": (window - 1.0) / (window + 1.0)}),
        ):
            for begun, start, first in (("wide", wide, 0), ("section 2.2", least_squares, window)):
                form = Form(window, carry, start, first, **given)
                _, frequency, _ = written_filter(one_phase(wave, t), sampling_hz, NOMINAL_HZ, form)
                error = np.abs(frequency - wave.frequency(t))
                found[f"{title}, {window_ms:g} ms, {begun}"] = (t, error)
    return found


def published(windows: Table, steady: Table, ranges: Table, sampling: Table) -> list[Published]:
    """What the text says of its figures, with the limits of class P where it says "almost the same"; the
    frequency is the quantity that suffers first."""
    at = windows.columns.index(">frequency [Hz]")
    small = [row for row in windows.rows if row[0] == steady.rows[0][0]]
    readings: dict[str, float] = {}
    for form in ("as written", "origin moved"):
        values = {
            f"{form}, {row[2]:g} ms at {row[1]} Hz, {row[3]}": float(str(row[at]))
            for row in small
            if str(row[4]).startswith(form)
        }
        best = min(values, key=lambda title: values[title])
        readings[best] = values[best]
    found = [Published("-0.2 Hz, -0.05 Hz/s: error of the frequency", LIMITS[1], readings, "Hz")]
    by_name = {row[0]: row for row in ranges.rows}
    for name in ("+-1 Hz", "+-2 Hz/s"):
        for what, column, limit, unit in (("frequency", 2, LIMITS[1], "Hz"), ("ROCOF", 3, LIMITS[2], "Hz/s")):
            own = {"origin moved, 50 ms": float(str(by_name[name][column]))}
            found.append(Published(f"{name}: error of the {what}", limit, own, unit))
    rocof = {row[0]: float(str(row[2])) for row in sampling.rows}
    for rate in (500, 600):
        own = {"origin moved, 50 ms, no noise": rocof[rate]}
        found.append(Published(f"{rate} samples/s: error of the ROCOF", 1e-3, own, "Hz/s"))
    return found


def time_within(t: Array, error: Array, limit: float) -> float:
    """From the step until the error stays within the limit [ms]."""
    beyond = np.flatnonzero((t >= STEP_S) & (error > limit))
    return 0.0 if not len(beyond) else 1000.0 * (t[beyond[-1]] - STEP_S) + 1000.0 * (t[1] - t[0])


def judge_step(wave: Wave, sampling_hz: int, noise: float) -> tuple[float, ...]:
    """Times to within 1 % and 0.1 Hz [ms], then TVE [%], FE [Hz] and RFE [Hz/s] from 0.5 to 1 s."""
    t, phasor, rows = run(wave, sampling_hz, 1.0, noise)
    truth = wave.phasor(t)
    vector = np.abs(phasor - truth) / np.abs(truth)
    fe = np.abs(rows[:, FREQUENCY] - wave.frequency(t))
    rfe = np.abs(rows[:, ROCOF] - wave.rocof(t))
    late = t >= 0.5
    last = (100.0 * vector[late].max(), fe[late].max(), rfe[late].max())
    return (time_within(t, vector, 0.01), time_within(t, fe, 0.1), *(float(v) for v in last))


def step_cases() -> tuple[Table, list[Check]]:
    """Figures 6 to 9: a fall of the voltage, a jump of the phase, and a slow ramp, over one second."""
    rows, checks = [], []
    for name, wave in STEPS.items():
        for rate in (PAPER_HZ, 400, 4800):
            for noise in (0.0, 0.001):
                rows.append((name, rate, 100.0 * noise, *judge_step(wave, rate, noise)))
        after = judge_step(wave, PAPER_HZ, 0.0)[0]
        checks.append(Check(f"{name} at {PAPER_HZ} Hz: within 1 % after", after, SETTLED_MS, "ms"))
    settled = (">within 1 % [ms]", ">within 0.1 Hz [ms]")
    columns = ("case", ">fs [Hz]", ">noise [%]", *settled, ">TVE [%]", ">FE [Hz]", ">RFE [Hz/s]")
    note = "TVE, FE and RFE: from 0.5 to 1 s. Noise is its standard deviation over the peak."
    title = "Steps at 0.2 s and a ramp (figures 6 to 9)"
    return Table(title, columns, rows, note), checks


def starts_of_a_step() -> Table:
    """How the estimator's two starts arrive after a disturbance."""
    rows = []
    for name, wave in STEPS.items():
        for start in ("prior", "least-squares"):
            for window_ms in (40.0, 60.0):
                t, phasor, found = run(wave, 400, 1.0, window_ms=window_ms, start=start)
                truth = wave.phasor(t)
                error = np.abs(phasor - truth) / np.abs(truth)
                late = np.abs(found[:, FREQUENCY] - wave.frequency(t))[t >= 0.5].max()
                rows.append((name, start, window_ms, time_within(t, error, 0.01), 1e3 * float(late)))
    columns = ("case", "start", ">window [ms]", ">within 1 % [ms]", ">FE from 0.5 s on [mHz]")
    note = (
        "The relay's estimator at 400 Hz, no noise. Least squares (section 2.2) waits for its window to fill."
    )
    return Table("The estimator's two starts", columns, rows, note)


def range_table() -> Table:
    """How far it holds, and how it degrades."""
    rows = []
    offsets = [(x, 0.0) for x in (0.5, 1.0, 2.0, 3.0, 5.0)]
    rates = [(0.0, y) for y in (1.0, 2.0, 5.0, 10.0)]
    for x, y in offsets + rates:
        found = np.max([errors_of(deviating(s * x, s * y), PAPER_HZ) for s in (1.0, -1.0)], axis=0)
        name = f"+-{x:g} Hz" if x else f"+-{y:g} Hz/s"
        rows.append((name, *(float(v) for v in found)))
    note = (
        "The remainder of the polynomial of degree four grows with up to the fifth power of the angle that "
        "the phasor turns in the window. A rate y has moved the frequency by 0.35 y when the case ends."
    )
    return Table("The range, at 200 Hz", ("deviation", *COLUMNS), rows, note)


def sampling_table() -> tuple[Table, Any]:
    """The paper's remark on the sampling rate: -0.2 Hz and -0.05 Hz/s, with and without noise."""
    wave = deviating(*STEADY[0])
    rows = []
    for rate in SAMPLING_RATES:
        clean, noisy, fixed = errors_of(wave, rate), errors_of(wave, rate, NOISE), fixed_samples(wave, rate)
        rows.append((rate, *clean[1:3], *noisy[1:3], *fixed[1:3]))
    names = ("no noise", "noise", "noise, 10 samples")
    columns = [f">{name}: {of}" for name in names for of in ("f [Hz]", "ROCOF [Hz/s]")]
    note = (
        "Noise: 0.01 % of the peak. Ours remembers 50 ms at any rate. Last two columns: ten samples at any "
        "rate, as with a noise of eq. 8 that is not scaled with the rate. This has the trend that the paper "
        "reports: the ROCOF suffers first, from 400 to 500 Hz on, and far above nothing is left. That it is "
        "the paper's reason is a guess: it does not say how Q was set."
    )
    table = Table("Sampling rate, -0.2 Hz and -0.05 Hz/s", (">fs [Hz]", *columns), rows, note)
    lines = {name: [row[2 * k + 2] for row in rows] for k, name in enumerate(names)}
    return table, figures.over_rate(SAMPLING_RATES, lines)


def fixed_samples(wave: Wave, sampling_hz: int) -> tuple[float, float, float, float]:
    """`worst_errors` with a memory of as many samples as at 200 Hz, under noise."""
    window_ms = 1000.0 * 10 / sampling_hz
    t, phasor, rows = run(wave, sampling_hz, JUDGED_S[1] + 0.5 / sampling_hz, NOISE, window_ms)
    return worst_errors(wave, t, phasor, rows[:, FREQUENCY], rows[:, ROCOF])


def report(quick: bool) -> Report:
    """The paper's cases; ``quick`` tries fewer Q of the filter as written."""
    done = Report("taylor-kalman", "Seed paper 002: ten-state Taylor Kalman synchrophasor")
    done.text = [
        "The formulas 1 to 15 and table 1 are missing from the paper's text; the estimator's docstring "
        "derives the formulas. Limits are those of synchrophasors of class P.",
        "As written, the filter cannot give the estimates that the paper reports: each window begins with "
        "the states of the last one's origin. With the polynomial moved to the new origin, which eq. 8 "
        "needs and the text does not say, it does. The paper's own limits are words; those of class P stand "
        "for them.",
    ]
    steady, steady_checks = steady_cases()
    steps, step_checks = step_cases()
    ranges = range_table()
    windows = windows_and_starts(quick)
    sampling, sampling_figure = sampling_table()
    done.tables = [
        steady,
        over_process_noise(quick),
        windows,
        starts_of_a_step(),
        steps,
        ranges,
        sampling,
    ]
    done.checks = [*steady_checks, *step_checks]
    state(done, published(windows, steady, ranges, sampling))
    steady_found, step_found = steady_tracks(), step_tracks()
    done.figures = [
        (f"Figures 2 to 5: constant deviation and rate at {PAPER_HZ} Hz", figures.four(steady_found)),
        ("The same: errors", figures.errors(steady_found)),
        (f"Figures 6 to 9: steps and ramp at {PAPER_HZ} Hz", figures.four(step_found)),
        ("The same: errors", figures.errors(step_found)),
        (
            "-0.2 Hz and -0.05 Hz/s at 400 Hz: both forms, windows and starts",
            figures.both_forms(form_tracks()),
        ),
        ("ROCOF and the sampling rate", sampling_figure),
    ]
    return done
