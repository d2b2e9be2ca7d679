"""What a run is made from: a scenario and its relays' settings, from files or objects, and overrides."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from operator import is_
from pathlib import Path
from typing import Any, NamedTuple

from faultloop.config.channel import linked
from faultloop.config.override import (
    PLACE_TABLES,
    SETTING_PARTS,
    overridden,
    set_key,
    setting_of,
    split_override,
)
from faultloop.config.place import RelayPlace
from faultloop.errors import InputError, nearest
from faultloop.loop.scenario import AnyScenario, Scenario
from faultloop.nodes.roster import seal
from faultloop.relay import Relay, RelaySettings, load_settings
from faultloop.relay.functions import FUNCTIONS
from faultloop.relay.functions.pdif import AGREED, REMOTES
from faultloop.relay.named_code import refuse_user_code

Given = RelaySettings | Mapping[str, Any]
"""Settings as an object, or as the dict that a file's TOML would be."""


class Inputs(NamedTuple):
    """Validated, and fit for each other."""

    scenario: Scenario
    settings: dict[str, RelaySettings]


def divided(overrides: Sequence[str]) -> tuple[list[str], list[str]]:
    """Overrides of the scenario, and those of relays' settings (``relay.RA.pdis.1.reach_pu=0.9``)."""
    of_settings = [override for override in overrides if _is_setting(override)]
    return [override for override in overrides if override not in of_settings], of_settings


def _is_setting(override: str) -> bool:
    """More parts than a key of a ``[[relay]]`` has."""
    parts = split_override(override)[0].split(".")
    return parts[0] == "relay" and len(parts) >= SETTING_PARTS and parts[2] not in PLACE_TABLES


def changes_of(overrides: Sequence[str], relay: str, relays: Sequence[str]) -> list[str]:
    """Of the settings' overrides those of one relay, as its file has the keys."""
    found = []
    for override in overrides:
        key, equals, value = override.partition("=")
        setting = setting_of(key.strip(), relays)
        if setting is not None and setting[0] == relay:
            found.append(f"{setting[1]}{equals}{value}")
    return found


def load_inputs(
    scenario: Scenario | Path | str,
    settings: Mapping[str, Given] | None = None,
    overrides: Sequence[str] = (),
    *,
    user_code: bool = True,
) -> Inputs:
    """Read, override, validate.

    Parameters
    ----------
    scenario : a file, or a `Scenario`, whose own keys cannot be overridden.
    settings : by relay, in place of the files that the scenario names.
    overrides : ``"fault.F1.at_pu=0.7"``, ``"relay.RA.pdis.1.reach_pu=0.9"``.

    user_code : whether the settings may name code.

    Raises
    ------
    InputError : anything that is wrong with them; what only the overrides make wrong is told of ``--set``.
    """
    return overridden(lambda chosen: _load(scenario, settings or {}, chosen, user_code), overrides)


def _load(
    scenario: Scenario | Path | str, given: Mapping[str, Given], overrides: Sequence[str], user_code: bool
) -> Inputs:
    own, of_settings = divided(overrides)
    if not isinstance(scenario, AnyScenario):
        scenario = Scenario.read(scenario, own)
    elif own:
        raise InputError(f"'{own[0]}' needs the scenario's file, not a Scenario", key="overrides")
    seal(scenario)  # keys that are wrong are found before anything is compiled
    names = [place.name for place in scenario.relay]
    for name in given:
        if name not in names:
            raise InputError(f"there is no relay '{name}'; {nearest(name, names)}", key="settings")
    found = {
        place.name: _settings(
            scenario, place, given.get(place.name), changes_of(of_settings, place.name, names)
        )
        for place in scenario.relay
    }
    check_settings(scenario, found, user_code)
    return Inputs(scenario, found)


def _settings(
    scenario: Scenario, place: RelayPlace, given: Given | None, changes: Sequence[str]
) -> RelaySettings:
    if given is None:
        return load_settings(scenario.settings_path(place), changes)
    if isinstance(given, RelaySettings) and not changes:
        return given
    if isinstance(given, RelaySettings):
        data = json.loads(given.model_dump_json(by_alias=True, exclude_unset=True))
        path, text = given.path, given.text
    else:
        data, path, text = json.loads(json.dumps(given)), None, ""
    for change in changes:
        set_key(data, *split_override(change), first=1, said=change)
    try:
        return RelaySettings.from_dict(data, path=path, text=text)
    except InputError as error:
        raise error.within(f"settings of relay '{place.name}'") from None


def check_settings(scenario: Scenario, settings: Mapping[str, RelaySettings], user_code: bool = True) -> None:
    """What scenario and settings must agree on, those of two ends among themselves, and whether these may
    name code."""
    for place in scenario.relay:
        if not user_code:
            refuse_user_code(settings[place.name])
        own = settings[place.name].relay
        for key, wanted in (
            ("sampling_hz", scenario.system.sampling_hz),
            ("frequency_hz", scenario.system.frequency_hz),
        ):
            got = getattr(own, key)
            if got != wanted:
                raise InputError(
                    f"is {got} for relay '{place.name}', but the scenario's [system] has {wanted}",
                    file=scenario.settings_path(place),
                    key=f"relay.{key}",
                )
        _check_noise(scenario, place, settings[place.name])
    check_ends(scenario, settings)


