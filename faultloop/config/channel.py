"""What a scenario file may say of the way from one line end to the other: ``[[channel]]``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Any

from pydantic import Field, model_validator

from faultloop.config.tables import Name, Seconds, Table
from faultloop.errors import InputError, nearest

Delay = Annotated[float, Field(ge=0, le=200)]
"""[ms]; what is longer carries no protection."""
Times = Annotated[tuple[Annotated[float, Field(ge=0, le=1e6)], ...], Field(strict=False, max_length=4)]


class Channel(Table):
    """``[[channel]]``: carries pilot signals and differential data of two relays, in both directions.

    It is behind the bus: a frame that a relay sends is on its own station's bus first, and reaches the relay
    at the other end so much later.  In a channel nothing overtakes.
    """

    from_relay: Name = Field(alias="from")
    """One relay ..."""
    to_relay: Name = Field(alias="to")
    """... and the other; a relay may have channels to several."""
    delay_ms: Delay = 0.0
    """Of each frame; 0 is the bus alone."""
    asymmetry_ms: Annotated[float, Field(ge=-200, le=200)] = 0.0
    """By how much longer the way there takes than the way back: half more there, half less back."""
    jitter_ms: Delay = 0.0
    """Uniformly distributed, 0 to this, added to each frame's delay."""
    loss: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Probability of a frame being lost."""
    reset_ms: Delay = 0.0
    """A pilot signal that ends arrives so much later; one that returns meanwhile has never ended."""
    out_at_s: Seconds | None = None
    """From then on nothing arrives ..."""
    out_for_s: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """... for so long; to the end where not given."""
    switch_at_s: Times = ()
    """Another path is taken from then on ..."""
    switch_delay_ms: Annotated[tuple[Delay, ...], Field(strict=False, max_length=4)] = ()
    """... with this delay ..."""
    switch_asymmetry_ms: Annotated[
        tuple[Annotated[float, Field(ge=-200, le=200)], ...], Field(strict=False, max_length=4)
    ] = ()
    """... and this asymmetry; the one of before where not given."""
    misrouted: Name | None = None
    """A relay whose frames arrive at `to` in place of those of `from` ..."""
    misrouted_at_s: Seconds = 0.0
    """... from then on."""

    @model_validator(mode="after")
    def _paths(self) -> Channel:
        if self.from_relay == self.to_relay:
            raise ValueError(f"it is between two relays, not from '{self.from_relay}' to itself")
        if len(self.switch_at_s) != len(self.switch_delay_ms):
            raise ValueError("switch_at_s and switch_delay_ms must be of the same length")
        if self.switch_asymmetry_ms and len(self.switch_asymmetry_ms) != len(self.switch_at_s):
            raise ValueError("switch_asymmetry_ms must be of the same length as switch_at_s, or left out")
        if list(self.switch_at_s) != sorted(self.switch_at_s):
            raise ValueError("switch_at_s must go up")
        for _, delay, asymmetry in self.paths:
            if abs(asymmetry) > 2 * delay:
                raise ValueError(
                    f"asymmetry {asymmetry:g} ms needs a delay of {abs(asymmetry) / 2:g} ms, not {delay:g}"
                )
        if self.out_for_s is not None and self.out_at_s is None:
            raise ValueError("out_for_s needs out_at_s")
        return self

    @property
    def paths(self) -> tuple[tuple[float, float, float], ...]:
        """From when [s], delay and asymmetry [ms] of each path that it takes in the run."""
        asymmetries = self.switch_asymmetry_ms or (self.asymmetry_ms,) * len(self.switch_at_s)
        switched = zip(self.switch_at_s, self.switch_delay_ms, asymmetries, strict=True)
        return ((0.0, self.delay_ms, self.asymmetry_ms), *switched)


def linked(channels: Iterable[Channel], relay: str) -> list[str]:
    """The relays that a relay has a channel to, in the order of the tables."""
    ends = [(c.from_relay, c.to_relay) for c in channels]
    return [other for a, b in ends for own, other in ((a, b), (b, a)) if own == relay]


def check_references(channels: Sequence[Channel], relays: Sequence[Any]) -> None:
    """Relays that must exist, and one channel between two of them; raises InputError."""
    names = [place.name for place in relays]
    pairs: set[frozenset[str]] = set()
    for number, channel in enumerate(channels):
        ends = (("from", channel.from_relay), ("to", channel.to_relay), ("misrouted", channel.misrouted))
        for key, name in ends:
            if name is not None and name not in names:
                raise InputError(
                    f"there is no relay '{name}'; {nearest(name, names)}", key=f"channel[{number}].{key}"
                )
        pair = frozenset((channel.from_relay, channel.to_relay))
        if pair in pairs:
            raise InputError(
                f"'{channel.from_relay}' and '{channel.to_relay}' have one already; it goes both ways",
                key=f"channel[{number}]",
            )
        pairs.add(pair)
