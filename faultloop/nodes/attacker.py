"""Nodes that should not be there: a babbling idiot, and one that forges the frames of another."""

from __future__ import annotations

from random import Random

from faultloop.config.bus_fault import BusFault
from faultloop.io.can.authentication import PLAIN, CmacSeal, Seal
from faultloop.io.can.frames import Frame, State, ticks
from faultloop.io.can.table import Kind
from faultloop.nodes.clock import FOREVER
from faultloop.nodes.tables import BusTables

POLES = {"A": 1, "B": 2, "C": 4, "AB": 3, "BC": 6, "CA": 5, "ABC": 7}
HEARD = 64
"""Frames that a replaying forger remembers."""


class Attacker:
    """Sends at a steady rate in its fault's window; what it sends is `_frame`'s business."""

    def __init__(self, fault: BusFault, stream: str) -> None:
        self.name = fault.name
        self.fault = fault
        self.sent = 0
        self._random = Random(stream)
        self.next_ns = self._due()

    def _due(self) -> int:
        """From the start and not from the last, so that no rounding adds up."""
        assert self.fault.rate_hz is not None
        due = self.fault.start_ns + round(self.sent * 1e9 / self.fault.rate_hz)
        return FOREVER if self.fault.end_ns is not None and due >= self.fault.end_ns else due

    def poll(self, t_ns: int) -> list[Frame]:
        """The frame that is due."""
        if t_ns < self.next_ns:
            return []
        self.sent += 1
        self.next_ns = self._due()
        frame = self._frame(t_ns)
        return [] if frame is None else [frame]

    def receive(self, t_ns: int, frame: Frame) -> None:
        """Take a frame."""

    def _frame(self, t_ns: int) -> Frame | None:
        raise NotImplementedError


class BabblingNode(Attacker):
    """A babbling idiot (Kopetz): one identifier, random data, as fast as it is told."""

    def _frame(self, t_ns: int) -> Frame | None:
        return Frame(self.fault.identifier, self._random.randbytes(self.fault.length))


class ForgingNode(Attacker):
    """Sends under another node's identifier.

    Parameters
    ----------
    identifier : the victim's.
    seal : what a crafted frame passes; a forger has no key of the run's.
    """

    def __init__(self, fault: BusFault, stream: str, identifier: int, seal: Seal) -> None:
        super().__init__(fault, stream)
        self.identifier = identifier
        self._seal = seal
        self._heard: list[Frame] = []

    def receive(self, t_ns: int, frame: Frame) -> None:
        """Remember the victim's frames, the last `HEARD` of them."""
        if frame.id == self.identifier and not frame.extended:
            self._heard = [*self._heard, frame][-HEARD:]

    def _frame(self, t_ns: int) -> Frame | None:
        if self.fault.content == "random":
            if self._seal is PLAIN:
                return Frame(self.identifier, self._random.randbytes(8))
            return Frame(self.identifier, self._random.randbytes(32), fd=True, brs=True)
        if self.fault.content == "replayed":
            return self._random.choice(self._heard) if self._heard else None
        return self._seal.close(t_ns, self._state(t_ns).encode())

    def _state(self, t_ns: int) -> State:
        """As a publisher that has just started would repeat it: E2E and acceptance find nothing wrong."""
        kind = Kind(self.identifier & ~0xF)
        poles, number = POLES[self.fault.poles], self.sent - 1
        return State(kind, self.identifier & 0xF, poles, 1, number % 256, number % 15, ticks(t_ns))


def attacker_nodes(scenario: BusTables) -> list[Attacker]:
    """The babbling and the forging nodes of a scenario."""
    seed = scenario.scenario.seed
    nodes: list[Attacker] = []
    for i, fault in enumerate(scenario.bus_fault):
        stream = f"{seed}/{i}/{fault.name}"
        if fault.kind == "babbling":
            nodes.append(BabblingNode(fault, stream))
        elif fault.kind == "forging":
            nodes.append(_forger(scenario, fault, stream))
    return nodes


def _forger(scenario: BusTables, fault: BusFault, stream: str) -> ForgingNode:
    assert fault.message is not None
    kind = Kind[fault.message.upper()]
    places = scenario.breaker if kind is Kind.BREAKER_STATUS else scenario.relay
    identifier = kind + [place.name for place in places].index(fault.node or "")
    seal: Seal = PLAIN
    if scenario.can.keys is not None:
        seal = CmacSeal({identifier: Random(f"{stream}/key").randbytes(16)}, scenario.scenario.start_ns)
    return ForgingNode(fault, stream, identifier, seal)
