"""The circuit as arrays: what the kernels read, and what they change."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from faultloop.plant.elements import Floats, Ints
from faultloop.plant.elements.bergeron import Waves
from faultloop.plant.elements.branch import Branches
from faultloop.plant.elements.emf import Emfs
from faultloop.plant.factor import Structure


class Network(NamedTuple):
    """Constants.  Rows of ``v``: buses in elimination order, ground, one per source."""

    structure: Structure
    emf: Emfs
    branch: Branches
    wave: Waves
    switch_bus: Ints
    """(switches, 2) rows of v"""


class State(NamedTuple):
    """All that changes from step to step, views of one buffer; rows as in `Network`."""

    v: Floats
    """(buses + 1 + sources, 3) [V]"""
    current: Floats
    """(branches + 2 waves + switches, 3): branches, start and end of each wave, switches [A]"""
    branch_current: Floats
    """of ``current``"""
    wave_current: Floats
    """of ``current``"""
    switch_current: Floats
    """of ``current``"""
    history: Floats
    """(branches, 3) [A]"""
    ring: Floats
    """(slots, 6) past ``u = y v + H i``: alpha, beta of a wave's start, of its end, zero of both [A]"""
    arriving: Floats
    """(waves, 6) [A], modal, order as in ring"""
    emf: Floats
    """(sources, 3) cos and sin at the first step of a block, and that block's number"""
    lowpass: Floats
    """(relays, 6, sections, 2)"""
    old_v: Floats
    """v and current one step ago, or at an instant in the step, kept while a pole waits for its zero"""
    old_current: Floats
    old_switch_current: Floats
    """of ``old_current``"""
    half_v: Floats
    """v and current half a step ago, in a commutation"""
    half_current: Floats
    measured: Floats
    """(relays, 6)"""


def new_state(shapes: dict[str, tuple[int, ...]], parts: tuple[int, int]) -> tuple[Floats, State]:
    """One buffer of zeros, and the arrays that are its views: to save it is one copy.

    ``shapes`` of the fields that are no part of another; ``parts``: rows of branches and of wave ends in
    ``current``."""
    sizes = [math.prod(shape) for shape in shapes.values()]
    buffer = np.zeros(sum(sizes))
    pieces = np.split(buffer, np.cumsum(sizes)[:-1])
    views = {name: piece.reshape(shape) for piece, (name, shape) in zip(pieces, shapes.items(), strict=True)}
    branches, waves = parts
    current, old = views["current"], views["old_current"]
    views["branch_current"] = current[:branches]
    views["wave_current"] = current[branches : branches + waves]
    views["switch_current"] = current[branches + waves :]
    views["old_switch_current"] = old[branches + waves :]
    return buffer, State(**views)
