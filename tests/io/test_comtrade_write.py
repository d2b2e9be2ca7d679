"""What is written comes back, here and in the `comtrade` package."""

from __future__ import annotations

import warnings

import comtrade
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.errors import InputError
from faultloop.io.comtrade import AnalogChannel, Rate, Record, StatusChannel, read_comtrade, write_comtrade
from faultloop.io.comtrade.record import TimeQuality, times_of

FORMATS = ("ASCII", "BINARY", "BINARY32", "FLOAT32")
VARIANTS = [(r, f, s) for r in ("1999", "2013") for f in FORMATS for s in (".cfg", ".cff")]
STEPS = {"ASCII": 2 * 99_998, "BINARY": 2 * 32_767, "BINARY32": 2 * (2**31 - 1)}
START_NS = 1_577_836_800_000_000_000


TWO_RATES = (Rate(4800.0, 300), Rate(1200.0, 400))


def example(values: np.ndarray | None = None, rates: tuple[Rate, ...] = TWO_RATES) -> Record:
    rng = np.random.default_rng(7)
    count = rates[-1].stop
    t_ns = times_of(rates, np.arange(count))
    t = t_ns / 1e9
    va = 89_800 * np.cos(2 * np.pi * 50 * t) if values is None else values
    ia = 3000 * np.cos(2 * np.pi * 50 * t - 1.4) + 2000 * np.exp(-t / 0.05)
    gap = rng.normal(0, 5, count)
    gap[3::77] = np.nan
    return Record(
        t_ns=t_ns,
        analog=[
            AnalogChannel("VA", va, "V", "A", "L1", "P", (110_000.0, 100.0)),
            AnalogChannel("IA", ia, "A", "A", "", "S", (600.0, 5.0), 12.5e-6),
            AnalogChannel("gap Ω", gap, "kA", "N", "", "P"),
            AnalogChannel("constant", np.full(count, -230.0), "V"),
            AnalogChannel("nothing", np.full(count, np.nan), "V"),
        ],
        status=[StatusChannel(f"bit {i}", rng.random(count) < 0.5, "", "", i % 2) for i in range(19)],
        rates=rates,
        start_ns=START_NS,
        trigger_ns=START_NS + 20_000_000,
        frequency_hz=50.0,
        station="north",
        device="R1",
        time_quality=TimeQuality("-5h30", "0", "B", "3"),
    )


def tolerance(values: np.ndarray, format: str) -> float:
    largest, span = np.nanmax(np.abs(values)), np.nanmax(values) - np.nanmin(values)
    if format == "FLOAT32":
        return largest * 2.0**-24 + 1e-44
    # Half a step, and what float64 rounds in a * raw + b.
    return 0.5 * span / STEPS[format] * (1 + 1e-6) + 4 * np.finfo(float).eps * largest


@pytest.mark.parametrize(("revision", "format", "suffix"), VARIANTS)
def test_round_trip(tmp_path, revision, format, suffix):
    record = example()
    written = write_comtrade(tmp_path / f"r{suffix}", record, revision, format)
    assert sorted(tmp_path.iterdir()) == sorted(written)
    assert len(written) == (1 if suffix == ".cff" else 2)
    again = read_comtrade(tmp_path / f"r{suffix}")
    for kept in ("rates", "start_ns", "trigger_ns", "frequency_hz", "station", "device"):
        assert getattr(again, kept) == getattr(record, kept)
    assert again.revision == revision
    np.testing.assert_array_equal(again.t_ns, record.t_ns)
    for a, b in zip(record.analog, again.analog, strict=True):
        assert (a.name, a.unit, a.phase, a.circuit, a.scale, a.ratio) == (
            b.name, b.unit, b.phase, b.circuit, b.scale, b.ratio,
        )  # fmt: skip
        assert b.skew_s == pytest.approx(a.skew_s)
        np.testing.assert_array_equal(np.isnan(a.values), np.isnan(b.values))
        if not np.isnan(a.values).all():
            assert np.nanmax(np.abs(a.values - b.values)) <= tolerance(a.values, format)
    for a, b in zip(record.status, again.status, strict=True):
        assert (a.name, a.normal) == (b.name, b.normal)
        np.testing.assert_array_equal(a.values, b.values)
    if revision == "2013":
        assert again.time_quality == record.time_quality


@pytest.mark.parametrize(("revision", "format", "suffix"), VARIANTS)
def test_the_package_reads_it(tmp_path, revision, format, suffix):
    record = example()
    write_comtrade(tmp_path / f"r{suffix}", record, revision, format)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        package = comtrade.load(
            str(tmp_path / f"r{suffix}"), use_numpy_arrays=True, use_double_precision=True
        )
    assert package.rev_year == revision and package.ft == format
    assert package.total_samples == len(record) and package.trigger_time == pytest.approx(0.02)
    np.testing.assert_allclose(package.time, record.t_ns / 1e9, atol=2e-9)
    for channel, values in zip(record.analog, package.analog, strict=True):
        present = ~np.isnan(channel.values)
        if format == "FLOAT32":  # the package does not know FLOAT32's missing value, 0xFF7FFFFF, as such
            assert (values[~present] == -np.finfo(np.float32).max).all()
        else:
            assert np.isnan(values[~present]).all()
        if present.any():
            limit = tolerance(channel.values, format)
            assert np.abs(values[present] - channel.values[present]).max() <= limit
    for channel, values in zip(record.status, package.status, strict=True):
        np.testing.assert_array_equal(channel.values, values)


