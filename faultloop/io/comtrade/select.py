"""Six channels of a record, in primary volts and amperes, for a relay."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.io.comtrade.record import AnalogChannel, Rate, Record

SLOTS = ("va", "vb", "vc", "ia", "ib", "ic")
ABSENT = "-"

# What a unit is of, and its factor; Cyrillic letters look the same and are not.
_PREFIXES = {"": 1.0, "k": 1e3, "K": 1e3, "M": 1e6, "m": 1e-3, "к": 1e3, "К": 1e3, "м": 1e-3}
_QUANTITIES = {"V": "v", "v": "v", "В": "v", "в": "v", "A": "i", "a": "i", "А": "i", "а": "i"}
_PHASES = {
    label: phase
    for phase, labels in {"a": "a an l1 1 r а", "b": "b bn l2 2 s в", "c": "c cn l3 3 t с"}.items()
    for label in labels.split()
}
# A phase quantity's name: V, U or I (or the words), then the phase, and nothing that makes it another one.
_NAME = re.compile(
    r"^(?P<quantity>voltage|volt|current|curr|[vui])[\s_.\-]*(?P<phase>l?[123]|[abc]n?|[авс])(?![a-z0-9а-я])",
    re.IGNORECASE,
)
_ASSIGNMENT = re.compile(r"(?:^|,)\s*(v[abc]|i[abc])\s*=")


@dataclass(slots=True, eq=False)
class SixChannels:
    """va vb vc ia ib ic of a record.

    `values` are instantaneous primary volts and amperes, NaN where missing (a whole column where the record
    has no such channel); `skew_s` is how much after `t_ns` each channel was sampled.
    """

    t_ns: NDArray[np.int64]  # (samples,)
    values: NDArray[np.float64]  # (samples, 6)
    stretches: tuple[Rate, ...]
    names: tuple[str, ...]  # of the record's channels; empty where there is none
    skew_s: tuple[float, ...] = (0.0,) * 6
    notes: list[str] = field(default_factory=list)

    @property
    def missing(self) -> tuple[str, ...]:
        """Which of the six the record does not have."""
        return tuple(slot for slot, name in zip(SLOTS, self.names, strict=True) if not name)


@dataclass(frozen=True, slots=True)
class _Choice:
    channel: AnalogChannel
    factor: float = 1.0


def select_channels(
    record: Record,
    mapping: str | None = None,
    *,
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
    ct_ratio, vt_ratio : if given, the record's values are taken as secondary and multiplied by these,
        whatever the record says of itself.
    scale : "P" or "S" in place of what the record says its values are.

    Raises
    ------
    InputError : an unknown name or place, several channels that it could be, none at all, a unit that is
        neither of voltage nor of current, secondary values without a ratio.
    """
    if scale not in (None, "P", "S"):
        raise InputError(f"'{scale}': values are P (primary) or S (secondary)", key="scale")
    given = _parse_mapping(record, mapping or "")
    ratios = {"v": vt_ratio, "i": ct_ratio}
    columns, names, skews, notes = [], [], [], []
    for slot in SLOTS:
        choice = given[slot] if slot in given else _find(record, slot)
        if choice is None:
            columns.append(np.full(len(record), np.nan))
            names.append("")
            skews.append(0.0)
            notes.append(f"{slot}: the record has no such channel")
            continue
        factor, note = _to_primary(choice, slot, ratios[slot[0]], scale)
        notes += [note] if note else []
        columns.append(choice.channel.values * factor if factor != 1.0 else choice.channel.values)
        names.append(choice.channel.name)
        skews.append(choice.channel.skew_s)
    if not any(names):
        raise InputError(f"no voltages or currents found by themselves: {_how(record)}", key="--map")
    six = SixChannels(
        record.t_ns, np.column_stack(columns), record.stretches, tuple(names), tuple(skews), notes
    )
    measured = fundamental_hz(six)
    if record.frequency_hz > 0 and abs(measured - record.frequency_hz) > 0.1 * record.frequency_hz:
        notes.append(f"the record says {record.frequency_hz:g} Hz, its signals have {measured:.1f} Hz")
    return six


def fundamental_hz(six: SixChannels) -> float:
    """Frequency of the strongest component between 40 and 70 Hz [Hz], to about 1 Hz; NaN if there is none.

    From the first 0.2 s of the first voltage (or current) that is there: files state wrong frequencies.
    """
    rate, present = six.stretches[0], [i for i, name in enumerate(six.names) if name]
    count = min(rate.stop, int(0.2 * rate.hz))
    values = np.nan_to_num(six.values[:count, present[0]])
    if count < 0.06 * rate.hz or rate.hz < 200 or not values.any():
        return float("nan")
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(count), 16 * count))
    frequencies = np.fft.rfftfreq(16 * count, 1 / rate.hz)
    within = (frequencies >= 40) & (frequencies <= 70)
    return float(frequencies[within][np.argmax(spectrum[within])])


