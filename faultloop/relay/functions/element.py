"""A user's own function in the chain: called by its address, once the estimator has settled.

It comes after the zones and before the trip logic.  What it is and how it is found: `faultloop.relay.users`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field

from faultloop.config.tables import Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.entry import call_entry
from faultloop.relay.functions.function import Function
from faultloop.relay.quantities import Record, request_trip

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

MAX_ELEMENTS = 8
RESERVED = ("PDIS", "RDIR", "PHS", "PTRC")


class ElementSettings(Table):
    """``[[element]]``: a user's own function, with its own parameters as further keys."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, allow_inf_nan=False)

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=32)]
    """Of its bits, and in a trip; not that of a built-in function."""
    function: Annotated[str, Field(pattern=r"^(.+:)?[A-Za-z_][A-Za-z0-9_-]*$")]
    """``file.py:NAME`` relative to the settings file, ``package.module:NAME``, or an entry point's name."""
    state: tuple[float, ...] = Field(default=(), strict=False, max_length=4096)
    """Of a plain step: what its state array starts with."""
    trip: bool = False
    """Whether its operate trips."""

    @property
    def parameters(self) -> dict[str, Any]:
        """The function's own keys."""
        return dict(self.model_extra or {})


def values(settings: RelaySettings, table: ElementSettings) -> dict[str, Any]:
    """Whether it trips; the addresses come from the function once it is loaded."""
    return {"trips": table.trip, "entry": 0, "constants": 0, "state": 0}


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
    """One sample, after the estimator has settled: before, a phasor is no measurement."""
    if not q.settled:
        return
    call_entry(c.entry, g, q, c.constants, c.state)
    if c.trips and (q.operate >> np.uint64(c.bit)) & np.uint64(1):
        request_trip(q, c.bit, q.fault, 0)


ELEMENT = Function(
    name="ELEMENT",
    settings=ElementSettings,
    step=step,
    constants=(("trips", "i8"), ("entry", "u8"), ("constants", "u8"), ("state", "u8")),
    values=values,
    most=MAX_ELEMENTS,
    check=check,
)
