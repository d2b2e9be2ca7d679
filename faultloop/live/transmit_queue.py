"""A process's way onto the bus, with the faults that befall its frames."""

from __future__ import annotations

from collections import Counter
from heapq import heappop, heappush

from faultloop.io.can.faults import SenderFaults
from faultloop.io.can.frames import Frame
from faultloop.io.can.link import Link
from faultloop.loop.scenario import Scenario
from faultloop.nodes.clock import FOREVER


class TransmitQueue:
    """Frames go through their sender's faults to the bus, as in the simulation; late ones wait here.

    Parameters
    ----------
    link : the bus.
    scenario : whose ``[[bus_fault]]`` befall the frames.
    sender : name of the node.
    """

    def __init__(self, link: Link, scenario: Scenario, sender: str) -> None:
        self._link = link
        faults = scenario.bus_fault
        self._stage = SenderFaults(scenario.scenario.seed, faults, sender) if faults else None
        self._late: list[tuple[int, int, Frame]] = []
        self._order = 0

    @property
    def next_ns(self) -> int:
        """When the next late frame is due."""
        return self._late[0][0] if self._late else FOREVER

    def silent(self, t_ns: int) -> bool:
        """The node is off the bus: it neither sends nor receives."""
        return self._stage is not None and self._stage.silent(t_ns)

    def send(self, t_ns: int, frame: Frame) -> None:
        """Send a frame, or what the faults leave of it."""
        if self._stage is None:
            self._link.send(frame)
        elif not self._stage.silent(t_ns):
            for at_ns, what in self._stage.send(t_ns, frame):
                self._order += 1
                heappush(self._late, (at_ns, self._order, what))

    def release(self, t_ns: int) -> None:
        """Send the late frames that are due."""
        while self._late and self._late[0][0] <= t_ns:
            frame = heappop(self._late)[2]
            if not self.silent(t_ns):
                self._link.send(frame)

    @property
    def hits(self) -> Counter[str]:
        """How many frames each fault has hit so far, by its name."""
        return Counter() if self._stage is None else self._stage.hits
