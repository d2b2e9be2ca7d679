"""A page for a fault: waves, digital lanes, phasors and R-X plane under two cursors; one file, offline."""

from __future__ import annotations

import html
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from string import Template

from faultloop.errors import InputError
from faultloop.io.mcap_reader import Log
from faultloop.io.output_file import write_aside
from faultloop.review.facts import Summary
from faultloop.review.page_data import content
from faultloop.review.retrace import Retraced, retrace
from faultloop.review.text import Rows, can_text, headline, tables
from faultloop.review.view import KIND_NAMES, lane_meaning
from faultloop.review.why import why

SCRIPTS = ("record.js", "phasors.js", "characteristic.js", "plane.js", "waves.js", "page.js")
PAGE = Template("""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>$style</style>
<script>
const dark = matchMedia("(prefers-color-scheme: dark)").matches;
document.documentElement.dataset.theme = dark ? "dark" : "light";
</script></head><body>
$body
<script id="record" type="application/json">$record</script>
<script>
/* uPlot 1.6.32
$licence */
$uplot
</script>
<script>
$script
</script>
</body></html>
""")
BAR = """<div id="bar">
<span class="group"><button id="fault">fault</button><button id="whole">whole record</button>
<button id="in" aria-label="zoom in">+</button><button id="out" aria-label="zoom out">−</button></span>
<span class="group"><button id="samples" aria-pressed="true">samples</button>
<button id="rms" aria-pressed="false">RMS</button>
<button id="sequence" aria-pressed="false">sequence</button></span>
{secondary}<button id="theme">light / dark</button>
<span id="times"></span></div>
<p class="note">Move to place cursor A, click for B, drag to zoom, double-click for the fault; arrow keys step
A by a sample (with Shift ten), b puts B there. Times count from {zero}.</p>
{lanes}"""
STATIC = "Zones as set: what polarizes them then is not known from this log"
DYNAMIC = "Zones as they are at A with what polarizes them then (solid), and as set (dashed)"
MOST_SAMPLES = 10_000_000
SECONDARY = '<button id="secondary" aria-pressed="false">secondary values</button>'
RELAY = """<section class="relay" data-relay="{place}"><h2>{name}</h2>
<div class="plots" role="group" aria-label="waves of {name}"></div>
<div class="side"><div><canvas class="phasors" role="img" aria-label="phasors of {name} at cursor A"></canvas>
<p class="note">Phasors at A: voltages solid, currents dashed; angles from VA {reference}.</p></div>
<div><span class="loops" role="group" aria-label="loop that is shown"></span>
<button class="nearer" aria-label="R-X plane nearer">+</button>
<button class="farther" aria-label="R-X plane farther">−</button>
<div class="impedance"></div>
<canvas class="plane" role="img" aria-label="impedance plane of {name}"></canvas>
<p class="note">{plane}, the chosen one bold; dot: A, ring: B.</p></div></div>
<div class="below"><div class="scroll"><table class="values"></table></div>{left_out}</div></section>"""


def write_html(log: Log, summary: Summary, path: str | Path) -> Path:
    """Writes the page of a log that ``summarize`` has summarized: one file that needs no network.

    Within the fault's window every sample is there; outside, waves are thinned to their least and greatest
    values, and shaded.  Raises InputError where ``path`` does not end in ``.html`` or cannot be written;
    nothing is left half-made.
    """
    with write_aside(path, ".html") as aside:
        title = summary.log.scenario or summary.log.record or Path(summary.log.path).name
        known = what_they_knew(log, summary)
        record = content(log, summary, known) | {"kinds": dict(KIND_NAMES)}
        page = PAGE.substitute(
            title=html.escape(title),
            style=_asset("uPlot.min.css") + _asset("page.css"),
            body="\n".join(_body(log, summary, record, title, known)),
            record=_json(record),
            licence=_asset("uPlot-LICENSE.txt"),
            uplot=_asset("uPlot.iife.min.js"),
            script="\n".join(_asset(name) for name in SCRIPTS),
        )
        aside.write_text(page, encoding="utf-8", newline="\n")
    return Path(path)


def _asset(name: str) -> str:
    return (files("faultloop.review") / "assets" / name).read_text(encoding="utf-8")


