"""All that changes from step to step, and how it begins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from faultloop.plant.elements import Complex, Floats
from faultloop.plant.elements.converter import settle
from faultloop.plant.elements.switch import switch_currents
from faultloop.plant.factor import Factor
from faultloop.plant.frontend import Analog
from faultloop.plant.network import Model
from faultloop.plant.steady import ROTATION, Steady


class State(NamedTuple):
    """Views of one buffer; rows as in `Network`."""

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
    varistor: Floats
    """(varistors, 2, 3) voltage across if none conducted [V], current [A]"""
    converter: Floats
    """(converters, FIELDS)"""
    past: Floats
    """(converters, steps, 2) voltages of their buses, alpha and beta, per unit"""
    emf: Floats
    """(sources, 3) cos and sin at the first step of a block, and that block's number"""
    analog: Analog
    """of the front ends"""
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
    analog = Analog(**{name: views.pop(name) for name in Analog._fields})
    return buffer, State(**views, analog=analog)


def fill(model: Model, states: Sequence[Steady], state: State) -> None:
    """Puts the superposed steady states, as of step 0, into a state of zeros."""
    state.v[:] = sum(_phases(s.v) for s in states).real
    state.current[:] = sum(_phases(s.current) for s in states).real
    state.emf[:, 2] = -1
    for k, converter in enumerate(model.circuit.converters):
        e, v = (model.network.converter.row[k, j] for j in (0, 1))
        settle(
            model.network.converter,
            k,
            complex(sum(s.v[e] for s in states)),
            complex(sum(s.v[v] for s in states)),
            complex(sum(s.current[converter.emf] for s in states)),
            state.converter,
            state.past,
        )
    net = model.network.branch
    across = state.v[net.bus[:, 0]] - state.v[net.bus[:, 1]]
    # positive sequence has no sum, so only the own terms of P and K act
    state.history[:] = net.trapezoid[:, 2:3] * across + net.trapezoid[:, 4:5] * state.branch_current
    first = len(across)
    for w, section in enumerate(model.circuit.sections):
        offset, mask = model.network.wave.tap[w, :2]
        steps = np.arange(-int(mask), 1)
        slots = offset + (steps & mask)
        for end, node in enumerate((section.start, section.end)):
            for s in states:
                u = (
                    section.wave.y[1] * s.v[model.row[node]]
                    + section.wave.h[1] * s.current[first + 2 * w + end]
                )
                past = u * np.exp(1j * s.angle * steps)
                # Clarke: of a positive sequence, beta lags alpha by 90 degrees and there is no zero sequence
                state.ring[slots, 2 * end] += past.real
                state.ring[slots, 2 * end + 1] += (-1j * past).real


def _phases(positive: Complex) -> Complex:
    return positive[:, None] * ROTATION


def renew_switch_currents(model: Model, factor: Factor, state: State) -> None:
    """Brings the currents through poles and faults up to the present voltages (as the kernel does only where
    it needs them)."""
    switch_currents(model.network.switch_bus, factor.switch, state.v, state.switch_current)
