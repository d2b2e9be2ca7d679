"""A diagram of a report, drawn alike by plotly for the page and by matplotlib for the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from faultloop.io.output_file import write_aside

COLOURS = (
    "#1f4e9c", "#d1495b", "#2e8b57", "#e08e0b", "#6d4fa3", "#3a9ab2", "#7a5c3e", "#4c566a", "#b5179e",
    "#8a9a1c", "#00808a", "#c05299", "#5e7ce2", "#a44a3f", "#2f3e46", "#e36414",
)  # fmt: skip
INK, GRID = "#222222", "#E4E6E9"
DASHES = {"solid": "-", "dash": "--", "dot": ":"}


@dataclass(frozen=True)
class Curve:
    """A line with or without (``smooth``) its points, points, or a band to ``upper``.  NaN breaks it."""

    name: str
    x: ArrayLike
    y: ArrayLike
    kind: Literal["line", "smooth", "points", "band"] = "line"
    colour: int = 0
    dash: str = "solid"
    """Of `DASHES`."""
    upper: ArrayLike | None = None
    in_legend: bool = True


@dataclass(frozen=True)
class Limit:
    """A value that is drawn across: of y, or of x."""

    name: str
    at: float
    axis: Literal["x", "y"] = "y"


@dataclass(frozen=True)
class Surface:
    """Values over a grid, coloured, with lines of equal value; NaN: none there.

    Attributes
    ----------
    z : (len(y), len(x)).
    levels : values at which lines are drawn.
    """

    x: Sequence[float]
    y: Sequence[float]
    z: NDArray[np.float64]
    levels: Sequence[float]
    unit: str = "ms"


@dataclass(frozen=True)
class Diagram:
    """One plot of curves, or of a surface."""

    title: str
    x_label: str
    y_label: str
    curves: list[Curve] = field(default_factory=list)
    limits: list[Limit] = field(default_factory=list)
    surface: Surface | None = None
    log_x: bool = False
    log_y: bool = False
    x_ticks: Sequence[float] | None = None
    y_ticks: Sequence[float] | None = None
    x_names: Sequence[str] | None = None
    """In place of numbers at ``x_ticks``."""
    y_range: tuple[float, float] | None = None
    equal: bool = False

    def plotly(self) -> Any:
        """For a page."""
        import plotly.graph_objects as go

        figure = go.Figure()
        if self.surface is not None:
            _plotly_surface(figure, self.surface)
        for curve in self.curves:
            _plotly_curve(figure, curve)
        for limit in self.limits:
            add = figure.add_hline if limit.axis == "y" else figure.add_vline
            add(
                limit.at,
                line={"color": INK, "dash": "dash", "width": 1},
                annotation={"text": limit.name, "font": {"size": 11}},
            )
        for axes, ticks, names, log in (
            (figure.update_xaxes, self.x_ticks, self.x_names, self.log_x),
            (figure.update_yaxes, self.y_ticks, None, self.log_y),
        ):
            if log:
                axes(type="log")
            if ticks is not None:
                axes(
                    tickmode="array", tickvals=list(ticks), ticktext=list(names or [f"{t:g}" for t in ticks])
                )
        if self.y_range is not None:
            figure.update_yaxes(range=np.log10(self.y_range).tolist() if self.log_y else list(self.y_range))
        if self.equal:
            figure.update_yaxes(scaleanchor="x")
        figure.update_layout(
            xaxis_title=self.x_label, yaxis_title=self.y_label, template="simple_white", height=460,
            margin={"l": 65, "r": 20, "t": 25, "b": 55}, legend={"font": {"size": 11}},
        )  # fmt: skip
        return figure.update_xaxes(showgrid=True, gridcolor=GRID).update_yaxes(showgrid=True, gridcolor=GRID)

    def draw(self, figure: Any, axes: Any) -> None:
        """On matplotlib's axes."""
        axes.set_title(self.title, fontsize=10)
        axes.set(xlabel=self.x_label, ylabel=self.y_label)
        if self.log_x:
            axes.set_xscale("log")
        if self.log_y:
            axes.set_yscale("log")
        if self.surface is not None:
            _draw_surface(figure, axes, self.surface)
        for curve in self.curves:
            _draw_curve(axes, curve)
        for limit in self.limits:
            _draw_limit(axes, limit)
        for axis, ticks, names in (
            (axes.xaxis, self.x_ticks, self.x_names),
            (axes.yaxis, self.y_ticks, None),
        ):
            if ticks is not None:
                axis.set_ticks(list(ticks), list(names or [f"{t:g}" for t in ticks]), minor=False)
                axis.set_ticks([], minor=True)
        if self.y_range is not None:
            axes.set_ylim(*self.y_range)
        if self.equal:
            axes.set_aspect("equal", adjustable="datalim")
        axes.grid(color=GRID)
        axes.set_axisbelow(True)
        if any(curve.in_legend for curve in self.curves):
            axes.legend(fontsize=7, framealpha=0.85)


