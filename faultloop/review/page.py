"""A page for a fault: tables, waves, timeline and R-X plane to zoom and point at, in one file, offline."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import Template

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from faultloop.io.mcap_reader import Log
from faultloop.io.messages import CHANNELS, LOOPS, PHASORS, SAMPLED_VALUES
from faultloop.io.output_file import write_aside
from faultloop.review.facts import Summary
from faultloop.review.plotly_config import CONFIG
from faultloop.review.relay_summary import line_impedance
from faultloop.review.rows import relay_rows
from faultloop.review.survey import survey
from faultloop.review.text import Rows, can_text, headline, tables
from faultloop.review.view import (
    KIND_COLOURS,
    LOOP_COLOURS,
    PHASE_COLOURS,
    RelayView,
    extent_ohm,
    fault_view,
    locus_ms,
    markers,
    thinned,
    window_ms,
    zone_shapes,
)

POINTS = 4000  # of a wave outside the fault's window; inside, every sample is there
MOST_INSIDE = 20_000  # samples of the window that are all there
PAGE = Template("""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>$title</title>
<style>
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 0 auto;
  max-width: 1500px; padding: 1rem 2rem; }
h1 { margin: 0 0 .3rem; }
h2 { margin: 2.2rem 0 .4rem; border-bottom: 1px solid #ddd; }
h3 { margin: 1.3rem 0 .3rem; font-size: 1rem; }
p { margin: .15rem 0; color: #555; }
p.warning { color: #8a4b00; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .9rem; }
th, td { text-align: left; padding: .12rem 1.1rem .12rem 0; white-space: nowrap; }
th { color: #70757c; font-weight: 600; border-bottom: 1px solid #ddd; }
.n { text-align: right; }
.scroll { overflow-x: auto; }
.events { max-height: 26rem; overflow: auto; }
</style><script>$plotly</script></head><body>
$body
</body></html>
""")


def write_html(log: Log, summary: Summary, path: str | Path) -> Path:
    """Writes the page of a log that ``summarize`` has summarized: one file that needs no network.

    Within the fault's window every sample is there; outside, waves are thinned to their least and greatest
    values.  Raises InputError where ``path`` does not end in ``.html`` or cannot be written; nothing is left
    half-made.
    """
    with write_aside(path, ".html") as aside:
        title = summary.log.scenario or Path(summary.log.path).name
        body = "\n".join(_body(log, summary, title))
        page = PAGE.substitute(title=html.escape(title), plotly=get_plotlyjs(), body=body)
        aside.write_text(page, encoding="utf-8", newline="\n")
    return Path(path)


def _body(log: Log, summary: Summary, title: str) -> Iterable[str]:
    yield f"<h1>{html.escape(title)}</h1>"
    yield from (f"<p>{html.escape(line)}</p>" for line in headline(summary))
    yield f"<p>{html.escape(can_text(summary.can))}</p>"
    yield from (f'<p class="warning">Warning: {html.escape(text)}</p>' for text in summary.warnings)
    for name, columns, rows in tables(summary):
        yield f"<h3>{html.escape(name)}</h3>{_table(columns, rows)}"
    if not any(own.trips for own in summary.relays.values()):
        yield "<h3>No trip.</h3>"
    for place, name in enumerate(summary.relays):
        yield f"<h2>{html.escape(name)}</h2>"
        if not summary.relays[name].samples:
            yield "<p>No samples in the log.</p>"
            continue
        view = fault_view(log, name, summary)
        yield _div(waves(view, summary, outline(log, view)), f"waves{place}")
        yield _div(plane(view, summary, log), f"plane{place}")
    events: Rows = [(f"{e.ms:.3f}", e.source, e.level, e.text) for e in summary.events]
    if events:
        yield f'<h2>Events</h2><div class="events">{_table((">ms", "from", "level", "what"), events)}</div>'


def _table(columns: Sequence[str], rows: Rows) -> str:
    right = [column.startswith(">") for column in columns]

    def line(cells: Sequence[str], tag: str) -> str:
        marks = [' class="n"' if side else "" for side in right]
        return "".join(f"<{tag}{m}>{html.escape(c)}</{tag}>" for m, c in zip(marks, cells, strict=True))

    head = line([column.removeprefix(">") for column in columns], "th")
    body = "".join(f"<tr>{line(row, 'td')}</tr>" for row in rows)
    return f'<div class="scroll"><table><tr>{head}</tr>{body}</table></div>'


def _div(figure: go.Figure, name: str) -> str:
    return figure.to_html(full_html=False, include_plotlyjs=False, div_id=name, config=CONFIG)


Outline = list[tuple[NDArray[np.float64], NDArray[np.float64]]]
"""Time [ms] and value of the record outside of the fault's window, thinned: of each wave, then of its RMS."""


def outline(log: Log, view: RelayView) -> Outline:
    """Of the whole record, from one pass over it in stretches."""
    name, whole = view.rows.name, survey(log, view.rows.name)
    zero = int(view.rows.t_ns[0]) - round(1e6 * view.ms[0]) if len(view.rows) else 0
    found: list[list[tuple[NDArray[np.float64], NDArray[np.float64]]]] = [[] for _ in range(12)]
    last_ns: int | None = None
    for span in log.windows():
        rows = relay_rows(log, name, *span, kinds=(SAMPLED_VALUES, PHASORS))
        if not len(rows):
            continue
        if last_ns is not None and rows.t_ns[0] - last_ns > 1.5 * whole.interval_ns:
            rows = rows.at(np.concatenate([[(last_ns + rows.t_ns[0]) // 2], rows.t_ns]))
        last_ns, rows = int(rows.t_ns[-1]), rows.broken_at_gaps()
        outside = np.ones(len(rows), bool)
        if len(view.rows):
            outside = (rows.t_ns < view.rows.t_ns[0]) | (rows.t_ns > view.rows.t_ns[-1])
        ms = (rows.t_ns[outside] - zero) / 1e6
        points = max(8, round(POINTS * len(rows) / max(whole.count, 1)))
        for into, y in zip(found, np.hstack([rows.samples, np.abs(rows.phasors)])[outside].T, strict=True):
            keep = thinned(y, points) if len(y) else np.empty(0, np.int64)
            into.append((ms[keep], y[keep]))
    return [(np.concatenate([ms for ms, _ in own]), np.concatenate([y for _, y in own])) for own in found]


def kept(y: NDArray[np.float64], inside: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Indices of y (n,) that the page shows: all of the window, the outline of the rest."""
    window = np.flatnonzero(inside)
    if len(window):
        window = window[0] + thinned(y[window[0] : window[-1] + 1], MOST_INSIDE)
    rest = np.flatnonzero(~inside)
    return np.union1d(window, rest[thinned(y[rest], POINTS)] if len(rest) else rest)


def waves(view: RelayView, summary: Summary, outside: Outline | None = None) -> go.Figure:
    """Voltages, currents, their phasors' magnitudes and the timeline over one time axis."""
    heights = [1, 1, 0.7, 0.7, 0.13 * max(len(view.timeline), 4)]
    figure = make_subplots(5, 1, shared_xaxes=True, vertical_spacing=0.022, row_heights=heights)
    span = window_ms(summary)
    inside = (view.ms >= span[0]) & (view.ms <= span[1])
    for k, channel in enumerate(CHANNELS):
        unit, row = ("kV", 1) if k < 3 else ("kA", 2)
        colour = PHASE_COLOURS[channel[1].upper()]
        wave, size = view.rows.samples[:, k] / 1e3, np.abs(view.rows.phasors[:, k]) / 1e3
        for y, place, name in ((wave, row, channel), (size, row + 2, f"{channel} RMS")):
            keep = kept(y, inside)
            ms, y = view.ms[keep], y[keep]
            if outside is not None:
                ms, y = _with_outline((ms, y), outside[k + (6 if place > 2 else 0)])
            figure.add_scatter(
                x=ms, y=y.astype(np.float32), name=name,
                line={"color": colour, "width": 1.4}, hovertemplate=f"%{{y:.4f}} {unit}",
                row=place, col=1, showlegend=place < 3, legendgroup=channel,
            )  # fmt: skip
    _add_timeline(figure, view)
    for ms, name in markers(summary, view.rows.name):
        figure.add_vline(
            ms, line={"color": "#222", "width": 1, "dash": "solid" if name == "fault" else "dash"}
        )
        text = name if name == "fault" else f"{name} {ms:.2f} ms"
        figure.add_annotation(
            x=ms, y=1.0, xref="x", yref="paper", yanchor="bottom", text=text, showarrow=False
        )
    for row, title in enumerate(("voltage [kV]", "current [kA]", "|V| RMS [kV]", "|I| RMS [kA]"), 1):
        figure.update_yaxes(title=title, row=row, col=1)
    zero = "time" if summary.inception.t_ns is None else "time from fault inception"
    figure.update_xaxes(range=list(span), hoverformat=".3f", gridcolor="#e4e6e9")
    figure.update_xaxes(title=f"{zero} [ms]", row=5, col=1)
    figure.update_yaxes(gridcolor="#e4e6e9", zerolinecolor="#b5b9bf")
    figure.update_layout(
        height=900, template="none", hovermode="x unified", margin={"l": 80, "r": 20, "t": 75, "b": 50},
        legend={"orientation": "h", "y": 1.04, "yanchor": "bottom", "x": 0}, barmode="overlay",
    )  # fmt: skip
    return figure


def _with_outline(
    own: tuple[NDArray[np.float64], NDArray[np.float64]],
    rest: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A window's points, and those of the rest of the record [V, A] before and behind it."""
    ms, y = np.concatenate([own[0], rest[0]]), np.concatenate([own[1], rest[1] / 1e3])
    order = np.argsort(ms, kind="stable")
    return ms[order], y[order]


def _add_timeline(figure: go.Figure, view: RelayView) -> None:
    for place, row in enumerate(view.timeline):
        for bar in row.bars:
            start = max(bar.start_ms, float(view.ms[0]))
            height = 0.7 / bar.lanes
            figure.add_bar(
                x=[max(bar.stop_ms - start, 0.0)], base=[start], y=[place], orientation="h", width=height,
                offset=-0.35 + bar.lane * height, marker={"color": KIND_COLOURS[bar.kind]}, showlegend=False,
                hovertemplate=f"{html.escape(bar.name)}: {start:.3f} to {bar.stop_ms:.3f} ms<extra></extra>",
                row=5, col=1,
            )  # fmt: skip
    labels = [row.label for row in view.timeline]
    figure.update_yaxes(
        tickvals=list(range(len(labels))), ticktext=labels, range=[len(labels) - 0.4, -0.6], row=5, col=1
    )


def plane(view: RelayView, summary: Summary, log: Log) -> go.Figure:
    """Zones, line and the loops' way from inception to clearing; a point tells its time."""
    figure = go.Figure()
    loop = view.facts.loop
    shapes = zone_shapes(log.characteristics(view.rows.name), loop)
    for zone, polygon in shapes.items():
        figure.add_scatter(
            x=polygon[:, 0], y=polygon[:, 1], name=zone, fill="toself", mode="lines", hoverinfo="name",
            line={"color": "#26436B", "width": 1.3}, fillcolor="rgba(38,67,107,0.05)",
        )  # fmt: skip
    z1 = line_impedance(log, view.rows.name)
    if z1 is not None:
        ends = {"x": [0, z1.real], "y": [0, z1.imag]}
        figure.add_scatter(**ends, name="line", mode="lines+markers", line={"color": "#222", "width": 3})
    _add_loci(figure, view, locus_ms(summary, view), loop.loop if loop else None)
    for name, point, symbol in (("load", view.facts.load_ohm, "square"), ("fault", loop, "star")):
        if point:
            figure.add_scatter(
                x=[point.r_ohm], y=[point.x_ohm], name=name, mode="markers",
                marker={"symbol": symbol, "size": 13, "color": "#FFD23F",
                        "line": {"color": "#222", "width": 1}},
                hovertemplate="%{x:.3f} + j %{y:.3f} Ω",
            )  # fmt: skip
    low, high = extent_ohm(shapes, z1, view)
    pad = np.maximum(0.15 * (high - low), 1.0)
    figure.update_xaxes(title="R [Ω primary]", range=[low[0] - pad[0], high[0] + pad[0]], gridcolor="#e4e6e9")
    figure.update_yaxes(
        title="X [Ω primary]", range=[low[1] - pad[1], high[1] + pad[1]], gridcolor="#e4e6e9",
        scaleanchor="x", scaleratio=1,
    )  # fmt: skip
    figure.update_layout(
        height=640, template="none", hovermode="closest", margin={"l": 80, "r": 20, "t": 20, "b": 50}
    )
    return figure


def _add_loci(figure: go.Figure, view: RelayView, span: tuple[float, float], faulted: str | None) -> None:
    inside = np.flatnonzero((view.ms >= span[0]) & (view.ms <= span[1]))[-MOST_INSIDE:]
    for k, name in enumerate(LOOPS):
        z = view.rows.loops[inside, k]
        main = name == faulted
        figure.add_scatter(
            x=z.real.astype(np.float32), y=z.imag.astype(np.float32), name=name, customdata=view.ms[inside],
            mode="lines+markers" if main else "lines", marker={"size": 4}, opacity=1 if main else 0.55,
            line={"color": LOOP_COLOURS[name], "width": 2.6 if main else 1},
            hovertemplate="%{x:.2f} + j %{y:.2f} Ω at %{customdata:.3f} ms",
        )  # fmt: skip
