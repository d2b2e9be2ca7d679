"""What the plant hears of a breaker that is a device of somebody else's."""

from __future__ import annotations

from typing import Literal, NamedTuple

from faultloop.io.can.authentication import PLAIN, Seal
from faultloop.io.can.frames import Frame
from faultloop.io.can.table import Kind
from faultloop.nodes.goose import Repetition, Subscriber
from faultloop.nodes.node import Node
from faultloop.nodes.refusals import Report
from faultloop.nodes.tables import BusTables


class Movement(NamedTuple):
    """Poles that a breaker says have opened or closed."""

    operation: Literal["open", "close"]
    poles: int


class BreakerFollower(Node):
    """Turns the accepted states of one breaker's BREAKER_STATUS into what its poles did.

    Parameters
    ----------
    number : of the breaker, 0 to 15.
    closed : mask of closed poles at the start.
    heartbeat_s : its longest interval of repetition.
    report : told of the frames that are refused, and why.
    seal, start_ns, confirmations : as a `BreakerNode` has them.
    """

    def __init__(
        self,
        number: int,
        closed: int,
        heartbeat_s: float,
        report: Report,
        *,
        seal: Seal = PLAIN,
        start_ns: int = 0,
        confirmations: int = 1,
    ) -> None:
        repetition = Repetition(heartbeat_ns=round(heartbeat_s * 1e9))
        status = Subscriber(
            repetition,
            start_ns=start_ns,
            confirmations=confirmations,
            kind=Kind.BREAKER_STATUS,
            number=number,
        )
        super().__init__(number, [], [status], 0, report, seal=seal, start_ns=start_ns, strict=False)
        self.closed = closed

    def receive(self, t_ns: int, frame: Frame) -> list[Movement]:
        """Take a frame; what the poles did, once for each state."""
        message = self.take(t_ns, frame)
        if message is None:
            return []
        poles = int(message["poles"])
        moved, self.closed = self.closed ^ poles, poles
        both = (Movement("open", moved & ~poles), Movement("close", moved & poles))
        return [movement for movement in both if movement.poles]


def with_followed_breakers(scenario: BusTables, names: frozenset[str]) -> BusTables:
    """The scenario for the plant: a followed breaker has its own delay, and the plant adds none.

    Its pole opens at the first current zero after the status that says so, and closes at once.  What it does
    by itself is its own business.
    """
    breakers = [
        b.model_copy(update={"operate_ms": 0.0, "close_ms": 0.0}) if b.name in names else b
        for b in scenario.breaker
    ]
    switching = [s for s in scenario.switching if s.breaker not in names]
    return scenario.model_copy(update={"breaker": tuple(breakers), "switching": tuple(switching)})