def write_png(title: str, diagrams: Sequence[Diagram], path: Path) -> None:
    """All of them as one picture, two in a row.  Raises InputError where it cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = max(-(-len(diagrams) // 2), 1)
    figure = Figure(figsize=(14, 0.7 + 4.6 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    for number, diagram in enumerate(diagrams):
        diagram.draw(figure, figure.add_subplot(rows, 2, number + 1))
    with write_aside(path, ".png") as aside:
        figure.savefig(aside, format="png", dpi=100, metadata={"Software": None})


def _plotly_curve(figure: Any, curve: Curve) -> None:
    colour = COLOURS[curve.colour % len(COLOURS)]
    own = {"name": curve.name, "legendgroup": curve.name, "showlegend": curve.in_legend}
    x, y = np.asarray(curve.x), np.asarray(curve.y)
    if curve.kind == "band":
        upper = np.asarray(curve.upper)
        figure.add_scatter(
            x=np.concatenate([x, x[::-1]]), y=np.concatenate([upper, y[::-1]]), fill="toself", mode="none",
            fillcolor=_faint(colour), hoverinfo="skip", **own,
        )  # fmt: skip
        return
    mode = {"points": "markers", "smooth": "lines"}.get(curve.kind, "lines+markers")
    figure.add_scatter(
        x=x, y=y, mode=mode, line={"color": colour, "dash": curve.dash, "width": 1.8},
        marker={"color": colour, "size": 5}, **own,
    )  # fmt: skip


def _plotly_surface(figure: Any, surface: Surface) -> None:
    low, high = surface.levels[0], surface.levels[-1]
    figure.add_heatmap(
        x=[f"{x:g}" for x in surface.x], y=[f"{y:g}" for y in surface.y], z=surface.z,
        text=[["" if np.isnan(v) else f"{v:.3g}" for v in row] for row in surface.z],
        texttemplate="%{text}", textfont={"size": 10}, colorscale="YlGnBu", zmin=low, zmax=high,
        colorbar={"title": surface.unit}, hoverongaps=False,
    )  # fmt: skip
    figure.update_xaxes(type="category").update_yaxes(type="category")


def _faint(colour: str) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.13)"


def _draw_curve(axes: Any, curve: Curve) -> None:
    colour, label = COLOURS[curve.colour % len(COLOURS)], curve.name if curve.in_legend else None
    if curve.kind == "band":
        assert curve.upper is not None
        axes.fill_between(curve.x, curve.y, curve.upper, color=colour, alpha=0.13, linewidth=0, label=label)
        return
    line = "none" if curve.kind == "points" else DASHES[curve.dash]
    marker = "" if curve.kind == "smooth" else "."
    axes.plot(
        curve.x,
        curve.y,
        color=colour,
        marker=marker,
        markersize=5,
        linewidth=1.3,
        label=label,
        linestyle=line,
    )


def _draw_limit(axes: Any, limit: Limit) -> None:
    across = limit.axis == "y"
    (axes.axhline if across else axes.axvline)(limit.at, color=INK, linestyle="--", linewidth=0.8)
    axes.annotate(
        limit.name,
        (0.995, limit.at) if across else (limit.at, 0.99),
        xycoords=axes.get_yaxis_transform() if across else axes.get_xaxis_transform(),
        fontsize=7,
        ha="right",
        va="bottom" if across else "top",
    )


def _draw_surface(figure: Any, axes: Any, surface: Surface) -> None:
    """Cells with their values, at equal distances whatever the numbers are."""
    low, high = surface.levels[0], surface.levels[-1]
    image = axes.imshow(
        surface.z, origin="lower", aspect="auto", cmap="YlGnBu", vmin=low, vmax=high, interpolation="nearest"
    )
    figure.colorbar(image, ax=axes, label=surface.unit)
    for (row, column), value in np.ndenumerate(surface.z):
        if np.isfinite(value):
            dark = value > (low + high) / 2
            axes.text(
                column,
                row,
                f"{value:.3g}",
                ha="center",
                va="center",
                fontsize=7,
                color="white" if dark else INK,
            )
    axes.set_xticks(range(len(surface.x)), [f"{x:g}" for x in surface.x])
    axes.set_yticks(range(len(surface.y)), [f"{y:g}" for y in surface.y])
