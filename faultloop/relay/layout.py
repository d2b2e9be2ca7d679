"""The relay's records, composed from ``FUNCTIONS``: constants from the settings, state, the names of bits.

Everything that changes while the relay decides is in one record of type ``STATE`` (plus the loops' and the
estimator's own): a checkpoint is a copy of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.relay import quantities
from faultloop.relay.functions import FUNCTIONS
from faultloop.relay.functions.function import Function
from faultloop.relay.settings import RelaySettings

WORD = 64
FIRST_BITS = ("PDIS", "RDIR", "PHS", "PTRC")
"""The order of bits in logs; other functions follow in the order of ``FUNCTIONS``, a user's elements last."""

COUNTS = np.dtype([(f.key, "i8") for f in FUNCTIONS])
CONSTANTS = np.dtype(
    [
        ("shared", quantities.CONSTANTS),
        ("count", COUNTS),  # instances of each function
        *((f.key, f.constants_dtype, (f.most,)) for f in FUNCTIONS),
    ],
    align=True,
)
STATE = np.dtype(
    [("shared", quantities.QUANTITIES), *((f.key, f.state_dtype, (f.most,)) for f in FUNCTIONS)], align=True
)


@dataclass(frozen=True, eq=False)
class Instance:
    """A function as it is in a relay: its table, its number from 0, its name, and where its bits begin."""

    function: Function
    table: Any
    number: int
    bit: int

    @property
    def name(self) -> str:
        """``PDIS1``, or the table's own ``name``."""
        return getattr(self.table, "name", None) or f"{self.function.name}{self.number + 1}"

    @property
    def bits(self) -> tuple[str, ...]:
        """Names of its bits: ``PDIS1``, or ``RDIR1.DirFwd``."""
        return tuple(f"{self.name}.{bit}" if bit else self.name for bit in self.function.bits)


def instances(settings: RelaySettings) -> tuple[Instance, ...]:
    """The relay's functions in the order of their bits.  Raises InputError for more bits than there are."""
    result, bit = [], 0
    for function in sorted(FUNCTIONS, key=_rank):
        for number, table in enumerate(settings.tables(function)):
            result.append(Instance(function, table, number, bit))
            bit += len(function.bits)
    if bit > WORD:
        what = f"the functions have {bit} bits together, {WORD} is the most; leave some zones or stages out"
        raise InputError(what, file=settings.path)
    return tuple(result)


def _rank(function: Function) -> int:
    """Of a function's bits; ``sorted`` keeps the order of those with the same."""
    if function.name in FIRST_BITS:
        return FIRST_BITS.index(function.name)
    return len(FIRST_BITS) + (function.name == "ELEMENT")


def bit_names(settings: RelaySettings) -> tuple[str, ...]:
    """Name of each bit of ``pickup`` and ``operate``."""
    return tuple(name for instance in instances(settings) for name in instance.bits)


def constants(settings: RelaySettings, settling_samples: int) -> NDArray[np.void]:
    """The settings as one ``CONSTANTS`` record, shape (1,), in primary values and samples."""
    c = np.zeros(1, CONSTANTS)
    _fill(c["shared"][0], quantities.constants(settings, settling_samples))
    for instance in instances(settings):
        function, number = instance.function, instance.number
        c["count"][function.key] += 1
        record = c[function.key][0, number]
        values = function.values(settings, instance.table)
        _fill(record, {"bit": instance.bit, "number": number, **values})
    return c


def _fill(record: np.void, values: dict[str, Any]) -> None:
    """Every field, so that none is forgotten."""
    for key in record.dtype.names or ():
        record[key] = values[key]


def initial_state() -> NDArray[np.void]:
    """A ``STATE`` record, shape (1,), of a relay that has seen nothing."""
    s = np.zeros(1, STATE)
    quantities.clear(s["shared"])
    for function in FUNCTIONS:
        for key, value in (function.start or {}).items():
            s[function.key][key] = value
    return s
