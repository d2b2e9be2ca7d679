"""How a run looks in rerun: colours, the R-X plane, and the layout of the views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from faultloop.io.messages import LOOPS

TIMELINE, CLOCK = "time", "clock"  # since the start of the run; simulated time of day
FROM_FAULT = "from fault"  # of a log that says when the first one began
LOCUS_HZ = 600  # points per second of an impedance locus
LOCUS_NS = 60_000_000  # how much of it is shown: three cycles at 50 Hz
PHASES = ("A", "B", "C")
# As uint32 arrays: rerun takes a list of three numbers for one colour's red, green and blue.
# The page's on dark, apart for the colour-blind too (Okabe and Ito 2008).
PHASE_COLORS = np.array([0xFF8A3CFF, 0x2FC795FF, 0x4FA8E8FF], np.uint32)
LOOP_COLORS = np.array([*PHASE_COLORS, 0xE0B040FF, 0x8FD0F8FF, 0xE7A3CAFF], np.uint32)
ZONE_COLORS = [0x4FD1C5FF, 0x8FA8FFFF, 0xC58BE8FF, 0x9FB65EFF, 0xA9B4C2FF]
FAULT_TYPES = (*LOOPS, "ABG", "BCG", "CAG", "ABC", "ABCG")
GRID, TICK, LINE = 0x343B47FF, 0x9AA5B1FF, 0xF2F4F7FF
STATE_COLORS = {  # of a lane's states; others get a colour from rerun
    "Str": 0xD9A21BFF,
    "Op": 0xE5484DFF,
    "Tr": 0xE5484DFF,
    "closed": 0x2F7D5BFF,
    "open": 0x7A8699FF,
    **{f"{poles} closed": 0x8C7A3AFF for poles in ("A", "B", "C", "AB", "BC", "AC")},
    **dict.fromkeys(FAULT_TYPES, 0xA83E8CFF),
    "DirFwd": 0x3E5C86FF,
    "DirRv": 0x6B5486FF,
    "on": 0x8C7A4FFF,
}

Characteristics = Mapping[str, tuple[np.ndarray, np.ndarray]]


def style_relay(rr: Any, stream: Any, path: str) -> None:
    """Names and colours of a relay's curves.  MinMax keeps the peaks of waves that are denser than pixels."""
    widths = {"voltage": 1.2, "current": 1.2, "voltage_rms": 1.8, "current_rms": 1.8}
    for name, width in widths.items():
        letter, unit = ("V", "kV") if name.startswith("voltage") else ("I", "kA")
        stream.log(
            f"{path}/{name}",
            rr.SeriesLines(
                colors=PHASE_COLORS,
                names=[f"{letter}{phase.lower()} [{unit}]" for phase in PHASES],
                widths=[width] * 3,
                aggregation_policy=rr.components.AggregationPolicy.MinMax,
            ),
            static=True,
        )
    stream.log(f"{path}/frequency", rr.SeriesLines(names="f [Hz]", colors=[0xC9D1D9FF]), static=True)
    for loop, color in zip(LOOPS, LOOP_COLORS, strict=True):
        stream.log(
            f"{path}/plane/locus/{loop}",
            rr.LineStrips2D.from_fields(colors=[color], radii=rr.Radius.ui_points(1.4)),
            static=True,
        )
        stream.log(
            f"{path}/plane/now/{loop}",
            rr.Points2D.from_fields(
                colors=[color], labels=[loop], show_labels=True, radii=rr.Radius.ui_points(5), draw_order=40
            ),
            static=True,
        )


def style_states(rr: Any, stream: Any, path: str) -> None:
    """Colours of a lane's states."""
    stream.log(
        path,
        rr.StateConfiguration(values=list(STATE_COLORS), colors=list(STATE_COLORS.values())),
        static=True,
    )


