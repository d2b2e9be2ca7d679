"""What every node's process does: learn when time zero is, serve the bus until the end, say how it went.

Under a supervisor a pipe joins the two: ``ready`` out, when time zero is in, ``end`` in, its statistics out.
When the pipe breaks, the supervisor is gone, and the node ends as if it had been told to.
"""

from __future__ import annotations

import contextlib
import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame, Heartbeat, SampledValues, decode
from faultloop.io.can.link import Link, TimedLink
from faultloop.io.can.table import PLANT_NODE, TICK_NS
from faultloop.live.clock import RunClock
from faultloop.live.transmit_queue import TransmitQueue
from faultloop.loop.recording import Recorder
from faultloop.loop.scenario import Scenario
from faultloop.nodes.clock import SampleClock
from faultloop.nodes.node import rehearse

LONGEST_WAIT_S = 0.1
"""A node looks at least so often whether it shall end."""
LINGER_S = 1.0
"""How long after its end a node without a supervisor waits for late frames."""


class Node(Protocol):
    """A node as its process runs it; times are run time [ns]."""

    name: str

    def begin(self, recorder: Recorder, clock: RunClock) -> None:
        """The log is open and the time is known; nothing has been sent yet."""
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
    """Set by a signal, by the supervisor, or when the supervisor is gone."""

    wanted: threading.Event = field(default_factory=threading.Event)

    def install(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self.wanted.set())


class Supervision:
    """The node's end of the pipe to its supervisor."""

    def __init__(self, connection: Connection, name: str) -> None:
        self.stop = Stop()
        self._connection = connection
        self._clock: dict[str, int] | None = None
        self._arrived = threading.Event()
        self.stop.install()
        # Ctrl-C at the terminal is for the supervisor, which ends the nodes in order.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _as_linux_shall_know_it(name)
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        told: dict[str, Any] = {}
        try:
            while "end" not in told:
                told = self._connection.recv()
                if "epoch_ns" in told:
                    self._clock = told
                    self._arrived.set()
        except (EOFError, OSError):
            pass
        self.stop.wanted.set()
        self._arrived.set()

    def clock(self, pace: float) -> RunClock | None:
        """Say that the node is ready; the clock that the supervisor names, None if it ends instead."""
        self.tell({"ready": True})
        while not self._arrived.wait(LONGEST_WAIT_S):
            if self.stop.wanted.is_set():
                return None
        told = self._clock
        return None if told is None else RunClock(told["epoch_ns"], told["start_ns"], pace)

    def tell(self, what: Mapping[str, Any]) -> None:
        with contextlib.suppress(OSError):  # nobody is left to hear it
            self._connection.send(what)


def _as_linux_shall_know_it(name: str) -> None:
    """The node's name in `ps` and `top`; and the node ends when its parent is killed."""
    if sys.platform == "linux":
        import ctypes

        pr_set_pdeathsig, pr_set_name = 1, 15
        libc = ctypes.CDLL(None)
        libc.prctl(pr_set_pdeathsig, signal.SIGTERM)
        libc.prctl(pr_set_name, f"faultloop {name}".encode()[:15])


def plant_clock(
    link: Link, scenario: Scenario, pace: float, stop: Stop, told: Callable[[str], None]
) -> RunClock | None:
    """The clock of a run that others have begun, from what the plant says; waits until it says something."""
    told("waiting for the plant: its sampled values or heartbeat tell the time")
    while not stop.wanted.is_set():
        for monotonic_ns, frame in link.receive(LONGEST_WAIT_S):
            t_ns = _time_of_plant(frame, scenario.system.sampling_hz)
            if t_ns is not None:
                late = time.monotonic_ns() - monotonic_ns
                return RunClock.showing(t_ns + round(late * pace), pace)
    return None


def _time_of_plant(frame: Frame, sampling_hz: int) -> int | None:
    message = decode(frame)
    if isinstance(message, SampledValues):
        return SampleClock(sampling_hz).ns(message.sample_count)
    if isinstance(message, Heartbeat) and message.number == PLANT_NODE:
        return message.time * TICK_NS
    return None


def serve(
    node: Node, link: Link, queue: TransmitQueue, clock: RunClock, stop: Stop, linger_s: float = LINGER_S
) -> None:
    """Run a node until it is done or told to stop."""
    done_at: float | None = None
    while not stop.wanted.is_set():
        wait = min(max(clock.wall_s(min(node.next_ns, queue.next_ns)), 0.0), LONGEST_WAIT_S)
        if wait > 0.0005:
            frames = link.receive(wait)
        else:
            if wait > 0:
                time.sleep(wait)  # more exact than a poll of whole milliseconds
            frames = link.receive(0)
        if frames and not queue.silent(clock.now_ns()):
            node.receive(clock.now_ns(), [(clock.at(at), frame) for at, frame in frames])
        t_ns = clock.now_ns()
        if node.next_ns <= t_ns:
            for frame in node.poll(t_ns):
                queue.send(t_ns, frame)
        queue.release(t_ns)
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
    scenario: Scenario,
    pace: float,
    *,
    log: Path | None,
    supervision: Supervision | None,
    metadata: dict[str, dict[str, str]],
    leads: bool = False,
) -> bool:
    """A node's whole life; True if it came to its end and was not told to stop.

    Parameters
    ----------
    supervision : None for a node that was started by hand.
    leads : without a supervisor its own start is time zero (the plant); others wait for the plant's time.
    """
    stop = Stop() if supervision is None else supervision.stop
    if supervision is None:
        stop.install()
    try:
        rehearse()
        if supervision is not None:
            clock = supervision.clock(pace)
        elif leads:
            clock = RunClock.starting_now(pace, in_s=0.2)
        else:
            clock = plant_clock(
                link, scenario, pace, stop, lambda text: print(f"{node.name}: {text}", file=sys.stderr)
            )
        if clock is None:
            return False
        if isinstance(link, TimedLink):
            link.attend(clock)
        recorder = open_log(log, clock, metadata)
        try:
            node.begin(recorder, clock)
            linger_s = LINGER_S if supervision is None else 0.0 if leads else math.inf
            queue = TransmitQueue(link, scenario, node.name)
            serve(node, link, queue, clock, stop, linger_s)
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
            "bus_faults": dict(queue.hits),
        }
        if supervision is not None:
            supervision.tell({"statistics": statistics})
        else:
            told = ", ".join(f"{key} {value}" for key, value in statistics.items())
            print(f"{node.name}: {told}", file=sys.stderr)
        return not stop.wanted.is_set()
    finally:
        link.close()
