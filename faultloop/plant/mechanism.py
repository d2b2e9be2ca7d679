"""The operating mechanism of a breaker: what a command makes of the motions that are under way.

A plant counts the time in its steps, a breaker that is a process in nanoseconds.
"""

from __future__ import annotations

import numpy as np

from faultloop.jit import njit
from faultloop.plant.elements import Ints
from faultloop.plant.elements.switch import Action

Pending = tuple[Action, ...]

STEP, KIND, SWITCH, MASK, PLANNED = range(5)
"""Columns of a row of integers that is an `Action`."""
MAKE, PART = range(2)
KINDS = ("make", "part")


def row_of(action: Action) -> tuple[int, int, int, int, int]:
    """An action as the kernels have it."""
    return action.step, KINDS.index(action.kind), action.switch, action.mask, int(action.planned)


def action_of(row: Ints) -> Action:
    """The action of a row."""
    step, kind, switch, mask, planned = row.tolist()
    return Action(step, "part" if kind == PART else "make", switch, mask, bool(planned))


@njit
def take_command(pending: Ints, count: int, command: Ints) -> int:
    """What is to come, ``count`` rows of ``pending`` (n, 5), after a command whose contacts move as the row
    ``command`` says; returns how many there are then.

    An open cancels a close that has not come to its end, and is none where the poles are about to part
    anyway; what the breaker does by itself (`Action.planned`) no command takes back.
    """
    mask = command[MASK]
    if command[KIND] == PART:
        for k in range(count):
            other = pending[k]
            if other[SWITCH] == command[SWITCH] and other[KIND] == PART and other[STEP] <= command[STEP]:
                mask &= ~other[MASK]
        kept = 0
        for k in range(count):
            other = pending[k]
            left = other[MASK]
            if other[SWITCH] == command[SWITCH] and other[KIND] == MAKE and not other[PLANNED]:
                left &= ~mask
            if left:
                for column in range(command.shape[0]):
                    pending[kept, column] = other[column]
                pending[kept, MASK] = left
                kept += 1
        count = kept
    if mask:
        for column in range(command.shape[0]):
            pending[count, column] = command[column]
        pending[count, MASK] = mask
        count += 1
    return count


take_in_python = getattr(take_command, "py_func", take_command)
"""The same where a command must not wait for a kernel to be loaded."""


def commanded(pending: Pending, action: Action) -> Pending:
    """`take_command` with tuples."""
    rows = np.array([*(row_of(other) for other in pending), row_of(action)], dtype=np.int64)
    count = take_in_python(rows, len(pending), rows[-1].copy())
    return tuple(action_of(row) for row in rows[:count])
