"""Whether six channels of a record can be what they are taken for: frequency, size, order of the phases."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.io.comtrade.select import SLOTS, SixChannels, fundamental_hz

# What no phase quantity of a network in service reaches, or falls to, RMS.
_LEAST_PRIMARY_V, _GREATEST_PRIMARY_V = 1000 / math.sqrt(3), 1.2e6 / math.sqrt(3) * 1.5
_GREATEST_SECONDARY_V = 300.0
_GREATEST_LOAD_A, _GREATEST_SECONDARY_LOAD_A = 20e3, 20.0
_DEAD = 1e-3
_OFF_HZ = 5.0
_QUANTITIES = (
    ("v", slice(0, 3), "voltages", "V", "--vt-ratio"),
    ("i", slice(3, 6), "currents", "A", "--ct-ratio"),
)


def check_frequency(six: SixChannels, stated_hz: float, wanted_hz: float) -> list[str]:
    """Refuse a record of another line frequency than the relay's; a warning where it cannot be measured.

    The signals decide: what a .cfg states of the frequency is wrong in some records.
    """
    measured = fundamental_hz(six)
    told = f"its .cfg says {stated_hz:g} Hz" if stated_hz > 0 else "its .cfg says nothing of it"
    if math.isnan(measured):
        if stated_hz > 0 and abs(stated_hz - wanted_hz) > _OFF_HZ:
            return [
                f"{told}, the relay is one of {wanted_hz:g} Hz, and the signals do not show which is right"
            ]
        return []
    if abs(measured - wanted_hz) > _OFF_HZ:
        raise InputError(
            f"is {wanted_hz:g}, but the record's signals have {measured:.1f} Hz ({told}): "
            "take a relay of the record's frequency",
            key="relay.frequency_hz",
        )
    return []


def check_values(six: SixChannels, frequency_hz: float, nominal_kv: float | None) -> list[str]:
    """What a user should know before trusting the values: sizes that cannot be, phases in a wrong order.

    Judged by the first cycles, which are before the fault in nearly every record.
    """
    warnings = []
    healthy = _first_cycles(six, frequency_hz)
    for quantity, part, words, unit, option in _QUANTITIES:
        own = healthy[:, part]
        there = own[:, ~np.isnan(own).any(axis=0)]
        if not there.size:
            continue
        rms = float(np.sqrt(np.mean(there**2, axis=0)).max())
        if rms > _DEAD and not any(six.given[part]):
            warnings += _size(six, part, words, rms, unit, option, nominal_kv if quantity == "v" else None)
        warnings += _order(own, words, six.stretches[0].hz, frequency_hz)
    return warnings


def _first_cycles(six: SixChannels, frequency_hz: float) -> NDArray[np.float64]:
    """Two cycles, or the one there is; after half a cycle, for the resampler's edge, where that can be."""
    cycle = six.stretches[0].hz / frequency_hz
    stop = six.stretches[0].stop
    first = int(cycle / 2) if stop >= 2.5 * cycle else 0
    count = round(2 * cycle) if stop >= 2 * cycle + first else round(cycle)
    values = six.values[first : first + min(count, stop)]
    return values if np.abs(np.nan_to_num(values)).max(initial=0.0) < 1e100 else np.full((1, 6), 1e100)


def _size(
    six: SixChannels, part: slice, words: str, rms: float, unit: str, option: str, nominal_kv: float | None
) -> list[str]:
    """A size that cannot be, with what to give for it."""
    ratios = [ratio for ratio in six.secondary[part] if not math.isnan(ratio)]
    slot = SLOTS[part][0][0]
    has = f"the {words} have {rms:.4g} {unit} RMS"
    if ratios and ratios[0] != 1.0:
        secondary = rms / ratios[0]
        limit = _GREATEST_SECONDARY_V if unit == "V" else _GREATEST_SECONDARY_LOAD_A
        if secondary > limit:
            return [
                f"the record's {words} are declared secondary and have {secondary:.4g} {unit} RMS, "
                f"which no secondary circuit has: primary perhaps ({option} 1)"
            ]
    if unit == "A":
        if rms > _GREATEST_LOAD_A:
            return [f"{has} from the beginning: too much for primary amperes; give --unit or {option}"]
        return []
    least, greatest, nominal = _LEAST_PRIMARY_V, _GREATEST_PRIMARY_V, ""
    if nominal_kv is not None:
        own = nominal_kv * 1e3 / math.sqrt(3)
        least, greatest, nominal = 0.1 * own, 2 * own, f" where the relay's nominal_kv makes {own:.4g} V"
    if least < rms < greatest:
        return []
    what = "they look secondary, or are in kV" if rms < least else "too much"
    return [f"{has} as primary{nominal}: {what}; give {option} RATIO, or --unit {slot}=kV"]


def _order(values: NDArray[np.float64], words: str, hz: float, frequency_hz: float) -> list[str]:
    """Phases that turn the wrong way round: the negative sequence is nearly all there is."""
    if values.shape[1] != 3 or np.isnan(values).any() or len(values) < hz / frequency_hz - 1:
        return []
    turn = np.exp(-2j * np.pi * frequency_hz / hz * np.arange(len(values)))
    phasors = turn @ values * (math.sqrt(2) / len(values))
    a = np.exp(2j * np.pi / 3)
    zero, positive, negative = (abs(phasors @ np.array([1, a**k, a ** (2 * k)])) / 3 for k in (0, 1, 2))
    if negative > 3 * max(positive, zero) and negative > (1.0 if words == "voltages" else 0.01):
        return [
            f"the {words} turn A-C-B (negative sequence {negative:.4g}, positive {positive:.4g}): two phases "
            "are swapped; say which is which with --map"
        ]
    return []
