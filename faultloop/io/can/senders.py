"""Every node's way onto the simulated bus, with the faults that are on it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from heapq import heappop, heappush

from faultloop.io.can.faults import Fault, SenderFaults, WireErrors
from faultloop.io.can.frames import Frame
from faultloop.io.can.transport import Transport

NEVER = 2**63 - 1


class Senders:
    """Frames go from their nodes through `SenderFaults` to the bus; those that are late wait here.

    Parameters
    ----------
    bus : where the frames go.
    seed, faults : of the run.
    names : the nodes whose frames the faults befall; others' go straight through.
    """

    def __init__(self, bus: Transport, seed: int, faults: Sequence[Fault], names: Collection[str]) -> None:
        self._bus = bus
        self._wire: WireErrors | None = None
        self._stages = {name: SenderFaults(seed, faults, name) for name in names} if faults else {}
        if any(fault.kind == "bit_error" for fault in faults):
            bus.model.errors = self._wire = WireErrors(seed, faults)
        self._late: list[tuple[int, int, Frame, str]] = []
        self._order = 0

    @property
    def next_ns(self) -> int:
        """When the next late frame comes to the bus."""
        return self._late[0][0] if self._late else NEVER

    def silent(self, name: str, t_ns: int) -> bool:
        """The node is off the bus: it neither sends nor receives."""
        stage = self._stages.get(name)
        return stage is not None and stage.silent(t_ns)

    def send(self, t_ns: int, frame: Frame, sender: str) -> None:
        """Offer a node's frame to the bus, or what the faults leave of it."""
        stage = self._stages.get(sender)
        if stage is None:
            self._bus.submit(t_ns, frame, sender)
        elif not stage.silent(t_ns):
            for at_ns, what in stage.send(t_ns, frame):
                self._order += 1
                heappush(self._late, (at_ns, self._order, what, sender))
            self.release(t_ns)

    def send_one(self, t_ns: int, frame: Frame, sender: str) -> None:
        """Offer a frame from a controller with one buffer: dropped where an earlier one still waits."""
        if not self._bus.waiting_from(sender):
            self._bus.submit(t_ns, frame, sender)

    def release(self, t_ns: int) -> None:
        """Late frames that have become due at `t_ns` go to the bus."""
        while self._late and self._late[0][0] <= t_ns:
            _, _, frame, sender = heappop(self._late)
            if not self.silent(sender, t_ns):
                self._bus.submit(t_ns, frame, sender)

    @property
    def hits(self) -> Counter[str]:
        """How many frames each fault has hit so far, by its name."""
        on_the_wire = Counter() if self._wire is None else self._wire.hits
        return sum((stage.hits for stage in self._stages.values()), Counter(on_the_wire))
