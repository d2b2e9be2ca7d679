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
"""Points of a kind in a shot plot."""
CELLS = 60
MOST_WRITTEN = 200
RATIOS = ("#30123b", "#4454c4", "#2b9bf4", "#1fc9a4", "#7bb51d", "#d3a10c", "#f1711d", "#c22402")
LIMIT, ZONE = "#5f6b7a", "#9aa0a6"


@dataclass(frozen=True)
class Series:
    """A line, a dotted line, steps or points; those of one ``group`` have one entry in the legend, the first.

    Attributes
    ----------
    told : what is said of each point.
    """

    name: str
    x: Array
    y: Array
    mode: Literal["line", "dotted", "steps", "points"] = "line"
    colour: str | None = None
    group: str | None = None
    told: Sequence[str] = ()


@dataclass(frozen=True)
class Panel:
    """One plot.  With ``cells`` it is a map: a value (or NaN) for each of ``y_names`` and ``x_names``.

    Attributes
    ----------
    written : in each cell of the map.
    """

    title: str
    x_label: str
    y_label: str
    series: list[Series] = field(default_factory=list)
    equal: bool = False
    log_x: bool = False
    note: str = ""
    cells: Array | None = None
    written: Sequence[Sequence[str]] = ()
    x_names: Sequence[str] = ()
    y_names: Sequence[str] = ()


def panels(results: Results, over: tuple[str, str] | None = None) -> Iterator[Panel]:
    """All of a report; ``over``: the two keys of the map of wrong answers."""
    for relay in results.relays:
        found = times_by_position(results, relay)
        if found is not None:
            yield found
    for relay in results.relays:
        found = distribution(results, relay)
        if found is not None:
            yield found
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
    series = []
    for name, colour, own in _by_ratio(results):
        centres, middle, worst = _middle(x[own], times[own])
        series.append(Series(f"{name}: median", centres, middle, "line", colour, name))
        series.append(Series(f"{name}: slowest", centres, worst, "dotted", colour, name))
    ends = np.array([np.nanmin(x), np.nanmax(x)])
    for limit in results.limits_ms(relay):
        series.append(Series(f"within {limit:g} ms", ends, np.full(2, limit), "dotted", LIMIT, "limit"))
    return Panel(
        f"{relay}: operate time against position",
        key,
        "ms, from the fault to the breaker's receiving the trip",
        series,
        note="Line: the median, of all cases; it ends where less than half of them were tripped. Dotted: the"
        " slowest trip.",
    )


def distribution(results: Results, relay: str) -> Panel | None:
    """The part of the cases that was tripped within which time, a line per source impedance ratio."""
    times = results.operate_ms(relay)
    if not np.isfinite(times).any():
        return None
    series = []
    for name, colour, own in _by_ratio(results):
        tripped = np.sort(times[own & np.isfinite(times)])
        if len(tripped):
            part = 100 * np.arange(1, len(tripped) + 1) / own.sum()
            pick = np.unique(np.linspace(0, len(tripped) - 1, 500).astype(int))
            series.append(Series(name, tripped[pick], part[pick], "steps", colour))
    for limit in results.limits_ms(relay):
        name = f"within {limit:g} ms"
        series.append(Series(name, np.full(2, limit), np.array([0.0, 100.0]), "dotted", LIMIT, "limit"))
    return Panel(
        f"{relay}: operate time, cumulative",
        "ms, from the fault to the breaker's receiving the trip",
        "% of all cases",
        series,
        log_x=bool(np.nanmin(times) > 0),
        note="What is missing to 100 % was not tripped.",
    )


def _by_ratio(results: Results) -> Iterator[tuple[str, str, NDArray[np.bool_]]]:
    """Name, colour (the weaker the source the warmer) and cases of each source impedance ratio."""
    key = results.first_key(".sir")
    if key is None:
        yield "all cases", RATIOS[0], np.ones(len(results), bool)
        return
    groups = list(_groups(key, results.numbers(key)))
    for number, (name, own) in enumerate(groups):
        yield name, RATIOS[number * (len(RATIOS) - 1) // max(len(groups) - 1, 1)], own


def shots(results: Results, relay: str) -> Panel | None:
    """Each fault on the relay's line where a test set puts it: x z1, and its resistance without infeed."""
    place = results.shot_ohm(relay)
    if place is None:
        return None
    settings = results.settings[relay]
    series = []
    for instance in instances(settings):
        if instance.function.polygons is None:
            continue
        ground, phase = instance.function.polygons(settings, instance.table)
        kinds = [("", ground)] if np.array_equal(ground, phase) else [(" ground", ground), (" phase", phase)]
        for name, polygon in kinds:
            if len(polygon):
                x, y = polygon[:, 0], polygon[:, 1]
                series.append(Series(f"{instance.name}{name}", x, y, colour=ZONE, group="zones"))
    wrong = results.wrong_of(relay)
    tripped = results.column(f"{relay}.tripped") == True  # noqa: E712 - null is neither
    for name, own, colour in (
        ("tripped", tripped & ~wrong, "#1a7f37"),
        ("not tripped", ~tripped & ~wrong, "#5f6b7a"),
        ("wrong", wrong, "#c62828"),
    ):
        which = np.flatnonzero(own & np.isfinite(place.real))
        if len(which) > SHOTS:
            which = which[np.linspace(0, len(which) - 1, SHOTS).astype(int)]
        if len(which):
            told = [f"case {case}" for case in results.column("case")[which]]
            x, y = place.real[which], place.imag[which]
            series.append(Series(name, x, y, "points", colour, told=told))
    return Panel(
        f"{relay}: shots on the R-X plane",
        "R ohm, primary",
        "X ohm, primary",
        series,
        equal=True,
        note="Where a test set would put the fault: its place on the line and its resistance, without infeed"
        f" from the other end. Each point tells its case; of more than {SHOTS} of a kind some are shown.",
    )


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
    few = len(every) <= MOST_WRITTEN
    texts = [f"{w} of {e:.0f}" if e and few else "" for w, e in zip(wrong, every, strict=True)]
    return Panel(
        "Wrong answers, % of the judged", keys[0], keys[1], cells=part.reshape(shape), x_names=x_names,
        y_names=y_names, written=[texts[i : i + shape[1]] for i in range(0, len(texts), shape[1])],
        note="Over any two varied keys with --map KEY,KEY. Empty: no case was judged there.",
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
    """Median (NaN where most have no y) and greatest of y by x: at each x, or in bins of many."""
    good = np.isfinite(x)
    x, y = x[good], y[good]
    own = np.unique(x)
    if len(own) > BINS:
        edges = np.linspace(x.min(), x.max(), BINS + 1)
        number = np.clip(np.searchsorted(edges, x, "right") - 1, 0, BINS - 1)
        own = (edges[:-1] + edges[1:]) / 2
    else:
        number = np.searchsorted(own, x)
    order = np.argsort(number, kind="stable")
    used, begins = np.unique(number[order], return_index=True)
    groups = np.split(np.where(np.isfinite(y), y, np.inf)[order], begins[1:])
    middle = np.array([np.quantile(group, 0.5, method="higher") for group in groups])
    worst = np.array([group[np.isfinite(group)].max(initial=-np.inf) for group in groups])
    return own[used], _finite(middle), _finite(worst)


def _finite(values: Array) -> Array:
    return np.where(np.isfinite(values), values, np.nan)


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
