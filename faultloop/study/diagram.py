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
HEIGHT, EQUAL_HEIGHT = 460, 640
MOST_NAMES = 16
"""Along an axis of a picture."""
MOST_SHAPES = 1500
"""Points of a plot that a browser draws one by one; more are drawn by its graphics processor."""


@dataclass(frozen=True)
class Curve:
    """A line with or without (``smooth``) its points, steps, points, a band to ``upper``.  NaN breaks it."""

    name: str
    x: ArrayLike
    y: ArrayLike
    kind: Literal["line", "smooth", "steps", "points", "band"] = "line"
    colour: int | str = 0
    """Of `COLOURS`, or one of its own."""
    dash: str = "solid"
    """Of `DASHES`."""
    upper: ArrayLike | None = None
    in_legend: bool = True
    group: str | None = None
    """Those of one group are shown and hidden together, by the entry of the one that is in the legend."""
    told: tuple[str, ArrayLike] | None = None
    """What each point is the value of, under the mouse: ``("case", numbers)``."""

    @property
    def ink(self) -> str:
        return self.colour if isinstance(self.colour, str) else COLOURS[self.colour % len(COLOURS)]


@dataclass(frozen=True)
class Limit:
    """A value that is drawn across: of y, or of x."""

    name: str
    at: float
    axis: Literal["x", "y"] = "y"


@dataclass(frozen=True)
class Surface:
    """Values over a grid of numbers or names, coloured; NaN: none there.

    Attributes
    ----------
    z : (len(y), len(x)).
    levels : the first and the last are the ends of the colours.
    written : in each cell; its value where not given.
    """

    x: Sequence[float | str]
    y: Sequence[float | str]
    z: NDArray[np.float64]
    levels: Sequence[float]
    unit: str = "ms"
    written: Sequence[Sequence[str]] | None = None
    colours: str = "YlGnBu"
    """A scale that plotly and matplotlib both have."""

    def texts(self) -> list[list[str]]:
        """What stands in each cell."""
        if self.written is not None:
            return [list(row) for row in self.written]
        return [["" if np.isnan(value) else f"{value:.3g}" for value in row] for row in self.z]


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
    y_range: tuple[float, float | None] | None = None
    """None: as far as it goes."""
    equal: bool = False
    wide: bool = False
    """As wide as a page is, on one where others stand side by side."""
    note: str = ""
    """What is said to it on a page."""

    def plotly(self) -> Any:
        """For a page."""
        import plotly.graph_objects as go

        figure = go.Figure()
        if self.surface is not None:
            _plotly_surface(figure, self.surface)
        many = sum(np.size(curve.x) for curve in self.curves if curve.kind == "points") > MOST_SHAPES
        for curve in self.curves:
            _plotly_curve(figure, curve, many)
        for limit in self.limits:
            _plotly_limit(figure, limit, self.log_y if limit.axis == "y" else self.log_x)
        for axes, ticks, names, log in (
            (figure.update_xaxes, self.x_ticks, self.x_names, self.log_x),
            (figure.update_yaxes, self.y_ticks, None, self.log_y),
        ):
            if log:
                axes(type="log", exponentformat="power")
            if ticks is not None:
                axes(
                    tickmode="array", tickvals=list(ticks), ticktext=list(names or [f"{t:g}" for t in ticks])
                )
        if self.y_range is not None:
            ends = [
                None if end is None else float(np.log10(end)) if self.log_y else end for end in self.y_range
            ]
            figure.update_yaxes(range=ends)
        if self.equal:
            figure.update_xaxes(constrain="domain")
            figure.update_yaxes(scaleanchor="x", constrain="domain")
        figure.update_layout(
            xaxis_title=self.x_label, yaxis_title=self.y_label, template="simple_white", hovermode="closest",
            height=EQUAL_HEIGHT if self.equal else HEIGHT, legend={"font": {"size": 11}},
            margin={"l": 65, "r": 20, "t": 25, "b": 55},
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
        if self.surface is None:  # over cells it would hide what is written in them
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


def _plotly_curve(figure: Any, curve: Curve, many: bool) -> None:
    group = curve.group or curve.name
    own: dict[str, Any] = {"name": curve.name, "legendgroup": group, "showlegend": curve.in_legend}
    colour, x, y = curve.ink, np.asarray(curve.x), np.asarray(curve.y)
    if curve.kind == "band":
        upper = np.asarray(curve.upper)
        figure.add_scatter(
            x=np.concatenate([x, x[::-1]]), y=np.concatenate([upper, y[::-1]]), fill="toself", mode="none",
            fillcolor=_faint(colour), hoverinfo="skip", **own,
        )  # fmt: skip
        return
    said = "%{x:.4g}, %{y:.4g}<extra></extra>"
    if curve.told is not None:
        what, values = curve.told
        own |= {"customdata": np.asarray(values), "hovertemplate": f"{what} %{{customdata}}: {said}"}
    if curve.kind == "points":
        add = figure.add_scattergl if many else figure.add_scatter
        add(x=x, y=y, mode="markers", marker={"color": colour, "size": 5, "opacity": 0.7}, **own)
        return
    line = {"color": colour, "dash": curve.dash, "width": 1.8}
    line |= {"shape": "hv"} if curve.kind == "steps" else {}
    mode = "lines+markers" if curve.kind == "line" else "lines"
    figure.add_scatter(x=x, y=y, mode=mode, line=line, marker={"color": colour, "size": 5}, **own)


def _plotly_limit(figure: Any, limit: Limit, log: bool) -> None:
    """With its name at the end; a note's place is a logarithm on such an axis, a line's is not."""
    figure.add_shape(
        type="line", line={"color": INK, "dash": "dash", "width": 1},
        **({"xref": "x domain", "x0": 0, "x1": 1, "y0": limit.at, "y1": limit.at} if limit.axis == "y"
           else {"yref": "y domain", "y0": 0, "y1": 1, "x0": limit.at, "x1": limit.at}),
    )  # fmt: skip
    at = float(np.log10(limit.at)) if log else limit.at
    figure.add_annotation(
        text=limit.name, font={"size": 11}, showarrow=False, xanchor="right",
        **({"xref": "x domain", "x": 1, "y": at, "yanchor": "bottom"} if limit.axis == "y"
           else {"yref": "y domain", "y": 0, "x": at, "yanchor": "bottom"}),
    )  # fmt: skip


def _plotly_surface(figure: Any, surface: Surface) -> None:
    low, high = surface.levels[0], surface.levels[-1]
    figure.add_heatmap(
        x=_names(surface.x), y=_names(surface.y), z=surface.z, text=surface.texts(), texttemplate="%{text}",
        textfont={"size": 10}, colorscale=surface.colours, zmin=low, zmax=high, xgap=1, ygap=1,
        colorbar={"title": surface.unit, "thickness": 12}, hoverongaps=False,
        hovertemplate=f"%{{x}}, %{{y}}: %{{z:.3g}} {surface.unit}<extra></extra>",
    )  # fmt: skip
    figure.update_xaxes(type="category").update_yaxes(type="category")


def _names(values: Sequence[float | str]) -> list[str]:
    return [value if isinstance(value, str) else f"{value:g}" for value in values]


def _faint(colour: str) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.13)"


