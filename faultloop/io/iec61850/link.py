"""The transport ``goose``: what nodes say as GOOSE and Sampled Values on an Ethernet interface.

faultloop run SCENARIO.toml --processes --can goose:eth0
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Collection

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame
from faultloop.io.can.link import Clock
from faultloop.io.can.table import PLANT_NODE, Kind
from faultloop.io.iec61850 import require
from faultloop.io.iec61850.ethernet import EthernetSocket
from faultloop.io.iec61850.gateway import GOOSE, SAMPLED_VALUES, Gateway
from faultloop.io.iec61850.sampled_values import station_profile
from faultloop.io.iec61850.streams import Station, Tables

BUS_FAULTS = ("loss", "delay", "duplication", "reordering", "bus_off", "restart")
"""What can befall messages here; the others are of the bits of CAN."""
FOREIGN_AFTER = 2.5
"""Heartbeats without one of the plant: then merging units of others tell the time."""


class GooseLink:
    """A node's place on a process bus.

    Parameters
    ----------
    interface : as in ``eth0``.
    identifiers : of the frames that are wanted; None for all.
    station : who is on the bus.
    """

    def __init__(self, interface: str, identifiers: Collection[int] | None, station: Station) -> None:
        self.sent = self.received = 0
        self._gateway = gateway = Gateway(station, identifiers)
        self._socket = EthernetSocket(interface, (GOOSE, SAMPLED_VALUES), gateway.app_ids)
        self._own: set[bytes] = set()
        self._everything = identifiers is None
        self._clock: Clock | None = None
        self._opened_ns = time.monotonic_ns()
        gateway.start_ns = time.time_ns() - self._opened_ns

    def attend(self, clock: Clock) -> None:
        """The run's time from now on."""
        self._clock = clock
        self._gateway.start_ns = clock.start_ns

    def send(self, frame: Frame) -> None:
        """Send a frame as the message that it is; a sample may wait for those that go with it."""
        for data in self._gateway.encode(frame, self._at(time.monotonic_ns())):
            self._own.add(data[6:12])
            self._socket.send(data)
            self.sent += 1

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        frames: list[tuple[int, Frame]] = []
        for at_ns, data in self._socket.receive(timeout_s):
            if data[6:12] not in self._own:
                found = self._gateway.decode(data, self._at(at_ns), numbered=self._clock is not None)
                frames += [(at_ns, frame) for frame in found if self._tells(at_ns, frame)]
        self.received += len(frames)
        return frames

    def _at(self, monotonic_ns: int) -> int:
        return monotonic_ns if self._clock is None else self._clock.at(monotonic_ns)

    def _tells(self, at_ns: int, frame: Frame) -> bool:
        """A sample has a number within its second only: before the run's time is known it tells that time
        where there is no plant of ours, whose heartbeat does."""
        if self._clock is not None or self._everything:
            return True
        if frame.id == Kind.HEARTBEAT + PLANT_NODE:
            return True
        waited = at_ns - self._opened_ns
        return waited > FOREIGN_AFTER * self._gateway.station.heartbeat_ns

    @property
    def refused(self) -> Counter[str]:
        """Messages of our streams that did not count, by cause."""
        return self._gateway.refused

    @property
    def errors(self) -> int:
        """How many those were."""
        return self.refused.total()

    @property
    def retries(self) -> int:
        """How often the transmit queue was full."""
        return self._socket.retries

    @property
    def dropped(self) -> int:
        """Frames that the kernel could not keep for us."""
        return self._socket.dropped

    def close(self) -> None:
        self._socket.close()


def open_link(channel: str, identifiers: Collection[int] | None, scenario: Tables | None = None) -> GooseLink:
    """The Ethernet interface `channel`.

    Raises
    ------
    InputError : the extra is not installed, the interface cannot be opened, or the scenario cannot be
    carried.
    """
    require("--can")
    if scenario is not None:
        check(scenario)
    return GooseLink(channel, identifiers, Station() if scenario is None else Station.of(scenario))


def check(scenario: Tables) -> None:
    """InputError where GOOSE and Sampled Values cannot carry a scenario."""
    station_profile(Station.of(scenario))
    if scenario.can.keys is not None:
        raise InputError(
            "GOOSE carries no authenticated frames (IEC 62351-6 is not there): leave keys out", key="can.keys"
        )
    for fault in scenario.bus_fault:
        if fault.kind not in BUS_FAULTS:
            raise InputError(
                f"{fault.kind} is of the frames of CAN; on GOOSE there can be {', '.join(BUS_FAULTS)}",
                key=f"bus_fault[{fault.name}].kind",
            )