@settings(derandomize=True, deadline=None)
@given(
    st.lists(st.floats(-1e9, 1e9) | st.just(float("nan")), min_size=1, max_size=20).map(np.array),
    st.sampled_from(VARIANTS),
    st.integers(-3 * 10**17, 3 * 10**18),
)
def test_any_values_come_back_within_half_a_step(tmp_path_factory, values, variant, start_ns):
    revision, format, suffix = variant
    record = example(values, (Rate(1000.0, len(values)),))
    record.start_ns = start_ns if revision == "2013" else start_ns // 1000 * 1000
    path = tmp_path_factory.mktemp("any") / f"r{suffix}"
    write_comtrade(path, record, revision, format)
    again = read_comtrade(path)
    assert again.start_ns == record.start_ns
    np.testing.assert_array_equal(np.isnan(again.analog[0].values), np.isnan(values))
    if not np.isnan(values).all():
        assert np.nanmax(np.abs(again.analog[0].values - values)) <= tolerance(values, format)


def test_times_without_a_rate(tmp_path):
    record = example()
    record.rates = ()
    record.t_ns = record.t_ns + np.arange(len(record)) ** 2 * 7_000
    write_comtrade(tmp_path / "r.cfg", record)
    again = read_comtrade(tmp_path / "r.cfg")
    assert again.rates == ()
    assert np.abs(again.t_ns - record.t_ns).max() <= 500  # the stamps are of 1 us


def test_a_record_of_two_hours(tmp_path):
    """More microseconds than a stamp can count: the multiplication factor says so."""
    record = example(rates=(Rate(0.05, 400),))
    record.rates = ()
    write_comtrade(tmp_path / "r.cfg", record)
    assert np.abs(read_comtrade(tmp_path / "r.cfg").t_ns - record.t_ns).max() <= 1000
    lines = (tmp_path / "r.cfg").read_text(encoding="utf-8").splitlines()
    assert lines[-3] == "2"


def test_the_cfg_is_as_the_standard_has_it(tmp_path):
    record = example()
    write_comtrade(tmp_path / "R.CFG", record, "2013", "ASCII")
    raw = (tmp_path / "R.CFG").read_bytes()
    assert raw.count(b"\r\n") == raw.count(b"\n") == len(raw.splitlines())
    lines = raw.decode("utf-8").splitlines()
    assert lines[:2] == ["north,R1,2013", "24,5A,19D"]
    assert lines[3].endswith(",12.5,-99998,99998,600,5,S")
    assert lines[26:] == [
        "50", "2", "4800,300", "1200,400", "01/01/2020,00:00:00.000000", "01/01/2020,00:00:00.020000",
        "ASCII", "1", "-5h30,0", "B,3",
    ]  # fmt: skip
    first = (tmp_path / "R.DAT").read_bytes().split(b"\r\n")[0].split(b",")
    assert len(first) == 2 + 5 + 19 and first[:2] == [b"1", b"0"] and first[6] == b"99999"
    record.start_ns += 1
    write_comtrade(tmp_path / "r.cfg", record, "2013", "ASCII")
    lines = (tmp_path / "r.cfg").read_text(encoding="utf-8").splitlines()
    assert lines[30] == "01/01/2020,00:00:00.000000001" and lines[33] == "1000"  # stamps of 1000 ns


@pytest.mark.parametrize(
    ("name", "revision", "format", "words"),
    [
        ("r.cfg", "1991", "ASCII", "must be 1999 or 2013"),
        ("r.cfg", "2013", "BINARY64", "did you mean 'BINARY"),
        ("r.dat", "2013", "ASCII", r"must end in \.cfg or \.cff"),
        ("no/r.cfg", "2013", "ASCII", "cannot be written: No such file"),
    ],
)
def test_what_cannot_be(tmp_path, name, revision, format, words):
    with pytest.raises(InputError, match=words):
        write_comtrade(tmp_path / name, example(), revision, format)
    assert list(tmp_path.iterdir()) == []


def test_values_and_names_that_do_not_fit(tmp_path):
    record = example()
    record.analog[0].values[0] = np.inf
    with pytest.raises(InputError, match="VA: a value is infinite"):
        write_comtrade(tmp_path / "r.cfg", record)
    record.analog[0].values[0] = 1e39
    with pytest.raises(InputError, match="does not fit into FLOAT32"):
        write_comtrade(tmp_path / "r.cfg", record, "2013", "FLOAT32")
    record = example()
    record.analog[0].name = "V,A"
    with pytest.raises(InputError, match="'V,A' has a comma"):
        write_comtrade(tmp_path / "r.cfg", record)
    record = example()
    record.status[0].values = record.status[0].values[1:]
    with pytest.raises(InputError, match="bit 0: 399 values, but 400 times"):
        write_comtrade(tmp_path / "r.cfg", record)
    assert list(tmp_path.iterdir()) == []


def test_real_records_survive_being_written(records, tmp_path):
    for name in ("sel311l-c-g/1991-ascii-sel.cfg", "b-g-500kv-reclose/cfg_file.CFG"):
        record = read_comtrade(records / name)
        write_comtrade(tmp_path / "r.cff", record, "2013", "BINARY32")
        again = read_comtrade(tmp_path / "r.cff")
        np.testing.assert_array_equal(again.t_ns, record.t_ns)
        assert again.analog_names == record.analog_names
        for a, b in zip(record.analog, again.analog, strict=True):
            np.testing.assert_allclose(b.values, a.values, atol=tolerance(a.values, "BINARY32"))
