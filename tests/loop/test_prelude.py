"""A case that goes on from where its network stood before the first fault is the one from sample 0."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from faultloop.loop import prelude
from faultloop.loop.case import CaseOutcome, Cases
from faultloop.loop.prelude import Stand
from faultloop.loop.scenario import load_scenario

AG = Path(__file__).resolve().parents[2] / "scenarios" / "ag-zone1.toml"


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The samples before which cases began."""
    found: list[int] = []
    put_back = Stand.put_back

    def told(stand: Stand, parts: Any) -> None:
        found.append(stand.sample)
        put_back(stand, parts)

    monkeypatch.setattr(Stand, "put_back", told)
    return found


def said(outcome: CaseOutcome) -> tuple[Any, ...]:
    """All of it; NaN is not equal to itself."""
    return tuple(repr(value) for value in vars(outcome).values())


def outcome(cases: Cases, *overrides: str, texts: bool = False) -> tuple[Any, ...]:
    scenario = load_scenario(AG, ["scenario.duration_s=0.2", *overrides])
    return said(cases.prepare(scenario).run(texts=texts))


def test_cases_of_one_network_equal_those_from_sample_0(begun: list[int]) -> None:
    kinds = [
        ("fault.F1.angle_deg=0",),
        ("fault.F1.angle_deg=270", "fault.F1.type=BC"),
        ("fault.F1.angle_deg=10", "fault.F1.resistance_ohm=20", "fault.F1.duration_s=0.03"),
        ("fault.F1.after_s=0.03", "fault.F1.type=ABC"),  # before the others' place
        ("fault.F1.after_s=0.15", "scenario.duration_s=0.3"),
        ("fault.F1.angle_deg=91",),
    ]
    cases = Cases()
    together = [outcome(cases, *kind) for kind in kinds]
    assert begun and all(sample % prelude.EVERY == 0 for sample in begun)
    assert max(begun) >= 0.1 * 4800
    begun.clear()
    assert together == [outcome(Cases(), *kind) for kind in kinds]
    assert not begun


def test_lines_are_those_of_a_case_from_sample_0(begun: list[int]) -> None:
    cases = Cases()
    kinds = [(f"fault.F1.angle_deg={angle}", angle > 100) for angle in (0, 120, 40, 240, 130)]
    together = [outcome(cases, kind, texts=texts) for kind, texts in kinds]
    assert len(begun) >= 1
    assert together == [outcome(Cases(), kind, texts=texts) for kind, texts in kinds]


def test_a_trip_before_the_fault_is_told_in_every_case(begun: list[int]) -> None:
    """Systems that slip against each other trip a relay before the fault: every case begins at sample 0."""
    slip = ("source.SB.frequency_hz=55", "fault.F1.after_s=0.25", "scenario.duration_s=0.3")
    kinds = [(*slip, f"fault.F1.angle_deg={angle}") for angle in (0, 120, 240)]
    cases = Cases()
    together = [cases.prepare(load_scenario(AG, kind)).run(texts=False) for kind in kinds]
    assert all(min(trip.t_ns for trip in case.trips) < 0.25e9 for case in together)
    assert [said(case) for case in together] == [outcome(Cases(), *kind) for kind in kinds]
    assert not begun
