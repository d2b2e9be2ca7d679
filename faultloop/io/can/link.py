"""What carries frames beyond this process, and how an installed package brings one of its own.

A package registers ``open_link(channel, identifiers) -> Link`` under the entry point group
``faultloop.transports``; its name there is the INTERFACE of ``--can INTERFACE:CHANNEL`` and of ``[can]``.
`identifiers` are those of the frames that are wanted, None for all.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Protocol

from faultloop.config.user_code import entry_point_names, load
from faultloop.errors import InputError
from faultloop.io.can.frames import Frame

GROUP = "faultloop.transports"


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


def transport_names() -> tuple[str, ...]:
    """Of the transports that installed packages bring."""
    return entry_point_names(GROUP)


def transport_named(name: str) -> Callable[[str, Collection[int] | None], Link] | None:
    """What opens a transport that an installed package brings; None where none brings one of that name.

    Raises
    ------
    InputError : it cannot be imported or, when it is called, opened.
    """
    if name not in transport_names():
        return None
    make = load(name, Path(), GROUP)

    def open_link(channel: str, identifiers: Collection[int] | None) -> Link:
        try:
            return make(channel, identifiers)
        except InputError:
            raise
        except Exception as error:  # somebody's package may raise anything
            raise InputError(f"{name}:{channel} cannot be opened ({error!r})", key="--can") from error

    return open_link
