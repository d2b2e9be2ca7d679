"""Comparing two logs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.io.diff import diff_logs
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter


@pytest.fixture
def make(tmp_path: Path, make_arrays: Callable[..., Any]) -> Callable[..., Log]:
    """A log whose arrays (samples, phasors, loops, pickup, operate) ``change`` may alter before writing."""

    def build(name: str, change: Callable[..., None] | None = None, **extra: Any) -> Log:
        rows = extra.get("rows", slice(None))
        t_ns, count, *arrays = (array.copy() for array in make_arrays(600))
        if change:
            change(*arrays)
        with LogWriter(tmp_path / name, 10**18, {"settings": {"reach_pu": extra.get("reach", "0.8")}}) as log:
            log.add_relay("R1", ["PDIS1"])
            log.relay_block("R1", *(array[rows] for array in (t_ns, count, *arrays)))
            for t, zone in extra.get("trips", ((50_000_000, 1),)):
                log.message("/relay/R1/trips", t, "Trip", function="PDIS1", zone=zone, loop="AG")
            if "breaker" in extra:
                log.message("/breaker/B1", 0, "BreakerStatus", pole_a=True)
        return open_log(tmp_path / name)

    return build


def test_equal_logs(make: Callable[..., Log]) -> None:
    diff = diff_logs(make("a.mcap"), make("b.mcap"))
    assert diff.equal and not diff and diff.first is None and not diff.information


def test_first_difference_is_the_earliest(make: Callable[..., Log]) -> None:
    def change(samples: np.ndarray, phasors: np.ndarray, loops: np.ndarray, *_: np.ndarray) -> None:
        samples[300:, 2] = 7.0
        phasors[299, 13] = np.nan
        loops[400, 0] = 1.0

    a, b = make("a.mcap"), make("b.mcap", change, reach="0.9")
    value = float(a.phasors("R1")["rocof_hz_per_s"][299])
    assert np.isfinite(value)
    diff = diff_logs(a, b)
    first = diff.first
    assert first is not None
    assert (first.name, first.t_ns, first.count) == ("/relay/R1/phasors.rocof_hz_per_s", 62_291_666, 1)
    assert first.a == value and np.isnan(first.b)
    assert [found.name.rpartition("/")[2] for found in diff.fields[1:]] == ["samples.vc", "loops.ag_r"]
    assert diff.fields[1].count == 300 and diff.fields[1].compared == 600
    assert diff.information == ["metadata settings.reach_pu: 0.8 -> 0.9"]


def test_information_alone_is_no_difference(make: Callable[..., Log]) -> None:
    diff = diff_logs(make("a.mcap"), make("b.mcap", reach="0.9"))
    assert diff.equal and diff.information


def test_tolerance_and_ignore(make: Callable[..., Log]) -> None:
    def change(samples: np.ndarray, phasors: np.ndarray, *_: np.ndarray) -> None:
        samples[10, 0] = 1000.0
        samples[11, 0] = 1000.5
        phasors[5, 0] += 1.0

    def base(samples: np.ndarray, *_: np.ndarray) -> None:
        samples[10, 0] = 1000.4
        samples[11, 0] = 1001.0

    a, b = make("a.mcap", base), make("b.mcap", change)
    assert {f.name for f in diff_logs(a, b).fields} == {"/relay/R1/samples.va", "/relay/R1/phasors.va_re"}
    assert diff_logs(a, b, ignore=["va_re"], tolerances={"va": 0.5}).equal
    assert diff_logs(a, b, ignore=["/relay/*/phasors.*"], tolerances={"/relay/R1/samples.v?": 0.5}).equal
    (only,) = diff_logs(a, b, ignore=["va_re"], tolerances={"va": 0.45}).fields
    assert (only.count, only.largest) == (1, 0.5)


def test_missing_messages_and_topics(make: Callable[..., Log]) -> None:
    a = make("a.mcap", trips=((50_000_000, 1), (50_000_000, 2), (90_000_000, 2)))
    b = make("b.mcap", rows=slice(0, 500), trips=((50_000_000, 1), (90_000_000, 3)), breaker=True)
    diff = diff_logs(a, b)
    assert diff.topics == [("/breaker/B1", "b")]
    found = {f.name.removeprefix("/relay/R1/"): f for f in diff.fields}
    assert set(found) == {f"{t}.(message)" for t in ("samples", "phasors", "loops", "elements", "trips")} | {
        "trips.zone"
    }
    assert (found["samples.(message)"].count, found["samples.(message)"].t_ns) == (100, 500 * 10**9 // 4800)
    assert found["samples.(message)"].a == "message" and found["samples.(message)"].b is None
    assert (found["trips.(message)"].count, found["trips.(message)"].t_ns) == (1, 50_000_000)
    assert (found["trips.zone"].t_ns, found["trips.zone"].a, found["trips.zone"].b) == (90_000_000, 2, 3)
    assert diff_logs(a, b, ignore=["(message)", "zone"]).equal


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"ignore": ["va_rre"]}, "did you mean 'va_re'"),
        ({"ignore": ["/relay/R1/samples.vx"]}, "no message has a field"),
        ({"tolerances": {"va": float("nan")}}, "0 or more"),
        ({"tolerances": {"va": -1.0}}, "0 or more"),
    ],
)
def test_wrong_options(make: Callable[..., Log], options: dict[str, Any], says: str) -> None:
    log = make("a.mcap")
    with pytest.raises(InputError, match=says):
        diff_logs(log, log, **options)
