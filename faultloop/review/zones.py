"""The zones of a relay's settings on the R-X plane: what they come to before any fault."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from faultloop.io.output_file import write_aside
from faultloop.relay import RelaySettings
from faultloop.relay.functions.pdis import polygons
from faultloop.review.impedance_plane import FAINT, INK

COLOURS = ("#26436B", "#0072B2", "#009E73", "#8A6D1D", "#CC79A7", "#D55E00")
MEANT = "#D55E00"


@dataclass(frozen=True)
class Outline:
    """A shape to be drawn beside the zones: corners in the settings' own ohms."""

    name: str
    loops: Literal["ground", "phase", "all"]
    corners: Sequence[complex]


def write_zones(
    settings: RelaySettings, path: str | Path, *, title: str = "", outlines: Sequence[Outline] = ()
) -> Path:
    """Writes a picture of the zones of ground and of phase loops, side by side; ``outlines`` are dashed.

    In the settings' own ohms.  A mho is drawn self-polarized, a quadrilateral without load flow.  Raises
    InputError where ``path`` does not end in ``.png`` or cannot be written.
    """
    from matplotlib import rc_context

    from faultloop.review.plot import STYLE

    with write_aside(path, ".png") as aside, rc_context(STYLE):
        figure = draw_zones(settings, title, outlines)
        figure.savefig(aside, format="png", facecolor="white", metadata={"Software": None})
    return Path(path)


def draw_zones(settings: RelaySettings, title: str = "", outlines: Sequence[Outline] = ()) -> Figure:
    """The figure."""
    figure = Figure(figsize=(11.0, 5.6), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title, x=0.02, ha="left", weight="bold", size=13)
    both = figure.subplots(1, 2, sharex=True, sharey=True)
    for place, (loops, axes) in enumerate(zip(("ground", "phase"), both, strict=True)):
        axes.set_title(f"{loops} loops", loc="left", size=11, color=FAINT)
        for number, zone in enumerate(settings.pdis):
            points = polygons(settings, zone)[place] / settings.ohm_ratio
            if len(points):
                name = f"PDIS{number + 1}: zone {zone.zone}, {zone.delay_ms:g} ms"
                _closed(axes, points, name, COLOURS[(zone.zone - 1) % len(COLOURS)], number)
        for outline in outlines:
            if outline.loops in (loops, "all"):
                corners = np.array([*outline.corners, outline.corners[0]], np.complex128)
                axes.plot(corners.real, corners.imag, color=MEANT, lw=1.1, ls=(0, (4, 3)), zorder=4)
        _frame(axes, settings, bool(outlines))
    named = {
        text: line for axes in both for line, text in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend([*named.values()], [*named], loc="outside lower left", ncols=4, fontsize=8.5, frameon=False)
    return figure


def _closed(axes: Axes, points: NDArray[np.float64], name: str, colour: str, order: int) -> None:
    axes.fill(*points.T, fc=colour, alpha=0.06, lw=0)
    axes.plot(*points.T, color=colour, lw=1.6, label=name, zorder=3 + 0.01 * order)


def _frame(axes: Axes, settings: RelaySettings, outlined: bool) -> None:
    z1 = settings.z1_ohm / settings.ohm_ratio
    axes.plot([0, z1.real], [0, z1.imag], color=INK, lw=2.4, marker="o", ms=4, label="line", zorder=5)
    if outlined:
        axes.plot([], [], color=MEANT, lw=1.1, ls=(0, (4, 3)), label="as the file draws it")
    axes.axhline(0, color="#B5B9BF", lw=0.9, zorder=1)
    axes.axvline(0, color="#B5B9BF", lw=0.9, zorder=1)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel(f"R [Ω {settings.relay.ohms}]")
    axes.set_ylabel(f"X [Ω {settings.relay.ohms}]")
