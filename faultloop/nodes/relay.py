"""A relay's side of the bus."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultloop.io.can.authentication import PLAIN, Seal
from faultloop.io.can.frames import Frame
from faultloop.io.can.port import NOBODY
from faultloop.io.can.table import Kind
from faultloop.nodes.goose import NOTHING_HEARD, Publisher, Repetition, Subscriber, set_state
from faultloop.nodes.node import Node
from faultloop.nodes.refusals import Report, unheard


class RelayNode(Node):
    """A relay's side of the bus: publishes trip, close, pilot and measurements; follows breaker and far end.

    Parameters
    ----------
    number : of the relay, 0 to 15.
    breaker : number of the breaker it trips and follows, None if it has none.
    partners : numbers of the relays whose pilot signal it takes.
    heartbeat_s, measurements_hz : how often it publishes while nothing happens.
    report : told of the frames that it refuses, and why.
    seal : what its state frames pass, in and out.
    start_ns : when it starts, run time [ns]; it acts on no frame that was sent before.
    confirmations : frames that must agree before it acts.
    """

    def __init__(
        self,
        number: int,
        breaker: int | None,
        partners: Sequence[int],
        heartbeat_s: float,
        measurements_hz: float,
        report: Report = unheard,
        *,
        seal: Seal = PLAIN,
        start_ns: int = 0,
        confirmations: int = 1,
    ) -> None:
        repetition = Repetition(heartbeat_ns=round(heartbeat_s * 1e9))
        self.breaker = breaker
        self.partners = tuple(partners)
        heard = [(Kind.BREAKER_STATUS, NOBODY - Kind.BREAKER_STATUS if breaker is None else breaker)]
        heard += [(Kind.PILOT, partner) for partner in partners]
        super().__init__(
            number,
            [
                Publisher(kind, number, 0, start_ns, repetition)
                for kind in (Kind.TRIP, Kind.CLOSE, Kind.PILOT)
            ],
            [
                Subscriber(
                    repetition, start_ns=start_ns, confirmations=confirmations, kind=kind, number=other
                )
                for kind, other in heard
            ],
            1,
            report,
            heartbeat_s=heartbeat_s,
            measurements_hz=measurements_hz,
            seal=seal,
            start_ns=start_ns,
            relay=number,
        )

    @property
    def shown_ns(self) -> int:
        """When it shows what the relay measures next."""
        return int(self.nodes.node["measurements"]["next_ns"][self.place])

    def set(self, t_ns: int, trip: int, close: int, pilot: int) -> None:
        """The relay's outputs from `t_ns` on, each a mask of poles."""
        for k, poles in enumerate((trip, close, pilot)):
            set_state(self.publisher(k), poles, t_ns)

    def receive(self, t_ns: int, frame: Frame) -> bool:
        """Take a frame; True where the relay's inputs have changed."""
        return self.take(t_ns, frame) is not None

    @property
    def breaker_closed(self) -> int:
        """Closed poles of its breaker, as last accepted; all where it has none or has heard nothing yet."""
        poles = int(self.subscribers()["poles"][0])
        return 7 if poles == NOTHING_HEARD else poles

    @property
    def pilot_received(self) -> int:
        """Poles for which any partner sends its pilot signal."""
        poles = self.subscribers()["poles"][1:]
        return int(np.bitwise_or.reduce(poles[poles != NOTHING_HEARD], initial=0))
