"""The closed loop: scenarios end as they should, and the loop is exact."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.io.diff import diff_logs
from faultloop.io.mcap_reader import open_log
from faultloop.loop import closed_loop
from faultloop.loop.result import Result
from faultloop.loop.scenario import Scenario, load_scenario
from tests.examples import scenario

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = sorted((ROOT / "scenarios").glob("*.toml"))
AG = ROOT / "scenarios" / "ag-zone1.toml"


@pytest.mark.parametrize("file", SCENARIOS, ids=lambda f: f.stem)
def test_expectations_of_the_ready_scenarios_hold(file: Path) -> None:
    result = faultloop.run(file)
    assert result.expectations
    assert result.held, [v.why for v in result.expectations if not v.held]


def test_a_trip_opens_the_breaker_and_the_fault_current_is_gone() -> None:
    result = faultloop.run(AG)
    for trip in result.trips:
        assert trip.received_ns is not None and trip.opened_ns is not None
        # the frame: sent with the sample, some 0.23 ms on the wire at 500 kbit/s
        assert 200_000 <= trip.received_ns - trip.t_ns <= 600_000
        # the breaker: 40 ms, then the first current zero of each phase
        assert 40e6 <= trip.opened_ns - trip.received_ns <= 51e6
        rows = result.samples(trip.relay)
        after = rows[rows["t_ns"] > trip.opened_ns + 1_000_000]
        for phase in ("ia", "ib", "ic"):
            assert np.abs(after[phase]).max() < 1.0  # a line open at both ends: no current


def test_an_open_line_has_no_direction_and_no_start() -> None:
    """After the poles have opened, on a bus that keeps its voltage."""
    result = faultloop.run(ROOT / "scenarios" / "clearing-both-ends.toml")
    for relay in ("RA", "RB"):
        opened = max(trip.opened_ns or 0 for trip in result.trips if trip.relay == relay)
        rows = result.elements(relay)
        late = rows[rows["t_ns"] > opened + 60_000_000]
        assert len(late) > 500
        assert not late["pickup"].any()


def test_causality_a_trip_changes_nothing_before_it_arrives() -> None:
    """With and without the trip the plant gives the same samples until the breaker's poles part."""
    with_trip = faultloop.run(AG)
    without = faultloop.run(load_scenario(AG, ["relay.RA.breaker=QB", "relay.RB.breaker=QA"]))
    first = min(t.received_ns for t in with_trip.trips if t.received_ns is not None)
    a, b = with_trip.samples("RA"), without.samples("RA")
    until = a["t_ns"] < first + 40_000_000
    for channel in ("va", "ia", "ic"):
        np.testing.assert_array_equal(a[channel][until], b[channel][until])


@pytest.mark.parametrize("block", [1, 7, 1000])
def test_the_block_size_changes_no_bit(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = _everything(faultloop.run(ROOT / "scenarios" / "evolving-fault.toml"))
    monkeypatch.setattr(closed_loop, "ROWS", block)
    got = _everything(faultloop.run(ROOT / "scenarios" / "evolving-fault.toml"))
    assert got == wanted


def _everything(result: Result) -> tuple[object, ...]:
    topics = (result.samples, result.phasors, result.loops, result.elements)
    arrays = [topic(relay).tobytes() for topic in topics for relay in ("RA", "RB")]
    return (*arrays, result.trips, result.events, result.can_frames)


def test_same_scenario_and_seed_give_the_same_bytes(tmp_path: Path) -> None:
    """Here and in another process, whose hashes are seeded differently."""
    file = ROOT / "scenarios" / "clearing-both-ends.toml"  # it has noise
    a, b = tmp_path / "a.mcap", tmp_path / "b.mcap"
    faultloop.run(file, log=a)
    code = f"import faultloop; faultloop.run({str(file)!r}, log={str(b)!r})"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)
    assert a.read_bytes() == b.read_bytes()
    assert diff_logs(open_log(a), open_log(b)).equal
    faultloop.run(file, log=b, overrides=["scenario.seed=2"])
    assert a.read_bytes() != b.read_bytes()


def test_diff_names_the_first_field_and_time(tmp_path: Path) -> None:
    a, b = tmp_path / "a.mcap", tmp_path / "b.mcap"
    result = faultloop.run(AG, log=a)
    faultloop.run(AG, log=b, overrides=["fault.F1.resistance_ohm=2"])
    diff = diff_logs(open_log(a), open_log(b))
    start = result.fault_start_ns
    assert start is not None
    assert diff.first is not None
    assert diff.first.name.startswith(("/relay/RA/samples.", "/relay/RB/samples."))
    # nothing differs before the fault, and something does in the sample after it
    assert start <= diff.first.t_ns <= start + 1_000_000


def test_a_real_front_end_shows_noise_and_steps() -> None:
    result = faultloop.run(ROOT / "scenarios" / "clearing-both-ends.toml")
    rows = result.samples("RA")
    step = 800e3 / 2**16
    codes = rows["va"] / step
    np.testing.assert_allclose(codes, np.round(codes), atol=1e-6)


def test_without_relays_the_plant_still_runs() -> None:
    result = faultloop.run(Scenario.from_dict(scenario(relay=[], breaker=[])))
    assert not result.trips
    assert result.faults[0].on
    with pytest.raises(KeyError):
        result.samples()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["relay.RA.settings=nothing.toml"], "no such file"),
        (["system.sampling_hz=4000"], "4000"),
        (["system.frequency_hz=60"], "frequency_hz"),
        (["can.interface=carrier-pigeon"], "carrier-pigeon"),
    ],
)
def test_what_only_the_run_can_find_wrong(overrides: list[str], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        faultloop.run(AG, log=tmp_path / "x.mcap", overrides=overrides)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("start_s", [0.0, 0.001, 0.021])
def test_the_relay_is_in_service_when_the_run_begins(start_s: float) -> None:
    fault = f"fault=[{{line='AB', at_pu=0.4, type='BC', start_s={start_s}}}]"
    data = scenario(fault=tomllib.loads(fault)["fault"])
    result = faultloop.run(Scenario.from_dict(data, path=ROOT / "scenarios" / "x.toml"))
    assert {(t.relay, t.loop, t.function) for t in result.trips} == {
        ("RA", "BC", "PDIS1"),
        ("RB", "BC", "PDIS1"),
    }
    assert all((t.received_ns or 0) / 1e9 - start_s < 0.03 for t in result.trips)


def test_phasors_stand_from_the_first_sample_on() -> None:
    result = faultloop.run(AG)
    before = result.phasors("RA")[:400]
    for column in ("va_re", "va_im", "ic_re", "ic_im", "frequency_hz"):
        assert np.ptp(before[column]) < 1e-3 * np.abs(before[column]).max()
