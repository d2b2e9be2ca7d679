"""A function from a file beside the settings, end to end: settings, chain, bits, trip, breaker, log."""

from __future__ import annotations

import re
from pathlib import Path

import faultloop
from faultloop.io.mcap_reader import open_log

SCENARIO = "high-resistance.toml"


def test_a_function_from_a_file_trips_a_breaker(root: Path, tmp_path: Path) -> None:
    text = (root / "docs" / "how-to-add.md").read_text(encoding="utf-8")
    source = next(t for t in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "PTOV = Function" in t)
    (tmp_path / "ptov.py").write_text(source, encoding="utf-8")
    scenario = (root / "scenarios" / SCENARIO).read_text(encoding="utf-8")
    named = re.findall(r'settings *= *"(.*?)"', scenario)
    for name in named:
        target = tmp_path / name
        target.parent.mkdir(exist_ok=True)
        target.write_text((root / "scenarios" / name).read_text(encoding="utf-8"), encoding="utf-8")
    own = tmp_path / named[0]
    element = '\n[[element]]\nname = "MINE"\nfunction = "../ptov.py:PTOV"\nstart_v = 2e3\ntrip = true\n'
    own.write_text(own.read_text(encoding="utf-8") + element, encoding="utf-8")
    path = tmp_path / SCENARIO
    path.write_text(re.sub(r"\[\[expect\]\].*", "", scenario, flags=re.DOTALL), encoding="utf-8")

    result = faultloop.run(path, log=tmp_path / "run.mcap")

    trip = next(trip for trip in result.trips if trip.function == "MINE")
    assert trip.opened_ns is not None
    log = open_log(tmp_path / "run.mcap")
    assert "MINE.Str" in log.bits(trip.relay)["pickup"]
    assert "MINE.Op" in log.bits(trip.relay)["operate"]
    place = log.bits(trip.relay)["operate"].index("MINE.Op")
    operate = log.elements(trip.relay)["operate"]
    assert (operate >> place & 1).any()
    assert any(entry.function == "MINE" for entry in log.trips)
    assert any(entry.message.startswith("MINE Str") for entry in log.events)
