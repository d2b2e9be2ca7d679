"""Panels of a report drawn: by plotly for the page, by matplotlib for the picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from faultloop.io.output_file import write_aside
from faultloop.study.campaign.figures import Panel, Series

HEIGHT, EQUAL_HEIGHT = 460, 640
WIDTH, DOTTED_WIDTH = 2, 1.2
LOG_TICKS = [digit * 10**power for power in range(-1, 5) for digit in (1, 2, 5)]


def plotly_figure(panel: Panel) -> Any:
    """For a page."""
    import plotly.graph_objects as go

    figure = go.Figure()
    if panel.cells is not None:
        figure.add_heatmap(
            z=panel.cells, x=list(panel.x_names), y=list(panel.y_names), colorscale="Reds", zmin=0, zmax=100,
            text=[list(row) for row in panel.written], texttemplate="%{text}", xgap=1, ygap=1,
            hovertemplate=f"{panel.x_label} %{{x}}<br>{panel.y_label} %{{y}}<br>%{{z:.1f}} %<extra></extra>",
            colorbar={"title": "%", "thickness": 12},
        )  # fmt: skip
        figure.update_xaxes(type="category")
        figure.update_yaxes(type="category")
    seen: set[str] = set()
    for series in panel.series:
        figure.add_trace(_trace(series, series.group is None or series.group not in seen))
        seen.add(series.group or "")
    if panel.equal:
        figure.update_xaxes(constrain="domain")
        figure.update_yaxes(scaleanchor="x", constrain="domain")
    if panel.log_x:
        figure.update_xaxes(type="log", tickvals=LOG_TICKS)
    if panel.cells is None:
        figure.update_xaxes(showgrid=True, gridcolor="#eee", zeroline=panel.equal, zerolinecolor="#ccc")
        figure.update_yaxes(showgrid=True, gridcolor="#eee", zeroline=panel.equal, zerolinecolor="#ccc")
        if not panel.equal:
            figure.update_yaxes(rangemode="tozero")
    figure.update_layout(
        xaxis_title=panel.x_label, yaxis_title=panel.y_label, template="simple_white", autosize=True,
        height=EQUAL_HEIGHT if panel.equal else HEIGHT, margin={"l": 55, "r": 15, "t": 15, "b": 50},
        legend={"orientation": "h", "y": -0.18, "yanchor": "top"}, hovermode="closest",
    )  # fmt: skip
    return figure


def _trace(series: Series, in_legend: bool) -> Any:
    import plotly.graph_objects as go

    common = {
        "x": series.x, "y": series.y, "showlegend": in_legend, "legendgroup": series.group,
        "name": series.group if series.group == "zones" else _entry(series),
    }  # fmt: skip
    if series.mode == "points":
        told = {"text": list(series.told), "hovertemplate": "%{text}: %{x:.3g}, %{y:.3g}<extra></extra>"}
        style = {"color": series.colour, "size": 6, "opacity": 0.75}
        return go.Scattergl(**common, mode="markers", marker=style, **(told if series.told else {}))
    dotted = series.mode == "dotted"
    line = {"color": series.colour, "width": DOTTED_WIDTH if dotted else WIDTH}
    line |= {"dash": "dot"} if dotted else {"shape": "hv"} if series.mode == "steps" else {}
    said = f"{series.name}<br>%{{x:.4g}}, %{{y:.4g}}<extra></extra>"
    one = np.isfinite(series.y).sum() == 1  # which a line would not show
    return go.Scatter(**common, mode="lines+markers" if one else "lines", line=line, hovertemplate=said)


def _entry(series: Series) -> str:
    """In the legend: ``SIR 5`` for its median and its slowest."""
    return series.name.partition(": ")[0]


def write_png(title: str, panels: Sequence[Panel], path: Path) -> None:
    """All panels as one picture, two in a row."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = -(-len(panels) // 2)
    figure = Figure(figsize=(14, 0.8 + 5 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    for number, panel in enumerate(panels):
        _draw(figure, figure.add_subplot(rows, 2, number + 1), panel)
    with write_aside(path, ".png") as aside:
        figure.savefig(aside, format="png", dpi=110)


STYLES: dict[str, dict[str, Any]] = {
    "points": {"marker": ".", "linestyle": "", "markersize": 4},
    "dotted": {"linestyle": ":", "linewidth": 1},
    "steps": {"drawstyle": "steps-post", "linewidth": 1.4},
    "line": {"linewidth": 1.4},
}


def _draw(figure: Any, axes: Any, panel: Panel) -> None:
    axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
    if panel.cells is not None:
        image = axes.imshow(panel.cells, origin="lower", aspect="auto", cmap="Reds", vmin=0, vmax=100)
        figure.colorbar(image, ax=axes)
        for names, axis in ((panel.x_names, axes.xaxis), (panel.y_names, axes.yaxis)):
            step = max(len(names) // 12, 1)
            axis.set_ticks(range(0, len(names), step), list(names)[::step])
    seen: set[str | None] = {None}
    for series in panel.series:
        label = "_" if series.group in seen - {None} else _entry(series)
        axes.plot(series.x, series.y, label=label, color=series.colour, **STYLES[series.mode])
        seen.add(series.group)
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if panel.log_x:
        low, high = axes.get_xlim()
        axes.set_xscale("log")
        ticks = [tick for tick in LOG_TICKS if low <= tick <= high]
        axes.xaxis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.xaxis.set_ticks([], minor=True)
    if panel.series:
        axes.grid(alpha=0.25)
        axes.legend(fontsize=7)
