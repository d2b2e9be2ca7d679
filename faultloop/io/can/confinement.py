"""Errors on the wire: error frames and fault confinement (ISO 11898-1:2015, 10.4.4 and 12.1.4).

Whoever sees an error flags it: an error-active node with six dominant bits.  They break the stuffing rule, so
all the others flag, too, at the latest at the sixth: the flags together take 6 to 12 bits.  Eight recessive
bits of delimiter follow, then the intermission; then the frame is sent again.  A transmitter's error counter
(TEC) goes up by 8 with each error and down by 1 with each frame sent; above 127 the node is error-passive:
its flag is recessive, the others see it as six equal bits and flag then, and before it sends again it leaves
eight more bits to others.  Above 255 it is bus-off until it has seen 128 times 11 recessive bits.

Not in it: receivers' error counters, and the exceptions of the rules for the acknowledgement.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from faultloop.io.can.frames import Frame

ERROR_PASSIVE = 127
BUS_OFF = 255
FLAG = 6
LONGEST_FLAGS = 12
DELIMITER = 8
SUSPEND = 8
RECOVERY = 128
RECESSIVE = 11


class WireError(NamedTuple):
    """An error in a frame: after how many of its bits it is seen, and how long the flags are together."""

    bit: int
    flag_bits: int


class ErrorSource(Protocol):
    """Decides which transmissions are hit."""

    def hit(self, t_ns: int, frame: Frame, sender: object, bits: int) -> WireError | None:
        """Asked once for each transmission, of `bits` bits, that begins at `t_ns`."""
        ...


class StateChange(NamedTuple):
    """A node's controller changed its state."""

    t_ns: int
    sender: object
    state: str  # "error-active", "error-passive", "bus-off"


@dataclass(slots=True)
class Controller:
    """Fault confinement of one sender; times [ns]."""

    bit_ns: int
    tec: int = 0
    ready_ns: int = 0
    """It may not send before: suspend transmission, or the recovery from bus-off on a bus that stays idle."""
    sequences: int | None = None
    """Of 11 recessive bits, still to be seen; None: it is not bus-off."""

    @property
    def state(self) -> str:
        """As the standard names it."""
        if self.sequences is not None:
            return "bus-off"
        return "error-passive" if self.tec > ERROR_PASSIVE else "error-active"

    def flag_bits(self, error: WireError) -> int:
        """Bits of the flags of all nodes together, when this one transmits."""
        return LONGEST_FLAGS if self.tec > ERROR_PASSIVE else error.flag_bits

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
        self.ready_ns = idle_ns + (SUSPEND * self.bit_ns if self.tec > ERROR_PASSIVE else 0)

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
        self.tec, self.sequences = 0, None

    def copied(self) -> Controller:
        """An independent copy."""
        return replace(self)
