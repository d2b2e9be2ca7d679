"""The bus faults of a run as it meets them: when each begins and ends, and what it did."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from faultloop.config.bus_fault import PLANT, STAGES, BusFault
from faultloop.nodes.clock import FOREVER


class Edge(NamedTuple):
    """A bus fault begins or ends."""

    t_ns: int
    fault: BusFault
    begins: bool


class Edges:
    """Beginnings and ends, in order of time."""

    def __init__(self, faults: Iterable[BusFault]) -> None:
        edges = [edge for fault in faults for edge in _edges_of(fault)]
        self._edges = sorted(edges, key=lambda edge: edge.t_ns)  # stable: a beginning stays before its end

    @property
    def next_ns(self) -> int:
        """When the next one is."""
        return self._edges[0].t_ns if self._edges else FOREVER

    def due(self, t_ns: int) -> list[Edge]:
        """Those up to `t_ns`; each once."""
        count = sum(edge.t_ns <= t_ns for edge in self._edges)
        due, self._edges = self._edges[:count], self._edges[count:]
        return due


def end_ns(fault: BusFault) -> int:
    """When it is over; `FOREVER`: with the run.  A restart without a duration is over at once."""
    if fault.end_ns is not None:
        return fault.end_ns
    return fault.start_ns if fault.kind == "restart" else FOREVER


def _edges_of(fault: BusFault) -> list[Edge]:
    return [Edge(fault.start_ns, fault, True), Edge(end_ns(fault), fault, False)]


def describe(fault: BusFault) -> str:
    """``B1: loss of trip frames of RA``."""
    match fault.kind:
        case "babbling":
            return f"{fault.name}: babbling with {fault.identifier:#05x}, {fault.rate_hz:g} frames/s"
        case "forging":
            return f"{fault.name}: forging {fault.message} of {fault.node}, {fault.content}"
        case "bus_off" | "restart":
            return f"{fault.name}: {fault.kind} of {fault.node}"
    frames = "all frames" if fault.message is None else f"{fault.message} frames"
    return f"{fault.name}: {fault.kind} of {frames} of {fault.node or 'all nodes'}"


def without_effect(fault: BusFault) -> bool:
    """In one process the plant sends no samples as frames: they go to the relays directly."""
    return fault.message == "sampled_values" or (fault.node == PLANT and fault.message != "time_sync")


def counted(fault: BusFault) -> bool:
    """It hits frames, which are counted."""
    return fault.kind in STAGES or fault.kind == "bit_error"
