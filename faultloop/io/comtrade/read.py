"""Read a COMTRADE record: .cfg with .dat, or .cff."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from faultloop.config.input_file import check_input
from faultloop.errors import InputError
from faultloop.io.comtrade.config import Config, parse_config
from faultloop.io.comtrade.data import Data, read_data
from faultloop.io.comtrade.encoding import decode
from faultloop.io.comtrade.record import LONGEST_NS, AnalogChannel, Rate, Record, StatusChannel, times_of

MOST_BYTES = 2**30
"""Of a file that is read."""

_SECTION = re.compile(  # kind, data format, length in bytes
    rb"^(?:\xef\xbb\xbf)?[ \t]*---[ \t]*file type:[ \t]*([a-z]+)"
    rb"(?:[ \t]+([a-z0-9]+))?[ \t]*(?::[ \t]*(\d{1,15}))?[ \t]*---[ \t]*\r*\n",
    re.IGNORECASE | re.MULTILINE,
)


def read_comtrade(path: Path | str, encoding: str | None = None) -> Record:
    """Read a record.

    Parameters
    ----------
    path : the .cfg (its .dat lies beside it, whatever the case of its name) or the .cff.
    encoding : of the names; found out where it is not given.

    Raises
    ------
    InputError : not there, cut off (with the number of samples expected and found), or damaged.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".cfg", ".cff"):
        raise InputError("not a COMTRADE record: its name must end in .cfg or .cff", file=path)
    try:
        stated = None
        if suffix == ".cff":
            config_bytes, data_bytes, stated = _sections(_content(path))
            data_path = path
        else:
            config_bytes, data_path = _content(path), _beside(path, ".dat")
            data_bytes = _content(data_path)
        text, encoding = decode(config_bytes, encoding)
        config = parse_config(text)
    except InputError as error:
        raise error.within(path) from error
    except LookupError as error:
        raise InputError(f"no such encoding: '{encoding}'", key="encoding") from error
    if stated is not None and stated != len(data_bytes):
        config.notes.append(f"the DAT section says {stated} bytes and has {len(data_bytes)}")
        data_bytes = data_bytes if config.samples else data_bytes[:stated]
    try:
        return _record(config, read_data(data_bytes, config), encoding)
    except InputError as error:
        raise error.within(data_path) from error


def _content(path: Path) -> bytes:
    check_input(path, "a COMTRADE record", MOST_BYTES)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error


def _beside(path: Path, suffix: str) -> Path:
    """The file of the same name with another suffix, in whatever case."""
    exact = path.with_suffix(suffix)
    if exact.is_file():
        return exact
    for other in sorted(path.parent.iterdir()):
        if other.name.lower() == exact.name.lower():
            return other
    raise InputError(f"there is no {exact.name} beside it", file=path)


def _sections(content: bytes) -> tuple[bytes, bytes, int | None]:
    """The CFG and DAT sections of a .cff, and the length that its heading gives a binary DAT section.

    A binary DAT section is the last one, and nothing in it is taken for a heading.
    """
    config: bytes | None = None
    heading = _SECTION.search(content)
    while heading is not None:
        kind, data_format = heading[1].upper(), (heading[2] or b"ASCII").upper()
        start = heading.end()
        if kind == b"DAT" and data_format != b"ASCII":
            if config is None:
                break
            return config, content[start:], int(heading[3]) if heading[3] else None
        following = _SECTION.search(content, start)
        body = content[start : following.start() if following else len(content)]
        if kind == b"CFG":
            config = body
        elif kind == b"DAT" and config is not None:
            return config, body, None
        heading = following
    lacking = "CFG" if config is None else "DAT"
    raise InputError(f"it has no section '--- file type: {lacking} ---'")


def _record(config: Config, data: Data, encoding: str) -> Record:
    analog = [
        AnalogChannel(
            name=channel.name,
            values=values,
            unit=channel.unit,
            phase=channel.phase,
            circuit=channel.circuit,
            scale=channel.scale,
            ratio=channel.ratio,
            skew_s=channel.skew_us * 1e-6,
        )
        for channel, values in zip(config.analog, data.analog, strict=True)
    ]
    status = [
        StatusChannel(channel.name, values, channel.phase, channel.circuit, channel.normal)
        for channel, values in zip(config.status, data.status, strict=True)
    ]
    return Record(
        t_ns=_times(config, data),
        analog=analog,
        status=status,
        rates=_rates(config, len(data.numbers)),
        start_ns=config.start_ns,
        trigger_ns=config.trigger_ns,
        frequency_hz=config.frequency_hz,
        station=config.station,
        device=config.device,
        revision=config.revision,
        time_quality=config.time_quality,
        encoding=encoding,
        notes=[*config.notes, *_notes(config, data)],
    )


def _rates(config: Config, samples: int) -> tuple[Rate, ...]:
    """The stated rates; the last one to the record's end where its last sample is not stated."""
    if not config.rates or config.samples:
        return config.rates
    return (*config.rates[:-1], Rate(config.rates[-1].hz, samples))


def _times(config: Config, data: Data) -> NDArray[np.int64]:
    if config.rates:
        return times_of(_rates(config, len(data.numbers)), data.numbers)
    if np.isnan(data.stamps).any():
        raise InputError("time stamps are missing, and the .cfg gives no sampling rate")
    times = np.rint((data.stamps - data.stamps[:1]) * config.stamp_ns)
    if len(times) > 1 and not (np.diff(times) > 0).all():
        raise InputError("the time stamps do not increase, and the .cfg gives no sampling rate")
    if len(times) and times[-1] > LONGEST_NS:
        raise InputError("the time stamps go beyond 36 years")
    return times.astype(np.int64)


def _notes(config: Config, data: Data) -> list[str]:
    notes = []
    samples = len(data.numbers)
    if samples and not data.numbered:
        notes.append("the rows' sample numbers do not count up: the rows are taken one after the other")
    if samples and data.numbers[-1] != samples - 1:
        notes.append(f"{data.numbers[-1] + 1 - samples} samples are left out, by the samples' numbers")
    with np.errstate(over="ignore"):
        gaps = [values for values in data.analog if np.isnan(values.sum())]
    missing = sum(int(np.isnan(values).sum()) for values in gaps)
    if missing:
        notes.append("1 value is missing" if missing == 1 else f"{missing} values are missing")
    return notes + _other_rate(config, data)


def _other_rate(config: Config, data: Data) -> list[str]:
    """What to know where the stamps count at another rate than the .cfg states; its rate is what is taken."""
    if len(config.rates) != 1 or len(data.stamps) < 10 or np.isnan(data.stamps).any():
        return []
    hz, steps = config.rates[0].hz, np.diff(data.stamps)
    shortest, longest = float(steps.min()), float(steps.max())
    if shortest <= 0:
        return []
    if all(abs(1e9 / (step * config.stamp_ns) / hz - 1) < 0.05 for step in (shortest, longest)):
        return []
    counted = 1e9 / (float(np.median(steps)) * config.stamp_ns)
    # Stamps of whole microseconds, or of milliseconds, are rounded.
    if abs(counted / hz - 1) < max(0.05, 1.0 / float(np.median(steps))):
        return []
    return [f"its time stamps count at {counted:.6g} Hz, its rate line says {hz:g} Hz, which is taken"]
