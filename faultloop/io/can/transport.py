"""The simulation's bus: the model of it for the times, a python-can bus for whoever else is there.

Every frame goes through the model (`SimulatedBus`), which says when it arrives; then it is put on a
python-can bus, in-process (``virtual``) or real (``socketcan``), where others see it.  What others put on
that bus is taken into the model.  So the same run gives the same times whether or not anybody listens.
"""

from __future__ import annotations

import errno
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

from faultloop.errors import InputError, nearest
from faultloop.io.can.bus import BusLoad, Delivery, SimulatedBus
from faultloop.io.can.confinement import StateChange
from faultloop.io.can.frames import Frame
from faultloop.io.can.link import TimedLink, transport_named, transport_names
from faultloop.io.can.message import from_message, to_message

if TYPE_CHECKING:
    from can import BusABC, Message

SEND_WITHIN_S = 1.0
"""How long a full transmit queue ("No buffer space available") is waited for."""

CAN_FD_MTU = 72
EXTERNAL = "external"
"""Sender of the frames that others put on the bus."""


class CanSettings(Protocol):
    """What `open_transport` reads: a scenario's ``[can]`` table."""

    @property
    def interface(self) -> str: ...
    @property
    def channel(self) -> str: ...
    @property
    def bitrate(self) -> int: ...
    @property
    def data_bitrate(self) -> int: ...
    @property
    def fd(self) -> bool: ...


def open_bus(
    interface: str = "virtual",
    channel: str = "faultloop",
    bitrate: int = 500_000,
    fd: bool = False,
    scenario: Any = None,
) -> BusABC:
    """A python-can bus.

    Parameters
    ----------
    interface : a python-can interface; ``virtual`` is in-process, and keeps the time stamps that it is given.
        Or the name of a transport that an installed package brings (`faultloop.io.can.link`).
    channel : its channel, as in ``vcan0``.
    bitrate : nominal bit rate [bit/s]; SocketCAN takes it from ``ip link``, not from here.
    fd : also CAN FD frames.
    scenario : of the run, for a transport that has use for it.

    Raises
    ------
    InputError : no such interface or channel, or it is down, or it does not carry CAN FD.
    """
    if (brought := transport_named(interface, scenario)) is not None:
        from faultloop.io.can.linked_bus import LinkedBus

        return LinkedBus(channel, brought(channel, None), fd)
    import can

    if interface not in can.VALID_INTERFACES:
        known = sorted({*can.VALID_INTERFACES, *transport_names()})
        raise InputError(f"no CAN interface '{interface}': {nearest(interface, known)}")
    if interface == "virtual":
        protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        return can.Bus(
            channel, interface="virtual", preserve_timestamps=True, protocol=protocol, ignore_config=True
        )
    if interface == "socketcan":
        check_socketcan(channel, fd)
        return _opened(lambda: can.Bus(channel, interface="socketcan", fd=fd, ignore_config=True), channel)
    return _opened(lambda: can.Bus(channel, interface=interface, bitrate=bitrate, fd=fd), channel)


def open_transport(
    settings: CanSettings, channel: str | None = None, *, start_ns: int = 0, scenario: Any = None
) -> Transport:
    """The bus of a run, from its settings; to be used in a `with`.

    Parameters
    ----------
    settings : interface, channel, bit rates, CAN FD.
    channel : ``"INTERFACE:CHANNEL"`` in place of the settings' interface and channel.
    start_ns : what the run's time zero is on the clock of the time stamps [ns since 1970].
    scenario : of the run, for a transport that has use for it.
    """
    interface, name = settings.interface, settings.channel
    if channel is not None:
        interface, colon, name = channel.partition(":")
        if not (interface and colon and name):
            raise InputError(f"'{channel}' is not INTERFACE:CHANNEL, as in socketcan:vcan0", key="--can")
    if interface == "socketcan":
        check_bit_rates(name, settings.bitrate, settings.data_bitrate if settings.fd else None)
    bus = open_bus(interface, name, settings.bitrate, settings.fd, scenario)
    transport = Transport(
        SimulatedBus(settings.bitrate, settings.data_bitrate), bus, settings.fd, start_ns=start_ns
    )
    if isinstance(bus, TimedLink):
        bus.attend(transport)
    return transport


