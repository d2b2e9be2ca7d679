"""What a campaign's report shows: times, distributions, shots, and where the wrong answers are."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.layout import instances
from faultloop.study.campaign.results import Mask, Results
from faultloop.study.diagram import Curve, Diagram, Limit, Surface

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
BINS = 40
GROUPS = 8
SHOTS = 1500
"""Points of a kind in a shot plot."""
STEPS = 500
"""Of a distribution's line."""
CELLS = 60
"""Values of a key that have cells of their own in a map; more are binned."""
MAP_BINS = 16
SCALES = (1, 2, 5, 10, 20, 50, 100)
MOST_WRITTEN = 200
RATIOS = ("#30123b", "#4454c4", "#2b9bf4", "#1fc9a4", "#7bb51d", "#d3a10c", "#f1711d", "#c22402")
ZONE = "#9aa0a6"
RIGHT, WRONG, QUIET = "#1a7f37", "#c62828", "#5f6b7a"
MILLISECONDS = "operate time, ms"
COUNTED = "From the fault to the breaker's receiving the trip."
DECADE = [digit * 10**power for power in range(-1, 5) for digit in (1, 2, 5)]


def diagrams(results: Results, over: tuple[str, str] | None = None) -> list[Diagram]:
    """All of a report; ``over``: the two keys of the map of wrong answers."""
    found = [wrong_answers(results, over)]
    for drawn in (times_by_position, distribution, shots):
        found += [drawn(results, relay) for relay in results.relays]
    return [diagram for diagram in found if diagram is not None]


def times_by_position(results: Results, relay: str) -> Diagram | None:
    """Operate time against the fault's position, a line per source impedance ratio where it was varied."""
    key = results.first_key(".at_pu", ".at_km")
    # a place on another line is none on this one; where the relay's has no fault, of all
    there = results.on_line(relay)
    there = there if there.any() else ~there
    times = np.where(there, results.operate_ms(relay), np.nan)
    if key is None or not np.isfinite(times).any():
        return None
    x, where = results.numbers(key), "" if there.all() else " with the fault on its line"
    curves = []
    for name, colour, own in _by_ratio(results):
        own = own & there
        if not own.any():
            continue
        centres, middle, worst = _middle(x[own], times[own])
        curves.append(Curve(name, centres, middle, colour=colour, group=name))
        slowest = Curve(
            f"{name}: slowest", centres, worst, "smooth", colour, "dot", in_legend=False, group=name
        )
        curves.append(slowest)
    return Diagram(
        f"{relay}: operate time against position",
        key,
        MILLISECONDS,
        curves,
        _limits(results, relay, "y"),
        y_range=(0, None),
        note=f"{COUNTED} Line: the median, of all cases{where};"
        " it ends where less than half of them were tripped. Dotted: the slowest trip.",
    )


def distribution(results: Results, relay: str) -> Diagram | None:
    """The part of the cases that was tripped within which time, a line per source impedance ratio."""
    times = results.operate_ms(relay)
    if not np.isfinite(times).any():
        return None
    curves = []
    for name, colour, own in _by_ratio(results):
        tripped = np.sort(times[own & np.isfinite(times)])
        if len(tripped):
            part = 100 * np.arange(1, len(tripped) + 1) / own.sum()
            pick = np.unique(np.linspace(0, len(tripped) - 1, STEPS).astype(int))
            curves.append(Curve(name, tripped[pick], part[pick], "steps", colour))
    low, high = np.nanmin(times), np.nanmax(times)
    spread = bool(low > 0)
    return Diagram(
        f"{relay}: operate time, cumulative",
        MILLISECONDS,
        "% of all cases",
        curves,
        _limits(results, relay, "x"),
        log_x=spread,
        x_ticks=[tick for tick in DECADE if low / 2 <= tick <= 2 * high] if spread else None,
        y_range=(0, 102),
        note=f"{COUNTED} What is missing to 100 % was not tripped.",
    )


def _limits(results: Results, relay: str, axis: Literal["x", "y"]) -> list[Limit]:
    return [Limit(f"within {limit:g} ms", limit, axis) for limit in results.limits_ms(relay)]


