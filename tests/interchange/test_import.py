"""Settings files of other tools, made for these tests, against the zones that were meant."""

from __future__ import annotations

import cmath
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.interchange import read_settings
from faultloop.interchange.model import Given, Taken
from faultloop.interchange.shape import cut, inside
from faultloop.interchange.toml import settings_dict
from faultloop.relay import RelaySettings, load_settings
from faultloop.relay.functions.pdis import polygons
from faultloop.review.zones import Outline, draw_zones, write_zones
from tests.measured import Measured

Z1 = cmath.rect(10.0, math.radians(78))

RIO_1 = """
BEGIN TESTOBJECT
  BEGIN DEVICE
    NAME "line 7"
    MANUFACTURER somebody
    VNOM 110
    VPRIM-LL 220000
    INOM 1
    IPRIM 1200
    FNOM 50
  END DEVICE
  BEGIN DISTANCE
    LINEANGLE 78
    IMPPRIM NO
    RERL_XEXL 1.1,0.8
    BEGIN ZONE
      INDEX 1
      LABEL "Z1 LL"
      TYPE TRIPPING
      FAULTLOOP LL
      TRIPTIME 0.0
      ACTIVE YES
      BEGIN SHAPE
        LINE 0,8,0,RIGHT
        LINE 6,0,78,LEFT
        LINE 0,0,115,RIGHT
        LINE 0,0,-15,LEFT
        AUTOCLOSE YES
      END SHAPE
    END ZONE
    BEGIN ZONE
      INDEX 2
      LABEL Z2
      FAULTLOOP LN
      TRIPTIME 0.4
      BEGIN MHOSHAPE
        ANGLE 78
        REACH 13
        OFFSET 0
      END MHOSHAPE
    END ZONE
    BEGIN ZONE
      INDEX 3
      LABEL Z3
      TYPE NONTRIPPING
      FAULTLOOP ALL
      TRIPTIME 1.2
      BEGIN MHOSHAPE
        ANGLE -102
        REACH 4
      END MHOSHAPE
    END ZONE
    BEGIN ZONE
      INDEX 4
      LABEL Z4
      FAULTLOOP L1N
      BEGIN MHOSHAPE
        ANGLE 78
        REACH 20
      END MHOSHAPE
    END ZONE
    BEGIN ZONE
      INDEX 5
      LABEL Z5
      FAULTLOOP LL
      BEGIN LENSTOMATOSHAPE
        ANGLE 78
      END LENSTOMATOSHAPE
    END ZONE
  END DISTANCE
END TESTOBJECT
"""

RIO_2 = """BEGIN   PROTECTIONDEVICE
  DEVICE      7SA522
  RATING 100, 5, 60
  LINEANGLE   78
  RE/RL 1.1
  XE/XL 0.8
  BEGIN ZONE
    NAME  Z1
    TIME1 0.0
    TIMEM 0.05
    BEGIN      TRIPCHAR
      START 0.0 , 0.0
      LINE 6, -1.6077
      LINE 7.7004, 8
      LINE -3.7305, 8
      CLOSE
    END TRIPCHAR
    BEGIN TRIPCHAR-EARTH
      START 0, 0
      LINE 3, -0.8038
      LINE 4.7004, 8
      LINE -3.7305, 8
      CLOSE
    END TRIPCHAR-EARTH
  END ZONE
  BEGIN ZONE-OVERREACH
    NAME Z5
    BEGIN TRIPCHAR
      START 8, 0
      ARC 8, 0, 360, CCW
      CLOSE
    END TRIPCHAR
  END ZONE-OVERREACH
END PROTECTIONDEVICE
"""

SEL = '''[INFO]
RELAYTYPE=SEL-311L
FID=SEL-311L-R100
[1]
RID,"LINE ""7"""
CTR,"240"
PTR,"600"
Z1MAG,"1.78"
Z1ANG,"75.10"
Z0MAG,"5.71"
Z0ANG,"72.10"
E21P,"3"
Z1P,"1.43"
Z2P,"2.67"
Z3P,"1.25"
Z4P,"OFF"
DIR3,"R"
Z1PD,"5.00"
Z2PD,"25.00"
Z1MG,"OFF"
XG1,"1.30"
RG1,"4.00"
Z1GD,"5"
NFREQ,"60"
'''

