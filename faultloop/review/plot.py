"""A picture of a fault: per relay the waves, what started and tripped when, and the R-X plane."""

from __future__ import annotations

from collections.abc import Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from faultloop.io.mcap_reader import Log
from faultloop.io.messages import LOOPS, POLES
from faultloop.io.output_file import write_aside
from faultloop.review.characteristic import characteristics_at
from faultloop.review.facts import RelayFacts, Summary
from faultloop.review.impedance_plane import impedance_plane
from faultloop.review.relay_summary import line_impedance
from faultloop.review.text import fault_text
from faultloop.review.view import (
    KIND_COLOURS,
    KIND_NAMES,
    PHASE_COLOURS,
    Kind,
    RelayView,
    TimelineRow,
    fault_view,
    markers,
    thinned,
    window_ms,
)

MOST_RELAYS = 3
LEGEND_KINDS: tuple[Kind, ...] = ("forward", "reverse", "start", "operate", "blocked", "record")
BAR = 0.72  # height of a timeline bar, of its row
POINTS = 3000  # of a wave: more than pixels
INK, FAINT, GRID = "#222222", "#70757C", "#E4E6E9"
STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.edgecolor": "#B5B9BF",
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "lines.solid_capstyle": "round",
}


def write_png(log: Log, summary: Summary, path: str | Path) -> Path:
    """Writes the picture of a log that ``summarize`` has summarized; needs no display.

    At most three relays: those that tripped first.  Raises InputError where ``path`` does not end in ``.png``
    or cannot be written; nothing is left half-made.
    """
    from matplotlib import rc_context

    with write_aside(path, ".png") as aside, rc_context(STYLE):
        figure = draw(log, summary)
        # without metadata of its own: the same log gives the same bytes
        figure.savefig(aside, format="png", facecolor="white", metadata={"Software": None})
    return Path(path)


def draw(log: Log, summary: Summary) -> Figure:
    """The figure."""
    names = shown_relays(summary)
    columns = max(len(names), 1)
    figure = Figure(figsize=(8.0 * max(columns, 1.4) if columns < 2 else 8.0 * columns, 11.0), dpi=100)
    FigureCanvasAgg(figure)
    _headings(figure, summary, len(names))
    if not names:
        figure.text(0.5, 0.5, "The log has no relay with samples.", ha="center", color=FAINT, size=14)
        return figure
    views = [fault_view(log, name, summary) for name in names]
    edges = {"left": 0.065 if columns == 1 else 0.05, "right": 0.985, "top": 0.872, "bottom": 0.05}
    grid = figure.add_gridspec(1, columns, wspace=0.14, **edges)
    tallest = max(4, *(len(_drawn_rows(view, window_ms(summary))) for view in views))
    shared: list[Axes] = []
    for place, view in enumerate(views):
        shared = _relay_column(figure, grid[place], (log, summary, view, tallest), shared)
    return figure


def shown_relays(summary: Summary) -> list[str]:
    """The relays of the picture, in the log's order."""
    with_samples = [name for name, own in summary.relays.items() if own.samples]

    def first_trip(name: str) -> float:
        return min((trip.decided_ns for trip in summary.relays[name].trips), default=np.inf)

    chosen = sorted(with_samples, key=first_trip)[:MOST_RELAYS]
    return [name for name in with_samples if name in chosen]


def _headings(figure: Figure, summary: Summary, shown: int) -> None:
    title = summary.log.scenario or Path(summary.log.path).name
    figure.text(0.02, 0.972, title, size=19, weight="bold", va="center")
    under = [fault_text(fault) for fault in summary.faults] or [summary.inception.text]
    left = len(summary.relays) - shown
    if left:
        under.append(f"{left} more relay{'s' if left > 1 else ''} in the log")
    figure.text(0.02, 0.943, "   |   ".join(under[:3]), size=11, color=FAINT, va="center")
    phases = [Line2D([], [], color=PHASE_COLOURS[p], lw=2.5, label=f"phase {p}") for p in POLES]
    phases.append(Line2D([], [], color=FAINT, lw=1.2, ls=(0, (3, 1.5)), label="√2 · phasor magnitude"))
    figure.legend(handles=phases, loc="center right", bbox_to_anchor=(0.99, 0.958), ncols=4, frameon=False)


