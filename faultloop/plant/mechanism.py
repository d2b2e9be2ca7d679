"""The operating mechanism of a breaker: what a command makes of the motions that are under way.

A plant counts the time in its steps, a breaker that is a process in nanoseconds.
"""

from __future__ import annotations

from faultloop.plant.elements.switch import Action

Pending = tuple[Action, ...]


def commanded(pending: Pending, action: Action) -> Pending:
    """What is to come after a command whose contacts move with ``action``.

    An open cancels a close that has not come to its end, and is none where the poles are about to part
    anyway; what the breaker does by itself (`Action.planned`) no command takes back.
    """
    if action.kind == "part":
        for other in pending:
            if other.switch == action.switch and other.kind == "part" and other.step <= action.step:
                action = action._replace(mask=action.mask & ~other.mask)
        less = tuple(_without(other, action.switch, action.mask) for other in pending)
        pending = tuple(other for other in less if other.mask)
    return (*pending, action) if action.mask else pending


def _without(action: Action, switch: int, mask: int) -> Action:
    """A pending close less the poles that are now to open."""
    if action.switch == switch and action.kind == "make" and not action.planned:
        return action._replace(mask=action.mask & ~mask)
    return action