ABB = """<?xml version="1.0" encoding="utf-8"?>
<XRIO xmlns="http://www.omicron.at/xrio"><CUSTOM><Block Id="B1"><Name>ZMFPDIS: 1</Name>
<Block><Name>Zone 1</Name><Block><Name>Setting Group1</Name>
<Parameter Id="p1"><Name>X1PPZ1</Name><Value>27.2</Value></Parameter>
<Parameter><Name>R1PPZ1</Name><Value>4.08</Value></Parameter>
<Parameter><Name>RFPPZ1</Name><Value>30</Value></Parameter>
<Parameter><Name>X1PEZ1</Name><Value>27.2 Ohm</Value></Parameter>
<Parameter><Name>R1PEZ1</Name><Value>4.08</Value></Parameter>
<Parameter><Name>RFPEZ1</Name><Value>60</Value></Parameter>
<Parameter><Name>tPPZ1</Name><Value>0.0</Value></Parameter>
<Parameter><Name>tPEZ1</Name><Value>50 ms</Value></Parameter>
<Parameter><Name>OpModePEZ1</Name><Value>Enable</Value></Parameter>
</Block></Block><Block><Name>Zone 2</Name><Block><Name>Setting Group1</Name>
<Parameter><Name>X1PPZ2</Name><Value>40</Value></Parameter>
<Parameter><Name>RFPPZ2</Name><Value>30</Value></Parameter>
<Parameter><Name>OpModePPZ2</Name><Value>Disable</Value></Parameter>
<Parameter><Name>Mystery</Name><Value>7</Value></Parameter>
</Block></Block></Block></CUSTOM></XRIO>
"""

MICOM = """<XRIO><Block><Name>P443</Name>
<Parameter><Name>Active Settings</Name><Value>Group 2</Value></Parameter>
<Parameter><Name>Frequency</Name><Value>50 Hz</Value></Parameter>
<Parameter><Name>Phase CT Primary</Name><Value>1200 A</Value></Parameter>
<Parameter><Name>Phase CT Sec'y</Name><Value>1 A</Value></Parameter>
<Parameter><Name>Main VT Primary</Name><Value>220000 V</Value></Parameter>
<Parameter><Name>Main VT Sec'y</Name><Value>110 V</Value></Parameter>
<Block><Name>GROUP 1</Name><Parameter><Name>Z1 Ph. Reach</Name><Value>1 Ohm</Value></Parameter></Block>
<Block><Name>GROUP 2</Name>
<Parameter><Name>Line Impedance</Name><Value>10 Ohm</Value></Parameter>
<Parameter><Name>Line Angle</Name><Value>78 deg</Value></Parameter>
<Parameter><Name>kZN Res Comp</Name><Value>0.9</Value></Parameter>
<Parameter><Name>kZN Res Angle</Name><Value>-5 deg</Value></Parameter>
<Parameter><Name>Z1 Ph. Reach</Name><Value>8 Ohm</Value></Parameter>
<Parameter><Name>tZ1 Ph. Delay</Name><Value>0 s</Value></Parameter>
<Parameter><Name>Z1 Gnd. Reach</Name><Value>8 Ohm</Value></Parameter>
<Parameter><Name>R1 Gnd. Resistive</Name><Value>12 Ohm</Value></Parameter>
<Parameter><Name>tZ1 Gnd. Delay</Name><Value>20 ms</Value></Parameter>
</Block></Block></XRIO>
"""


def taken_from(folder: Path, text: str, **given: Any) -> tuple[Taken, RelaySettings]:
    path = folder / "given.txt"
    path.write_text(text, encoding="utf-8")
    taken = read_settings(path, Given(**given))
    return taken, RelaySettings.from_dict(settings_dict(taken))


def drawn(settings: RelaySettings, number: int, loops: str) -> np.ndarray:
    """Corners of a zone as the R-X plane shows it, in the settings' own ohms."""
    zone = next(z for z in settings.pdis if z.zone == number and z.loops in (loops, "all"))
    points = polygons(settings, zone)[loops == "phase"] / settings.ohm_ratio
    return points[:, 0] + 1j * points[:, 1]


def same_area(one: np.ndarray, other: np.ndarray) -> float:
    """Part of the first one's area in which the two agree."""
    r, x = np.meshgrid(np.linspace(-40, 60, 500), np.linspace(-40, 60, 500))
    a, b = inside((r + 1j * x).ravel(), one), inside((r + 1j * x).ravel(), other)
    return float(1 - (a ^ b).sum() / a.sum())


