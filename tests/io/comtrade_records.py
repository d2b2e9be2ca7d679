"""A small record of a line's six channels, in whatever form a test wants it."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

HZ, SAMPLES = 2400, 1200
NAMES = ("VA", "VB", "VC", "IA", "IB", "IC")
PHASES = tuple("ABCABC")
UNITS = ("V",) * 3 + ("A",) * 3
SCALE = {"ASCII": 4.0, "BINARY": 8.0, "BINARY32": 1e-4, "FLOAT32": 1.0}
WIDTH = {"BINARY": "h", "BINARY32": "i", "FLOAT32": "f"}


def signals(samples: int = SAMPLES, hz: float = HZ) -> np.ndarray:
    """Healthy 220 kV and 400 A at 50 Hz, (samples, 6)."""
    t = np.arange(samples)[:, None] / hz
    lag = np.radians([0, 120, 240, 20, 140, 260])
    peak = np.array([220e3 * np.sqrt(2 / 3)] * 3 + [400 * np.sqrt(2)] * 3)
    return peak * np.cos(2 * np.pi * 50 * t - lag)


def config_text(
    format: str = "ASCII",
    revision: str = "1999",
    *,
    names: tuple[str, ...] = NAMES,
    phases: tuple[str, ...] = PHASES,
    units: tuple[str, ...] = UNITS,
    tails: tuple[str, ...] = ("-99999,99999,1,1,P",) * 6,
    status: int = 2,
    lf: str = "50",
    rates: str = f"1\n{HZ},{SAMPLES}",
    times: tuple[str, str] = ("25/11/2026,10:00:00.000000", "25/11/2026,10:00:00.200000"),
) -> str:
    lines = [f"TEST ST,DEV1,{revision}", f"{len(names) + status},{len(names)}A,{status}D"]
    for i, (name, phase, unit, tail) in enumerate(zip(names, phases, units, tails, strict=True)):
        lines.append(f"{i + 1},{name},{phase},,{unit},{SCALE[format]},0,0,{tail}")
    lines += [f"{i + 1},ST{i + 1},,,0" for i in range(status)]
    return "\n".join([*lines, lf, rates, *times, format, "1"]) + "\n"


def data_bytes(
    format: str = "ASCII",
    values: np.ndarray | None = None,
    *,
    status_words: int = 1,
    stamps: np.ndarray | None = None,
    numbers: np.ndarray | None = None,
) -> bytes:
    values = signals() if values is None else values
    raw = values / SCALE[format]
    counts = np.arange(1, len(raw) + 1) if numbers is None else numbers
    stamps = np.rint(np.arange(len(raw)) * 1e6 / HZ).astype(int) if stamps is None else stamps
    if format == "ASCII":
        rows = [
            f"{n},{s}," + ",".join(str(round(x)) for x in row) + ",0" * (2 * status_words)
            for n, s, row in zip(counts.tolist(), stamps.tolist(), raw, strict=True)
        ]
        return ("\r\n".join(rows) + "\r\n").encode()
    own = raw if format == "FLOAT32" else np.rint(raw).astype(int)
    return b"".join(
        struct.pack(f"<II{len(row)}{WIDTH[format]}{status_words}H", n, s % 2**32, *row, *([0] * status_words))
        for n, s, row in zip(counts.tolist(), stamps.tolist(), own.tolist(), strict=True)
    )


def write(folder: Path, config: str | bytes, data: bytes) -> Path:
    (folder / "r.dat").write_bytes(data)
    (folder / "r.cfg").write_bytes(config if isinstance(config, bytes) else config.encode("utf-8"))
    return folder / "r.cfg"
