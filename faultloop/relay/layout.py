"""The relay's records, composed from ``FUNCTIONS``: constants from the settings, state, the names of bits.

Everything that changes while the relay decides is in one record of type ``STATE`` (plus the loops' and the
estimator's own): a checkpoint is a copy of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.relay import quantities
from faultloop.relay.functions import FUNCTIONS
from faultloop.relay.functions.element import ELEMENT
from faultloop.relay.functions.function import BitsOf, Function
from faultloop.relay.settings import RelaySettings
from faultloop.relay.users import UserElement

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
    """A function as it is in a relay: its name, its table, its number from 0, and where its bits begin."""

    name: str
    function: Function
    table: Any
    number: int
    bit: int
    """Its first bit in the log."""
    user: UserElement | None = None
    """The user's own element that it is."""

    @property
    def bits(self) -> tuple[str, ...]:
        """Names of its bits: ``PDIS1``, or ``RDIR1.DirFwd``."""
        return tuple(f"{self.name}.{bit}" if bit else self.name for bit in self.function.bits)


def instances(settings: RelaySettings, users: Sequence[UserElement] = ()) -> tuple[Instance, ...]:
    """The relay's functions in the order of their bits.  Raises InputError for more bits than there are."""
    result: list[Instance] = []
    bit = 0
    for name, function, table, number, user in _in_order(settings, users):
        if any(name == other.name for other in result):
            what = f"the name '{name}' is taken; each element needs its own"
            raise InputError(what, file=settings.path, key=f"element[{name}].name")
        result.append(Instance(name, function, table, number, bit, user))
        bit += len(function.bits)
    if bit > WORD:
        what = f"the functions have {bit} bits together, {WORD} is the most; leave some zones or stages out"
        raise InputError(what, file=settings.path)
    return tuple(result)


def _in_order(settings: RelaySettings, users: Sequence[UserElement]) -> Iterator[tuple[Any, ...]]:
    for function in sorted(FUNCTIONS, key=_rank):
        if function is not ELEMENT:
            for number, table in enumerate(settings.tables(function)):
                yield f"{function.name}{number + 1}", function, table, number, None
    for number, user in enumerate(users):
        yield user.name, user.function, user.table, number, user


def _rank(function: Function) -> int:
    """Of a function's bits; ``sorted`` keeps the order of those with the same."""
    return FIRST_BITS.index(function.name) if function.name in FIRST_BITS else len(FIRST_BITS)


def constants(settings: RelaySettings, settling_samples: int, places: Sequence[Instance]) -> NDArray[np.void]:
    """The settings as one ``CONSTANTS`` record, shape (1,), in primary values and samples."""
    c = np.zeros(1, CONSTANTS)
    _fill(c["shared"][0], quantities.constants(settings, settling_samples))
    for place in places:
        function, table = place.function, place.table
        values: dict[str, Any] = {"bit": place.bit, "number": place.number}
        if place.user is not None:
            for key, value in values.items():
                place.user.constants[key] = value
            function, table = ELEMENT, settings.element[place.number]
            values |= place.user.addresses
        c["count"][function.key] += 1
        own = {
            key: _mask(value, settings, places) if isinstance(value, BitsOf) else value
            for key, value in function.values(settings, table).items()
        }
        _fill(c[function.key][0, place.number], own | values)
    return c


def _mask(wanted: BitsOf, settings: RelaySettings, places: Sequence[Instance]) -> int:
    """Of the first bits of the instances.  Raises InputError for one that is not there."""
    bits = {place.name: place.bit for place in places}
    for name in wanted.names:
        if name not in bits:
            what = f"there is no function '{name}'; {nearest(name, bits)}"
            raise InputError(what, file=settings.path, key=wanted.key)
    return sum(1 << bits[name] for name in set(wanted.names))


def _fill(record: np.void, values: dict[str, Any]) -> None:
    """Every field, so that none is forgotten."""
    for key in record.dtype.names or ():
        record[key] = values[key]


def initial_state() -> NDArray[np.void]:
    """A ``STATE`` record, shape (1,), of a relay that has seen nothing."""
    s = np.zeros(1, STATE)
    quantities.clear(s["shared"])
    for function in FUNCTIONS:
        s[function.key][0] = function.initial_state(function.most)
    return s


def neighbours(state: NDArray[np.void], names: tuple[str, ...]) -> NDArray[np.int64]:
    """Neighbouring integers of the shared quantities as one array, a view: 0.2 us to read them, not each."""
    fields: Any = quantities.QUANTITIES.fields
    places = [fields[name][1] for name in names]
    first, end = places[0], places[0] + 8 * len(names)
    if places != list(range(first, end, 8)):
        raise ValueError(f"{', '.join(names)} are no neighbours")
    begin = (STATE.fields or {})["shared"][1]
    return state.view(np.uint8)[begin + first : begin + end].view(np.int64)


def record_of(state: NDArray[np.void], place: Instance) -> np.void:
    """The state of one function: a view."""
    return state[place.function.key][0, place.number] if place.user is None else place.user.state[0]
