"""What both ends of a line must agree on, and the channel between them: refused with one line."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from faultloop.errors import InputError
from faultloop.loop.inputs import load_inputs
from faultloop.loop.scenario import Scenario


def refused(root: Path, change: Any = None, *overrides: str) -> tuple[str | None, str]:
    path = root / "scenarios" / "pott.toml"
    data = tomllib.loads(path.read_text())
    if change is not None:
        change(data)
    with pytest.raises(InputError) as error:
        if overrides:
            load_inputs(path, None, overrides)
        else:
            load_inputs(Scenario.from_dict(data, path=path))
    return error.value.key, error.value.what


@pytest.mark.parametrize(
    ("change", "key", "what"),
    [
        (
            lambda d: d.pop("channel"),
            "psch",
            "relay 'RA' has [psch], and no [[channel]] of the scenario links it to another",
        ),
        (
            lambda d: d["channel"][0].update(to="RX"),
            "channel[0].to",
            "there is no relay 'RX'; did you mean 'RB'?",
        ),
        (
            lambda d: d["channel"].append({"from": "RB", "to": "RA"}),
            "channel[1]",
            "'RB' and 'RA' have one already; it goes both ways",
        ),
        (
            lambda d: d["relay"][1].update(settings="settings/ab-mho.toml"),
            "psch",
            "relay 'RA' has [psch], and its partner 'RB' has not",
        ),
    ],
)
def test_a_channel_and_a_partner(root: Path, change: Any, key: str, what: str) -> None:
    assert refused(root, change) == (key, what)


def test_ends_that_do_not_agree(root: Path) -> None:
    assert refused(root, None, "relay.RB.psch.type='putt'") == (
        f"{root / 'scenarios' / 'settings' / 'ab-pott.toml'}: psch.type",
        "is 'pott' for relay 'RA' and 'putt' for 'RB'; must be the same",
    )
