"""Any voltage and current of the network, for tests and for people who look inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from faultloop.plant.factor import Factor
from faultloop.plant.network import Model
from faultloop.plant.state import State, renew_switch_currents

Phases = NDArray[np.float64]
"""(3,) of phases A, B, C."""


class Probe:
    """Reads a plant's present values [V, A]; it changes nothing."""

    def __init__(self, model: Model, factor: Factor, state: State) -> None:
        renew_switch_currents(model, factor, state)  # the others are always up to date
        self._model, self._state = model, state

    def nodes(self) -> list[str]:
        """Names of all nodes, as `Circuit` makes them."""
        return list(self._model.row)

    def voltage(self, node: str) -> Phases:
        """Of a bus, ``LINE:from`` or ``LINE:to`` behind a breaker, ``LINE@pu`` of a fault on a line."""
        return self._state.v[self._model.row[node]].copy()

    def terminal_voltage(self, line: str, end: str) -> Phases:
        """At a line's ``from`` or ``to`` end, behind its breaker where there is one."""
        return self.voltage(self._model.circuit.terminals[line, end])

    def line_current(self, line: str, end: str) -> Phases:
        """Into a line from its bus, what a relay there measures."""
        total = np.zeros(3)
        for kind, index, sign in self._model.circuit.terms[line, end]:
            total += sign * self._state.current[self._model.circuit.current_row(kind, index)]
        return total

    def source_current(self, name: str) -> Phases:
        """Out of a source into its bus."""
        return self._state.current[self._model.circuit.number["source", name]].copy()

    def breaker_current(self, name: str) -> Phases:
        """Through a breaker's poles, from bus to line."""
        return self._switch("breaker", name)

    def fault_current(self, name: str) -> Phases:
        """Out of each phase into a fault."""
        return self._switch("fault", name)

    def _switch(self, table: str, name: str) -> Phases:
        return self._state.switch_current[self._model.circuit.number[table, name]].copy()
