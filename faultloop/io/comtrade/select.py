"""Six channels of a record, in primary volts and amperes, for a relay."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.io.comtrade.bays import bays_of
from faultloop.io.comtrade.mapping import SLOTS, Choice, parse_mapping
from faultloop.io.comtrade.names import Label, label_of, phases_of
from faultloop.io.comtrade.record import AnalogChannel, Rate, Record
from faultloop.io.comtrade.units import Unit, unit_of

__all__ = ["SLOTS", "Overrides", "SixChannels", "fundamental_hz", "select_channels", "slots_of"]

_WINDOWS = 50
"""Of 0.2 s, that are looked at for a frequency."""


@dataclass(frozen=True, slots=True)
class Overrides:
    """What a user knows better than the record, by slot (va .. ic).

    ``units`` in place of the channel's own; ``scales`` from that unit to primary, in place of whatever the
    record says of primary, secondary and ratio; ``ct_ratio`` and ``vt_ratio`` likewise for all currents and
    voltages.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    ct_ratio: float | None = None
    vt_ratio: float | None = None

    def scale(self, slot: str) -> float | None:
        return self.scales.get(slot, self.vt_ratio if slot[0] == "v" else self.ct_ratio)


@dataclass(slots=True, eq=False)
class SixChannels:
    """va vb vc ia ib ic of a record.

    `values` are instantaneous primary volts and amperes, NaN where missing (a whole column where the record
    has no such channel); `skew_s` is how much after `t_ns` each channel was sampled.  `secondary` is by what
    the record itself had secondary values multiplied; NaN where it had primary ones, or a user says by what.
    """

    t_ns: NDArray[np.int64]  # (samples,)
    values: NDArray[np.float64]  # (samples, 6)
    stretches: tuple[Rate, ...]
    names: tuple[str, ...]  # of the record's channels; empty where there is none
    skew_s: tuple[float, ...] = (0.0,) * 6
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    secondary: tuple[float, ...] = (math.nan,) * 6
    given: tuple[bool, ...] = (False,) * 6  # a user gave unit or factor

    @property
    def missing(self) -> tuple[str, ...]:
        """Which of the six the record does not have."""
        return tuple(slot for slot, name in zip(SLOTS, self.names, strict=True) if not name)


def select_channels(
    record: Record,
    mapping: str | None = None,
    *,
    overrides: Overrides = Overrides(),
    ct_ratio: float | None = None,
    vt_ratio: float | None = None,
    scale: str | None = None,
) -> SixChannels:
    """Choose six channels of a record and bring them to primary volts and amperes.

    Parameters
    ----------
    mapping : ``"va=..,vb=..,ic=.."``, each a channel's name or its place in the analog list counted from 0,
        with a factor if need be (``va=5*1.4142``); ``-`` for a channel that the record does not have.  What
        is not mapped is found by unit, phase and name, if there is just one channel that it can be.
    overrides : units, factors and ratios in place of the record's own.
    ct_ratio, vt_ratio : the same two of ``overrides``.
    scale : "P" or "S" in place of what the record says its values are.

    Raises
    ------
    InputError : an unknown name or place, several channels that it could be, none at all, a unit that is
        neither of voltage nor of current, secondary values without a ratio.
    """
    if scale not in (None, "P", "S"):
        raise InputError(f"'{scale}': values are P (primary) or S (secondary)", key="scale")
    if ct_ratio is not None or vt_ratio is not None:
        overrides = replace(
            overrides,
            ct_ratio=ct_ratio if ct_ratio is not None else overrides.ct_ratio,
            vt_ratio=vt_ratio if vt_ratio is not None else overrides.vt_ratio,
        )
    given = parse_mapping(record, mapping or "").analog
    found = slots_of(record, overrides.units)
    columns, names, skews, notes, secondary = [], [], [], [], []
    for slot in SLOTS:
        choice = given[slot] if slot in given else _only(record, slot, found)
        if choice is None:
            columns.append(np.full(len(record), np.nan))
            names.append("")
            skews.append(0.0)
            secondary.append(math.nan)
            notes.append(f"{slot}: the record has no such channel")
            continue
        channel = replace(choice.channel, scale=scale or choice.channel.scale)
        unit = _unit(channel, slot, overrides.units.get(slot), notes)
        factor, by = _to_primary(channel, slot, overrides.scale(slot))
        factor *= choice.factor * unit.factor
        with np.errstate(over="ignore"):
            columns.append(channel.values * factor if factor != 1.0 else channel.values)
        names.append(channel.name)
        skews.append(channel.skew_s)
        secondary.append(by)
    if not any(names):
        raise InputError(f"no voltages or currents found by themselves: {_how(record)}", key="--map")
    six = SixChannels(
        record.t_ns,
        np.column_stack(columns),
        record.stretches,
        tuple(names),
        tuple(skews),
        notes,
        secondary=tuple(secondary),
        given=tuple(slot in overrides.units or overrides.scale(slot) is not None for slot in SLOTS),
    )
    measured = fundamental_hz(six)
    if record.frequency_hz > 0 and abs(measured - record.frequency_hz) > 0.1 * record.frequency_hz:
        notes.append(f"the record says {record.frequency_hz:g} Hz, its signals have {measured:.1f} Hz")
    return six


