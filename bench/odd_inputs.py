"""Logs and settings files that are odd, into every command that reads them: what is there, or one line.

    python bench/odd_inputs.py [--seed 1]

Logs: a run's, cut at several places, with bytes changed, without a topic, without metadata or attachments,
with messages whose bodies are none, rewritten by mcap's own writer, another tool's, none at all; each into 24
commands.  Settings: those of tests/interchange/line-7 in five formats, damaged in 18 ways, imported with the
line's impedance given and without.  Right is status 0, 2 or 3, and with 2 one line on the standard error;
settings that were taken must pass `check`.  What is not right is listed; exit status 1.
"""

# ruff: noqa: E402
from __future__ import annotations

import argparse
import contextlib
import io
import shutil
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

sys.path[0] = str(Path(__file__).resolve().parents[1])  # and not this folder, whose can.py is not python-can

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

import faultloop
from faultloop.cli import call

ROOT = Path(__file__).resolve().parents[1]
AG = ROOT / "scenarios" / "ag-zone1.toml"
MHO = ROOT / "scenarios" / "settings" / "ab-mho.toml"
COMMANDS = (
    *("review {}", "review {} --json", "review {} --html o.html", "review {} --png o.png"),
    *("review {} --secondary", "review {} --rerun o.rrd", "why {}", "why {} --json"),
    *("why {} --relay RA --at 10", "why {} --function PDIS1", "layout {} --view v.mcap"),
    *("layout {} --foxglove o.json --plotjuggler o.xml", "diff {} whole.mcap", "diff whole.mcap {}"),
    *("diff {} --again", "locate {} {} --relay-a RA --relay-b RB", "locate {} whole.mcap"),
    *("export {} --comtrade o.cfg", "export {} --parquet o.parquet", "export {} --csv o.csv"),
    *("export {} --can o.asc", "recover {} o.mcap", "channels {}", f"replay {{}} --settings {MHO}"),
)


def rewritten(
    whole: Path,
    out: Path,
    takes: Callable[[str], bool] = lambda topic: True,
    body: Callable[[str, bytes], bytes] = lambda topic, data: data,
    beside: bool = True,
) -> None:
    """The log by mcap's own writer; without topics, with other bodies, without metadata and attachments."""
    with whole.open("rb") as source, out.open("wb") as sink:
        reader, writer = make_reader(source), Writer(sink)
        writer.start()
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            if not takes(channel.topic):
                continue
            if channel.id not in channels:
                if schema is not None and schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic,
                    channel.message_encoding,
                    schemas[schema.id] if schema is not None else 0,
                    dict(channel.metadata),
                )
            data = body(channel.topic, message.data)
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        if beside:
            for one in reader.iter_metadata():
                writer.add_metadata(one.name, dict(one.metadata))
            for one in reader.iter_attachments():
                writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
        writer.finish()


