"""Why a zone did not operate, by what it saw at each sample."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import faultloop
from faultloop.config.toml_text import toml_text
from faultloop.io.mcap_reader import open_log
from faultloop.relay.explain import SHARED, ZONE
from faultloop.relay.functions.lphd import CURRENT, MISSING, READY, VANISHED
from faultloop.relay.layout import constants, instances
from faultloop.relay.settings import RelaySettings
from faultloop.review.retrace import retrace
from faultloop.review.summary import summarize
from faultloop.review.why import at_instant, why
from faultloop.review.why_zone import Zone, judge_zone
from tests.load import load
from tests.relay.functions.kernel import GIVEN

NAN = float("nan")


@pytest.mark.parametrize(
    ("m", "alone", "delay_ms", "cause"),
    [
        (-1.2, NAN, 0.0, "direction"),
        (-0.4, NAN, 0.0, "not-settled"),
        (-1.2, NAN, 300.0, "not-settled"),
        (1.2, NAN, 0.0, "reach"),
        (1.2, 0.7, 0.0, "not-settled"),
    ],
)
def test_a_zone_without_delay_does_not_start_for_what_is_far_behind(
    m: float, alone: float, delay_ms: float, cause: str
) -> None:
    """Released, forward, and inside by memory; with a delay, or less far, it may start, and where the samples
    alone say inside."""
    verdict = judge_zone(made(m, alone, delay_ms))
    assert verdict.cause == cause
    assert ("behind the relay" in verdict.text) == (cause == "direction")
    assert ("by the samples alone" in verdict.text) == (alone == 0.7)


@pytest.mark.parametrize(
    ("lphd", "words"), [(READY, "nothing happened"), (MISSING, "voltages cannot be relied on"),
                        (CURRENT, "current of a phase is missing"), (VANISHED, "all currents went")]
)  # fmt: skip
def test_a_relay_that_is_blind_does_not_say_that_nothing_happened(lphd: int, words: str) -> None:
    verdict = judge_zone(made(0.5, NAN, 0.0, unmeasured=0b111111, cause=lphd))
    assert words in verdict.text
    assert verdict.cause == ("quiet" if lphd == READY else "blocked")


def made(m: float, alone: float, delay_ms: float, **more: int) -> Zone:
    """A zone at an A-G fault ahead, 20 samples long."""
    pdis = [{"zone": 1, "reach_pu": 0.8, "delay_ms": delay_ms}]
    settings = RelaySettings.from_dict(GIVEN | {"pdis": pdis})
    shared, zones = np.zeros(20, SHARED), np.zeros((20, 1), ZONE)
    on = dict.fromkeys(("ready", "disturbed", "fed", "fault", "released", "direction"), 1)
    for key, value in (on | more).items():
        shared[key] = value
    zones["m"], zones["x"], zones["uncharged"], zones["alone"] = m, m, m, alone
    zones["current"], zones["residual"] = 2.0, 2.0
    known: Any = SimpleNamespace(
        settings=settings, shared=shared, zones=zones, t_ns=np.arange(20),
        constants=constants(settings, 96, instances(settings))[0],
    )  # fmt: skip
    facts: Any = SimpleNamespace(known=known, rows=np.arange(20), one=SimpleNamespace(number=0), zero=0)
    return Zone(facts, "AG")


def logged(folder: Path, seed: int, number: int, fault: int, kind: str, *own: str) -> tuple[dict, Path]:
    """A case of bench/security.py and its log; ``own``: the susceptances that the relays are told."""
    cases = load("bench/security_cases.py")
    case = cases.another(cases.draw(seed, number, kind), fault)
    line, length = case["line"], case["length"]
    z1, z0 = ([line[f"{part}{n}_ohm_per_km"] * length for part in "rx"] for n in (1, 0))
    settings = RelaySettings.from_dict(
        {
            "relay": {"frequency_hz": case["f0"], "nominal_kv": case["kv"]},
            "vt": {"kind": "ideal"},
            "line": {"z1_ohm": z1, "z0_ohm": z0}
            | {f"{key}_us": line[f"{key}_us_per_km"] * length for key in own},
            "pdis": [{"zone": 1, "reach_pu": 0.8}],
        }
    )
    path = folder / "case.toml"
    path.write_text(toml_text(cases.tables(case, 1500.0, 4) | {"fault": [cases.fault(case)]}))
    faultloop.run(path, settings={"RA": settings, "RB": settings}, log=folder / "case.mcap")
    return case, folder / "case.mcap"


def test_a_zone_that_the_charging_keeps_says_so(tmp_path: Path) -> None:
    """A-G at the far bus of 395 km: by R and X inside, and not by its resistance outside."""
    _, path = logged(tmp_path, 97002, 1708, 16, "long", "b1", "b0")
    log = open_log(path)
    (reason,) = why(log, summarize(log), "RA", "PDIS1")
    assert (reason.cause, reason.operated) == ("reach", False)
    assert reason.m is not None and reason.m > 1.0
    assert "with the line's charging, b1_us and b0_us (0.8" in reason.text
    assert retrace(log, "RA").differs is None


def test_a_zone_that_started_by_the_samples_alone_tells_their_depth(tmp_path: Path) -> None:
    """147 km at 0.581 behind 4 times the line: by its phasors, which ring, it was outside as it started."""
    case, path = logged(tmp_path, 91001, 18251, 17, "mixed")
    log = open_log(path)
    summary = summarize(log)
    (reason,) = why(log, summary, "RB", "PDIS1")
    assert retrace(log, "RB").differs is None
    assert reason.operated and reason.m == pytest.approx((1 - case["at"]) / 0.8, abs=0.02)
    assert "of reach by the samples alone (" in reason.text
    at_ms = (reason.t_ns - summary.inception.zero_ns) / 1e6
    told = [at_instant(log, summary, "RB", at_ms - 0.2 * k)["zones"][0] for k in range(10)]
    assert told[0]["m_by_samples"] == reason.m
    assert any(one["text"].startswith("inside by the samples alone (0.7") for one in told[1:])
    assert at_instant(log, summary, "RA", at_ms)["zones"][0]["m_by_samples"] is None