class Transport:
    """Carries the frames of a run.

    Parameters
    ----------
    model : says when each frame arrives.
    bus : where each frame is shown to others, and theirs are taken from; None for nobody.
    fd : the bus carries CAN FD frames.
    start_ns : added to the run's time in the time stamps of the frames on `bus` [ns].
    """

    def __init__(
        self, model: SimulatedBus, bus: BusABC | None = None, fd: bool = False, *, start_ns: int = 0
    ) -> None:
        self.model = model
        self.bus = bus
        self.fd = fd
        self.start_ns = start_ns
        self.ignored = 0
        """Frames of others without use here: remote, error, and FD frames where the bus is classic."""

    @classmethod
    def alone(cls, settings: CanSettings) -> Self:
        """The model of the bus, with nobody else on it: what one run does is no other run's affair."""
        return cls(SimulatedBus(settings.bitrate, settings.data_bitrate), None, settings.fd)

    def submit(self, t_ns: int, frame: Frame, sender: object = None) -> None:
        """Offer a frame at `t_ns`, not before the time up to which the bus was advanced."""
        if frame.fd and not self.fd:
            raise InputError("a CAN FD frame on a bus without CAN FD: set fd = true", key="can.fd")
        self.model.submit(t_ns, frame, sender)

    def next_event_ns(self) -> int | None:
        """When the next frame is received, from what is submitted now; None if none is under way."""
        return self.model.next_event_ns()

    def at(self, monotonic_ns: int) -> int:
        """Run time [ns]: as far as the bus was advanced, whenever that is asked."""
        return self.model.now_ns

    def pending(self) -> list[Frame]:
        """The frames that are waiting or on the wire."""
        return self.model.pending()

    def controller_changes(self) -> list[StateChange]:
        """What fault confinement did to the senders' controllers since the last call."""
        if not self.model.changes:
            return []
        changes, self.model.changes = self.model.changes, []
        return changes

    def bus_off(self, t_ns: int) -> frozenset[object]:
        """Who is bus-off at `t_ns`, the time up to which the bus was advanced: it hears nothing."""
        return self.model.bus_off(t_ns)

    def waiting_from(self, sender: object) -> int:
        """How many frames of a sender wait for the bus."""
        return self.model.waiting_from(sender)

    def advance(self, until_ns: int) -> list[Delivery]:
        """Let time pass, for good: what was received up to `until_ns` has been shown to the others, too.

        Frames of others that are found now are offered at `until_ns`: before it is past.
        """
        return self.shared(self.model.advance(until_ns))

    def shared(self, received: list[Delivery]) -> list[Delivery]:
        """What was received is shown to the others, and theirs is taken in."""
        if self.bus is not None:
            for delivery in received:
                if delivery.sender != EXTERNAL:
                    self._show(self.bus, delivery)
            self._take_in(self.bus)
        return received

    def load(self, duration_ns: int) -> float:
        """Part of `duration_ns` in which the bus was not idle, 0 to 1."""
        return self.model.busy(duration_ns)

    @property
    def statistics(self) -> BusLoad:
        """What went over the bus, by identifier."""
        return self.model.load

    def close(self) -> None:
        """Leave the bus."""
        if self.bus is not None:
            self.bus.shutdown()
            self.bus = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _take_in(self, bus: BusABC) -> None:
        while (message := _received(bus)) is not None:
            if message.is_error_frame or message.is_remote_frame or (message.is_fd and not self.fd):
                self.ignored += 1
            else:
                self.model.submit(self.model.now_ns, from_message(message), EXTERNAL)

    def _show(self, bus: BusABC, delivery: Delivery) -> None:
        send(bus, to_message(delivery.frame, self.start_ns + delivery.t_ns))


