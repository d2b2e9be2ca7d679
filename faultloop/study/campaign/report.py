"""A campaign in tables: counts, times, the worst cases, and what changed against another one."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from typing import Any

import numpy as np

from faultloop.config.campaign import Judge
from faultloop.errors import InputError
from faultloop.study.campaign.draw import described
from faultloop.study.campaign.results import Mask, Results
from faultloop.study.report import Report, Table

WORST = 20
CHANGES = 50
PERCENTILES = (50, 95, 99, 100)
FIGURES = r"after -?[\d.]+ ms, |\(.*\)| -?[\d.]+ ms$"
"""Of a reason: what differs from case to case."""
NUMBERS = r"-?\d+(\.\d+)?(e[-+]?\d+)?"
LATE = ": after -?[0-9]"
"""A reason that is a trip at the wrong time."""


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
    if counts["failed"]:
        report.tables.append(_failures(results))
    return report


def setup_of(results: Results) -> Report:
    """What the campaign is: what it varies, what it holds to be right, what it was made with."""
    head, record = results.tables.campaign, results.record
    report = Report("setup", "What was asked")
    sampling = head.sampling if head.sampling == "grid" else f"{head.sampling}, seed {head.seed}"
    made = ", ".join(f"{name} {version}" for name, version in record["versions"].items())
    report.text = [f"Scenario {record['scenario']['name']}, {sampling}. Made with {made}."]
    rows = [[", ".join(vary.all_keys), described(vary)] for vary in results.tables.vary]
    report.tables = [Table("Varied", ["key", "values"], rows)]
    if results.tables.only:
        report.tables.append(Table("Only where", ["condition"], [[o.when] for o in results.tables.only]))
    if results.tables.judge:
        judged = [[judge.relay, judge.where or "any", _wanted(judge)] for judge in results.tables.judge]
        report.tables.append(Table("Judged", ["relay", "fault", "right is"], judged))
    return report


def _wanted(judge: Judge) -> str:
    said = judge.model_dump(exclude_none=True, exclude={"relay", "where", "trip"}, exclude_defaults=True)
    parts = [
        "a trip" if judge.trip else "no trip",
        *(f"{key} {_short(value)}" for key, value in said.items()),
    ]
    return ", ".join(parts)


def worst_of(results: Results) -> Report:
    """The wrong ones, those without a trip or with one that must not be first; then the slowest."""
    report = Report("worst", "The worst cases")
    report.tables = [_worst(results)]
    return report


def _counts(results: Results) -> dict[str, int]:
    counts = {name: int(results.verdict(name).sum()) for name in ("right", "wrong", "unjudged")}
    return counts | {"failed": len(results) - results.table["error"].null_count}


def _times(results: Results) -> Table:
    rows = []
    for relay in results.relays:
        times = results.operate_ms(relay)
        times = times[np.isfinite(times)]
        own = np.percentile(times, PERCENTILES) if len(times) else [float("nan")] * len(PERCENTILES)
        tripped = int(results.tripped(relay).sum())
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
    kinds: Counter[tuple[str, str]] = Counter()
    for reason, count, _ in _kinds(results, "reason", results.wrong, FIGURES):
        relay, expected, came = [*reason.split(": ", 2), "", ""][:3]
        kinds[f"{relay}: {expected}", came.partition("; ")[0].strip()] += count
    rows = [[*kind, count] for kind, count in kinds.most_common()]
    return Table("Wrong", ["expected", "what came", ">cases"], rows)


def _failures(results: Results) -> Table:
    """Of the cases that could not be run."""
    which = results.verdict("unjudged") & results.reasons(".", "error")
    found = sorted(_kinds(results, "error", which, NUMBERS), key=lambda kind: -kind[1])[:WORST]
    rows = [[text, count, _command(results, first)] for text, count, first in found]
    return Table("Could not be run", ["why", ">cases", "the first of them"], rows)


def _kinds(results: Results, name: str, which: Mask, without: str) -> list[tuple[str, int, int]]:
    """Texts of a column less what differs from case to case, how many rows have each, and the first case."""
    codes, texts = results.texts(name)
    rows = np.flatnonzero(which)
    used, first, often = np.unique(codes[rows], return_index=True, return_counts=True)
    cases = results.numbers("case")[rows[first]].astype(np.int64).tolist()
    counts: Counter[str] = Counter()
    began: dict[str, int] = {}
    differs, instead = re.compile(without), "…" if without is NUMBERS else ""
    for code, count, case in zip(used.tolist(), often.tolist(), cases, strict=True):
        text = differs.sub(instead, texts[code])
        counts[text] += count
        began[text] = min(case, began.get(text, case))
    return [(text, count, began[text]) for text, count in counts.items()]


def _worst(results: Results) -> Table:
    times = [results.operate_ms(relay) for relay in results.relays]
    slowest = np.fmax.reduce([np.nan_to_num(own, nan=-np.inf) for own in times])
    wrong, late = results.wrong, results.reasons(LATE)
    order = np.lexsort((-slowest, late, ~wrong))[:WORST]
    which = order[wrong[order] | np.isfinite(slowest[order])]
    keys = results.varied_keys()
    rows = []
    for row in results.table.take(which).to_pylist():
        values = ", ".join(f"{key} = {_short(row[key])}" for key in keys)
        why = row["reason"] or row["verdict"]
        own = [_after(row, relay) for relay in results.relays]
        rows.append([row["case"], values, why, *own, _command(results, row["case"])])
    columns = [">case", "values", "verdict", *(f">{relay} ms" for relay in results.relays), "again"]
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
    verdict = new.words("verdict") != old.words("verdict")
    moved, other = np.zeros(len(new)), np.zeros(len(new), bool)
    for relay in new.relays:
        now, before = new.operate_ms(relay), old.operate_ms(relay)
        only_one = np.isfinite(now) != np.isfinite(before)
        moved = np.fmax(moved, np.where(only_one, np.inf, np.nan_to_num(np.abs(now - before))))
        for name in ("function", "loop"):
            other |= new.words(f"{relay}.{name}") != old.words(f"{relay}.{name}")
    changed = verdict | (moved > 0) | other
    worse, better = verdict & new.wrong, verdict & old.wrong & new.verdict("right")
    report = Report("changes", f"Against {old.path}")
    report.text.append(
        f"{int(changed.sum())} of {len(new)} cases changed: {int(worse.sum())} became wrong, "
        f"{int(better.sum())} right, {int(((moved > 0) & ~verdict).sum())} in time only, "
        f"{int((other & ~(moved > 0) & ~verdict).sum())} in what tripped only"
    )
    order = np.lexsort((-moved, ~changed, ~verdict, ~worse))
    which = order[: min(int(changed.sum()), CHANGES)]
    rows, keys = [], new.varied_keys()
    for now, before in zip(new.table.take(which).to_pylist(), old.table.take(which).to_pylist(), strict=True):
        values = ", ".join(f"{key} = {_short(now[key])}" for key in keys)
        times = [_change(before, now, relay) for relay in new.relays]
        verdicts = f"{before['verdict']} > {now['verdict']}"
        rows.append([now["case"], values, verdicts, *times, _command(new, now["case"])])
    columns = [">case", "values", "verdict", *(f">{relay} ms" for relay in new.relays), "again"]
    report.tables.append(Table("Changed: what became wrong first, then the most", columns, rows))
    return report


def _change(before: dict[str, Any], now: dict[str, Any], relay: str) -> str:
    """``21.0 > 24.0``, with what tripped where that is not the same; once what is as it was."""
    names = [[row[f"{relay}.{name}"] or "" for name in ("function", "loop")] for row in (before, now)]
    sides = []
    for row, own in zip((before, now), names, strict=True):
        after = _after(row, relay)
        time = after if isinstance(after, str) else f"{after:.1f}"
        sides.append(" ".join([time, *own]).strip() if names[0] != names[1] else time)
    return " > ".join(sides if sides[0] != sides[1] else sides[:1])
