"""Two-ended location, against the place at which the plant applied the fault."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import faultloop
from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.review.locate import locate
from tests.measured import Measured
from tests.review.review_logs import START_NS, write_log

CASES = [
    ("AG", 0.1, 1.0), ("AG", 0.73, 50.0), ("BC", 0.4, 5.0), ("CAG", 0.9, 0.1), ("ABC", 0.55, 0.1),
    ("ABC", 0.05, 10.0),
]  # fmt: skip


def run(root: Path, folder: Path, kind: str, at: float, ohm: float, *more: str) -> Path:
    log = folder / "run.mcap"
    changes = [f"fault.F1.type={kind}", f"fault.F1.at_pu={at}", f"fault.F1.resistance_ohm={ohm}", *more]
    faultloop.run(root / "scenarios" / "ag-zone1.toml", log=log, overrides=changes)
    return log


@pytest.mark.parametrize(("kind", "at", "ohm"), CASES)
def test_a_fault_is_where_the_plant_applied_it(
    root: Path, tmp_path: Path, kind: str, at: float, ohm: float, measured: Measured
) -> None:
    log = open_log(run(root, tmp_path, kind, at, ohm))
    both = locate(log, log)
    assert (both.synchronised, both.sequence) == (True, "positive" if kind == "ABC" else "negative")
    measured("error", 100 * abs(both.part - at), "% of the line")
    assert both.part == pytest.approx(at, abs=0.005)
    assert both.km == pytest.approx(100 * both.part)
    apart = locate(log, log, ("RA", "RB"), synchronised=False)
    measured("error without a common clock", 100 * abs(apart.part - at), "% of the line")
    assert apart.part == pytest.approx(at, abs=0.01)
    assert both.second_mismatch == pytest.approx(0, abs=0.01)
    assert apart.second_mismatch == pytest.approx(0, abs=0.03)  # no word
    assert locate(log, log, ("RB", "RA")).part == pytest.approx(1 - at, abs=0.005)


def test_a_long_line_with_its_capacitance(root: Path, tmp_path: Path) -> None:
    log = open_log(run(root, tmp_path, "AG", 0.3, 20.0, "line.AB.length_km=300"))
    assert locate(log, log).part == pytest.approx(0.3, abs=0.005)


def test_two_faults_that_agree_somewhere_are_not_taken_for_one(root: Path, tmp_path: Path) -> None:
    """Magnitudes of what is used to find the place agree at 70 % of the line for a fault between B and C at
    40 % as one end saw it and one at 90 % as the other did; of three-phase faults at 55 and 80 % at 69 %."""

    def of(kind: str, at: float, ohm: float) -> Log:
        folder = tmp_path / f"{kind}{at}"
        folder.mkdir()
        return open_log(run(root, folder, kind, at, ohm))

    one, other = of("BC", 0.4, 5.0), of("BC", 0.9, 0.1)
    with pytest.raises(InputError) as refused:
        locate(one, other, ("RA", "RB"))
    assert str(refused.value) == (
        "at 70.6 % of the line the two ends agree in the negative sequence alone, and differ by 39 %"
        " otherwise: are both of the same fault, and are these its two ends?"
    )
    with pytest.raises(InputError, match="in the positive sequence alone"):
        locate(of("ABC", 0.55, 0.1), other := of("ABC", 0.8, 0.1), ("RA", "RB"))
    near = of("ABC", 0.7, 0.1)
    found = locate(near, other, ("RA", "RB"))
    assert found.second_mismatch is not None and 0.03 < found.second_mismatch < 0.2
    assert any(
        "in what was not used to find it: are both of the same fault" in line for line in near.warnings
    )


def test_command_line_and_what_is_wrong(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(run(root, tmp_path, "AG", 0.4, 1.0))
    assert call(["locate", log, log, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["part"] == pytest.approx(0.4, abs=0.005) and told["synchronised"] is True
    assert call(["locate", log, log]) == 0
    assert "of the line, " in capsys.readouterr().out
    for arguments, words in (
        (["--relay-a", "RC"], "has no relay 'RC'; it has RA, RB"),
        (["--relay-a", "RB", "--relay-b", "RB"], "both are relay RB"),
    ):
        assert call(["locate", log, log, *arguments]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and words in error
    lonely = write_log(tmp_path / "one.mcap")
    with pytest.raises(InputError, match="has 1 relays, and two are needed"):
        locate(open_log(lonely), open_log(lonely))
    with LogWriter(tmp_path / "quiet.mcap", START_NS) as writer:
        writer.add_relay("R1", ("PDIS1",))
    with pytest.raises(InputError, match="tells no impedance of the line"):
        locate(open_log(tmp_path / "quiet.mcap"), open_log(log))


def test_a_record_is_told_how_it_becomes_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, record = str(write_log(tmp_path / "a.mcap")), tmp_path / "b.cfg"
    assert call(["locate", log, str(record)]) == 2
    what = "is a COMTRADE record: play it into a relay (faultloop replay --log F.mcap), give its log"
    assert capsys.readouterr().err == f"faultloop: {record}: {what}\n"
