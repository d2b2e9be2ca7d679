"""What every node's process does: learn when time zero is, serve the bus until the end, say how it went.

Under a supervisor it speaks JSON lines with it: ``{"ready": true}`` out, ``{"epoch_ns": .., "start_ns": ..}``
in, its statistics out at the end.  When its standard input ends, the supervisor is gone, and so is the node.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame, Heartbeat, decode
from faultloop.io.can.table import PLANT_NODE, TICK_NS, Kind
from faultloop.live.clock import RunClock
from faultloop.live.link import Link
from faultloop.recording import Recorder

LONGEST_WAIT_S = 0.1
"""A node looks at least so often whether it shall end."""
LINGER_S = 1.0
"""How long after its end a node without a supervisor waits for late frames."""


class Node(Protocol):
    """A node as its process runs it; times are run time [ns]."""

    name: str

    def begin(self, recorder: Recorder) -> None:
        """The log is open; nothing has been sent yet."""
        ...

    @property
    def next_ns(self) -> int: ...

    def poll(self, t_ns: int) -> list[Frame]: ...

    def receive(self, t_ns: int, frames: list[tuple[int, Frame]]) -> None: ...

    def done(self, t_ns: int) -> bool:
        """It has nothing more to do in this run."""
        ...

    def statistics(self, pace: float) -> dict[str, Any]: ...


@dataclass
class Stop:
    """Set by a signal, or when the supervisor is gone."""

    wanted: threading.Event = field(default_factory=threading.Event)

    def install(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self.wanted.set())


class Supervision:
    """The node's end of the pipes to its supervisor."""

    def __init__(self, stop: Stop) -> None:
        self._stop = stop
        self._lines: list[str] = []
        self._arrived = threading.Condition()
        _die_with_parent()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in sys.stdin:
            with self._arrived:
                self._lines.append(line)
                self._arrived.notify()
        self._stop.wanted.set()
        with self._arrived:
            self._arrived.notify()

    def clock(self, pace: float) -> RunClock | None:
        """Say that the node is ready; the clock that the supervisor names, None if it ends instead."""
        print(json.dumps({"ready": True}), flush=True)
        with self._arrived:
            while not self._lines:
                if self._stop.wanted.is_set():
                    return None
                self._arrived.wait(LONGEST_WAIT_S)
            told = json.loads(self._lines.pop(0))
        return RunClock(told["epoch_ns"], told["start_ns"], pace)

    def tell(self, statistics: Mapping[str, Any]) -> None:
        with contextlib.suppress(BrokenPipeError):  # nobody is left to hear it
            print(json.dumps(statistics), flush=True)


def _die_with_parent() -> None:
    """Linux ends this process when the supervisor is killed, even while it computes."""
    if sys.platform == "linux":
        import ctypes

        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGTERM)
        if os.getppid() == 1:  # it was killed before that
            raise SystemExit(1)


def plant_clock(link: Link, pace: float, stop: Stop, told: Callable[[str], None]) -> RunClock | None:
    """The clock of a run that others have begun, from what the plant says; waits until it says something."""
    told("waiting for the plant: its sampled values or heartbeat tell the time")
    while not stop.wanted.is_set():
        for monotonic_ns, frame in link.receive(LONGEST_WAIT_S):
            t_ns = _time_of_plant(frame)
            if t_ns is not None:
                late = time.monotonic_ns() - monotonic_ns
                return RunClock.showing(t_ns + round(late * pace), pace)
    return None


def _time_of_plant(frame: Frame) -> int | None:
    if frame.id != Kind.HEARTBEAT + PLANT_NODE:
        return None
    message = decode(frame)
    return message.time * TICK_NS if isinstance(message, Heartbeat) else None


def serve(node: Node, link: Link, clock: RunClock, stop: Stop, linger_s: float = LINGER_S) -> None:
    """Run a node until it is done or told to stop."""
    done_at: float | None = None
    while not stop.wanted.is_set():
        wait = min(max(clock.wall_s(node.next_ns), 0.0), LONGEST_WAIT_S)
        if wait > 0.0005:
            frames = link.receive(wait)
        else:
            if wait > 0:
                time.sleep(wait)  # more exact than a poll of whole milliseconds
            frames = link.receive(0)
        if frames:
            node.receive(clock.now_ns(), [(clock.at(at), frame) for at, frame in frames])
        t_ns = clock.now_ns()
        if node.next_ns <= t_ns:
            for frame in node.poll(t_ns):
                link.send(frame)
        if node.done(t_ns):
            done_at = time.monotonic() if done_at is None else done_at
            if time.monotonic() - done_at >= linger_s:
                return


def open_log(path: Path | None, clock: RunClock, metadata: dict[str, dict[str, str]]) -> Recorder:
    """The node's own log; nowhere if it has none."""
    if path is None:
        return Recorder([])
    from faultloop.io.mcap_writer import LogWriter

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return Recorder([LogWriter(path, clock.start_ns, metadata)])
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror or error})", file=path) from None


def run_node(
    node: Node,
    link: Link,
    pace: float,
    *,
    log: Path | None,
    supervised: bool,
    metadata: dict[str, dict[str, str]],
    leads: bool = False,
) -> bool:
    """A node's whole life; True if it came to its end and was not told to stop.

    Parameters
    ----------
    leads : without a supervisor its own start is time zero (the plant); others wait for the plant's time.
    """
    stop = Stop()
    stop.install()
    supervision = Supervision(stop) if supervised else None
    try:
        if supervision is not None:
            clock = supervision.clock(pace)
        elif leads:
            clock = RunClock.starting_now(pace, in_s=0.2)
        else:
            clock = plant_clock(link, pace, stop, lambda text: print(f"{node.name}: {text}", file=sys.stderr))
        if clock is None:
            return False
        recorder = open_log(log, clock, metadata)
        try:
            node.begin(recorder)
            linger_s = LINGER_S if not supervised else 0.0 if leads else math.inf
            serve(node, link, clock, stop, linger_s)
        except BaseException:
            recorder.abort()
            raise
        recorder.close()
        statistics = node.statistics(pace) | {
            "sent": link.sent,
            "received": link.received,
            "retries": link.retries,
            "errors": link.errors,
            "dropped": link.dropped,
        }
        if supervision is not None:
            supervision.tell({"statistics": statistics})
        else:
            told = ", ".join(f"{key} {value}" for key, value in statistics.items())
            print(f"{node.name}: {told}", file=sys.stderr)
        return not stop.wanted.is_set()
    finally:
        link.close()
