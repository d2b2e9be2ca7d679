"""What the transcriptions share: the lengths, and how the package's estimators are run."""

from __future__ import annotations

import numpy as np

from faultloop.relay.estimators import Estimator, run_estimator

RECORDS = (1, 60)
"""One step, and a record."""


def rows_of(estimator: Estimator, samples: np.ndarray) -> np.ndarray:
    """(n, 14) as a relay has them."""
    rows = np.empty((len(samples), 14))
    run_estimator(estimator.step, estimator.state.copy(), np.ascontiguousarray(samples), rows)
    return rows


def phasors_of(estimator: Estimator, samples: np.ndarray) -> np.ndarray:
    """(n, 6) complex, peak."""
    return np.sqrt(2) * rows_of(estimator, samples)[:, :12].copy().view(complex)
