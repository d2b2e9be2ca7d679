"""What a protection function is: one value, made at the end of the module that holds everything about it.

The chain, the records of constants and state, the settings, the bits, the events and the R-X plane are
composed from `faultloop.relay.functions.FUNCTIONS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.config.tables import Table

if TYPE_CHECKING:
    from faultloop.relay.events import Event, Names
    from faultloop.relay.settings import RelaySettings

Polygon = NDArray[np.float64]


class BitsOf(NamedTuple):
    """A constant that is the mask of the first bits of these instances, which only the whole relay knows."""

    names: tuple[str, ...]
    key: str
    """In the settings, where they are from."""


def no_constants(settings: RelaySettings, table: Any) -> Mapping[str, Any]:
    """Of a function without constants of its own."""
    return {}


def no_detail(on: frozenset[str]) -> str:
    """Nothing beside the bit's name."""
    return ""


@dataclass(frozen=True, eq=False)
class Function:
    """A protection function.

    Attributes
    ----------
    name : its logical node class, ``PDIS``; in the settings its table is ``[pdis]``, with ``most`` above 1
        ``[[pdis]]``; the instances are ``PDIS1``, ``PDIS2`` ... in the order of the file.
    settings : the table's model.
    step : the kernel ``step(g, q, c, w)``, called at every sample for each instance, in the order of
        ``FUNCTIONS``: shared constants and quantities (`faultloop.relay.quantities`), its own constants and
        state.
    constants : fields of ``c``.  ``bit`` (where the first of its bits is) and ``number`` (of the instance,
        from 0) are added in front.
    values : ``values(settings, table) -> {field: value}``, in primary values and samples; `BitsOf` for a mask
        of bits.
    state : fields of ``w``; all zero at the start but for ``start``.
    start : first values of state fields that are not zero.
    most : the greatest number of instances.
    always : there without its table, with every default.
    bits : the data objects it shows: "" for the instance itself (``PDIS1.Str``, ``PDIS1.Op``), else a name
        of its own in pickup (``RDIR1.DirFwd``).
    told : whether a change of its bits is an event.
    detail : what stands in the event of a start beside the name, from the names of all bits that are on.
    tell : ``tell(names, was, now) -> events``, called when ``q.notices`` or an output has changed, with the
        instance's state at the last call and now.
    trips : its events may be trips; a user's may always.
    polygons : ``polygons(settings, table) -> (ground, phase)``, closed polygons (k, 2) in the R-X plane, ohm.
    check : ``check(settings)``, what only the whole file can judge; raises InputError without its file.
    """

    name: str
    settings: type[Table]
    step: Callable[..., None]
    constants: tuple[tuple[Any, ...], ...] = ()
    values: Callable[[RelaySettings, Any], Mapping[str, Any]] = no_constants
    state: tuple[tuple[Any, ...], ...] = ()
    start: Mapping[str, Any] | None = None
    most: int = 1
    always: bool = False
    bits: tuple[str, ...] = ("",)
    told: bool = True
    detail: Callable[[frozenset[str]], str] = no_detail
    tell: Callable[[Names, np.void, np.void], Iterable[Event]] | None = None
    trips: bool = False
    polygons: Callable[[RelaySettings, Any], tuple[Polygon, Polygon]] | None = None
    check: Callable[[RelaySettings], None] | None = None

    @property
    def key(self) -> str:
        """Of its table in the settings, and of its records."""
        return self.name.lower()

    @property
    def constants_dtype(self) -> np.dtype:
        """Of ``c``."""
        return np.dtype([("bit", "i8"), ("number", "i8"), *self.constants], align=True)

    @property
    def state_dtype(self) -> np.dtype:
        """Of ``w``."""
        return np.dtype(list(self.state) or [("unused", "i8")], align=True)

    def initial_state(self, count: int) -> NDArray[np.void]:
        """``w`` of as many instances, at the start."""
        state = np.zeros(count, self.state_dtype)
        for key, value in (self.start or {}).items():
            state[key] = value
        return state
