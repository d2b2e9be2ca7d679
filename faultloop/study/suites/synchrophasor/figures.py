"""Figures of the synchrophasor suite: errors over frequency, and the response to a step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from faultloop.study.suites.synchrophasor.classes import WATCHED_S, PerformanceClass
from faultloop.study.suites.synchrophasor.measure import Errors, Subject, errors
from faultloop.study.suites.synchrophasor.signals import Tone, steady, step

FLOOR = 1e-6  # of the logarithmic axes
DOTTED: dict[str, Any] = {"line": {"dash": "dot", "width": 1.5, "color": "#666666"}, "opacity": 1.0}


def figures(tested: Sequence[Subject], kind: PerformanceClass) -> list[tuple[str, Any]]:
    """TVE over frequency, FE over an interfering tone, and a step of the angle."""
    return [
        ("TVE over the frequency; dotted: the limit", over_frequency(tested, kind)),
        (
            "Frequency error by a tone of 10 %; dotted: the limit, and the band's edges",
            over_tone(tested, kind),
        ),
        ("Angle step of 10 degrees", angle_step(tested)),
    ]


def figure(x: str, y: str, *, log: bool) -> Any:
    """An empty plotly figure."""
    import plotly.graph_objects as go

    layout = {"template": "simple_white", "height": 360, "margin": {"t": 20}}
    made = go.Figure(layout=layout)
    made.update_xaxes(title=x)
    made.update_yaxes(title=y, type="log" if log else "linear", exponentformat="power")
    return made


def worst(one: Subject, offset_hz: float, tone: Tone | None = None) -> Errors:
    """Of a steady signal."""
    return errors(one, steady(one.frequency_hz, offset_hz, tone=tone), one.settle_s + WATCHED_S)


def over_frequency(tested: Sequence[Subject], kind: PerformanceClass) -> Any:
    """Worst TVE at each frequency of the class's range."""
    made = figure("frequency [Hz]", "TVE [%]", log=True)
    offsets = np.linspace(-kind.span_hz, kind.span_hz, 21)
    for one in tested:
        tve = [max(float(worst(one, float(offset)).tve.max()), FLOOR) for offset in offsets]
        made.add_scatter(x=one.frequency_hz + offsets, y=tve, name=one.name, mode="lines")
    made.add_hline(kind.frequency[0], **DOTTED)
    return made


def over_tone(tested: Sequence[Subject], kind: PerformanceClass) -> Any:
    """Worst FE at f0 under a positive-sequence tone, 10 Hz to 2 f0; between the lines it is in band."""
    made = figure("tone [Hz]", "FE [Hz]", log=True)
    f0 = tested[0].frequency_hz
    tones = np.arange(10.0, 2.0 * f0 + 1.0, 2.5)
    for one in tested:
        fe = [max(float(worst(one, 0.0, Tone(float(hz), 0.1)).fe.max()), FLOOR) for hz in tones]
        made.add_scatter(x=tones, y=fe, name=one.name, mode="lines")
    if kind.interference is not None:
        made.add_hline(kind.interference[1], **DOTTED)
    for edge in (0.5 * f0, 1.5 * f0):
        made.add_vline(edge, **DOTTED)
    return made


def angle_step(tested: Sequence[Subject]) -> Any:
    """The positive sequence's angle about a step."""
    made = figure("time from the step [ms]", "angle [deg]", log=False)
    for one in tested:
        at = one.settle_s + 0.3
        found = errors(one, step(one.frequency_hz, at, angle=np.radians(10.0)), at + 0.3)
        near = np.abs(found.t - at) < 0.1
        ms = 1000.0 * (found.t[near] - at)
        made.add_scatter(
            x=ms[::4], y=np.degrees(np.angle(found.phasor[near]))[::4], name=one.name, mode="lines"
        )
    return made
