"""A log in rerun, with the line and the zones as they were on each relay's R-X plane."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.io.mcap_reader import Log
from faultloop.io.rerun_sink import RerunSink, log_to_rerun
from faultloop.io.rerun_view import LOCUS_HZ
from faultloop.relay.functions.phs import LOOP_MASK
from faultloop.relay.layout import Instance
from faultloop.review.characteristic import characteristic
from faultloop.review.facts import Summary
from faultloop.review.page import what_they_knew
from faultloop.review.relay_summary import line_impedance
from faultloop.review.retrace import Retraced
from faultloop.review.rows import relay_rows

Moving = tuple[str, NDArray[np.int64], list[NDArray[np.float64]]]


def show(log: Log, summary: Summary, target: str) -> RerunSink:
    """Shows a log; ``target`` as for `RerunSink`.  Zones move where the log tells what polarized them."""
    known = what_they_knew(log, summary)

    def more(sink: RerunSink) -> None:
        for name in log.relays:
            z1 = line_impedance(log, name)
            if z1 is not None:
                sink.draw_line(name, z1)
            for moving in moving_zones(log, known[name]) if name in known else ():
                sink.move_zone(name, *moving)

    return log_to_rerun(log, target, more)


def polygon(constants: Any, one: Instance, q: Any, x: NDArray[np.complex128]) -> NDArray[np.float64]:
    """A zone's polygon (k, 2) [ohm, primary] at an instant (`faultloop.relay.explain.SHARED`) with phasors x,
    of the loop that is selected then; empty without a disturbance, and of a fault that it does not measure.
    """
    c = constants["pdis"][one.number]
    own = LOOP_MASK[int(q["fault"])] & int(c["loops"])
    if not own or not q["disturbed"] or q["fuse_failure"]:
        return np.empty((0, 2))
    points = characteristic(constants["shared"], c, q, x, (own & -own).bit_length() - 1)
    return np.column_stack([points.real, points.imag])


def moving_zones(log: Log, known: Retraced) -> Iterator[Moving]:
    """Each distance zone's polygons [ohm, primary] and when they were so, of the loop that the relay selected
    then; an empty one where that ends."""
    q = known.shared
    there = np.flatnonzero((q["disturbed"] > 0) & (q["fuse_failure"] == 0) & (q["fault"] > 0))
    if not len(there):
        return
    every = max(1, round(known.settings.relay.sampling_hz / LOCUS_HZ))
    rows = relay_rows(log, known.name, int(known.t_ns[there[0]]), int(known.t_ns[there[-1]]) + 1)
    place = np.searchsorted(rows.t_ns, known.t_ns[there])
    found = place < len(rows)
    there, place = there[found], place[found]
    same = rows.t_ns[place] == known.t_ns[there]
    there, place = there[same][::every], place[same][::every]
    step_ns = int(1e9 / known.settings.relay.sampling_hz) * every
    for one in known.instances:
        if one.function.name != "PDIS":
            continue
        times, polygons = [], []
        for row, at in zip(there, place, strict=True):
            t_ns = int(known.t_ns[row])
            if times and t_ns - times[-1] > 1.5 * step_ns:
                times.append(times[-1] + step_ns)
                polygons.append(np.empty((0, 2)))
            times.append(t_ns)
            polygons.append(polygon(known.constants, one, q[row], rows.phasors[at]))
        if times:
            times.append(times[-1] + step_ns)
            polygons.append(np.empty((0, 2)))
            yield one.name, np.array(times, np.int64), polygons
