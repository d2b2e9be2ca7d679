"""A campaign made ready: which cases there are, and the scenario and the settings of each."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from faultloop.config.campaign import CampaignTables
from faultloop.config.override import override_settings, set_key, setting_of
from faultloop.config.tables import read_toml
from faultloop.errors import InputError, nearest
from faultloop.loop.inputs import check_settings
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings
from faultloop.relay.layout import instances
from faultloop.study.campaign.condition import Condition
from faultloop.study.campaign.draw import Draws
from faultloop.study.campaign.where import where_of

MOST_COMBINATIONS = 100_000_000
ATTEMPTS = 1000
"""Draws of one case before its conditions count as impossible."""
LOOKED_AT = 2000
"""Cases that a judge must apply to one of."""


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
    """A campaign and its files.  Raises InputError for whatever would make its cases impossible."""

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
        self._numbers: np.ndarray | None = None  # of a grid with conditions: the combinations that remain
        try:
            self.cases = self._count()
            self._check()
        except InputError as error:
            raise error.within(file) from None

    def values(self, case: int) -> dict[str, Any]:
        """Of the varied keys in a case.  Raises InputError where no draw meets the conditions."""
        if self.draws.sampling == "grid":
            return self.draws.at(case if self._numbers is None else int(self._numbers[case]))
        for attempt in range(ATTEMPTS):
            values = self.draws.at(case, attempt)
            if all(condition.holds(values) for condition in self.conditions):
                return values
        raise InputError(f"holds in none of {ATTEMPTS} draws", key="only")

    def case(self, number: int) -> Case:
        """Case `number`, from 0.  Raises InputError where it is impossible."""
        return self.made(number, self.values(number))

    def made(self, number: int, values: Mapping[str, Any]) -> Case:
        """The case with these values."""
        data, own = self.tables_of(values)
        scenario = Scenario.from_dict(data, path=self.files.path, text=self.files.text)
        settings = {}
        for place in scenario.relay:
            path, text, content = own[place.name]
            settings[place.name] = RelaySettings.from_dict(content, path=path, text=text)
        check_settings(scenario, settings, self.user_code)
        return Case(number, dict(values), scenario, settings)

    def tables_of(self, values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, SettingsFile]]:
        """The scenario with these values, as parsed TOML, and each relay's settings by its name."""
        data = copy.deepcopy(self.files.scenario)
        relays = [relay for relay in data.get("relay", []) if isinstance(relay, dict)]
        names = [str(relay.get("name")) for relay in relays]
        changes: list[tuple[str, str, str, Any]] = []
        for key, value in values.items():
            try:
                setting = setting_of(key, names)
                if setting is None:
                    set_key(data, key, value, first=0, said=key)
                else:
                    changes.append((key, *setting, value))
            except InputError as error:
                raise InputError(error.what, file=self.file, key=key) from None
        own = {str(relay.get("name")): self.files.settings_of(str(relay.get("settings"))) for relay in relays}
        for key, name, setting, value in changes:
            path, text, content = own[name]
            try:
                own[name] = path, text, override_settings(content, setting, value)
            except InputError as error:
                raise InputError(error.what, file=self.file, key=key) from None
        return data, own

    @property
    def varies_settings(self) -> bool:
        """Whether cases differ in their relays' settings."""
        return any(key.startswith("relay.") for key in self.keys)

    def _count(self) -> int:
        head = self.tables.campaign
        if head.cases is not None:
            return head.cases
        size = self.draws.grid_size
        if size > MOST_COMBINATIONS:
            raise InputError(
                f"a grid of {size} combinations; at most {MOST_COMBINATIONS} are possible", key="vary"
            )
        if not self.conditions:
            return size
        self._numbers = np.fromiter(self._remaining(size), np.int64)
        if not len(self._numbers):
            raise InputError(f"holds in none of the {size} combinations: there are no cases", key="only")
        return len(self._numbers)

    def _remaining(self, size: int) -> Iterator[int]:
        for number in range(size):
            values = self.draws.at(number)
            if all(condition.holds(values) for condition in self.conditions):
                yield number

    # -- what can be known before the first case is run ------------------------------------------------------

    def _check(self) -> None:
        first = self.values(0)
        for place in range(len(self.tables.vary)):  # first: an end of a range explains more than one case
            for value in self.draws.ends(place):
                self._check_end(place, value, first)
        self._check_judges(self.made(0, first))

    def _check_end(self, place: int, value: Any, first: Mapping[str, Any]) -> None:
        vary = self.tables.vary[place]
        factors = {key: vary.factor.get(key) for key in vary.all_keys}
        own = {key: value if factor is None else value * factor for key, factor in factors.items()}
        values = dict(first) | own
        try:
            if all(condition.holds(values) for condition in self.conditions):
                self.made(0, values)
        except InputError as error:
            told = ", ".join(f"{key} = {own[key]!r}" for key in vary.all_keys)
            raise InputError(
                f"{told} is impossible: {error.what}", file=self.file, key=_where(error, place)
            ) from None

    def _check_judges(self, base: Case) -> None:
        for number, judge in enumerate(self.tables.judge):
            if judge.relay not in base.settings:
                what = f"there is no relay '{judge.relay}'; {nearest(judge.relay, base.settings)}"
                raise InputError(what, key=f"judge[{number}].relay")
            functions = _functions(base.settings[judge.relay])
            if judge.function is not None and judge.function not in functions:
                what = f"relay '{judge.relay}' has no function '{judge.function}'"
                raise InputError(
                    f"{what}; {nearest(judge.function, functions)}", key=f"judge[{number}].function"
                )
        places = {(judge.relay, judge.where) for judge in self.tables.judge if judge.where is not None}
        looked_at = min(self.cases, LOOKED_AT)
        step = self.cases // looked_at if looked_at else 1
        for number in range(0, self.cases, max(step, 1)):
            if not places:
                return
            try:
                case = self.case(number)
            except InputError:  # will be a row with its error
                continue
            for place in case.scenario.relay:
                places.discard((place.name, where_of(case.scenario, place)))
        for number, judge in enumerate(self.tables.judge):
            if (judge.relay, judge.where) in places:
                raise InputError(
                    f"can never apply: in none of {looked_at} cases is a fault {_told(judge.where)} for relay"
                    f" '{judge.relay}'",
                    key=f"judge[{number}].where",
                )


def _functions(settings: RelaySettings) -> list[str]:
    """Names of what can trip."""
    own = [instance.name for instance in instances(settings) if instance.name != "PTRC1"]
    return [*own, *(element.name for element in settings.element)]


def _where(error: InputError, place: int) -> str:
    return f"vary[{place}]" if error.key is None else f"vary[{place}]: {error.key}"


def _told(where: str | None) -> str:
    return "absent" if where == "none" else str(where)