def _relay_column(
    figure: Figure, cell: Any, what: tuple[Log, Summary, RelayView, int], shared: Sequence[Axes]
) -> list[Axes]:
    """Voltages, currents and timeline over one time axis; below, the R-X plane and the figures."""
    log, summary, view, tallest = what
    halves = cell.subgridspec(2, 1, height_ratios=[1.45, 1], hspace=0.13)
    span = window_ms(summary)
    drawn = _drawn_rows(view, span)
    waves = halves[0].subgridspec(3, 1, height_ratios=[1, 1, 0.1 * tallest + 0.1], hspace=0.07)
    low = halves[1].subgridspec(1, 2, width_ratios=[1.25, 1], wspace=0.02)
    voltage = figure.add_subplot(waves[0], sharey=shared[0] if shared else None)
    current = figure.add_subplot(waves[1], sharex=voltage, sharey=shared[1] if shared else None)
    timeline = figure.add_subplot(waves[2], sharex=voltage)
    _waves(voltage, view, (0, "voltage [kV]"), span)
    _waves(current, view, (3, "current [kA]"), span)
    _timeline(timeline, drawn, span)
    zero = "time" if summary.inception.t_ns is None else "time from fault inception"
    timeline.set_xlabel(f"{zero} [ms]", loc="left")
    timeline.set_ylim(tallest - 0.4, -0.6)
    voltage.set_xlim(*span)
    for axes in (voltage, current):
        axes.tick_params(labelbottom=False, length=0)
    own = (("line", view.facts.line), ("breaker", view.facts.breaker))
    place = ", ".join(f"{kind} {name}" for kind, name in own if name)
    voltage.text(0, 1.17, view.rows.name, transform=voltage.transAxes, size=14, weight="bold", va="center")
    voltage.text(0.07, 1.17, place, transform=voltage.transAxes, size=10, color=FAINT, va="center")
    _instants((voltage, current, timeline), markers(summary, view.rows.name), span)
    impedance_plane(
        figure.add_subplot(low[0]),
        (line_impedance(log, view.rows.name), log.characteristics(view.rows.name), _now(log, view)),
        summary,
        view,
    )
    _card(figure.add_subplot(low[1]), view)
    return [voltage, current]


def _now(log: Log, view: RelayView) -> dict[str, NDArray[np.float64]]:
    """The zones as they are at the instant at which the faulted loop is told."""
    loop, fault = view.facts.loop, view.facts.fault
    if loop is None or fault is None:
        return {}
    row = int(np.searchsorted(view.rows.t_ns, fault.t_ns))
    if row >= len(view.rows.t_ns) or view.rows.t_ns[row] != fault.t_ns:
        return {}  # not in the window that is drawn
    place = LOOPS.index(loop.loop)
    return characteristics_at(log, view.rows.name, fault.t_ns, place, view.rows.phasors[row])


def _waves(axes: Axes, view: RelayView, what: tuple[int, str], span: tuple[float, float]) -> None:
    first, label = what
    inside = (view.ms >= span[0]) & (view.ms <= span[1])
    ms, y = view.ms[inside], view.rows.samples[inside, first : first + 3] / 1e3
    size = np.sqrt(2) * np.abs(view.rows.phasors[inside, first : first + 3]) / 1e3
    for k, pole in enumerate(POLES):
        keep = thinned(y[:, k], POINTS)
        axes.plot(ms[keep], y[keep, k], color=PHASE_COLOURS[pole], lw=1.3)
        keep = thinned(size[:, k], POINTS)
        # Not part of the axes' range: an estimate may leave the waves' for a moment after a disturbance.
        line = Line2D(
            ms[keep], size[keep, k], color=PHASE_COLOURS[pole], lw=1.1, ls=(0, (3, 1.5)), alpha=0.75
        )
        axes.add_artist(line)
    if not np.isfinite(y).any():
        axes.text(0.5, 0.5, "no value is a number", transform=axes.transAxes, ha="center", color=FAINT)
    axes.set_ylabel(label)
    axes.margins(y=0.07)


def _drawn_rows(view: RelayView, span: tuple[float, float]) -> list[TimelineRow]:
    """The timeline's rows with something to show; phase selection is left out, the trip names its loop."""
    return [
        row
        for row in view.timeline
        if not row.label.startswith("PHS")
        and any(bar.stop_ms >= span[0] and bar.start_ms <= span[1] for bar in row.bars)
    ]


def _timeline(axes: Axes, rows: Sequence[TimelineRow], span: tuple[float, float]) -> None:
    for place, row in enumerate(rows):
        for bar in row.bars:
            start, stop = max(bar.start_ms, span[0]), min(bar.stop_ms, span[1])
            height = BAR / bar.lanes
            width = max(stop - start, 0.003 * (span[1] - span[0]))  # the shortest is still seen
            if stop >= start:
                low = place - BAR / 2 + bar.lane * height
                axes.broken_barh([(start, width)], (low, height), color=KIND_COLOURS[bar.kind], lw=0)
        _bar_texts(axes, place, row, span)
    axes.set_yticks(range(len(rows)), [row.label for row in rows])
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.grid(axis="y", visible=False)
    if not rows:
        axes.text(0.5, 0.5, "nothing started", transform=axes.transAxes, ha="center", color=FAINT)
    _timeline_legend(axes, {bar.kind for row in rows for bar in row.bars})


def _bar_texts(axes: Axes, place: int, row: TimelineRow, span: tuple[float, float]) -> None:
    """When an element first operated, and the fault's type: in the bar where it is long enough."""
    named = [
        bar for bar in row.bars if bar.kind in ("fault", "operate") and span[0] <= bar.start_ms <= span[1]
    ]
    for bar in named if row.label == "fault" else named[:1]:
        text = bar.name if bar.kind == "fault" else f"{bar.start_ms:.1f}"
        inside = min(bar.stop_ms, span[1]) - bar.start_ms > 0.06 * (span[1] - span[0])
        axes.annotate(
            text, (bar.start_ms, place), (4 if inside else -3, -0.5), textcoords="offset points", size=8,
            ha="left" if inside else "right", va="center", color="white" if inside else INK,
        )  # fmt: skip


