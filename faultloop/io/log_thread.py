"""A log that a thread of its own writes, so that a second core takes what writing it costs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np

from faultloop.io.mcap_writer import Characteristics, LogWriter

MOST_WAITING = 64
"""Calls; one brings at most some 0.2 s of a relay's samples."""


class LogThread:
    """Hands all that a run has for its log to a thread, in order; the file is the same to the byte.

    What could not be written is raised by a later call, at the latest by `close`.  A killed run loses,
    beside what `LogWriter` would have held, the calls that wait (`MOST_WAITING` at most).

    Parameters
    ----------
    writer : the log; this thread's alone from now on.
    """

    def __init__(self, writer: LogWriter) -> None:
        self._writer = writer
        self._calls: Queue[Callable[[], object] | None] = Queue(MOST_WAITING)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name=f"log {writer.path.name}", daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while (call := self._calls.get()) is not None:
            if self._error is None:  # after it the run is told, and only what it hands over is taken
                try:
                    call()
                except BaseException as error:
                    self._error = error

    def _hand_over(self, call: Callable[[], object]) -> None:
        if self._error is not None:
            raise self._error
        self._calls.put(call)

    def _end(self) -> None:
        """All that was handed over is done."""
        if self._thread.is_alive():
            self._calls.put(None)
            self._thread.join()

    def add_relay(
        self, name: str, bits: Sequence[str], characteristics: Characteristics | None = None
    ) -> None:
        """See `LogWriter.add_relay`."""
        self._hand_over(lambda: self._writer.add_relay(name, bits, characteristics))

    def relay_block(self, name: str, *arrays: np.ndarray) -> None:
        """See `LogWriter.relay_block`; the arrays are copied here."""
        own = [np.array(array) for array in arrays]
        self._hand_over(lambda: self._writer.relay_block(name, *own))

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        """See `LogWriter.message`."""
        self._hand_over(lambda: self._writer.message(topic, t_ns, message_name, **fields))

    def close(self) -> Path:
        """See `LogWriter.close`."""
        self._end()
        if self._error is not None:
            raise self._error
        return self._writer.close()

    def abort(self) -> Path:
        """See `LogWriter.abort`."""
        self._end()
        return self._writer.abort()

    def discard(self) -> None:
        """See `LogWriter.discard`."""
        self._end()
        self._writer.discard()
