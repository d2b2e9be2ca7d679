"""Layouts of viewers for a log: Foxglove as JSON, PlotJuggler as XML.

Foxglove's current form is a tree of splits, tabs and panels (``foxglove.layouts``, schema 0.62 of
foxglove-sdk 0.30); PlotJuggler 4 reads ``<root pj4_version="4">`` with tabs of dock splitters, in which a
curve is known by its topic and field, and not by a name (its sources and tests).  PlotJuggler 3 reads the
same tree, and knows a curve by its name, ``/topic/field`` (sources of 3.17: plotwidget.cpp, plot_docker.cpp,
dataload_mcap.cpp): both are given.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from itertools import count
from typing import Any

import numpy as np

from faultloop.io.mcap_reader import Log
from faultloop.io.messages import CHANNELS, LOOP_IMPEDANCES, LOOPS, SAMPLED_VALUES
from faultloop.io.view import WORDS, booleans, view_topic

COLOURS = ("#D55E00", "#009E73", "#0072B2")
LOOP_COLOURS = (*COLOURS, "#B8860B", "#56B4E9", "#CC79A7")
PLOTJUGGLER_3 = {
    "max_array_size": "500",
    "use_timestamp": "0",
    "use_mcap_log_time": "1",
    "clamp_large_arrays": "1",
}
"""What its loader of MCAP is told, or it asks."""
Curves = list[tuple[str, str, str]]
"""Topic, field, colour."""


def waves(relay: str) -> list[tuple[str, Curves]]:
    """Titles and curves of the plots of a relay over time."""
    samples, view = SAMPLED_VALUES.topic_for(relay), view_topic(relay)

    def three(topic: str, names: Sequence[str], end: str = "") -> Curves:
        return [(topic, f"{name}{end}", COLOURS[k % 3]) for k, name in enumerate(names)]

    return [
        (f"{relay} voltage [V]", three(samples, CHANNELS[:3])),
        (f"{relay} current [A]", three(samples, CHANNELS[3:])),
        (f"{relay} |V| RMS [V]", three(view, CHANNELS[:3], "_mag")),
        (f"{relay} |I| RMS [A]", three(view, CHANNELS[3:], "_mag")),
        (f"{relay} angles [deg]", [(view, f"{n}_deg", COLOURS[k % 3]) for k, n in enumerate(CHANNELS)]),
    ]


def states(log: Log, relay: str) -> Curves:
    """The booleans of a relay that ever were on; all of them where none was."""
    words = log.elements(relay)
    ever = [int(np.bitwise_or.reduce(words[word], initial=0)) for word in WORDS]
    places = booleans(log.bits(relay))
    on = [name for name, (word, place) in places.items() if ever[word] >> place & 1]
    return [(view_topic(relay), name, "") for name in on or places]


def loci(relay: str) -> list[tuple[str, str, str, str]]:
    """Topic, r, x and colour of each loop's way in the R-X plane."""
    topic = LOOP_IMPEDANCES.topic_for(relay)
    return [
        (topic, f"{loop.lower()}_r", f"{loop.lower()}_x", LOOP_COLOURS[k]) for k, loop in enumerate(LOOPS)
    ]


# -- Foxglove ------------------------------------------------------------------------------------------


def foxglove(log: Log) -> dict[str, Any]:
    """A tab for each relay - waves, magnitudes, states, R-X plane - and one for events and frames."""
    tabs = [{"title": relay, "content": _relay_tab(log, relay)} for relay in log.relays]
    told = [_log_panel(topic) for topic in log.topics if topic.endswith("/events")]
    frames = [_raw(topic) for topic in log.topics if topic == "/can"]  # none in a replay's log
    if told or frames:
        tabs.append({"title": "events", "content": _split([*told, *frames])})
    return {"version": 1, "content": {"type": "tabs", "selectedTabIndex": 0, "tabs": tabs}}


def _panel(kind: str, title: str, config: dict[str, Any]) -> dict[str, Any]:
    return {"type": "panel", "panelType": kind, "title": title, "version": 1, "config": config}


def _split(panels: Sequence[dict[str, Any]], direction: str = "column") -> dict[str, Any]:
    items = [{"proportion": 1, "content": panel} for panel in panels]
    return {"type": "split", "direction": direction, "items": items}


def _path(topic: str, field: str, colour: str) -> dict[str, Any]:
    path = {"value": f"{topic}.{field}", "label": field, "enabled": True, "timestampMethod": "receiveTime"}
    return path | ({"color": colour} if colour else {})


