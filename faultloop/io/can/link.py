"""What carries frames beyond this process, and how an installed package brings one of its own.

A package registers ``open_link(channel, identifiers) -> Link`` under the entry point group
``faultloop.transports``; its name there is the INTERFACE of ``--can INTERFACE:CHANNEL`` and of ``[can]``.
`identifiers` are those of the frames that are wanted, None for all.  Where it has a third parameter,
`scenario`, that is the run's scenario; None where there is none, as for a monitor.  ``goose`` is built in.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from inspect import signature
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from faultloop.config.user_code import entry_point_names, load
from faultloop.errors import InputError
from faultloop.io.can.frames import Frame

GROUP = "faultloop.transports"
BUILT_IN = {"goose": "faultloop.io.iec61850.link:open_link"}


class Link(Protocol):
    """What a node needs of a bus."""

    sent: int
    received: int
    retries: int
    """How often the transmit queue was full and a frame had to be offered again."""
    errors: int
    """Error frames of the controller."""

    def send(self, frame: Frame) -> None: ...

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        """Frames that have come, each with the monotonic time of its taking [ns]; waits for the first one
        up to `timeout_s`."""
        ...

    @property
    def dropped(self) -> int:
        """Frames that the kernel could not keep for us."""
        ...

    def close(self) -> None: ...


class Clock(Protocol):
    """The run's time on the monotonic clock."""

    @property
    def start_ns(self) -> int:
        """Time zero in UTC [ns since 1970]."""
        ...

    def at(self, monotonic_ns: int) -> int:
        """Run time at an instant of the monotonic clock [ns]."""
        ...


@runtime_checkable
class TimedLink(Protocol):
    """A link that has use for the run's time, which it is told as soon as that is known."""

    def attend(self, clock: Clock) -> None: ...


def transport_names() -> tuple[str, ...]:
    """Of the transports that are built in or that installed packages bring."""
    return tuple(sorted({*BUILT_IN, *entry_point_names(GROUP)}))


def transport_named(name: str, scenario: Any = None) -> Callable[[str, Collection[int] | None], Link] | None:
    """What opens a transport of that name for a run of `scenario`; None where there is none.

    Raises
    ------
    InputError : it cannot be imported or, when it is called, opened.
    """
    if name not in transport_names():
        return None
    make = load(BUILT_IN.get(name, name), Path(), GROUP)
    told = {"scenario": scenario} if "scenario" in signature(make).parameters else {}

    def open_link(channel: str, identifiers: Collection[int] | None) -> Link:
        try:
            return make(channel, identifiers, **told)
        except InputError:
            raise
        except Exception as error:  # somebody's package may raise anything
            raise InputError(f"{name}:{channel} cannot be opened ({error!r})", key="--can") from error

    return open_link
