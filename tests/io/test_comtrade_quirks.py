"""What real recorders leave out, add and get wrong: read right, or refused in one line."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.io.comtrade import Rate, read_comtrade
from tests.io.comtrade_records import HZ, SAMPLES, config_text, data_bytes, signals, write

STATED = Rate(float(HZ), SAMPLES)


def case(shared: Path, name: str) -> Path:
    return next(p for p in (shared / "cases" / name).iterdir() if p.suffix in (".cfg", ".cff"))


def check(path: Path) -> None:
    """All 1200 rows at 2400 Hz, and the signals that went in."""
    record = read_comtrade(path)
    assert record.stretches == (STATED,)
    for i, column in enumerate(signals().T):
        assert np.abs(record.analog[i].values - column).max() < 10


@pytest.mark.parametrize(
    "name",
    ["cff-bom", "empty-min-max", "line-voltages", "negative-stamps", "nul-padding", "ryb-phases", "stop-zero",
     "time-base-7digits", "time-base-dots", "time-not-understood", "units-amps", "infinite-value"],
)  # fmt: skip
def test_cases_that_are_read(shared: Path, name: str) -> None:
    record = read_comtrade(case(shared, f"comtrade-{name}"))
    assert record.stretches == (STATED,)
    assert record.t_ns[-1] == pytest.approx(1199 / 2400 * 1e9, abs=1000)
    known = name != "time-not-understood"
    assert (record.start_ns > 0) == known
    assert any("time of the first sample is not known" in note for note in record.notes) == (not known)
    assert sum(int(np.isnan(c.values).sum()) for c in record.analog) == (name == "infinite-value")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("binary32-called-binary", r"rows of 22 bytes .* do not fit.*of 34 bytes do .1200 .*as BINARY32"),
        ("status-word-0D", r"rows of 20 bytes .* do not fit.*rows of 22 bytes do \(1200 of them"),
    ],
)  # fmt: skip
def test_cases_that_are_refused(shared: Path, name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_comtrade(case(shared, f"comtrade-{name}"))


BINARY = ("BINARY", "BINARY32", "FLOAT32")


@pytest.mark.parametrize("told", BINARY)
@pytest.mark.parametrize("real", BINARY)
def test_one_binary_format_called_another(tmp_path: Path, told: str, real: str) -> None:
    path = write(tmp_path, config_text(told, "2013"), data_bytes(real))
    if told == real:
        check(path)
        return
    words = "as .*BINARY|no FLOAT32|no BINARY32"
    with pytest.raises(InputError, match=words):
        read_comtrade(path)
    unknown = config_text(told, "2013", rates=f"1\n{HZ},0")  # the count of rows does not help
    with pytest.raises(InputError, match=words):
        read_comtrade(write(tmp_path, unknown, data_bytes(real)))


@pytest.mark.parametrize(("status", "words"), [(0, 1), (2, 0), (2, 2), (17, 1), (33, 1), (2, 5)])
def test_status_words_that_are_not_there(tmp_path: Path, status: int, words: int) -> None:
    path = write(tmp_path, config_text("BINARY", status=status), data_bytes("BINARY", status_words=words))
    length = 20 + 2 * words
    with pytest.raises(InputError, match=rf"rows of {length} bytes do \(1200 of them"):
        read_comtrade(path)


@pytest.mark.parametrize(
    "numbers",
    [
        np.arange(SAMPLES),
        np.arange(1, SAMPLES + 1) * 5,
        np.concatenate([np.arange(1, 601), np.arange(605, 605 + 5 * 600, 5)]),
        (np.arange(SAMPLES) + 65_000) % 65_536,
        np.concatenate([np.arange(1, 601), np.arange(1, 601)]),
        np.zeros(SAMPLES, int),
        np.full(SAMPLES, 7),
        np.delete(np.arange(1, SAMPLES + 4), [30, 500, 900]),
    ],
    ids=["from 0", "by fives", "then by fives", "16 bits", "anew", "zero", "seven", "some left out"],
)
def test_rows_that_fit_are_read_however_they_are_numbered(tmp_path: Path, numbers: np.ndarray) -> None:
    path = write(tmp_path, config_text("BINARY"), data_bytes("BINARY", numbers=numbers))
    record = read_comtrade(path)
    assert len(record) == SAMPLES
    assert np.abs(record.analog[0].values - signals()[:, 0]).max() < 10


def test_rows_without_numbers_or_stamps(tmp_path: Path) -> None:
    nothing = np.zeros(SAMPLES, int)
    check(write(tmp_path, config_text("BINARY"), data_bytes("BINARY", numbers=nothing, stamps=nothing)))


@pytest.mark.parametrize("row", [3, 400, 1100, 1190])
@pytest.mark.parametrize("change", [-5, -2, 1, 7])
def test_bytes_lost_or_put_in_between(tmp_path: Path, row: int, change: int) -> None:
    """Every row after them would be garbage; with an open count nothing else tells."""
    data, place = data_bytes("BINARY"), row * 22 + 9
    changed = data[:place] + b"\7" * change + data[place + max(-change, 0) :]
    with pytest.raises(InputError, match=r"sample numbers do not count|rows of 22 bytes .* do not fit"):
        read_comtrade(write(tmp_path, config_text("BINARY", rates=f"1\n{HZ},0"), changed))


def test_random_rows_are_refused(tmp_path: Path) -> None:
    garbage = np.random.default_rng(3).bytes(22 * SAMPLES)
    with pytest.raises(InputError, match=r"r\.dat: rows of 22 bytes .* do not fit"):
        read_comtrade(write(tmp_path, config_text("BINARY"), garbage))


# -- times ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("revision", "time", "count_ns"),
    [
        ("1999", "25/11/2026,10:00:00", 1000),
        ("1999", "25/11/2026,10:00:00.0", 1000),
        ("1999", "25/11/2026,10:00:00.0000000", 1000),
        ("1999", "25/11/2026,10:00:00.000000000", 1000),
        ("1999", "25.11.2026,10:00:00", 1000),
        ("1991", "11.25.26,10:00:00.000000000", 1000),
        ("2013", "25/11/2026,10:00:00.000000", 1000),
        ("2013", "25/11/2026,10:00:00.0000000", 1000),
        ("2013", "25.11.2026,10:00:00", 1000),
        ("2013", "25/11/2026,10:00:00.000000000", 1),
        ("2013", "25/11/2026,10:00:00.000000000  ,", 1),
    ],
)
def test_what_a_stamp_counts(tmp_path: Path, revision: str, time: str, count_ns: int) -> None:
    stamps = np.rint(np.arange(SAMPLES) * 1e9 / HZ / count_ns).astype(int)
    config = config_text(revision=revision, rates=f"0\n0,{SAMPLES}", times=(time, time))
    record = read_comtrade(write(tmp_path, config, data_bytes(stamps=stamps)))
    assert record.stretches == (STATED,)
    assert np.datetime64(record.start_ns, "ns") == np.datetime64("2026-11-25T10:00:00")


@pytest.mark.parametrize(
    "time",
    ["", ",", "25/11/2026", "25/11/2026,", "25/11/2026,10:00:00 PM", "25/11/2026,10:00:18581309.000",
     "25/11/2026,10:61:00", "32/13/2026,10:00:00", "00/00/0000,00:00:00", "25/11/2026,10:00:75", "now",
     "25/11/9999,10:00:00"],
)  # fmt: skip
def test_a_time_that_is_none_is_noted(tmp_path: Path, time: str) -> None:
    record = read_comtrade(write(tmp_path, config_text(times=(time, time)), data_bytes()))
    assert record.start_ns == record.trigger_ns == 0
    assert sum("is not known" in note for note in record.notes) == 2


@pytest.mark.parametrize("format", ["ASCII", "BINARY"])
@pytest.mark.parametrize("first", [-200_000, 2**32 - 100_000, -1])
def test_stamps_below_zero_and_past_32_bits(tmp_path: Path, format: str, first: int) -> None:
    stamps = first + np.rint(np.arange(SAMPLES) * 1e6 / HZ).astype(int)
    config = config_text(format, rates=f"0\n0,{SAMPLES}")
    check(write(tmp_path, config, data_bytes(format, stamps=stamps)))


@pytest.mark.parametrize(
    "rates", [f"0\n0,{SAMPLES}", "0\n0,0", "0\n", "0\n0,1200,", f"1\n0,{SAMPLES}", "1\n,1200"]
)
def test_times_from_stamps(tmp_path: Path, rates: str) -> None:
    check(write(tmp_path, config_text(rates=rates.rstrip("\n")), data_bytes()))


def test_stamps_that_count_at_another_rate_are_noted(tmp_path: Path) -> None:
    record = read_comtrade(write(tmp_path, config_text(rates=f"1\n1200,{SAMPLES}"), data_bytes()))
    assert record.stretches == (Rate(1200.0, SAMPLES),)
    assert any("count at 2398.08 Hz, its rate line says 1200 Hz" in note for note in record.notes)


@pytest.mark.parametrize(
    ("rates", "words"),
    [
        ("1\n1e12,1200", "from 0 to 1e\\+08 hertz"),
        ("1\n1e-6,1200", "1200 samples at 1e-06 Hz would take more than 36 years"),
        ("1\ninf,1200", "must be a finite number"),
        ("1\n1e400,1200", "must be a finite number"),
        ("1\n-2400,1200", "from 0 to"),
        ("2\n2400,900\n2400,600", "each must be greater"),
        ("2\n2400,900\n2400,900\n", "cannot be understood|must be one of"),
        ("99999999\n2400,1200", "sampling rates are due and"),
        ("1\n2400,99999999", "cut off: 99999999 samples expected, 1200 found"),
        ("1\n2400,1e300", "last sample: a whole number"),
        ("1\n2400,12.5", "last sample: a whole number"),
        ("x\n2400,1200", "number of sampling rates: 'x' is no number"),
    ],
)
@pytest.mark.parametrize("format", ["ASCII", "BINARY"])
def test_rates_that_cannot_be(tmp_path: Path, rates: str, words: str, format: str) -> None:
    with pytest.raises(InputError, match=words):
        read_comtrade(write(tmp_path, config_text(format, rates=rates), data_bytes(format)))


def test_a_stretch_without_samples(tmp_path: Path) -> None:
    for rates in ("2\n9600,0\n2400,1200", "3\n9600,0\n9600,0\n2400,1200"):
        check(write(tmp_path, config_text(rates=rates), data_bytes()))
    two = read_comtrade(write(tmp_path, config_text(rates="3\n2400,600\n50,600\n1200,1200"), data_bytes()))
    assert two.rates == (Rate(2400.0, 600), Rate(1200.0, SAMPLES)) and two.t_ns[0] == 0


def test_stops_left_open(tmp_path: Path) -> None:
    check(write(tmp_path, config_text(rates=f"1\n{HZ},0"), data_bytes()))
    two = read_comtrade(write(tmp_path, config_text(rates="2\n2400,600\n1200,0"), data_bytes()))
    assert two.rates == (Rate(2400.0, 600), Rate(1200.0, SAMPLES))


# -- text -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", ["ASCII", "BINARY"])
@pytest.mark.parametrize("change", [
    lambda text: "﻿" + text,
    lambda text: text.replace("\n", "\r\n"),
    lambda text: text.replace("\n", "\r\r\n"),
    lambda text: text.replace("\n", "\r"),
    lambda text: text + "\0" * 200,
    lambda text: text + "\x1a" + "\0" * 9,
    lambda text: text.replace("\n", ",\n"),
    lambda text: text.replace("\n", " ,, \n"),
    lambda text: text.rstrip("\n"),
    lambda text: text.removesuffix("1\n"),
    lambda text: text.replace("-99999,99999", ","),
    lambda text: text.replace(",0,0,", ",,,"),
    lambda text: text.replace("-99999,99999,1,1,P", ""),
    lambda text: text.replace("1,1,P", ",,P"),
    lambda text: text.replace("-99999,99999", "x,nan"),
    lambda text: text.replace(",6A,2D", ", 6a , 2d "),
    lambda text: text.replace("8,6A", "9,6A"),
    lambda text: text.replace("\n50\n", "\n\n"),
    lambda text: text.replace("\n50\n", "\n50 Hz\n"),
    lambda text: text.replace("ST1,,,0", "ST1,,,").replace("ST2,,,0", "ST2,0"),
], ids=range(20))  # fmt: skip
def test_text_as_devices_write_it(tmp_path: Path, change, format: str) -> None:
    check(write(tmp_path, change(config_text(format)), data_bytes(format)))


def test_utf16(tmp_path: Path) -> None:
    check(write(tmp_path, config_text().encode("utf-16"), data_bytes()))


@pytest.mark.parametrize("change", [
    lambda data: data.replace(b"\r\n", b"\r\r\n"),
    lambda data: b"\xef\xbb\xbf" + data,
    lambda data: data + b"\0" * 300,
    lambda data: data + b"\x1a\0\0",
    lambda data: data.replace(b"\r\n", b",\r\n"),
], ids=["crcrlf", "bom", "nul", "sub", "commas"])  # fmt: skip
def test_an_ascii_dat_as_devices_write_it(tmp_path: Path, change) -> None:
    check(write(tmp_path, config_text(), change(data_bytes())))


@pytest.mark.parametrize("text", ["inf", "-inf", "1e400", "nan", "99999", ""])
def test_an_ascii_value_that_is_none(tmp_path: Path, text: str) -> None:
    rows = data_bytes().split(b"\r\n")
    fields = rows[77].split(b",")
    fields[2] = text.encode()
    rows[77] = b",".join(fields)
    record = read_comtrade(write(tmp_path, config_text(), b"\r\n".join(rows)))
    assert np.flatnonzero(np.isnan(record.analog[0].values)).tolist() == [77]
    assert "1 value is missing" in record.notes


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, -np.finfo(np.float32).max])
def test_a_float_that_is_none(tmp_path: Path, value: float) -> None:
    values = signals()
    values[77, 3] = value
    record = read_comtrade(write(tmp_path, config_text("FLOAT32", "2013"), data_bytes("FLOAT32", values)))
    assert np.flatnonzero(np.isnan(record.analog[3].values)).tolist() == [77]


def test_a_signalling_nan(tmp_path: Path) -> None:
    data = bytearray(data_bytes("FLOAT32"))
    data[8:12] = b"\x01\x00\x80\x7f"
    record = read_comtrade(write(tmp_path, config_text("FLOAT32", "2013"), bytes(data)))
    assert np.isnan(record.analog[0].values[0])


def test_a_factor_that_overflows(tmp_path: Path) -> None:
    record = read_comtrade(write(tmp_path, config_text().replace(",4.0,", ",1e307,"), data_bytes()))
    assert np.isnan(record.analog[0].values).any()  # infinite, so missing; and no warning of NumPy's


@pytest.mark.parametrize("stated", [0, 1, 22 * 600, 22 * SAMPLES, 10**9, None])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_a_cff_whose_dat_has_another_length(tmp_path: Path, stated: int | None, mark: bytes) -> None:
    length = b"" if stated is None else b": %d" % stated
    content = (
        mark + b"--- file type: CFG ---\r\n" + config_text("BINARY", "2013").encode()
        + b"--- file type: DAT BINARY" + length + b" ---\r\n" + data_bytes("BINARY")
    )  # fmt: skip
    path = tmp_path / "r.cff"
    path.write_bytes(content)
    check(path)
    told = any("the DAT section says" in note for note in read_comtrade(path).notes)
    assert told == (stated not in (None, 22 * SAMPLES))


def test_inputs_that_are_no_files(tmp_path: Path) -> None:
    path = write(tmp_path, config_text(), data_bytes())
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(InputError, match="is a pipe; a COMTRADE record is needed"):
        read_comtrade(path)
