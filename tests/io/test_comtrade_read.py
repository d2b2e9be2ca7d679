"""Every real record is read, as the `comtrade` package reads it where that is right; damage is reported."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path

import comtrade
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.errors import InputError
from faultloop.io.comtrade import Rate, read_comtrade
from faultloop.io.comtrade.config import parse_config
from faultloop.io.comtrade.record import stretches_of, times_of

RECORDS = {  # file: revision, encoding, samples, analog, status, rates, one name
    "sel311l-c-g/1991-ascii-sel.cfg": ("1991", "utf-8", 480, 24, 592, [(960, 480)], "VA(kV)"),
    "osc-swing-110kv/2.cfg": ("1999", "cp1251", 19679, 55, 112, [(1200, 19679)], "Ua_1СШ-110_ТН_110кВ"),
    "b-g-500kv-reclose/cfg_file.CFG": (
        "1999", "gb18030", 11878, 77, 77,
        [(5000, 6301), (1000, 6387), (5000, 8877), (1000, 11878)], "某某Ⅱ回电压Ua",
    ),
    "b-c-to-abc-110kv/two_phase_fault.cfg": ("1991", "cp1251", 2159, 7, 0, [(1800, 2159)], "Ua"),
    "breaker-failure-30kv/NOR-T2_osc1.cfg": ("1999", "utf-8", 4223, 9, 32, [], "VA"),
    "transformer-inrush/transformer_inrush.cfg": ("1999", "cp1251", 3852, 7, 79, [(2400, 3852)], "IA ВН"),
    "formats/sample_ascii.cfg": ("2013", "utf-8", 40, 4, 4, [(1200, 40)], "IA"),
    "formats/sample_ascii.cff": ("2013", "utf-8", 40, 4, 4, [(1200, 40)], "IA"),
    "formats/sample_bin.cfg": ("1999", "utf-8", 5, 4, 16, [(15360, 5)], "VA"),
    "formats/sample_float32.cff": ("2013", "utf-8", 301, 1, 1, [(100, 301)], "test/out1"),
    "formats/sample_iso8859-1.cfg": ("2013", "cp1252", 40, 4, 4, [(1200, 40)], "IA"),
    "formats/sample_iso8859-1_bin.cfg": ("2013", "cp1252", 40, 4, 4, [(1200, 40)], "IA"),
}  # fmt: skip


@pytest.mark.parametrize("name", RECORDS)
def test_real_records(records, name):
    revision, encoding, samples, analog, status, rates, channel = RECORDS[name]
    record = read_comtrade(records / name)
    assert (record.revision, record.encoding, len(record)) == (revision, encoding, samples)
    assert (len(record.analog), len(record.status)) == (analog, status)
    assert record.rates == tuple(Rate(*rate) for rate in rates)
    assert channel in record.analog_names
    assert record.t_ns[0] == 0 and (np.diff(record.t_ns) > 0).all()
    assert 946_684_800e9 < record.start_ns <= record.trigger_ns < 1_735_689_600e9  # of this century


@pytest.mark.parametrize("name", RECORDS)
def test_the_same_as_the_package_reads(records, name, tmp_path):
    path = records / name
    if name == "breaker-failure-30kv/NOR-T2_osc1.cfg":  # the package wants .dat in the same case as .cfg
        shutil.copy(path, tmp_path / "a.cfg")
        shutil.copy(path.with_suffix(".DAT"), tmp_path / "a.dat")
        path = tmp_path / "a.cfg"
    record = read_comtrade(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        package = comtrade.load(
            str(path), encoding=record.encoding, use_numpy_arrays=True, use_double_precision=True
        )
    for channel, values in zip(record.analog, package.analog, strict=True):
        np.testing.assert_array_equal(channel.values, values)
    for channel, values in zip(record.status, package.status, strict=True):
        np.testing.assert_array_equal(channel.values, np.asarray(values) != 0)
    package_ns = (
        package.time - package.time[0]
    ) * 1e9  # it counts from sample 1, which is not always the first
    assert np.abs(record.t_ns - package_ns).max() < 2
    assert record.analog_names == package.analog_channel_ids
    assert record.frequency_hz == package.frequency


def test_times_and_trigger_of_known_events(records):
    record = read_comtrade(records / "sel311l-c-g/1991-ascii-sel.cfg")
    assert np.datetime64(record.start_ns, "ns") == np.datetime64("2011-02-12T11:41:11.081315")
    status = {channel.name: channel.values for channel in record.status}
    assert record.t_ns[np.argmax(status["51G"])] / 1e9 == pytest.approx(0.0531, abs=1e-3)
    assert record.t_ns[np.argmax(status["Z2G"])] / 1e9 == pytest.approx(0.0740, abs=1e-3)
    assert not status["Z1G"].any()
    assert (record.trigger_ns - record.start_ns) / 1e9 == pytest.approx(0.0657, abs=1e-3)

    reclose = read_comtrade(records / "b-g-500kv-reclose/cfg_file.CFG")
    current = reclose.analog[13]
    assert current.to_primary == 1250 and current.scale == "S"
    assert np.datetime64(reclose.start_ns, "ns") == np.datetime64("2018-08-01T02:18:46.2766")
    # The stamps in its .dat say the same as its four rates: 100 us a count.
    stamps = np.frombuffer((records / "b-g-500kv-reclose/cfg_file.DAT").read_bytes(), "<u4")
    row = 4 + 4 + 77 * 2 + 5 * 2
    assert (stamps[1 :: row // 4].astype(np.int64) * 100_000 == reclose.t_ns).all()


def test_two_digit_years_and_days_first():
    head = "s,d\n1,1A,0D\n1,x,,,V,1,0,0,0,1\n50\n1\n1000,2\n"
    parsed = parse_config(head + "02/28/98,01:02:03.5\n28/02/1998,01:02:03.500000\nASCII\n")
    assert parsed.start_ns == parsed.trigger_ns
    assert np.datetime64(parsed.start_ns, "ns") == np.datetime64("1998-02-28T01:02:03.5")


RATES = (Rate(5000.0, 11), Rate(1000.0, 21), Rate(960.5, 31))


def test_times_of_several_rates():
    t_ns = times_of(RATES, np.arange(31))
    steps = np.diff(t_ns)
    assert (steps[:10] == 200_000).all() and (steps[10:20] == 1_000_000).all()
    assert np.abs(steps[20:] - 1e9 / 960.5).max() <= 1
    # Sample k of a whole number of hertz lies where a run has it, bit by bit.
    assert (times_of((Rate(4800.0, 10**4),), np.arange(10**4)) == np.arange(10**4) * 10**9 // 4800).all()


def test_rates_found_from_rounded_stamps():
    t_ns = times_of(RATES, np.arange(31)) // 1000 * 1000
    found = stretches_of(t_ns)
    assert [rate.stop for rate in found] == [11, 31]  # 1000 and 960.5 Hz are within 20 %
    assert found[0].hz == 5000
    steady = np.rint(np.arange(1000) * 1e6 / 1200).astype(np.int64) * 1000
    assert stretches_of(steady) == (Rate(1200.0, 1000),)


ASCII_CFG = """station,device,1999
4,2A,2D
1,va,A,,kV,0.5,1,0,-32767,32767,1000,1,P
2,ia,A,,A,2,0,25.5,-32767,32767,200,5,S
1,trip,,,0
2,52a,,,1
50
1
1000,4
01/02/2020,03:04:05.000000
01/02/2020,03:04:05.002000
ASCII
1
"""
ASCII_DAT = "1,0,10,-5,0,1\r\n2,1000,99999,3,0,1\r\n3,2000,-20,0,1,1\r\n4,3000,6,7,1,0\r\n"


def write_pair(folder: Path, cfg: str | bytes = ASCII_CFG, dat: str | bytes = ASCII_DAT) -> Path:
    for name, text in (("a.cfg", cfg), ("a.dat", dat)):
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return folder / "a.cfg"


def test_a_small_record(tmp_path):
    record = read_comtrade(write_pair(tmp_path))
    va, ia = record.analog
    np.testing.assert_array_equal(va.values, [6, np.nan, -9, 4])
    np.testing.assert_array_equal(ia.values, [-10, 6, 0, 14])
    assert (va.to_primary, ia.to_primary, ia.skew_s) == (1.0, 40.0, 25.5e-6)
    assert record.status[0].values.tolist() == [False, False, True, True]
    assert record.status[1].normal == 1
    assert record.t_ns.tolist() == [0, 10**6, 2 * 10**6, 3 * 10**6]
    assert record.trigger_ns - record.start_ns == 2_000_000
    assert record.notes == ["1 value is missing"]


@pytest.mark.parametrize(
    "dat",
    [
        ASCII_DAT.rstrip(),
        ASCII_DAT + "\x1a",
        ASCII_DAT.replace("\r\n", "\n"),
        ASCII_DAT.replace("\r\n", ",\r\n"),
        ASCII_DAT.replace(",", " , "),
        ASCII_DAT.replace("\r\n", "\r\n\r\n"),
        ASCII_DAT.replace(",0,10,", ",,10,"),
        ASCII_DAT + "5,4000,1,1,1,1\r\n",
    ],
    ids=[
        "no-last-newline",
        "sub",
        "lf",
        "trailing-comma",
        "spaces",
        "blank-lines",
        "blank-stamp",
        "more-rows",
    ],
)
def test_ascii_as_devices_write_it(tmp_path, dat):
    record = read_comtrade(write_pair(tmp_path, dat=dat))
    assert len(record) == 4
    np.testing.assert_array_equal(record.analog[1].values, [-10, 6, 0, 14])


def test_names_in_any_case(tmp_path):
    write_pair(tmp_path)
    (tmp_path / "a.cfg").rename(tmp_path / "B.CFG")
    (tmp_path / "a.dat").rename(tmp_path / "b.Dat")
    assert len(read_comtrade(tmp_path / "B.CFG")) == 4


def test_samples_left_out_keep_their_time(tmp_path):
    dat = ASCII_DAT.replace("3,2000", "4,2000").replace("4,3000", "7,3000")
    record = read_comtrade(write_pair(tmp_path, dat=dat))
    assert record.t_ns.tolist() == [0, 10**6, 3 * 10**6, 6 * 10**6]
    assert "3 samples are left out, by the samples' numbers" in record.notes


def test_times_from_stamps(tmp_path):
    cfg = ASCII_CFG.replace("1\n1000,4", "0\n0,4").replace("ASCII\n1\n", "ASCII\n2\n")
    record = read_comtrade(write_pair(tmp_path, cfg))
    assert record.t_ns.tolist() == [0, 2 * 10**6, 4 * 10**6, 6 * 10**6]
    assert record.rates == () and record.stretches == (Rate(500.0, 4),)


@pytest.mark.parametrize(
    ("encoding", "name"),
    [
        ("gbk", "某某回电压"),
        ("cp1251", "Напряжение фазы А"),
        ("latin-1", "Tensão de saída"),
        ("utf-8", "Spannung größer"),
    ],
)
def test_names_are_readable(tmp_path, encoding, name):
    record = read_comtrade(write_pair(tmp_path, ASCII_CFG.replace("va", name).encode(encoding)))
    assert record.analog[0].name == name
    forced = read_comtrade(tmp_path / "a.cfg", encoding="latin-1")
    assert forced.analog[0].name == name.encode(encoding).decode("latin-1")


BAD_DAT = {
    ASCII_DAT[:40]: "cut off: 4 samples expected, 2 found",
    "": "4 samples expected, 0 found",
    ASCII_DAT.replace("-20", "x"): "not the numbers",
    ASCII_DAT.replace("-20,", ""): "5 values where 6 are due",
    ASCII_DAT.replace("-20", "\xb5"): "byte 0xc2 at 42",
}
BAD_CFG = {
    "": r"a\.cfg: empty",
    ASCII_CFG[:60]: "line 2: 2 analog and 2 status channels are due and 1 lines follow: it is cut off",
    "\n".join(ASCII_CFG.splitlines()[:6]): "ends after line 6: it is cut off",
    ASCII_CFG.replace("4,2A,2D", "999999,999997A,2D"): "line 2: 999997 analog and 2 status channels are due",
    ASCII_CFG.replace("1\n1000,4", "900000\n1000,4"): "line 8: 900000 sampling rates are due",
    ASCII_CFG.replace(
        "2,ia,A,,A,2,0,25.5,-32767,32767,200,5,S", "2,ia"
    ): "line 4: .*2 fields, where an analog channel has 13",
    ASCII_CFG.replace("0.5", "half"): "line 3: cannot be understood.*a: 'half' is no number",
    ASCII_CFG.replace(",0.5,1,", ",,1,"): "line 3: cannot be understood.*a: '' is no number",
    ASCII_CFG.replace("0.5", "nan"): "line 3: .*a must be a finite number",
    ASCII_CFG.replace("1000,4", "1e400,4"): "line 9: .*sampling rate must be a finite number",
    ASCII_CFG.replace("1000,4", "inf,4"): "line 9: .*sampling rate must be a finite number",
    ASCII_CFG.replace("1000,4", "1e12,4"): r"line 9: .*from 0 to 1e\+08 hertz",
    ASCII_CFG.replace("1000,4", "1000,4.5"): "line 9: .*last sample: a whole number",
    ASCII_CFG.replace("1000,4", "1000,-4"): "line 9: .*last sample: a whole number",
    ASCII_CFG.replace("ASCII", "BCD"): "'BCD': it must be one of ASCII",
    ASCII_CFG.replace("1\n1000,4", "2\n1,9\n1,3"): "each must be greater",
    ASCII_CFG.replace("1000,4", "-1000,4"): "sampling rate must be",
    ASCII_CFG.replace("ASCII\n1", "ASCII\n0"): "greater than 0",
}


@pytest.mark.parametrize("dat", BAD_DAT, ids=range(len(BAD_DAT)))
def test_a_damaged_dat_is_named(tmp_path, dat):
    with pytest.raises(InputError, match=r"a\.dat: .*" + BAD_DAT[dat]) as caught:
        read_comtrade(write_pair(tmp_path, dat=dat))
    assert str(caught.value).startswith(str(tmp_path)) and "\n" not in str(caught.value)


@pytest.mark.parametrize("cfg", BAD_CFG, ids=range(len(BAD_CFG)))
def test_a_damaged_cfg_is_named(tmp_path, cfg):
    with pytest.raises(InputError, match=BAD_CFG[cfg]) as caught:
        read_comtrade(write_pair(tmp_path, cfg))
    assert str(caught.value).startswith(str(tmp_path)) and "\n" not in str(caught.value)


def test_a_dat_that_is_not_there(tmp_path):
    path = write_pair(tmp_path)
    (tmp_path / "a.dat").unlink()
    with pytest.raises(InputError, match=r"there is no a\.dat beside it"):
        read_comtrade(path)


def test_wrong_paths(tmp_path):
    with pytest.raises(InputError, match=r"must end in \.cfg or \.cff"):
        read_comtrade(tmp_path / "a.mcap")
    with pytest.raises(InputError, match=r"a\.cff: no such file"):
        read_comtrade(tmp_path / "a.cff")
    (tmp_path / "d.cfg").mkdir()
    with pytest.raises(InputError, match="is a folder; a COMTRADE record is needed"):
        read_comtrade(tmp_path / "d.cfg")
    (tmp_path / "n.cff").write_text("--- file type: CFG ---\n")
    with pytest.raises(InputError, match="no section '--- file type: DAT ---'"):
        read_comtrade(tmp_path / "n.cff")
    with pytest.raises(InputError, match="no such encoding: 'klingon'"):
        read_comtrade(write_pair(tmp_path), encoding="klingon")


@pytest.mark.parametrize(
    "name",
    ["sample_bin.cfg", "sample_ascii.cfg", "sample_float32.cff", "sample_ascii.cff", "sample_iso8859-1.cfg"],
)
def test_no_damage_crashes_the_reader(records, name, tmp_path_factory):
    """Bytes changed, cut out or doubled: a record comes back, or one line."""
    folder = tmp_path_factory.mktemp("damaged")
    source = records / "formats" / name
    suffixes = [".cff"] if source.suffix == ".cff" else [".cfg", ".dat"]
    originals = {suffix: source.with_suffix(suffix).read_bytes() for suffix in suffixes}

    @settings(derandomize=True, deadline=None, max_examples=150)
    @given(
        st.sampled_from(suffixes), st.integers(0, 10**6), st.integers(0, 10**6),
        st.binary(max_size=6) | st.sampled_from([b"-1", b"9" * 20, b",", b"\n", b"nan", b"1e400"]),
    )  # fmt: skip
    def damage(suffix, first, length, put):
        for other, content in originals.items():
            if other == suffix:
                start = first % (len(content) + 1)
                content = content[:start] + put + content[start + length % 20 :]
            (folder / f"a{other}").write_bytes(content)
        try:
            record = read_comtrade(folder / f"a{suffixes[0]}")
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert all(len(channel.values) == len(record) for channel in record.analog)

    damage()
