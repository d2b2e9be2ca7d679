"""Seed paper 002's figures, redrawn: four quantities and their errors over the time, and the ROCOF over the
sampling rate."""

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


Track = tuple[Wave, Array, NDArray[np.complex128], Array]
"""A wave, the times (n,), the phasor (n,) and the rows (n, 14)."""


def quantities(track: Track) -> list[tuple[Array, Array]]:
    """RMS, phase, frequency and ROCOF: estimated and true."""
    wave, t, phasor, rows = track
    true = wave.phasor(t)
    return [
        (np.abs(phasor), np.abs(true)),
        (degrees(phasor), degrees(true)),
        (rows[:, FREQUENCY], wave.frequency(t)),
        (rows[:, ROCOF], wave.rocof(t)),
    ]


def four(found: Mapping[str, Track]) -> Any:
    """RMS, phase, frequency and ROCOF over the time; the truth is dotted.  Nothing is clipped."""
    figure = _panels(QUANTITIES)
    for colour, (name, track) in zip(COLOURS, found.items(), strict=False):
        for place, (estimate, truth) in enumerate(quantities(track)):
            _line(figure, place, track[1], (estimate, name), {"color": colour, "width": 1.5})
            _line(figure, place, track[1], (truth, ""), {"color": colour, "width": 1.0, "dash": "dot"})
    return figure


def errors(found: Mapping[str, Track]) -> Any:
    """Their errors on a logarithmic scale, so that those of a millihertz are seen beside a step's."""
    figure = _panels([f"error of {quantity}" for quantity in QUANTITIES])
    for colour, (name, track) in zip(COLOURS, found.items(), strict=False):
        for place, (estimate, truth) in enumerate(quantities(track)):
            error = np.maximum(np.abs(estimate - truth), 1e-12)
            _line(figure, place, track[1], (error, name), {"color": colour, "width": 1.5})
    return figure.update_yaxes(type="log", exponentformat="power", tickformat="")


def both_forms(found: Mapping[str, tuple[Array, Array]]) -> Any:
    """Errors of the frequency [Hz] over the time [s], by the form, the window and the start."""
    import plotly.graph_objects as go

    figure = go.Figure(layout={"template": "plotly_white", "height": 420, "margin": {"t": 20}})
    for place, (name, (t, error)) in enumerate(found.items()):
        style = {"color": COLOURS[place // 2 % 4], "dash": "dot" if "section" in name else "solid"}
        shown = t >= SETTLED_S
        figure.add_scatter(x=t[shown], y=np.maximum(error[shown], 1e-12), name=name, line=style)
    figure.update_xaxes(title="time [s]")
    return figure.update_yaxes(title="error of the frequency [Hz]", type="log", exponentformat="power")


def _panels(titles: Sequence[str]) -> Any:
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=4, shared_xaxes=True, subplot_titles=titles, vertical_spacing=0.05)
    figure.update_xaxes(title_text="time [s]", row=4)
    figure.update_yaxes(tickformat=".3~f", row=1)
    return figure.update_layout(height=860, template="plotly_white", margin={"t": 40})


def _line(figure: Any, place: int, t: Array, line: tuple[Array, str], style: Mapping[str, object]) -> None:
    """A line of a panel, named once; without a name it goes with the last one."""
    values, name = line
    shown = t >= SETTLED_S
    figure.add_scatter(
        x=t[shown],
        y=values[shown],
        name=name or "true",
        legendgroup=name or None,
        showlegend=bool(name) and place == 0,
        line=style,
        row=place + 1,
        col=1,
    )


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
