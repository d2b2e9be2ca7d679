"""Bank of Kalman filters over decay constants, mixed by their likelihood: no time constant to set.

Voltages have two states, the phasor.  Each current has one filter of three states (phasor, and the offset's
value at the renewal: Zhang and Chen, seed paper 000, eq. 11, 12) for every decay constant of a grid; the
estimate is their mean, weighted by the likelihood of what each predicted (multiple-model adaptive
estimation: Magill 1965; the filters do not interact).  A large offset soon tells its decay constant; where
it is too small to tell, all filters agree.

- The frequency is that of the voltages, from their turn over a cycle once the last disturbance is two cycles
  past, and held through the next.  The model turns at it, so that off the nominal frequency there is no lag:
  a full-cycle window at 49 Hz is 6 % behind the true phasor, for ever.
- P is that of unit noise and does not depend on the samples, so one serves the three voltages, and one of
  each decay constant the three currents.  Each channel's own R (disturbance.py) serves the detection and the
  likelihood.
- The filters see the mean of the last twelfth of a cycle: travelling waves, of some 1 kHz and as large as the
  voltage itself behind a weak source, are no noise that a few samples could average.  While that window
  still holds samples from before a disturbance nothing is learned from it; then P is renewed.  The model is
  turned back by half the window, so the phasor is that of the newest sample.
- The voltages' noise is raised at a renewal and decays (the paper's own R0 exp(-k dT / T)): what waves
  are left is not taken for a voltage.
- At a disturbance P is renewed and the evidence begins anew; the present mean is the prior.  Otherwise the
  phasors have a process noise that makes the memory of the steady filter, and the evidence fades.
- The weights are each phase's own: with a fault to ground the phases' offsets need not decay alike.

With twelve decay constants between 5 and 500 ms no offset of 10 to 200 ms lies so far from all of them that
the error after a cycle is above 3 %; with eight it reaches 6 % (13 ms, between two of them).
"""

from __future__ import annotations

import math

import numpy as np

from faultloop.errors import InputError
from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.disturbance import DETECTION_THRESHOLD, FLOOR, HEADER, header
from faultloop.relay.estimators.filters.offset_bank import (
    ALPHA,
    CYCLE,
    DECAY,
    FADE,
    LISTS,
    PROCESS,
    SCALE,
    TAPS,
    WEIGHT,
    bank_step,
    state_size,
)
from faultloop.relay.estimators.parameters import number, samples_per_cycle, whole

# Four times the other recursive methods' floor: the renewal then waits until a travelling wave, or the
# low-pass in front, has done its worst, instead of fitting it.  On a 300 km line at 24 samples per cycle the
# three-phase fault's phasors stay within 5 % after 11 and 12 ms (median: voltages, currents), not 19 and 21.
BANK_NOISE_FLOOR = 0.02

# Standard deviation, over the peak, of what waves are left in the voltages at a renewal.  Of 2304 faults
# beyond zone 1 (docs/relay.md) the largest voltage estimate was then 1.1 of what was there, with 0.2 2.1;
# without the mean over a twelfth of a cycle 4.4, and a mho operated for 72 of them.
BANK_WAVE_NOISE = 0.5


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    models: int = 12,
    shortest_ms: float = 5.0,
    longest_ms: float = 500.0,
    memory_cycles: float = 1.0,
    evidence_cycles: float = 1.0,
    renewal_spread: float = 2.0,
    window_cycles: float = 1 / 12,
    noise_floor: float = BANK_NOISE_FLOOR,
    detection_threshold: float = DETECTION_THRESHOLD,
    wave_noise: float = BANK_WAVE_NOISE,
) -> Estimator:
    """Bank of Kalman filters.

    Parameters
    ----------
    models : decay constants, in a geometric row from ``shortest_ms`` to ``longest_ms``.
    shortest_ms, longest_ms : the first and the last decay constant [ms].
    memory_cycles : time constant of the steady filter [cycles of f0].
    evidence_cycles : time constant with which the models' evidence fades [cycles of f0].
    renewal_spread : standard deviation of the renewed states, over the peak of the voltages or currents.
    window_cycles : length of the mean that the filters see [cycles of f0]; below two samples it is none.
    noise_floor : least standard deviation of the noise, over the peak of the voltages or currents.
    detection_threshold : squared normalised innovation that is a disturbance.
    wave_noise : standard deviation that a disturbance adds to the voltages, over their peak; its variance
        decays within a fifth of a cycle.

    Raises InputError below 6 samples per cycle or for a parameter outside its limits.
    """
    per_cycle = samples_per_cycle(sampling_hz, frequency_hz, least=6, method="kalman-bank")
    count = whole("models", models, least=1, most=64)
    shortest = number("shortest_ms", shortest_ms, least=1.0, most=1000.0)
    longest = number("longest_ms", longest_ms, least=1.0, most=10_000.0)
    if longest < shortest:
        raise InputError(f"{longest:g} should be at least shortest_ms, {shortest:g}", key="longest_ms")
    memory = per_cycle * number("memory_cycles", memory_cycles, least=0.1, most=100.0)
    evidence = per_cycle * number("evidence_cycles", evidence_cycles, least=0.1, most=100.0)
    taps = max(1, math.floor(per_cycle * number("window_cycles", window_cycles, least=0.0, most=0.25) + 1e-9))
    state = np.zeros(state_size(count, taps))
    state[:HEADER] = header(sampling_hz, frequency_hz, noise_floor, detection_threshold, wave_noise)
    # A phasor of variance q R per sample that is seen through a unit sinusoid settles at the pole 1 -
    # sqrt(q / 2).
    state[PROCESS] = 2.0 / memory**2
    state[ALPHA] = number("renewal_spread", renewal_spread, above=0.0, most=1e3) ** 2 / state[FLOOR]
    half = math.pi * frequency_hz / sampling_hz
    state[TAPS], state[SCALE] = taps, math.sin(half) / math.sin(taps * half)
    state[CYCLE] = round(per_cycle)
    state[FADE] = math.exp(-1.0 / evidence)
    constants_s = 1e-3 * np.geomspace(shortest, longest, count)
    state[LISTS + DECAY * count : LISTS + (DECAY + 1) * count] = np.exp(-1.0 / (constants_s * sampling_hz))
    state[LISTS + WEIGHT * count : LISTS + (WEIGHT + 3) * count] = 1.0 / count
    return Estimator("kalman-bank", bank_step(count), state, math.ceil(per_cycle) + taps)
