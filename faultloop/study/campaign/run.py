"""Running a campaign: parts of cases, by one process or several, to one Parquet file.

A finished part lies in ``F.parquet.parts/`` under its number; what is there is not run again.  Where a part
begins and ends depends on the number of cases only, and F.parquet is put together in order at the end: it is
the same whatever was stopped, and however many workers there were.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import closing
from operator import itemgetter
from pathlib import Path
from typing import Any

import pyarrow as pa

from faultloop.errors import InputError
from faultloop.loop.case import Cases
from faultloop.loop.recording import MemorySink
from faultloop.study.campaign.parts import PartFiles, Parts, finished, prepare_waves, waves_there
from faultloop.study.campaign.plan import Plan
from faultloop.study.campaign.record import fingerprint, record_of
from faultloop.study.campaign.summary import Progress, Summary, summary_of
from faultloop.study.campaign.table import arrow, failed, row_of, schema_of
from faultloop.study.campaign.waves import MOST_BYTES, Kept, Waves
from faultloop.study.campaign.waves import folder_of as waves_folder
from faultloop.study.pool import begin_worker, pool_of

LEAST_IN_A_PART_S = 10.0
"""Simulated, where there are enough cases: some 0.3 s of work, to 10 ms for the part's file."""


def run_campaign(
    plan: Plan,
    out: Path,
    workers: int = 1,
    progress: Progress | None = None,
    waves: Waves | None = None,
    scheduler: str | None = None,
) -> Summary:
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
    folder, mark = (
        (None, own) if waves is None else (waves_folder(out), f"{own} with {waves.kinds} {waves.dtype}")
    )
    if finished(out, own):
        if folder is not None and (there := waves_there(folder, mark)) < plan.cases:
            told = f"of {there} of {plan.cases} cases only" if there else "not"
            raise InputError(f"is there, but waves are {told}; give another --out, or delete it", file=out)
        return summary_of(out, 0)
    schema = schema_of(plan, [place.name for place in plan.first.scenario.relay])
    most = None if waves is None else max(MOST_BYTES // max(waves.case_bytes, 1), 1)
    least = int(LEAST_IN_A_PART_S / plan.first.scenario.scenario.duration_s)
    with closing(Parts(out, plan.cases, mark, most, folder, least)) as parts:
        if waves is not None and folder is not None:
            prepare_waves(folder, mark, waves.card(plan, record["versions"], out))
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

        job = Job(plan, schema, parts.files, parts.size, waves)
        if scheduler is not None:
            from faultloop.study.campaign.cluster import by_cluster

            for number in by_cluster(job, todo, scheduler, parts):
                one_more(parts.size_of(number))
        elif workers == 1:
            for number in todo:
                job.run(number, one_more)
        elif todo:
            for number in _by_processes(job, todo, min(workers, len(todo)), parts):
                one_more(parts.size_of(number))
        parts.merge(schema, record | {"fingerprint": own})
    return summary_of(out, new)


class Job:
    """What a worker needs to make a part."""

    def __init__(
        self, plan: Plan, schema: pa.Schema, files: PartFiles, size: int, waves: Waves | None = None
    ) -> None:
        self.plan, self.schema, self.files, self.size, self.waves = plan, schema, files, size, waves
        self._cases = Cases()

    def __getstate__(self) -> tuple[Any, ...]:
        return self.plan, self.schema, self.files, self.size, self.waves

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.__init__(*state)

    def run(self, number: int, each: Callable[[], None] | None = None) -> None:
        """Make a part and write it."""
        rows, waves = self.made(number, each)
        self.files.write(number, rows, waves)

    def made(self, number: int, each: Callable[[], None] | None = None) -> tuple[pa.Table, pa.Table | None]:
        """A part's rows, and their waves where these are kept."""
        rows: dict[int, dict[str, Any]] = {}
        kept: dict[int, Kept | None] = {}
        for number_, values in self._batch(number):
            rows[number_], kept[number_] = self._case(number_, values)
            if each is not None:
                each()
        order = sorted(rows)
        table = arrow(self.schema, [rows[case] for case in order])
        waves = None if self.waves is None else self.waves.table(table, [kept[case] for case in order])
        return table, waves

    def _batch(self, number: int) -> list[tuple[int, dict[str, Any] | InputError]]:
        """A part's cases with what they draw; those with the same settings and network follow each other."""
        begin = number * self.size
        found: list[tuple[str, int, dict[str, Any] | InputError]] = []
        for case in range(begin, min(begin + self.size, self.plan.cases)):
            try:
                values = self.plan.values(case)
                found.append((self.plan.network(values), case, values))
            except InputError as error:
                found.append(("", case, error))
        return [(case, values) for _, case, values in sorted(found, key=itemgetter(0, 1))]

    def _case(self, number: int, values: dict[str, Any] | InputError) -> tuple[dict[str, Any], Kept | None]:
        """A case's row, and what is kept of it where it could be run."""
        if isinstance(values, InputError):
            return failed(number, {}, str(values)), None
        try:
            case = self.plan.made(number, values)
            sinks = [] if self.waves is None else [MemorySink()]
            if self._cases.full:
                self._cases = Cases()
            outcome = self._cases.prepare(case.scenario, case.settings).run(sinks, texts=False)
            row = row_of(self.plan, case, outcome)
            return row, None if self.waves is None else self.waves.of(case.scenario, sinks[0])
        except InputError as error:
            return failed(number, values, str(error)), None
        except MemoryError:
            raise
        except Exception as error:  # a user's element may raise anything
            return failed(number, values, f"{type(error).__name__}: {error}"), None


_job: Job | None = None


def _begin(job: Job) -> None:
    """In a new worker."""
    global _job  # noqa: PLW0603 - a process pool has no other place for what its tasks share
    _job = job
    begin_worker()


def _run_part(number: int) -> int:
    assert _job is not None
    _job.run(number)
    return number


def _by_processes(job: Job, todo: list[int], workers: int, parts: Parts) -> Iterator[int]:
    """Parts as they are finished; few are handed out ahead, so memory does not grow with their number."""

    def died() -> InputError:
        return InputError(
            f"a worker died (killed, or out of memory); {parts.kept()}; the same command goes on from there",
            file=parts.out,
        )

    waiting = iter(todo)
    running: set[Future[int]] = set()
    with pool_of(workers, died, _begin, job) as pool:
        while True:
            while len(running) < 2 * workers and (number := next(waiting, None)) is not None:
                running.add(pool.submit(_run_part, number))
            if not running:
                break
            ready, running = wait(running, return_when=FIRST_COMPLETED)
            for future in ready:
                yield future.result()