def test_rio_of_the_newer_family(tmp_path: Path) -> None:
    taken, settings = taken_from(tmp_path, RIO_1, z1_ohm=Z1)
    assert (settings.relay.ct_ratio, settings.relay.vt_ratio) == (1200, 2000)
    k0 = complex(1.1 * Z1.real, 0.8 * Z1.imag) / Z1
    assert settings.z0_ohm / settings.ohm_ratio == pytest.approx(Z1 * (1 + 3 * k0), rel=1e-6)
    # By hand: reactance 8, resistance 6 parallel to the line, borders at -15 and 115 degrees.
    top = 8 / math.tan(math.radians(78))
    meant = np.array([0, 6 - 1.6077j, top + 6 + 8j, 8 / math.tan(math.radians(115)) + 8j])
    assert same_area(meant, drawn(settings, 1, "phase")) > 0.97
    assert np.abs(drawn(settings, 2, "ground")).max() == pytest.approx(13, rel=1e-4)
    assert drawn(settings, 3, "ground").imag.min() == pytest.approx(-4 * math.sin(math.radians(78)), abs=0.06)
    assert [(z.zone, z.loops, z.direction, z.delay_ms) for z in settings.pdis] == [
        (1, "phase", "forward", 0), (2, "ground", "forward", 400), (3, "all", "reverse", 1200)]  # fmt: skip
    assert settings.ptrc.zones == (1, 2) or list(settings.ptrc.zones) == [1, 2]
    left = "\n".join(taken.left)
    for words in ("MANUFACTURER somebody", "zone Z4: of the loop L1N alone", "zone Z5: LENSTOMATOSHAPE"):
        assert words in left
    assert any("polarized" in line for line in taken.noted)


def test_rio_of_the_older_family(tmp_path: Path) -> None:
    taken, settings = taken_from(tmp_path, RIO_2, z1_ohm=Z1, ct_ratio=240.0, vt_ratio=1000.0)
    assert settings.relay.frequency_hz == 60
    meant = np.array([0, 6 - 1.6077j, 7.7004 + 8j, -3.7305 + 8j])
    assert same_area(meant, drawn(settings, 1, "phase")) > 0.97
    ground = np.array([0, 3 - 0.8038j, 4.7004 + 8j, -3.7305 + 8j])
    # Ours ends at the left, too, as far from the line as at the right: told, with how much is missed.
    assert 0.88 < same_area(ground, drawn(settings, 1, "ground")) < 0.97
    assert any(line.startswith("zone Z1: the quadrilateral misses 11 %") for line in taken.noted)
    one, other = (next(z for z in settings.pdis if z.loops == loops) for loops in ("phase", "ground"))
    assert (one.delay_ms, other.delay_ms) == (50, 0)
    # A circle about the origin is no quadrilateral.
    assert [zone.number for zone in taken.zones] == [1, 1]
    assert any("zone Z5: a quadrilateral would miss" in line for line in taken.left)


def test_sel_text(tmp_path: Path) -> None:
    taken, settings = taken_from(tmp_path, SEL)
    assert (settings.relay.ct_ratio, settings.relay.vt_ratio, settings.relay.frequency_hz) == (240, 600, 60)
    zones = {(z.zone, z.loops): z for z in settings.pdis}
    assert set(zones) == {(1, "phase"), (2, "phase"), (3, "phase"), (1, "ground")}
    assert zones[1, "phase"].reach_ohm == 1.43
    assert zones[1, "phase"].delay_ms == pytest.approx(1e3 * 5 / 60)
    assert (zones[3, "phase"].direction, zones[3, "phase"].delay_ms) == ("reverse", 0)
    quad = zones[1, "ground"]
    assert (quad.reach_ohm or 0) * math.sin(math.radians(75.1)) == pytest.approx(1.30, rel=1e-6)
    corners = drawn(settings, 1, "ground")
    at = corners[np.argmax(corners.real)]
    assert quad.resistive_reach_ground_ohm == 4.0
    in_plane = 4.0 / abs(1 + settings.residual_compensation_factor)
    assert at.real - 1.3 / math.tan(math.radians(75.1)) == pytest.approx(in_plane, rel=0.02)
    assert list(settings.ptrc.zones) == [1, 2]
    assert 'RID = LINE "7"' in taken.left and "E21P = 3" in taken.left
    assert any("3 phase: without Z3PD" in line for line in taken.noted)


