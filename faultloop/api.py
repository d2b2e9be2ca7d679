"""`faultloop.run` and `faultloop.replay`: those of the loop, with the zones as they are in what rerun shows.

The loop knows nothing of reviews: what it is to stream to is given to it here.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from faultloop.loop import replay as _replay
from faultloop.loop import runner as _runner

if TYPE_CHECKING:
    from faultloop.loop.inputs import Inputs
    from faultloop.review.live_rerun import LiveRerun

P = ParamSpec("P")
R = TypeVar("R")


def _of_run(target: str, inputs: Inputs) -> LiveRerun:
    from faultloop.review.live_rerun import LiveRerun

    return LiveRerun.of_run(target, inputs)


def _of_replay(target: str, *given: Any) -> LiveRerun:
    from faultloop.review.live_rerun import LiveRerun

    return LiveRerun.of_replay(target, *given)


def _shown(function: Callable[P, R], made: Callable[..., LiveRerun]) -> Callable[P, R]:
    """``function``, whose ``rerun`` is a target, given the stream that ``made`` makes of it."""

    @wraps(function)
    def shown(*args: P.args, **kwargs: P.kwargs) -> R:
        target = kwargs.get("rerun")
        if isinstance(target, str):
            kwargs["rerun"] = partial(made, target)
        return function(*args, **kwargs)

    shown.__module__ = __name__  # where it is found again when it has been pickled
    return shown


run = _shown(_runner.run, _of_run)
replay = _shown(_replay.replay, _of_replay)
