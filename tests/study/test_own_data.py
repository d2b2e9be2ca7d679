"""A user's own CSV and COMTRADE through the papers' filters: the docs' examples, and what is refused."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.io.comtrade import AnalogChannel, Rate, Record, write_comtrade
from faultloop.study.own_data import disturbances, read_series, synchrophasors
from faultloop.study.papers.ckmc.cases import CKF, FRAMES_PER_S, Q, R, gaussian, mcc, plan
from faultloop.study.papers.ckmc.generator import Generator, track_generator


def write_csv(path: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = np.column_stack(list(columns.values()))
    path.write_text(
        "\n".join([",".join(columns), *(",".join(f"{v:.9g}" for v in row) for row in rows)]) + "\n"
    )
    return path


def three_phases(t, frequency_hz, rms):
    lags = np.array([0.0, 1.0, -1.0]) * 2 * np.pi / 3
    return rms * np.sqrt(2) * np.cos(2 * np.pi * frequency_hz * t[:, None] - lags + 0.4)


def voltages(folder: Path) -> Path:
    """COMTRADE, 49.6 Hz."""
    t = np.arange(2400) / 4800
    values = three_phases(t, 49.6, 63.5e3)
    channels = [AnalogChannel(name, values[:, k].copy(), "V") for k, name in enumerate(("VA", "VB", "VC"))]
    t_ns = np.arange(2400) * 1_000_000_000 // 4800
    record = Record(t_ns, channels, rates=(Rate(4800.0, 2400),), frequency_hz=50.0)
    write_comtrade(folder / "voltages.cfg", record, format="FLOAT32")
    return folder / "voltages.cfg"


def sag(folder: Path) -> Path:
    """CSV in kV, from 10 s on: to a half at 10.1 s."""
    t = 10 + np.arange(1280) / 6400
    noise = 0.2 * np.random.default_rng(1).normal(size=len(t))
    v = 90 * np.where(t < 10.1, 1.0, 0.5) * np.sin(2 * np.pi * 50 * t + 0.7) + noise
    return write_csv(folder / "sag.csv", {"t": t, "va": v})


def generator(folder: Path) -> tuple[Path, np.ndarray]:
    """CSV of the paper's generator 2, and the true states."""
    what = plan()
    z = what.measurements + gaussian(R)(np.random.default_rng(2), what.states.shape)[0]
    u = dict(zip(("tm", "ufd", "ir", "ii"), what.inputs[:, 8:].T, strict=True))
    measured = dict(zip(("delta", "omega", "er", "ei"), z.T, strict=True))
    return write_csv(folder / "generator.csv", {"t": what.swing.t, **u, **measured}), what.states


def examples(root: Path) -> list[str]:
    section = (root / "docs" / "estimators.md").read_text().split("## Data of your own")[1].split("\n## ")[0]
    return re.findall(r"```python\n(.*?)```", section, re.DOTALL)


