"""A small classifier of the fault's type from a campaign's waves, beside the relay's own phase selection.

    pip install 'faultloop[learn]'
    faultloop campaign campaigns/fault-type.toml --keep samples --out fault-type.parquet
    python examples/fault_type.py fault-type.parquet

It sees a cycle after the fault began and one before, and is told when that was; the relay has to find out.
"""

import sys
from pathlib import Path

import numpy as np
import pyarrow.dataset as ds
from sklearn.neural_network import MLPClassifier

RELAY, SAMPLING_HZ, CYCLE = "RA", 4800, 96
TYPE, LOOP, WAVES = "fault.F1.type", f"{RELAY}.loop", f"{RELAY}.samples"
TYPES = ["AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC"]
EPOCHS = 60


def batches(folder: Path):
    """Types, loops of the relay's trip, features and whether held out: 256 cases at a time, from the disk."""
    rows = ds.dataset(folder).to_batches(
        columns=["case", "fault_ns", TYPE, LOOP, WAVES], filter=ds.field("error").is_null(), batch_size=256
    )
    for batch in rows:
        if len(batch):
            waves = batch[WAVES].flatten().to_numpy().reshape(len(batch), -1, 6)
            held_out = batch["case"].to_numpy() % 5 == 0
            seen = features(waves, batch["fault_ns"].to_numpy() * SAMPLING_HZ // 1_000_000_000)
            yield np.array(batch[TYPE].to_pylist()), batch[LOOP].to_pylist(), seen, held_out


def features(waves: np.ndarray, begins: np.ndarray) -> np.ndarray:
    """What the fault changed within a cycle: RMS of the phases, their differences and their sum."""
    window = begins[:, None] + np.arange(-CYCLE, CYCLE)
    near = waves[np.arange(len(waves))[:, None], window].astype(np.float64)
    change = near[:, CYCLE:] - near[:, :CYCLE]
    parts = []
    for three in (change[..., :3], change[..., 3:]):
        all_ = np.concatenate([three, three - np.roll(three, -1, 2), three.sum(2, keepdims=True)], 2)
        rms = np.sqrt(np.mean(all_**2, axis=1))
        parts.append(rms / rms[:, :3].max(axis=1, keepdims=True))
    return np.hstack(parts)


def phases(kind: str | None) -> str | None:
    """BC for BC and BCG, which a relay's loops do not tell apart; AG, ABC and None (no trip) as they are."""
    return kind.removesuffix("G") if kind and len(kind) > 2 else kind


def main(file: str) -> dict[str, float]:
    folder = Path(file).with_suffix(".waves")
    model = MLPClassifier((32,), learning_rate_init=0.01, random_state=1)
    for _ in range(EPOCHS):
        for kinds, _, seen, held_out in batches(folder):
            if not held_out.all():
                model.partial_fit(seen[~held_out], kinds[~held_out], classes=TYPES)
    asked, types, own, relay = 0, 0, 0, 0
    for kinds, loops, seen, held_out in batches(folder):
        which = np.flatnonzero(held_out)
        for case, found in zip(which, model.predict(seen[which]) if len(which) else (), strict=True):
            asked += 1
            types += found == kinds[case]
            own += phases(found) == phases(kinds[case])
            relay += phases(loops[case]) == phases(kinds[case])
    print(f"{asked} cases that were held out: type {types / asked:.1%}")
    print(f"faulted phases: classifier {own / asked:.1%}, the relay's selection {relay / asked:.1%}")
    return {"asked": asked, "type": types / asked, "phases": own / asked, "relay": relay / asked}


if __name__ == "__main__":
    main(sys.argv[1])