def tick_step(reach: float) -> float:
    """1, 2 or 5 times a power of ten: the spacing of about five ticks over ``reach``."""
    magnitude = 10.0 ** np.floor(np.log10(reach / 5))
    return float(magnitude * min((1, 2, 5, 10), key=lambda step: abs(np.log(reach / 5 / (step * magnitude)))))


def draw_plane(rr: Any, stream: Any, path: str, characteristics: Characteristics) -> float:
    """Draws the zones and the axes of a relay's R-X plane; returns its extent [ohm].

    rerun's 2D views have y pointing down, so that everything below ``plane`` is mirrored once.
    """
    polygons = [shape for pair in characteristics.values() for shape in pair if len(shape)]
    reach = max((float(np.nanmax(np.abs(shape))) for shape in polygons), default=10.0) or 10.0
    plane = f"{path}/plane"
    stream.log(plane, rr.Transform3D(scale=[1, -1, 1]), static=True)
    _draw_axes(rr, stream, f"{plane}/axes", reach)
    for place, (zone, (ground, phase)) in enumerate(characteristics.items()):
        color = ZONE_COLORS[place % len(ZONE_COLORS)]
        same = ground.shape == phase.shape and np.array_equal(ground, phase, equal_nan=True)
        for kind, shape in (("", phase),) if same else ((" ground", ground), (" phase", phase)):
            if len(shape):
                closed = np.vstack((shape, shape[:1]))
                stream.log(
                    f"{plane}/zone/{zone}{kind}".replace(" ", "_"),
                    rr.LineStrips2D(
                        [closed], colors=[color], radii=rr.Radius.ui_points(0.6 if kind == " ground" else 0.9)
                    ),
                    static=True,
                )
                _label_zone(
                    rr,
                    stream,
                    f"{plane}/zone/{zone}{kind}_label".replace(" ", "_"),
                    zone + kind,
                    shape,
                    color,
                )
    return reach


def draw_line(rr: Any, stream: Any, path: str, z1: complex) -> None:
    """The line, from where the relay is to its far end."""
    points = [[[0.0, 0.0], [z1.real, z1.imag]]]
    thick = rr.Radius.ui_points(1.6)
    stream.log(f"{path}/plane/line", rr.LineStrips2D(points, colors=[LINE], radii=thick), static=True)


def move_zone(
    rr: Any, stream: Any, path: str, place: int, times: Any, polygons: Sequence[np.ndarray]
) -> None:
    """A zone as it is, in the colour of the ``place``-th zone as set, and thicker."""
    color, thick = ZONE_COLORS[place % len(ZONE_COLORS)], rr.Radius.ui_points(2.2)
    stream.log(path, rr.LineStrips2D.from_fields(colors=[color], radii=thick, draw_order=20), static=True)
    there = [int(len(polygon) > 0) for polygon in polygons]
    strips = rr.LineStrips2D.columns(strips=[polygon for polygon in polygons if len(polygon)])
    stream.send_columns(path, times, strips.partition(there))


def _label_zone(rr: Any, stream: Any, path: str, text: str, shape: np.ndarray, color: int) -> None:
    """The zone's name at its reach, the corner farthest from the origin."""
    corner = shape[np.argmax(np.hypot(shape[:, 0], shape[:, 1]))]
    stream.log(
        path,
        rr.Points2D([corner], labels=[text], colors=[color], radii=rr.Radius.ui_points(2), show_labels=True),
        static=True,
    )


def _draw_axes(rr: Any, stream: Any, path: str, reach: float) -> None:
    step = tick_step(reach)
    ticks = step * np.arange(-8, 9)
    far = float(ticks[-1])
    lines = [[[x, -far], [x, far]] for x in ticks] + [[[-far, y], [far, y]] for y in ticks]
    thin = [0.4 if x != 0 else 1.0 for x in (*ticks, *ticks)]
    stream.log(
        f"{path}/grid",
        rr.LineStrips2D(lines, colors=[GRID], radii=rr.Radius.ui_points(thin), draw_order=-10),
        static=True,
    )
    marks = [x for x in ticks if x != 0]
    stream.log(
        f"{path}/ticks",
        rr.Points2D(
            [*([x, 0.0] for x in marks), *([0.0, y] for y in marks)],
            labels=[*(f"{x:g}" for x in marks), *(f"j{y:g}" for y in marks)],
            colors=[TICK],
            radii=rr.Radius.ui_points(1.5),
            show_labels=True,
        ),
        static=True,
    )


