"""What a campaign's report shows, as panels that a page and a picture draw alike."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.layout import instances
from faultloop.study.campaign.results import Results

Array = NDArray[np.float64]
BINS = 40
GROUPS = 8
SHOTS = 4000
"""Points of a shot plot; every wrong one is among them."""
CELLS = 60


@dataclass(frozen=True)
class Series:
    """A line or points."""

    name: str
    x: Array
    y: Array
    mode: Literal["line", "points"] = "line"
    colour: str | None = None


@dataclass(frozen=True)
class Panel:
    """One plot.  With ``cells`` it is a map: a value (or NaN) for each of ``y_names`` and ``x_names``."""

    title: str
    x_label: str
    y_label: str
    series: list[Series] = field(default_factory=list)
    equal: bool = False
    cells: Array | None = None
    x_names: Sequence[str] = ()
    y_names: Sequence[str] = ()


def panels(results: Results, over: tuple[str, str] | None = None) -> Iterator[Panel]:
    """All of a report; ``over``: the two keys of the map of wrong answers."""
    for relay in results.relays:
        found = times_by_position(results, relay)
        if found is not None:
            yield found
    yield distributions(results)
    for relay in results.relays:
        found = shots(results, relay)
        if found is not None:
            yield found
    found = wrong_answers(results, over)
    if found is not None:
        yield found


def times_by_position(results: Results, relay: str) -> Panel | None:
    """Operate time against the fault's position, a line per source impedance ratio where it was varied."""
    key = results.first_key(".at_pu", ".at_km")
    times = results.operate_ms(relay)
    if key is None or not np.isfinite(times).any():
        return None
    x = results.numbers(key)
    ratio = results.first_key(".sir")
    groups = (
        [("all", np.ones(len(x), bool))] if ratio is None else list(_groups(ratio, results.numbers(ratio)))
    )
    series = []
    for name, own in groups:
        centres, middle, worst = _middle(x[own], times[own])
        if len(centres):
            series.append(Series(f"{name}: median", centres, middle))
            series.append(Series(f"{name}: slowest", centres, worst, "points"))
    return Panel(f"{relay}: operate time against position", key, "ms from the fault to the breaker", series)


def distributions(results: Results) -> Panel:
    """How many cases were tripped within which time."""
    series = []
    for relay in results.relays:
        times = np.sort(results.operate_ms(relay))
        times = times[np.isfinite(times)]
        if len(times):
            part = np.arange(1, len(times) + 1) / len(results)
            pick = np.unique(np.linspace(0, len(times) - 1, 500).astype(int))
            series.append(Series(relay, times[pick], 100 * part[pick]))
    return Panel("Operate time, cumulative", "ms", "% of all cases", series)


def shots(results: Results, relay: str) -> Panel | None:
    """Each fault on the relay's line where a test set puts it: x z1, and its resistance without infeed."""
    place = results.shot_ohm(relay)
    if place is None:
        return None
    settings = results.settings[relay]
    series = []
    for instance in instances(settings):
        if instance.function.polygons is not None:
            ground, phase = instance.function.polygons(settings, instance.table)
            for name, polygon in (("ground", ground), ("phase", phase)):
                if len(polygon):
                    series.append(
                        Series(f"{instance.name} {name}", polygon[:, 0], polygon[:, 1], colour="#9aa0a6")
                    )
    wrong = results.verdict == "wrong"
    tripped = results.column(f"{relay}.tripped") == True  # noqa: E712 - null is neither
    for name, own, colour in (
        ("tripped", tripped & ~wrong, "#1a7f37"),
        ("not tripped", ~tripped & ~wrong, "#5f6b7a"),
        ("wrong", wrong, "#c62828"),
    ):
        which = np.flatnonzero(own & np.isfinite(place.real))
        if name != "wrong" and len(which) > SHOTS:
            which = which[np.linspace(0, len(which) - 1, SHOTS).astype(int)]
        if len(which):
            series.append(Series(name, place.real[which], place.imag[which], "points", colour))
    return Panel(f"{relay}: shots on the R-X plane", "R ohm, primary", "X ohm, primary", series, equal=True)


def wrong_answers(results: Results, over: tuple[str, str] | None) -> Panel | None:
    """The part of wrong answers over two varied keys."""
    keys = over or tuple(results.varied_keys()[:2])
    if len(keys) < 2:
        return None
    judged = results.verdict != "unjudged"
    (x, x_names), (y, y_names) = (_cells(results.column(key)) for key in keys)
    shape = (len(y_names), len(x_names))
    place = np.ravel_multi_index((y, x), shape)
    every = np.bincount(place[judged], minlength=shape[0] * shape[1]).astype(float)
    wrong = np.bincount(place[results.verdict == "wrong"], minlength=len(every))
    part = np.full(len(every), np.nan)
    np.divide(100 * wrong, every, out=part, where=every > 0)
    return Panel(
        "Wrong answers, % of the judged", keys[0], keys[1], cells=part.reshape(shape), x_names=x_names,
        y_names=y_names,
    )  # fmt: skip


def _groups(key: str, values: Array) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """A key's values, or parts of them where there are many."""
    name = key.rpartition(".")[2].upper()
    own = np.unique(values[np.isfinite(values)])
    if len(own) <= GROUPS:
        yield from ((f"{name} {value:g}", values == value) for value in own)
        return
    edges = np.quantile(own, np.linspace(0, 1, 5))
    for low, high in pairwise(edges):
        yield f"{name} {low:.3g} to {high:.3g}", (values >= low) & (values <= high)


def _middle(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Median and greatest of y by x: at each x, or in bins where there are many."""
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    own = np.unique(x)
    if len(own) > BINS:
        edges = np.linspace(x.min(), x.max(), BINS + 1)
        number = np.clip(np.searchsorted(edges, x, "right") - 1, 0, BINS - 1)
        own = (edges[:-1] + edges[1:]) / 2
    else:
        number = np.searchsorted(own, x)
    used = np.unique(number)
    middle = np.array([np.median(y[number == n]) for n in used])
    return own[used], middle, np.array([y[number == n].max() for n in used])


def _cells(values: NDArray[Any]) -> tuple[NDArray[np.int64], list[str]]:
    """Which column or row of a map each value is in, and their names."""
    if values.dtype.kind in "fi":
        own = np.unique(values[np.isfinite(values)]) if values.dtype.kind == "f" else np.unique(values)
        if len(own) > CELLS:
            edges = np.linspace(own[0], own[-1], 25)
            number = np.clip(np.searchsorted(edges, values, "right") - 1, 0, len(edges) - 2)
            return number, [f"{(a + b) / 2:.4g}" for a, b in pairwise(edges)]
        return np.clip(np.searchsorted(own, values), 0, len(own) - 1), [f"{value:g}" for value in own]
    names, number = np.unique(values.astype(str), return_inverse=True)
    return number, [str(name) for name in names]
