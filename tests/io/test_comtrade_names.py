"""Units, phases, and what is no phase: how channels are found by themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.io.comtrade import AnalogChannel, Overrides, Rate, Record, read_comtrade, select_channels
from faultloop.io.comtrade.mapping import numbers_of, parse_mapping, parse_overrides
from faultloop.io.comtrade.names import label_of, phases_of
from faultloop.io.comtrade.record import StatusChannel, times_of
from faultloop.io.comtrade.units import unit_of
from tests.io.comtrade_records import NAMES


@pytest.mark.parametrize(
    ("text", "quantity", "factor"),
    [
        ("V", "v", 1), ("v", "v", 1), ("Volts", "v", 1),
        ("VOLT", "v", 1), ("kVolt", "v", 1e3), ("kV", "v", 1e3),
        ("KV", "v", 1e3), ("KVolts", "v", 1e3), ("mV", "v", 1e-3),
        ("MV", "v", 1e6), ("В", "v", 1), ("кВ", "v", 1e3),
        ("КВ", "v", 1e3), ("МВ", "v", 1e6), ("Вольт", "v", 1), ("kilovolts", "v", 1e3), ("[kV]", "v", 1e3),
        ("A", "i", 1), ("a", "i", 1), ("Amps", "i", 1),
        ("AMP", "i", 1), ("Ampere", "i", 1), ("amperes", "i", 1),
        ("kA", "i", 1e3), ("KA", "i", 1e3), ("kAmps", "i", 1e3),
        ("mA", "i", 1e-3), ("А", "i", 1), ("кА", "i", 1e3),
        ("Ампер", "i", 1), (" A ", "i", 1), ("安", "i", 1), ("千伏", "v", 1e3),
    ],
)  # fmt: skip
def test_units(text: str, quantity: str, factor: float) -> None:
    assert unit_of(text) == (quantity, factor)


@pytest.mark.parametrize(
    "text", ["", "Hz", "pu", "VA", "var", "W", "kVA", "deg", "none", "V/m", "As", "Vrms", "%"]
)
def test_no_units_of_ours(text: str) -> None:
    assert unit_of(text) is None


PHASE = [  # name, unit, phase field: quantity and phase
    ("VA", "kV", "", "va"), ("Ua", "кВ", "A", "va"), ("U_A-N", "V", "", "va"), ("VAN", "V", "AN", "va"),
    ("UL1", "V", "", "vl1"), ("IL3", "A", "L3", "il3"), ("V a", "V", "", "va"),
    ("某某Ⅱ回电压Ua", "V", "A", "va"),
    ("IВ ВН", "A", "", "ib"), ("A相电压", "V", "", "va"),
    ("Voltage Phase C", "V", "", "vc"), ("VA(kV)", "kV", "", "va"),
    ("Ph-R Volt", "V", "", "vr"), ("VY", "V", "Y", "vy"), ("CT1 IA", "A", "", "ia"), ("IA-1", "A", "", "ia"),
    ("anything", "A", "B", "ib"), ("U1", "V", "A", "va"), ("Curr 2", "A", "", "i2"), ("VA", "V", "0", "va"),
    ("IW", "Amps", "W", "iw"), ("VA", "", "", "va"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "unit", "phase", "expected"), PHASE)
def test_phases(name: str, unit: str, phase: str, expected: str) -> None:
    label = label_of(AnalogChannel(name, np.zeros(1), unit, phase))
    assert label.quantity + label.phase == expected


NO_PHASE = [
    ("UAB", "V", "A", "between two"), ("Uab", "V", "", "between two"), ("U A-B", "V", "", "between two"),
    ("UL1-L2", "V", "", "between two"), ("UL12", "V", "", "between two"), ("V23", "V", "", "between two"),
    ("VRY", "V", "R", "between two"), ("VYB", "V", "Y", "between two"), ("Uвс", "V", "", "between two"),
    ("Bus AB voltage", "V", "A", "between two"), ("线电压", "V", "A", "between two"),
    ("VS-T", "V", "", "between two"),
    ("3U0", "V", "A", "sequence"), ("3Uo", "V", "A", "sequence"),
    ("I0", "A", "A", "sequence"), ("IN", "A", "A", "sequence"),
    ("V_neg", "V", "A", "sequence"), ("3＃主变零序电流", "A", "B", "sequence"),
    ("Residual current", "A", "A", "sequence"),
    ("VX", "V", "N", "phase field says N"), ("VX", "V", "AB", "phase field says AB"),
    ("Battery", "V", "DC", "says DC"),
    ("VA", "V", "B", "phase A, its phase field B"), ("U2", "V", "A", "phase 2, its phase field A"),
    ("VA", "Hz", "A", "its unit is Hz"), ("VA", "A", "A", "do not agree"), ("V1MEM", "kV", "", "no phase"),
    ("IAL", "A", "", "no phase"), ("Freq", "", "", "neither unit nor name"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "unit", "phase", "why"), NO_PHASE)
def test_what_is_no_phase_quantity(name: str, unit: str, phase: str, why: str) -> None:
    label = label_of(AnalogChannel(name, np.zeros(1), unit, phase))
    assert not label.is_phase
    assert why in label.why


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        ("abc", "abc"), ("ryb", "abc"), ("rwb", "abc"), ("rst", "abc"),
        ("123", "abc"), ("ab", "ab"), ("b", "b"),
        ("ry", "ab"), ("abcr", "abc-"), ("bcr", "bc-"), ("12", "--"),
        ("r", "-"), ("s", "-"), ("abc1", "abc-"),
        (("l1", "l2", "l3"), "abc"), (("l2", "l3"), "bc"),
    ],
)  # fmt: skip
def test_phases_by_what_stands_together(labels: str | tuple[str, ...], expected: str) -> None:
    found = phases_of(labels)
    assert "".join(found.get(label, "-") for label in labels) == expected


def record_of(
    names: tuple[str, ...] = NAMES,
    phases: tuple[str, ...] = ("",) * 6,
    units: tuple[str, ...] = ("V",) * 3 + ("A",) * 3,
    **more: object,
) -> Record:
    rates = (Rate(1000.0, 400),)
    t_ns = times_of(rates, np.arange(400))
    channels = [
        AnalogChannel(name, (i + 1) * np.cos(2 * np.pi * 50 * t_ns / 1e9 - i), unit, phase, **more)  # type: ignore[arg-type]
        for i, (name, phase, unit) in enumerate(zip(names, phases, units, strict=True))
    ]
    return Record(t_ns, channels, rates=rates)


@pytest.mark.parametrize("order", ["RYB", "RWB", "RST", "123", "ABC"])
def test_colours_and_letters(order: str) -> None:
    names = tuple(q + phase for q in "VI" for phase in order)
    assert select_channels(record_of(names)).names == names
    assert select_channels(record_of(names, tuple(order) * 2)).names == names
    blank = tuple(f"ch {i}" for i in range(6))
    assert select_channels(record_of(blank, tuple(order) * 2)).names == blank


def test_voltages_and_currents_may_be_called_differently() -> None:
    names = ("VR", "VY", "VB", "IL1", "IL2", "IL3")
    assert select_channels(record_of(names)).names == names


def test_the_cases(shared: Path) -> None:
    cases = shared / "cases"
    assert select_channels(read_comtrade(cases / "comtrade-ryb-phases" / "r.cfg")).names == (
        "VR", "VY", "VB", "IR", "IY", "IB",
    )  # fmt: skip
    lines = select_channels(read_comtrade(cases / "comtrade-line-voltages" / "r.cfg"))
    assert lines.missing == ("va", "vb", "vc")
    words = select_channels(read_comtrade(cases / "comtrade-units-amps" / "r.cfg"))
    assert np.abs(words.values[:100, 0]).max() == pytest.approx(180e3, rel=0.01)  # 220 kV, phase to ground


# -- what a user overrules --------------------------------------------------------------------------------


def test_overrides() -> None:
    record = record_of(scale="S", ratio=(1100.0, 1.0))
    one = record.analog[0].values
    plain = select_channels(record)
    assert plain.secondary == (1100.0,) * 6 and plain.given == (False,) * 6
    np.testing.assert_allclose(plain.values[:, 0], one * 1100)
    units = select_channels(record, overrides=Overrides(units={"va": "kV"}))
    np.testing.assert_allclose(units.values[:, 0], one * 1100e3)
    np.testing.assert_allclose(units.values[:, 1], record.analog[1].values * 1100)
    scales = select_channels(record, overrides=Overrides(scales={"va": 2200.0}, vt_ratio=3.0))
    np.testing.assert_allclose(scales.values[:, 0], one * 2200)
    np.testing.assert_allclose(scales.values[:, 1], record.analog[1].values * 3)
    np.testing.assert_allclose(scales.values[:, 3], record.analog[3].values * 1100)
    assert scales.given == (True, True, True, False, False, False)
    both = select_channels(record, "va=0*-2", overrides=Overrides(units={"va": "kV"}, scales={"va": 2200.0}))
    np.testing.assert_allclose(both.values[:, 0], one * -2 * 1e3 * 2200)


def test_a_unit_given_for_a_record_that_has_none_of_ours() -> None:
    record = record_of(units=("pu",) * 6)
    six = select_channels(record, overrides=Overrides(units=parse_overrides(["v=kV", "i=A"], "--unit")))
    assert six.names == NAMES
    np.testing.assert_allclose(six.values[:, 0], record.analog[0].values * 1e3)
    with pytest.raises(InputError, match="--unit: va: channel 'VA' is in 'A': it must be in V or kV"):
        select_channels(record, overrides=Overrides(units={"va": "A"}))


def test_overrides_as_written() -> None:
    assert parse_overrides(["va=kV", "i=A"], "--unit") == {"va": "kV", "ia": "A", "ib": "A", "ic": "A"}
    assert parse_overrides(["v=kV,va=V"], "--unit")["va"] == "V"
    assert numbers_of({"va": "2200"}, "--scale") == {"va": 2200.0}
    for wrong, words in (("va", "not of the form"), ("vx=1", "'vx' is none of"), ("va=", "not of the form")):
        with pytest.raises(InputError, match=words):
            parse_overrides([wrong], "--scale")
    for number in ("x", "nan", "inf", "0"):
        with pytest.raises(InputError, match="--scale: va"):
            numbers_of({"va": number}, "--scale")


def test_contacts_in_a_mapping() -> None:
    record = record_of()
    record.status = [StatusChannel(name, np.zeros(400, bool)) for name in ("CB open", "52a A", "52a A", "x")]
    found = parse_mapping(record, "va=VA,52b=cb open,52a_a=1,52a_b=x")
    assert {slot: channel.name for slot, channel in found.contacts.items()} == {
        "52b": "CB open", "52a_a": "52a A", "52a_b": "x",
    }  # fmt: skip
    assert found.analog["va"] is not None
    for wrong, words in (
        ("52a=52a A", "2 channels are called '52a A': say which by its place, 1, 2"),
        ("52a=9", "counted from 0, the last is 3"),
        ("52a=no", "no digital channel 'no'"),
        ("52a=0,52a_b=1", "52a is of all three poles"),
        ("52a=0,52a=1", "52a is mapped twice"),
        ("52c=0", "not of the form"),
    ):
        with pytest.raises(InputError, match=words):
            parse_mapping(record, wrong)
