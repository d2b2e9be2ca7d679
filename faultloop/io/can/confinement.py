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

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from faultloop.io.can.frames import Frame

ERROR_PASSIVE = 127
BUS_OFF = 255
DELIMITER = 8
SUSPEND = 8
RECOVERY = 128
RECESSIVE = 11


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
    state: str  # "error-active", "error-passive", "bus-off"


@dataclass(slots=True)
class Controller:
    """Fault confinement of one node; times [ns]."""

    bit_ns: int
    tec: int = 0
    rec: int = 0
    ready_ns: int = 0
    """It may not send before: suspend transmission, or the recovery from bus-off on a bus that stays idle."""
    sequences: int | None = None
    """Of 11 recessive bits, still to be seen; None: it is not bus-off."""

    @property
    def state(self) -> str:
        """As the standard names it."""
        if self.sequences is not None:
            return "bus-off"
        return "error-passive" if max(self.tec, self.rec) > ERROR_PASSIVE else "error-active"

    def off(self, t_ns: int) -> bool:
        """Is it bus-off at `t_ns`, if the bus stays idle from now on?"""
        return self.sequences is not None and t_ns < self.ready_ns

    def heard_error(self) -> None:
        """Somebody else's frame was cut."""
        if self.sequences is None:
            self.rec += 1

    def heard_frame(self) -> None:
        """Somebody else's frame went through.  The standard leaves the value after 128 and more open."""
        self.rec = max(min(self.rec, ERROR_PASSIVE + 1) - 1, 0)

    def failed(self, delimiter_ns: int, idle_ns: int) -> None:
        """Its frame was cut; the delimiter begins at `delimiter_ns`, the bus is idle from `idle_ns` on."""
        self.tec += 8
        if self.tec > BUS_OFF:
            self.sequences = RECOVERY
            self.ready_ns = delimiter_ns + RECOVERY * RECESSIVE * self.bit_ns
        else:
            self._suspend(idle_ns)

    def succeeded(self, idle_ns: int) -> None:
        """Its frame went through."""
        self.tec = max(self.tec - 1, 0)
        self._suspend(idle_ns)

    def _suspend(self, idle_ns: int) -> None:
        self.ready_ns = idle_ns + (SUSPEND * self.bit_ns if self.state == "error-passive" else 0)

    def other_begins(self, t_ns: int) -> None:
        """Somebody's frame begins: a run of recessive bits ends, and the wait goes on with the next one."""
        if self.sequences is not None:
            left_ns = self.ready_ns - t_ns
            self.sequences = -(-left_ns // (RECESSIVE * self.bit_ns))

    def run_begins(self, t_ns: int) -> None:
        """The bus is recessive from `t_ns` on, as far as is known."""
        if self.sequences is not None:
            self.ready_ns = t_ns + self.sequences * RECESSIVE * self.bit_ns

    def recovered(self) -> None:
        """The last sequence was seen: it begins anew."""
        self.tec, self.rec, self.sequences = 0, 0, None

    def copied(self) -> Controller:
        """An independent copy."""
        return replace(self)
