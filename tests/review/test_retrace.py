"""A relay of a log that is run once more: in stretches, and with a bounded number of samples kept."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from faultloop.io import mcap_reader
from faultloop.io.mcap_reader import Log, open_log
from faultloop.review import retrace_run
from faultloop.review.characteristic import remembered
from faultloop.review.retrace import Retraced, retrace
from tests.review.why_cases import fault, write


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fault beyond the zones, which stays: there is something to explain at every sample of it."""
    return write(tmp_path_factory.mktemp("case") / "beyond.mcap", {}, fault("BC", 0.95), "BC")


def test_stretches_tell_what_the_whole_tells(case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = retrace(open_log(case), "R1")
    edges = [-mcap_reader.MOST_NS, *range(31_000_000, 400_000_000, 37_000_000), mcap_reader.MOST_NS]
    monkeypatch.setattr(Log, "windows", lambda log, size=0: list(pairwise(edges)))
    parts = retrace(open_log(case), "R1")
    assert parts.step == whole.step == 1
    assert parts.differs is None
    for key in ("t_ns", "shared", "zones"):
        assert getattr(parts, key).tobytes() == getattr(whole, key).tobytes()


def test_no_more_samples_are_kept_than_memory_is_for(case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = retrace(open_log(case), "R1")
    monkeypatch.setattr(retrace_run, "MOST", 128)
    monkeypatch.setattr(retrace_run, "FULL_S", 0.002)
    log = open_log(case)
    some = retrace(log, "R1")
    assert some.differs is None
    assert len(some.t_ns) <= 128 < len(whole.t_ns)
    assert some.step > 1
    assert any(f"one in {some.step} samples" in text for text in log.warnings)
    place = np.searchsorted(whole.t_ns, some.t_ns)
    assert (whole.t_ns[place] == some.t_ns).all()
    assert whole.shared[place].tobytes() == some.shared.tobytes()
    assert whole.zones[place].tobytes() == some.zones.tobytes()
    assert np.diff(place).max() <= some.step
    assert (place[:9] == np.arange(9)).all(), "from a change on all are kept"


def test_what_is_drawn_between_those_that_are_kept(case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole: Retraced = retrace(open_log(case), "R1")
    monkeypatch.setattr(retrace_run, "MOST", 128)
    some = retrace(open_log(case), "R1")
    t_ns = whole.t_ns
    drawn, known = remembered(some, t_ns), remembered(whole, t_ns)
    assert np.isfinite(known).all(axis=1).sum() > 200
    inside = t_ns <= some.t_ns[-1]
    assert (np.isfinite(drawn) == np.isfinite(known))[inside].mean() > 0.95, "but where one begins or ends"
    assert remembered(some, t_ns[:1] - 10**9).tolist() != drawn[:1].tolist()
    assert np.isnan(remembered(some, t_ns[:1] - 10**9)).all(), "long before there is nothing"
