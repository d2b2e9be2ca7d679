"""What a scenario file may say: the tables of the components, and those that belong to none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field, PrivateAttr

from faultloop.config.bus_fault import check_references as check_bus_faults
from faultloop.config.channel import check_references as check_channels
from faultloop.config.clock import check_references as check_clocks
from faultloop.config.expect import Expect
from faultloop.config.override import apply_override, copied, overridden
from faultloop.config.place import RelayPlace
from faultloop.config.tables import read_toml, validate
from faultloop.errors import InputError
from faultloop.nodes.tables import BusTables
from faultloop.plant.component import known, unique, with_components
from faultloop.plant.components import COMPONENTS


class AnyScenario(BusTables):
    """A scenario but for the components' own tables, which `with_components` adds."""

    expect: tuple[Expect, ...] = Field(default=(), strict=False)

    _text: str = PrivateAttr(default="")

    @property
    def text(self) -> str:
        """The file's text, for the log."""
        return self._text

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], *, path: Path | None = None, text: str = "") -> Self:
        """Validated; raises InputError.  ``path`` is what settings files are relative to."""
        return cls.of_named(cls.named(data), path=path, text=text)

    @classmethod
    def of_named(cls, data: Mapping[str, Any], *, path: Path | None = None, text: str = "") -> Self:
        """`from_dict` of what `named` gave."""
        result = validate(cls, data, path)
        result._path, result._text = path, text
        try:
            result.check()
        except InputError as error:
            raise error.within(path) from None
        return result

    @classmethod
    def read(cls, path: Path | str, overrides: Sequence[str] = ()) -> Self:
        """Read, override (``fault.F1.resistance_ohm=5``) and validate a file; raises InputError."""
        path = Path(path)
        data, text = read_toml(path)

        def read(chosen: Sequence[str]) -> Self:
            changed = cls.named(data)
            for override in chosen:
                apply_override(changed, override)
            return cls.of_named(changed, path=path, text=text)

        return overridden(read, overrides, path)

    @classmethod
    def named(cls, data: Mapping[str, Any]) -> dict[str, Any]:
        """A copy in which items without a name are called by their place: faults F1, F2, ..., those of the
        bus B1, B2, ..."""
        data = {table: copied(value) for table, value in data.items()}
        letters = {kind.table: kind.letter for kind in cls.components if kind.letter} | {"bus_fault": "B"}
        for table, letter in letters.items():
            items = data.get(table)
            if isinstance(items, list):
                data[table] = [
                    {"name": f"{letter}{number}"} | item if isinstance(item, dict) else item
                    for number, item in enumerate(items, 1)
                ]
        return data

    def check(self) -> None:
        """Names that point somewhere, and values that only the whole can judge."""
        super().check()
        relays = {place.name: place for place in self.relay}
        unique("bus_fault", self.bus_fault)
        check_bus_faults(self.bus_fault, relays, [b.name for b in self.breaker], self.scenario.duration_s)
        check_channels(self.channel, self.relay)
        check_clocks(self.clock, relays)
        for number, expect in enumerate(self.expect):
            known(expect.relay, relays, "relay", f"expect[{number}].relay")
            if expect.trip and expect.within_ms is not None and not self.fault:
                raise InputError(
                    "within_ms counts from a fault, and there is none", key=f"expect[{number}].within_ms"
                )

    def settings_path(self, relay: RelayPlace) -> Path:
        """The relay's settings file."""
        base = self._path.parent if self._path else Path()
        return base / relay.settings


if TYPE_CHECKING:

    class Scenario(AnyScenario):
        """A whole scenario.  Build it from a file (`load_scenario`) or a dict (`Scenario.from_dict`)."""

else:
    Scenario = with_components(AnyScenario, COMPONENTS, "Scenario")
    Scenario.__doc__ = "A whole scenario.  Build it from a file (`load_scenario`) or a dict (`from_dict`)."


def load_scenario(path: Path | str, overrides: Sequence[str] = ()) -> Scenario:
    """Read, override (``fault.F1.resistance_ohm=5``) and validate a scenario file; raises InputError."""
    return Scenario.read(path, overrides)
