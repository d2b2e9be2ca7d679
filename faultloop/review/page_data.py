"""What the page of a log draws, as one JSON object; arrays are base64 of little-endian numbers.

Samples are 16-bit integers with a scale for each channel, as the converter of a relay has them (-90 dB);
estimates are float32, times float64 [ms from inception].  Within the detail every sample is there; outside it
the least and the greatest value of each stretch stand side by side, and the page says so.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.io.mcap_reader import Log
from faultloop.io.messages import CHANNELS, LOOPS, SAMPLED_VALUES
from faultloop.review.characteristic import remembered, zones
from faultloop.review.facts import Summary
from faultloop.review.relay_summary import line_impedance, ratios
from faultloop.review.retrace import Retraced
from faultloop.review.rows import RelayRows, relay_rows
from faultloop.review.survey import Survey, survey
from faultloop.review.view import fault_view, locus_ms, markers, relay_view, window_ms

MOST_BYTES = 1_300_000
"""Of all relays' arrays before base64, which adds a third."""
STRETCHES = 1200
"""Of the overview outside the detail, for each relay."""
NO_NUMBER = -(2**15)
SAMPLE_BYTES = 8 + 2 * len(CHANNELS)
ESTIMATE_BYTES = 8 * len(CHANNELS) + 8 * len(LOOPS) + 40


def content(log: Log, summary: Summary, known: Mapping[str, Retraced] | None = None) -> dict[str, Any]:
    """Everything that the page draws; ``known``: what the relays knew, of those of which it can be told."""
    names = [name for name in summary.relays if summary.relays[name].samples]
    share = MOST_BYTES // max(len(names), 1)
    return {
        "nominal_hz": summary.log.nominal_hz,
        "channels": list(CHANNELS),
        "loops": list(LOOPS),
        "window": [float(ms) for ms in window_ms(summary)],
        "from_inception": summary.inception.t_ns is not None,
        "relays": [_relay(log, name, summary, share, (known or {}).get(name)) for name in names],
        "events": [[e.ms, e.source, e.level, e.text] for e in summary.events],
    }


