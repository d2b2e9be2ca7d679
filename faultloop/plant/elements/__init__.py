"""What the solver steps: each kind of element with its constants, its state and its part of a step.

A component of a scenario (`faultloop.plant.component`) is made up of them; most need no other than these.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Complex = NDArray[np.complex128]
Pair = NDArray[np.float64]
"""``[mode 0, mode 1]``: the two eigenvalues (zero and positive sequence) of a balanced element's circulant,
symmetric 3x3 matrix.  Mode 1 is that of both aerial modes of the Clarke transformation."""

GROUND = ":ground"
"""The node at zero volts."""
HALF_ROOT_3 = math.sqrt(3) / 2


def circulant(modes: Pair) -> Floats:
    """(3, 3) matrix with the given eigenvalues of zero and positive sequence."""
    return np.eye(3) * modes[1] + (modes[0] - modes[1]) / 3
