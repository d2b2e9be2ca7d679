"""Reading COMTRADE beside the `comtrade` package: a long ASCII and a long binary record.

    python bench/comtrade_files.py [MEGABYTES]

Prints seconds for each, and the ratio.  Both read the same files, the package into NumPy arrays of float64.
"""

from __future__ import annotations

import sys
import tempfile
import time
import warnings
from pathlib import Path

import comtrade
import numpy as np

from faultloop.io.comtrade import AnalogChannel, Rate, Record, StatusChannel, read_comtrade, write_comtrade

CHANNELS, BITS = 12, 32


def record_of(samples: int) -> Record:
    rng = np.random.default_rng(1)
    t_ns = np.arange(samples) * 1_000_000_000 // 4800
    return Record(
        t_ns,
        [AnalogChannel(f"ch{i}", rng.normal(0, 1000, samples), "V") for i in range(CHANNELS)],
        [StatusChannel(f"bit{i}", rng.random(samples) < 0.5) for i in range(BITS)],
        (Rate(4800.0, samples),),
    )


def with_the_package(path: Path) -> comtrade.Comtrade:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return comtrade.load(str(path), use_numpy_arrays=True, use_double_precision=True)


def main(megabytes: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for format, row_bytes in (("ASCII", 150), ("BINARY", 8 + 2 * CHANNELS + BITS // 8)):
            path = Path(folder) / f"{format}.cfg"
            record = record_of(int(megabytes * 1e6 / row_bytes))
            started = time.perf_counter()
            write_comtrade(path, record, "2013", format)
            wrote = time.perf_counter() - started
            started = time.perf_counter()
            ours = read_comtrade(path)
            read = time.perf_counter() - started
            started = time.perf_counter()
            theirs = with_the_package(path)
            package = time.perf_counter() - started
            same = all(np.array_equal(a.values, b) for a, b in zip(ours.analog, theirs.analog, strict=True))
            size = path.with_suffix(".dat").stat().st_size / 1e6
            print(
                f"{format:7} {size:5.0f} MB, {len(ours)} samples: read {read:.2f} s, package {package:.2f} s "
                f"({package / read:.1f} times), written in {wrote:.2f} s, the same numbers: {same}"
            )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 68.0)