def _by_ratio(results: Results) -> Iterator[tuple[str, str, Mask]]:
    """Name, colour (the weaker the source the warmer) and cases of each source impedance ratio."""
    key = results.first_key(".sir")
    if key is None:
        yield "all cases", RATIOS[0], np.ones(len(results), bool)
        return
    groups = list(_groups(key, results.numbers(key)))
    for number, (name, own) in enumerate(groups):
        yield name, RATIOS[number * (len(RATIOS) - 1) // max(len(groups) - 1, 1)], own


def shots(results: Results, relay: str) -> Diagram | None:
    """Each fault on the relay's line where a test set puts it: x z1, and its resistance without infeed."""
    place = results.shot_ohm(relay)
    if place is None:
        return None
    curves = _zones(results, relay)
    wrong, tripped, case = results.wrong_of(relay), results.tripped(relay), results.numbers("case")
    for name, own, colour in (
        ("tripped", tripped & ~wrong, RIGHT),
        ("not tripped", ~tripped & ~wrong, QUIET),
        ("wrong", wrong, WRONG),
    ):
        which = np.flatnonzero(own & np.isfinite(place.real))
        if len(which) > SHOTS:
            which = which[np.linspace(0, len(which) - 1, SHOTS).astype(int)]
        if len(which):
            told = ("case", case[which].astype(np.int64))
            at = place[which]
            curves.append(Curve(name, at.real, at.imag, "points", colour, told=told))
    return Diagram(
        f"{relay}: shots on the R-X plane",
        "R ohm, primary",
        "X ohm, primary",
        curves,
        equal=True,
        note="Where a test set would put the fault: its place on the line and its resistance, without infeed"
        f" from the other end. Each point tells its case; of more than {SHOTS} of a kind some are shown.",
    )


def _zones(results: Results, relay: str) -> list[Curve]:
    """Outlines of the zones, as the first case has them; one entry in the legend."""
    settings = results.settings[relay]
    curves: list[Curve] = []
    for instance in instances(settings):
        if instance.function.polygons is None:
            continue
        ground, phase = instance.function.polygons(settings, instance.table)
        kinds = [("", ground)] if np.array_equal(ground, phase) else [(" ground", ground), (" phase", phase)]
        for name, polygon in kinds:
            if len(polygon):
                x, y, told = polygon[:, 0], polygon[:, 1], f"{instance.name}{name}"
                curves.append(Curve(told, x, y, "smooth", ZONE, in_legend=False, group="zones"))
    varied = any(key.startswith(f"relay.{relay}.") for key in results.keys)
    entry = Curve(
        "zones of the first case" if varied else "zones", [np.nan], [np.nan], "smooth", ZONE, group="zones"
    )
    return [entry, *curves] if curves else []


def wrong_answers(results: Results, over: tuple[str, str] | None) -> Diagram | None:
    """The part of wrong answers over two varied keys; where none are given, those that tell the most, if any
    answer is wrong."""
    if over is None and not results.wrong.any():
        return None
    keys = over or telling_keys(results)
    if len(keys) < 2:
        return None
    (x, x_names), (y, y_names) = (_cells(results, key) for key in keys[:2])
    shape = (len(y_names), len(x_names))
    every, wrong = _counted(results, np.ravel_multi_index((y, x), shape), shape[0] * shape[1])
    part = np.full(len(every), np.nan)
    np.divide(100 * wrong, every, out=part, where=every > 0)
    few = len(every) <= MOST_WRITTEN
    texts = [f"{w}/{e}" if w and few else "" for w, e in zip(wrong, every, strict=True)]
    written = [texts[i : i + shape[1]] for i in range(0, len(texts), shape[1])]
    most = next(end for end in SCALES if end >= np.nanmax(part, initial=0))
    surface = Surface(x_names, y_names, part.reshape(shape), [0, most], "% wrong", written, "Reds")
    return Diagram(
        "Wrong answers, % of the judged", keys[0], keys[1], surface=surface, wide=True,
        note="Over any two varied keys with --map KEY,KEY. In a cell: so many of its judged cases were wrong."
        " White: no case was judged there.",
    )  # fmt: skip


def telling_keys(results: Results) -> list[str]:
    """The varied keys, those first over which the part of wrong answers differs most: by chi-squared against
    the same part everywhere, in standard deviations, so that many values are no merit.  In their own order
    where nothing is wrong.
    """
    keys = results.varied_keys()
    told = {}
    for key in keys:
        cell, names = _cells(results, key)
        every, wrong = _counted(results, cell, len(names))
        mean, used = wrong.sum() / max(every.sum(), 1), every > 0
        spread = np.sum((wrong[used] - mean * every[used]) ** 2 / every[used])
        freedom = max(np.count_nonzero(used) - 1, 1)
        variance = mean * (1 - mean)
        told[key] = (spread / variance - freedom) / np.sqrt(2 * freedom) if variance > 0 else 0.0
    return sorted(keys, key=lambda key: -told[key])


def _counted(results: Results, cell: Counts, cells: int) -> tuple[Counts, Counts]:
    """In each cell, how many were judged, and how many were wrong."""
    every, wrong = (np.bincount(cell[which], minlength=cells) for which in (results.judged, results.wrong))
    return every, wrong


def _groups(key: str, values: Array) -> Iterator[tuple[str, Mask]]:
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


def _cells(results: Results, key: str) -> tuple[Counts, list[str]]:
    """Which column or row of a map each case is in (any, of a case that has no value), and their names."""
    if not results.is_number(key):
        codes, texts = results.texts(key)
        order = np.argsort(texts)
        return np.append(np.argsort(order), 0)[codes], [texts[i] for i in order]
    values = results.numbers(key)
    own = np.unique(values[np.isfinite(values)])
    if len(own) > CELLS:
        by_ratio = any(key in vary.all_keys and vary.log_uniform for vary in results.tables.vary)
        edges = (np.geomspace if by_ratio else np.linspace)(own[0], own[-1], 2 * MAP_BINS + 1)
        edges, middles = edges[::2], edges[1::2]
        number = np.clip(np.searchsorted(edges, values, "right") - 1, 0, MAP_BINS - 1)
        return number, _told(middles)
    return np.clip(np.searchsorted(own, values), 0, len(own) - 1), _told(own)


def _told(values: Array) -> list[str]:
    """With as few digits as tell them apart, three at least."""
    for digits in range(3, 17):
        names = [f"{value:.{digits}g}" for value in values]
        if len(set(names)) == len(names):
            return names
    return [repr(float(value)) for value in values]
