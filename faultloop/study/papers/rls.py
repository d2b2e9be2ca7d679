"""Recursive least squares (seed paper 004): what the paper proves, put to the test.

Li Liezhong, Zhou Chao (Chengdu University of Science and Technology), "The application of recursive least
squares in microprocessor protection" (Chinese; received in December 1992, printed in 1993; its text does not
name the journal).

The recursion here is the paper's own, eq. 2 to 4 with h(i) = [exp(-i Ts / Td), cos j w i Ts, sin j w i Ts]
and P0 = alpha^2 I; beside it the package's ``rls``, which carries the square root of P.

Three places of the printed text are corrected.  Eq. 2 has lost its P(k): the bracket is h P h' + 1, and the
factors around it are P h' and h P.  Eq. 5 has lost its i in cos(j w i Ts).  In 5.1 the expectation of X(k) is
X, not 0.

One claim does not hold: X(k) does not converge to X as a whole (5.2).  The offset's column exp(-i Ts / Td)
has a finite sum of squares, so that later samples say nothing of x0 and its variance stays at

    sigma^2 (1 - q) / q,   q = exp(-2 Ts / Td)

(the columns being orthogonal to each other by then).  The harmonics are consistent, as 1 / sqrt(N).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.estimators import ROW, make_estimator, run_estimator
from faultloop.study.papers.published import Published, state
from faultloop.study.report import Check, Report, Table

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

F0 = 50.0
TD_S = 0.03
ALPHAS = (1e5, 1e6, 1e7, 1e8, 1e9, 1e10)
WIDE = 1e16
EXACT = 1e-6
NOISE = 0.05
PER_CYCLE = 24
TRUTH = np.array([0.9, 0.6, -0.8])  # x0, xR1, xI1: a fundamental of 1


class Deviation(NamedTuple):
    """Of the recursive from the batch estimate, over the batch fundamental.

    first : at sample 2 n + 1; cycle : at one cycle; later : the greatest from one cycle on.
    """

    first: float
    cycle: float
    later: float


def model(count: int, per_cycle: int, harmonics: int = 1, td_s: float = TD_S) -> Array:
    """H of eq. 1, rows i = 1 .. count, (count, 2 n + 1)."""
    i = np.arange(1, count + 1)
    columns = [np.exp(-i / (td_s * F0 * per_cycle))]
    for j in range(1, harmonics + 1):
        angle = 2.0 * np.pi * j * i / per_cycle
        columns += [np.cos(angle), np.sin(angle)]
    return np.column_stack(columns)


def gains(rows: Array, alpha_squared: float, forgetting: float = 1.0, decay: float = 1.0) -> Array:
    """K(1) .. K(N) from eq. 2 and 4, (N, 2 n + 1): no sample is in them.

    ``decay`` of the first unknown per sample: 1 in the paper, whose unknown is the offset's initial value.
    """
    p = alpha_squared * np.eye(rows.shape[1])
    transition = np.ones(rows.shape[1])
    transition[0] = decay
    found = np.empty_like(rows)
    for k, h in enumerate(rows):
        p = p * np.outer(transition, transition)
        ph = p @ h
        total = forgetting + h @ ph
        found[k] = ph / total
        # The outer product before the division: P stays symmetric to the bit.  An antisymmetric rounding
        # error never contracts, and grows as 1 / forgetting per sample.
        p = (p - np.outer(ph, ph) / total) / forgetting
    return found


def estimates(rows: Array, z: Array, gain: Array, decay: float = 1.0) -> Array:
    """Eq. 3 with gains that are known: z (N, runs) -> X (N, 2 n + 1, runs)."""
    x = np.zeros((rows.shape[1], z.shape[1]))
    found = np.empty((len(rows), *x.shape))
    for k, (h, g) in enumerate(zip(rows, gain, strict=True)):
        x[0] *= decay
        x = x + np.outer(g, z[k] - h @ x)
        found[k] = x
    return found


def on_line(rows: Array, z: Array, alpha_squared: float) -> Array:
    """Eq. 2 to 4 sample by sample, for one run: z (N,) -> X (N, 2 n + 1)."""
    x, p = np.zeros(rows.shape[1]), alpha_squared * np.eye(rows.shape[1])
    found = np.empty_like(rows)
    for k, h in enumerate(rows):
        ph = p @ h
        total = 1.0 + h @ ph
        x = x + ph / total * (z[k] - h @ x)
        p = p - np.outer(ph, ph) / total
        found[k] = x
    return found


def weighted_deviation(rows: Array, forgetting: float) -> Array:
    """Standard deviations of weighted least squares over all rows, in closed form, (2 n + 1,).

    With W = diag(l^(N-k)): covariance sigma^2 (H'WH)^-1 H'W^2H (H'WH)^-1.
    """
    weight = forgetting ** np.arange(len(rows) - 1, -1, -1)
    inverse = np.linalg.inv(rows.T @ (weight[:, None] * rows))
    return NOISE * np.sqrt(np.diag(inverse @ (rows.T @ (weight[:, None] ** 2 * rows)) @ inverse))


def samples(rows: Array, runs: int, seed: int, noise: float = NOISE) -> Array:
    """z = H X + e, (N, runs); harmonics above the first are a tenth."""
    truth = np.concatenate([TRUTH, np.full(rows.shape[1] - 3, 0.1)])
    e = np.random.default_rng(seed).normal(scale=noise, size=(len(rows), runs))
    return (rows @ truth)[:, None] + e


def batch(rows: Array, z: Array) -> Complex:
    """Eq. 1 for every N from 2 n + 1 on, the fundamental as a complex number; NaN before."""
    found = np.full(len(rows), np.nan, np.complex128)
    for n in range(rows.shape[1], len(rows) + 1):
        x = np.linalg.lstsq(rows[:n], z[:n], rcond=None)[0]
        found[n - 1] = x[1] + 1j * x[2]
    return found


def deviation(found: Complex, wanted: Complex, first: int, cycle: int) -> Deviation:
    """``first`` = 2 n + 1 samples, ``cycle`` samples."""
    relative = np.abs(found - wanted) / np.abs(wanted)
    return Deviation(
        float(relative[first - 1]), float(relative[cycle - 1]), float(relative[cycle - 1 :].max())
    )


def deviations(
    per_cycle: int, harmonics: int, alpha_squared: float, count: int
) -> tuple[Deviation, Deviation]:
    """Of the paper's recursion and of the package's square root from the batch estimate."""
    rows = model(count, per_cycle, harmonics)
    z = samples(rows, 1, seed=7)[:, 0]
    wanted = batch(rows, z)
    x = estimates(rows, z[:, None], gains(rows, alpha_squared))[:, :, 0]
    paper = deviation(x[:, 1] + 1j * x[:, 2], wanted, rows.shape[1], per_cycle)
    return paper, deviation(
        square_root(z, per_cycle, harmonics, alpha_squared), wanted, rows.shape[1], per_cycle
    )


def square_root(z: Array, per_cycle: int, harmonics: int, alpha_squared: float) -> Complex:
    """The package's ``rls`` on the same samples, in the paper's coordinates (xR + j xI at i = 0)."""
    estimator = make_estimator(
        "rls",
        round(F0 * per_cycle),
        F0,
        harmonics=harmonics,
        time_constant_ms=1e3 * TD_S,
        initial_covariance=alpha_squared,
        forgetting_factor=1.0,
        detection_threshold=3e4,  # only the first sample is a disturbance
    )
    channels = np.ascontiguousarray(np.repeat(z[:, None], 6, axis=1))
    out = np.empty((len(z), ROW))
    run_estimator(estimator.step, estimator.state.copy(), channels, out)
    # Peak, from sample 0 to i = 1 as the origin of the angle; cos and -sin there, cos and sin here.
    turned = np.sqrt(2.0) * (out[:, 0] + 1j * out[:, 1]) * np.exp(-2j * np.pi / per_cycle)
    return np.conj(turned)


def report(quick: bool) -> Report:
    """All that the paper claims, in tables and checks."""
    result = Report("rls", "Recursive least squares (seed 004)")
    result.text = [
        "Li and Zhou 1993. A fundamental of 1 and an offset of 0.9 with Td = 30 ms, white noise of 0.05.",
        "Printed text corrected in three places: eq. 2 lacks P(k) in its bracket, eq. 5 lacks i in the "
        "cosine, and the expectation of X(k) in 5.1 is X, not 0.",
    ]
    if quick:
        result.text.append("Quick: fewer runs, fewer sampling rates.")
    _start(result, quick)
    _off_line(result)
    _asymptotics(result, 400 if quick else 4000)
    _forgetting(result, 400 if quick else 4000)
    return result


def _start(result: Report, quick: bool) -> None:
    """P0 = alpha^2 I against the batch estimate from 2 n + 1 on."""
    rows = []
    for per_cycle, harmonics in ((12, 1), (24, 1), *(() if quick else ((24, 3), (96, 1)))):
        for alpha_squared in (*ALPHAS, WIDE):
            paper, root = deviations(per_cycle, harmonics, alpha_squared, 4 * per_cycle)
            rows.append((per_cycle, harmonics, f"{alpha_squared:.0e}", *paper, *root))
    columns = (">samples per cycle", ">n", ">alpha^2", ">eq. 2: at 2n+1", ">at a cycle", ">worst later",
               ">square root: at 2n+1", ">at a cycle", ">worst later")  # fmt: skip
    note = (
        "The first 2n+1 samples are nearly collinear: P is large there, and what P0 holds back is P / "
        "alpha^2. With an alpha^2 that makes it small, eq. 2 in double precision loses as many digits as "
        "alpha^2 has."
    )
    result.tables.append(Table("Recursive against batch: relative deviation", columns, rows, note))
    root = [row for row in rows if row[2] == f"{WIDE:.0e}"]
    worst = max(max(row[6:9]) for row in root)
    result.checks.append(Check("square root, alpha^2 = 1e16: from batch, from 2n+1 on", worst, EXACT))
    paper = [row for row in rows if row[2] != f"{WIDE:.0e}"]
    state(result, [_equal_to_batch(rows, *case) for case in dict.fromkeys(row[:2] for row in rows)])
    first, later = (sum(row[k] <= EXACT for row in paper) for k in (3, 5))
    result.text.append(
        f"Of alpha^2 = 1e5 .. 1e10 with eq. 2, {first} of {len(paper)} cases are within 1e-6 of the batch "
        f"estimate at sample 2n+1, and {later} from one cycle on."
    )


def _equal_to_batch(rows: Sequence[Sequence[Any]], per_cycle: int, harmonics: int) -> Published:
    """Section 4: X* and P* are the batch's at sample 2 n + 1; "equal" is taken for 1e-6."""
    own = [row for row in rows if row[:2] == (per_cycle, harmonics)]
    wide = f"{WIDE:.0e}"
    what = f"{per_cycle} samples a cycle, n = {harmonics}: from the batch at 2n + 1, relative"
    readings = {f"alpha^2 = {row[2]}": float(row[3]) for row in own if row[2] != wide}
    root = next(float(row[6]) for row in own if row[2] == wide)
    return Published(what, EXACT, readings, ours=root)


def _off_line(result: Report) -> None:
    rows = model(10 * PER_CYCLE, PER_CYCLE)
    z = samples(rows, 1, seed=3)
    difference = np.abs(estimates(rows, z, gains(rows, 1e5))[:, :, 0] - on_line(rows, z[:, 0], 1e5)).max()
    result.checks.append(
        Check("gain computed off-line against on-line: largest difference", float(difference), 1e-12)
    )


def _asymptotics(result: Report, runs: int) -> None:
    """Unbiased, and consistent as 1 / sqrt(N) but for x0."""
    lengths = np.array([1, 2, 4, 8, 16, 32]) * PER_CYCLE
    rows = model(int(lengths[-1]), PER_CYCLE)
    found = estimates(rows, samples(rows, runs, seed=11), gains(rows, 1e8))[lengths - 1] - TRUTH[:, None]
    bias, spread = found.mean(axis=2), found.std(axis=2, ddof=1)
    scores = np.abs(bias) / (spread / np.sqrt(runs))
    theory = np.array([np.sqrt(np.diag(np.linalg.inv(rows[:n].T @ rows[:n]))) * NOISE for n in lengths])
    table = [(int(n), *b, *s, *t) for n, b, s, t in zip(lengths, bias, spread, theory, strict=True)]
    columns = (
        ">N",
        ">bias x0",
        ">xR1",
        ">xI1",
        ">deviation x0",
        ">xR1",
        ">xI1",
        ">theory x0",
        ">xR1",
        ">xI1",
    )
    result.tables.append(Table(f"Bias and standard deviation over {runs} runs", columns, table))
    slopes = np.polyfit(np.log(lengths[1:]), np.log(spread[1:]), 1)[0]
    q = np.exp(-2.0 / (TD_S * F0 * PER_CYCLE))
    limit = NOISE * np.sqrt((1.0 - q) / q)
    result.text.append(
        f"Consistency: the harmonics' deviation falls as N^{slopes[1]:.3f} and N^{slopes[2]:.3f}. That of "
        f"x0 does not fall: {spread[-1, 0]:.4f} at N = {lengths[-1]}, with the limit {limit:.4f}; its "
        "column has a finite sum of squares, so the lemma of 5.2 does not apply to it."
    )
    because = "the closed form of its variance: later samples say nothing of x0"
    run = {f"{runs} runs": float(scores.max())}
    slope = {f"{runs} runs": float(np.abs(slopes[1:] + 0.5).max())}
    x0 = {f"{runs} runs": float(spread[-1, 0])}
    state(
        result,
        [
            Published("5.1, unbiased: bias over its standard error, worst of 18", 4.0, run),
            Published("5.2, consistent, harmonics: exponent of N from -1/2", 0.05, slope),
            Published("5.2, consistent, x0: deviation", 0.0, x0, bound=float(limit), because=because),
        ],
    )
    result.checks.append(
        Check("deviation of x0 against its limit, relative", float(abs(spread[-1, 0] / limit - 1.0)), 0.1)
    )
    result.figures.append(("Standard deviation over the samples", _spread_figure(lengths, spread, theory)))


def _forgetting(result: Report, runs: int) -> None:
    """What a forgetting factor does: variance where the model is true, less bias where it is not."""
    count = 10 * PER_CYCLE
    rows, wrong = model(count, PER_CYCLE), model(count, PER_CYCLE, td_s=2.0 * TD_S)
    decay = float(rows[0, 0])
    present = rows.copy()  # the offset's value now, not at i = 0: its column is then 1, and it decays itself
    present[:, 0] = 1.0
    scaled = rows.copy()  # the same unknown for the closed form, which has no transition
    scaled[:, 0] /= rows[-1, 0]
    z = samples(rows, runs, seed=5)
    table, worst, ratios = [], 0.0, []
    for forgetting in (1.0, 0.99, 0.98, 0.95, 0.9):
        paper = estimates(rows, z, gains(rows, 1e8, forgetting))[-1] - TRUTH[:, None]
        cured = estimates(present, z, gains(present, 1e8, forgetting, decay), decay)[-1, 1:] - TRUTH[1:, None]
        bias, spread = cured.mean(axis=1), cured.std(axis=1, ddof=1)
        worst = max(worst, float((np.abs(bias) / spread).max() * np.sqrt(runs)))
        theory = weighted_deviation(scaled, forgetting)[1:]
        ratios.append(float(np.abs(spread / theory - 1.0).max()))
        gain = gains(wrong, 1e8, forgetting)
        off = (
            estimates(wrong, z.mean(axis=1)[:, None], gain)[:, :, 0] - TRUTH
        )  # linear: the mean's is the mean
        at = [float(np.hypot(*off[cycles * PER_CYCLE - 1, 1:])) for cycles in (1, 3)]
        own = paper.std(axis=1, ddof=1)
        table.append((forgetting, float(np.hypot(*bias)), float(spread.mean()), float(theory.mean()),
                      float(own[1:].mean()), own[0], *at))  # fmt: skip
    columns = (">factor", ">bias", ">deviation", ">closed form", ">eq. 2-4: deviation", ">its x0",
               ">Td wrong by 2: bias at 1 cycle", ">3 cycles")  # fmt: skip
    note = (
        "Of the fundamental after ten cycles; the first columns with the offset's present value as "
        "unknown. In the paper's coordinates x0 is the value at i = 0, of which a memory that fades knows"
        " less with every sample: its deviation grows without limit (winds up), while the phasor's is as "
        "good. Eq. 2 must keep P symmetric to the bit: otherwise an antisymmetric rounding error grows as"
        " 1 / l per sample, and at 0.9 has taken the phasor along after ten cycles."
    )
    result.tables.append(Table("Forgetting factor", columns, table, note))
    result.text.append(
        "A forgetting factor brings no bias while the model is true, but the estimate no longer converges; "
        "with a wrong Td it takes away a bias that otherwise stays for long."
    )
    result.checks += [
        Check("forgetting, true model: bias of the fundamental over its standard error", worst, 4.0),
        Check("forgetting: deviation against the closed form, relative", max(ratios), 0.1),
    ]


def _spread_figure(lengths: Array, spread: Array, theory: Array) -> Any:
    import plotly.graph_objects as go

    figure = go.Figure(layout={"template": "plotly_white", "height": 420, "margin": {"t": 20}})
    for column, (name, colour) in enumerate((("x0", "#d98c1f"), ("xR1", "#1f6fb2"), ("xI1", "#2a9d5c"))):
        figure.add_scatter(
            x=lengths, y=spread[:, column], name=name, mode="markers", marker={"color": colour}
        )
        line = {"color": colour, "width": 1.5, "dash": "solid" if column < 2 else "dot"}
        figure.add_scatter(x=lengths, y=theory[:, column], name=f"{name}, theory", mode="lines", line=line)
    figure.update_xaxes(type="log", title="samples N", tickvals=list(lengths))
    ticks = [0.002, 0.003, 0.005, 0.007, 0.01, 0.015]
    figure.update_yaxes(type="log", title="standard deviation [of the fundamental's peak]", tickvals=ticks)
    return figure
