"""The logs of several processes as one, in order of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from faultloop.errors import InputError
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import CHUNK_NS, LogWriter
from faultloop.io.messages import BLOCK_SHAPES, MESSAGES, SAMPLED, message_of, values
from faultloop.io.output_file import parts_of
from faultloop.io.recover import recover_log
from faultloop.loop.recording import Attachments, Metadata

SLICE_NS = CHUNK_NS
STRETCH_NS = 50 * SLICE_NS
"""So much of each log is in memory."""


def merge(
    logs: Sequence[Path], out: Path, start_ns: int, metadata: Metadata, attachments: Attachments
) -> list[str]:
    """Write `out` with everything that is in `logs`; returns a line for each that had to be recovered.

    A log that a killed process left as ``F.mcap.part`` is recovered first; what is not there is left out.
    """
    opened, notes = [], []
    for path in logs:
        found, note = _opened(path)
        opened += [] if found is None else [found]
        notes += [] if note is None else [note]
    with LogWriter(out, start_ns, metadata, attachments) as writer:
        _write(opened, writer, start_ns)
    return notes


def _opened(path: Path) -> tuple[Log | None, str | None]:
    if path.exists():
        return open_log(path), None
    if not parts_of(path):
        return None, f"{path.stem} left no log"
    try:
        recovered = recover_log(path, path)
    except InputError as error:
        return None, f"{path.stem}'s log cannot be recovered: {error.what}"
    return open_log(path), f"{path.stem}'s log recovered: {sum(recovered.messages.values())} messages"


def _write(logs: Sequence[Log], writer: LogWriter, start_ns: int) -> None:
    """Stretch by stretch, so that no more of them is in memory."""
    added: set[str] = set()
    for log in logs:
        for relay in _sampled(log):
            if relay not in added:
                writer.add_relay(relay, _bare_bits(log, relay), log.characteristics(relay))
                added.add(relay)
    ends = [t_ns + log.start_ns - start_ns for log in logs for t_ns in log.last_ns(*MESSAGES)]
    last_ns = max(ends, default=-1)
    for begin in range(0, last_ns + 1, STRETCH_NS):
        _write_stretch(logs, writer, start_ns, (begin, begin + STRETCH_NS))


def _write_stretch(logs: Sequence[Log], writer: LogWriter, start_ns: int, span: tuple[int, int]) -> None:
    """Everything between two times; with the first also what was said before the start."""
    rare: list[tuple[int, str, str, Mapping[str, object]]] = []
    rows: dict[str, list[tuple[np.ndarray, ...]]] = {}
    for log in logs:
        shift = log.start_ns - start_ns
        within = span[0] - shift, span[1] - shift
        for topic in log.topics:
            message = message_of(topic)
            if message is None or message in SAMPLED:
                continue
            names = [field.name for field in message.fields]
            since = within[0] if span[0] else None
            for t_ns, *entry in log.array(topic, since, within[1]).tolist():
                rare.append((t_ns + shift, topic, message.name, dict(zip(names, entry, strict=True))))
        for relay in _sampled(log):
            columns = _columns(log, relay, shift, within)
            if len(columns[0]):
                rows.setdefault(relay, []).append(columns)
    rare.sort(key=lambda entry: entry[0])
    whole = {relay: _joined(parts) for relay, parts in rows.items()}
    k = 0
    for until in range(span[0] + SLICE_NS, span[1] + 1, SLICE_NS):
        for relay, columns in whole.items():
            a, b = np.searchsorted(columns[0], (until - SLICE_NS, until))
            if b > a:
                writer.relay_block(relay, *(column[a:b] for column in columns))
        while k < len(rare) and rare[k][0] < until:
            t_ns, topic, name, fields = rare[k]
            writer.message(topic, max(t_ns, 0), name, **fields)
            k += 1


def _sampled(log: Log) -> list[str]:
    """The relays whose samples and estimates a log has; of another it may have events alone."""
    kinds = BLOCK_SHAPES.keys()
    return [relay for relay in log.relays if all(kind.topic_for(relay) in log.topics for kind in kinds)]


def _bare_bits(log: Log, relay: str) -> list[str]:
    """The bits as a relay names them, without what says pickup or operate."""
    names = log.bits(relay)
    return [
        pickup.removesuffix(".Str") if operate else pickup
        for pickup, operate in zip(names["pickup"], names["operate"], strict=True)
    ]


def _columns(log: Log, relay: str, shift: int, within: tuple[int, int]) -> tuple[np.ndarray, ...]:
    found = [(shapes, log.array(kind.topic_for(relay), *within)) for kind, shapes in BLOCK_SHAPES.items()]
    n = min(len(rows) for _, rows in found)
    columns = [found[0][1]["t_ns"][:n] + shift, found[0][1]["sample_count"][:n]]
    for shapes, rows in found:
        if shapes[0]:
            columns.append(values(rows)[:n])
        else:
            columns += [rows[name][:n] for name in (rows.dtype.names or ())[1:]]
    return tuple(columns)


def _joined(parts: list[tuple[np.ndarray, ...]]) -> tuple[np.ndarray, ...]:
    columns = tuple(np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(columns[0], kind="stable")
    return columns if (np.diff(order) == 1).all() else tuple(column[order] for column in columns)
