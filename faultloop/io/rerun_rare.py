"""What is said now and then, as rerun shows it: lines of text, and lanes of states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from faultloop.io.rerun_view import style_states

MOST_HELD = 2000
"""Lines and states; a log may have more of them than samples."""


class RareRows:
    """Lines and states that wait, as a call for one costs 0.3 ms.

    Parameters
    ----------
    rr : the package rerun.
    stream : where they go.
    times : the time columns of (n,) [ns since the run's start].
    """

    def __init__(self, rr: Any, stream: Any, times: Callable[[np.ndarray], list[Any]]) -> None:
        self._rr, self._stream, self._times = rr, stream, times
        self._styled: set[str] = set()
        self.texts: dict[str, list[tuple[int, str, str]]] = {}
        self.lanes: dict[str, list[tuple[int, str | None]]] = {}
        self._count = 0

    def text(self, path: str, t_ns: int, text: str, level: str) -> None:
        """A line, later."""
        self.texts.setdefault(path, []).append((t_ns, f"{t_ns / 1e6:10.3f} ms  {text}", level))
        self._one_more()

    def state(self, path: str, t_ns: int, state: str | None) -> None:
        """A lane's state from here on, later; None: it shows nothing."""
        self.lanes.setdefault(path, []).append((t_ns, state))
        self._one_more()

    def send_states(self, path: str, t_ns: np.ndarray, states: Sequence[str | None]) -> None:
        """States of a lane, at once."""
        if path not in self._styled:
            self._styled.add(path)
            style_states(self._rr, self._stream, path)
        # As an Arrow array: a None in a list would become the text "None" instead of a gap.
        column = self._rr.StateChange.columns(state=pa.array(states, pa.string()))
        self._stream.send_columns(path, self._times(t_ns), column)

    def send(self) -> None:
        """All that waits."""
        for path, lines in self.texts.items():
            t_ns, texts, levels = zip(*lines, strict=True)
            columns = self._rr.TextLog.columns(text=texts, level=levels)
            self._stream.send_columns(path, self._times(np.array(t_ns, np.int64)), columns)
        for path, changes in self.lanes.items():
            t_ns, states = zip(*changes, strict=True)
            self.send_states(path, np.array(t_ns, np.int64), states)
        self.texts, self.lanes, self._count = {}, {}, 0

    def _one_more(self) -> None:
        self._count += 1
        if self._count >= MOST_HELD:
            self.send()
