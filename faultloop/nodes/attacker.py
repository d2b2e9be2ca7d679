"""Nodes that should not be there: a babbling idiot, and one that forges the frames of another."""

from __future__ import annotations

from random import Random

from faultloop.config.bus_fault import BusFault
from faultloop.io.can.authentication import PLAIN, SEALED_BYTES, CmacSeal, Seal, unsealed
from faultloop.io.can.frames import Differential, Frame, State, decode, ticks
from faultloop.io.can.table import Kind
from faultloop.nodes.clock import FOREVER
from faultloop.nodes.tables import BusTables

POLES = {"A": 1, "B": 2, "C": 4, "AB": 3, "BC": 6, "CA": 5, "ABC": 7}
HEARD = 64
"""Frames that a replaying forger remembers."""
FORGED_A = 20_000.0
"""The current of a crafted set of differential data, in each of its poles."""


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
        differential = self.identifier & ~0xF == Kind.DIFFERENTIAL
        if self.fault.content == "random":
            plain = 32 if differential else 8
            length = plain if self._seal is PLAIN else SEALED_BYTES[plain]
            return Frame(self.identifier, self._random.randbytes(length), fd=length > 8, brs=length > 8)
        if self.fault.content == "replayed":
            return self._random.choice(self._heard) if self._heard else None
        message = self._set(t_ns) if differential else self._state(t_ns)
        return None if message is None else self._seal.close(t_ns, message.encode())

    def _set(self, t_ns: int) -> Differential | None:
        """The victim's last set with another time and other currents: what both ends agree on is right."""
        heard = decode(unsealed(self._heard[-1])) if self._heard else None
        if not isinstance(heard, Differential):
            return None
        mask = POLES[self.fault.poles]
        currents = [complex(FORGED_A if mask >> phase & 1 else 0.0) for phase in range(3)]
        return heard._replace(
            time=t_ns // 1000 % 2**32,
            currents=(currents[0], currents[1], currents[2]),
            counter=(heard.counter + 1) % 256,
        )

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