def logs(folder: Path, dice: np.random.Generator) -> Iterator[Path]:
    """The odd ones, made from ``folder``/whole.mcap."""
    whole = folder / "whole.mcap"
    data = whole.read_bytes()

    def named(name: str, content: bytes | None = None) -> Path:
        path = folder / f"{name}.mcap"
        if content is not None:
            path.write_bytes(content)
        return path

    yield named("empty", b"")
    yield named("text", b"no log\n" * 100)
    yield named("zeros", bytes(100_000))
    yield named("magic", data[:8])
    for part in (0.1, 0.5, 0.9, 0.999):
        yield named(f"cut-{part}", data[: int(part * len(data))])
    for number in range(8):
        changed = bytearray(data)
        for place in dice.integers(len(data), size=1 + 3 * (number % 2)):
            changed[place] = int(dice.integers(256))
        yield named(f"changed-{number}", bytes(changed))
    topics = ("samples", "phasors", "loops", "elements", "trips", "events", "why", "faults")
    for topic in topics:
        rewritten(whole, named(f"without-{topic}"), lambda name, t=topic: not name.endswith(f"/{t}"))
        yield named(f"without-{topic}")
    kinds: dict[str, dict[str, Any]] = {
        "by-mcap": {},
        "bare": {"beside": False},
        "no-messages": {"takes": lambda topic: False},
        "one-topic": {"takes": lambda topic: topic.endswith("RA/samples")},
        "empty-bodies": {"body": lambda topic, body: b""},
        "random-bodies": {"body": lambda topic, body: dice.bytes(len(body))},
        "cut-bodies": {"body": lambda topic, body: body[: len(body) // 2]},
    }
    for name, words in kinds.items():
        rewritten(whole, named(name), **words)
        yield named(name)
    with named("other-tool").open("wb") as sink:
        writer = Writer(sink)
        writer.start()
        schema = writer.register_schema("pose", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/pose", "json", schema)
        for number in range(100):
            writer.add_message(channel, number * 10**6, b'{"x": 1}', number * 10**6)
        writer.finish()
    yield named("other-tool")


def settings(folder: Path, dice: np.random.Generator) -> Iterator[Path]:
    """Five files, damaged in 18 ways."""
    for source in sorted((ROOT / "tests" / "interchange" / "line-7").iterdir()):
        data = source.read_bytes()
        text = data.decode()
        lines = text.splitlines(keepends=True)
        byte = bytearray(data)
        byte[int(dice.integers(len(data)))] = int(dice.integers(256))
        digits = [place for place, letter in enumerate(text) if letter.isdigit()]
        place = digits[int(dice.integers(len(digits)))]
        ways = {
            "whole": data,
            "cut-1": data[: len(data) // 4],
            "cut-2": data[: len(data) // 2],
            "cut-3": data[:-20],
            "byte": bytes(byte),
            "empty": b"",
            "blank": b"\n \t\n",
            "binary": dice.bytes(4096),
            "utf-16": text.encode("utf-16"),
            "latin-1": text.replace("e", "\xe9").encode("latin-1"),
            "bom": b"\xef\xbb\xbf" + data,
            "twice": data + data,
            "reversed": "".join(lines[::-1]).encode(),
            "every-second": "".join(lines[::2]).encode(),
            "letters": (text[:place] + "x" + text[place + 1 :]).encode(),
            "negative": (text[:place] + "-" + text[place:]).encode(),
            "huge-number": (text[:place] + "9e999" + text[place + 1 :]).encode(),
            "deep": b"<XRIO>" + b"<Block>" * 20_000 if b"<" in data else b"BEGIN X\n" * 20_000,
        }
        for name, content in ways.items():
            path = folder / f"{source.stem}-{name}{source.suffix}"
            path.write_bytes(content)
            yield path


def verdict(command: str) -> tuple[int, str]:
    """Status of a command, and what is wrong with how it ended: nothing, mostly."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            status = call(command.split())
    except BaseException:  # whatever it is, it is no line: shown
        return -1, traceback.format_exc().strip().splitlines()[-1]
    if status not in (0, 2, 3):
        return status, f"status {status}"
    if status == 2 and err.getvalue().count("\n") != 1:
        return status, f"{err.getvalue().count(chr(10))} lines: {err.getvalue()!r}"
    return status, ""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=1)
    dice = np.random.default_rng(parser.parse_args().seed)
    wrong = 0
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        folder = Path(name)
        faultloop.run(AG, overrides=["scenario.duration_s=0.3"], log=folder / "whole.mcap")
        counts, files = Counter[int](), 0
        for path in logs(folder, dice):
            files += 1
            for command in COMMANDS:
                for left in folder.glob("o.*"):  # what the command before has written
                    shutil.rmtree(left) if left.is_dir() else left.unlink()
                status, fault = verdict(command.replace("{}", path.name))
                counts[status] += 1
                wrong += bool(fault)
                if fault:
                    print(f"    {command.replace('{}', path.stem)}: {fault}", flush=True)
        each = ", ".join(f"{count} with status {status}" for status, count in sorted(counts.items()))
        print(f"{files} odd logs in {len(COMMANDS)} commands: {counts.total()} calls, {each}; wrong: {wrong}")
        counts, files, refused = Counter[int](), 0, 0
        for path in settings(folder, dice):
            files += 1
            for given in ("", " --z1 3.5,25 --z0 12,80 --ct-ratio 240 --vt-ratio 600 --frequency 50"):
                (folder / "o.toml").unlink(missing_ok=True)
                status, fault = verdict(f"import {path.name}{given} --out o.toml")
                if status == 0:
                    checked, fault = verdict("check o.toml")
                    fault = fault or ("" if checked == 0 else f"taken, but `check` says {checked}")
                counts[status] += 1
                refused += bool(fault)
                if fault:
                    print(f"    import {path.name}{given}: {fault}", flush=True)
        each = ", ".join(f"{count} with status {status}" for status, count in sorted(counts.items()))
        print(f"{files} odd settings files, the line given or not: {counts.total()} imports, {each};")
        print(f"wrong, or taken and not valid: {refused}")
    return 1 if wrong or refused else 0


if __name__ == "__main__":
    raise SystemExit(main())
