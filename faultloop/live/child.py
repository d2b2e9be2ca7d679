"""One node's process, as its supervisor holds it."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Iterator
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.context import BaseContext
from types import ModuleType
from typing import Any

from faultloop.errors import InputError
from faultloop.live.clock import RunClock
from faultloop.live.nodes import NodeOptions, run_supervised

END_WITHIN_S = 10.0
"""How long a process that is told to end may take to close its log."""

_PRELOADED = ["breaker", "plant", "relay"]


def _context() -> BaseContext:
    """Where there is a fork server, nodes are its children: numba and the rest are then imported once and not
    by each of them, which took 4 of 5 s of a node's start on the slow guest of the tests."""
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    modules = [f"faultloop.live.{name}" for name in _PRELOADED]
    context.set_forkserver_preload([*modules, "faultloop.io.can.socketcan", "faultloop.io.mcap_writer"])
    return context


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Nodes need nothing of the program that starts them; multiprocessing would run its main module again."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


class Child:
    """A process that a `process.Supervision` connects with us.

    Parameters
    ----------
    options : of the node, as ``faultloop node`` has them.
    """

    def __init__(self, options: NodeOptions) -> None:
        self.name = options.name or options.role
        self.log = options.log
        self.statistics: dict[str, Any] = {}
        self.ready = False
        self.last_words = ""
        """Why it failed, in one line, if it did."""
        context = _context()
        self._connection, theirs = context.Pipe()
        self.process = context.Process(  # type: ignore[attr-defined]
            target=run_supervised, args=(theirs, options), name=f"faultloop {self.name}", daemon=True
        )
        with _without_main():
            self.process.start()
        theirs.close()

    def listen(self) -> None:
        """Take in what it has said."""
        try:
            while self._connection.poll():
                said = self._connection.recv()
                self.ready = self.ready or "ready" in said
                self.statistics = said.get("statistics", self.statistics)
                self.last_words = said.get("failed", self.last_words)
        except (EOFError, OSError):  # it has ended
            pass

    @property
    def ended(self) -> bool:
        return self.status is not None

    @property
    def status(self) -> int | None:
        """Its exit status, negative where a signal ended it; None while it runs."""
        return self.process.exitcode

    def check(self) -> None:
        """InputError with its own word, if it has ended before it began."""
        status = self.status
        if status is None:
            return
        self.listen()
        if status == 2 and self.last_words:
            raise InputError(self.last_words)
        raise InputError(
            f"ended before the run began ({ended_how(status)}) {self.last_words}".rstrip(), key=self.name
        )

    def _tell(self, what: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):  # it has died: whoever looks at `ended` will see
            self._connection.send(what)

    def start(self, clock: RunClock) -> None:
        """Tell it when time zero is."""
        self._tell({"epoch_ns": clock.epoch_ns, "start_ns": clock.start_ns})

    def end(self) -> None:
        """Ask it to close its log and end."""
        self._tell({"end": True})

    def wait(self, timeout_s: float = END_WITHIN_S) -> int | None:
        """Wait for its end; after `timeout_s` it is killed."""
        self.process.join(timeout_s)
        self.kill()
        self.listen()
        return self.status

    def kill(self) -> None:
        """It is not there any more, whatever it was doing."""
        if not self.ended:
            self.process.kill()
            self.process.join()

    def close(self) -> None:
        """Leave it; kill it if it is there."""
        self.kill()
        self._connection.close()


def ended_how(status: int) -> str:
    """A process's exit status in words."""
    if status >= 0:
        return f"exit status {status}"
    try:
        return f"killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"killed by signal {-status}"
