"""One setting changed in each of 22 runs: the first difference is where that setting acts first."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import faultloop
from faultloop.config.toml_text import toml_text
from faultloop.io.diff import diff_logs
from faultloop.io.mcap_reader import Log
from tests.examples import scenario

ROOT = Path(__file__).resolve().parents[2]
MS = 1_000_000
FAULT_NS = 100 * MS
STEP_NS, SAMPLE_NS = 52_083, 208_334
FRAME_NS = 270_000
"""Of 8 bytes at 500 kbit/s, with the most stuffing."""
WAVE_NS = 168_000
"""From the fault at 50 km to either relay: 50 km sqrt(L' C'), L' = 0.40 / w, C' = 2.8 uS / w."""

Window = tuple[int, int]


def made(path: Path, *overrides: str, **tables: Any) -> Log:
    data = scenario(scenario={"duration_s": 0.25}, **tables)
    for relay in data["relay"]:
        relay["settings"] = str(ROOT / "scenarios" / relay["settings"])
    file = path.with_suffix(".toml")
    file.write_text(toml_text(data), encoding="utf-8")
    faultloop.run(file, overrides=overrides, log=path)
    return faultloop.open_log(path)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return made(tmp_path_factory.mktemp("diff") / "base.mcap")


def bit(log: Log, relay: str, name: str, on: bool = True) -> int:
    """When a bit of the elements first came, or went [ns]."""
    kind = "pickup" if name.endswith(".Str") else "operate"
    place = log.bits(relay)[kind].index(name)
    rows = log.elements(relay)
    values = (rows[kind] >> place & 1).astype(bool)
    came = int(values.argmax())
    return int(rows["t_ns"][came if on else came + int((~values[came:]).argmax())])


def at(t_ns: int, within_ns: int = 0) -> Callable[[Log, Log], Window]:
    return lambda a, b: (t_ns, t_ns + within_ns)


def of_base(relay: str, name: str, on: bool = True) -> Callable[[Log, Log], Window]:
    return lambda a, b: (bit(a, relay, name, on), bit(a, relay, name, on))


def opening(a: Log, b: Log) -> Window:
    """When the first pole of QA opened in the other run, which is the sooner one."""
    rows = b.array("/breaker/QA")
    opened = int(rows["t_ns"][~(rows["pole_a"] & rows["pole_b"] & rows["pole_c"])][0])
    return opened - SAMPLE_NS, opened + SAMPLE_NS


def first_trip_frame(a: Log, b: Log) -> Window:
    """RA's is lost: what comes after it is on the bus by a frame's length sooner."""
    rows = a.array("/can")
    first = int(rows["t_ns"][rows["id"] == 0x10][0])
    return first - FRAME_NS, first


WAVES = at(FAULT_NS + WAVE_NS - STEP_NS, SAMPLE_NS + 2 * STEP_NS)
START = at(0)
# what is changed: the field that differs first, and from when to when
CASES: list[tuple[str | dict[str, Any], str, Callable[[Log, Log], Window]]] = [
    ("fault.F1.resistance_ohm=5", r"/relay/R[AB]/samples\.v", WAVES),
    ("fault.F1.at_pu=0.45", r"/relay/RA/samples\.va", START),  # the place cuts the line, 1e-8
    ("fault.F1.type=BG", r"/plant/faults\.type", at(FAULT_NS, STEP_NS)),
    ("fault.F1.start_s=0.11", r"/plant/faults\.\(message\)", at(FAULT_NS, STEP_NS)),
    ("fault.F1.duration_s=0.02", r"/plant/faults|/relay/R./samples", at(FAULT_NS + 20 * MS, 11 * MS)),
    ("source.SA.voltage_pu=1.01", r"/relay/RA/samples\.va", START),
    ("source.SB.angle_deg=-11", r"/relay/RA/samples\.va", START),
    ("line.AB.x1_ohm_per_km=0.41", r"/relay/RA/samples\.va", START),
    ("front_end.voltage_noise_v=100", r"/relay/RA/samples\.va", START),
    ("relay.RA.estimator.method=fourier", r"/relay/RA/phasors\.", at(0, 4 * SAMPLE_NS)),
    ("relay.RB.line.z0_ohm=[30.0, 120.0]", r"/relay/RB/loops\.[abc]g_", at(0, FAULT_NS + 2 * SAMPLE_NS)),
    ("relay.RA.pdis.1.reach_pu=0.4", r"/relay/RA/elements\.pickup", of_base("RA", "PDIS1.Str")),
    ("relay.RB.pdis.1.delay_ms=50", r"/relay/RB/elements\.operate", of_base("RB", "PDIS1.Op")),
    ("relay.RA.pdis.4.direction=reverse", r"/relay/RA/elements\.pickup", of_base("RA", "PDIS4.Str")),
    ("relay.RA.ptrc.mode=single-pole", r"/relay/RA/trips\.poles", of_base("RA", "PTRC1.Tr")),
    ("relay.RA.ptrc.minimum_trip_ms=120", r"/relay/RA/elements\.operate", of_base("RA", "PTRC1.Tr", False)),
    ("breaker.QA.operate_ms=30", r"/breaker/QA\.|/relay/R./samples", opening),
    ("can.bitrate=250000", r"/can\.", at(0, 2 * MS)),
    ("can.measurements_hz=50", r"/can\.", at(0, 100 * MS)),
    ("scenario.duration_s=0.2", r"/relay/R./samples\.\(message\)", at(200 * MS)),
    ({"bus_fault": [{"kind": "loss", "message": "trip", "node": "RA"}]}, r"/can\.", first_trip_frame),
    ({"load": [{"name": "L", "bus": "B", "mw": 50}]}, r"/relay/RA/samples\.va", START),
]  # fmt: skip


@pytest.mark.parametrize(("change", "field", "when"), CASES, ids=[str(case[0]) for case in CASES])
def test_the_first_difference(
    base: Log, tmp_path: Path, change: str | dict[str, Any], field: str, when: Callable[[Log, Log], Window]
) -> None:
    path = tmp_path / "other.mcap"
    other = made(path, change) if isinstance(change, str) else made(path, **change)
    first = diff_logs(base, other).first
    assert first is not None
    earliest, latest = when(base, other)
    assert re.match(field, first.name), first
    assert earliest <= first.t_ns <= latest, first
