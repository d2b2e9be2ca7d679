"""A function's kernel by itself: as the suite of functions has it."""

from faultloop.study.suites.functions.kernel import GIVEN, TURN, Kernel

__all__ = ["GIVEN", "TURN", "Kernel"]