def slots_of(record: Record, units: Mapping[str, str] | None = None) -> list[tuple[str, Label]]:
    """Per analog channel which of the six it is ("" where none), and what its name, unit and phase say.

    Of a quantity whose unit a user gives, a channel's own unit does not count.
    """
    free = {slot[0] for slot in units or ()}
    labels = [_label(channel, free) for channel in record.analog]
    phases = {
        quantity: phases_of(label.phase for label in labels if label.quantity == quantity)
        for quantity in "vi"
    }

    def slot(label: Label) -> str:
        phase = phases[label.quantity].get(label.phase) if label.is_phase else None
        return label.quantity + phase if phase else ""

    return [(slot(label), label) for label in labels]


def _label(channel: AnalogChannel, free: set[str]) -> Label:
    if free and unit_of(channel.unit) is None:
        label = label_of(replace(channel, unit=""))
        if label.quantity in free:
            return label
    return label_of(channel)


def _only(record: Record, slot: str, found: list[tuple[str, Label]]) -> Choice | None:
    """The one channel that can be it, or None if there is none."""
    fitting = [channel for channel, (own, _) in zip(record.analog, found, strict=True) if own == slot]
    if len(fitting) > 1:
        names = ", ".join(repr(channel.name) for channel in fitting[:6])
        more = f" and {len(fitting) - 6} more" if len(fitting) > 6 else ""
        raise InputError(f"{slot} can be any of {names}{more}: {_how(record)}", key="--map")
    return Choice(fitting[0]) if fitting else None


def _unit(channel: AnalogChannel, slot: str, given: str | None, notes: list[str]) -> Unit:
    """A channel's unit, or the one given for it."""
    wanted = "V or kV" if slot[0] == "v" else "A or kA"
    text = channel.unit.strip() if given is None else given
    if not text:
        notes.append(f"{slot}: channel '{channel.name}' has no unit: taken as {wanted[0]}")
        return Unit("v" if slot[0] == "v" else "i", 1.0)
    unit = unit_of(text)
    if unit is None or unit.quantity != slot[0]:
        key = "--map" if given is None else "--unit"
        hint = f", or given with --unit {slot}={wanted[:1]}" if given is None and unit is None else ""
        raise InputError(
            f"{slot}: channel '{channel.name}' is in '{text}': it must be in {wanted}{hint}", key=key
        )
    return unit


def _to_primary(channel: AnalogChannel, slot: str, given: float | None) -> tuple[float, float]:
    """Factor from the file's values to primary; and the record's own ratio where that is it, else NaN."""
    if given is not None:
        return given, math.nan
    to_primary = channel.to_primary
    if math.isnan(to_primary):
        option = "vt_ratio" if slot[0] == "v" else "ct_ratio"
        raise InputError(
            f"{slot}: channel '{channel.name}' has secondary values and no ratio: give {option}", key="--map"
        )
    return to_primary, to_primary if channel.scale == "S" else math.nan


def fundamental_hz(six: SixChannels) -> float:
    """Frequency of the strongest component between 40 and 70 Hz [Hz], to about 1 Hz; NaN if there is none.

    From the first 0.2 s of the greatest voltage (or current) in which it is what there is most of: files
    state wrong frequencies.
    """
    present = [i for i, name in enumerate(six.names) if name]
    voltages = [i for i in present if i < 3] or present
    size = np.abs(np.nan_to_num(six.values[:, voltages])).max(axis=0, initial=0.0)
    column = six.values[:, voltages[int(np.argmax(size))]]
    first = 0
    for rate in six.stretches:
        count = int(0.2 * rate.hz)
        if rate.hz >= 200 and rate.stop - first >= 0.06 * rate.hz:
            starts = range(first, max(rate.stop - count, first) + 1, count // 2)
            for start in starts[:_WINDOWS]:
                found = _strongest_hz(column[start : min(start + count, rate.stop)], rate.hz)
                if not math.isnan(found):
                    return found
        first = rate.stop
    return math.nan


def _strongest_hz(values: NDArray[np.float64], hz: float) -> float:
    stride = max(int(hz / 20_000), 1)
    values, hz = np.nan_to_num(values[::stride]), hz / stride
    with np.errstate(over="ignore", invalid="ignore"):
        values = values - values.mean()
        values /= np.abs(values).max(initial=0.0)
    if not np.isfinite(values).all():  # nothing there, or nothing that can be
        return math.nan
    spectrum = np.abs(np.fft.rfft(values * np.hanning(len(values)), 16 * len(values)))
    frequencies = np.fft.rfftfreq(16 * len(values), 1 / hz)
    within = (frequencies >= 40) & (frequencies <= 70)
    found = float(frequencies[within][np.argmax(spectrum[within])])
    near = np.abs(frequencies - found) <= 2 * hz / len(values)  # the window's main lobe
    share = np.sum(spectrum[near] ** 2) / np.sum(spectrum**2)
    return found if share > 0.5 else math.nan


def _how(record: Record) -> str:
    last = len(record.analog) - 1
    bays = [f"{place} '{bay.name}'" for place, bay in enumerate(bays_of(record)) if not bay.unsaid]
    whole = f"a whole bay with --map bay=.. ({', '.join(bays[:4])}), or " if len(bays) > 1 else ""
    return (
        f"map {whole}the channels by name or place (0 to {last}): --map va=..,vb=..,...,ic=..; "
        "`faultloop channels` lists them"
    )
