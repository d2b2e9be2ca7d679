"""The closed loop on a bus where something goes wrong."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest

import faultloop
from faultloop.loop import closed_loop
from faultloop.loop.result import Result
from faultloop.loop.scenario import Scenario

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
LOSSY = SCENARIOS / "lossy-bus.toml"
MS = 1_000_000
AG = tomllib.loads((SCENARIOS / "ag-zone1.toml").read_text(encoding="utf-8"))
QUIET = AG | {"fault": [], "expect": [], "scenario": AG["scenario"] | {"duration_s": 0.2}}


def run(*faults: dict[str, Any], data: dict[str, Any] = AG, **can: Any) -> Result:
    data = copy.deepcopy(data) | {"bus_fault": list(faults)}
    data["can"] = data.get("can", {}) | can
    return faultloop.run(Scenario.from_dict(data, path=SCENARIOS / "x.toml"))


def received(result: Result) -> dict[str, int | None]:
    return {trip.relay: trip.received_ns for trip in result.trips}


def texts(result: Result, source: str) -> list[str]:
    return [event.text for event in result.events if event.source == source]


def everything(result: Result) -> tuple[object, ...]:
    topics = (result.samples, result.phasors, result.elements)
    arrays = [topic(relay).tobytes() for topic in topics for relay in ("RA", "RB")]
    return (*arrays, result.trips, result.events, result.can_frames)


def test_same_seed_same_bytes_and_another_seed_other_faults(tmp_path: Path) -> None:
    a, b = tmp_path / "a.mcap", tmp_path / "b.mcap"
    first, second = (faultloop.run(LOSSY, log=log) for log in (a, b))
    assert a.read_bytes() == b.read_bytes()
    assert received(first) == received(second)
    other = faultloop.run(LOSSY, overrides=["scenario.seed=2"])
    assert other.held
    assert received(other) != received(first)


@pytest.mark.parametrize("block", [1, 7, 1000])
def test_the_block_size_changes_no_bit(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = everything(faultloop.run(LOSSY))
    monkeypatch.setattr(closed_loop, "ROWS", block)
    assert everything(faultloop.run(LOSSY)) == wanted


@pytest.mark.parametrize("node", ["RA", "QA"])
def test_the_block_size_changes_no_bit_of_a_bus_off(node: str, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = {"kind": "bit_error", "node": node, "start_s": 0.09, "duration_s": 0.05}
    wanted = run(broken)
    assert any("bus-off" in text for text in texts(wanted, node))
    monkeypatch.setattr(closed_loop, "ROWS", 3)
    assert everything(run(broken)) == everything(wanted)


def test_a_breaker_that_is_bus_off_hears_no_trip() -> None:
    """Every frame of QA's is hit, so its controller goes bus-off and comes back, again and again."""
    broken = run({"kind": "bit_error", "node": "QA", "start_s": 0.01, "duration_s": 0.15})
    states = [(e.t_ns, e.text) for e in broken.events if e.source == "QA" and e.text.startswith("is ")]
    sent = received(run())["RA"] or 0
    off = max(t_ns for t_ns, text in states if text == "is bus-off" and t_ns < sent)
    back = min(t_ns for t_ns, text in states if text == "is error-active" and t_ns > off)
    assert off < sent < sent + 2 * MS < back < sent + 6 * MS  # the trip and its first repetition are missed
    assert received(broken)["RA"] == pytest.approx(sent + 6 * MS, abs=0.3 * MS)


def test_a_fault_that_hits_nothing_changes_nothing() -> None:
    clean, faulty = run(), run({"kind": "loss", "probability": 0.0})
    clean_events, events = ([e for e in r.events if e.source != "B1"] for r in (clean, faulty))
    assert events == clean_events
    assert everything(faulty)[:-2] == everything(clean)[:-2]
    assert faulty.can_frames == clean.can_frames


