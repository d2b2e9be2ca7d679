"""Panels of a report drawn: by plotly for the page, by matplotlib for the picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from faultloop.io.output_file import write_aside
from faultloop.study.campaign.figures import Panel


def plotly_figure(panel: Panel) -> Any:
    """For a page."""
    import plotly.graph_objects as go

    figure = go.Figure()
    if panel.cells is not None:
        figure.add_heatmap(
            z=panel.cells, x=list(panel.x_names), y=list(panel.y_names), colorscale="Reds", zmin=0, zmax=100
        )
        figure.update_xaxes(type="category")
        figure.update_yaxes(type="category")
    for series in panel.series:
        style = {"color": series.colour, "size": 5} if series.mode == "points" else None
        figure.add_trace(
            (go.Scattergl if series.mode == "points" else go.Scatter)(
                x=series.x,
                y=series.y,
                name=series.name,
                mode="markers" if series.mode == "points" else "lines",
                marker=style,
                line={"color": series.colour} if series.mode == "line" else None,
            )
        )
    if panel.equal:
        figure.update_yaxes(scaleanchor="x")
    figure.update_layout(
        xaxis_title=panel.x_label, yaxis_title=panel.y_label, template="simple_white", height=480,
        margin={"l": 60, "r": 20, "t": 20, "b": 50}, legend={"orientation": "h", "y": -0.2},
    )  # fmt: skip
    return figure


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


def _draw(figure: Any, axes: Any, panel: Panel) -> None:
    axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
    if panel.cells is not None:
        image = axes.imshow(panel.cells, origin="lower", aspect="auto", cmap="Reds", vmin=0, vmax=100)
        figure.colorbar(image, ax=axes)
        for names, axis in ((panel.x_names, axes.xaxis), (panel.y_names, axes.yaxis)):
            step = max(len(names) // 12, 1)
            axis.set_ticks(range(0, len(names), step), list(names)[::step])
    for series in panel.series:
        kind = (
            {"marker": ".", "linestyle": "", "markersize": 3}
            if series.mode == "points"
            else {"linewidth": 1.2}
        )
        axes.plot(series.x, series.y, label=series.name, color=series.colour, **kind)
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if panel.series:
        axes.grid(alpha=0.25)
        axes.legend(fontsize=7)
