"""A campaign made ready: which cases there are, and the scenario and the settings of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from faultloop.config.campaign import CampaignTables
from faultloop.config.override import copied, override_settings, set_key, setting_of
from faultloop.config.tables import read_toml
from faultloop.errors import InputError
from faultloop.loop.inputs import Agreement
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings
from faultloop.study.campaign.condition import Condition
from faultloop.study.campaign.draw import Draws
from faultloop.study.campaign.grid import Grid

MOST_COMBINATIONS = 100_000_000
ATTEMPTS = 1000
"""Draws of one case before its conditions count as impossible."""
FIRST = 1000
"""Cases among which there must be one that is possible."""
KEPT_SETTINGS = 1000

Change = tuple[str, str, Any]
"""The campaign's key, the key in the settings, the value."""

SettingsFile = tuple[Path, str, dict[str, Any]]
"""Path, text and parsed content."""


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes
    ----------
    values : of the varied keys.
    """

    number: int
    values: dict[str, Any]
    scenario: Scenario
    settings: dict[str, RelaySettings]


@dataclass
class Files:
    """The scenario and every settings file that a case may want, as parsed TOML.

    Attributes
    ----------
    settings : by the reference in the scenario: the file's path, text and content.
    """

    path: Path
    text: str
    scenario: dict[str, Any]
    settings: dict[str, SettingsFile] = field(default_factory=dict)

    def settings_of(self, reference: str) -> SettingsFile:
        """Read once.  Raises InputError."""
        if reference not in self.settings:
            path = self.path.parent / reference
            data, text = read_toml(path)
            self.settings[reference] = path, text, data
        return self.settings[reference]

    @classmethod
    def read(cls, path: Path) -> Files:
        """Of a scenario file.  Raises InputError."""
        data, text = read_toml(path)
        return cls(path, text, Scenario.named(data))


class Plan:
    """A campaign and its files.  Raises InputError; `check_plan` finds more that is wrong with them."""

    def __init__(
        self, tables: CampaignTables, files: Files, file: object = None, user_code: bool = True
    ) -> None:
        self.tables, self.files, self.file, self.user_code = tables, files, file, user_code
        head = tables.campaign
        self.keys = tuple(key for vary in tables.vary for key in vary.all_keys)
        self.draws = Draws(tables.vary, head.seed, head.sampling)
        self.conditions = [
            Condition(only.when, self.keys, f"only[{number}].when") for number, only in enumerate(tables.only)
        ]
        self._settings: dict[tuple[Any, ...], RelaySettings] = {}
        self._fixed: dict[str, Any] = {}
        """Tables that no case varies, validated: the same objects in every case, so that they need not be
        validated, nor compared with those of the case before, item by item."""
        self._agreement = Agreement()
        self._grid: Grid | None = None
        try:
            self._read_settings()
            self.cases = self._count()
        except InputError as error:
            raise error.within(file) from None

    def values(self, case: int) -> dict[str, Any]:
        """Of the varied keys in a case.  Raises InputError where no draw meets the conditions."""
        if self.draws.sampling == "grid":
            assert self._grid is not None
            return self.draws.at(self._grid.combination(case))
        for attempt in range(ATTEMPTS):
            values = self.draws.at(case, attempt)
            if all(condition.holds(values) for condition in self.conditions):
                return values
        raise InputError(f"holds in none of {ATTEMPTS} draws", key="only")

    @cached_property
    def first(self) -> Case:
        """The first that is possible.  Raises the first one's InputError where none of `FIRST` is."""
        objection: InputError | None = None
        for number in range(min(self.cases, FIRST)):
            try:
                return self.case(number)
            except InputError as error:
                objection = objection or error
        assert objection is not None
        raise objection

    def case(self, number: int) -> Case:
        """Case `number`, from 0.  Raises InputError where it is impossible."""
        return self.made(number, self.values(number))

    def made(self, number: int, values: Mapping[str, Any]) -> Case:
        """The case with these values."""
        data, changes = self._scenario_of(values)
        scenario = Scenario.of_named(data | self._fixed, path=self.files.path, text=self.files.text)
        if not self._fixed:
            varied = {key.partition(".")[0] for key in self.keys}
            self._fixed = {table: getattr(scenario, table) for table in data if table not in varied}
        settings = {
            place.name: self._settings_of(place.settings, changes.get(place.name, ()))
            for place in scenario.relay
        }
        self._agreement.check(scenario, settings, self.user_code)
        return Case(number, dict(values), scenario, settings)

    def key_files(self) -> dict[str, Path]:
        """Key files of authenticated buses that a case may name, by the reference in the scenario."""
        varied = [vary.values or () for vary in self.tables.vary if "can.keys" in vary.all_keys]
        named = {self.files.scenario.get("can", {}).get("keys"), *(str(v) for own in varied for v in own)}
        return {name: self.files.path.parent / name for name in sorted(named - {None})}

    def tables_of(self, values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, SettingsFile]]:
        """The scenario with these values, as parsed TOML, and each relay's settings by its name."""
        data, changes = self._scenario_of(values)
        own = {
            relay["name"]: self._changed(relay["settings"], changes.get(relay["name"], ()))
            for relay in data["relay"]
        }
        return data, own

    def _scenario_of(self, values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, list[Change]]]:
        """The scenario as parsed TOML, and what is changed in the settings of each relay."""
        touched = {key.partition(".")[0] for key in values}
        data = {
            table: copied(value) if table in touched else value
            for table, value in self.files.scenario.items()
        }
        relays = [relay for relay in data.get("relay", []) if isinstance(relay, dict)]
        names = [str(relay.get("name")) for relay in relays]
        changes: dict[str, list[Change]] = {}
        for key, value in values.items():
            try:
                setting = setting_of(key, names)
                if setting is None:
                    set_key(data, key, value, first=0, said=key)
                else:
                    changes.setdefault(setting[0], []).append((key, setting[1], value))
            except InputError as error:
                raise InputError(error.what, file=self.file, key=key) from None
        return data, changes

    def _settings_of(self, reference: str, changes: Sequence[Change]) -> RelaySettings:
        """Validated once for each content."""
        key = (reference, *((setting, repr(value)) for _, setting, value in changes))
        if key not in self._settings:
            path, text, content = self._changed(reference, changes)
            if len(self._settings) >= KEPT_SETTINGS:
                self._settings.clear()
            self._settings[key] = RelaySettings.from_dict(content, path=path, text=text)
        return self._settings[key]

    def _changed(self, reference: str, changes: Sequence[Change]) -> SettingsFile:
        path, text, content = self.files.settings_of(reference)
        for key, setting, value in changes:
            try:
                content = override_settings(content, setting, value)
            except InputError as error:
                raise InputError(error.what, file=self.file, key=key) from None
        return path, text, content

    def network(self, values: Mapping[str, Any]) -> str:
        """The same for cases with the same settings and the same network before the fault."""
        return repr([values[key] for key in self.keys if not of_fault(key)])

    def _read_settings(self) -> None:
        """Every file that a case may name, so that the campaign's file can carry it."""
        for vary in self.tables.vary:
            for key in vary.all_keys:
                parts = key.split(".")
                if parts[0] == "relay" and parts[2:] == ["settings"]:
                    for reference in vary.values or ():
                        self.files.settings_of(str(reference))

    def _count(self) -> int:
        head = self.tables.campaign
        if head.cases is not None:
            return head.cases
        size = self.draws.grid_size
        if size > MOST_COMBINATIONS:
            raise InputError(
                f"a grid of {size} combinations; at most {MOST_COMBINATIONS} are possible", key="vary"
            )
        self._grid = Grid(self.draws, self.conditions)
        return len(self._grid)


def of_fault(key: str) -> bool:
    """Whether it leaves the settings, and the network before the fault, as they are."""
    table, *_, name = key.split(".")
    return table in ("scenario", "fault") and name not in ("line", "at_pu", "at_km", "bus")
