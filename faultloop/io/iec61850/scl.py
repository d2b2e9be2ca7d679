"""Who publishes what, as SCL (IEC 61850-6, version 2007 B4): configured IEDs with their data sets, control
blocks and addresses, for tools and devices that subscribe."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from pathlib import Path

from faultloop.io.iec61850.data_types import NODE_TYPES, add_templates
from faultloop.io.iec61850.sampled_values import Profile, station_profile
from faultloop.io.iec61850.streams import (
    CONF_REV,
    DEVICE,
    FIRST_NS,
    MS,
    UNIT,
    Address,
    Member,
    Station,
    Stream,
    Unit,
)
from faultloop.io.output_file import write_aside

NAMESPACE = "http://www.iec.ch/61850/2003/SCL"
ACCESS_POINT = "AP1"
UNIT_DATA_SET, UNIT_BLOCK = "PhsMeas1", "MSVCB01"
UNIT_NODES = tuple(
    (prefix, kind, str(instance), name)
    for kind, letter, name in (("TCTR", "I", "AmpSv"), ("TVTR", "U", "VolSv"))
    for instance, prefix in enumerate((f"{letter}01{phase}" for phase in "ABCN"), 1)
)
"""Prefix, class, instance and data object of each channel, in the order of the samples."""


def write_scl(folder: Path | str, station: Station, name: str) -> list[Path]:
    """Write ``station.scd`` with every IED, and a ``.cid`` for each one.

    Parameters
    ----------
    name : what the files are of.

    Raises
    ------
    InputError : a file cannot be written, or no profile has the station's sampling rate.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    ieds = _ieds(station)
    files = {folder / "station.scd": ieds} | {folder / f"{ied}.cid": {ied: own} for ied, own in ieds.items()}
    for path, content in files.items():
        root = document(station, content, name)
        with write_aside(path) as aside:
            aside.write_bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")
    return list(files)


Ieds = dict[str, list[Stream | Unit]]


def _ieds(station: Station) -> Ieds:
    ieds: Ieds = {}
    for stream in (*station.streams(), *station.units()):
        ieds.setdefault(stream.ied, []).append(stream)
    return ieds


def document(station: Station, ieds: Ieds, name: str) -> ET.Element:
    """The root of a file with these IEDs."""
    root = ET.Element("SCL", {"xmlns": NAMESPACE, "version": "2007", "revision": "B", "release": "4"})
    ET.SubElement(root, "Header", id=name, version="1", revision="", toolID="faultloop")
    network = ET.SubElement(
        ET.SubElement(root, "Communication"), "SubNetwork", name="ProcessBus", type="8-MMS"
    )
    for ied, streams in ieds.items():
        point = ET.SubElement(network, "ConnectedAP", iedName=ied, apName=ACCESS_POINT)
        for stream in streams:
            _connected(point, station, stream)
    used: list[str] = []
    for ied, streams in ieds.items():
        used += _ied(root, station, ied, streams)
    add_templates(root, dict.fromkeys(used))
    ET.indent(root)
    return root