def test_xrio_of_abb(tmp_path: Path) -> None:
    taken, settings = taken_from(tmp_path, ABB, z1_ohm=4.8 + 32j, z0_ohm=20 + 96j, frequency_hz=50.0)
    phase, ground = (next(z for z in settings.pdis if z.loops == loops) for loops in ("phase", "ground"))
    assert phase.reach_ohm == pytest.approx(abs(4.08 + 27.2j)) and phase.resistive_reach_ohm == 15
    assert (phase.delay_ms, ground.delay_ms) == (0, 50)
    assert settings.relay.ohms == "primary"
    corners = drawn(settings, 1, "ground")
    in_plane = 60 / abs(1 + settings.residual_compensation_factor)
    assert corners.real.max() == pytest.approx(4.08 + in_plane, rel=0.02)
    assert any(line.endswith("Mystery") for line in taken.left)
    assert "zone 2 phase: off" in taken.left


def test_xrio_of_micom_takes_the_active_group(tmp_path: Path) -> None:
    _, settings = taken_from(tmp_path, MICOM)
    assert settings.z1_ohm / settings.ohm_ratio == pytest.approx(Z1)
    phase, ground = (next(z for z in settings.pdis if z.loops == loops) for loops in ("phase", "ground"))
    assert (phase.reach_ohm, phase.characteristic) == (8, "mho")
    assert (ground.characteristic, ground.delay_ms) == ("quad", 20)
    right = 8 * math.cos(math.radians(78)) + 12 / abs(1 + settings.residual_compensation_factor)
    assert drawn(settings, 1, "ground").real.max() == pytest.approx(right, rel=0.02)


LINE_7 = {
    "testobject.rio": Given(z1_ohm=Z1),
    "protectiondevice.rio": Given(z1_ohm=Z1, ct_ratio=1000.0, vt_ratio=2000.0),
    "SET_1.TXT": Given(),
    "abb.xrio": Given(z1_ohm=2 * Z1, z0_ohm=6.8 * Z1, frequency_hz=50.0),
    "micom.xrio": Given(),
}
"""One line's settings in five formats, and what must be given beside each file."""


@pytest.mark.parametrize("name", LINE_7)
def test_the_same_zones_in_five_formats(name: str, measured: Measured) -> None:
    """Zones 1 and 2 of 8 and 13 ohm forward, zone 4 of 4 ohm reverse; 4, 5 and 3 ohm beside the line between
    phases, 9, 10.8 and 5.4 ohm to ground, which k0 = 0.8 makes 5, 6 and 3 in the plane."""
    taken = read_settings(Path(__file__).with_name("line-7") / name, LINE_7[name])
    settings = RelaySettings.from_dict(settings_dict(taken))
    assert settings.residual_compensation_factor == pytest.approx(0.8, abs=1e-3)
    along = cmath.rect(1.0, math.radians(78))
    for number, reach, phase, ground, delay_ms in ((1, 8, 4, 5, 0), (2, 13, 5, 6, 400), (4, 4, 3, 3, 1200)):
        for loops, resistive in (("phase", phase), ("ground", ground)):
            whole = np.array([1, -1, -1, 1]) * resistive + reach * along * np.array([1, 1, -1, -1])
            whole = cut(whole[::-1], 0j, math.radians(-15), True)
            meant = 2 * cut(whole, 0j, math.radians(115), False)
            found = drawn(settings, number, loops) * settings.ohm_ratio
            same = same_area(meant, -found if number == 4 else found)
            measured("zones of the five formats differ by", 100 * (1 - same), "% of the area")
            assert same > 0.997
            zone = next(z for z in settings.pdis if (z.zone, z.loops) == (number, loops))
            assert (zone.direction, zone.delay_ms) == ("reverse" if number == 4 else "forward", delay_ms)
    assert [(z.zone, z.loops) for z in settings.pdis] == [
        (n, loops) for n in (1, 2, 4) for loops in ("phase", "ground")
    ]


