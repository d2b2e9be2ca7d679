"""Errors on the wire: error frames and fault confinement (ISO 11898-1:2015, 10.4.4 and 12.1.4).

Whoever sees an error flags it: an error-active node with six dominant bits.  They break a rule for all the
others, who flag, too: the flags together take 6 to 12 bits (`bits.receivers_late`).  Eight recessive bits of
delimiter follow, then the intermission; then the frame is sent again.

A transmitter's error counter (TEC) goes up by 8 with each error and down by 1 with each frame sent; a
receiver's (REC) up by 1 and down by 1.  Above 127 a node is error-passive: its flag is recessive, and before
it sends again it leaves eight more bits to others.  Above 255 in TEC it is bus-off until it has seen 128
times 11 recessive bits; it hears nothing, and what it wants to send waits.

Errors here are disturbed bits that all nodes see alike.  Then all receivers flag at once, so none sees a
dominant bit after its own flag (which would cost it 8); the sender sees six at most (from eight on they would
cost it more).  Somebody always acknowledges, so the exceptions for a node that is alone do not arise.
Receivers that are all error-passive are taken to need as long as active ones.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from faultloop.io.can.frames import Frame
from faultloop.io.can.record import Record, Records
from faultloop.jit import njit

ERROR_PASSIVE = 127
BUS_OFF = 255
DELIMITER = 8
SUSPEND = 8
RECOVERY = 128
RECESSIVE = 11

ACTIVE, PASSIVE, OFF = range(3)
STATES = ("error-active", "error-passive", "bus-off")
"""As the standard names them."""
IN_SERVICE = -1

CONTROLLER = np.dtype(
    [
        ("sender", "i8"),  # number of the node
        ("bit_ns", "i8"),
        ("tec", "i8"),
        ("rec", "i8"),
        ("ready_ns", "i8"),  # may not send before: suspended, or recovering on a bus that stays idle
        ("sequences", "i8"),  # of 11 recessive bits, still to be seen; IN_SERVICE: it is not bus-off
    ]
)
"""Fault confinement of one node."""


class ErrorSource(Protocol):
    """Decides which transmissions are hit."""

    def hit(self, t_ns: int, frame: Frame, sender: object, bits: int) -> int | None:
        """Place of the bit that is disturbed, 0 to bits - 1, or None.

        Asked once for each transmission, of `bits` bits, that begins at `t_ns`.
        """
        ...


class StateChange(NamedTuple):
    """A node's controller changed its state."""

    t_ns: int
    sender: object
    state: str
    """One of `STATES`."""


@njit
def state_of(c: Record) -> int:
    """ACTIVE, PASSIVE or OFF."""
    if c.sequences != IN_SERVICE:
        return OFF
    return PASSIVE if max(c.tec, c.rec) > ERROR_PASSIVE else ACTIVE


@njit
def is_off(c: Record, t_ns: int) -> bool:
    """Is it bus-off at ``t_ns``, if the bus stays idle from now on?"""
    return c.sequences != IN_SERVICE and t_ns < c.ready_ns


@njit
def heard_error(c: Record) -> None:
    """Somebody else's frame was cut."""
    if c.sequences == IN_SERVICE:
        c.rec += 1


@njit
def heard_frame(c: Record) -> None:
    """Somebody else's frame went through.  The standard leaves the value after 128 and more open."""
    c.rec = max(min(c.rec, ERROR_PASSIVE + 1) - 1, 0)


@njit
def failed(c: Record, delimiter_ns: int, idle_ns: int) -> None:
    """Its frame was cut; the delimiter begins at ``delimiter_ns``, the bus is idle from ``idle_ns`` on."""
    c.tec += 8
    if c.tec > BUS_OFF:
        c.sequences = RECOVERY
        c.ready_ns = delimiter_ns + RECOVERY * RECESSIVE * c.bit_ns
    else:
        _suspend(c, idle_ns)


@njit
def succeeded(c: Record, idle_ns: int) -> None:
    """Its frame went through."""
    c.tec = max(c.tec - 1, 0)
    _suspend(c, idle_ns)


@njit
def _suspend(c: Record, idle_ns: int) -> None:
    c.ready_ns = idle_ns + (SUSPEND * c.bit_ns if state_of(c) == PASSIVE else 0)


@njit
def other_begins(c: Record, t_ns: int) -> None:
    """Somebody's frame begins: a run of recessive bits ends, and the wait goes on with the next one."""
    if c.sequences != IN_SERVICE:
        c.sequences = -((t_ns - c.ready_ns) // (RECESSIVE * c.bit_ns))


@njit
def run_begins(c: Record, t_ns: int) -> None:
    """The bus is recessive from ``t_ns`` on, as far as is known."""
    if c.sequences != IN_SERVICE:
        c.ready_ns = t_ns + c.sequences * RECESSIVE * c.bit_ns


@njit
def recovered(c: Record) -> None:
    """The last sequence was seen: it begins anew."""
    c.tec = 0
    c.rec = 0
    c.sequences = IN_SERVICE


class Controller:
    """Fault confinement of one node; times [ns].

    Parameters
    ----------
    bit_ns : of a nominal bit.
    record : a view of one ``CONTROLLER``, shape (1,); a new one where not given.
    """

    def __init__(self, bit_ns: int = 0, record: Records | None = None) -> None:
        if record is None:
            record = np.zeros(1, CONTROLLER)
            record["bit_ns"], record["sequences"] = bit_ns, IN_SERVICE
        self.record = record

    @property
    def tec(self) -> int:
        """Transmit error counter."""
        return int(self.record["tec"][0])

    @property
    def rec(self) -> int:
        """Receive error counter."""
        return int(self.record["rec"][0])

    @property
    def state(self) -> str:
        """As the standard names it."""
        return STATES[state_of(self.record[0])]

    def heard_error(self) -> None:
        """Somebody else's frame was cut."""
        heard_error(self.record[0])

    def heard_frame(self) -> None:
        """Somebody else's frame went through."""
        heard_frame(self.record[0])
