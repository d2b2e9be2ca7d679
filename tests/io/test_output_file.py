"""What is written is whole or not there, and two writers never share a file."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.output_file import OutputFiles, missing_folders, parts_of, write_aside
from faultloop.io.recover import recover_log

SMALL = Path(__file__).parent / "data" / "v0.1.0.mcap"
posix = pytest.mark.skipif(sys.platform == "win32", reason="locks, FIFOs and signals of POSIX")


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


# -- one file, several files -----------------------------------------------------------------------------


def test_a_file_gets_its_name_when_it_is_whole(tmp_path: Path) -> None:
    with write_aside(tmp_path / "x.txt", ".txt") as aside:
        aside.write_text("one", encoding="utf-8")
        assert not (tmp_path / "x.txt").exists()
    assert left(tmp_path) == ["x.txt"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, RuntimeError, InputError])
def test_nothing_stays_of_what_fails(error: type[BaseException], tmp_path: Path) -> None:
    (tmp_path / "x.txt").write_text("before", encoding="utf-8")
    with pytest.raises(error), write_aside(tmp_path / "x.txt") as aside:
        aside.write_text("half", encoding="utf-8")
        raise error("stop")
    assert left(tmp_path) == ["x.txt"]
    assert (tmp_path / "x.txt").read_text(encoding="utf-8") == "before"


def test_two_writers_of_one_name_do_not_meet(tmp_path: Path) -> None:
    with write_aside(tmp_path / "x") as one, write_aside(tmp_path / "x") as other:
        assert one != other
        one.write_text("1" * 1000, encoding="utf-8")
        other.write_text("2", encoding="utf-8")
    assert (tmp_path / "x").read_text(encoding="utf-8") in ("1" * 1000, "2")
    assert left(tmp_path) == ["x"]


def test_several_files_come_together_or_not_at_all(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No space"), OutputFiles(tmp_path) as files:
        files.new(tmp_path / "a").write_text("a", encoding="utf-8")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert left(tmp_path) == []


def test_folders_that_were_made_go_with_what_failed(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), missing_folders(tmp_path / "a" / "b"):
        raise RuntimeError
    assert left(tmp_path) == []
    with missing_folders(tmp_path / "a" / "b"):
        pass
    assert left(tmp_path) == ["a", "b"]


@posix
@pytest.mark.parametrize("kind", ["FIFO", "link", "folder", "dangling link", "device"])
def test_only_a_regular_file_is_replaced(kind: str, tmp_path: Path) -> None:
    """In place of the target, for every writer that the command line has."""
    for name in ("x.mcap", "x.cfg", "x.cff", "x.blf", "x.log", "x.html", "x.png"):
        target = tmp_path / name
        if kind == "FIFO":
            os.mkfifo(target)
        elif kind == "folder":
            target.mkdir()
        elif kind == "device":
            target.symlink_to("/dev/null")
        else:
            if kind == "link":
                (tmp_path / "somebody's").write_text("keep", encoding="utf-8")
            target.symlink_to(tmp_path / "somebody's")
    before = left(tmp_path)
    says = kind.rpartition(" ")[2].replace("device", "link")
    with pytest.raises(InputError, match=says):
        recover_log(SMALL, tmp_path / "x.mcap")
    with pytest.raises(InputError, match=says):
        LogWriter(tmp_path / "x.mcap", 0)
    for option, name in (
        ("--comtrade", "x.cfg"),
        ("--comtrade", "x.cff"),
        ("--can", "x.blf"),
        ("--can", "x.log"),
    ):
        assert call(["export", str(SMALL), option, str(tmp_path / name)]) == 2
    for option, name in (("--html", "x.html"), ("--png", "x.png")):
        assert call(["review", str(SMALL), option, str(tmp_path / name)]) == 2
    assert left(tmp_path) == before
    if kind == "link":
        assert (tmp_path / "somebody's").read_text(encoding="utf-8") == "keep"


@posix
def test_what_stands_at_the_part_is_left_alone(make_log: Callable[..., Path], tmp_path: Path) -> None:
    """A FIFO, a link to somebody's file, a folder: neither followed, nor written to, nor waited for."""
    os.mkfifo(tmp_path / "a.mcap.part")
    (tmp_path / "mine").write_text("keep", encoding="utf-8")
    (tmp_path / "b.mcap.part").symlink_to(tmp_path / "mine")
    (tmp_path / "c.mcap.part").mkdir()
    for name in "abc":
        log = open_log(make_log(tmp_path / f"{name}.mcap", rows=10))
        assert len(log.samples("R1")) == 10
    assert (tmp_path / "mine").read_text(encoding="utf-8") == "keep"
    assert (tmp_path / "b.mcap.part").is_symlink() and not list(tmp_path.glob("*.2.part"))


# -- two runs to one log ---------------------------------------------------------------------------------


