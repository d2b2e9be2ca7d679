"""SCL files: the order and the references that the schema of IEC 61850-6 (2007 B4) asks for, and another
reader."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from faultloop.errors import InputError
from faultloop.io.iec61850.scl import NAMESPACE, write_scl
from faultloop.io.iec61850.streams import Station
from tests.io.process_bus import station

# Of each element: its attributes that must be there, and its children in their order.
STRUCTURE = {
    "SCL": ("version revision release", "Header Communication IED DataTypeTemplates"),
    "Header": ("id", ""),
    "Communication": ("", "SubNetwork"),
    "SubNetwork": ("name", "ConnectedAP"),
    "ConnectedAP": ("iedName apName", "GSE SMV"),
    "GSE": ("ldInst cbName", "Address MinTime MaxTime"),
    "SMV": ("ldInst cbName", "Address"),
    "Address": ("", "P"),
    "P": ("type", ""),
    "MinTime": ("unit multiplier", ""),
    "MaxTime": ("unit multiplier", ""),
    "IED": ("name", "AccessPoint"),
    "AccessPoint": ("name", "Server"),
    "Server": ("", "Authentication LDevice"),
    "Authentication": ("", ""),
    "LDevice": ("inst", "LN0 LN"),
    "LN0": ("lnClass inst lnType", "DataSet GSEControl SampledValueControl"),
    "LN": ("lnClass inst lnType", ""),
    "DataSet": ("name", "FCDA"),
    "FCDA": ("ldInst lnClass lnInst doName daName fc", ""),
    "GSEControl": ("name datSet confRev appID type", ""),
    "SampledValueControl": ("name datSet confRev smvID smpRate smpMod nofASDU multicast", "SmvOpts"),
    "SmvOpts": ("", ""),
    "DataTypeTemplates": ("", "LNodeType DOType DAType EnumType"),
    "LNodeType": ("id lnClass", "DO"),
    "DO": ("name type", ""),
    "DOType": ("id cdc", "SDO DA"),
    "SDO": ("name type", ""),
    "DA": ("name bType fc", ""),
    "DAType": ("id", "BDA"),
    "BDA": ("name bType", "Val"),
    "Val": ("", ""),
    "EnumType": ("id", "EnumVal"),
    "EnumVal": ("ord", ""),
}


def _tag(element: ET.Element) -> str:
    space, _, name = element.tag.partition("}")
    assert space == "{" + NAMESPACE
    return name


def _children(element: ET.Element, name: str) -> list[ET.Element]:
    return [child for child in element if _tag(child) == name]


def _check_structure(element: ET.Element) -> None:
    needed, order = (text.split() for text in STRUCTURE[_tag(element)])
    assert set(needed) <= set(element.attrib), _tag(element)
    places = [order.index(_tag(child)) for child in element]
    assert places == sorted(places), _tag(element)
    for child in element:
        _check_structure(child)


def _check_references(root: ET.Element) -> None:
    templates = root[-1]
    types = {(_tag(t), t.attrib["id"]): t for t in templates}
    assert len(types) == len(templates), "every id once"
    used = set()
    for element in templates.iter():
        name, kind = _tag(element), element.get("type")
        if kind is not None:
            target = {"DO": "DOType", "SDO": "DOType"}.get(name) or {"Struct": "DAType", "Enum": "EnumType"}[
                element.attrib["bType"]
            ]
            assert (target, kind) in types
            used.add((target, kind))
    for ied in _children(root, "IED"):
        used |= {("LNodeType", node.attrib["lnType"]) for node in ied.iter() if "lnType" in node.attrib}
        device = ied[0][0][1]
        blocks = {(b.attrib["name"], b.attrib["datSet"]) for b in device[0] if "datSet" in b.attrib}
        sets = {s.attrib["name"]: s for s in _children(device[0], "DataSet")}
        assert {data_set for _, data_set in blocks} == set(sets)
        (point,) = (
            p for p in root.iter(f"{{{NAMESPACE}}}ConnectedAP") if p.get("iedName") == ied.get("name")
        )
        assert {p.attrib["cbName"] for p in point} == {name for name, _ in blocks}
        nodes = {
            (n.get("prefix", ""), n.attrib["lnClass"], n.attrib["inst"]): n.attrib["lnType"] for n in device
        }
        for member in (m for data_set in sets.values() for m in data_set):
            a = member.attrib
            at = types["LNodeType", nodes[a.get("prefix", ""), a["lnClass"], a["lnInst"]]]
            for part in a["doName"].split("."):
                (step,) = (c for c in at if c.attrib["name"] == part)
                at = types["DOType", step.attrib["type"]]
            for depth, part in enumerate(a["daName"].split(".")):
                (step,) = (c for c in at if c.attrib["name"] == part)
                assert depth or step.attrib["fc"] == a["fc"]
                if step.attrib["bType"] == "Struct":
                    at = types["DAType", step.attrib["type"]]
    assert used == set(types), "nothing is missing or left over"


@pytest.mark.parametrize(
    "own", [station(), station(sampling_hz=4800, vlan_id=7), Station(named=True)], ids=str
)
def test_every_file_has_the_structure_of_the_schema(tmp_path: Path, own: Station) -> None:
    files = write_scl(tmp_path / "scl", own, "a name")
    assert len(files) == 1 + 2 * len(own.relays) + len(own.breakers) + 1
    for path in files:
        root = ET.parse(path).getroot()
        _check_structure(root)
        _check_references(root)


def test_another_reader_finds_the_control_blocks(tmp_path: Path) -> None:
    scl = pytest.importorskip("open61850.scl")
    write_scl(tmp_path, station(sampling_hz=4800, vlan_id=7), "name")
    found = {ied.name: ied for ied in scl.load_ieds(tmp_path / "station.scd")}
    assert list(found) == ["RA", "RB", "QA", "QB", "plant", "RA_MU", "RB_MU"]
    trip = found["RA"].goose_controls[0]
    assert (trip.gocb_ref, trip.go_id, trip.conf_rev) == ("RALD0/LLN0$GO$gcbTrip", "RATrip", 1)
    assert (trip.address.mac, trip.address.app_id) == ("01:0c:cd:01:00:10", 0x8010)
    assert (trip.address.vlan_id, trip.address.vlan_priority) == (7, 4)
    assert (trip.address.min_time_ms, trip.address.max_time_ms) == (2, 1000)
    members = [str(r) for r in next(s for s in found["QA"].data_sets if s.name == "dsPosition").references()]
    assert [m.rpartition("/")[2] for m in members][:2] == ["XCBR1.Pos.stVal [ST]", "XCBR1.Pos.q [ST]"]
    (unit,) = found["RB_MU"].sv_controls
    assert (unit.sv_id, unit.smp_rate, unit.smp_mod, unit.nof_asdu) == ("RB_MUMU0101", 4800, "SmpPerSec", 2)
    assert (unit.address.mac, unit.address.app_id) == ("01:0c:cd:04:00:01", 0x4001)
    assert scl.load_ieds(tmp_path / "RB_MU.cid")[0].sv_controls == [unit]
    le = write_scl(tmp_path / "le", station(sampling_hz=12800), "name")
    (unit,) = scl.load_ieds(next(p for p in le if p.name == "RA_MU.cid"))[0].sv_controls
    assert (unit.smp_rate, unit.smp_mod, unit.nof_asdu) == (256, "SmpPerPeriod", 8)


def test_a_rate_without_a_profile_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^system\.sampling_hz: 5000 is the rate of no Sampled Values"):
        write_scl(tmp_path, station(sampling_hz=5000), "name")
