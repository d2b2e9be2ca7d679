"""Six channels with one model row and one covariance: the gain does not depend on the samples.

The covariance is that of a noise of variance one; each channel's own is its noise's variance times that.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Array
from faultloop.relay.estimators.disturbance import compare, follow_variance, is_sample, noise_variance


@njit
def innovate(state: Array, x: Array, row: Array, states: Array, innovation: Array, projected: Array) -> None:
    """e of the six channels, compared with what is expected of it.

    ``states`` (n, 6), ``innovation`` (6,) is overwritten, ``projected`` is h P h'.
    """
    for c in range(CHANNELS):
        e = 0.0
        if is_sample(x[c]):
            e = x[c]
            for i in range(len(row)):
                e -= row[i] * states[i, c]
        innovation[c] = e
        compare(state, c, e, projected * noise_variance(state, c))


@njit
def correct_channels(
    state: Array, x: Array, gain: Array, states: Array, innovation: Array, projected: Array
) -> None:
    """Correct each channel that has a sample, and follow its noise."""
    for c in range(CHANNELS):
        if is_sample(x[c]):
            e = innovation[c]
            for i in range(len(gain)):
                states[i, c] += gain[i] * e
            follow_variance(state, c, e, projected * noise_variance(state, c))
