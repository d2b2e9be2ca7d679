"""How well a run in real time kept its time."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Percentiles:
    """Of some durations [ms, wall time]."""

    count: int = 0
    median: float = math.nan
    p95: float = math.nan
    p99: float = math.nan
    greatest: float = math.nan

    @classmethod
    def of(cls, durations_ns: list[int] | np.ndarray, pace: float = 1.0) -> Percentiles:
        """`durations_ns` of run time."""
        if len(durations_ns) == 0:
            return cls()
        wall_ms = np.asarray(durations_ns, float) / pace / 1e6
        return cls(len(wall_ms), *np.percentile(wall_ms, (50, 95, 99, 100)).tolist())

    def __str__(self) -> str:
        if self.count == 0:
            return "none"
        return f"median {self.median:.2f} p95 {self.p95:.2f} p99 {self.p99:.2f} max {self.greatest:.2f} ms"


@dataclass(slots=True)
class Deadlines:
    """How late the samples were: each is due at its own time, and missed where it came a sample later.

    Parameters
    ----------
    interval_ns : of the sampling [ns of run time].
    """

    interval_ns: int
    late_ns: list[int] = field(default_factory=list)

    def note(self, due_ns: int, t_ns: int) -> None:
        self.late_ns.append(t_ns - due_ns)

    def keep(self, t_ns: int, started: float, pace: float) -> None:
        """Sleep until `t_ns` of a run that ``started`` then (`time.monotonic`); note how late it is."""
        ahead_s = t_ns / 1e9 / pace - (time.monotonic() - started)
        if ahead_s > 0:
            time.sleep(ahead_s)
        self.note(t_ns, round((time.monotonic() - started) * pace * 1e9))

    @property
    def missed(self) -> int:
        """How many came later than the next one was due."""
        return int(np.count_nonzero(np.asarray(self.late_ns) > self.interval_ns))


@dataclass(frozen=True)
class Pacing:
    """What a run in real time ends with.

    Attributes
    ----------
    pace : run time in a second of wall time.
    samples, missed : of the plant (in one process: blocks of samples), and how many of them came later than
        the next sample was due.
    jitter : how late they were, wall time.
    reaction : from the sample that a relay tripped at to its breaker's taking the frame, wall time; empty in
        one process, where the bus model says when.
    latency : from a sample to the relay's having worked on it, wall time, by relay.
    lost : sampled values that did not arrive, by relay.
    dropped : frames that the kernel could not keep, by node.
    retries : how often a transmit queue was full, by node.
    """

    pace: float
    samples: int
    missed: int
    jitter: Percentiles
    reaction: Percentiles = field(default_factory=Percentiles)
    latency: dict[str, Percentiles] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)
    retries: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of_blocks(cls, pace: float, deadlines: Deadlines) -> Pacing:
        """Of a run in one process, which keeps time by blocks of about a millisecond."""
        late = deadlines.late_ns
        return cls(pace, len(late), deadlines.missed, Percentiles.of(late, pace))

    def lines(self) -> list[str]:
        """For a person."""
        told = [
            f"pace {self.pace:g}: {self.samples} samples, {self.missed} missed their deadline;"
            f" jitter {self.jitter}"
        ]
        if self.reaction.count:
            told.append(f"reaction, sample taken to frame received by the breaker: {self.reaction}")
        told += [f"{name}, sample to estimate: {own}" for name, own in self.latency.items()]
        for what, counts in (
            ("samples lost", self.lost),
            ("frames dropped by the kernel", self.dropped),
            ("full transmit queue, frames sent again", self.retries),
        ):
            some = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
            if counts:
                told.append(f"{what}: {some or 'none'}")
        return told
