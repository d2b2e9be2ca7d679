"""A breaker's side of the bus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from faultloop.io.can.authentication import PLAIN, Seal
from faultloop.io.can.frames import Frame
from faultloop.io.can.table import RELAYS, Kind
from faultloop.nodes.goose import Publisher, Repetition, Subscriber, set_state
from faultloop.nodes.node import Node
from faultloop.nodes.refusals import Report


@dataclass(frozen=True, slots=True)
class Command:
    """What a breaker node accepted from the bus."""

    t_ns: int
    operation: Literal["open", "close"]
    poles: int
    relay: int

    @classmethod
    def of(cls, t_ns: int, message: Any) -> Command | None:
        """In a ``MESSAGE`` that was accepted at `t_ns`; None where it commands nothing."""
        poles = int(message["poles"])
        operation: Literal["open", "close"] = "close" if message["kind"] == Kind.CLOSE else "open"
        return cls(t_ns, operation, poles, int(message["number"])) if poles else None


def commands_of(relays: Sequence[int], backed_up: Sequence[int]) -> list[tuple[Kind, int]]:
    """What a breaker obeys: kind of message and relay."""
    own = [(kind, relay) for relay in relays for kind in (Kind.TRIP, Kind.CLOSE)]
    return own + [(Kind.BREAKER_FAILURE, relay) for relay in backed_up]


class BreakerNode(Node):
    """A breaker's side of the bus: acts on trip and close frames of its relays, publishes its position.

    Parameters
    ----------
    number : of the breaker, 0 to 15.
    relays : numbers of the relays that may command it.
    backed_up : numbers of the relays that open it when a breaker beside it has failed.
    closed : mask of closed poles at the start.
    report : told of the frames that it refuses, and why.
    seal : what its state frames pass, in and out.
    start_ns : when it starts, run time [ns]; it acts on no frame that was sent before.
    confirmations : frames that must agree before it acts.
    """

    def __init__(
        self,
        number: int,
        relays: Sequence[int],
        closed: int,
        heartbeat_s: float,
        report: Report,
        *,
        seal: Seal = PLAIN,
        start_ns: int = 0,
        confirmations: int = 1,
        backed_up: Sequence[int] = (),
    ) -> None:
        repetition = Repetition(heartbeat_ns=round(heartbeat_s * 1e9))
        status = Publisher(Kind.BREAKER_STATUS, number, closed, start_ns, repetition)
        commands = [
            Subscriber(repetition, start_ns=start_ns, confirmations=confirmations, kind=kind, number=relay)
            for kind, relay in commands_of(relays, backed_up)
        ]
        super().__init__(
            RELAYS + number,
            [status],
            commands,
            len(commands),
            report,
            heartbeat_s=heartbeat_s,
            seal=seal,
            start_ns=start_ns,
        )

    def set(self, t_ns: int, closed: int) -> None:
        """Its position from `t_ns` on."""
        set_state(self.publisher(0), closed, t_ns)

    def receive(self, t_ns: int, frame: Frame) -> Command | None:
        """Take a frame; the command in it, once for each state, or None.

        A frame that is for somebody else is passed over; one that is for it and fails any check, or whose
        identifier is nobody's, is refused and counted.
        """
        message = self.take(t_ns, frame)
        return None if message is None else Command.of(t_ns, message)
