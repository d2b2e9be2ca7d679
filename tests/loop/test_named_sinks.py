"""A sink that an installed package brings."""

from __future__ import annotations

from pathlib import Path

import pytest

import faultloop
from faultloop.errors import InputError

SOURCE = """
from pathlib import Path


class Counting:
    def __init__(self, start_ns, name):
        self.lines, self.start_ns = [name], start_ns

    def add_relay(self, name, bits, characteristics=None):
        self.lines.append(f"{name} {bits[0]}")

    def relay_block(self, name, t_ns, *arrays):
        pass

    def message(self, topic, t_ns, message_name, **fields):
        if message_name == "Trip":
            self.lines.append(f"{topic} {fields['function']}")

    def close(self):
        Path(__file__).with_name("seen.txt").write_text("\\n".join(self.lines))

    def abort(self):
        pass


def broken(start_ns, name):
    raise OSError("no such place")
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    info = tmp_path / "counting-1.0.dist-info"
    info.mkdir()
    (tmp_path / "counting_sink.py").write_text(SOURCE, encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: counting\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[faultloop.sinks]\ncounting = counting_sink:Counting\nbroken = counting_sink:broken\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_a_sink_gets_what_the_log_gets(root: Path, package: Path) -> None:
    result = faultloop.run(root / "scenarios" / "ag-zone1.toml", sinks=["counting"])
    lines = (package / "seen.txt").read_text().splitlines()
    assert lines[1:3] == ["RA PDIS1", "RB PDIS1"]
    assert lines[3:] == [f"/relay/{trip.relay}/trips {trip.function}" for trip in result.trips]
    assert len(lines) > 3


@pytest.mark.parametrize(
    ("name", "words"), [("countin", "did you mean 'counting'"), ("broken", "OSError: no such place")]
)
def test_one_that_is_not_there_or_fails_is_named(root: Path, package: Path, name: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        faultloop.run(root / "scenarios" / "ag-zone1.toml", sinks=[name])
    assert error.value.key == "--sink"
