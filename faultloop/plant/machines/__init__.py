"""Electromechanical swings: synchronous machines on a network that has no dynamics of its own."""

from faultloop.plant.machines.data import System, read_system, with_damping
from faultloop.plant.machines.network import LineFault, reduced_impedances
from faultloop.plant.machines.swing import Exciter, SteadyState, Swing, simulate, steady_state

__all__ = [
    "Exciter",
    "LineFault",
    "SteadyState",
    "Swing",
    "System",
    "read_system",
    "reduced_impedances",
    "simulate",
    "steady_state",
    "with_damping",
]