def _relay_tab(log: Log, relay: str) -> dict[str, Any]:
    plots = [
        _panel("Plot", title, {"paths": [_path(*curve) for curve in curves], "xAxisVal": "timestamp"})
        for title, curves in waves(relay)
    ]
    lanes = _panel(
        "StateTransitions", f"{relay} elements", {"paths": [_path(*curve) for curve in states(log, relay)]}
    )
    ways = [
        _path(topic, x, colour) | {"label": x[:2].upper(), "xAxisPath": f"{topic}.{r}"}
        for topic, r, x, colour in loci(relay)
    ]
    planes = [
        _panel(
            "Plot",
            f"{relay} R-X {way['label']} [ohm]",
            {
                "paths": [way],
                "xAxisVal": "custom",  # all messages; "currentCustom" is the present one alone
                "xAxisPath": {"value": way.pop("xAxisPath"), "enabled": True},
            },
        )
        for way in ways
    ]
    return _split([_split([*plots, lanes]), _split(planes)], "row")


def _log_panel(topic: str) -> dict[str, Any]:
    return _panel("Log", topic, {"topicToRender": topic})


def _raw(topic: str) -> dict[str, Any]:
    return _panel("RawMessages", topic, {"topicPath": topic})


# -- PlotJuggler ---------------------------------------------------------------------------------------


def plotjuggler(log: Log, files: Sequence[str]) -> ET.Element:
    """A tab for each relay, and its R-X plane; ``files``: the logs that the curves come from."""
    root = ET.Element("root", pj4_version="4", binding="source", format="PlotJuggler")
    numbers = map(str, count(1))
    widget = ET.SubElement(
        root, "tabbed_widget", {"id": next(numbers), "name": "main", "parent": "main_window"}
    )
    for relay in log.relays:
        _time_tab(widget, relay, [*waves(relay), (f"{relay} elements", states(log, relay))], numbers)
        _plane_tab(widget, relay, numbers)
    ET.SubElement(widget, "currentTabIndex", index="0")
    topics = ";".join(sorted({one.get("topic") or one.get("x_topic", "") for one in root.iter("curve")}))
    ET.SubElement(root, "data_processors")
    loaded = ET.SubElement(root, "previouslyLoaded_Datafiles")
    for file in files:
        info = ET.SubElement(loaded, "fileInfo", filename=file, prefix="")
        ET.SubElement(info, "dataset", source_index="0", display_offset_ns="0")
        loader = {"ID": "MCAP Loader", "manifest_id": "mcap-loader", "filepath_mode": "source"}
        plugin = ET.SubElement(info, "plugin", loader)
        plugin.text = json.dumps({"filepath": file, "use_log_time": True})
        ET.SubElement(plugin, "parameters", PLOTJUGGLER_3 | {"selected_topics": topics})
    return root


def _tab(widget: ET.Element, name: str, plots: int, number: str) -> ET.Element:
    """Plots below each other: the splitter that they go into."""
    tab = ET.SubElement(widget, "Tab", id=number, tab_name=name, containers="1")
    sizes = ";".join([f"{1 / plots:.6g}"] * plots)
    container = ET.SubElement(tab, "Container")
    return ET.SubElement(container, "DockSplitter", orientation="-", count=str(plots), sizes=sizes)


def _time_tab(
    widget: ET.Element, relay: str, plots: Sequence[tuple[str, Curves]], numbers: Iterator[str]
) -> None:
    splitter = _tab(widget, relay, len(plots), next(numbers))
    for title, curves in plots:
        area = ET.SubElement(splitter, "DockArea", id=next(numbers), name=title)
        style = "Steps" if title.endswith("elements") else "Lines"
        plot = ET.SubElement(area, "plot", id=next(numbers), mode="TimeSeries", style=style, title=title)
        ET.SubElement(plot, "limitY")
        for topic, field, colour in curves:
            known = {"topic": topic, "field": field, "name": f"{topic}/{field}"}
            ET.SubElement(plot, "curve", known | {"color": colour or "#26436B"})


def _plane_tab(widget: ET.Element, relay: str, numbers: Iterator[str]) -> None:
    splitter = _tab(widget, f"{relay} R-X", 1, next(numbers))
    area = ET.SubElement(splitter, "DockArea", id=next(numbers), name=f"{relay} R-X [ohm]")
    plot = ET.SubElement(area, "plot", id=next(numbers), mode="XYPlot", style="Lines")
    for topic, r, x, colour in loci(relay):
        path = {"x_topic": topic, "x_field": r, "y_topic": topic, "y_field": x}
        path |= {"curve_x": f"{topic}/{r}", "curve_y": f"{topic}/{x}"}
        ET.SubElement(plot, "curve", path | {"name": x[:2].upper(), "color": colour})
