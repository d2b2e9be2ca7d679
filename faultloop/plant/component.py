"""What a component of the primary system is: one table of a scenario, in one file.

To add one: a subclass of `Component` in a file of its own, and its name in `faultloop.plant.components`
(docs/how-to-add.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from pydantic import Field, PrivateAttr, create_model

from faultloop.config.header import Header, System
from faultloop.config.place import FrontEnd, RelayPlace
from faultloop.config.tables import Name, Table
from faultloop.errors import InputError, nearest
from faultloop.plant.circuit import Circuit
from faultloop.plant.elements.switch import Action
from faultloop.plant.network import Model
from faultloop.plant.steady import Steady


class Component(Table):
    """One item of a scenario's ``[[table]]``: its settings, what must be true of them, and the elements
    (`faultloop.plant.elements`) that it is made up of.

    Only what a component needs is overridden; the methods are called in the order in which they stand here,
    each for all components before the next.
    """

    table: ClassVar[str]
    """Its name in a scenario."""
    least: ClassVar[int] = 0
    most: ClassVar[int | None] = None
    """How many of it a scenario has."""
    letter: ClassVar[str] = ""
    """Items without a name are called by it and their place: F1, F2, ...; none: the name is needed."""

    name: Name
    """Its name, for other tables, `--set` and the log."""

    def key(self, key: str) -> str:
        """Of one of its settings, for a message."""
        return f"{self.table}[{self.name}].{key}"

    def buses(self) -> tuple[str, ...]:
        """Buses that exist because it names them."""
        return ()

    def check(self, tables: PlantTables) -> None:
        """Names that point somewhere, and values that only the whole can judge.  Raises InputError."""

    def cuts(self, tables: PlantTables) -> Iterable[tuple[str, float]]:
        """Places on lines, name and position [pu], where it needs a node."""
        return ()

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        """Its elements.  Components are added in the order of their tuple: a breaker makes the line's end
        before the line is laid."""

    def couple(self, circuit: Circuit, tables: PlantTables) -> None:
        """What it changes of elements that others have added."""

    def actions(self, model: Model, steady: Sequence[Steady]) -> tuple[list[Action], list[str]]:
        """What it does to switches in the run, timed by the state before it; and what a log should say."""
        return [], []

    def beginning_at(self, begins_s: float, tables: PlantTables) -> Self | None:
        """The same in a run that begins so much later; None where it is over."""
        return self

    def as_network(self) -> object:
        """Equal for items that make the same network and the same state before the run."""
        return self


C = TypeVar("C", bound=Component)


class PlantTables(Table):
    """What a plant is built from: the tables of a scenario that stand for the primary system.

    The arrays of components are fields that `with_components` adds.
    """

    components: ClassVar[tuple[type[Component], ...]] = ()

    scenario: Header
    system: System
    relay: tuple[RelayPlace, ...] = Field(default=(), strict=False, max_length=16)
    front_end: FrontEnd = FrontEnd()

    _path: Path | None = PrivateAttr(default=None)

    @property
    def path(self) -> Path | None:
        """The file that they came from."""
        return self._path

    @contextmanager
    def naming_its_file(self) -> Iterator[None]:
        """An InputError within names the file."""
        try:
            yield
        except InputError as error:
            raise error.within(self.path) from None

    def all(self, kind: type[C]) -> tuple[C, ...]:
        """The items of one kind."""
        return getattr(self, kind.table, ())

    def items(self) -> Iterator[Component]:
        """Of every kind, in the order of the tuple."""
        for kind in self.components:
            yield from self.all(kind)

    def find(self, kind: type[C], name: str, key: str) -> C:
        """The item of that name; InputError at ``key`` where there is none."""
        items = {item.name: item for item in self.all(kind)}
        known(name, items, kind.table, key)
        return items[name]

    def known_bus(self, bus: str, key: str, kind: str = "bus") -> None:
        """InputError at ``key`` where no component makes such a bus."""
        known(bus, dict.fromkeys(b for item in self.items() for b in item.buses()), kind, key)

    def within_run(self, start_s: float, key: str) -> None:
        """InputError at ``key`` where something would begin after the run."""
        end = self.scenario.duration_s
        if start_s >= end:
            raise InputError(f"{start_s:g} is not before the end of the run (duration_s = {end:g})", key=key)

    def check(self) -> None:
        """Of all components, and of where relays measure.  Raises InputError."""
        for kind in self.components:
            unique(kind.table, self.all(kind))
        unique("relay", self.relay)
        for item in self.items():
            item.check(self)
        for place in self.relay:
            self._check_place(place)

    def _check_place(self, place: RelayPlace) -> None:
        """The names in a ``[[relay]]`` are each of an item of that table."""
        for table in ("line", "breaker", "ct", "vt"):
            name = getattr(place, table)
            if name is not None:
                names = {item.name: item for item in getattr(self, table, ())}
                known(name, names, table, f"relay[{place.name}].{table}")
        breakers = {item.name: item for item in getattr(self, "breaker", ())}
        for name in place.back_trip:
            known(name, breakers, "breaker", f"relay[{place.name}].back_trip")
            if name == place.breaker:
                what = f"'{name}' is the breaker that fails; name those around it"
                raise InputError(what, key=f"relay[{place.name}].back_trip")
        if place.synchro_vt and not any(
            (b.line, b.end) == (place.line, place.end) for b in breakers.values()
        ):
            what = (
                f"there is no breaker at the '{place.end}' end of line '{place.line}', and so no other side"
            )
            raise InputError(what, key=f"relay[{place.name}].synchro_vt")
        if place.parallel is not None:
            self._check_parallel(place, place.parallel)

    def _check_parallel(self, place: RelayPlace, name: str) -> None:
        key = f"relay[{place.name}].parallel"
        relays = {other.name: other for other in self.relay}
        known(name, relays, "relay", key)
        if relays[name].line == place.line:
            raise InputError(f"'{name}' is on the same line; name the relay of the parallel one", key=key)

    def is_same_network(self, other: PlantTables) -> bool:
        """Whether a plant of ``other`` differs from that of these in nothing but what its switches do, and
        the resistances of its faults."""
        if type(self) is not type(other) or self.scenario.seed != other.scenario.seed:
            return False
        fixed = ("system", "relay", "front_end")
        if any(getattr(self, key) != getattr(other, key) for key in fixed):
            return False
        return all(
            len(own := self.all(kind)) == len(others := other.all(kind))
            and all(a is b or a.as_network() == b.as_network() for a, b in zip(own, others, strict=True))
            for kind in self.components
        )

    def beginning_at(self, begins_s: float) -> Self:
        """The same for a run that begins so much later: waves as they are then, what is past left out."""
        update = {
            kind.table: tuple(
                later for item in self.all(kind) if (later := item.beginning_at(begins_s, self)) is not None
            )
            for kind in self.components
        }
        return self.model_copy(update=update)


T = TypeVar("T", bound=PlantTables)


def with_components(base: type[T], components: Sequence[type[Component]], name: str) -> type[T]:
    """A model ``name`` of ``base`` and an array of tables for each kind of component."""
    fields: dict[str, Any] = {}
    for c in components:
        default = ... if c.least else ()
        field = Field(default=default, strict=False, min_length=c.least, max_length=c.most)
        fields[c.table] = (tuple[c, ...], field)
    model = create_model(name, __base__=base, __module__=base.__module__, **fields)
    model.components = tuple(components)
    return model


def known(name: str, names: Mapping[str, Any], kind: str, key: str) -> None:
    """InputError at ``key`` where ``name`` is not among ``names``."""
    if name not in names:
        raise InputError(f"there is no {kind} '{name}'; {nearest(name, names)}", key=key)


def unique(table: str, items: Iterable[Any]) -> None:
    """InputError where two items have one name."""
    seen: set[str] = set()
    for item in items:
        if item.name in seen:
            raise InputError(f"two of them are called '{item.name}'", key=f"{table}[{item.name}].name")
        seen.add(item.name)
