"""A relay's side of the bus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from faultloop.io.can.authentication import PLAIN, Seal
from faultloop.io.can.frames import Frame
from faultloop.io.can.port import NOBODY, PILOT, TRANSFER
from faultloop.io.can.record import Record
from faultloop.io.can.table import Kind
from faultloop.jit import njit
from faultloop.nodes.goose import NOTHING_HEARD, Publisher, Repetition, Subscriber, set_state
from faultloop.nodes.node import Node, Nodes
from faultloop.nodes.refusals import Report, unheard
from faultloop.nodes.sets import sources

CHANNEL_GRACE_NS = 10_000_000
"""Of a channel's jitter, and of one lost repetition, beyond the time allowed to live."""
TRANSFER_FRAMES = 2
"""That must agree before a relay is tripped from afar: a single corrupted one is the commonest wrong trip."""
HEARD = np.dtype([(name, "i8") for name in ("closed", "received", "received_all", "transferred", "linked")])
"""A relay's binary inputs, as its node has them."""


@njit
def hear(nodes: Nodes, i: int, q: Record) -> None:
    """A relay's binary inputs: the closed poles of its breaker, all where it has none or has heard nothing
    yet; the poles for which any partner, and for which every one, sends its pilot signal; those of a
    transferred trip; whether every channel works.  A partner whose channel is silent sends nothing."""
    n = nodes.node[i]
    first = n.first_subscriber
    closed = nodes.subscribers[first].poles
    some, every, transferred, linked = 0, 7, 0, 1
    for k in range(first + 1, first + n.subscribers):
        s = nodes.subscribers[k]
        poles = 0 if s.poles == NOTHING_HEARD or s.alarm else s.poles
        if s.kind == TRANSFER:
            transferred |= poles
        elif s.kind == PILOT and (n.linked == 0 or k <= first + n.linked):
            some |= poles
            every &= poles
            linked &= 1 - s.alarm
    q.closed = 7 if closed == NOTHING_HEARD else closed
    q.received = some
    q.received_all = every & some
    q.transferred = transferred
    q.linked = linked


@njit
def hear_first(nodes: Nodes, i: int, heard: Any) -> None:
    """`hear` for whoever is not compiled."""
    hear(nodes, i, heard[0])


def published(linked: bool, back_trips: bool) -> tuple[Kind, ...]:
    """The states that a relay publishes; of these the last ones only where somebody hears them."""
    kinds = [Kind.TRIP, Kind.CLOSE, Kind.PILOT]
    kinds += [Kind.TRANSFER] if linked else []
    kinds += [Kind.BREAKER_FAILURE] if back_trips else []
    return tuple(kinds)


class RelayNode(Node):
    """A relay's side of the bus: publishes trip, close, pilot and measurements; follows breaker and far end.

    Parameters
    ----------
    number : of the relay, 0 to 15.
    breaker : number of the breaker it trips and follows, None if it has none.
    partners : numbers of the relays whose pilot signal it takes.
    agreement : hash of what the ends of its line differential must have alike; 0: it has none.
    linked : of those that a channel links to it: it misses their signals, and takes their transferred trips.
    back_trips : it tells the breakers around when its own has failed.
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
        linked: Sequence[int] = (),
        back_trips: bool = False,
        agreement: int = 0,
    ) -> None:
        repetition = Repetition(heartbeat_ns=round(heartbeat_s * 1e9))
        through = Repetition(heartbeat_ns=repetition.heartbeat_ns, grace_ns=CHANNEL_GRACE_NS)
        self.breaker = breaker
        self.partners = (*linked, *(partner for partner in partners if partner not in linked))
        self.linked = tuple(linked)
        heard = [(Kind.BREAKER_STATUS, NOBODY - Kind.BREAKER_STATUS if breaker is None else breaker)]
        heard += [(Kind.PILOT, partner) for partner in self.partners]
        heard += [(Kind.TRANSFER, partner) for partner in linked]
        self._kinds = kinds = published(bool(linked), back_trips)
        self._heard = np.zeros(1, HEARD)
        super().__init__(
            number,
            [Publisher(kind, number, 0, start_ns, repetition) for kind in kinds],
            [
                Subscriber(
                    through if kind != Kind.BREAKER_STATUS and other in linked else repetition,
                    start_ns=start_ns,
                    confirmations=max(confirmations, TRANSFER_FRAMES if kind == Kind.TRANSFER else 1),
                    kind=kind,
                    number=other,
                    expected=kind == Kind.PILOT and other in linked,
                )
                for kind, other in heard
            ],
            1 + len(linked),
            report,
            heartbeat_s=heartbeat_s,
            measurements_hz=measurements_hz,
            seal=seal,
            start_ns=start_ns,
            relay=number,
            linked=len(linked),
            sources=sources(number, linked, agreement) if agreement else None,
        )
        for key, kind in (("transfers", Kind.TRANSFER), ("back_trips", Kind.BREAKER_FAILURE)):
            self.nodes.node[key] = kinds.index(kind) if kind in kinds else 0

    @property
    def shown_ns(self) -> int:
        """When it shows what the relay measures next."""
        return int(self.nodes.node["measurements"]["next_ns"][self.place])

    def set(
        self, t_ns: int, trip: int, close: int, pilot: int, transfer: int = 0, back_trip: int = 0
    ) -> None:
        """The relay's outputs from `t_ns` on, each a mask of poles."""
        outputs = {Kind.TRANSFER: transfer, Kind.BREAKER_FAILURE: back_trip}
        outputs |= {Kind.TRIP: trip, Kind.CLOSE: close, Kind.PILOT: pilot}
        for k, kind in enumerate(self._kinds):
            set_state(self.publisher(k), outputs[kind], t_ns)

    def receive(self, t_ns: int, frame: Frame) -> bool:
        """Take a frame; True where the relay's inputs have changed."""
        return self.take(t_ns, frame) is not None

    @property
    def heard(self) -> tuple[int, ...]:
        """The relay's binary inputs, in the order of `HEARD`."""
        hear_first(self.nodes, self.place, self._heard)
        return tuple(self._heard[0].tolist())

    @property
    def breaker_closed(self) -> int:
        """Closed poles of its breaker, as last accepted; all where it has none or has heard nothing yet."""
        return self.heard[0]

    @property
    def pilot_received(self) -> int:
        """Poles for which any partner sends its pilot signal."""
        return self.heard[1]

    @property
    def silences(self) -> int:
        """How often a channel has fallen silent."""
        return int(self.nodes.node["silences"][self.place])
