"""From the tables of a scenario to the circuit."""

from __future__ import annotations

from faultloop.errors import InputError
from faultloop.plant.circuit import Circuit
from faultloop.plant.component import PlantTables
from faultloop.plant.line import Line


def circuit_of(tables: PlantTables) -> Circuit:
    """The circuit of all components.  Raises InputError for a network without a unique solution."""
    system = tables.system
    rate = system.sampling_hz * system.steps_per_sample
    circuit = Circuit(rate, float(system.frequency_hz), system.base_kv * 1e3)
    for item in tables.items():
        for line, position in item.cuts(tables):
            circuit.cut(line, [position])
    for item in tables.items():
        item.add(circuit, tables)
    for item in tables.items():
        item.couple(circuit, tables)
    fed = circuit.fed()
    for line in tables.all(Line):
        if line.from_bus not in fed:
            raise InputError(
                f"bus '{line.from_bus}' reaches no source, so its voltage is undefined; "
                "give its island a [[source]] or a line to the rest",
                key=line.key("from"),
            )
    return circuit