@posix
def test_a_second_run_to_a_log_in_the_making_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    first = LogWriter(path, 0)
    first.message("/breaker/first", 0, "BreakerStatus")
    with pytest.raises(InputError, match="another run is writing this log") as caught:
        LogWriter(path, 0)
    assert "\n" not in str(caught.value) and caught.value.file == str(path)
    first.close()
    assert open_log(path).breakers == ("first",)
    with LogWriter(path, 0) as second:  # afterwards a run replaces it, as ever
        second.message("/breaker/second", 0, "BreakerStatus")
    assert open_log(path).breakers == ("second",)
    assert left(tmp_path) == ["run.mcap"]


@posix
def test_many_at_once_and_every_one_that_ends_well_has_its_own(tmp_path: Path) -> None:
    """Threads that open, write and close one log at the same time: whoever closes has been alone."""
    path, outcome = tmp_path / "run.mcap", []
    gate = threading.Barrier(8)
    closing = threading.Lock()

    def run(number: int) -> None:
        gate.wait()
        try:
            log = LogWriter(path, 0)
        except InputError:
            outcome.append((number, None))
            return
        log.message(f"/breaker/{number}", 0, "BreakerStatus")
        with closing:
            log.close()
            outcome.append((number, open_log(path).breakers))

    threads = [threading.Thread(target=run, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(outcome) == 8
    done = [(number, breakers) for number, breakers in outcome if breakers is not None]
    assert done and all(breakers == (str(number),) for number, breakers in done)
    assert left(tmp_path) == ["run.mcap"]


def test_what_a_killed_run_left_is_never_overwritten(make_log: Callable[..., Path], tmp_path: Path) -> None:
    whole = make_log(tmp_path / "whole.mcap", rows=600).read_bytes()
    path = tmp_path / "run.mcap"
    for number, name in enumerate(("run.mcap.part", "run.mcap.2.part")):
        (tmp_path / name).write_bytes(whole[: 200_000 + number])
        os.utime(tmp_path / name, (number, number))
    third = LogWriter(path, 0)
    assert third.part.name == "run.mcap.3.part"
    third.discard()
    assert [part.name for part in parts_of(path)] == ["run.mcap.2.part", "run.mcap.part"]
    with pytest.raises(InputError, match=r"left run\.mcap\.2\.part, run\.mcap\.part: faultloop recover"):
        open_log(path)
    result = recover_log(path, tmp_path / "out.mcap")
    assert result.source.name == "run.mcap.2.part"
    assert [other.name for other in result.others] == ["run.mcap.part"]
    assert "not taken, as older" in str(result)


# -- a full disk, a device that fails --------------------------------------------------------------------


class Full:
    """A raw file that takes so many bytes and no more."""

    def __init__(self, raw: Any, room: int, number: int) -> None:
        self.raw, self.room, self.number, self.refused = raw, room, number, 0

    def write(self, data: Any) -> int:
        if self.refused or self.room <= 0:
            self.refused += 1
            raise OSError(self.number, os.strerror(self.number))
        taken = self.raw.write(memoryview(data)[: self.room])
        self.room -= taken
        return taken


@contextmanager
def full_disk(monkeypatch: pytest.MonkeyPatch, room: int, number: int = errno.ENOSPC) -> Iterator[list[Full]]:
    """Logs find a disk with this much room."""
    import io

    made: list[Full] = []

    class Raw(io.FileIO):
        def write(self, data: Any) -> int:  # type: ignore[override]
            return made[-1].write(data)

    def fdopen(descriptor: int, *_: object, **__: object) -> Raw:
        raw = Raw(descriptor, "wb")
        plain = io.FileIO(os.dup(descriptor), "wb")
        made.append(Full(plain, room, number))
        return raw

    with monkeypatch.context() as patch:
        patch.setattr("faultloop.io.output_file.os.fdopen", fdopen)
        yield made


@pytest.mark.parametrize(
    ("number", "room"), [(errno.ENOSPC, 650_000), (errno.ENOSPC, 1_000_000), (errno.EIO, 300_000)]
)
def test_full_disk_is_one_line_and_nothing_more_is_written(
    number: int, room: int, make_arrays: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path, arrays = tmp_path / "run.mcap", make_arrays(4800)
    with full_disk(monkeypatch, room, number) as disks:
        log = LogWriter(path, 0)
        log.add_relay("R1", ["PDIS1"])
        with pytest.raises(InputError) as caught:
            for start in range(0, 4800, 480):
                log.relay_block("R1", *(array[start : start + 480] for array in arrays))
        size = log.part.stat().st_size
        log.abort()
        assert log.failed and log.part.stat().st_size == size and disks[-1].refused == 1
        with pytest.raises(InputError):
            log.close()
        log.discard()  # what is there stays
    told = str(caught.value)
    assert "\n" not in told and os.strerror(number) in told
    assert f"faultloop recover {path}.part OUT.mcap" in told
    assert left(tmp_path) == ["run.mcap.part"]
    recover_log(path, tmp_path / "out.mcap")
    rows = len(open_log(tmp_path / "out.mcap").samples("R1"))
    assert rows * 495 > size - 250_000  # what a chunk may hold back


def test_a_disk_that_is_full_at_the_end(
    make_arrays: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with full_disk(monkeypatch, 60_000):
        log = LogWriter(tmp_path / "run.mcap", 0)
        log.add_relay("R1", [])
        log.relay_block("R1", *make_arrays(100))
        with pytest.raises(InputError, match=r"run\.mcap\.part"):
            log.close()
    assert not (tmp_path / "run.mcap").exists()
    recover_log(tmp_path / "run.mcap", tmp_path / "out.mcap")
    assert len(open_log(tmp_path / "out.mcap").samples("R1")) == 100


def test_a_disk_that_is_full_from_the_start_leaves_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with full_disk(monkeypatch, 10), pytest.raises(InputError, match="No space"):
        LogWriter(tmp_path / "run.mcap", 0)
    assert left(tmp_path) == []


@posix
@pytest.mark.parametrize("more", [[], ["--log-thread"]])
def test_run_on_a_full_disk_ends_with_2_and_names_the_part(
    more: list[str], root: Path, tmp_path: Path
) -> None:
    """The real thing: a limit on the size of files, which fails as a full disk does."""
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "from faultloop.cli import call; import faultloop.loop.runner;"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000));"
        "sys.exit(call(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", code, "run", str(root / "scenarios" / "ag-zone1.toml"), *more, "--log"]
    done = subprocess.run([*command, "x.mcap"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = [text for text in done.stderr.splitlines() if not text.startswith("first run of this version")]
    assert "x.mcap.part" in line and "faultloop recover" in line
    assert left(tmp_path) == ["x.mcap.part"]
    assert recover_log(tmp_path / "x.mcap", tmp_path / "out.mcap").messages


# -- signals ---------------------------------------------------------------------------------------------

STOPPED_IN_THE_MIDDLE = """
import os, signal, sys
from pathlib import Path
from faultloop.cli import call
from faultloop.io import output_file

new = output_file.OutputFiles.new
def new_and_stop(self, path):
    aside = new(self, path)
    aside.write_bytes(b"half")
    os.kill(os.getpid(), getattr(signal, sys.argv[1]))
    return aside
output_file.OutputFiles.new = new_and_stop
sys.exit(call(sys.argv[2:]))
"""


@posix
@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("SIGINT", ["recover", "LOG", "out/x.mcap"]),
        ("SIGTERM", ["recover", "LOG", "out/x.mcap"]),
        ("SIGHUP", ["export", "LOG", "--csv", "out/new"]),
        ("SIGTERM", ["export", "LOG", "--comtrade", "out/new/x.cfg"]),
        ("SIGINT", ["export", "LOG", "--can", "out/x.asc"]),
        ("SIGTERM", ["review", "LOG", "--png", "out/x.png"]),
        ("SIGTERM", ["review", "LOG", "--html", "out/x.html"]),
        ("SIGTERM", ["suite", "bus", "--html", "out/x.html"]),
    ],
)
def test_a_signal_leaves_nothing_half_made(name: str, arguments: list[str], tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    command = [sys.executable, "-c", STOPPED_IN_THE_MIDDLE, name]
    command += [str(SMALL) if part == "LOG" else part for part in arguments]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr
    assert left(tmp_path / "out") == []


@posix
def test_a_replay_that_is_stopped_leaves_its_log_whole(root: Path, tmp_path: Path) -> None:
    settings = root / "scenarios" / "settings" / "ab-mho.toml"
    source = tmp_path / "long.mcap"
    rows = 20 * 4800
    t_ns = np.arange(rows) * 1_000_000_000 // 4800
    with LogWriter(source, 0) as log:
        log.add_relay("R", [])
        words = np.zeros(rows, np.uint64)
        waves = np.sin(2 * np.pi * 50 * t_ns / 1e9)[:, None] * np.array([1e5, 1e5, 1e5, 1e3, 1e3, 1e3])
        log.relay_block(
            "R", t_ns, np.arange(rows), waves, np.zeros((rows, 14)), np.zeros((rows, 12)), words, words
        )
    code = (
        "import os, signal, sys; from faultloop.cli import call; from faultloop.relay import Relay\n"
        "advance, calls = Relay.advance, []\n"
        "def stopping(self, block):\n"
        "    calls.append(1)\n"
        "    if len(calls) == 30: os.kill(os.getpid(), getattr(signal, sys.argv[1]))\n"
        "    return advance(self, block)\n"
        "Relay.advance = stopping\n"
        "sys.exit(call(sys.argv[2:]))"
    )
    command = [sys.executable, "-c", code, "SIGTERM", "replay", str(source), "--settings", str(settings)]
    done = subprocess.run(
        [*command, "--log", "out.mcap"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 130, done.stderr
    assert "interrupted before the record's end" in done.stdout
    assert left(tmp_path) == ["long.mcap", "out.mcap"]
    assert len(open_log(tmp_path / "out.mcap").samples("replay")) == 30 * 240