def _relay(log: Log, name: str, summary: Summary, share: int, known: Retraced | None) -> dict[str, Any]:
    facts = summary.relays[name]
    whole = survey(log, name)
    everything = whole.count * (SAMPLE_BYTES + ESTIMATE_BYTES) <= share
    view = relay_view(relay_rows(log, name), summary) if everything else fault_view(log, name, summary)
    rows, ms = view.rows, view.ms
    samples, inside = rows.samples, len(rows)
    first, width_ms = 0, 0.0
    if not everything:
        # A detail that is too long itself is cut where it is least looked at: at its end.
        inside = min(inside, max(share // SAMPLE_BYTES, 1))
        limits = (float(ms[0]), float(ms[inside - 1])) if inside else (np.inf, np.inf)
        rest_ms, rest, width_ms = _overview(log, whole, summary.inception.zero_ns, limits)
        first = int(np.searchsorted(rest_ms, limits[0]))
        ms = np.concatenate([rest_ms[:first], ms[:inside], rest_ms[first:]])
        samples = np.concatenate([rest[:first], samples[:inside], rest[first:]])
    left = share - SAMPLE_BYTES * len(ms)
    step = max(1, -(-inside * ESTIMATE_BYTES // max(left, share // 4)))
    kept = slice(0, inside, step)
    loop, load, z1 = facts.loop, facts.load_ohm, line_impedance(log, name)
    span = locus_ms(summary, view)
    return {
        "name": name,
        "line": facts.line,
        "breaker": facts.breaker,
        "ratios": ratios(log, name),
        "t": _packed(ms, "<f8"),
        "detail": [first, first + inside],
        "stretch_ms": width_ms,
        "samples": [_scaled(samples[:, k]) for k in range(len(CHANNELS))],
        "step": step,
        "phasors": _packed(_pairs(rows.phasors[kept]), "<f4"),
        "impedances": _packed(_pairs(rows.loops[kept]), "<f4"),
        "reference_deg": _reference_deg(rows, view.ms),
        "lanes": [_lane(row) for row in view.timeline],
        "marks": [[float(at), text] for at, text in markers(summary, name)],
        "zones": {
            zone: {"ground": ground.tolist(), "phase": phase.tolist()}
            for zone, (ground, phase) in log.characteristics(name).items()
        },
        "dynamic": None if known is None else _dynamic(known, rows.t_ns[kept]),
        "z1": None if z1 is None else [z1.real, z1.imag],
        "loop": None if loop is None else [loop.loop, loop.r_ohm, loop.x_ohm],
        "load": None if load is None else [load.r_ohm, load.x_ohm],
        "locus": [float(at) for at in span],
    }


def _dynamic(known: Retraced, t_ns: NDArray[np.int64]) -> dict[str, Any]:
    """What the zones' characteristics at each kept row are drawn from."""
    g = known.constants["shared"]
    return {
        "rows": _packed(remembered(known, t_ns), "<f4"),
        "zones": zones(known),
        "frequency": float(g["frequency"]),
        "unbalance": float(g["minimum_unbalance"]),
    }


def _overview(
    log: Log, whole: Survey, zero: int, detail_ms: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Outside the detail: times, values (n, 6), length of a stretch [ms]; from one pass over the log."""
    assert whole.first_ns is not None and whole.last_ns is not None
    width_ns = max((whole.last_ns - whole.first_ns) / STRETCHES, 2 * whole.interval_ns)
    times, values, last_ms = [np.empty(0)], [np.empty((0, len(CHANNELS)))], -np.inf
    gap_ms = 1.5e-6 * whole.interval_ns
    for span in log.stretches():
        rows = relay_rows(log, whole.name, *span, kinds=(SAMPLED_VALUES,))
        ms = (rows.t_ns - zero) / 1e6
        outside = np.flatnonzero((ms < detail_ms[0]) | (ms > detail_ms[1]))
        at, y = ms[outside], rows.samples[outside]
        for part in np.split(np.arange(len(at)), np.flatnonzero(np.diff(at) > gap_ms) + 1):
            if not len(part):
                continue
            if at[part[0]] - last_ms > gap_ms:  # samples are missing, or the detail is between
                times.append(at[part[:1]] - gap_ms / 3)
                values.append(np.full((1, len(CHANNELS)), np.nan))
            last_ms = float(at[part[-1]])
            own_times, own_values = _least_and_greatest(at[part], y[part], width_ns / 1e6)
            times.append(own_times)
            values.append(own_values)
    return np.concatenate(times), np.concatenate(values), width_ns / 1e6


def _least_and_greatest(
    at: NDArray[np.float64], y: NDArray[np.float64], width_ms: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two points for each stretch of samples without a gap: at its begin and in its middle."""
    starts = np.flatnonzero(np.diff(at // width_ms, prepend=-np.inf))
    stops = np.append(at[starts[1:]], at[-1])
    two = np.stack([np.fmin.reduceat(y, starts), np.fmax.reduceat(y, starts)], axis=1)
    times = np.stack([at[starts], (at[starts] + stops) / 2], axis=1)
    if stops[-1] == at[starts[-1]]:  # a stretch of a single sample
        times, two = times.reshape(-1)[:-1], two.reshape(-1, y.shape[1])[:-1]
    return times.reshape(-1), two.reshape(-1, y.shape[1])


def _reference_deg(rows: RelayRows, ms: NDArray[np.float64]) -> float:
    """Angle of VA before the fault, or of the first phasor of it that is a number; angles count from it."""
    angles = np.degrees(np.angle(rows.phasors[:, 0]))
    known = np.flatnonzero(np.isfinite(angles) & (np.abs(rows.phasors[:, 0]) > 0))
    before = known[ms[known] < 0.0]
    at = before[-1] if len(before) else known[0] if len(known) else None
    return 0.0 if at is None else float(angles[at])


def _lane(row: Any) -> list[Any]:
    bars = [[_bounded(b.start_ms), _bounded(b.stop_ms), b.kind, b.name, b.lane, b.lanes] for b in row.bars]
    return [row.label, bars]


def _bounded(ms: float) -> float:
    """JSON has no infinity: what was so from before the log begins long before it."""
    return float(np.clip(ms, -1e12, 1e12))


def _pairs(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.ascontiguousarray(values).view(np.float64)


def _packed(values: NDArray[np.float64], kind: str) -> str:
    with np.errstate(over="ignore"):
        return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")


def _scaled(values: NDArray[np.float64]) -> list[Any]:
    """A channel's greatest value, and the part of it that each sample is, in 16 bits."""
    finite = np.isfinite(values)
    greatest = float(np.abs(values[finite]).max(initial=0.0)) or 1.0
    counts = np.full(len(values), NO_NUMBER, "<i2")
    counts[finite] = np.rint(values[finite] / greatest * 32767).astype(np.int16)
    return [greatest, base64.b64encode(counts.tobytes()).decode("ascii")]
