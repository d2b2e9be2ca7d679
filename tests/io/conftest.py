"""Small logs for the tests of the log's writer, readers and exports."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from faultloop.io.mcap_writer import LogWriter

START_NS = 1_577_836_800_000_000_000  # 2020-01-01T00:00:00Z
SAMPLING_HZ = 4800


def relay_arrays(rows: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """What LogWriter.relay_block takes, after the name: random, with NaN, inf, zero and extremes in it."""
    random = np.random.default_rng(seed)
    odd = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 5e-324, 1.7976931348623157e308])
    values = random.normal(scale=1e4, size=(rows, 32))
    where = random.random(values.shape) < 0.05
    values[where] = random.choice(odd, where.sum())
    count = np.arange(rows)
    t_ns = count * 1_000_000_000 // SAMPLING_HZ
    bits = random.integers(0, 2**64, size=(2, rows), dtype=np.uint64)
    return (t_ns, count, values[:, :6], values[:, 6:20], values[:, 20:], bits[0], bits[1])


def write_log(path: Path, rows: int = 1200, block: int = 100, compression: str = "", seed: int = 0) -> Path:
    """A log of two relays with every kind of message; the same bytes whatever the size of the blocks."""
    metadata = {"scenario": {"name": "test"}, "seed": {"seed": str(seed)}}
    with LogWriter(path, START_NS, metadata, {"relay.toml": "[relay]\n"}, compression) as log:
        triangle = np.array([[0.0, 0.0], [5.0, 1.0], [4.0, 9.5]])
        for name in ("R1", "R2"):
            log.add_relay(
                name, ["PDIS1", "PDIS2", "PTRC1", "RDIR1.DirFwd"], {"PDIS1": (triangle, 2 * triangle)}
            )
        arrays = {name: relay_arrays(rows, seed + place) for place, name in enumerate(("R1", "R2"))}
        log.message("/breaker/B1", 0, "BreakerStatus", pole_a=True, pole_b=True, pole_c=True)
        log.message("/plant/faults", 50_000_000, "FaultState", fault=0, on=True, type="AG")
        log.message(
            "/record/digital", 60_000_000, "RecordDigital", number=3, name="51G", on=True, normal=False
        )
        for start in range(0, rows, block):
            for name in arrays:
                log.relay_block(name, *(array[start : start + block] for array in arrays[name]))
        log.message(
            "/relay/R1/trips",
            90_000_000,
            "Trip",
            function="PDIS1",
            zone=1,
            loop="AG",
            poles=7,
            sample_count=432,
        )
        log.message(
            "/relay/R1/events", 90_000_000, "foxglove.Log", level="WARNING", message="Trip: Ü", name="R1"
        )
        log.message(
            "/can", 91_000_000, "CanFrame", id=0x010, data=bytes(range(8)), direction="tx", sender="R1"
        )
        log.message(
            "/can", 92_000_000, "CanFrame", id=0x1ABCDEFF, data=b"", extended=True, fd=True, direction="rx"
        )
    return path


@pytest.fixture(scope="session")
def log_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One small log that tests read and do not change."""
    return write_log(tmp_path_factory.mktemp("log") / "run.mcap")


@pytest.fixture(scope="session")
def make_log() -> Callable[..., Path]:
    return write_log


@pytest.fixture(scope="session")
def make_arrays() -> Callable[..., tuple[np.ndarray, ...]]:
    return relay_arrays