def test_each_lost_frame_delays_a_trip_to_the_next_repetition() -> None:
    """Repeated after 2, 4, 8 ms: with the first n lost the trip comes 2, 6, 14 ms later."""
    base = received(run())
    for lost, later_ms in ((1, 2), (2, 6), (3, 14)):
        # the relay's first two trip frames say that no pole is to be opened, at 0 and 2, 6, 14, ... ms
        window = {"kind": "loss", "message": "trip", "node": "RA", "start_s": 0.105}
        got = received(run(window | {"pattern": "1" * lost + "0" * 50}))
        assert abs((got["RB"] or 0) - (base["RB"] or 0)) < 0.3 * MS  # it may miss a frame of RA's before it
        assert (got["RA"] or 0) - (base["RA"] or 0) == pytest.approx(later_ms * MS, abs=0.3 * MS)


def test_corrupted_frames_do_nothing_and_are_told_of() -> None:
    result = run({"kind": "corruption", "message": "trip", "node": "RA"})
    assert received(result)["RA"] is None
    assert received(result)["RB"] is not None
    assert any("wrong CRC" in text for text in texts(result, "QA"))
    assert "frames hit" in texts(result, "B1")[-1]


def test_a_delay_is_added_and_duplicates_trip_once() -> None:
    base = received(run())
    late = run({"kind": "delay", "node": "RA", "delay_ms": 5.0})
    assert (received(late)["RA"] or 0) - (base["RA"] or 0) == pytest.approx(5 * MS, abs=0.3 * MS)
    twice = run({"kind": "duplication", "copies": 3})
    for relay, at in received(twice).items():
        assert abs((at or 0) - (base[relay] or 0)) < 4 * 0.27 * MS
    assert sum(text.startswith("open poles") for text in texts(twice, "QA")) == 1


def test_a_breaker_off_the_bus_hears_the_trip_when_it_is_back() -> None:
    result = run({"kind": "bus_off", "node": "QA", "start_s": 0.1, "duration_s": 0.1})
    back_ns = 200 * MS
    got = received(result)["RA"]
    assert got is not None
    # the trip's repetitions are 2, 4, ... 64, 128 ms apart: the next one is within 128 ms
    assert back_ns < got <= back_ns + 128 * MS


def test_a_relay_that_restarted_trips_like_one_that_did_not() -> None:
    restart = {"kind": "restart", "node": "RA", "start_s": 0.04, "duration_s": 0.01}
    quiet = run(restart, data=QUIET)
    assert not quiet.trips
    rows = quiet.samples("RA")["t_ns"]
    gap = rows[1:][(rows[1:] - rows[:-1]) > MS]
    assert gap.tolist() == [50 * MS]  # no samples while it was away, and none twice
    tripped, base = run(restart), run()
    assert [(t.relay, t.loop, t.zone) for t in tripped.trips] == [("RA", "AG", 1), ("RB", "AG", 1)]
    assert abs((received(tripped)["RA"] or 0) - (received(base)["RA"] or 0)) < 1 * MS


def test_a_relay_that_restarts_after_its_trip_takes_nothing_back() -> None:
    result = run({"kind": "restart", "node": "RA", "start_s": 0.115})
    assert received(result)["RA"] == received(run())["RA"]
    assert result.trips[0].opened_ns is not None
    assert texts(result, "B1") == ["B1: restart of RA begins", "B1: restart of RA is over"]


def test_a_breaker_that_restarted_knows_its_poles_and_waits_for_a_second_frame() -> None:
    restart = {"kind": "restart", "node": "QA", "start_s": 0.05, "duration_s": 0.02}
    result = run(restart, data=QUIET)
    assert not any("poles" in text for text in texts(result, "QA"))
    # it has heard nothing of RA since, so one frame does not open it: the repetition 2 ms later does
    later_ns = (received(run(restart))["RA"] or 0) - (received(run())["RA"] or 0)
    assert later_ns == pytest.approx(2 * MS, abs=0.3 * MS)


