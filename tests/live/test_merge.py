"""Logs of several processes as one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.live.merge import merge
from tests.review.review_logs import write_log


@pytest.mark.parametrize("first", [True, False])
def test_a_log_that_has_events_of_a_relay_alone(tmp_path: Path, first: bool) -> None:
    """As of a relay's process that was killed before its first samples, and started anew."""
    whole, beside = write_log(tmp_path / "whole.mcap"), tmp_path / "beside.mcap"
    log = open_log(whole)
    with LogWriter(beside, log.start_ns) as extra:
        for k in range(3):
            extra.message(
                "/relay/R1/events", k * 1000, "foxglove.Log", name="R1", message=f"event {k}", level=2
            )
    both = [beside, whole] if first else [whole, beside]
    assert merge(both, tmp_path / "both.mcap", log.start_ns, {}, {}) == []
    merged = open_log(tmp_path / "both.mcap")
    assert merged.bits("R1") == log.bits("R1")
    np.testing.assert_array_equal(merged.samples("R1"), log.samples("R1"))
    assert len(merged.events) == len(log.events) + 3
