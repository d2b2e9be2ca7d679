"""Two sources that slip, with or without a fault between them: phasors of the network at every sample."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tests.relay.network import Network


def sources_part(network: Network, kind: str, at: float, resistance: float) -> tuple[np.ndarray, np.ndarray]:
    """What the six phasors are of the near source, and of the far one at angle 0; the network is linear."""
    zero = replace(network, angle_deg=0.0).solve(kind, at, resistance, resistance)
    quarter = replace(network, angle_deg=90.0).solve(kind, at, resistance, resistance)
    far = (zero - quarter) / (1 - 1j)
    return zero - far, far


def samples(
    network: Network,
    angle_deg: np.ndarray,
    kind: str = "",
    at: float = 0.5,
    start_s: float = np.inf,
    resistance: float = 0.0,
    end_s: float = np.inf,
) -> np.ndarray:
    """(n, 6) at the network's rate, with the far source at these angles, in degrees ahead, one for each
    sample.

    The fault's currents begin with a decaying offset (tau of the network), as through inductances they must.
    """
    t = np.arange(len(angle_deg)) / network.sampling_hz
    slip = np.exp(1j * np.radians(angle_deg))[:, None]
    near, far = sources_part(network, "", 0.5, 0.0)
    x = near + far * slip
    turn = np.exp(2j * np.pi * network.frequency_hz * t)[:, None]
    wave = math.sqrt(2) * np.real(x * turn)
    if kind and start_s < t[-1]:
        near, far = sources_part(network, kind, at, resistance)
        faulted = math.sqrt(2) * np.real((near + far * slip) * turn)
        first = int(np.argmax(t >= start_s))
        offset = (wave - faulted)[first] * ([0] * 3 + [1] * 3)
        inside = (t >= start_s) & (t < end_s)
        faulted += offset * np.exp(-(t - start_s) / network.tau_s)[:, None]
        wave[inside] = faulted[inside]
    return wave


def slipping(
    network: Network, slip_hz: float, seconds: float, quiet_s: float = 0.3, load_deg: float = -20.0
) -> np.ndarray:
    """Angles: load, and from ``quiet_s`` on a constant slip away from it."""
    t = np.arange(round(seconds * network.sampling_hz)) / network.sampling_hz
    return load_deg + 360 * slip_hz * np.maximum(t - quiet_s, 0) * (1 if load_deg > 0 else -1)


def stable(
    network: Network, swing_hz: float, most_deg: float, seconds: float, quiet_s: float = 0.3
) -> np.ndarray:
    """Angles: load of 20 degrees, and from ``quiet_s`` on a sinusoid up to the greatest and back."""
    t = np.arange(round(seconds * network.sampling_hz)) / network.sampling_hz
    part = (1 - np.cos(2 * math.pi * swing_hz * np.maximum(t - quiet_s, 0))) / 2
    return -(20.0 + (most_deg - 20.0) * part)
