"""Electromechanical swings: synchronous machines on a network that has no dynamics of its own."""

from faultloop.study.papers.ckmc.machines.data import System, read_system, with_damping
from faultloop.study.papers.ckmc.machines.network import LineFault, reduced_impedances
from faultloop.study.papers.ckmc.machines.swing import Exciter, SteadyState, Swing, simulate, steady_state

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
