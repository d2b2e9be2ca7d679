"""Running a campaign: parts of cases, by one process or several, to one Parquet file.

A finished part lies in ``F.parquet.parts/`` under its number; what is there is not run again.  Where a part
begins and ends depends on the number of cases only, and F.parquet is put together in order at the end: it is
the same whatever was stopped, and however many workers there were.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

from faultloop.errors import InputError
from faultloop.loop.case import Cases
from faultloop.study.campaign.parts import Parts, finished
from faultloop.study.campaign.plan import Plan
from faultloop.study.campaign.record import fingerprint, record_of
from faultloop.study.campaign.table import arrow, failed, row_of, schema_of

KEPT_RELAYS = 100
"""Cases between which relays are kept, where every case has settings of its own."""

Progress = Callable[[int, int], None]
"""Called with the number of cases done, and of all."""


@dataclass(frozen=True)
class Summary:
    """What came of a campaign.

    Attributes
    ----------
    out : the file; None where the rows were kept in memory only.
    errors : cases that could not be run, with the verdict `unjudged`.
    new : cases that were run now; the others were there.
    """

    out: Path
    cases: int
    right: int
    wrong: int
    unjudged: int
    errors: int
    new: int


def run_campaign(plan: Plan, out: Path, workers: int = 1, progress: Progress | None = None) -> Summary:
    """Run what is not there yet.

    Raises
    ------
    InputError : `out` cannot be written, or holds, or has parts of, another campaign; or a worker died.
        What was finished is kept.
    """
    if workers < 1:
        raise InputError(f"must be at least 1, not {workers}", key="--workers")
    record = record_of(plan)
    own = fingerprint(record)
    if finished(out, own):
        return _summary(out, 0)
    schema = schema_of(plan, [place.name for place in plan.case(0).scenario.relay])
    with closing(Parts(out, plan.cases, own)) as parts:
        todo = parts.missing()
        new = sum(parts.size_of(number) for number in todo)
        done = plan.cases - new
        if progress is not None:
            progress(done, plan.cases)

        def one_more(cases: int = 1) -> None:
            nonlocal done
            done += cases
            if progress is not None:
                progress(done, plan.cases)

        job = Job(plan, schema, parts.folder, parts.size)
        if workers == 1:
            for number in todo:
                job.run(number, one_more)
        elif todo:
            for number in _by_processes(job, todo, min(workers, len(todo)), parts):
                one_more(parts.size_of(number))
        parts.merge(schema, record | {"fingerprint": own})
    return _summary(out, new)


class Job:
    """What a worker needs to make a part."""

    def __init__(self, plan: Plan, schema: Any, folder: Path, size: int) -> None:
        self.plan, self.schema, self.folder, self.size = plan, schema, folder, size
        self._own_settings = plan.varies_settings
        self._cases = Cases()

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_cases": None}

    def run(self, number: int, each: Callable[[], None] | None = None) -> None:
        """Make a part and write it."""
        begin = number * self.size
        rows = []
        for case in range(begin, min(begin + self.size, self.plan.cases)):
            rows.append(self._row(case))
            if each is not None:
                each()
        Parts.write(self.folder, number, arrow(self.schema, rows))

    def _row(self, number: int) -> dict[str, Any]:
        if self._cases is None or (self._own_settings and number % KEPT_RELAYS == 0):
            self._cases = Cases()
        values: dict[str, Any] = {}
        try:
            values = self.plan.values(number)
            case = self.plan.made(number, values)
            outcome = self._cases.prepare(case.scenario, case.settings).run()
            return row_of(self.plan, self.schema, case, outcome)
        except InputError as error:
            return failed(self.schema, number, values, str(error))
        except MemoryError:
            raise
        except Exception as error:  # a user's element may raise anything
            return failed(self.schema, number, values, f"{type(error).__name__}: {error}")


_job: Job | None = None


def _begin(job: Job) -> None:
    """In a new worker: it ends with its parent, whatever ends that, and leaves Ctrl-C to it."""
    import signal

    global _job  # noqa: PLW0603 - a process pool has no other place for what its tasks share
    _job = job
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()


def _run_part(number: int) -> int:
    assert _job is not None
    _job.run(number)
    return number


def _by_processes(job: Job, todo: list[int], workers: int, parts: Parts) -> Iterator[int]:
    """Parts as they are finished; few are handed out ahead, so memory does not grow with their number."""
    pool = ProcessPoolExecutor(workers, get_context("spawn"), _begin, (job,))
    waiting = iter(todo)
    running: set[Future[int]] = set()
    try:
        while True:
            while len(running) < 2 * workers and (number := next(waiting, None)) is not None:
                running.add(pool.submit(_run_part, number))
            if not running:
                break
            ready, running = wait(running, return_when=FIRST_COMPLETED)
            for future in ready:
                yield future.result()
        pool.shutdown()
    except BrokenProcessPool:
        raise InputError(
            f"a worker died (killed, or out of memory); {parts.kept()}; the same command goes on from there",
            file=parts.out,
        ) from None
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _summary(out: Path, new: int) -> Summary:
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    table = pq.read_table(out, columns=["verdict", "error"])
    counts = {item["values"]: item["counts"] for item in pc.value_counts(table["verdict"]).to_pylist()}
    failures = len(table) - table["error"].null_count
    right, wrong, unjudged = (counts.get(name, 0) for name in ("right", "wrong", "unjudged"))
    return Summary(out, len(table), right, wrong, unjudged, failures, new)
