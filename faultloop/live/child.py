"""One node's process, as its supervisor holds it."""

from __future__ import annotations

import contextlib
import json
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from faultloop.errors import InputError
from faultloop.live.clock import RunClock

END_WITHIN_S = 10.0
"""How long a process that is told to end may take to close its log."""


class Child:
    """A process that speaks JSON lines (``process.Supervision``).

    Parameters
    ----------
    name : of the node.
    arguments : of ``faultloop node``.
    log : the log that it writes.
    """

    def __init__(self, name: str, arguments: Sequence[str], log: Path) -> None:
        self.name, self.log = name, log
        self.statistics: dict[str, Any] = {}
        self.ready = False
        self._said: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - it lives as long as this
        command = [sys.executable, "-m", "faultloop", "node", *arguments, "--log", str(log), "--supervised"]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            # Ctrl-C at the terminal is for the supervisor, which ends the nodes in order.
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self.process.stdout or ():
            try:
                self._said.put(json.loads(line))
            except json.JSONDecodeError:
                continue

    def listen(self) -> None:
        """Take in what it has said."""
        while not self._said.empty():
            said = self._said.get()
            self.ready = self.ready or bool(said.get("ready"))
            self.statistics = said.get("statistics", self.statistics)

    @property
    def ended(self) -> bool:
        return self.process.poll() is not None

    def check(self) -> None:
        """InputError with its own word, if it has ended before it began."""
        if not self.ended:
            return
        status = self.process.returncode
        lines = self.last_words().splitlines()
        if status == 2 and lines:
            raise InputError(lines[-1].removeprefix("faultloop: "))
        raise InputError(
            f"ended before the run began ({ended_how(status)}): {' '.join(lines[-1:])}", key=self.name
        )

    def start(self, clock: RunClock) -> None:
        """Tell it when time zero is."""
        try:
            assert self.process.stdin is not None
            self.process.stdin.write(
                json.dumps({"epoch_ns": clock.epoch_ns, "start_ns": clock.start_ns}) + "\n"
            )
            self.process.stdin.flush()
        except BrokenPipeError:  # it has died: whoever polls it will see
            pass

    def end(self) -> None:
        """Ask it to close its log and end."""
        if not self.ended:
            self.process.send_signal(signal.SIGTERM)

    def wait(self, timeout_s: float = END_WITHIN_S) -> int:
        """Wait for its end; after `timeout_s` it is killed."""
        try:
            self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join(1.0)
        self.listen()
        return self.process.returncode

    def last_words(self) -> str:
        """Its standard error so far."""
        self._errors.seek(0)
        return self._errors.read().strip()

    def close(self) -> None:
        """It is not there any more, whatever it was doing."""
        if not self.ended:
            self.process.kill()
            self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()
        self._errors.close()


def ended_how(status: int) -> str:
    """A process's exit status in words."""
    if status >= 0:
        return f"exit status {status}"
    try:
        return f"killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"killed by signal {-status}"
