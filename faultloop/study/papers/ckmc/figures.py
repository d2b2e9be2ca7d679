"""Seed paper 003's figures, redrawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.study.papers.ckmc.cases import Errors, Plan

STATES = ("delta [rad]", "omega - w0 [rad/s]", "eq [pu]", "ed [pu]")
COLOURS = ("#888888", "#d98c1f", "#1f6fb2")
UNTIL_S = 5.0


def swing(what: Plan) -> Any:
    """Angle of every machine to that at bus 39."""
    import plotly.graph_objects as go

    figure = go.Figure()
    delta = what.swing.states[:, :, 0]
    angle = np.rad2deg(delta - delta[:, -1:])
    for k, bus in enumerate(what.system.machine_bus):
        figure.add_scatter(x=light(what.swing.t), y=light(angle[:, k]), name=f"bus {what.system.buses[bus]}")
    return figure.update_layout(
        xaxis_title="time [s]", yaxis_title="angle to bus 39 [deg]", height=420, template="plotly_white"
    )


def states(what: Plan, errors: Mapping[str, Errors], names: Sequence[str]) -> Any:
    """The four states of the first run: true and estimated."""
    lines = [("true", "#000000", errors[names[0]].truth)]
    lines += [(n, c, errors[n].estimate) for n, c in zip(names, COLOURS, strict=True)]
    return _four(what, lines, "linear")


def errors(what: Plan, errors: Mapping[str, Errors], names: Sequence[str]) -> Any:
    """Mean absolute error over the runs, frame by frame."""
    lines = [(n, c, errors[n].by_frame[1:]) for n, c in zip(names, COLOURS, strict=True)]
    return _four(what, lines, "log")


def light(values: NDArray[np.float64] | Sequence[float]) -> list[float]:
    """Five digits, which halves the page."""
    return [float(f"{v:.5g}") for v in values]


def _four(what: Plan, lines: Sequence[tuple[str, str, NDArray[np.float64]]], scale: str) -> Any:
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=4, shared_xaxes=True, vertical_spacing=0.05, subplot_titles=STATES)
    shown = int(np.searchsorted(what.swing.t, UNTIL_S))
    for name, colour, values in lines:
        t = what.swing.t[-len(values) :][:shown]
        for i in range(4):
            figure.add_scatter(
                x=light(t),
                y=light(values[:shown, i]),
                name=name,
                legendgroup=name,
                showlegend=i == 0,
                line={
                    "color": colour,
                    "width": 3.0 if name == "CKF" else 1.2,
                },  # it is often under the others
                row=i + 1,
                col=1,
            )
    figure.update_xaxes(title_text="time [s]", row=4).update_yaxes(type=scale, exponentformat="power")
    return figure.update_layout(height=860, template="plotly_white")


def kernels(lines: Mapping[str, Mapping[float, float]]) -> Any:
    """J over the Cauchy kernel's bandwidth; a Gaussian one stands at that of its curvature."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for place, (name, line) in enumerate(lines.items()):
        style = {"color": ("#1f6fb2", "#d98c1f")[place % 2], "dash": ("solid", "dot")[place // 2 % 2]}
        figure.add_scatter(x=list(line), y=light(list(line.values())), name=name, line=style)
    figure.update_xaxes(title="bandwidth", type="log", tickvals=[5, 10, 20, 50, 100, 200])
    title = "J; above 1 the track is lost"
    figure.update_yaxes(title=title, type="log", dtick=1, exponentformat="power")
    return figure.update_layout(height=420, template="plotly_white")
