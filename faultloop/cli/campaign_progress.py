"""How far a campaign is: a bar on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from faultloop.cli.terminal import warn

WINDOW_S = 120.0
"""Over which the rate is taken: parts come in clumps, as the workers' are finished at about the same time."""
EVERY_S = 30.0
"""Between two lines where there is no terminal."""


class Pace:
    """Rate and time left.  Cases that were there before tell nothing of them.

    Parameters
    ----------
    clock : seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: deque[tuple[float, int]] = deque()
        self.per_s = 0.0

    def take(self, done: int) -> None:
        """So many are done now; the first time: were done before."""
        now = self._clock()
        self._seen.append((now, done))
        while len(self._seen) > 2 and now - self._seen[1][0] >= WINDOW_S:
            self._seen.popleft()
        began, before = self._seen[0]
        self.per_s = (done - before) / (now - began) if now > began else 0.0

    def told(self, done: int, total: int) -> str:
        """``12,000 an hour, 5 min left``; empty while nothing is known."""
        if self.per_s <= 0:
            return ""
        return f"{3600 * self.per_s:,.0f} an hour, {duration((total - done) / self.per_s)} left"


def duration(seconds: float) -> str:
    """``45 s``, ``5 min``, ``2 h 05 min``"""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


@contextmanager
def case_progress(cases: int) -> Iterator[Callable[[int, int], None]]:
    """Fed with the cases that are done, and all of them; says it on standard error."""
    err = Console(stderr=True)
    if not err.is_terminal:
        yield lines()
        return
    columns = (
        TextColumn("{task.completed:.0f} of {task.total:.0f} cases"),
        BarColumn(),
        TextColumn("{task.fields[pace]}"),
    )
    pace = Pace()
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task("cases", total=cases, pace="")

        def show(done: int, total: int) -> None:
            pace.take(done)
            bar.update(task, completed=done, total=total, pace=pace.told(done, total))

        yield show


def lines(clock: Callable[[], float] = time.monotonic) -> Callable[[int, int], None]:
    """A line each half minute: a campaign that is shorter says nothing."""
    pace, last = Pace(clock), clock()

    def show(done: int, total: int) -> None:
        nonlocal last
        pace.take(done)
        if clock() - last >= EVERY_S and done < total:
            last = clock()
            told = pace.told(done, total)
            warn(f"{done} of {total} cases{f', {told}' if told else ''}")

    return show