@pytest.mark.parametrize("name", ["ab-mho", "ab-quad"])
def test_rio_that_was_exported_gives_the_same_zones(
    root: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    source = root / "scenarios" / "settings" / f"{name}.toml"
    assert call(["export-settings", str(source), str(tmp_path / "a.rio")]) == 0
    words = capsys.readouterr().out.splitlines()[-1].rpartition("faultloop ")[2].split()
    assert words[-2:] == ["--z1", "6,40"]  # what the file cannot tell
    assert call([*words, "--out", str(tmp_path / "a.toml")]) == 0
    ours, back = load_settings(source), load_settings(tmp_path / "a.toml")
    for zone in ours.pdis:
        for ground in (True, False):
            meant = polygons(ours, zone)[not ground]
            loops = "ground" if ground else "phase"
            again = next(z for z in back.pdis if (z.zone, z.loops) == (zone.zone, loops))
            np.testing.assert_allclose(polygons(back, again)[not ground], meant, atol=1e-4)
    assert list(back.ptrc.zones) == list(ours.ptrc.zones)
    assert back.residual_compensation_factor == pytest.approx(ours.residual_compensation_factor, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty|is no RIO"),
        ("nothing", "is no RIO"),
        (RIO_1.replace("END DISTANCE", ""), "END TESTOBJECT does not end DISTANCE"),
        (RIO_1[:900], "not whole"),
        (RIO_1, "give --z1"),
        (RIO_1.replace("LINEANGLE 78", "LINEANGLE steep"), "LINEANGLE: 'steep'"),
        (RIO_2, "give --z1"),
        ("BEGIN CURVES\nEND CURVES\n", "neither a TESTOBJECT"),
        ("[INFO]\nnothing\n", "has no line NAME"),
        (SEL.replace('"1.43"', '"a lot"'), "Z1P: 'a lot' should be a number"),
        (ABB[:300], "not whole XML"),
        ("<XRIO/>", "neither ABB"),
        ('<!DOCTYPE x [<!ENTITY a "aaaa">]><XRIO>&a;</XRIO>', "document type"),
        ("BEGIN A\n" * 40, "deep"),
    ],
)
def test_wrong_files_are_one_line(
    tmp_path: Path, text: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        read_settings(path, Given())
    assert call(["import", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "set_1.txt"
    path.write_text(SEL, encoding="utf-8")
    assert call(["import", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["kind"] == "SEL text" and len(told["settings"]["pdis"]) == 4 and told["not_taken"]
    assert call(["import", str(path), "--z1", "7"]) == 2
    assert "should be R,X" in capsys.readouterr().err
    assert call(["import", str(path), "--out", str(tmp_path / "x.toml")]) == 0
    assert "4 zones taken" in capsys.readouterr().out
    assert "# Not taken: E21P = 3" in (tmp_path / "x.toml").read_text(encoding="utf-8")


def test_the_picture_has_each_zone_and_the_files_own_shape(tmp_path: Path) -> None:
    """Of the older RIO: both loops of zone 1, and dashed what the file draws, of which 11 % are missed."""
    taken, settings = taken_from(tmp_path, RIO_2, z1_ohm=Z1, ct_ratio=240.0, vt_ratio=1000.0)
    outlines = [Outline(zone.name, zone.loops, zone.shape) for zone in taken.zones]
    figure = draw_zones(settings, "line 7", outlines)
    for axes, loops in zip(figure.axes, ("ground", "phase"), strict=True):
        lines = [np.asarray(line.get_xydata()) for line in axes.lines]
        corners = [xy[:, 0] + 1j * xy[:, 1] for xy in lines if len(xy)]
        ours, theirs = drawn(settings, 1, loops), next(o for o in outlines if o.loops == loops)
        for wanted in (ours, np.array([*theirs.corners, theirs.corners[0]])):
            assert any(len(c) == len(wanted) and np.allclose(c, wanted) for c in corners)
    path = write_zones(settings, tmp_path / "zones.png", outlines=outlines)
    assert path.stat().st_size > 10_000


def test_any_byte_changed_is_taken_or_refused_in_one_line(tmp_path: Path) -> None:
    dice, path = np.random.default_rng(5), tmp_path / "any.txt"
    given = Given(Z1, 3 * Z1, 240.0, 600.0, 50.0)
    for case in range(300):
        data = bytearray((RIO_1, RIO_2, SEL, ABB, MICOM)[case % 5].strip().encode())
        for _ in range(int(dice.integers(1, 4))):
            data[int(dice.integers(len(data)))] = int(dice.integers(256))
        path.write_bytes(data)
        try:
            RelaySettings.from_dict(settings_dict(read_settings(path, given)))
        except InputError as error:
            assert "\n" not in str(error)
