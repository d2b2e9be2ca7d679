"""PTUF: underfrequency (`faultloop.relay.functions.ptof` has the measurement)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from faultloop.jit import njit
from faultloop.relay.functions.function import Function
from faultloop.relay.functions.ptof import CONSTANTS, STATE, FrequencyStage, beyond, check_side, values
from faultloop.relay.quantities import Record

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings


class Ptuf(FrequencyStage):
    """``[[ptuf]]``: one stage of underfrequency."""


def check(settings: RelaySettings) -> None:
    """Of every stage."""
    check_side(settings, "ptuf", -1)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of a stage."""
    beyond(g, q, c, w, -1)


PTUF = Function(
    name="PTUF",
    settings=Ptuf,
    step=step,
    constants=CONSTANTS,
    values=values,
    state=STATE,
    most=4,
    check=check,
)
