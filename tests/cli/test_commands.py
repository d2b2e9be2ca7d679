"""The command line: what it prints, its exit status, and what it leaves behind when the input is wrong."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import faultloop
from faultloop.cli import call

ROOT = Path(__file__).resolve().parents[2]
AG = ROOT / "scenarios" / "ag-zone1.toml"
Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "ag.mcap"
    faultloop.run(AG, log=path)
    return path


def wrong(capsys: Capture, *arguments: object) -> str:
    """Exit status 2, nothing on standard output, one line on standard error."""
    assert call([str(a) for a in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("faultloop: ")
    assert "Traceback" not in err
    return err


def test_run_tells_what_happened(capsys: Capture, tmp_path: Path) -> None:
    target = tmp_path / "deep" / "run.mcap"
    assert call(["run", str(AG), "--log", str(target)]) == 0
    out = capsys.readouterr().out
    for words in (
        "A-G in zone 1",
        "PTRC1 Tr poles ABC zone 1 loop AG",
        "open poles ABC received from RA",
        "held",
    ):
        assert words in out
    assert str(target) in out.replace("\n", "")
    assert [p.name for p in target.parent.iterdir()] == ["run.mcap"]


def test_run_json_is_one_object(capsys: Capture, tmp_path: Path) -> None:
    assert call(["run", str(AG), "--log", str(tmp_path / "x.mcap"), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["held"] is True
    assert {t["relay"] for t in data["trips"]} == {"RA", "RB"}
    trip = data["trips"][0]
    assert trip["received_s"] > trip["decided_s"]
    assert trip["trip_time_ms"] == pytest.approx(1e3 * (trip["received_s"] - data["faults"][0]["t_s"]))


def test_an_expectation_that_fails_is_status_3(capsys: Capture, tmp_path: Path) -> None:
    arguments = ["run", str(AG), "--log", str(tmp_path / "x.mcap"), "--set", "expect.0.within_ms=5"]
    assert call(arguments) == 3
    assert "NOT HELD" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "scenario: missing"),
        ("[scenario", "not valid TOML"),
        ("[scenario]\nname = 3\nduration_s = 1", "scenario.name"),
        (None, "no such file"),
    ],
)
def test_a_wrong_scenario(capsys: Capture, tmp_path: Path, text: str | None, words: str) -> None:
    file = tmp_path / "s.toml"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    assert words in wrong(capsys, "run", file, "--log", tmp_path / "x.mcap")
    assert not list(tmp_path.glob("*.mcap*"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "line.AB.length_km=-1"], "line[AB].length_km"),
        (["--set", "line.AB.lenght_km=1"], "did you mean 'length_km'"),
        (["--set", "relay.RA.settings=no.toml"], "no.toml: no such file"),
        (["--set", "nonsense"], "KEY=VALUE"),
        (["--pace", "-1"], "greater than 0"),
        (["--pace", "1", "--realtime"], "either --realtime"),
        (["--can", "vcan0"], "INTERFACE:CHANNEL"),
        (["--can", "nothing:0"], "nothing"),
        (["--pace", "inf"], "finite"),
        (["--set", "scenario.start=1600-01-01T00:00:00Z"], "scenario.start"),
        (["--set", "scenario.start=5"], "scenario.start"),
        (["--set", "source.SA.frequency_hz=1e-9"], "source[SA].frequency_hz"),
        (["--set", "can.measurements_hz=1e9"], "can.measurements_hz"),
        (["--set", "line.AB.length_km=1e7"], "line[AB].length_km"),
        (["--set", "system.base_kv=1e308"], "system.base_kv"),
        (["--set", "breaker.QA.operate_ms=1e300"], "breaker[QA].operate_ms"),
        (["--set", "expect.0.function=PDIS99"], "did you mean 'PDIS"),
        (["--colour"], "No such option"),
    ],
)
def test_wrong_arguments_of_run(capsys: Capture, tmp_path: Path, arguments: list[str], words: str) -> None:
    assert words in wrong(capsys, "run", AG, "--log", tmp_path / "x.mcap", *arguments)
    assert not list(tmp_path.iterdir())


def test_brackets_in_a_name_are_no_markup(capsys: Capture, tmp_path: Path) -> None:
    log = tmp_path / "x.mcap"
    assert call(["run", str(AG), "--log", str(log), "--set", 'scenario.name="x [/z]"']) == 0
    assert "x [/z]" in capsys.readouterr().out
    assert call(["review", str(log)]) == 0
    assert "x [/z]" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["folder.mcap", "run.toml"])
def test_a_log_goes_to_a_file_of_its_own(capsys: Capture, tmp_path: Path, name: str) -> None:
    (tmp_path / "folder.mcap").mkdir()
    assert name in wrong(capsys, "run", AG, "--log", tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == ["folder.mcap"]


def test_a_users_element_that_fails(capsys: Capture, tmp_path: Path) -> None:
    """One line that names it, and no log half-made."""
    (tmp_path / "bad.py").write_text("def step(state, x, out):\n    raise KeyError('no')\n", encoding="utf-8")
    text = (ROOT / "scenarios" / "settings" / "ab-mho.toml").read_text(encoding="utf-8")
    element = '\n[[element]]\nname = "BAD1"\nfunction = "bad.py:step"\n'
    (tmp_path / "r.toml").write_text(text + element, encoding="utf-8")
    err = wrong(
        capsys, "run", AG, "--log", tmp_path / "x.mcap", "--set", f"relay.RA.settings={tmp_path / 'r.toml'}"
    )
    assert "element[BAD1].function" in err
    assert not list(tmp_path.glob("*.mcap*"))


def test_a_log_that_cannot_be_written(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    assert "cannot be written" in wrong(capsys, "run", AG, "--log", tmp_path / "file" / "x.mcap")


@pytest.mark.parametrize("command", [["review"], ["export", "--csv", "out"], ["recover"], ["diff"]])
@pytest.mark.parametrize(
    ("content", "words"), [(b"", "empty"), (b"hello, this is no MCAP", "not an MCAP"), (None, "no such file")]
)
def test_wrong_logs(
    capsys: Capture, tmp_path: Path, command: list[str], content: bytes | None, words: str
) -> None:
    file = tmp_path / "x.mcap"
    if content is not None:
        file.write_bytes(content)
    more = {"recover": [tmp_path / "out.mcap"], "diff": [file]}.get(command[0], [])
    err = wrong(capsys, command[0], file, *more, *command[1:])
    assert words in err or "no such file" in err.lower()
    assert not list(tmp_path.glob("out*"))


def test_a_half_written_log_says_how_to_recover_it(capsys: Capture, tmp_path: Path, log: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    assert "faultloop recover" in wrong(capsys, "review", cut)
    out = tmp_path / "out.mcap"
    assert call(["recover", str(cut), str(out)]) == 0
    assert len(faultloop.open_log(out).samples("RA")) > 100


def test_diff(capsys: Capture, tmp_path: Path, log: Path) -> None:
    assert call(["diff", str(log), str(log)]) == 0
    assert "no difference" in capsys.readouterr().out
    other = tmp_path / "other.mcap"
    faultloop.run(AG, log=other, overrides=["fault.F1.resistance_ohm=1.5"])
    assert call(["diff", str(log), str(other)]) == 3
    out = capsys.readouterr().out
    assert out.startswith("first difference: /relay/RA/samples.va at 0.1004")
    assert call(["diff", str(log), str(other), "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["first"]["name"] == "/relay/RA/samples.va"
    assert "FIELD=ABS" in wrong(capsys, "diff", log, log, "--tolerance", "va")
    assert "no message has a field" in wrong(capsys, "diff", log, log, "--ignore", "vaa")


def test_exports(tmp_path: Path, log: Path) -> None:
    for arguments in (
        ["--csv", "csv"], ["--parquet", "parquet"], ["--comtrade", "a.cff"], ["--comtrade", "b.cfg"],
        ["--can", "c.blf"], ["--can", "c.asc"], ["--can", "c.log"],
    ):  # fmt: skip
        assert call(["export", str(log), arguments[0], str(tmp_path / arguments[1])]) == 0
    names = {p.name for p in tmp_path.iterdir()}
    assert {"csv", "parquet", "a.cff", "b.cfg", "b.dat", "c.blf", "c.asc", "c.log"} <= names
    assert not [n for n in names if n.endswith((".part", ".tmp"))]


def test_help_is_quick_to_import() -> None:
    """--help must not import numba, numpy or rerun: that is what makes it answer in half a second."""
    code = (
        "import sys; from faultloop.cli import call; call(['--help']);"
        "print([m for m in ('numba', 'numpy', 'rerun', 'matplotlib', 'can') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip().endswith("[]")
    for command in ("run", "replay", "review", "export", "diff", "recover"):
        assert command in done.stdout


def slow_run(folder: Path) -> tuple[subprocess.Popen[bytes], Path]:
    """A run of two simulated seconds at a tenth of real time, once it has written something."""
    log = folder / "slow.mcap"
    command = [sys.executable, "-m", "faultloop", "run", str(AG), "--log", str(log)]
    command += ["--set", "scenario.duration_s=60", "--pace", "2"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    part = folder / "slow.mcap.part"
    _wait(lambda: part.exists() and part.stat().st_size > 1_000_000)
    return process, log


def _wait(ready: Callable[[], bool]) -> None:
    for _ in range(1200):
        if ready():
            return
        time.sleep(0.05)
    raise AssertionError("nothing happened in a minute")


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_leaves_a_whole_log(tmp_path: Path) -> None:
    process, log = slow_run(tmp_path)
    process.send_signal(signal.SIGINT)
    assert process.wait(30) == 130
    assert len(faultloop.open_log(log).samples("RA")) > 0  # it had begun, and its last sample is there
    assert [p.name for p in tmp_path.iterdir()] == ["slow.mcap"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_kill_leaves_a_log_that_recovers(tmp_path: Path, capsys: Capture) -> None:
    process, log = slow_run(tmp_path)
    os.kill(process.pid, signal.SIGKILL)
    process.wait(30)
    assert not log.exists()
    out = tmp_path / "out.mcap"
    assert call(["recover", str(log), str(out)]) == 0  # finds the .part by itself
    assert "slow.mcap.part" in capsys.readouterr().out
    opened = faultloop.open_log(out)
    assert opened.samples("RA")["t_ns"][-1] > 0.1e9
    assert opened.attachments["scenario.toml"]
