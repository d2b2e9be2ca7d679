"""One value of relay settings, set by its key."""

from __future__ import annotations

import copy

import pytest

from faultloop.config.override import override_settings, setting_of, split_override
from faultloop.errors import InputError
from faultloop.relay import RelaySettings

DATA = {
    "relay": {"frequency_hz": 50},
    "line": {"z1_ohm": [3.0, 30.0], "z0_ohm": [12.0, 90.0]},
    "pdis": [{"zone": 1, "reach_pu": 0.8}, {"zone": 2, "reach_pu": 1.2}],
    "element": [{"name": "MINE", "function": "mine.py:step"}],
}


@pytest.mark.parametrize(
    ("key", "value", "read"),
    [
        ("pdis.1.reach_pu", 0.9, lambda s: s.pdis[0].reach_pu),
        ("pdis.2.delay_ms", 350, lambda s: s.pdis[1].delay_ms),
        ("ptrc.mode", "single-pole", lambda s: s.ptrc.mode),  # a table that was not there
        ("line.z1_ohm", [2.0, 20.0], lambda s: list(s.line.z1_ohm)),
        ("estimator.method", "fourier", lambda s: s.estimator.method),
        ("element.MINE.trip", True, lambda s: s.element[0].trip),
        ("element.1.trip", True, lambda s: s.element[0].trip),
    ],
)
def test_a_setting_is_reached(key: str, value: object, read: object) -> None:
    before = copy.deepcopy(DATA)
    changed = override_settings(DATA, key, value)
    assert read(RelaySettings.from_dict(changed)) == value  # type: ignore[operator]
    assert before == DATA


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("pdis.0.reach_pu", "no pdis '0'; known: 1, 2"),  # from 1, as in PDIS1
        ("pdis.3.reach_pu", "no pdis '3'; known: 1, 2"),
        ("pdis.reach_pu", "name one of pdis"),
        ("element.MINNE.trip", "did you mean 'MINE'?"),
        ("pdis.\u00b2.reach_pu", "no pdis '\u00b2'; known: 1, 2"),  # a digit that is no number
        (f"pdis.{'1' * 5000}.reach_pu", "known: 1, 2"),  # more digits than Python converts
        ("relay.frequency_hz.value", "relay.frequency_hz is not a table"),
        ("ptoc.1.pickup_a", "there is no [[ptoc]]"),
    ],
)
def test_what_is_not_there_is_named(key: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        override_settings(DATA, key, 1.0)
    assert words in error.value.what
    assert f"'{key}'" in error.value.what
    assert error.value.key == "--set"


def test_a_wrong_key_or_value_is_the_settings_affair() -> None:
    for key, value, words in (
        ("pdis.2.reech_pu", 0.9, "reach_pu"),
        ("pdis.2.reach_pu", -1.0, "greater than 0"),
    ):
        with pytest.raises(InputError) as error:
            RelaySettings.from_dict(override_settings(DATA, key, value))
        assert error.value.key == f"pdis[2].{key.rpartition('.')[2]}"
        assert words in error.value.what


def test_a_name_that_is_no_text_is_not_compared() -> None:
    data = {"relay": [{"name": [{}]}, {"name": "RB"}]}
    with pytest.raises(InputError, match="no relay 'RC'; did you mean 'RB'"):
        override_settings(data, "relay.RC.line", "AB")


def test_a_long_value_is_not_repeated_whole() -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(override_settings(DATA, "pdis.2.reach_pu", "x" * 5000))
    assert error.value.what.endswith("xxx...") and len(error.value.what) < 200


def test_more_parts_than_the_scenarios_key_mean_the_setting() -> None:
    relays = ["RA", "RB"]
    assert setting_of("relay.RA.pdis.1.reach_pu", relays) == ("RA", "pdis.1.reach_pu")
    assert setting_of("relay.RA.line.z1_ohm", relays) == ("RA", "line.z1_ohm")
    assert setting_of("relay.1.ptrc.mode", relays) == ("RB", "ptrc.mode")
    assert setting_of("relay.RA.line", relays) is None  # the scenario's own
    assert setting_of("fault.F1.at_pu", relays) is None
    with pytest.raises(InputError, match="did you mean 'RA'"):
        setting_of("relay.R.pdis.1.reach_pu", ["RA"])


@pytest.mark.parametrize(
    ("text", "value"), [("0.9", 0.9), ("[1, 2]", [1, 2]), ("BC", "BC"), (".5", 0.5), ("true", True)]
)
def test_a_value_is_toml_or_a_word(text: str, value: object) -> None:
    assert split_override(f"relay.RA.pdis.1.reach_pu = {text}") == ("relay.RA.pdis.1.reach_pu", value)
