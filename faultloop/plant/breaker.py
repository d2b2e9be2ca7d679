"""``[[breaker]]`` between a bus and a line end."""

from __future__ import annotations

from typing import ClassVar

from faultloop.config.place import End
from faultloop.config.tables import Milliseconds, Name
from faultloop.errors import InputError
from faultloop.plant.circuit import Circuit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements.switch import Poles
from faultloop.plant.line import Line


class Breaker(Component):
    """Times count from the command to the contacts; an opening pole then conducts on to its current zero."""

    table: ClassVar[str] = "breaker"
    most: ClassVar[int | None] = 16

    line: Name
    """The line that it is in."""
    end: End
    """The end of the line at which it is."""
    operate_ms: Milliseconds = 40.0
    """From the trip frame's reception to the parting of the contacts; each pole opens at its next current
    zero."""
    close_ms: Milliseconds = 80.0
    """From the close frame to the making of the contacts."""
    closed: bool = True
    """Whether its poles conduct when the run begins."""

    def check(self, tables: PlantTables) -> None:
        tables.find(Line, self.line, self.key("line"))
        for other in tables.all(Breaker):
            if other.name == self.name:
                return
            if (other.line, other.end) == (self.line, self.end):
                raise InputError(
                    f"breaker '{other.name}' is already at the '{self.end}' end of line '{self.line}'",
                    key=self.key("end"),
                )

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        line = tables.find(Line, self.line, self.key("line"))
        inner = f"{self.line}:{self.end}"
        number = circuit.add_switch(self.table, self.name, Poles(line.bus(self.end), inner, self.closed))
        circuit.terminals[self.line, self.end] = inner
        circuit.terms[self.line, self.end] = [("switch", number, 1.0)]
