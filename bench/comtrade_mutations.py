"""Damaged COMTRADE records, thousands of them, into the reader, the selection and a relay.

    python bench/comtrade_mutations.py [CASES] [SEED]

Each is a sound record of one of the formats with one to three things changed in its .cfg or .dat: bytes,
fields (emptied, or set to what a field should never be), lines, its length.  It must be played or refused in
one line; anything else is a fault: its seed and traceback are shown, and the program ends with status 1.  The
last line tells how many were played, and the program's greatest memory.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from faultloop.errors import InputError
from faultloop.io.comtrade import AnalogChannel, Rate, Record, write_comtrade
from faultloop.io.comtrade.record import StatusChannel, times_of
from faultloop.loop.replay import replay
from faultloop.relay import RelaySettings

VARIANTS = [("1999", "ASCII", ".cfg"), ("1999", "BINARY", ".cfg"), ("2013", "BINARY32", ".cfg"),
            ("2013", "FLOAT32", ".cfg"), ("2013", "BINARY", ".cff"), ("2013", "ASCII", ".cff")]  # fmt: skip
FIELDS = ["", "0", "-1", "1", "2", "1e400", "-1e400", "inf", "nan", "1e12", "1e-6", "1e308", "9" * 20,
          "99999999", "4294967295", "A", "B", "V", "kV", "\0", "é", "999999A", "999999D", "0A", "0D", "1e5",
          "60", "BINARY", "BINARY32", "FLOAT32", "ASCII", "2013", "1991", "01/01/1900", "31/12/9999",
          "25:61:61.1234567", " " * 300]  # fmt: skip
SETTINGS = {
    "relay": {"frequency_hz": 50},
    "line": {"z1_ohm": [5.0, 30.0], "z0_ohm": [30.0, 90.0]},
    "pdis": [{"zone": 1, "reach_pu": 0.8}],
}


def sound(samples: int = 600) -> Record:
    """Half a second at 1200 Hz, a fault in it, and one rate or two."""
    rates = (Rate(1200.0, samples // 2), Rate(600.0, samples))
    t_ns = times_of(rates, np.arange(samples))
    turn = 2 * np.pi * 50 * t_ns[:, None] / 1e9 - np.radians([0, 120, 240, 20, 140, 260])
    values = np.cos(turn) * np.array([180e3] * 3 + [500.0] * 3)
    values[samples // 3 :, 0] *= 0.3
    values[samples // 3 :, 3] *= 8
    analog = [AnalogChannel(name, values[:, i], "VVVAAA"[i], name[1])
              for i, name in enumerate(("VA", "VB", "VC", "IA", "IB", "IC"))]  # fmt: skip
    status = [StatusChannel("52a", t_ns < 300e6), StatusChannel("trip", t_ns > 250e6)]
    return Record(t_ns, analog, status, rates, 10**18, 10**18, 50.0, "st", "dev")


def mutated(content: bytes, random: np.random.Generator) -> bytes:
    """The content with one thing changed."""
    kind = random.integers(8)
    place = int(random.integers(len(content) + 1))
    if kind == 0:
        return content[:place] + random.bytes(1) + content[place + 1 :]
    if kind == 1:
        return content[:place] + content[place + int(random.integers(1, 40)) :]
    if kind == 2:
        return content[:place] + random.bytes(int(random.integers(1, 20))) + content[place:]
    if kind == 3:
        return content[:place]
    lines = content.split(b"\n")
    number = int(random.integers(min(len(lines), 40)))
    if kind == 4:
        del lines[number]
    elif kind == 5:
        lines.insert(number, lines[int(random.integers(len(lines)))])
    else:
        fields = lines[number].split(b",")
        fields[int(random.integers(len(fields)))] = str(random.choice(FIELDS)).encode()
        lines[number] = b",".join(fields)
    return b"\n".join(lines)


def one(folder: Path, originals: list[dict[str, bytes]], seed: int, settings: RelaySettings) -> str:
    """Play one damaged record: "played", or "refused"; whatever else it raises goes up."""
    random = np.random.default_rng(seed)
    files = dict(originals[int(random.integers(len(originals)))])
    names = sorted(files, key=lambda name: not name.endswith("g"))  # .cfg first, and more often
    for _ in range(int(random.integers(1, 4))):
        name = names[0] if random.random() < 0.7 else names[-1]
        files[name] = mutated(files[name], random)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    try:
        replay(folder / next(name for name in files if name.endswith((".cfg", ".cff"))), settings)
    except InputError as error:
        if "\n" in str(error):
            raise ValueError(f"more than one line: {error}") from error
        return "refused"
    return "played"


def campaign(cases: int, seed: int = 0) -> Counter[str]:
    """Outcomes of so many cases; a traceback on standard error for each that is a fault."""
    settings = RelaySettings.from_dict(SETTINGS)
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        folder, originals = Path(name), []
        for revision, format, suffix in VARIANTS:
            written = write_comtrade(folder / f"sound{suffix}", sound(), revision, format)
            originals.append({path.name: path.read_bytes() for path in written})
        for case in range(cases):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error", RuntimeWarning)
                    outcomes[one(folder, originals, seed + case, settings)] += 1
            except Exception:
                print(f"seed {seed + case}", file=sys.stderr)
                traceback.print_exc()
                outcomes["fault"] += 1
    return outcomes


def peak_mb() -> float:
    """Of this program alone: getrusage counts what its parent had in memory when it started this one, too."""
    status = Path("/proc/self/status")
    if status.exists():
        fields = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return int(fields["VmHWM"].split()[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> int:
    given = [int(text) for text in sys.argv[1:]]
    cases, seed = (given + [2000, 0][len(given) :])[:2]
    outcomes = campaign(cases, seed)
    print(json.dumps({"cases": cases, **outcomes, "peak_mb": round(peak_mb())}))
    return 1 if outcomes["fault"] else 0


if __name__ == "__main__":
    sys.exit(main())
