"""What a notebook shows of a relay's rows: a figure, a data frame, a table."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from faultloop.errors import InputError, nearest
from faultloop.io.messages import CHANNELS, ELEMENTS, SAMPLED, SAMPLED_VALUES, array_dtype, values

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from faultloop.io.mcap_reader import Log

COLOURS = ("#D55E00", "#009E73", "#0072B2")  # apart for the colour-blind too (Okabe and Ito 2008)
FRAME_BYTES = 1 << 32
"""Of a data frame, at most."""
POINTS = 20_000
"""Of a curve in a figure, which is some hundred pixels wide."""
LABEL_POINTS = 11
"""Height of a row of texts above a figure's waves."""
Arrays = Mapping[str, np.ndarray]
"""Of one relay: "samples", "phasors", "loops", "elements", those there are, as the log's reader has them."""


def drawn(log: Log, relay: str) -> np.ndarray:
    """A relay's sampled values, no more than a picture has points for."""
    topic = SAMPLED_VALUES.topic_for(relay)
    every = -(-log.count(topic) // POINTS)
    if every < 2:
        return log.array(topic)
    return np.concatenate([thinned(log.array(topic, *span), every) for span in log.stretches()])


def thinned(rows: np.ndarray, every: int) -> np.ndarray:
    """Of each ``every`` sampled values the least and the greatest of every channel, as two rows."""
    starts = np.arange(0, len(rows), every)
    out = np.repeat(rows[starts], 2)
    if len(rows):
        out["t_ns"][1::2] = rows["t_ns"][np.minimum(starts + every // 2, len(rows) - 1)]
        for name in CHANNELS:
            out[name][::2] = np.fmin.reduceat(rows[name], starts)
            out[name][1::2] = np.fmax.reduceat(rows[name], starts)
    return out


def figure(relays: Mapping[str, np.ndarray], marks: Sequence[tuple[int, str]]) -> Figure:
    """Voltages and currents side by side; ``relays``: sampled values by name; ``marks``: ns and text, which
    begins with the relay whose it is, or with none's."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    shown = Figure(figsize=(6.5 * max(len(relays), 1), 4.8), layout="constrained")
    axes = shown.subplots(2, max(len(relays), 1), squeeze=False, sharex=True, sharey="row")
    for column, (name, rows) in zip(axes.T, relays.items(), strict=False):
        ms, own = rows["t_ns"] / 1e6, values(rows) / 1e3
        for k in range(len(CHANNELS)):
            column[k // 3].plot(ms, own[:, k], color=COLOURS[k % 3], lw=1)
        column[1].set_xlabel("time from the start [ms]")
        others = tuple(f"{other} " for other in relays if other != name)
        here = [
            (t_ns / 1e6, text.removeprefix(f"{name} ")) for t_ns, text in marks if not text.startswith(others)
        ]
        span = (float(ms[0]), float(ms[-1])) if len(ms) else (0.0, 0.0)
        levels = _label(column[0], here, span)
        column[0].set_title(name, loc="left", weight="bold", pad=6 + LABEL_POINTS * levels)
        for one in column:
            for at_ms, _ in here:
                one.axvline(at_ms, color="#222222", lw=0.8, ls="--")
    axes[0, 0].set_ylabel("voltage [kV]")
    axes[1, 0].set_ylabel("current [kA]")
    phases = [
        Line2D([], [], color=colour, lw=2, label=f"phase {p}")
        for p, colour in zip("ABC", COLOURS, strict=True)
    ]
    shown.legend(handles=phases, loc="outside upper right", ncols=3, fontsize=9, frameon=False)
    return shown


def _label(axes: Axes, marks: Sequence[tuple[float, str]], span: tuple[float, float]) -> int:
    """Texts above the axes, each at its line, in as many rows as keep them apart; how many rows."""
    wide = (span[1] - span[0]) * 0.017  # of a letter: a column is some 60 wide
    ends: list[float] = []
    for at_ms, text in sorted(marks):
        left = at_ms > span[0] + 0.7 * (span[1] - span[0])  # near the right end it stands before its line
        begin = at_ms - wide * len(text) if left else at_ms
        level = next((k for k, end in enumerate(ends) if begin > end), len(ends))
        ends[level : level + 1] = [begin + wide * (len(text) + 1)]
        where: dict[str, Any] = {
            "textcoords": "offset points",
            "ha": "right" if left else "left",
            "va": "bottom",
        }
        place = (at_ms, 1.0), ("data", "axes fraction"), (0, 2 + LABEL_POINTS * level)
        axes.annotate(
            text, place[0], xycoords=place[1], xytext=place[2], size=8, annotation_clip=False, **where
        )
    return len(ends)


def log_frame(log: Log, relay: str | None, from_ns: int | None, to_ns: int | None) -> Any:
    """`Log.to_pandas`"""
    name = relay if relay is not None else (log.relays[0] if log.relays else "")
    there = {m.name: t for m in SAMPLED if (t := m.topic_for(name)) in log.topics}
    if not there:
        raise InputError(f"no relay '{name}'; {nearest(name, log.relays)}", file=log.path)
    span = () if from_ns is None and to_ns is None else (from_ns, to_ns)
    row = sum(array_dtype(m).itemsize for m in SAMPLED) + sum(map(len, log.bits(name).values()))
    most = max(log.count(topic) for topic in there.values())
    if not span and most * row > FRAME_BYTES:
        what = f"{most} samples of {name} are a frame of {most * row / 1e9:.0f} GB: give from_ns and to_ns"
        raise InputError(f"{what}, or make tables by faultloop export --parquet", file=log.path)
    return frame({what: log.array(topic, *span) for what, topic in there.items()}, log.bits(name))


def frame(arrays: Arrays, bits: Mapping[str, Sequence[str]]) -> Any:
    """A pandas DataFrame of a relay, a row for each sample: index ``t_s`` [s from the start]; samples,
    phasors and loops by their fields' names, elements as booleans by their IEC 61850 names.

    Raises InputError without pandas.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise InputError("pandas is not installed: pip install pandas") from error
    tables = []
    for what, rows in arrays.items():
        index = pd.Index(rows["t_ns"] / 1e9, name="t_s")
        if what in ("elements", ELEMENTS.name):
            columns = {
                name: (rows[word] >> np.uint64(place) & np.uint64(1)).astype(bool)
                for word in ("pickup", "operate")
                for place, name in enumerate(bits[word])
                if name
            }
        else:
            columns = {name: rows[name] for name in rows.dtype.names or () if name != "t_ns"}
        tables.append(pd.DataFrame(columns, index=index))
    return pd.concat(tables, axis=1)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """HTML of a title and a table; every text is safe."""

    def line(cells: Sequence[object], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    body = "".join(line(row, "td") for row in rows)
    head = line(columns, "th") if rows else ""
    return f"<p>{html.escape(title)}</p><table>{head}{body}</table>"


def log_html(title: str, trips: Sequence[Any], events: Sequence[Any]) -> str:
    """A log's trips and events, entries of its reader."""
    told = [(f"{t.t_ns / 1e6:.3f}", t.source, t.function, t.zone, t.loop) for t in trips]
    said = [(f"{e.t_ns / 1e6:.3f}", e.fields["name"] or e.source, e.message) for e in events]
    shown = table(title, ("ms", "relay", "function", "zone", "loop"), told)
    return shown + table("Events", ("ms", "from", "what"), said)
