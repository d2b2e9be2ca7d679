"""Seed paper 001's figures, redrawn: one noise seed, as in the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from faultloop.study.papers.mstukf.cases import (
    FADING,
    ORDERS,
    PHASE,
    SAMPLING_HZ,
    Array,
    Reading,
    Setting,
    noisy,
    track,
)

SEED = 0
COLOURS = ("#d98c1f", "#1f6fb2", "#2a9d5c")


def sag(settings: Mapping[str, Setting]) -> list[tuple[str, Any]]:
    """Figures 1 and 2."""
    samples, tracks = run("sag", settings)
    shown = slice(600, 1600)
    k = np.arange(1, len(samples) + 1)
    turned = 2 * np.pi * 50 * k / SAMPLING_HZ
    phase = {
        name: np.degrees(np.angle(np.exp(1j * (found[:, PHASE] - turned)))) for name, found in tracks.items()
    }
    magnitude = {name: found[:, 0] for name, found in tracks.items()}
    return [
        ("Figure 1: sag, and fading factors", signal_and_factors(samples, tracks, shown)),
        (
            "Figure 2: magnitude and phase of the fundamental",
            stack([("magnitude [pu]", magnitude, "linear"), ("phase [deg]", phase, "linear")], shown),
        ),
    ]


def readings(settings: Mapping[str, tuple[Setting, Reading]]) -> list[tuple[str, Any]]:
    """The sag by some readings of its text: lambda and magnitude of one filter."""
    tracks = {
        title: track(setting, noisy("sag", SEED, reading)) for title, (setting, reading) in settings.items()
    }
    panels = [
        ("lambda", factors(tracks), "log"),
        ("magnitude [pu]", {title: found[:, 0] for title, found in tracks.items()}, "linear"),
    ]
    return [("The sag by three readings: lambda and magnitude of MSTUKF", stack(panels, slice(600, 1600)))]


def impulse(settings: Mapping[str, Setting]) -> list[tuple[str, Any]]:
    """Figure 3."""
    samples, tracks = run("impulse", settings)
    magnitude = {name: found[:, 0] for name, found in tracks.items()}
    panels = [
        ("signal [pu]", {"signal": samples}, "linear"),
        ("lambda", factors(tracks), "log"),
        ("magnitude [pu]", magnitude, "linear"),
    ]
    return [
        ("Figure 3: impulse, fading factors, magnitude of the fundamental", stack(panels, slice(700, 1000)))
    ]


def harmonics(settings: Mapping[str, Setting]) -> list[tuple[str, Any]]:
    """Figures 4 and 5."""
    samples, tracks = run("harmonics", settings)
    shown = slice(1000, 2000)
    panels = [
        (
            f"{order}{'rd' if order == 3 else 'th'} harmonic: magnitude [pu]",
            {name: found[:, i] for name, found in tracks.items()},
            "linear",
        )
        for i, order in enumerate(ORDERS, start=1)
    ]
    return [
        ("Figure 4: harmonics, and fading factors", signal_and_factors(samples, tracks, shown)),
        ("Figure 5: magnitudes of the harmonics 3, 5, 7", stack(panels, shown)),
    ]


def run(case: str, settings: Mapping[str, Setting]) -> tuple[Array, dict[str, Array]]:
    """The samples, and each filter's track."""
    samples = noisy(case, SEED)
    return samples, {name: track(setting, samples) for name, setting in settings.items()}


def signal_and_factors(samples: Array, tracks: Mapping[str, Array], shown: slice) -> Any:
    """The waveform over the fading factors."""
    panels = [("signal [pu]", {"signal": samples}, "linear"), ("lambda", factors(tracks), "log")]
    return stack(panels, shown)


def factors(tracks: Mapping[str, Array]) -> dict[str, Array]:
    """lambda of each filter."""
    return {name: found[:, FADING] for name, found in tracks.items()}


def stack(panels: Sequence[tuple[str, Mapping[str, Array], str]], shown: slice) -> Any:
    """Panels (title, lines, scale) over one axis of samples, counted from one."""
    from plotly.subplots import make_subplots

    figure = make_subplots(
        rows=len(panels),
        shared_xaxes=True,
        vertical_spacing=0.18 / len(panels),
        subplot_titles=[p[0] for p in panels],
    )
    named: set[str] = set()
    for row, (_, lines, scale) in enumerate(panels, start=1):
        colours = ("#888888",) if "signal" in lines else COLOURS
        for colour, (name, values) in zip(colours, lines.items(), strict=True):
            figure.add_scatter(
                x0=shown.start + 1,
                dx=1,
                y=[float(f"{v:.4g}") for v in values[shown]],
                name=name,
                legendgroup=name,
                showlegend=name not in named,
                line={"color": colour, "width": 1},
                row=row,
                col=1,
            )
            named.add(name)
        figure.update_yaxes(type=scale, dtick=1 if scale == "log" else None, row=row, col=1)
    figure.update_xaxes(title_text="sample", row=len(panels), col=1)
    return figure.update_layout(height=220 * len(panels) + 80, template="plotly_white", margin={"t": 30})
