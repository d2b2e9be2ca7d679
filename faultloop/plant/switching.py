"""``[[switching]]``: what a breaker does by itself in the run: a line energised, a load taken off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal, Self

from faultloop.config.tables import Name, Poles, Seconds
from faultloop.errors import InputError
from faultloop.plant.breaker import Breaker
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements.switch import Action
from faultloop.plant.network import Model
from faultloop.plant.steady import Steady


class Switching(Component):
    """The contacts part or make at ``at_s`` itself, with no operating time before it; an opening pole then
    conducts on to its current zero."""

    table: ClassVar[str] = "switching"
    letter: ClassVar[str] = "S"

    name: Name = ""
    """S1, S2, ... where not given."""
    breaker: Name
    """Whose poles."""
    operation: Literal["open", "close"]
    """What they do."""
    poles: Poles = "ABC"
    """Which."""
    at_s: Seconds
    """When the contacts make or part."""

    def check(self, tables: PlantTables) -> None:
        tables.find(Breaker, self.breaker, self.key("breaker"))
        tables.within_run(self.at_s, self.key("at_s"))
        for other in tables.all(Switching):
            same = (other.breaker, other.at_s) == (self.breaker, self.at_s) and other.mask & self.mask
            if same and other.operation != self.operation:
                what = f"switching '{other.name}' is to {other.operation} breaker '{self.breaker}' then, too"
                raise InputError(f"{what}; give another time or other poles", key=self.key("at_s"))

    @property
    def mask(self) -> int:
        """Of the poles: A = 1, B = 2, C = 4."""
        return sum(1 << "ABC".index(pole) for pole in self.poles)

    def actions(self, model: Model, steady: Sequence[Steady]) -> tuple[list[Action], list[str]]:
        switch = model.circuit.number[Breaker.table, self.breaker]
        kind = "part" if self.operation == "open" else "make"
        return [Action(round(self.at_s * model.circuit.rate), kind, switch, self.mask, planned=True)], []

    def beginning_at(self, begins_s: float, tables: PlantTables) -> Self | None:
        """What is past is left out: the breaker then is as its `closed` says."""
        if self.at_s < begins_s:
            return None
        return self.model_copy(update={"at_s": self.at_s - begins_s})
