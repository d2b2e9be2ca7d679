"""A campaign in tables: counts, times, the worst cases, and what changed against another one."""

from __future__ import annotations

import re
import shlex
from typing import Any

import numpy as np

from faultloop.errors import InputError
from faultloop.study.campaign.results import Results
from faultloop.study.report import Report, Table

WORST = 20
CHANGES = 50
PERCENTILES = (50, 95, 99, 100)


def report_of(results: Results) -> Report:
    """Counts and times, without the figures."""
    counts = _counts(results)
    report = Report("campaign", results.name)
    report.text.append(
        f"{len(results)} cases: " + ", ".join(f"{count} {name}" for name, count in counts.items())
    )
    report.tables = [_times(results)]
    if counts["wrong"]:
        report.tables.append(_reasons(results))
    return report


def worst_of(results: Results) -> Report:
    """The wrong ones, those without a trip or with one that must not be first; then the slowest."""
    report = Report("worst", "The worst cases")
    report.tables = [_worst(results)]
    return report


def _counts(results: Results) -> dict[str, int]:
    counts = {name: int((results.verdict == name).sum()) for name in ("right", "wrong", "unjudged")}
    return counts | {"failed": len(results) - results.table["error"].null_count}


def _times(results: Results) -> Table:
    rows = []
    for relay in results.relays:
        times = results.operate_ms(relay)
        times = times[np.isfinite(times)]
        own = np.percentile(times, PERCENTILES) if len(times) else [float("nan")] * len(PERCENTILES)
        tripped = int((results.column(f"{relay}.tripped") == True).sum())  # noqa: E712
        rows.append([relay, tripped, len(results) - tripped, *map(float, own)])
    columns = [
        "relay",
        ">tripped",
        ">not tripped",
        *(f">{p} % ms" if p < 100 else ">slowest ms" for p in PERCENTILES),
    ]
    return Table("Operate time, from the fault to the breaker's receiving the trip", columns, rows)


def _reasons(results: Results) -> Table:
    """By what was expected and what came, without the figures that differ from case to case."""
    kinds: dict[tuple[str, str], int] = {}
    for reason in results.column("reason")[results.verdict == "wrong"]:
        relay, expected, came = [*str(reason).split(": ", 2), "", ""][:3]
        kind = f"{relay}: {expected}", _FIGURES.sub("", came.partition("; ")[0]).strip()
        kinds[kind] = kinds.get(kind, 0) + 1
    rows = [[*kind, count] for kind, count in sorted(kinds.items(), key=lambda item: -item[1])]
    return Table("Wrong", ["expected", "what came", ">cases"], rows)


_FIGURES = re.compile(r"after -?[\d.]+ ms, |\(.*\)| -?[\d.]+ ms$")


def _worst(results: Results) -> Table:
    times = [results.operate_ms(relay) for relay in results.relays]
    slowest = np.fmax.reduce([np.nan_to_num(own, nan=-np.inf) for own in times])
    wrong = results.verdict == "wrong"
    late = np.array([": after " in str(reason) for reason in results.column("reason")])
    order = np.lexsort((-slowest, late, ~wrong))[: max(WORST, 1)]
    which = order[wrong[order] | np.isfinite(slowest[order])]
    keys = results.varied_keys()
    rows = []
    for row in results.table.take(which).to_pylist():
        values = ", ".join(f"{key} = {_short(row[key])}" for key in keys)
        why = row["reason"] or row["verdict"]
        own = [_after(row, relay) for relay in results.relays]
        rows.append([row["case"], values, why, *own, _command(results, row["case"])])
    columns = ["case", "values", "verdict", *(f">{relay} ms" for relay in results.relays), "again"]
    return Table("Wrong ones first, then the slowest", columns, rows)


def _command(results: Results, case: int) -> str:
    return f"faultloop campaign-case {shlex.quote(str(results.path))} {case}"


def _after(row: dict[str, Any], relay: str) -> float | str:
    received = row[f"{relay}.received_ns"]
    return "-" if received is None else (received - (row["fault_ns"] or 0)) / 1e6


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def changes(new: Results, old: Results) -> Report:
    """The cases whose verdict or time is not what it was.  Raises InputError where they are not the same."""
    if new.keys != old.keys or len(new) != len(old) or new.relays != old.relays:
        raise InputError("is of other cases: the varied keys, the relays or the number differ", file=old.path)
    for key in new.keys:
        if not new.table[key].combine_chunks().equals(old.table[key].combine_chunks()):
            raise InputError(f"is of other cases: the values of {key} differ", file=old.path)
    verdict = new.verdict != old.verdict
    moved = np.zeros(len(new))
    for relay in new.relays:
        now, before = new.operate_ms(relay), old.operate_ms(relay)
        only_one = np.isfinite(now) != np.isfinite(before)
        moved = np.fmax(moved, np.where(only_one, np.inf, np.nan_to_num(np.abs(now - before))))
    changed = verdict | (moved > 0)
    worse = int((verdict & (new.verdict == "wrong")).sum())
    better = int((verdict & (old.verdict == "wrong") & (new.verdict == "right")).sum())
    report = Report("changes", f"Against {old.path}")
    report.text.append(
        f"{int(changed.sum())} of {len(new)} cases changed: {worse} became wrong, {better} right, "
        f"{int((changed & ~verdict).sum())} in time only"
    )
    order = np.lexsort((-moved, ~verdict))
    which = order[: min(int(changed.sum()), CHANGES)]
    rows, keys = [], new.varied_keys()
    for now, before in zip(new.table.take(which).to_pylist(), old.table.take(which).to_pylist(), strict=True):
        values = ", ".join(f"{key} = {_short(now[key])}" for key in keys)
        times = [f"{_told(before, relay)} > {_told(now, relay)}" for relay in new.relays]
        verdicts = f"{before['verdict']} > {now['verdict']}"
        rows.append([now["case"], values, verdicts, *times, _command(new, now["case"])])
    columns = ["case", "values", "verdict", *(f"{relay} ms" for relay in new.relays), "again"]
    report.tables.append(Table("Changed, the most first", columns, rows))
    return report


def _told(row: dict[str, Any], relay: str) -> str:
    after = _after(row, relay)
    return after if isinstance(after, str) else f"{after:.1f}"
