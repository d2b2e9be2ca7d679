"""The R-X plane of a relay: zones, line, and the way of the six loops into the fault."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from faultloop.io.messages import LOOPS
from faultloop.review.facts import FaultedLoop, Impedance, Summary
from faultloop.review.view import LOOP_COLOURS, RelayView, Zones, extent_ohm, locus_ms, zone_shapes

Shapes = Mapping[str, NDArray[np.float64]]
INK, FAINT, ZONE = "#222222", "#70757C", "#26436B"
DOT_MS = 5.0
PAPER = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.85}


def impedance_plane(
    axes: Axes, known: tuple[complex | None, Zones, Shapes], summary: Summary, view: RelayView
) -> None:
    """Draws it, from inception to the first pole's opening; ``known``: the line's z1 [ohm], the zones as set,
    and as they are at the instant of the star (empty where that is not known)."""
    z1, zones, now = known
    loop = view.facts.loop
    shapes = zone_shapes(zones, loop)
    _frame(axes, extent_ohm(shapes, z1, view))
    for shade, (zone, polygon) in enumerate(shapes.items()):
        _zone(axes, (polygon, now.get(zone)), max(1 - 0.2 * shade, 0.35))
    if now and loop and view.facts.fault:
        text = f"zones at {view.facts.fault.ms:.0f} ms; dashed: as set"
        axes.text(0.985, 0.05, text, transform=axes.transAxes, size=8, color=FAINT, ha="right", bbox=PAPER)
    if z1 is not None:
        axes.plot([0, z1.real], [0, z1.imag], color=INK, lw=2.2, marker="o", ms=4, zorder=3)
    way = _loci(axes, view, locus_ms(summary, view), loop.loop if loop else None)
    if loop:
        _final_point(axes, loop)
    _load(axes, view.facts.load_ohm)
    axes.apply_aspect()
    busy = np.concatenate([axes.transData.transform(_strewn(one)) for one in (way, np.array([0, z1 or 0]))])
    if z1 is not None:
        _name_line(axes, z1, busy)
    _name_zones(axes, {zone: now.get(zone, polygon) for zone, polygon in shapes.items()}, busy)


def _frame(axes: Axes, extent: NDArray[np.float64]) -> None:
    """Limits around the extent, an ohm equally long both ways."""
    place, size = axes.get_position(), axes.get_figure(root=True).get_size_inches()  # type: ignore[union-attr]
    box = np.array([place.width, place.height]) * size
    span = np.maximum(1.26 * (extent[1] - extent[0]), 1.0)
    span = box * (span / box).max()
    low = extent.mean(axis=0) - span / 2
    axes.set_xlim(low[0], low[0] + span[0])
    axes.set_ylim(low[1], low[1] + span[1])
    axes.set_aspect("equal", adjustable="box")
    axes.axhline(0, color="#B5B9BF", lw=0.9, zorder=1)
    axes.axvline(0, color="#B5B9BF", lw=0.9, zorder=1)
    axes.set_xlabel("R [Ω primary]")
    axes.set_ylabel("X [Ω primary]")


def _zone(axes: Axes, shape: tuple[NDArray[np.float64], NDArray[np.float64] | None], alpha: float) -> None:
    polygon, now = shape
    if now is None:
        axes.fill(*polygon.T, fc=ZONE, alpha=0.05, lw=0)
    else:
        axes.plot(*now.T, color=ZONE, lw=1.4, alpha=alpha)
    width, shade, line = (1.4, alpha, "-") if now is None else (0.9, 0.5, (0, (3, 3)))
    axes.plot(*polygon.T, color=ZONE, lw=width, alpha=shade, ls=line)


def _name_line(axes: Axes, z1: complex, busy: NDArray[np.float64]) -> None:
    """At its end, on the side on which less is."""
    near = busy - axes.transData.transform((z1.real, z1.imag))
    beside = np.abs(near[:, 1]) < 8
    left = (beside & (near[:, 0] < -4) & (near[:, 0] > -40)).sum()
    right = (beside & (near[:, 0] > 4) & (near[:, 0] < 40)).sum()
    side = -1 if right > left else 1
    axes.annotate(
        "line", (z1.real, z1.imag), (7 * side, 1), textcoords="offset points", size=8.5, va="center",
        ha="right" if side < 0 else "left",
    )  # fmt: skip


def _name_zones(axes: Axes, shapes: Shapes, busy: NDArray[np.float64]) -> None:
    """Each outside its outline, where it touches neither what is busy (n, 2) [pixels] nor another text; by
    preference on the shoulder away from a line.  Where it has no such place in the picture it has none."""
    point = axes.get_figure(root=True).dpi / 72  # type: ignore[union-attr]
    low, high = axes.transAxes.transform([(0, 0), (1, 1)])
    boxes = np.array([text.get_window_extent().get_points() for text in axes.texts]).reshape(-1, 2, 2)
    for zone, polygon in shapes.items():
        outline = axes.transData.transform(_strewn(polygon[:, 0] + 1j * polygon[:, 1]))
        side = 1 if polygon[:, 1].mean() >= 0 else -1
        half = np.array([0.32 * len(zone) * 8.5 + 1, 5.5]) * point
        away = outline - outline.mean(axis=0)
        away /= np.linalg.norm(away, axis=1, keepdims=True) + 1e-9
        middles = outline + away * (half + 2 * point)
        least, most = middles - half, middles + half
        on = ((least[:, None] < boxes[:, 1]) & (most[:, None] > boxes[:, 0])).all(axis=2).sum(axis=1)
        near = (np.abs(middles[:, None] - busy) < half + 2 * point).all(axis=2).sum(axis=1)
        cut = ((least < low) | (most > high)).any(axis=1)
        best = int(np.argmin(near + 1000.0 * on + 10_000.0 * cut - 3 * side * (away @ (-0.75, 0.65))))
        if not cut[best]:
            at = axes.transData.inverted().transform(middles[best])
            axes.annotate(zone, tuple(at), size=8.5, color=ZONE, ha="center", va="center")
            boxes = np.concatenate([boxes, [[least[best], most[best]]]])


def _strewn(way: NDArray[np.complex128]) -> NDArray[np.float64]:
    """(n, 2) points along a way of many or few."""
    way = way[np.isfinite(way)]
    if len(way) < 2:
        return np.column_stack([way.real, way.imag])
    at = np.linspace(0, len(way) - 1, 40 * min(len(way), 50))
    place = np.arange(len(way))
    return np.column_stack([np.interp(at, place, way.real), np.interp(at, place, way.imag)])


def _loci(
    axes: Axes, view: RelayView, span: tuple[float, float], faulted: str | None
) -> NDArray[np.complex128]:
    """Draws all loops' ways; returns the faulted one's."""
    inside = np.flatnonzero((view.ms >= span[0]) & (view.ms <= span[1]))
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    for k, name in enumerate(LOOPS):
        z = view.rows.loops[inside, k]
        main = name == faulted
        colour = LOOP_COLOURS[name]
        axes.plot(
            z.real,
            z.imag,
            color=colour,
            lw=2.2 if main else 0.9,
            alpha=1 if main else 0.55,
            zorder=2 + 2 * main,
        )
        last = z[np.isfinite(z)][-1:]
        if main:
            dots = z[
                np.unique(
                    np.searchsorted(view.ms[inside], np.arange(0, span[1], DOT_MS)).clip(max=len(z) - 1)
                )
            ]
            axes.plot(dots.real, dots.imag, ls="", marker="o", ms=4.2, mfc="white", mec=colour, zorder=5)
        elif (
            len(last)
            and x0 < last[0].real < x1 - 0.1 * (x1 - x0)
            and y0 + 0.1 * (y1 - y0) < last[0].imag < y1
        ):
            at = (last[0].real, last[0].imag)
            axes.annotate(name, at, (4, 4), textcoords="offset points", size=8, color=colour)
    if faulted:
        text = f"{faulted}: a dot every {DOT_MS:g} ms"
        axes.text(0.985, 0.015, text, transform=axes.transAxes, size=8, color=FAINT, ha="right", bbox=PAPER)
        return view.rows.loops[inside, LOOPS.index(faulted)]
    return np.zeros(0, np.complex128)


def _final_point(axes: Axes, loop: FaultedLoop) -> None:
    percent = loop.percent_of_line
    text = loop.loop + ("" if percent is None else f"  {percent:.1f} %")
    at = (loop.r_ohm, loop.x_ohm)
    axes.plot(*at, marker="*", ms=15, mfc="#FFD23F", mec=INK, zorder=6)
    axes.annotate(
        text, at, (-12, 0), textcoords="offset points", ha="right", va="center", weight="bold", size=10,
        zorder=6, bbox={"boxstyle": "square,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
    )  # fmt: skip


def _load(axes: Axes, load: Impedance | None) -> None:
    """The load before the fault, or an arrow towards it where it lies outside."""
    if load is None:
        return
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    r, x = load.r_ohm, load.x_ohm
    text = f"load {load.magnitude_ohm:.0f} Ω"
    if x0 < r < x1 and y0 < x < y1:
        axes.plot(r, x, marker="s", ms=6, mfc="white", mec=INK, zorder=5)
        axes.annotate(text, (r, x), (7, 5), textcoords="offset points", size=8.5)
        return
    edges = [(x1 if r > 0 else x0) / r] if r else []
    edges += [(y1 if x > 0 else y0) / x] if x else []
    end = 0.985 * min(edges)  # as far along the ray from the origin as the frame lets it
    tip, tail = (end * r, end * x), (0.84 * end * r, 0.84 * end * x)
    style = {"arrowstyle": "-|>", "color": INK, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tip, tail, arrowprops=style, zorder=6)
    side = "right" if r > 0 else "left"
    axes.annotate(text, tip, (0, 7), textcoords="offset points", size=8.5, ha=side)