def _connected(point: ET.Element, station: Station, stream: Stream | Unit) -> None:
    if isinstance(stream, Stream):
        gse = ET.SubElement(point, "GSE", ldInst=DEVICE, cbName=f"gcb{stream.block.name}")
        _address(gse, station, stream.address)
        for tag, t_ns in (("MinTime", FIRST_NS), ("MaxTime", station.heartbeat_ns)):
            ET.SubElement(gse, tag, unit="s", multiplier="m").text = str(t_ns // MS)
    else:
        _address(ET.SubElement(point, "SMV", ldInst=UNIT, cbName=UNIT_BLOCK), station, stream.address)


def _address(parent: ET.Element, station: Station, address: Address) -> None:
    element = ET.SubElement(parent, "Address")
    for kind, text in (
        ("MAC-Address", address.destination.replace(":", "-").upper()),
        ("APPID", f"{address.app_id:04X}"),
        ("VLAN-ID", f"{station.options.vlan_id:03X}"),
        ("VLAN-PRIORITY", str(station.options.vlan_priority)),
    ):
        ET.SubElement(element, "P", type=kind).text = text


def _ied(root: ET.Element, station: Station, name: str, streams: Sequence[Stream | Unit]) -> list[str]:
    """Adds an IED; returns the types of its logical nodes."""
    ied = ET.SubElement(root, "IED", name=name, type="simulated", manufacturer="faultloop", configVersion="1")
    server = ET.SubElement(ET.SubElement(ied, "AccessPoint", name=ACCESS_POINT), "Server")
    ET.SubElement(server, "Authentication")
    goose = [stream for stream in streams if isinstance(stream, Stream)]
    units = [stream for stream in streams if isinstance(stream, Unit)]
    nodes = list(dict.fromkeys(member.node for stream in goose for member in stream.block.members))
    device = ET.SubElement(server, "LDevice", inst=UNIT if units else DEVICE)
    first = _node(device, "LN0", "LLN0", "")
    for stream in goose:
        _goose_data_set(first, stream)
    if units:
        _unit_data_set(first)
    for stream in goose:
        ET.SubElement(
            first, "GSEControl", name=f"gcb{stream.block.name}", datSet=f"ds{stream.block.name}",
            confRev=str(CONF_REV), appID=stream.id, type="GOOSE",
        )  # fmt: skip
    for unit in units:
        _unit_control(first, unit, station_profile(station), station.frequency_hz)
    kinds = ["LLN0", "LPHD"]
    _node(device, "LN", "LPHD", "1")
    for node in nodes:
        kinds.append(node.rstrip("0123456789"))
        _node(device, "LN", kinds[-1], node[len(kinds[-1]) :])
    for prefix, kind, instance, _ in UNIT_NODES if units else ():
        kinds.append(kind)
        _node(device, "LN", kind, instance, prefix)
    return kinds


def _node(device: ET.Element, tag: str, kind: str, instance: str, prefix: str = "") -> ET.Element:
    more = {"prefix": prefix} if prefix else {}
    return ET.SubElement(
        device, tag, more | {"lnClass": kind, "inst": instance, "lnType": NODE_TYPES[kind].id}
    )


def _members(parent: ET.Element, name: str, members: Iterable[Member]) -> None:
    data_set = ET.SubElement(parent, "DataSet", name=name)
    for member in members:
        kind = member.node.rstrip("0123456789")
        ET.SubElement(
            data_set, "FCDA", ldInst=DEVICE, lnClass=kind, lnInst=member.node[len(kind) :],
            doName=member.object, daName=member.attribute, fc=member.constraint,
        )  # fmt: skip


def _goose_data_set(first: ET.Element, stream: Stream) -> None:
    _members(first, f"ds{stream.block.name}", stream.block.members)


def _unit_data_set(first: ET.Element) -> None:
    data_set = ET.SubElement(first, "DataSet", name=UNIT_DATA_SET)
    for prefix, kind, instance, name in UNIT_NODES:
        for attribute in ("instMag.i", "q"):
            ET.SubElement(
                data_set, "FCDA", ldInst=UNIT, prefix=prefix, lnClass=kind, lnInst=instance,
                doName=name, daName=attribute, fc="MX",
            )  # fmt: skip


def _unit_control(first: ET.Element, unit: Unit, profile: Profile, frequency_hz: int) -> None:
    per_period = profile.is_9_2le
    control = ET.SubElement(
        first, "SampledValueControl", name=UNIT_BLOCK, datSet=UNIT_DATA_SET, confRev=str(CONF_REV),
        smvID=unit.id, multicast="true", nofASDU=str(profile.asdus),
        smpRate=str(profile.rate // frequency_hz if per_period else profile.rate),
        smpMod="SmpPerPeriod" if per_period else "SmpPerSec",
    )  # fmt: skip
    ET.SubElement(
        control, "SmvOpts", refreshTime="false", sampleSynchronized="true", sampleRate="false",
        dataSet="false", security="false",
    )  # fmt: skip
