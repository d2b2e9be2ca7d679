"""Running a campaign: parts of cases, by one process or several, to one Parquet file.

A finished part lies in ``F.parquet.parts/`` under its number; what is there is not run again.  Where a part
begins and ends depends on the number of cases only, and F.parquet is put together in order at the end: it is
the same whatever was stopped, and however many workers there were.
"""

from __future__ import annotations

import os
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from operator import itemgetter
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from faultloop.errors import InputError
from faultloop.loop.case import Cases
from faultloop.loop.recording import MemorySink
from faultloop.study.campaign.parts import Parts, finished
from faultloop.study.campaign.plan import Plan
from faultloop.study.campaign.record import fingerprint, record_of
from faultloop.study.campaign.table import arrow, failed, row_of, schema_of
from faultloop.study.campaign.waves import MOST_BYTES, Waves, folder_of

KEPT_RELAYS = 100
"""Settings whose relays are kept."""

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
    first_error : the first case that could not be run, and why.
    """

    out: Path
    cases: int
    right: int
    wrong: int
    unjudged: int
    errors: int
    new: int
    first_error: str | None = None


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
    if finished(out, own):
        if waves is not None and not folder_of(out).is_dir():
            raise InputError("is there, without waves; give another --out, or delete it", file=out)
        return _summary(out, 0)
    schema = schema_of(plan, [place.name for place in plan.case(0).scenario.relay])
    most = None if waves is None else max(MOST_BYTES // max(waves.case_bytes, 1), 1)
    kept = "" if waves is None else f" with {waves.kinds} {waves.dtype}"
    with closing(Parts(out, plan.cases, own + kept, most)) as parts:
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

        if waves is not None:
            prepare_waves(out, waves.card(plan, record["versions"], out))
        job = Job(plan, schema, parts.folder, parts.size, waves)
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
    return _summary(out, new)


class Job:
    """What a worker needs to make a part."""

    def __init__(self, plan: Plan, schema: Any, folder: Path, size: int, waves: Waves | None = None) -> None:
        self.plan, self.schema, self.folder, self.size, self.waves = plan, schema, folder, size, waves
        self._cases = Cases()
        self._kept: set[str] = set()

    def __getstate__(self) -> tuple[Any, ...]:
        return self.plan, self.schema, self.folder, self.size, self.waves

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.__init__(*state)

    def run(self, number: int, each: Callable[[], None] | None = None) -> None:
        """Make a part and write it."""
        rows, waves = self.made(number, each)
        self.write(number, rows, waves)

    def made(self, number: int, each: Callable[[], None] | None = None) -> tuple[pa.Table, pa.Table | None]:
        """A part's rows, and their waves where these are kept."""
        rows, kept = {}, {}
        for case, values in self._batch(number):
            memory = None if self.waves is None else MemorySink()
            row = rows[case] = self._row(case, values, [] if memory is None else [memory])
            if self.waves is not None and memory is not None:
                kept[case] = self.waves.of(memory) if row["error"] is None else None
            if each is not None:
                each()
        table = arrow(self.schema, [rows[case] for case in sorted(rows)])
        waves = None if self.waves is None else self.waves.table(table, [kept[case] for case in sorted(kept)])
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

    def write(self, number: int, rows: pa.Table, waves: pa.Table | None) -> None:
        """The waves first: where the rows are, the waves are."""
        if waves is not None:
            floats = [name for name in waves.column_names if name not in rows.column_names]
            folder = folder_of(self.folder.with_suffix(""))
            Parts.write(folder, number, waves, use_byte_stream_split=floats, use_dictionary=False)
        Parts.write(self.folder, number, rows)

    def _row(self, number: int, values: dict[str, Any] | InputError, sinks: list[Any]) -> dict[str, Any]:
        if isinstance(values, InputError):
            return failed(self.schema, number, {}, str(values))
        try:
            case = self.plan.made(number, values)
            outcome = self._cases_for(values).prepare(case.scenario, case.settings).run(sinks)
            return row_of(self.plan, self.schema, case, outcome)
        except InputError as error:
            return failed(self.schema, number, values, str(error))
        except MemoryError:
            raise
        except Exception as error:  # a user's element may raise anything
            return failed(self.schema, number, values, f"{type(error).__name__}: {error}")

    def _cases_for(self, values: dict[str, Any]) -> Cases:
        """New ones when relays of many settings are kept."""
        own = self.plan.settings(values)
        if own not in self._kept and len(self._kept) >= KEPT_RELAYS:
            self._cases, self._kept = Cases(), set()
        self._kept.add(own)
        return self._cases


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


def prepare_waves(out: Path, card: str) -> None:
    """Their folder, and the data card beside it (a folder of Parquet files holds nothing else)."""
    folder = folder_of(out)
    try:
        folder.mkdir(exist_ok=True)
        folder.with_suffix(".waves.md").write_text(card, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror or error})", file=folder) from None


def _summary(out: Path, new: int) -> Summary:
    counts: Counter[str] = Counter()
    failures, first = 0, None
    with pq.ParquetFile(out) as file:
        for batch in file.iter_batches(columns=["case", "verdict", "error"]):
            counts.update(batch["verdict"].to_pylist())
            failures += len(batch) - batch["error"].null_count
            if failures and first is None:
                row = batch.filter(batch["error"].is_valid()).slice(0, 1).to_pylist()[0]
                first = f"case {row['case']}: {row['error']}"
    right, wrong, unjudged = (counts[name] for name in ("right", "wrong", "unjudged"))
    return Summary(out, counts.total(), right, wrong, unjudged, failures, new, first)
