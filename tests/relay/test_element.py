"""A user's own element: the documented one, compiled and as plain Python."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import Relay, RelaySettings, load_settings
from tests.relay.network import Network, play, settings_dict

NETWORK = Network()


def blocks(root: Path, language: str) -> list[str]:
    text = (root / "docs" / "relay.md").read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def with_element(folder: Path, source: str, element: str) -> RelaySettings:
    (folder / "stub.py").write_text(source, encoding="utf-8")
    data = settings_dict(NETWORK, [{"zone": 1, "reach_pu": 0.4}]) | tomllib.loads(element)
    return RelaySettings.from_dict(data, path=folder / "relay.toml")


def test_the_documented_settings_are_valid(root: Path, tmp_path: Path) -> None:
    path = tmp_path / "relay.toml"
    path.write_text(blocks(root, "toml")[0], encoding="utf-8")
    relay = Relay(load_settings(path))
    assert relay.settings.z1_ohm == pytest.approx(3 + 30j)
    assert list(relay.characteristics()) == ["PDIS1", "PDIS2"]


@pytest.mark.parametrize("compiled", [True, False])
def test_the_documented_element_trips(root: Path, tmp_path: Path, compiled: bool) -> None:
    source, element = blocks(root, "python")[0], blocks(root, "toml")[1]
    if not compiled:
        source = source.replace("@njit", "")
    relay = Relay(with_element(tmp_path, source, element))
    assert relay.bits[-1] == "PTOC1"
    events = play(relay, NETWORK.fault("AG", 0.9, duration_s=0.3), block=100)
    start = next(e.sample_count for e in events if e.text == "PTOC1 Str")
    trip = next(e for e in events if e.trip)
    assert (trip.trip.function, trip.trip.zone, trip.trip.loop, trip.trip.poles) == ("PTOC1", 0, "AG", 7)
    assert trip.sample_count - start == 480
    assert not any("PDIS1" in e.text for e in events)


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ("nowhere.py:step", "no such file"),
        ("stub.py:stop", "did you mean 'step'"),
        ("faultloop.nowhere:step", "cannot be imported"),
        ("stub.py:broken", "does not compile"),
    ],
)
def test_a_wrong_element_is_named(tmp_path: Path, function: str, words: str) -> None:
    source = (
        "from numba import njit\n\n\ndef step(state, x, out):\n    pass\n\n\n"
        "@njit\ndef broken(state, x, out):\n    out[0] = unknown\n"
    )
    element = f'[[element]]\nname = "MINE"\nfunction = "{function}"\n'
    with pytest.raises(InputError, match=words) as error:
        Relay(with_element(tmp_path, source, element))
    assert error.value.key == "element[MINE].function"


def test_python_and_compiled_give_the_same_bits(root: Path, tmp_path: Path) -> None:
    source, element = blocks(root, "python")[0], blocks(root, "toml")[1].replace("trip = true", "")
    words = []
    for text in (source, source.replace("@njit", "")):
        relay = Relay(with_element(tmp_path, text, element))
        relay.advance(NETWORK.fault("BG", 0.9, duration_s=0.3))
        words.append((relay.pickup.copy(), relay.operate.copy()))
    assert all(np.array_equal(a, b) for a, b in zip(*words, strict=True))
    assert int(words[0][1][-1]) >> (len(relay.bits) - 1) == 1
