"""A log as the traffic of a process bus: GOOSE and Sampled Values in a capture file, and who publishes them
in SCL."""

from __future__ import annotations

from collections.abc import Iterator
from heapq import merge
from pathlib import Path

import numpy as np

from faultloop.config.iec61850 import Iec61850
from faultloop.config.tables import validate
from faultloop.errors import InputError
from faultloop.io.can.authentication import read
from faultloop.io.can.frames import Frame, Rejection, SampledValues
from faultloop.io.can.table import CURRENT_LSB, VOLTAGE_LSB
from faultloop.io.iec61850.gateway import Gateway
from faultloop.io.iec61850.pcap import write_pcap
from faultloop.io.iec61850.sampled_values import station_profile
from faultloop.io.iec61850.scl import write_scl
from faultloop.io.iec61850.streams import Station
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import CAN_FRAME
from faultloop.io.output_file import missing_folders
from faultloop.loop.recorded import recorded_scenario

LSB = np.array([VOLTAGE_LSB] * 3 + [CURRENT_LSB] * 3)
MOST = 2**31 - 1


def station_of(log: Log) -> Station:
    """The station of a log; that of a replay has the relays that are in it."""
    found = recorded_scenario(log)
    relays = tuple(place["name"] for place in found["relay"]) or tuple(log.relays)
    breakers = tuple(place["name"] for place in found["breaker"] if "name" in place) or tuple(log.breakers)
    return Station(
        relays,
        breakers,
        round(found["system"].get("sampling_hz", 0)) or _sampling_hz(log),
        round(found["system"].get("frequency_hz", 50)),
        round(found["can"].get("heartbeat_s", 1.0) * 1e9),
        validate(Iec61850, found["iec61850"], log.path),
        True,
    )


def _sampling_hz(log: Log) -> int:
    for relay in log.relays:
        t_ns = log.samples(relay)["t_ns"]
        if len(t_ns) > 1:
            return round((len(t_ns) - 1) * 1e9 / int(t_ns[-1] - t_ns[0]))
    raise InputError("holds no sampled values", file=log.path)


def log_to_pcap(log: Log, path: Path) -> list[Path]:
    """The messages of a run as they are on a process bus, in a capture file.

    A GOOSE message has the time at which the bus delivered it, a message of Sampled Values that of its last
    sample.

    Raises
    ------
    InputError : no profile has the log's sampling rate, or the file cannot be written.
    """
    station = station_of(log)
    try:
        station_profile(station)
    except InputError as error:
        raise error.within(log.path) from None
    gateway = Gateway(station, start_ns=log.start_ns)
    frames = (
        item
        for span in log.stretches()
        for item in merge(_goose(log, gateway, span), _samples(log, gateway, span), key=lambda item: item[0])
    )
    return [write_pcap(path, frames)]


def _goose(log: Log, gateway: Gateway, span: tuple[int, int]) -> Iterator[tuple[int, bytes]]:
    """Of the frames on the bus those that a publisher of the scenario may have sent."""
    for entry in log.entries(CAN_FRAME, from_ns=span[0], to_ns=span[1]):
        message = read(Frame(entry.id, entry.data, entry.extended, entry.fd, entry.fd))
        if entry.id in gateway.identifiers and not isinstance(message, (Rejection, SampledValues)):
            for data in gateway.encode(message.encode(), entry.t_ns):
                yield log.start_ns + entry.t_ns, data


def _samples(log: Log, gateway: Gateway, span: tuple[int, int]) -> Iterator[tuple[int, bytes]]:
    streams = [_relay_samples(log, gateway, number, span) for number in range(len(gateway.station.relays))]
    return merge(*streams, key=lambda item: item[0])


def _relay_samples(
    log: Log, gateway: Gateway, number: int, span: tuple[int, int]
) -> Iterator[tuple[int, bytes]]:
    name = gateway.station.relays[number]
    if name not in log.relays:
        return
    rows = log.samples(name, from_ns=span[0], to_ns=span[1])
    values = np.stack([rows[channel] for channel in ("va", "vb", "vc", "ia", "ib", "ic")], axis=1)
    raw = np.rint(values / LSB)
    wrong = ~(np.abs(raw) <= MOST)
    invalid = (wrong << np.arange(6)).sum(axis=1).tolist()
    counts = np.nan_to_num(np.clip(raw, -MOST, MOST)).astype(np.int64).tolist()
    for t_ns, count, own, bits in zip(
        rows["t_ns"].tolist(), rows["sample_count"].tolist(), counts, invalid, strict=True
    ):
        for data in gateway.encode_sample(number, count, tuple(own), bits):
            yield log.start_ns + t_ns, data


def log_to_scl(log: Log, folder: Path) -> list[Path]:
    """Who publishes the messages of a run: SCL files, one for each IED (``.cid``) and one of all
    (``.scd``)."""
    station = station_of(log)
    name = recorded_scenario(log)["scenario"].get("name", log.path.stem)
    with missing_folders(folder):
        return write_scl(folder, station, name)