def _parse_mapping(record: Record, mapping: str) -> dict[str, _Choice | None]:
    found = list(_ASSIGNMENT.finditer(mapping))
    if not found and mapping.strip():
        raise InputError(f"'{mapping}' is not of the form va=..,vb=..,ic=..", key="--map")
    if found and mapping[: found[0].start()].strip():
        raise InputError(f"'{mapping[: found[0].start()]}' is none of {', '.join(SLOTS)}", key="--map")
    chosen: dict[str, _Choice | None] = {}
    ends = [match.start() for match in found[1:]] + [len(mapping)]
    for match, end in zip(found, ends, strict=False):
        slot = match[1]
        if slot in chosen:
            raise InputError(f"{slot} is mapped twice", key="--map")
        text = mapping[match.end() : end].strip()
        chosen[slot] = None if text == ABSENT else _chosen(record, slot, text)
    return chosen


def _chosen(record: Record, slot: str, text: str) -> _Choice:
    """A name or place with an optional factor."""
    for name, factor in ((text, 1.0), _factored(text)):
        same = [channel for channel in record.analog if channel.name == name]
        same = same or [channel for channel in record.analog if channel.name.lower() == name.lower()]
        if len(same) == 1:
            return _Choice(same[0], factor)
        if same:
            places = [str(i) for i, channel in enumerate(record.analog) if channel in same]
            raise InputError(f"{slot}: {len(same)} channels are called '{name}': say which by its place, "
                             f"{', '.join(places)}", key="--map")  # fmt: skip
        if re.fullmatch(r"\d+", name):
            if int(name) >= len(record.analog):
                last = len(record.analog) - 1
                raise InputError(
                    f"{slot}: no channel {name}: counted from 0, the last is {last}", key="--map"
                )
            return _Choice(record.analog[int(name)], factor)
    raise InputError(f"{slot}: no channel '{text}': {nearest(text, record.analog_names)}", key="--map")


def _factored(text: str) -> tuple[str, float]:
    name, star, factor = text.rpartition("*")
    try:
        return (name.strip(), float(factor)) if star else (text, 1.0)
    except ValueError:
        return text, 1.0


def _find(record: Record, slot: str) -> _Choice | None:
    """The one channel that can be it, or None if there is none."""
    fitting = [channel for channel in record.analog if _slot_of(channel) == slot]
    if len(fitting) > 1:
        names = ", ".join(repr(channel.name) for channel in fitting[:6])
        raise InputError(f"{slot} can be any of {names}: {_how(record)}", key="--map")
    return _Choice(fitting[0]) if fitting else None


def _slot_of(channel: AnalogChannel) -> str | None:
    """Which of the six a channel is, by unit, phase and name; None if none, or if one cannot say."""
    unit = _unit(channel.unit)
    name = _NAME.match(channel.name.strip())
    quantity = unit[0] if unit else None
    if name is not None:
        by_name = "i" if name["quantity"][0] in "iIcC" else "v"
        if quantity not in (None, by_name):
            return None
        quantity = by_name
    phase = _PHASES.get(channel.phase.strip().lower())
    if phase is None and name is not None:
        phase = _PHASES.get(name["phase"].lower())
    return quantity + phase if quantity and phase and (unit or not channel.unit.strip()) else None


def _unit(text: str) -> tuple[str, float] | None:
    """What a unit is of ("v" or "i"), and its factor to volts or amperes."""
    text = text.strip()
    quantity = _QUANTITIES.get(text[-1:])
    factor = _PREFIXES.get(text[:-1].strip())
    return None if quantity is None or factor is None else (quantity, factor)


def _to_primary(
    choice: _Choice, slot: str, ratio: float | None, scale: str | None
) -> tuple[float, str | None]:
    """Factor from the file's values to primary volts or amperes, and what a user should know of it."""
    channel, note = choice.channel, None
    unit = _unit(channel.unit)
    if unit is None and channel.unit.strip():
        wanted = "V or kV" if slot[0] == "v" else "A or kA"
        raise InputError(
            f"{slot}: channel '{channel.name}' is in '{channel.unit}': it must be in {wanted}", key="--map"
        )
    if unit is None:
        note = f"{slot}: channel '{channel.name}' has no unit: taken as {'V' if slot[0] == 'v' else 'A'}"
        unit = (slot[0], 1.0)
    if unit[0] != slot[0]:
        raise InputError(f"{slot}: channel '{channel.name}' is in {channel.unit}", key="--map")
    if ratio is not None:
        return choice.factor * unit[1] * ratio, note
    to_primary = replace(channel, scale=scale or channel.scale).to_primary
    if np.isnan(to_primary):
        option = "vt_ratio" if slot[0] == "v" else "ct_ratio"
        raise InputError(
            f"{slot}: channel '{channel.name}' has secondary values and no ratio: give {option}", key="--map"
        )
    return choice.factor * unit[1] * to_primary, note


def _how(record: Record) -> str:
    return f"map the channels by name or place (0 to {len(record.analog) - 1}): --map va=..,vb=..,...,ic=.."


def channel_table(record: Record) -> Iterable[str]:
    """One line per analog channel, as a user needs it to write a mapping."""
    for i, channel in enumerate(record.analog):
        ratio = f"{channel.ratio[0]:g}/{channel.ratio[1]:g}" if channel.scale else "-"
        about = f"{channel.unit:4} {channel.scale or '-'} {ratio:12} {_slot_of(channel) or ''}"
        yield f"{i:4} {channel.name:32} {about}".rstrip()
