"""Comparing two logs: the first field that differs, how often each does, what is missing on either side."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from itertools import pairwise
from typing import Any

import numpy as np

from faultloop.errors import InputError, nearest
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import BREAKER_STATUS, EVENT, FAULT_STATE, MESSAGES, message_of

FIELD_NAMES = tuple(dict.fromkeys(f.name for message in MESSAGES for f in message.fields))
MISSING = "(message)"  # the field of a message that one log has and the other has not


@dataclass(frozen=True)
class FieldDifference:
    """How one field differs between two logs.

    Attributes
    ----------
    name : ``/relay/R1/phasors.va_re``; ``(message)`` after the point where one log lacks whole messages.
    count : number of messages in which it differs; ``compared``, of how many.
    t_ns, a, b : time of the first of them [ns since the start], and both values there (None: no message).
    largest : largest absolute difference of a number, NaN if one side alone is NaN, None for texts.
    """

    name: str
    count: int
    compared: int
    t_ns: int
    a: Any
    b: Any
    largest: float | None = None


@dataclass
class Diff:
    """Result of ``diff_logs``.

    Attributes
    ----------
    fields : the fields that differ, the first one (by time) first.
    topics : topics that only one log has: name and ``a`` or ``b``.
    information : differing metadata and attachments, which do not make logs different.
    """

    fields: list[FieldDifference] = field(default_factory=list)
    topics: list[tuple[str, str]] = field(default_factory=list)
    information: list[str] = field(default_factory=list)

    @property
    def first(self) -> FieldDifference | None:
        """The field that differs first."""
        return self.fields[0] if self.fields else None

    @property
    def equal(self) -> bool:
        """Nothing differs that makes logs different."""
        return not self.fields and not self.topics

    def __bool__(self) -> bool:
        return not self.equal


def diff_logs(
    a: Log, b: Log, ignore: Iterable[str] = (), tolerances: Mapping[str, float] | None = None
) -> Diff:
    """Compares two logs message by message; messages of a topic are paired by their time since the start.

    Parameters
    ----------
    ignore : fields to leave out: a field's name (``rocof_hz_per_s``), or a pattern over ``TOPIC.FIELD``
        (``/relay/R1/phasors.*``).
    tolerances : largest absolute difference allowed, by name or pattern as above.

    NaN equals NaN.  Raises InputError for a name that no message has, and a tolerance that is no number >= 0.
    """
    ignore, tolerances = list(ignore), dict(tolerances or {})
    _check(ignore, tolerances)
    result = Diff(information=_information(a, b))
    shared = [topic for topic in a.topics if topic in b.topics and message_of(topic)]
    for topic in sorted({*a.topics, *b.topics} - set(shared)):
        side = a if topic in a.topics else b
        wanted = message_of(topic) and not _matches(f"{topic}.{MISSING}", ignore)
        if wanted and any(len(side.array(topic, *span)) for span in side.windows()):
            result.topics.append((topic, "a" if side is a else "b"))
    tallies = [_Tally(topic, ignore, tolerances) for topic in shared]
    edges = sorted({edge for log in (a, b) for span in log.windows() for edge in span})
    for place, span in enumerate(pairwise(edges)):  # logs of any length in a memory that is bounded
        if a.progress is not None:
            a.progress(place / len(edges))
        for tally in tallies:
            tally.take(a.array(tally.topic, *span), b.array(tally.topic, *span))
    result.fields = [found for tally in tallies for found in tally.differences()]
    # Of fields that differ at the same time the cause stands first: what happened in the plant, then samples,
    # phasors, loops, elements, ..., and last what a person reads of it.
    ends = (FAULT_STATE, BREAKER_STATUS, EVENT)
    kinds = (*ends[:2], *(message for message in MESSAGES if message not in ends), EVENT)
    shared.sort(key=lambda topic: kinds.index(message_of(topic)))
    order = {topic: place for place, topic in enumerate(shared)}
    result.fields.sort(key=lambda found: (found.t_ns, order[found.name.rpartition(".")[0]]))
    return result


def _check(ignore: list[str], tolerances: dict[str, float]) -> None:
    for name in (*ignore, *tolerances):
        last = name.rpartition(".")[2] if name.startswith("/") else name
        if not any(fnmatchcase(known, last) for known in (*FIELD_NAMES, MISSING)):
            raise InputError(f"no message has a field of that name; {nearest(last, FIELD_NAMES)}", key=name)
    for name, limit in tolerances.items():
        if math.isnan(limit) or limit < 0:
            raise InputError(f"a tolerance is a number of 0 or more; this one is {limit}", key=name)


def _matches(name: str, patterns: Iterable[str]) -> bool:
    bare = name.rpartition(".")[2]
    return any(fnmatchcase(name if pattern.startswith("/") else bare, pattern) for pattern in patterns)


class _Tally:
    """The differences of one topic, stretch of time by stretch of time."""

    def __init__(self, topic: str, ignore: list[str], tolerances: dict[str, float]) -> None:
        self.topic, self._ignore = topic, ignore
        self._tolerances = tolerances
        self._paired = 0
        self._found: dict[str, FieldDifference] = {}

    def take(self, a: np.ndarray, b: np.ndarray) -> None:
        """Compares the messages of a stretch."""
        in_a, in_b = _pair(a["t_ns"], b["t_ns"])
        missing = _missing(self.topic, (a, in_a), (b, in_b))
        if missing and not _matches(missing.name, self._ignore):
            self._add(missing)
        if len(in_a) < len(a) or len(in_b) < len(b):
            a, b = a[in_a], b[in_b]
        self._paired += len(a)
        for name in (a.dtype.names or ())[1:]:
            self._compare(f"{self.topic}.{name}", a[name], b[name], a["t_ns"])

    def _compare(self, full: str, a: np.ndarray, b: np.ndarray, t_ns: np.ndarray) -> None:
        if _matches(full, self._ignore):
            return
        limits = [limit for pattern, limit in self._tolerances.items() if _matches(full, [pattern])]
        unequal = _unequal(a, b, max(limits, default=0.0))
        if len(unequal):
            first = int(unequal[0])
            one, other = (x[first] if x.dtype == object else x[first].item() for x in (a, b))
            largest = _largest(a[unequal], b[unequal])
            self._add(FieldDifference(full, len(unequal), 0, int(t_ns[first]), one, other, largest))

    def _add(self, new: FieldDifference) -> None:
        old = self._found.get(new.name)
        if old is not None:
            largest = None
            if old.largest is not None and new.largest is not None:
                largest = float(np.maximum(old.largest, new.largest))  # NaN stays NaN
            new = replace(old, count=old.count + new.count, largest=largest)
        self._found[new.name] = new

    def differences(self) -> list[FieldDifference]:
        """One for each field that differs, the missing messages first."""
        out = []
        for name, found in self._found.items():
            alone = found.count if name.endswith(MISSING) else 0
            out.append(replace(found, compared=self._paired + alone))
        return sorted(out, key=lambda found: not found.name.endswith(MISSING))


def _pair(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of equal time in both (sorted) time arrays; the k-th message at a time goes with the k-th."""
    if np.array_equal(a, b):
        every = np.arange(len(a))
        return every, every

    def numbered(t_ns: np.ndarray) -> np.ndarray:
        keys = np.empty(len(t_ns), [("t_ns", np.int64), ("turn", np.int64)])
        keys["t_ns"], keys["turn"] = t_ns, np.arange(len(t_ns)) - np.searchsorted(t_ns, t_ns)
        return keys

    _, in_a, in_b = np.intersect1d(numbered(a), numbered(b), assume_unique=True, return_indices=True)
    return in_a, in_b


