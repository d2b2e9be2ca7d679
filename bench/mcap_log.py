"""Cost of logging: microseconds per sample of a relay for all four topics, against mcap's own writers.

    python bench/mcap_log.py [LOG.mcap]

Takes the samples, phasors, loop impedances and elements of a log (of a run of the first scenario, if none is
given), and writes them again: through LogWriter, in blocks of 16, 48 and 960 samples, with each compression;
through mcap's `add_message` with ready-made bytes; through mcap-protobuf-support with filled messages.  Then
reads them.  The time includes opening, the summary, closing and renaming; the best of several runs.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory
from mcap_protobuf.writer import Writer as ProtobufWriter

from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.messages import SAMPLED, array_dtype, values
from faultloop.io.schema import message_class, schema_bytes

ROOT = Path(__file__).resolve().parents[1]
ROWS = 24_000  # samples written: 5 s at 4800 Hz


def relay_arrays(log: Log) -> list[np.ndarray]:
    """The first relay's arrays, repeated to ``ROWS``, as LogWriter takes them."""
    relay = log.relays[0]
    elements = log.elements(relay)
    floats = [values(rows) for rows in (log.samples(relay), log.phasors(relay), log.loops(relay))]
    wanted = np.arange(ROWS) % len(elements)
    count = np.arange(ROWS)
    t_ns = count * 1_000_000_000 // 4800
    return [
        t_ns,
        count,
        *(np.ascontiguousarray(array[wanted]) for array in floats),
        elements["pickup"][wanted],
        elements["operate"][wanted],
    ]


def best(job: Callable[[], object], target: Path, runs: int) -> float:
    """Microseconds per row."""
    seconds = []
    for _ in range(runs):
        target.unlink(missing_ok=True)  # a rename over an existing file waits for the disk
        begin = time.perf_counter()
        job()
        seconds.append(time.perf_counter() - begin)
    return 1e6 * min(seconds) / ROWS


def ours(target: Path, arrays: list[np.ndarray], block: int, compression: str) -> None:
    with LogWriter(target, 0, compression=compression) as log:
        log.add_relay("R1", ["PDIS1"])
        for start in range(0, ROWS, block):
            log.relay_block("R1", *(array[start : start + block] for array in arrays))


def structured(arrays: list[np.ndarray]) -> list[list[tuple]]:
    """The same rows as plain tuples per message, for the writers that take one message at a time."""
    _, count, samples, phasors, loops, pickup, operate = (array.tolist() for array in arrays)
    return [
        [(c, *row) for c, row in zip(count, samples, strict=True)],
        [tuple(row) for row in phasors],
        [tuple(row) for row in loops],
        list(zip(pickup, operate, strict=True)),
    ]


def filled(arrays: list[np.ndarray]) -> list[list]:
    """Filled protobuf messages, outside of what is timed."""
    stamped = []
    for message, rows in zip(SAMPLED, structured(arrays), strict=True):
        names = array_dtype(message).names or ()
        kind = message_class(message)
        protos = [kind(**dict(zip(names[1:], row, strict=True))) for row in rows]
        for proto, t_ns in zip(protos, arrays[0].tolist(), strict=True):
            proto.timestamp.seconds, proto.timestamp.nanos = divmod(t_ns, 1_000_000_000)
        stamped.append(protos)
    return stamped


def add_message(target: Path, t_ns: list[int], data: list[list[bytes]]) -> None:
    with target.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        channels = []
        for message in SAMPLED:
            schema = writer.register_schema(message.full_name, "protobuf", schema_bytes(message))
            channels.append(writer.register_channel(message.topic_for("R1"), "protobuf", schema))
        for row, t in enumerate(t_ns):
            for channel, records in zip(channels, data, strict=True):
                writer.add_message(channel, t, records[row], t, row)
        writer.finish()


def protobuf_writer(target: Path, t_ns: list[int], protos: list[list]) -> None:
    with target.open("wb") as stream, ProtobufWriter(stream, compression=CompressionType.NONE) as writer:
        topics = [message.topic_for("R1") for message in SAMPLED]
        for row, t in enumerate(t_ns):
            for topic, messages in zip(topics, protos, strict=True):
                writer.write_message(topic, messages[row], t, t, row)


def read_ours(target: Path) -> None:
    log = open_log(target)
    for topic in log.topics:
        log.array(topic)


def read_mcap(target: Path) -> None:
    with target.open("rb") as stream:
        for _ in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            pass


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, "x.mcap")
        if len(sys.argv) > 1:
            source = Path(sys.argv[1])
        else:
            import faultloop

            source = Path(folder, "run.mcap")
            faultloop.run(ROOT / "scenarios" / "ag-zone1.toml", log=source)
        arrays = relay_arrays(open_log(source))
        protos = filled(arrays)
        data = [[proto.SerializeToString() for proto in messages] for messages in protos]
        t_ns = arrays[0].tolist()
        reference = best(lambda: ours(target, arrays, 48, ""), target, 7)
        print("us per sample, four topics; and as a multiple of LogWriter in blocks of 48")
        for compression in ("", "lz4", "zstd"):
            for block in (16, 48, 960):
                cost = best(lambda b=block, c=compression: ours(target, arrays, b, c), target, 7)
                size = target.stat().st_size / ROWS
                name = f"LogWriter, {compression or 'no compression'}, blocks of {block}"
                print(f"  {name:46} {cost:7.2f} {cost / reference:7.1f}x {size:6.0f} bytes")
        for name, job in (
            ("mcap add_message, ready bytes", lambda: add_message(target, t_ns, data)),
            ("mcap-protobuf-support, filled messages", lambda: protobuf_writer(target, t_ns, protos)),
        ):
            cost = best(job, target, 2)
            print(
                f"  {name:46} {cost:7.2f} {cost / reference:7.1f}x {target.stat().st_size / ROWS:6.0f} bytes"
            )
        target.unlink()
        ours(target, arrays, 960, "")
        print("reading, us per sample")
        for name, job, runs in (
            ("open_log, all arrays", read_ours, 5),
            ("mcap, decoded messages", read_mcap, 1),
        ):
            seconds = []
            for _ in range(runs):
                begin = time.perf_counter()
                job(target)
                seconds.append(time.perf_counter() - begin)
            print(f"  {name:46} {1e6 * min(seconds) / ROWS:7.2f}")


if __name__ == "__main__":
    main()
