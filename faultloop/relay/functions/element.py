"""A user's own element in the chain: what it said, as bits and as a wish to trip.

The element itself is a plain function, run by `faultloop.relay.users`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from faultloop.config.tables import Number, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.functions.function import Function
from faultloop.relay.quantities import MAX_ELEMENTS, Record, publish, request_trip

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

RESERVED = ("PDIS", "RDIR", "PHS", "PTRC")


class ElementSettings(Table):
    """``[[element]]``: a user's own element."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=32)]
    function: Annotated[str, Field(pattern=r"^.+:[A-Za-z_][A-Za-z0-9_]*$")]
    """``package.module:function``, or ``file.py:function`` relative to the settings file."""
    state: tuple[Number, ...] = Field(default=(), strict=False, max_length=4096)
    """What its state array starts with."""
    trip: bool = False
    """Whether its operate trips."""


def values(settings: RelaySettings, table: ElementSettings) -> dict[str, Any]:
    """Whether it trips."""
    return {"trips": table.trip}


def check(settings: RelaySettings) -> None:
    """Every element has a name of its own."""
    names: set[str] = set()
    for element in settings.element:
        if element.name in names or element.name.startswith(RESERVED):
            what = f"the name '{element.name}' is taken; each element needs its own"
            raise InputError(what, key=f"element[{element.name}].name")
        names.add(element.name)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample; above 0.5 is on."""
    operated = q.user[c.number, 1] > 0.5
    publish(q, c.bit, q.user[c.number, 0] > 0.5, operated)
    if operated and c.trips:
        request_trip(q, c.bit, q.fault, 0)


ELEMENT = Function(
    name="ELEMENT",
    settings=ElementSettings,
    step=step,
    constants=(("trips", "i8"),),
    values=values,
    most=MAX_ELEMENTS,
    check=check,
)
