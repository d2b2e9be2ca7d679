"""The run's time on the monotonic clock."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from faultloop.loop.scenario import Scenario

SECOND_NS = 1_000_000_000
MICROSECOND_NS = 1_000
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def _whole(t_ns: int) -> int:
    """In whole microseconds, as a `datetime` has them."""
    return t_ns // MICROSECOND_NS * MICROSECOND_NS


@dataclass(frozen=True, slots=True)
class RunClock:
    """Run time ``t = (monotonic - epoch) * pace``; the same for all processes of one machine.

    Parameters
    ----------
    epoch_ns : time zero on the machine's monotonic clock [ns].
    start_ns : time zero in UTC [ns since 1970]: what a log and the freshness of a frame count from.
    pace : run time that passes in a second of wall time [s].
    """

    epoch_ns: int
    start_ns: int
    pace: float = 1.0

    @classmethod
    def starting_now(cls, pace: float = 1.0, in_s: float = 0.0) -> RunClock:
        """Time zero is `in_s` from now."""
        ahead = round(in_s * SECOND_NS)
        return cls(time.monotonic_ns() + ahead, _whole(time.time_ns() + ahead), pace)

    @classmethod
    def showing(cls, t_ns: int, pace: float = 1.0) -> RunClock:
        """The clock that shows `t_ns` now: of a node that joins."""
        past = round(t_ns / pace)
        return cls(time.monotonic_ns() - past, _whole(time.time_ns() - past), pace)

    def started(self, scenario: Scenario) -> Scenario:
        """The scenario with this clock's time zero as its start: authenticated frames tell the wall clock."""
        start = EPOCH + timedelta(microseconds=self.start_ns // MICROSECOND_NS)
        header = scenario.scenario.model_copy(update={"start": start})
        return scenario.model_copy(update={"scenario": header})

    def now_ns(self) -> int:
        """Run time [ns]; negative before the start."""
        return self.at(time.monotonic_ns())

    def at(self, monotonic_ns: int) -> int:
        """Run time at an instant of the monotonic clock [ns]."""
        passed = monotonic_ns - self.epoch_ns
        return passed if self.pace == 1.0 else math.floor(passed * self.pace)

    def wall_s(self, t_ns: int) -> float:
        """Wall time from now to run time `t_ns` [s]; negative if it is past."""
        return (t_ns / self.pace + self.epoch_ns - time.monotonic_ns()) / SECOND_NS