def _timeline_legend(axes: Axes, kinds: Set[str]) -> None:
    handles = [Patch(color=KIND_COLOURS[k], label=KIND_NAMES[k]) for k in LEGEND_KINDS if k in kinds]
    if kinds & set(POLES):
        handles.append(Patch(color=FAINT, label="pole open"))
    if handles:
        axes.legend(
            handles=handles, loc="upper right", bbox_to_anchor=(1.0, -0.14), ncols=len(handles),
            frameon=False, fontsize=8.5, handlelength=1.2, columnspacing=1.2, borderaxespad=0.4,
        )  # fmt: skip


def _instants(axes: Sequence[Axes], found: list[tuple[float, str]], span: tuple[float, float]) -> None:
    """Lines through all three, named above the first; names that would collide move apart."""
    shown = [(ms, name if name == "fault" else f"{name} {ms:.1f} ms") for ms, name in found]
    shown = [(ms, text) for ms, text in shown if span[0] <= ms <= span[1]]
    widths = [0.0115 * len(text) + 0.02 for _, text in shown]
    left: list[float] = []
    for (ms, _), width in zip(shown, widths, strict=True):
        wanted = (ms - span[0]) / (span[1] - span[0]) - width / 2
        left.append(max(wanted, left[-1] + widths[len(left) - 1]) if left else wanted)
    edge = 1.02
    for k in reversed(range(len(left))):
        left[k] = min(left[k], edge - widths[k])
        edge = left[k]
    for (ms, text), start, width in zip(shown, left, widths, strict=True):
        for one in axes:
            one.axvline(ms, color=INK, lw=1.0, ls="-" if text == "fault" else (0, (4, 2)), zorder=1.5)
        axes[0].annotate(
            text, (start + width / 2, 1.0), (0, 3), xycoords="axes fraction", textcoords="offset points",
            ha="center", va="bottom", size=9, weight="bold",
        )  # fmt: skip


def _card(axes: Axes, view: RelayView) -> None:
    """The figures that a person writes down."""
    axes.axis("off")
    y = 0.985
    for heading, lines in card(view.facts):
        axes.text(0.06, y, heading, transform=axes.transAxes, size=10, weight="bold", va="top")
        y -= 0.062
        for name, value in lines:
            axes.text(0.06, y, name, transform=axes.transAxes, size=9.5, color=FAINT, va="top")
            axes.text(0.99, y, value, transform=axes.transAxes, size=9.5, va="top", ha="right")
            y -= 0.054
        y -= 0.026


def card(own: RelayFacts) -> list[tuple[str, list[tuple[str, str]]]]:
    """Headings, each with names and values."""
    out: list[tuple[str, list[tuple[str, str]]]] = []
    for trip in own.trips[:2]:
        times = [("decided", trip.decided_ms), ("received by breaker", trip.received_ms)]
        times.append(("poles open", trip.opened_ms))
        lines = [(name, f"{ms:.2f} ms") for name, ms in times if ms is not None]
        out.append((f"Trip {trip.function} {trip.loop}, poles {trip.poles}", lines))
    if not own.trips:
        out.append(("No trip", []))
    loop = own.loop
    if loop and own.fault:
        lines = [("impedance", f"{loop.magnitude_ohm:.2f} Ω  {loop.angle_deg:.1f}°")]
        lines.append(("R + jX", f"{loop.r_ohm:.2f} + j {loop.x_ohm:.2f} Ω"))
        if loop.percent_of_line is not None:
            lines.append(("of the line, by X", f"{loop.percent_of_line:.1f} %"))
        if own.location:
            lines.append(("fault locator", own.location.partition(" at ")[2].replace(" of the line", " pu")))
        out.append((f"Loop {loop.loop} at {own.fault.ms:.0f} ms", lines))
    lines = []
    for pole in POLES:
        before, during = own.prefault, own.fault
        if before and during:
            v, i = f"v{pole.lower()}", f"i{pole.lower()}"
            volts = f"{before[v].magnitude / 1e3:.1f} → {during[v].magnitude / 1e3:.1f} kV"
            amps = f"{before[i].magnitude:.0f} → {during[i].magnitude:.0f} A"
            lines.append((pole, f"{volts}   {amps}"))
    if lines:
        out.append(("RMS before and in the fault", lines))
    peaks = [
        (peak.instantaneous, pole, peak.ms)
        for pole, peak in zip(POLES, own.peak_current.values(), strict=True)
        if peak
    ]
    if peaks:
        amps, pole, ms = max(peaks)
        out.append(("Peak current", [(f"phase {pole} at {ms:.1f} ms", f"{amps / 1e3:.2f} kA")]))
    return out
