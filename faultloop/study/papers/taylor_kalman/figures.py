"""Seed paper 002's figures, redrawn: four quantities over the time, and the ROCOF over the sampling rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.estimators import FREQUENCY, ROCOF
from faultloop.study.suites.synchrophasor.signals import Array, Wave

QUANTITIES = ("RMS [V]", "phase [deg]", "frequency [Hz]", "ROCOF [Hz/s]")
COLOURS = ("#1f6fb2", "#d98c1f", "#2a9d5c", "#8a4fb0", "#b23a48")
SETTLED_S = 0.06
"""Estimates before this are the filter's start: they would set the axes."""


def four(found: Mapping[str, tuple[Wave, Array, NDArray[np.complex128], Array]]) -> Any:
    """RMS, phase, frequency and ROCOF; the truth is dotted.

    Parameters
    ----------
    found : for each name the wave, the times (n,), the phasor (n,) and the rows (n, 14).
    """
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=2, cols=2, subplot_titles=QUANTITIES, vertical_spacing=0.12)
    for colour, (name, (wave, t, phasor, rows)) in zip(COLOURS, found.items(), strict=False):
        true = wave.phasor(t)
        pairs = (
            (np.abs(phasor), np.abs(true)),
            (degrees(phasor), degrees(true)),
            (rows[:, FREQUENCY], wave.frequency(t)),
            (rows[:, ROCOF], wave.rocof(t)),
        )
        shown = t >= SETTLED_S
        for place, (estimate, truth) in enumerate(pairs):
            at = {"row": place // 2 + 1, "col": place % 2 + 1}
            line = {"color": colour, "width": 1.5}
            figure.add_scatter(
                x=t[shown],
                y=estimate[shown],
                name=name,
                legendgroup=name,
                showlegend=place == 0,
                line=line,
                **at,
            )
            dotted = line | {"dash": "dot", "width": 1.0}
            figure.add_scatter(
                x=t[shown], y=truth[shown], name=f"{name}, true", showlegend=False, line=dotted, **at
            )
    clip(figure)
    figure.update_xaxes(title_text="time [s]", row=2)
    return figure.update_layout(height=640, template="plotly_white", margin={"t": 40})


def clip(figure: Any) -> None:
    """Frequency and ROCOF of a step leave the figure: what is settled could not be seen beside them."""
    figure.update_yaxes(range=(47.5, 51.0), row=2, col=1)
    figure.update_yaxes(range=(-4.0, 4.0), row=2, col=2)


def degrees(phasor: NDArray[np.complex128]) -> Array:
    """Its angle, without jumps [deg]."""
    return np.degrees(np.unwrap(np.angle(phasor)))


def over_rate(rates: Sequence[int], lines: Mapping[str, Sequence[float]]) -> Any:
    """Errors of the ROCOF over the sampling rate."""
    import plotly.graph_objects as go

    figure = go.Figure(layout={"template": "plotly_white", "height": 360, "margin": {"t": 20}})
    for colour, (name, errors) in zip(COLOURS, lines.items(), strict=False):
        figure.add_scatter(x=list(rates), y=list(errors), name=name, line={"color": colour})
    figure.update_xaxes(title="sampling rate [Hz]", type="log", tickvals=list(rates))
    return figure.update_yaxes(title="ROCOF error [Hz/s]", type="log", exponentformat="power")