def blueprint(rr: Any, relays: Mapping[str, float], documents: Sequence[str], timeline: str) -> Any:
    """The layout: a tab per relay with waveforms, magnitudes, states and R-X plane; the texts beside them.

    ``relays``: extent of each relay's plane [ohm], by name.
    """
    import rerun.blueprint as rrb

    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(*(_relay_view(rr, rrb, name, reach) for name, reach in relays.items())),
            rrb.Vertical(
                rrb.Tabs(*(_plane_view(rr, rrb, name, reach) for name, reach in relays.items())),
                rrb.Tabs(
                    _text_view(rrb, "events", "Events"),
                    _text_view(rrb, "can", "CAN"),
                    *(rrb.TextDocumentView(origin=path, name=path.rpartition("/")[2]) for path in documents),
                    active_tab=0,
                ),
                row_shares=[3, 2],
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=timeline, play_state="following", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
    )


def _relay_view(rr: Any, rrb: Any, name: str, reach: float) -> Any:
    path = rr.new_entity_path(["relay", name])
    axis = rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal)

    def curves(entity: str, title: str) -> Any:
        return rrb.TimeSeriesView(
            # the colours are in the title: a legend would lie on the waves
            origin=f"{path}/{entity}",
            name=title,
            axis_x=axis,
            plot_legend=rrb.PlotLegend(visible=False),
        )

    return rrb.Vertical(
        curves("voltage", f"{name}: voltage [kV], a orange, b green, c blue"),
        curves("current", f"{name}: current [kA], a orange, b green, c blue"),
        rrb.Horizontal(
            curves("voltage_rms", "Voltage phasors, RMS [kV]"),
            curves("current_rms", "Current phasors, RMS [kA]"),
        ),
        rrb.StateTimelineView(
            origin="/state",
            contents=[
                f"+ {rr.new_entity_path(['state', name])}/**",
                "+ /state/breaker/**",
                "+ /state/fault/**",
                "+ /state/record/**",
            ],
            name=f"{name}: elements; breakers, faults, a record's own channels",
            time_view=axis,
        ),
        row_shares=[1, 1, 0.8, 2],
        name=name,
    )


def _plane_view(rr: Any, rrb: Any, name: str, reach: float) -> Any:
    path = rr.new_entity_path(["relay", name])
    window = rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                timeline,
                start=rrb.TimeRangeBoundary.cursor_relative(nanos=-LOCUS_NS),
                end=rrb.TimeRangeBoundary.cursor_relative(nanos=0),
            )
            for timeline in (TIMELINE, FROM_FAULT)
        ]
    )
    return rrb.Spatial2DView(
        origin=path,
        contents=[f"{path}/plane/**"],
        name=f"{name}: R-X plane [ohm, primary]",
        visual_bounds=rrb.VisualBounds2D(x_range=[-reach, 1.4 * reach], y_range=[-1.2 * reach, 0.6 * reach]),
        background=rrb.Background(color=0x0D1117FF, kind=rrb.BackgroundKind.SolidColor),
        overrides={f"{path}/plane/locus/{loop}": window for loop in LOOPS},
    )


def _text_view(rrb: Any, origin: str, name: str) -> Any:
    kinds = rrb.encodings.TextLogColumnKind
    columns = [rrb.encodings.TextLogColumn(kind) for kind in (kinds.LogLevel, kinds.Body)]
    return rrb.TextLogView(
        origin=f"/{origin}", name=name, columns=rrb.TextLogColumns(text_log_columns=columns)
    )