def send(bus: BusABC, message: Message) -> None:
    """Send; wait, with a bound, where the transmit queue is full."""
    import can

    deadline = time.monotonic() + SEND_WITHIN_S
    while True:
        try:
            return bus.send(message, timeout=SEND_WITHIN_S)
        except can.CanOperationError as error:
            code = error.error_code
            if code == errno.ENOBUFS and time.monotonic() < deadline:
                time.sleep(0.0005)
                continue
            raise InputError(f"cannot send: {_reason(error, code)}", key=bus.channel_info) from error


def _received(bus: BusABC) -> Message | None:
    import can

    try:
        return bus.recv(0)
    except can.CanOperationError as error:
        code = error.error_code
        raise InputError(f"cannot receive: {_reason(error, code)}", key=bus.channel_info) from error


def _opened(make: Callable[[], BusABC], channel: str) -> BusABC:
    """The bus, or one line that says why not: each interface has its own exceptions for that."""
    import can

    try:
        return make()
    except (can.CanError, OSError, ValueError, TypeError, ImportError, AttributeError) as error:
        raise InputError(
            f"cannot open: {_reason(error, getattr(error, 'errno', None))}", key=channel
        ) from error


def _reason(error: Exception, code: int | None) -> str:
    if code == errno.ENETDOWN:
        return "the interface is down: ip link set CHANNEL up"
    if code == errno.ENOBUFS:
        return (
            f"the transmit queue has been full for {SEND_WITHIN_S:g} s: raise its txqueuelen, or run slower"
        )
    return str(error) or type(error).__name__


def check_socketcan(channel: str, fd: bool) -> None:
    """InputError where SocketCAN has no such interface, it is down, or it carries no FD frames.

    `bind` would not tell of the last two.
    """
    if not sys.platform.startswith("linux"):
        raise InputError("SocketCAN is of Linux: use interface = 'virtual'", key="interface")
    device = Path("/sys/class/net") / channel
    if not device.is_dir():
        names = sorted(path.name for path in device.parent.glob("*can*"))
        hint = nearest(channel, names) if names else "ip link add dev vcan0 type vcan makes a virtual one"
        raise InputError(f"no CAN interface of this name: {hint}", key=channel)
    if not int((device / "flags").read_text(encoding="ascii"), 16) & 1:  # IFF_UP
        raise InputError(f"the interface is down: ip link set {channel} up", key=channel)
    if fd and int((device / "mtu").read_text(encoding="ascii")) < CAN_FD_MTU:
        raise InputError(
            f"the interface carries no CAN FD: ip link set {channel} mtu {CAN_FD_MTU}", key=channel
        )


def check_bit_rates(channel: str, bitrate: int, data_bitrate: int | None = None) -> None:
    """InputError where a SocketCAN controller runs at another bit rate: it would only disturb the bus.

    A virtual interface has no bit rate.
    """
    if not (Path("/sys/class/net") / channel / "device").exists():
        return
    actual = bit_rates(_told_by_ip(channel))
    for wanted, got, key, option in (
        (bitrate, actual[0], "bitrate", "bitrate"),
        (data_bitrate, actual[1], "data_bitrate", "dbitrate"),
    ):
        if None not in (wanted, got) and wanted != got:
            raise InputError(
                f"runs at {got} bit/s, and [can] {key} is {wanted}: set it to {got}, or take the"
                f" interface down and say ip link set {channel} type can {option} {wanted}",
                key=channel,
            )


def bit_rates(told: str) -> tuple[int | None, int | None]:
    """Nominal and data bit rate in what ``ip -details -json link show`` says; None where it has none."""
    try:
        data = json.loads(told)[0]["linkinfo"]["info_data"]
    except (ValueError, LookupError, TypeError):
        return None, None
    nominal, fast = (data.get(key, {}).get("bitrate") for key in ("bittiming", "data_bittiming"))
    return nominal, fast


def _told_by_ip(channel: str) -> str:
    """The kernel tells bit rates by netlink only, and iproute2 is how one asks."""
    command = ["ip", "-details", "-json", "link", "show", "dev", channel]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=5, check=False).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ""
