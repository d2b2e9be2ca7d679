"""What each case draws: from the seed, the case's number and the place of its ``[[vary]]``, and nothing else.

So a case can be made again alone, in any order, by any number of workers.
"""

from __future__ import annotations

import math
import threading
import warnings
from collections.abc import Sequence
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from faultloop.config.campaign import Vary

if TYPE_CHECKING:
    from scipy.stats import qmc

Array = NDArray[np.float64]
SOBOL_BLOCK = 1024
MOST_TRIED = 500
MOST_SHOWN = 24


def described(vary: Vary) -> str:
    """What a ``[[vary]]`` takes, for a person."""
    if vary.values is not None:
        shown = [f"{v:g}" if isinstance(v, float) else str(v) for v in vary.values[:MOST_SHOWN]]
        text = ", ".join(shown) + (f", ... ({len(vary.values)})" if len(vary.values) > MOST_SHOWN else "")
    elif vary.range is not None:
        text = "{:g} to {:g}, {} values".format(*vary.range)
    elif vary.uniform is not None:
        text = "uniform, {:g} to {:g}".format(*vary.uniform)
    elif vary.log_uniform is not None:
        text = "log-uniform, {:g} to {:g}".format(*vary.log_uniform)
    else:
        text = "normal, mean {:g}, deviation {:g}".format(*vary.normal or ())
    return text + "".join(f"; {key}: {factor:g} times that" for key, factor in vary.factor.items())


_own = threading.local()


def uniforms(seed: int, case: int, places: int, attempt: int) -> Array:
    """(places,) numbers in (0, 1), by a counter-based generator (Salmon et al., 2011: Philox): a case's
    are at the counter (0, attempt, case, 0) of 64 bits each, the lowest first.
    """
    generator, state = _philox(seed)
    state["state"]["counter"][:] = (0, attempt, case, 0)
    generator.state = state
    raw = generator.random_raw(places) >> np.uint64(11)
    return np.asarray((raw + 0.5) * 2.0**-53, dtype=np.float64)


def _philox(seed: int) -> tuple[np.random.Philox, Any]:
    """This thread's generator, and its state when it was new: to make one takes ten times its use."""
    if getattr(_own, "seed", None) != seed:
        _own.seed, _own.generator = seed, np.random.Philox(key=seed)
        _own.state = _own.generator.state
    return _own.generator, _own.state


class Sobol:
    """Points of a scrambled Sobol sequence (Owen, 1998) by their number; in order they cost no more than one
    after the other.
    """

    def __init__(self, seed: int, places: int) -> None:
        self.seed, self.places = seed, places
        self._engine: qmc.Sobol | None = None
        self._lock = Lock()  # threads of a cluster's worker share a plan
        self._block: tuple[int, Array] = (-1, np.empty((0, places)))

    def __getstate__(self) -> dict[str, Any]:
        return {"seed": self.seed, "places": self.places}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)

    def point(self, number: int) -> Array:
        """(places,) in (0, 1)."""
        block, row = divmod(number, SOBOL_BLOCK)
        with self._lock:
            if self._block[0] != block:
                self._block = block, self._points(block)
            point = self._block[1][row]
        return np.clip(point, 2.0**-54, 1 - 2.0**-53)

    def _points(self, block: int) -> Array:
        if self._engine is None or block <= self._block[0]:  # scipy cannot go back
            self._engine, self._block = self._begun(), (-1, self._block[1])
        ahead = (block - self._block[0] - 1) * SOBOL_BLOCK
        with warnings.catch_warnings():  # of a number of points that is no power of two
            warnings.simplefilter("ignore", UserWarning)
            if ahead:  # nor on by nothing
                self._engine.fast_forward(ahead)
            return self._engine.random(SOBOL_BLOCK)

    def _begun(self) -> qmc.Sobol:
        from scipy.stats import qmc  # a second of imports, which no other sampling needs

        return qmc.Sobol(self.places, scramble=True, rng=np.random.default_rng(self.seed))


class Draws:
    """Values of every varied key."""

    def __init__(self, varied: Sequence[Vary], seed: int, sampling: str) -> None:
        self.varied, self.seed, self.sampling = varied, seed, sampling
        self.listed = [None if vary.is_draw else vary.listed() for vary in varied]
        self._sobol = Sobol(seed, len(varied)) if sampling == "sobol" else None

    @property
    def grid_size(self) -> int:
        """How many combinations a grid has."""
        return math.prod(len(listed) for listed in self.listed if listed is not None)

    def at(self, number: int, attempt: int = 0) -> dict[str, Any]:
        """The values of a combination of a grid (the last ``[[vary]]`` changes first), or of a drawn case."""
        if self.sampling == "grid":
            return self.of(self._combination(number))
        if self._sobol is not None and attempt == 0:
            parts = self._sobol.point(number)
        else:  # a Sobol point that a condition refused is drawn again at random
            parts = uniforms(self.seed, number, len(self.varied), attempt)
        return self.of([self._value(place, float(part)) for place, part in enumerate(parts)])

    def of(self, values: Sequence[Any]) -> dict[str, Any]:
        """By key, from one value for each ``[[vary]]``."""
        found: dict[str, Any] = {}
        for place, value in enumerate(values):
            found |= self.keyed(place, value)
        return found

    def keyed(self, place: int, value: Any) -> dict[str, Any]:
        """A ``[[vary]]``'s value, by each of its keys."""
        vary = self.varied[place]
        return {key: value if key not in vary.factor else value * vary.factor[key] for key in vary.all_keys}

    def changing(self) -> list[str]:
        """The keys that are not the same in every case."""
        alike = [listed is not None and len(set(map(repr, listed))) == 1 for listed in self.listed]
        return [key for vary, one in zip(self.varied, alike, strict=True) if not one for key in vary.all_keys]

    def ends(self, place: int) -> list[Any]:
        """What shows whether a ``[[vary]]`` is possible at all: each value (of many some), or both ends."""
        vary, listed = self.varied[place], self.listed[place]
        if listed is not None:
            some = range(0, len(listed), max(len(listed) // MOST_TRIED, 1))
            return (
                [listed[0], listed[-1]]
                if vary.range is not None
                else [*(listed[i] for i in some), listed[-1]]
            )
        if vary.normal is not None:
            return [vary.normal[0]]
        return list(vary.uniform or vary.log_uniform or ())

    def _combination(self, number: int) -> list[Any]:
        values = []
        for listed in reversed(self.listed):
            assert listed is not None
            number, index = divmod(number, len(listed))
            values.append(listed[index])
        return values[::-1]

    def _value(self, place: int, part: float) -> Any:
        vary, listed = self.varied[place], self.listed[place]
        if listed is not None:
            return listed[min(int(part * len(listed)), len(listed) - 1)]
        if vary.uniform is not None:
            low, high = vary.uniform
            return low + (high - low) * part
        if vary.log_uniform is not None:
            low, high = vary.log_uniform
            return min(max(low * (high / low) ** part, low), high)
        from scipy.special import ndtri

        assert vary.normal is not None
        mean, deviation = vary.normal
        return mean + deviation * float(ndtri(part))