def _missing(
    topic: str, a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]
) -> FieldDifference | None:
    """The messages that only one side has; each side is its rows and the places of those that are paired."""
    alone = [np.delete(rows["t_ns"], paired) for rows, paired in (a, b)]
    count = len(alone[0]) + len(alone[1])
    if not count:
        return None
    a_first = len(alone[1]) == 0 or (len(alone[0]) > 0 and alone[0][0] <= alone[1][0])
    side = 0 if a_first else 1
    present = "message"
    return FieldDifference(
        f"{topic}.{MISSING}",
        count=count,
        compared=0,
        t_ns=int(alone[side][0]),
        a=present if a_first else None,
        b=None if a_first else present,
    )


def _unequal(a: np.ndarray, b: np.ndarray, tolerance: float) -> np.ndarray:
    """Places where a and b differ by more than the tolerance; NaN equals NaN, inf equals inf."""
    with np.errstate(invalid="ignore", over="ignore"):
        different = a != b
        if a.dtype.kind == "f":
            different &= ~(np.isnan(a) & np.isnan(b))
            if tolerance > 0:
                different &= ~(np.abs(a - b) <= tolerance)
        elif a.dtype.kind == "u" and tolerance > 0:
            different &= np.maximum(a, b) - np.minimum(a, b) > tolerance
    return np.flatnonzero(different)


def _largest(a: np.ndarray, b: np.ndarray) -> float | None:
    if a.dtype.kind == "f":
        with np.errstate(invalid="ignore", over="ignore"):
            return float(np.abs(a - b).max())
    if a.dtype.kind == "u":
        return float((np.maximum(a, b) - np.minimum(a, b)).max())
    return None


def _information(a: Log, b: Log) -> list[str]:
    """What differs beside the messages, one line each: metadata record and key, attachment."""
    lines = []
    for name in sorted({*a.metadata, *b.metadata}):
        ours, theirs = a.metadata.get(name, {}), b.metadata.get(name, {})
        for key in sorted({*ours, *theirs}):
            if ours.get(key) != theirs.get(key):
                lines.append(f"metadata {name}.{key}: {_short(ours.get(key))} -> {_short(theirs.get(key))}")
    for name in sorted({*a.attachments, *b.attachments}):
        if a.attachments.get(name) != b.attachments.get(name):
            lines.append(
                f"attachment {name} differs"
                if name in a.attachments and name in b.attachments
                else f"attachment {name} only in {'a' if name in a.attachments else 'b'}"
            )
    return lines


def _short(text: str | None) -> str:
    if text is None:
        return "(none)"
    return text if len(text) <= 60 and "\n" not in text else f"{len(text)} characters"
