"""Read a COMTRADE record: .cfg with .dat, or .cff."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.io.comtrade.config import Config, parse_config
from faultloop.io.comtrade.data import Data, read_data
from faultloop.io.comtrade.encoding import decode
from faultloop.io.comtrade.record import AnalogChannel, Record, StatusChannel, times_of

_SECTION = re.compile(  # kind, data format, length in bytes
    rb"^[ \t]*---[ \t]*file type:[ \t]*([a-z]+)"
    rb"(?:[ \t]+([a-z0-9]+))?[ \t]*(?::[ \t]*(\d{1,15}))?[ \t]*---[ \t]*\r?\n",
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
        if suffix == ".cff":
            config_bytes, data_bytes = _sections(_content(path))
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
    try:
        return _record(config, read_data(data_bytes, config), encoding)
    except InputError as error:
        raise error.within(data_path) from error


def _content(path: Path) -> bytes:
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


def _sections(content: bytes) -> tuple[bytes, bytes]:
    """The CFG and DAT sections of a .cff.

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
            stop = start + int(heading[3]) if heading[3] else len(content)
            return config, content[start:stop]
        following = _SECTION.search(content, start)
        body = content[start : following.start() if following else len(content)]
        if kind == b"CFG":
            config = body
        elif kind == b"DAT" and config is not None:
            return config, body
        heading = following
    lacking = "CFG" if config is None else "DAT"
    raise InputError(f"it has no section '--- file type: {lacking} ---'")


def _record(config: Config, data: Data, encoding: str) -> Record:
    parsed = config.parsed
    analog = [
        AnalogChannel(
            name=channel.name,
            values=values,
            unit=channel.uu,
            phase=channel.ph,
            circuit=channel.ccbm,
            scale=channel.pors.upper() if channel.pors.upper() in ("P", "S") else "",
            ratio=(channel.primary, channel.secondary),
            skew_s=channel.skew * 1e-6,
        )
        for channel, values in zip(parsed.analog_channels, data.analog, strict=True)
    ]
    status = [
        StatusChannel(channel.name, values, channel.ph, channel.ccbm, channel.y)
        for channel, values in zip(parsed.status_channels, data.status, strict=True)
    ]
    return Record(
        t_ns=_times(config, data),
        analog=analog,
        status=status,
        rates=config.rates,
        start_ns=config.start_ns,
        trigger_ns=config.trigger_ns,
        frequency_hz=parsed.frequency,
        station=parsed.station_name,
        device=parsed.rec_dev_id,
        revision=config.revision,
        time_quality=config.time_quality,
        encoding=encoding,
        notes=_notes(config, data),
    )


def _times(config: Config, data: Data) -> NDArray[np.int64]:
    if config.rates:
        return times_of(config.rates, data.numbers)
    if np.isnan(data.stamps).any():
        raise InputError("time stamps are missing, and the .cfg gives no sampling rate")
    times = np.rint((data.stamps - data.stamps[:1]) * config.stamp_ns)
    if len(times) > 1 and not (np.diff(times) > 0).all():
        raise InputError("the time stamps do not increase, and the .cfg gives no sampling rate")
    if len(times) and times[-1] > 2**62:
        raise InputError("the time stamps go beyond 146 years")
    return times.astype(np.int64)


def _notes(config: Config, data: Data) -> list[str]:
    notes = []
    if len(data.numbers) and data.numbers[-1] != len(data.numbers) - 1:
        notes.append(
            f"{data.numbers[-1] + 1 - len(data.numbers)} samples are left out, by the samples' numbers"
        )
    missing = sum(int(np.isnan(values).sum()) for values in data.analog)
    if missing:
        notes.append(f"{missing} values are missing")
    return notes
