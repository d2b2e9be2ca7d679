"""Settings: what is refused and how it is said; one unit system inside."""

from __future__ import annotations

import copy
import math
from pathlib import Path

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import Relay, RelaySettings, layout, load_settings

GOOD = {
    "relay": {"frequency_hz": 50},
    "line": {"z1_ohm": [3.0, 30.0], "z0_ohm": [12.0, 90.0]},
    "pdis": [{"zone": 1, "reach_pu": 0.8}],
}


def changed(path: str, value: object) -> dict:
    data = copy.deepcopy(GOOD)
    here: object = data
    parts = path.split(".")
    for part in parts[:-1]:
        here = here[int(part)] if isinstance(here, list) else here.setdefault(part, {})  # type: ignore[union-attr]
    if value is None:
        del here[parts[-1]]  # type: ignore[attr-defined]
    else:
        here[parts[-1]] = value  # type: ignore[index]
    return data


def zone_constants(settings: RelaySettings) -> np.void:
    """Of the first zone."""
    return layout.constants(settings, 96, layout.instances(settings))["pdis"][0, 0]


def test_a_short_file_is_enough() -> None:
    settings = RelaySettings.from_dict(GOOD)
    assert settings.relay.sampling_hz == 4800
    assert settings.residual_compensation_factor == pytest.approx((9 + 60j) / (9 + 90j))


@pytest.mark.parametrize(
    ("path", "value", "key", "words"),
    [
        ("pdis.0.reach_p", 0.8, "pdis[1].reach_p", "did you mean 'reach_pu'?"),
        ("pdis.0.reach_pu", -1.0, "pdis[1].reach_pu", "greater than 0"),
        ("pdis.0.reach_ohm", 20.0, "pdis[1]", "either reach_pu"),
        ("pdis.0.characteristic", "quad", "pdis[1]", "resistive_reach_ohm"),
        ("pdis.0.direction", "forwards", "pdis[1].direction", "'forward', 'reverse' or 'none'"),
        ("pdis.0.residual_compensation_factor", {"magnitude": 1.0}, "pdis[1].residual", "angle_deg"),
        ("line.z1_ohm", [3.0], "line.z1_ohm", "2 numbers"),
        ("line.z0_ohm", None, "line.z0_ohm", "missing"),
        ("line.z1_ohm", [-3.0, 30.0], "line", "r >= 0"),
        ("relay.ohms", "secondary", "relay", "ct_ratio and vt_ratio"),
        ("relay.sampling_hz", "4800", "relay.sampling_hz", "integer"),
        ("ptrc.zones", [1, 4], "ptrc.zones", "no zone 4"),
        ("rdir.z2_reverse_pu", 0.1, "rdir", "above z2_forward_pu"),
        ("psof.delay_ms", 500.0, "psof", "below armed_ms, 500, not 500: it would never operate"),
        ("psof.armed_ms", 20.0, "psof", "below armed_ms, 20, not 25"),
        ("element", [{"name": "PDIS9", "function": "math:sqrt"}], "element[PDIS9].name", "taken"),
    ],
)
def test_what_is_wrong_is_named(path: str, value: object, key: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(changed(path, value))
    assert (error.value.key or "").startswith(key)
    assert words in error.value.what


@pytest.mark.parametrize(
    ("estimator", "key"),
    [({"method": "fourrier"}, "estimator.method"), ({"method": "fourier", "tau": 3}, "estimator.tau")],
)
def test_an_unknown_estimator_names_file_and_key(tmp_path: Path, estimator: dict, key: str) -> None:
    path = tmp_path / "line.toml"
    with pytest.raises(InputError) as error:
        Relay(RelaySettings.from_dict(GOOD | {"estimator": estimator}, path=path))
    assert error.value.key == key
    assert error.value.file == str(path)


def test_a_file_keeps_its_text_and_a_broken_one_is_named(tmp_path: Path) -> None:
    path = tmp_path / "line.toml"
    text = "# mine\n[relay]\nfrequency_hz = 50\n[line]\nz1_ohm = [3, 30]\nz0_ohm = [12, 90]\n"
    path.write_text(text, encoding="utf-8")
    assert load_settings(path).text == text
    path.write_text(text + "[[pdis]\n", encoding="utf-8")
    with pytest.raises(InputError, match="not valid TOML"):
        load_settings(path)


def test_secondary_settings_are_the_primary_ones_scaled() -> None:
    """CT 240, VT 600: an ohm secondary is 600 / 240 ohm primary, an ampere 240 A."""
    zone = {"zone": 1, "reach_ohm": 24.0, "characteristic": "quad", "resistive_reach_ohm": 30.0}
    primary = GOOD | {"pdis": [zone | {"minimum_current_a": 120.0}]}
    ohm, ampere = 240 / 600, 1 / 240
    scaled = zone | {
        "reach_ohm": 24 * ohm,
        "resistive_reach_ohm": 30 * ohm,
        "minimum_current_a": 120 * ampere,
    }
    secondary = {
        "relay": {"frequency_hz": 50, "ohms": "secondary", "ct_ratio": 240.0, "vt_ratio": 600.0},
        "line": {key: [v * ohm for v in z] for key, z in GOOD["line"].items()},
        "pdis": [scaled],
    }
    one, two = (zone_constants(RelaySettings.from_dict(d)) for d in (primary, secondary))
    for name in one.dtype.names or ():
        assert complex(one[name]) == pytest.approx(complex(two[name]), rel=1e-12), name


def test_k0_by_magnitude_and_angle() -> None:
    zone = {"zone": 1, "reach_pu": 1.0, "residual_compensation_factor": {"magnitude": 0.7, "angle_deg": -10}}
    settings = RelaySettings.from_dict(GOOD | {"pdis": [zone]})
    k0 = complex(zone_constants(settings)["k0"])
    assert k0 == pytest.approx(0.7 * complex(math.cos(math.radians(-10)), math.sin(math.radians(-10))))


def test_polygons_contain_the_reach_on_their_border() -> None:
    zones = [
        {"zone": 1, "reach_pu": 0.8},
        {"zone": 2, "reach_pu": 1.2, "characteristic": "quad", "resistive_reach_ohm": 20.0},
        {"zone": 3, "reach_pu": 0.5, "direction": "reverse", "loops": "phase"},
    ]
    polygons = Relay(RelaySettings.from_dict(GOOD | {"pdis": zones})).characteristics()
    for name, reach, kinds in (("PDIS1", 0.8, (0, 1)), ("PDIS2", 1.2, (1,)), ("PDIS3", -0.5, (1,))):
        for kind in kinds:
            polygon = polygons[name][kind]
            target = reach * (3 + 30j)
            side = polygon[:-1] @ [1, 1j], polygon[1:] @ [1, 1j]
            along = [abs(a - target) + abs(b - target) - abs(b - a) for a, b in zip(*side, strict=True)]
            assert min(along) < 1e-2
            assert (polygon[0] == pytest.approx(polygon[-1])) is True
    assert len(polygons["PDIS3"][0]) == 0