def _draw_curve(axes: Any, curve: Curve) -> None:
    colour, label = curve.ink, curve.name if curve.in_legend else None
    if curve.kind == "band":
        assert curve.upper is not None
        axes.fill_between(curve.x, curve.y, curve.upper, color=colour, alpha=0.13, linewidth=0, label=label)
        return
    line = "none" if curve.kind == "points" else DASHES[curve.dash]
    axes.plot(
        curve.x, curve.y, color=colour, label=label, linestyle=line, linewidth=1.3,
        marker="" if curve.kind in ("smooth", "steps") else ".", markersize=5,
        drawstyle="steps-post" if curve.kind == "steps" else "default",
    )  # fmt: skip


def _draw_limit(axes: Any, limit: Limit) -> None:
    across = limit.axis == "y"
    (axes.axhline if across else axes.axvline)(limit.at, color=INK, linestyle="--", linewidth=0.8)
    axes.annotate(
        limit.name,
        (0.995, limit.at) if across else (limit.at, 0.01),
        xycoords=axes.get_yaxis_transform() if across else axes.get_xaxis_transform(),
        fontsize=7,
        ha="right",
        va="bottom",
    )


def _draw_surface(figure: Any, axes: Any, surface: Surface) -> None:
    """Cells with their values, at equal distances whatever the numbers are."""
    low, high = surface.levels[0], surface.levels[-1]
    image = axes.imshow(
        surface.z, origin="lower", aspect="auto", cmap=surface.colours, vmin=low, vmax=high,
        interpolation="nearest",
    )  # fmt: skip
    figure.colorbar(image, ax=axes, label=surface.unit)
    texts = surface.texts()
    for (row, column), value in np.ndenumerate(surface.z):
        if np.isfinite(value) and texts[row][column]:
            colour = "white" if value > (low + high) / 2 else INK
            axes.text(column, row, texts[row][column], ha="center", va="center", fontsize=7, color=colour)
    for names, axis in ((_names(surface.x), axes.xaxis), (_names(surface.y), axes.yaxis)):
        step = -(-len(names) // MOST_NAMES)
        axis.set_ticks(range(0, len(names), step), names[::step])
