"""A campaign file: many cases of one scenario, and what is right in each."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from faultloop.config.expect import Expect
from faultloop.config.tables import Number, Positive, Table

Sampling = Literal["grid", "random", "sobol"]
Where = Literal["inside", "beyond", "behind", "none"]


def _key(value: str) -> str:
    parts = value.split(".")
    if len(parts) < 2 or not all(part.strip() == part and part for part in parts):
        raise ValueError("must be table.key or array.name.key, as in fault.F1.at_pu")
    return value


def _range(value: Any) -> Any:
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise ValueError("must be [from, to, count]")
    if isinstance(value[2], bool) or not isinstance(value[2], int) or not 1 <= value[2] <= 1_000_000:
        raise ValueError(f"count must be a whole number from 1 to 1000000, not {value[2]!r}")
    if value[2] == 1 and value[0] != value[1]:
        raise ValueError("a count of 1 needs from and to to be the same")
    return value


def _rising(value: tuple[float, float]) -> tuple[float, float]:
    if not value[0] < value[1]:
        raise ValueError("must be [low, high] with low < high")
    return value


def _positive_rising(value: tuple[float, float]) -> tuple[float, float]:
    if not 0 < value[0] < value[1]:
        raise ValueError("must be [low, high] with 0 < low < high")
    return value


def _spread(value: tuple[float, float]) -> tuple[float, float]:
    if value[1] <= 0:
        raise ValueError("must be [mean, deviation] with a deviation above 0")
    return value


Key = Annotated[str, Field(max_length=200), AfterValidator(_key)]
Finite = Annotated[Number, Field(allow_inf_nan=False)]
Pair = Annotated[tuple[Finite, Finite], Field(strict=False)]


class Header(Table):
    """``[campaign]``: which scenario, how many cases, drawn how."""

    name: str = Field(min_length=1, max_length=200)
    """What reports call it."""
    scenario: str = Field(min_length=1)
    """Path of the scenario, relative to the campaign file."""
    cases: int | None = Field(default=None, ge=1, le=100_000_000)
    """How many are drawn; a grid counts its own."""
    seed: int = Field(default=1, ge=0, lt=2**63)
    """Of the draws; a case's draw depends on it, its number and its place."""
    sampling: Sampling
    """Every combination; independent draws; a scrambled Sobol sequence."""

    @model_validator(mode="after")
    def _counted(self) -> Header:
        if self.sampling == "grid" and self.cases is not None:
            raise ValueError("cases cannot stand with a grid, which has as many as its values make")
        if self.sampling != "grid" and self.cases is None:
            raise ValueError(f'sampling = "{self.sampling}" needs cases')
        return self


class Vary(Table):
    """``[[vary]]``: one key, or several with the same draw, and what it takes."""

    key: Key | None = None
    """One key of the scenario, as in `--set`, or of a relay's settings."""
    keys: tuple[Key, ...] = Field(default=(), strict=False, max_length=64)
    """Several keys that get one draw."""
    values: tuple[Any, ...] | None = Field(default=None, strict=False, min_length=1, max_length=1_000_000)
    """Each of them, or one drawn evenly."""
    range: Annotated[tuple[Finite, Finite, int], BeforeValidator(_range)] | None = Field(
        default=None, strict=False
    )
    """``[from, to, count]``: so many evenly spaced values, both ends included."""
    uniform: Annotated[Pair, AfterValidator(_rising)] | None = None
    """[low, high]: drawn evenly."""
    log_uniform: Annotated[Pair, AfterValidator(_positive_rising)] | None = None
    """[low, high]: its logarithm is drawn evenly."""
    normal: Annotated[Pair, AfterValidator(_spread)] | None = None
    """``[mean, deviation]``"""
    factor: dict[Key, Finite] = Field(default_factory=dict, max_length=64)
    """More keys that get the draw times a number."""

    @model_validator(mode="after")
    def _one_of_each(self) -> Vary:
        if (self.key is None) == (not self.keys):
            raise ValueError("give either key or keys")
        given = [name for name in KINDS if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of {', '.join(KINDS)}, not {' and '.join(given) or 'none'}")
        if self.factor and not all(_is_number(value) for value in self.values or ()):
            raise ValueError("factor needs values that are numbers")
        for value in self.values or ():
            _check_value(value)
        return self

    @property
    def is_draw(self) -> bool:
        """Whether it has no values to go through one by one."""
        return self.values is None and self.range is None

    @property
    def all_keys(self) -> tuple[str, ...]:
        """Every key that it sets."""
        own = (self.key,) if self.key is not None else self.keys
        return (*own, *(key for key in self.factor if key not in own))

    def listed(self) -> tuple[Any, ...]:
        """The values of `values` or `range`."""
        if self.values is not None:
            return self.values
        assert self.range is not None
        low, high, count = self.range
        return tuple(low + (high - low) * i / max(count - 1, 1) for i in range(count))


KINDS = ("values", "range", "uniform", "log_uniform", "normal")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _check_value(value: Any) -> None:
    items = value if isinstance(value, list) else [value]
    for item in items:
        if not isinstance(item, (bool, int, float, str)):
            raise ValueError(f"values must be numbers, texts, true or false, or lists of them, not {item!r}")
        if isinstance(item, float) and not math.isfinite(item):
            raise ValueError(f"values must be finite, not {item!r}")
        if isinstance(item, int) and not -(2**63) <= item < 2**63:
            raise ValueError(f"{item} has more than 64 bits")


class Only(Table):
    """``[[only]]``: a condition over the varied keys."""

    when: str = Field(min_length=1, max_length=2000)
    """Of the varied keys: numbers, texts, + - * / %, comparisons, in, and, or, not, abs, min, max."""


class Judge(Expect):
    """``[[judge]]``: an `[[expect]]` for the cases whose fault is ``where`` this says; for all without it."""

    where: Where | None = None
    """Where the fault is, seen from the relay's line; all cases where not given."""
    within_ms: Positive | None = None
    """Received by the breaker at most this long after the fault's start."""


class CampaignTables(Table):
    """The whole file."""

    campaign: Header
    vary: tuple[Vary, ...] = Field(min_length=1, max_length=64, strict=False)
    only: tuple[Only, ...] = Field(default=(), max_length=64, strict=False)
    judge: tuple[Judge, ...] = Field(default=(), max_length=256, strict=False)

    @model_validator(mode="after")
    def _together(self) -> CampaignTables:
        seen: set[str] = set()
        for number, vary in enumerate(self.vary):
            if self.campaign.sampling == "grid" and vary.is_draw:
                raise ValueError(f"vary[{number}]: a grid takes values or range, not a draw")
            for key in vary.all_keys:
                if key in seen:
                    raise ValueError(f"vary[{number}]: {key} is varied twice")
                seen.add(key)
        return self