def test_the_examples_of_the_docs_run(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each in five lines and its imports, on files of the names that it takes."""
    voltages(tmp_path), sag(tmp_path)
    _, states = generator(tmp_path)
    monkeypatch.chdir(tmp_path)
    found: dict[str, object] = {}
    texts = examples(root)
    assert len(texts) == 3
    for text in texts:
        lines = [line for line in text.splitlines() if line and not line.startswith("from ")]
        assert len(lines) <= 5
        exec(compile(text, "docs/estimators.md", "exec"), found)
    phasors = found["found"]
    assert phasors.frequency_hz[-1] == pytest.approx(49.6, abs=1e-3)
    assert np.abs(phasors.phasors[-1]) == pytest.approx(63.5e3, rel=1e-4)
    turned = np.angle(phasors.phasors[-1, 0] * np.exp(-1j * (0.4 - 2 * np.pi * 0.4 * phasors.t_s[-1])))
    assert turned == pytest.approx(0.0, abs=1e-3)  # at the time that the row says
    events = found["events"]
    inside = events.starts_s[events.starts_s > 10.05]
    assert inside[0] == pytest.approx(10.1, abs=3 / 6400)
    assert events.amplitudes[-1, 0] == pytest.approx(45.0, rel=0.03)
    assert events.frequency_hz[-1] == pytest.approx(50.0, abs=0.5)
    error = found["states"] - states
    assert np.sqrt((error[200:] ** 2).mean(axis=0)) == pytest.approx(np.zeros(4), abs=0.01)


def test_csv_and_comtrade_are_the_same(tmp_path: Path) -> None:
    comtrade = read_series(voltages(tmp_path))
    named = dict(zip(comtrade.names, comtrade.values.T, strict=True))
    csv = read_series(write_csv(tmp_path / "v.csv", {"Time": comtrade.t_s, **named}))
    assert csv.names == comtrade.names and csv.sampling_hz == comtrade.sampling_hz == 4800.0
    a, b = (
        synchrophasors(s, ("VA", "VB", "VC"), "taylor-kalman", frequency_hz=50.0) for s in (csv, comtrade)
    )
    np.testing.assert_allclose(a.phasors, b.phasors, atol=1.0)
    one = synchrophasors(comtrade, ["VA"], "taylor-kalman", frequency_hz=50.0)
    assert one.phasors.shape == (2400, 1)
    assert one.frequency_hz[-1] == pytest.approx(49.6, abs=1e-3)


def test_every_filter_runs_on_a_generator(tmp_path: Path) -> None:
    """From the first frame's own voltage and current, and at another start that is forgotten."""
    path, states = generator(tmp_path)
    series = read_series(path)
    assert series.sampling_hz == FRAMES_PER_S
    constants = Generator(30.3, 0.295, 0.282, 0.0697, 0.17, 6.56, 1.5, damping=2 * 30.3)
    for by in (CKF, mcc(10.0)):
        found = track_generator(series, constants, by, q=Q, r=R)
        assert np.abs(found[0] - states[0]).max() < 0.02
        assert np.sqrt(((found - states)[200:] ** 2).mean()) < 0.005
    wrong = track_generator(series, constants, start=states[0] + [0.0, 0.0, 0.05, 0.0])
    assert np.abs(wrong[-1] - states[-1]).max() < 0.02


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a first row of names"),
        ("va,vb\n1,2\n", "one of them a time in seconds"),
        ("t,va\n0,1\n", "at least two samples"),
        ("t,va\n0,1\n0.1,x\n", "line 3, va: 'x' is no number"),
        ("t,va\n0,1\n0.1\n", "line 3: 1 cells, but 2 names"),
        ("t,va\n0,1\n0.1,2\n0.5,3\n", "not evenly spaced"),
        ("t,va\n1,1\n0.5,2\n0,3\n", "do not rise"),
    ],
)
def test_a_bad_csv_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_series(path)
    assert "\n" not in str(caught.value) and "bad.csv" in str(caught.value)


def test_what_a_filter_cannot_take_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_series(tmp_path / "none.csv")
    series = read_series(sag(tmp_path))
    with pytest.raises(InputError, match="did you mean 'va'"):
        synchrophasors(series, ["vb"], "p-class", frequency_hz=50.0)
    with pytest.raises(InputError, match="did you mean 'MSTUKF'"):
        disturbances(series, "va", "MSTUK", frequency_hz=50.0)
    with pytest.raises(InputError, match="16 are needed"):
        disturbances(series, "va", frequency_hz=500.0)
    with pytest.raises(InputError, match="no column 'tm'"):
        track_generator(series, Generator(30.3, 0.295, 0.282, 0.0697, 0.17, 6.56, 1.5))
    with pytest.raises(InputError, match="xd: -1 should be positive"):
        Generator(30.3, -1, 0.282, 0.0697, 0.17, 6.56, 1.5).parameters(0.02)
    with pytest.raises(InputError, match="too few for a time constant"):
        Generator(30.3, 0.295, 0.282, 0.0697, 0.17, 6.56, 0.03).parameters(0.02)


def comtrade(folder: Path, names: list[str], values: np.ndarray, rate: float, unit: str = "V") -> Path:
    channels = [AnalogChannel(name, values[:, k].copy(), unit) for k, name in enumerate(names)]
    t_ns = np.round(np.arange(len(values)) * 1e9 / rate).astype(np.int64)
    record = Record(t_ns, channels, rates=(Rate(rate, len(values)),), frequency_hz=50.0)
    write_comtrade(folder / "own.cfg", record, format="FLOAT32")
    return folder / "own.cfg"