def test_a_babbler_of_the_highest_priority_costs_a_trip_a_few_frames_at_most() -> None:
    base = received(run())
    babbled = run({"kind": "babbling", "identifier": 0, "rate_hz": 1000, "start_s": 0.05})
    assert babbled.bus_load is not None and babbled.bus_load > 0.2
    for relay, at in received(babbled).items():
        assert 0 <= (at or 0) - (base[relay] or 0) <= 2 * 270_000
    drowned = run({"kind": "babbling", "identifier": 0, "rate_hz": 10_000, "start_s": 0.05})
    assert received(drowned) == {"RA": None, "RB": None}  # the bus is full with what goes before a trip
    lowest = run({"kind": "babbling", "identifier": 0x7FF, "rate_hz": 10_000, "start_s": 0.05})
    for relay, at in received(lowest).items():
        assert 0 <= (at or 0) - (base[relay] or 0) <= 270_000


def test_errors_on_the_wire_cost_time_but_no_frame_and_bus_off_ends() -> None:
    clean = run()
    noisy = run({"kind": "bit_error", "probability": 0.2})
    assert noisy.can_frames >= clean.can_frames  # one that is hit in its last bit comes twice
    for relay, at in received(noisy).items():
        assert abs((at or 0) - (received(clean)[relay] or 0)) < 5 * 0.35 * MS
    # nothing of RA's goes through for 30 ms: bus-off after 32 tries, and again after each recovery
    # (but a frame that is hit in its very last bit, which the others have then taken: with this seed none is)
    data = AG | {"scenario": AG["scenario"] | {"seed": 2}}
    broken = run({"kind": "bit_error", "node": "RA", "start_s": 0.105, "duration_s": 0.03}, data=data)
    states = texts(broken, "RA")
    assert {"is error-passive", "is bus-off", "is error-active"} <= set(states)
    assert (received(broken)["RA"] or 0) > 135 * MS
    # RA's frames go before RB's in every arbitration, until RA is error-passive and leaves it eight bits
    passive_ns = min(e.t_ns for e in broken.events if e.source == "RA" and e.text == "is error-passive")
    decided_ns = next(trip.t_ns for trip in broken.trips if trip.relay == "RB")
    assert decided_ns == next(trip.t_ns for trip in clean.trips if trip.relay == "RB")
    assert decided_ns < passive_ns < (received(broken)["RB"] or 0) < passive_ns + 0.35 * MS


@pytest.mark.parametrize("content", ["random", "replayed"])
@pytest.mark.parametrize("message", ["trip", "close"])
def test_forged_frames_without_the_right_protection_open_nothing(content: str, message: str) -> None:
    forger = {"kind": "forging", "node": "RA", "message": message, "rate_hz": 800, "content": content}
    result = run(forger, data=QUIET)
    assert not any("poles" in text for text in texts(result, "QA"))
    assert any("refused" in text for text in texts(result, "QA"))


def test_a_forger_who_knows_the_protection_needs_a_key_too(tmp_path: Path) -> None:
    """E2E is against accidents: without keys such a forger opens the breaker, with them it does not."""
    forger = {"kind": "forging", "node": "RA", "message": "trip", "rate_hz": 200, "content": "crafted"}
    forger |= {"start_s": 0.05}
    assert any("open poles" in text for text in texts(run(forger, data=QUIET), "QA"))
    keys = tmp_path / "keys.toml"
    keys.write_text('default = "000102030405060708090a0b0c0d0e0f"\n', encoding="utf-8")
    keys.chmod(0o600)
    sealed = run(forger, data=QUIET, keys=str(keys), fd=True)
    assert not any("open poles" in text for text in texts(sealed, "QA"))
    assert any("wrong authentication tag" in text for text in texts(sealed, "QA"))


def test_faults_of_what_is_not_there_in_one_process_say_so() -> None:
    result = run({"kind": "loss", "message": "sampled_values"}, data=QUIET)
    assert "has no effect" in texts(result, "B1")[0]