class Agreement:
    """`check_settings` of one case after the other: what is as it was is not looked at again."""

    def __init__(self) -> None:
        self._last: tuple[tuple[Any, ...], list[RelaySettings]] | None = None

    def check(
        self, scenario: Scenario, settings: Mapping[str, RelaySettings], user_code: bool = True
    ) -> None:
        """Raises InputError as that does; ``user_code`` must be the same each time."""
        tables = tuple(getattr(scenario, key) for key in OF_AGREEMENT)
        own = list(settings.values())
        last = self._last
        if last is not None and tables == last[0] and all(map(is_, own, last[1])):
            return
        check_settings(scenario, settings, user_code)
        self._last = tables, own


OF_AGREEMENT = ("relay", "system", "front_end", "channel", "can")
"""What of a scenario `check_settings` looks at."""
PICKUPS = {
    "current_noise_a": ("pickup_a", "current_a", "pickup_current_a", "minimum_current_a", "open_current_a"),
    "voltage_noise_v": ("start_v",),
}
"""By the noise of a relay's inputs, the keys of functions whose settings must be above it."""


def _check_noise(scenario: Scenario, place: RelayPlace, settings: RelaySettings) -> None:
    front = place.front_end or scenario.front_end
    for key, names in PICKUPS.items():
        noise, primary = getattr(front, key), settings.amperes if key.endswith("_a") else settings.volts
        if not noise:
            continue  # every pickup is above nothing
        for where, table in _tables(settings):
            for name in names:
                given = getattr(table, name, None)
                if given is not None and primary(given, 0.0) <= noise:
                    of_place = (
                        f"of relay '{place.name}', {noise:g} {key[-1].upper()} primary (front_end.{key})"
                    )
                    least = f"above {noise / primary(1.0, 1.0):.4g}"
                    what = f"{given:g} is not above the noise {of_place}: it would start by itself; {least}"
                    raise InputError(what, file=settings.path, key=f"{where}.{name}")


def _tables(settings: RelaySettings) -> Iterator[tuple[str, Any]]:
    """Those of all functions, with their keys."""
    for function in FUNCTIONS:
        for number, table in enumerate(settings.tables(function), settings.first_place):
            yield f"{function.key}[{number}]" if function.most > 1 else function.key, table


TWO_ENDED = {"psch": ("type", "pole_bits", "transfer"), "pdif": AGREED}
"""Functions that decide at both ends, and what these must have alike."""


def check_ends(scenario: Scenario, settings: Mapping[str, RelaySettings]) -> None:
    """What decides at both ends of a line has a partner that is set alike; raises InputError."""
    for place in scenario.relay:
        for table in TWO_ENDED:
            if getattr(settings[place.name], table) is not None:
                _check_partners(scenario, settings, place.name, table)
        if settings[place.name].pdif is not None and not scenario.can.fd:
            what = f"relay '{place.name}' has [pdif], whose frames have 32 bytes: must be true"
            raise InputError(what, file=scenario.path, key="can.fd")


def _check_partners(
    scenario: Scenario, settings: Mapping[str, RelaySettings], relay: str, table: str
) -> None:
    own, file = getattr(settings[relay], table), settings[relay].path
    partners = linked(scenario.channel, relay)
    if not partners:
        what = f"relay '{relay}' has [{table}], and no [[channel]] of the scenario links it to another"
        raise InputError(what, file=file, key=table)
    if table == "pdif" and len(partners) > REMOTES:
        what = (
            f"relay '{relay}' has channels to {len(partners)} relays; [pdif] compares with {REMOTES} at most"
        )
        raise InputError(what, file=file, key=table)
    for name in partners:
        other = getattr(settings[name], table)
        if other is None:
            what = f"relay '{relay}' has [{table}], and its partner '{name}' has not"
            raise InputError(what, file=file, key=table)
        for key in TWO_ENDED[table]:
            mine, theirs = getattr(own, key), getattr(other, key)
            if mine != theirs:
                what = f"is {mine!r} for relay '{relay}' and {theirs!r} for '{name}'; must be the same"
                raise InputError(what, file=file, key=f"{table}.{key}")


def check_expectations(scenario: Scenario, relays: Mapping[str, Relay]) -> None:
    """The functions that are expected to trip exist, of ``relays``."""
    for number, expect in enumerate(scenario.expect):
        if expect.relay not in relays:
            continue
        bits = relays[expect.relay].bits
        functions = [name for name in bits if "." not in name and name != "PTRC1"]
        if expect.function is not None and expect.function not in functions:
            raise InputError(
                f"relay '{expect.relay}' has no function '{expect.function}';"
                f" {nearest(expect.function, functions)}",
                file=scenario.path,
                key=f"expect[{number}].function",
            )