def test_disturbances_of_a_comtrade_are_those_of_the_csv(tmp_path: Path) -> None:
    csv = read_series(sag(tmp_path))
    record = read_series(comtrade(tmp_path, ["va"], csv.values, 6400.0))
    a, b = (disturbances(series, "va", "STF", frequency_hz=50.0) for series in (csv, record))
    np.testing.assert_allclose(a.amplitudes[-400:], b.amplitudes[-400:], atol=0.05)
    np.testing.assert_allclose(a.starts_s[:3] - 10.0, b.starts_s[:3], atol=2e-4)


def test_a_generator_from_comtrade(tmp_path: Path) -> None:
    path, states = generator(tmp_path)
    csv = read_series(path)
    record = read_series(comtrade(tmp_path, list(csv.names), csv.values, FRAMES_PER_S, ""))
    constants = Generator(30.3, 0.295, 0.282, 0.0697, 0.17, 6.56, 1.5, damping=2 * 30.3)
    found = track_generator(record, constants, mcc(10.0))
    assert np.sqrt(((found - states)[200:] ** 2).mean()) < 0.005


def test_a_comtrade_without_voltages(tmp_path: Path) -> None:
    """Its currents are phasors too; a voltage that is not there is named."""
    t = np.arange(2400) / 4800
    record = read_series(comtrade(tmp_path, ["IA", "IB", "IC"], three_phases(t, 50.0, 400.0), 4800.0, "A"))
    with pytest.raises(InputError, match=r"own\.cfg: no column 'VA'"):
        synchrophasors(record, ["VA"], frequency_hz=50.0)
    found = synchrophasors(record, ["IA", "IB", "IC"], frequency_hz=50.0)
    assert np.abs(found.phasors[-1]) == pytest.approx(400.0, rel=1e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"t,va,va\n0,1,2\n0.1,2,3\n", "'va' stands twice"),
        (b"t,va\n0,1\n0.1,\x00\n", "is no number|cannot be read"),
        (b"\xff\xfet\x00,\x00", "cannot be read as CSV"),
        (b"t,va\nnan,1\nnan,2\n", "do not rise"),
        (b"t,va\n0,1\n1,2\ninf,3\n", "not evenly spaced|do not rise"),
        (b"t;va\n0;1\n1;2\n", "a first row of names"),
        (b"t,va\n", "at least two samples"),
    ],
)
def test_more_bad_csvs(tmp_path: Path, text: bytes, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_bytes(text)
    with pytest.raises(InputError, match=message) as caught:
        read_series(path)
    assert "\n" not in str(caught.value)


def test_what_is_missing_or_no_number_in_a_record(tmp_path: Path) -> None:
    (tmp_path / "bare.csv").write_text("t\n0\n1\n")
    with pytest.raises(InputError, match="no column 'va': it has none"):
        read_series(tmp_path / "bare.csv").column("va")
    gap = write_csv(tmp_path / "gap.csv", {"t": np.arange(800) / 4800, "va": np.full(800, np.nan)})
    with pytest.raises(InputError, match="not a number somewhere"):
        disturbances(read_series(gap), "va", frequency_hz=50.0)
    assert np.isnan(synchrophasors(read_series(gap), ["va"], frequency_hz=50.0).frequency_hz).all()
    series = read_series(sag(tmp_path))
    for wrong in (
        {"frequency_hz": 0.0},
        {"frequency_hz": math.nan},
        {"frequency_hz": 50.0, "softening": -1.0},
    ):
        with pytest.raises(InputError, match="should be positive"):
            disturbances(series, "va", **wrong)
    with pytest.raises(InputError):
        synchrophasors(series, ["va"], frequency_hz=0.0)
    constants = Generator(30.3, 0.295, 0.282, 0.0697, 0.17, 6.56, 1.5)
    measured = read_series(generator(tmp_path)[0])
    for key in ("q", "r", "start"):
        with pytest.raises(InputError, match=f"{key}: should be four numbers"):
            track_generator(measured, constants, **{key: np.ones(3)})
