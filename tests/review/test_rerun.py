"""A log in rerun: the line, and the zones with what polarized them at each instant, read back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import faultloop
from faultloop.cli import call
from faultloop.io.mcap_reader import Log, open_log
from faultloop.relay import RelaySettings
from faultloop.relay.quantities import FAULTS
from faultloop.review.characteristic import characteristics_at
from faultloop.review.relay_summary import line_impedance
from faultloop.review.rerun import show
from faultloop.review.retrace import retrace
from faultloop.review.rows import relay_rows
from faultloop.review.summary import summarize
from tests.review.why_cases import QUAD, fault, write

PLANE = "/relay/R1/plane"


def read(path: Path) -> dict[str, list[Any]]:
    from rerun.chunk import RrdReader

    found: dict[str, list[Any]] = {}
    for chunk in RrdReader(str(path)).stream().to_chunks():
        found.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    return found


def test_zones_move_as_the_relay_had_them(tmp_path: Path) -> None:
    zones = [{"zone": 1, "reach_pu": 0.8}, *QUAD]
    log = open_log(write(tmp_path / "a.mcap", {"pdis": zones}, fault("BC", 0.75, resistance=2.0), "BC"))
    show(log, summarize(log), str(tmp_path / "a.rrd"))
    chunks, known, rows = read(tmp_path / "a.rrd"), retrace(log, "R1"), relay_rows(log, "R1")

    (line,) = chunks[f"{PLANE}/line"]
    z1 = line_impedance(log, "R1")
    assert z1 is not None
    (strip,) = line["LineStrips2D:strips"].to_pylist()[0]
    np.testing.assert_allclose(strip, [[0, 0], [z1.real, z1.imag]], rtol=1e-6)

    moving = [batch for batch in chunks[f"{PLANE}/zone_now/PDIS1"] if "time" in batch.schema.names]
    times = np.concatenate([batch["time"].cast(pa.int64()).to_numpy() for batch in moving])
    strips = [value for batch in moving for value in batch["LineStrips2D:strips"].to_pylist()]
    assert not strips[np.argmax(times)]  # nothing is left standing when the disturbance is over
    compared = 0
    for t_ns, drawn in zip(times, strips, strict=True):
        place = np.searchsorted(known.t_ns, t_ns)
        if not drawn or FAULTS[int(known.shared["fault"][place])] != "BC":
            continue
        x = rows.phasors[np.searchsorted(rows.t_ns, t_ns)]
        there = characteristics_at(log, "R1", int(t_ns), 4, x)["PDIS1"]
        np.testing.assert_allclose(drawn[0], there, atol=1e-4 * np.abs(there).max())
        compared += 1
    assert compared > 10


def test_a_run_is_shown_as_its_log_is(root: Path, tmp_path: Path) -> None:
    file, path = tmp_path / "live.rrd", tmp_path / "live.mcap"
    scenario = root / "scenarios" / "ag-zone1.toml"  # its fault begins at an angle: when is not known before
    assert call(["run", str(scenario), "--log", str(path), "--rerun", str(file), "--json"]) == 0
    log, chunks = open_log(path), read(file)
    z1 = line_impedance(log, "RA")
    assert z1 is not None
    (line,) = chunks["/relay/RA/plane/line"]
    np.testing.assert_allclose(
        line["LineStrips2D:strips"].to_pylist()[0][0][1], [z1.real, z1.imag], rtol=1e-6
    )

    zero = log.faults[0].t_ns
    batch = next(one for one in reversed(chunks["/relay/RA/voltage"]) if "time" in one.schema.names)
    times = {key: batch[key].cast(pa.int64()).to_numpy() for key in ("time", "from fault")}
    np.testing.assert_array_equal(times["time"] - times["from fault"], zero)
    texts = [
        text
        for batch in chunks["/events"]
        if "TextLog:text" in batch.schema.names
        for row in batch["TextLog:text"].to_pylist()
        for text in row
        if "RA: trip" in text
    ]
    assert len(texts) == 1

    assert compared_zones(log, "RA", chunks, loop=0) > 10


@pytest.mark.parametrize("from_s", [0.0, 0.0613])
def test_a_replay_is_shown_as_its_log_is(tmp_path: Path, from_s: float) -> None:
    """Where it begins within a cycle, too: the relay's estimates then have another reference than the log."""
    recorded = write(tmp_path / "a.mcap", {"pdis": [{"zone": 1, "reach_pu": 0.8}]}, fault("AG", 0.5), "AG")
    settings = RelaySettings.from_dict(json.loads(open_log(recorded).metadata["settings"]["R1"]))
    file, path = tmp_path / "live.rrd", tmp_path / "live.mcap"
    faultloop.replay(recorded, settings, log=path, rerun=str(file), from_s=from_s)
    chunks = read(file)
    assert "/relay/replay/plane/line" in chunks
    assert compared_zones(open_log(path), "replay", chunks, loop=0) > 10


def compared_zones(log: Log, relay: str, chunks: dict[str, list[Any]], loop: int) -> int:
    """How many drawn characteristics of PDIS1 were compared with what the log tells."""
    known, rows, compared = retrace(log, relay), relay_rows(log, relay), 0
    for batch in chunks[f"/relay/{relay}/plane/zone_now/PDIS1"]:
        if "time" not in batch.schema.names:
            continue
        for t_ns, drawn in zip(
            batch["time"].cast(pa.int64()).to_numpy(), batch["LineStrips2D:strips"].to_pylist(), strict=True
        ):
            row = np.searchsorted(known.t_ns, t_ns)
            fault = int(known.shared["fault"][row]) if row < len(known.t_ns) else 0
            if not drawn or FAULTS[fault] != "AG":
                continue
            x = rows.phasors[np.searchsorted(rows.t_ns, t_ns)]
            there = characteristics_at(log, relay, int(t_ns), loop, x)["PDIS1"]
            np.testing.assert_allclose(drawn[0], there, atol=1e-4 * np.abs(there).max())
            compared += 1
    return compared
