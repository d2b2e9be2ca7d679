"""Six channels of a record in primary values, and the same on a relay's clock."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.io.comtrade import (
    AnalogChannel,
    Rate,
    Record,
    SixChannels,
    read_comtrade,
    resample,
    select_channels,
)
from faultloop.io.comtrade.record import times_of
from faultloop.io.comtrade.select import SLOTS, fundamental_hz

NAMES = ("VA", "VB", "VC", "IA", "IB", "IC")


def record_of(names=NAMES, units=("kV",) * 3 + ("A",) * 3, **more) -> Record:
    rates = (Rate(1000.0, 400),)
    t_ns = times_of(rates, np.arange(400))
    channels = [
        AnalogChannel(name, (i + 1) * np.cos(2 * np.pi * 50 * t_ns / 1e9 - i), unit, **more)
        for i, (name, unit) in enumerate(zip(names, units, strict=True))
    ]
    return Record(t_ns, channels, rates=rates, frequency_hz=50.0)


@pytest.mark.parametrize(
    ("names", "units"),
    [
        (NAMES, ("kV",) * 3 + ("A",) * 3),
        (("Ua", "Ub", "Uc", "Ia", "Ib", "Ic"), ("кВ",) * 3 + ("А",) * 3),
        (("UL1", "UL2", "UL3", "IL1", "IL2", "IL3"), ("V",) * 3 + ("kA",) * 3),
        (("U_A-N", "U_B-N", "U_C-N", "I A", "I B", "I C"), (" V",) * 3 + ("A ",) * 3),
        (("VA(kV)", "VB(kV)", "VC(kV)", "IA", "IB", "IC"), ("kV",) * 3 + ("A",) * 3),
        (NAMES, ("",) * 6),
    ],
)
def test_channels_found_by_themselves(names, units):
    extra = ("V0", "3U0", "IN", "VS", "IAL", "Freq", "UAB")
    record = record_of((*extra[:3], *names, *extra[3:]), ("V", "V", "A", *units, "V", "A", "Hz", "V"))
    six = select_channels(record)
    assert six.names == names and six.missing == ()
    factors = [1000.0 if unit.strip()[:1] in ("k", "к") else 1.0 for unit in units]
    for i, factor in enumerate(factors):
        np.testing.assert_array_equal(six.values[:, i], record.analog[3 + i].values * factor)
    assert any("no unit" in note for note in six.notes) == ("" in units)


def test_phase_and_unit_do_where_names_do_not_help():
    record = record_of(tuple("uvwxyz"))
    for channel, phase in zip(record.analog, "ABCABC", strict=True):
        channel.phase = phase
    assert select_channels(record).names == tuple("uvwxyz")


@pytest.mark.parametrize(
    ("mapping", "names", "factors"),
    [
        ("va=5,vb=4,vc=3,ia=2,ib=1,ic=0", NAMES[::-1], (1,) * 6),
        ("va=VA,vb= vb ,vc=VC*-2", NAMES, (1, 1, -2, 1, 1, 1)),
        ("va=0*1.4142,ic=IC*0.5", NAMES, (1.4142, 1, 1, 1, 1, 0.5)),
        ("ic=-", (*NAMES[:5], ""), (1,) * 6),
    ],
)
def test_mapping(mapping, names, factors):
    record = record_of(units=("V",) * 6 if mapping.startswith("va=5") else ("V",) * 3 + ("A",) * 3)
    if mapping.startswith("va=5"):
        for channel in record.analog:
            channel.unit = ""
    six = select_channels(record, mapping)
    assert six.names == names
    by_name = {channel.name: channel.values for channel in record.analog}
    for column, name, factor in zip(six.values.T, names, factors, strict=True):
        if name:
            np.testing.assert_array_equal(column, by_name[name] * factor)
        else:
            assert np.isnan(column).all()


def test_a_name_may_hold_what_the_mapping_uses():
    record = record_of(("1", "a,b", "c=d", "e*2", "IB", "IC"))
    six = select_channels(record, "va=1,vb=a,b,vc=c=d,ia=e*2")
    assert six.names == ("1", "a,b", "c=d", "e*2", "IB", "IC")  # a name goes before a place or a factor


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ("va=VX", "va: no channel 'VX': did you mean 'V[ABC]'"),
        ("va=6", "va: no channel 6: counted from 0, the last is 5"),
        ("va=IA", "va: channel 'IA' is in 'A': it must be in V or kV"),
        ("vx=1", "not of the form|none of"),
        ("vx=1,va=0", "'vx=1' is none of va, vb"),
        ("va=0,va=1", "va is mapped twice"),
        ("va=", "va: no channel ''"),
        ("nonsense", "not of the form va="),
    ],
)
def test_wrong_mappings(mapping, words):
    with pytest.raises(InputError, match=words):
        select_channels(record_of(), mapping)


def test_what_cannot_be_told_is_asked():
    twice = record_of(("VA", "VA", "VC", "IA", "IB", "IC"))
    with pytest.raises(InputError, match="2 channels are called 'VA': say which by its place, 0, 1"):
        select_channels(twice, "va=VA")
    two_lines = record_of(("Ua_1", "Ua_2", "Ub_1", "Uc_1", "Ia", "Ib"), ("kV",) * 4 + ("A",) * 2)
    with pytest.raises(InputError, match=r"va can be any of 'Ua_1', 'Ua_2'.*--map"):
        select_channels(two_lines)
    assert select_channels(two_lines, "va=Ua_2").names == ("Ua_2", "Ub_1", "Uc_1", "Ia", "Ib", "")
    with pytest.raises(InputError, match="no voltages or currents found"):
        select_channels(record_of(tuple("uvwxyz"), ("Hz",) * 6))
    with pytest.raises(InputError, match=r"is in 'pu': it must be in V or kV"):
        select_channels(record_of(units=("pu",) * 6), "va=0")


def test_primary_values():
    secondary = record_of(units=("V",) * 3 + ("A",) * 3, scale="S", ratio=(500_000.0, 100.0))
    one = secondary.analog[0].values
    np.testing.assert_allclose(select_channels(secondary).values[:, 0], one * 5000)
    np.testing.assert_allclose(select_channels(secondary, vt_ratio=1100).values[:, 0], one * 1100)
    np.testing.assert_allclose(select_channels(secondary, scale="P").values[:, 0], one)
    unknown = record_of(scale="S", ratio=(0.0, 0.0))
    with pytest.raises(InputError, match="secondary values and no ratio: give vt_ratio"):
        select_channels(unknown)
    six = select_channels(unknown, vt_ratio=1000.0, ct_ratio=240.0)
    np.testing.assert_allclose(six.values[:, 3], unknown.analog[3].values * 240)


def test_a_wrong_nominal_frequency_is_noted():
    record = record_of()
    assert fundamental_hz(select_channels(record)) == pytest.approx(50, abs=0.5)
    assert select_channels(record).notes == []
    record.frequency_hz = 60.0
    (note,) = select_channels(record).notes
    assert note.startswith("the record says 60 Hz, its signals have 50")


def test_real_records(records):
    swing = select_channels(
        read_comtrade(records / "osc-swing-110kv/2.cfg"), "va=4,vb=5,vc=6,ia=31,ib=32,ic=33"
    )
    assert 60e3 < np.abs(swing.values[:1000, 0]).max() < 110e3  # 110 kV, phase to ground, primary

    reclose = read_comtrade(records / "b-g-500kv-reclose/cfg_file.CFG")
    healthy = select_channels(reclose, "va=0,vb=1,vc=2,ia=8,ib=9,ic=10")
    faulted = select_channels(reclose, "va=4,vb=5,vc=6,ia=12,ib=13,ic=14")
    fault = slice(int(0.100 * 5000), int(0.115 * 5000))
    assert np.abs(faulted.values[fault, 4]).max() > 3 * np.abs(healthy.values[fault, 4]).max()
    assert np.abs(healthy.values[:400, 0]).max() == pytest.approx(500e3 * np.sqrt(2 / 3), rel=0.1)

    inrush = read_comtrade(records / "transformer-inrush/transformer_inrush.cfg")
    six = select_channels(inrush, "ia=0,ib=1,ic=2")
    assert six.missing == ("va", "vb", "vc")

    automatic = select_channels(read_comtrade(records / "b-c-to-abc-110kv/two_phase_fault.cfg"))
    assert automatic.names == ("Ua", "Ub", "Uc", "Ia", "Ib", "Ic")
    assert automatic.skew_s[5] == pytest.approx(104.17e-6)
    sel = select_channels(read_comtrade(records / "sel311l-c-g/1991-ascii-sel.cfg"))
    assert sel.names == ("VA(kV)", "VB(kV)", "VC(kV)", "IA", "IB", "IC")


def sine(rates: tuple[Rate, ...], hz: float = 50.0, skew_s: tuple[float, ...] = (0.0,) * 6) -> SixChannels:
    t_ns = times_of(rates, np.arange(rates[-1].stop))
    return SixChannels(t_ns, at(t_ns, hz, skew_s), rates, NAMES, skew_s)


def at(t_ns: np.ndarray, hz: float = 50.0, skew_s: tuple[float, ...] = (0.0,) * 6) -> np.ndarray:
    t = t_ns[:, None] / 1e9 + np.array(skew_s)
    return np.sqrt(2) * np.cos(2 * np.pi * hz * t - np.arange(6))


@pytest.mark.parametrize("hz", [960.0, 1200.0, 4800.0, 14400.0])
def test_the_same_rate_gives_the_same_bits(hz):
    six = sine((Rate(hz, 500),))
    again = resample(six, int(hz))
    np.testing.assert_array_equal(again.values, six.values)
    np.testing.assert_array_equal(again.t_ns, np.arange(500) * 10**9 // int(hz))


# Worst error of a cubic spline is about (w h)^4 / 384 of the peak; a low-pass adds its ripple.
@pytest.mark.parametrize(
    ("hz", "new_hz", "limit"),
    [(1000, 4800, 8e-5), (960, 4800, 1e-4), (4800, 1200, 1e-3), (14400, 4800, 1e-3), (5000, 4800, 1e-3)],
)
def test_a_sinusoid_keeps_its_shape(hz, new_hz, limit):
    six = sine((Rate(float(hz), hz // 2),))
    again = resample(six, new_hz)
    np.testing.assert_array_equal(again.t_ns, np.arange(len(again.t_ns)) * 10**9 // new_hz)
    assert 0 <= six.t_ns[-1] - again.t_ns[-1] < 10**9 / new_hz
    inside = slice(new_hz // 50, -new_hz // 50)
    assert np.abs(again.values - at(again.t_ns))[inside].max() < limit * np.sqrt(2)
    assert np.abs(again.values - at(again.t_ns)).max() < 0.02


def test_what_would_alias_is_taken_away():
    above = resample(sine((Rate(14400.0, 7200),), hz=4800.0 - 50.0), 4800)
    assert np.abs(above.values[100:-100]).max() < 10 ** (-70 / 20) * np.sqrt(2) * 1.5
    within = resample(sine((Rate(14400.0, 7200),), hz=1000.0), 4800)
    assert np.abs(within.values[100:-100]).max() == pytest.approx(np.sqrt(2), rel=0.01)


def test_skew_is_taken_out():
    skew_s = (0.0, 34.7e-6, 69.4e-6, 104e-6, 139e-6, 174e-6)
    again = resample(sine((Rate(1800.0, 900),), skew_s=skew_s), 1800)
    assert again.skew_s == (0.0,) * 6
    assert np.abs(again.values - at(again.t_ns))[10:-10].max() < 2e-5


def test_stretches_of_different_rates():
    """A slow stretch of a record does not ripple into the fast ones: a step stays where it was."""
    rates = (Rate(5000.0, 500), Rate(1000.0, 600), Rate(5000.0, 1100))
    six = sine(rates)
    again = resample(six, 4800)
    error = np.abs(again.values - at(again.t_ns))
    fast, slow = again.t_ns < 90e6, (again.t_ns > 110e6) & (again.t_ns < 190e6)
    assert error[100:][fast[100:]].max() < 1e-3 and error[slow].max() < 1e-4
    six.values[:600] = 0.0
    six.values[600:] = 1.0
    stepped = resample(six, 4800)
    assert np.abs(stepped.values[stepped.t_ns < six.t_ns[590]]).max() < 0.02
    assert np.abs(stepped.values[stepped.t_ns > six.t_ns[620]] - 1).max() < 0.02


def test_gaps():
    six = sine((Rate(1000.0, 400),))
    six.values[100:103, 1] = np.nan
    six.values[:, 2] = np.nan
    again = resample(six, 4800)
    assert not np.isnan(again.values[:, [0, 1, 3, 4, 5]]).any() and np.isnan(again.values[:, 2]).all()
    assert again.notes == ["vb: 3 missing values bridged by straight lines"]
    with pytest.raises(InputError, match="at least 4"):
        resample(sine((Rate(1000.0, 3),)), 4800)


@pytest.mark.parametrize(
    ("name", "mapping", "limit"),
    [
        ("sel311l-c-g/1991-ascii-sel.cfg", None, 5e-3),
        ("b-g-500kv-reclose/cfg_file.CFG", "va=4,vb=5,vc=6,ia=12,ib=13,ic=14", 3e-4),
        ("breaker-failure-30kv/NOR-T2_osc1.cfg", None, 3e-3),
    ],
)
def test_real_records_keep_their_phasors(records, name, mapping, limit):
    """A cycle before the fault has the same fundamental as recorded and as resampled.

    Closely where the record is steady (the 500 kV line); the others drift within the cycle and have
    harmonics, and the two fits do not weigh them alike.
    """
    record = read_comtrade(records / name)
    six = select_channels(record, mapping)
    again = resample(six, 4800)
    assert SLOTS[0] == "va"

    def fundamental(channels: SixChannels) -> np.ndarray:
        hz = record.frequency_hz
        inside = (channels.t_ns >= 0.25e9 / hz) & (channels.t_ns < 1.25e9 / hz)
        t = channels.t_ns[inside] / 1e9
        basis = np.column_stack([np.cos(2 * np.pi * hz * t), np.sin(2 * np.pi * hz * t), np.ones(len(t))])
        return np.linalg.lstsq(basis, channels.values[inside], rcond=None)[0]

    before, after = fundamental(six), fundamental(again)
    scale = np.repeat([np.abs(before[:, :3]).max(), np.abs(before[:, 3:]).max()], 3)
    assert (np.abs(after - before) / scale).max() < limit


@pytest.mark.parametrize(
    ("name", "mapping", "places"),
    [
        ("b-g-500kv-reclose/cfg_file.CFG", "bay=Ⅱ回", (4, 5, 6, 12, 13, 14)),
        ("b-g-500kv-reclose/cfg_file.CFG", "bay=0", (0, 1, 2, 8, 9, 10)),
        ("osc-swing-110kv/2.cfg", "bay=ВЛ62", (4, 5, 6, 31, 32, 33)),
        ("sel311l-c-g/1991-ascii-sel.cfg", None, (5, 6, 7, 0, 1, 2)),
        ("b-c-to-abc-110kv/two_phase_fault.cfg", None, (0, 1, 2, 3, 4, 5)),
        ("breaker-failure-30kv/NOR-T2_osc1.cfg", None, (0, 1, 2, 3, 4, 5)),
    ],
)
def test_the_shared_records_without_channel_numbers(
    records: Path, name: str, mapping: str | None, places: tuple[int, ...]
) -> None:
    """As the records' README has them."""
    record = read_comtrade(records / name)
    six = select_channels(record, mapping, ct_ratio=1.0, vt_ratio=1.0)
    assert six.names == tuple(record.analog[place].name for place in places)


def test_a_bay_that_is_not_told(records: Path) -> None:
    record = read_comtrade(records / "b-g-500kv-reclose" / "cfg_file.CFG")
    for mapping, words in (
        ("bay=nowhere", "no bay 'nowhere': 0 to"),
        ("bay=回", "'回' can be any of 某某Ⅰ回, 某某Ⅱ回"),
        ("bay=1,bay=0", "bay is mapped twice"),
        ("bay=3", "its name does not tell va, vb, vc: map these beside it"),
        (None, "a whole bay with --map bay=.. (0 '某某Ⅰ回', 1 '某某Ⅱ回'"),
    ):
        with pytest.raises(InputError, match=re.escape(words)):
            select_channels(record, mapping)
    beside = select_channels(record, "bay=3,va=20,vb=21,vc=22")
    assert beside.names[:3] == tuple(record.analog[place].name for place in (20, 21, 22))
