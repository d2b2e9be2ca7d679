"""Which estimators distance zones take: the others are refused, and these are right in what is shipped."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.relay import RelaySettings
from faultloop.relay.estimators import estimator_methods
from faultloop.relay.estimators.protection import REFUSED
from tests.relay.network import Network, settings_dict

ALLOWED = sorted(set(estimator_methods()) - set(REFUSED))
SOME = ("abc-close-in", "reverse-fault", "zone2-remote-end")


def settings(method: str, **more: object) -> dict:
    return settings_dict(Network(), [{"zone": 1, "reach_pu": 0.8}]) | {
        "estimator": {"method": method, **more}
    }


@pytest.mark.parametrize("method", REFUSED)
def test_a_refused_one_says_why_and_what_would_be_right(method: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(settings(method), path=Path("r.toml"))
    assert (error.value.key, error.value.file) == ("estimator.method", "r.toml")
    assert REFUSED[method] in error.value.what
    assert "kalman-bank" in error.value.what
    assert RelaySettings.from_dict(settings(method, unsafe=True)).estimator.parameters == {}
    no_zones = {key: value for key, value in settings(method).items() if key != "pdis"}
    assert RelaySettings.from_dict(no_zones).estimator.method == method


def test_every_name_is_one() -> None:
    assert set(REFUSED) <= set(estimator_methods())
    assert "kalman-bank" in ALLOWED


def held(root: Path, method: str, name: str) -> None:
    path = root / "scenarios" / f"{name}.toml"
    relays = [relay["name"] for relay in tomllib.loads(path.read_text())["relay"]]
    overrides = [f'relay.{relay}.estimator.method="{method}"' for relay in relays]
    result = faultloop.run(path, overrides=overrides, keep=False)
    assert result.held, [verdict for verdict in result.expectations if not verdict.held]
    assert result.expectations


@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize("method", ALLOWED)
def test_shipped_scenarios(root: Path, method: str, name: str) -> None:
    held(root, method, name)


@pytest.mark.slow
@pytest.mark.parametrize("method", ALLOWED)
def test_every_shipped_scenario(root: Path, method: str) -> None:
    for path in sorted((root / "scenarios").glob("*.toml")):
        if path.stem not in SOME:
            held(root, method, path.stem)
