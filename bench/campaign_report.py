"""What the report of a large campaign takes: time, memory, sizes.

    python bench/campaign_report.py [--cases 100000] [--run 400] [--of F.parquet] [--folder FOLDER]

`--run` cases are really run; the file of `--cases` cases has their outcomes again and again beside the values
that each case of that campaign draws: as many rows, places and shots as after a real run; what the relays did
repeats.  `--of`: the report of a file that is there.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import faultloop
from faultloop.study.campaign.parts import KEY
from faultloop.study.campaign.record import fingerprint, record_of

ROOT = Path(__file__).resolve().parents[1]
TABLES: dict[str, Any] = {
    "campaign": {"name": "Of many cases", "scenario": "weak-source.toml", "sampling": "random", "seed": 1},
    "vary": [
        {"key": "source.SA.sir", "values": [0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0]},
        {"key": "fault.F1.at_pu", "uniform": [0.02, 0.98]},
        {"key": "fault.F1.type", "values": ["AG", "BC", "BCG", "ABC"]},
        {"key": "fault.F1.angle_deg", "uniform": [0.0, 360.0]},
        {"key": "fault.F1.resistance_ohm", "log_uniform": [0.01, 10.0]},
        {"key": "scenario.duration_s", "values": [0.25]},
    ],
    "judge": [{"relay": "RA", "where": "inside", "trip": True, "zone": 1, "within_ms": 40}],
}


def campaign(cases: int) -> faultloop.Campaign:
    tables = TABLES | {"campaign": TABLES["campaign"] | {"cases": cases}}
    return faultloop.Campaign.from_dict(tables, path=ROOT / "scenarios" / "campaign.toml")


def repeated(run: int, cases: int, folder: Path) -> Path:
    """A file of `cases` rows from `run` real ones."""
    campaign(run).run(folder / "real.parquet", workers=2)
    real, large = pq.read_table(folder / "real.parquet"), campaign(cases)
    table = real.take(np.arange(cases) % run)
    drawn = [large.plan.values(number) for number in range(cases)]
    own: dict[str, Any] = {"case": range(cases)} | {
        key: [values[key] for values in drawn] for key in large.plan.keys
    }
    for name, values in own.items():
        place = table.schema.get_field_index(name)
        table = table.set_column(
            place, table.schema.field(name), pa.array(values, table.schema.field(name).type)
        )
    record = record_of(large.plan)
    text = json.dumps(record | {"fingerprint": fingerprint(record)})
    path = folder / "large.parquet"
    pq.write_table(table.replace_schema_metadata({KEY: text}), path, compression="zstd")
    return path


def report(file: Path, folder: Path, *options: str) -> None:
    command = [sys.executable, "-m", "faultloop", "campaign-report", str(file), *options]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=folder)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    sizes = [f"{o} {(folder / o).stat().st_size / 1e6:.1f} MB" for o in options if (folder / o).is_file()]
    told = f"{' '.join(options) or 'text':36} {wall:6.1f} s, {cpu:5.1f} s of CPU"
    print(f"{told}, at most {after.ru_maxrss / 1e3:.0f} MB {', '.join(sizes)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--run", type=int, default=400)
    parser.add_argument("--of", type=Path)
    parser.add_argument("--folder", type=Path, help="folder for the file, page and picture")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = (options.folder or Path(name)).absolute()
        folder.mkdir(exist_ok=True)
        file = options.of or repeated(options.run, options.cases, folder)
        rows = pq.read_metadata(file).num_rows
        print(f"{rows} rows, {file.stat().st_size / 1e6:.1f} MB")
        for outputs in (
            (),
            ("--json",),
            ("--html", "r.html"),
            ("--png", "r.png"),
            ("--html", "r.html", "--png", "r.png"),
        ):
            report(file.absolute(), folder, *outputs)


if __name__ == "__main__":
    main()
