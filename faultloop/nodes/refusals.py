"""Frames refused: each counted, and told of without a flood filling the log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from faultloop.io.can.frames import Rejection
from faultloop.io.can.table import BY_IDENTIFIER

Report = Callable[[int, str, str], None]
"""Called with time [ns], level ("info", "warning") and a text for the log."""


def unheard(t_ns: int, level: str, text: str) -> None:
    """A report that nobody reads."""


QUIET_NS = 1_000_000_000
"""A cause and sender is told of at most this often."""


class Refusals:
    """Counts by cause.  Tells of the first of each cause and sender at once, of more once a second at most.

    The senders are those of the table of messages, and one more for all other identifiers: so there is an end
    to what can be told, whatever is on the bus.
    """

    def __init__(self, report: Report) -> None:
        self.causes: Counter[Rejection] = Counter()
        self._report = report
        self._told_ns: dict[tuple[Rejection, int | None], int] = {}
        self._untold: Counter[tuple[Rejection, int | None]] = Counter()

    def clear(self) -> None:
        """As a new one."""
        for counts in (self.causes, self._told_ns, self._untold):
            counts.clear()

    @property
    def total(self) -> int:
        """All frames refused."""
        return self.causes.total()

    def add(self, t_ns: int, identifier: int, cause: Rejection) -> None:
        """A frame is refused at `t_ns`."""
        self.causes[cause] += 1
        key = (cause, identifier if identifier in BY_IDENTIFIER else None)
        told_ns = self._told_ns.get(key)
        if told_ns is None:
            self._told_ns[key] = t_ns
            self._report(t_ns, "warning", f"frame {identifier:#05x} refused: {cause.value}")
            return
        self._untold[key] += 1
        if t_ns - told_ns >= QUIET_NS:
            self._tell(t_ns, key)

    def beat(self, t_ns: int) -> None:
        """With each heartbeat: tells what is due."""
        for key in [key for key in self._untold if t_ns - self._told_ns[key] >= QUIET_NS]:
            self._tell(t_ns, key)

    def _tell(self, t_ns: int, key: tuple[Rejection, int | None]) -> None:
        cause, identifier = key
        who = "unknown identifiers" if identifier is None else f"{identifier:#05x}"
        seconds = (t_ns - self._told_ns[key]) / 1e9
        self._report(
            t_ns,
            "warning",
            f"frames {who} refused: {cause.value}, {self._untold[key]} more in {seconds:.1f} s",
        )
        self._told_ns[key] = t_ns
        del self._untold[key]