def _json(record: object) -> str:
    """In a script element nothing may look like its end; and JSON knows no NaN."""
    return json.dumps(record, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _body(
    log: Log, summary: Summary, record: dict, title: str, known: Mapping[str, Retraced]
) -> Iterable[str]:
    yield f"<h1>{html.escape(title)}</h1>"
    yield from (f"<p>{html.escape(line)}</p>" for line in headline(summary, named=False))
    yield f"<p>{html.escape(can_text(summary.can))}</p>"
    yield from (f'<p class="warning">Warning: {html.escape(text)}</p>' for text in summary.warnings)
    if not any(own.trips for own in summary.relays.values()):
        yield "<h3>No trip.</h3>"
    every = tables(summary)
    yield from (_section(*table) for table in every if table[0].startswith("Trips"))
    yield from _reasons(log, summary, known)
    secondary = any(relay["ratios"] for relay in record["relays"])
    zero = "the fault's inception" if record["from_inception"] else "the start of the log"
    if record["relays"]:
        yield BAR.format(secondary=SECONDARY if secondary else "", zero=zero, lanes=_lanes(record["relays"]))
    for place, relay in enumerate(record["relays"]):
        yield RELAY.format(
            place=place,
            name=html.escape(relay["name"]),
            reference="before the fault" if record["from_inception"] else "at the start",
            left_out=_left_out(relay),
            plane=_plane(relay),
        )
    for name, own in summary.relays.items():
        if not own.samples:
            yield f"<h2>{html.escape(name)}</h2><p>No samples in the log.</p>"
    if summary.events:
        events = [(f"{e.ms:.3f}", e.source, e.text) for e in summary.events]
        serious = [e.level not in ("DEBUG", "INFO") for e in summary.events]
        table = _table((">ms", "from", "what"), events, [e.ms for e in summary.events], serious)
        yield f'<h2>Sequence of events</h2><div class="events">{table}</div>'
    yield "<details open><summary>Everything else that was found</summary>"
    yield from (_section(*table) for table in every if not table[0].startswith("Trips"))
    yield "</details>"


def what_they_knew(log: Log, summary: Summary) -> dict[str, Retraced]:
    """Of the relays whose log has what it takes, and is not so long that it would take a minute."""
    found = {}
    for name, own in summary.relays.items():
        if own.samples and own.samples <= MOST_SAMPLES:
            with suppress(InputError):
                found[name] = retrace(log, name)
    return found


def _reasons(log: Log, summary: Summary, known: Mapping[str, Retraced]) -> Iterable[str]:
    """Why each function operated, or did not: a row is a link to its instant."""
    rows, times = [], []
    for name in known:
        for reason in why(log, summary, name):
            rows.append((name, reason.cause, reason.text))
            times.append((reason.t_ns - summary.inception.zero_ns) / 1e6)
    if rows:
        table = _table(("relay", "cause", "what kept it, or let it operate"), rows, times)
        yield f'<details open><summary>Why</summary><div class="why">{table}</div></details>'
    without = [name for name, own in summary.relays.items() if own.samples and name not in known]
    if without:
        names = html.escape(", ".join(without))
        yield f'<p class="note">What {names} knew cannot be told from this log: faultloop why says why.</p>'


def _plane(relay: dict) -> str:
    """What the R-X plane shows."""
    zones = (DYNAMIC if relay["dynamic"] else STATIC) if relay["zones"] else "The relay has no zones"
    return f"{zones}; the loops' way during the fault"


def _left_out(relay: dict) -> str:
    """What the page does not have of the log."""
    told = []
    if relay["stretch_ms"]:
        told.append(f"Shaded: least and greatest of each {relay['stretch_ms']:.3g} ms, no single samples.")
    if relay["step"] > 1:
        told.append(f"Phasors and impedances of one in {relay['step']} samples.")
    return f'<p class="note">{" ".join(told)}</p>' if told else ""


def _section(name: str, columns: Sequence[str], rows: Rows) -> str:
    """A table; where its rows begin with an instant, they are links to it."""
    times = [float(row[0]) if row[0] else None for row in rows] if columns[0] == ">at" else ()
    return f"<h3>{html.escape(name)}</h3>{_table(columns, rows, times)}"


def _lanes(relays: Sequence[dict]) -> str:
    """What the names of the lanes stand for."""
    names = list(dict.fromkeys(label for relay in relays for label, _ in relay["lanes"]))
    told = [(label, meaning) for label in names if (meaning := lane_meaning(label))]
    breakers = list(dict.fromkeys(relay["breaker"] for relay in relays if relay["breaker"] in names))
    told += [(name, "breaker: its poles, from the top A, B, C, where they are open") for name in breakers]
    if not told:
        return ""
    rows = "".join(f"<dt>{html.escape(label)}</dt><dd>{html.escape(text)}</dd>" for label, text in told)
    return f"<details><summary>What the lanes are</summary><dl>{rows}</dl></details>"


def _table(
    columns: Sequence[str],
    rows: Rows,
    times_ms: Sequence[float | None] = (),
    serious: Sequence[bool] = (),
) -> str:
    """Rows with a time are links to it; ``serious`` ones stand out."""
    right = [column.startswith(">") for column in columns]

    def line(cells: Sequence[str], tag: str, mark: str = "") -> str:
        marks = [' class="n"' if side else "" for side in right]
        inner = "".join(f"<{tag}{m}>{html.escape(c)}</{tag}>" for m, c in zip(marks, cells, strict=True))
        return f"<tr{mark}>{inner}</tr>"

    head = line([column.removeprefix(">") for column in columns], "th")
    marks = ["" if ms is None else f' data-ms="{ms!r}"' for ms in times_ms] or [""] * len(rows)
    if serious:
        marks = [f'{mark} class="serious"' if bad else mark for mark, bad in zip(marks, serious, strict=True)]
    body = "".join(line(row, "td", mark) for row, mark in zip(rows, marks, strict=True))
    return f'<div class="scroll"><table>{head}{body}</table></div>'
