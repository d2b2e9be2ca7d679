"""DataTypeTemplates: the types of the logical nodes that an SCL file of ours has (IEC 61850-7-3 and 7-4)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import NamedTuple

from faultloop.io.can.table import CURRENT_LSB, VOLTAGE_LSB


class Attribute(NamedTuple):
    """A data attribute, or a part of one."""

    name: str
    type: str
    """A basic type, or ``Enum`` or ``Struct`` with a colon and the name of its type."""
    constraint: str | None = None
    value: str | None = None


class ObjectType(NamedTuple):
    """A type of data object: its common data class, and what it is made of."""

    kind: str
    attributes: tuple[Attribute, ...] = ()
    objects: tuple[tuple[str, str], ...] = ()


class NodeType(NamedTuple):
    """A type of logical node: its data objects and their types."""

    id: str
    objects: tuple[tuple[str, str], ...]


def _quality(constraint: str) -> tuple[Attribute, Attribute]:
    return Attribute("q", "Quality", constraint), Attribute("t", "Timestamp", constraint)


def _status(kind: str, type: str, *more: Attribute) -> ObjectType:
    return ObjectType(kind, (Attribute("stVal", type, "ST"), *_quality("ST"), *more))


def _measurement(kind: str, name: str, structure: str) -> ObjectType:
    return ObjectType(kind, (Attribute(name, f"Struct:{structure}", "MX"), *_quality("MX")))


def _samples(scale: str) -> ObjectType:
    return ObjectType(
        "SAV",
        (
            Attribute("instMag", "Struct:AnalogueValue_i", "MX"),
            Attribute("q", "Quality", "MX"),
            Attribute("sVC", f"Struct:{scale}", "CF"),
        ),
    )


def _plate(kind: str, *names: str) -> ObjectType:
    return ObjectType(kind, tuple(Attribute(name, "VisString255", "DC") for name in names))


MODEL = Attribute("ctlModel", "Enum:CtlModelKind", "CF")
PHASES = ("phsA", "phsB", "phsC")
OBJECT_TYPES = {
    "ENS_Beh": _status("ENS", "Enum:BehaviourModeKind"),
    "ENS_Health": _status("ENS", "Enum:HealthKind"),
    "ENS_AutoRecSt": _status("ENS", "Enum:AutoReclosingKind"),
    "ENC_Mod": _status("ENC", "Enum:BehaviourModeKind", MODEL),
    "SPS": _status("SPS", "BOOLEAN"),
    "SPC": _status("SPC", "BOOLEAN", MODEL),
    "INS": _status("INS", "INT32"),
    "DPC": _status("DPC", "Dbpos", MODEL),
    "ACT": ObjectType(
        "ACT", (*(Attribute(name, "BOOLEAN", "ST") for name in ("general", *PHASES)), *_quality("ST"))
    ),
    "MV": _measurement("MV", "mag", "AnalogueValue_f"),
    "CMV": _measurement("CMV", "cVal", "Vector"),
    "WYE": ObjectType("WYE", objects=tuple((phase, "CMV") for phase in PHASES)),
    "SAV_A": _samples("Scale_A"),
    "SAV_V": _samples("Scale_V"),
    "LPL": _plate("LPL", "vendor", "swRev", "d", "configRev"),
    "DPL": _plate("DPL", "vendor"),
}


def _scale(factor: float) -> tuple[Attribute, Attribute]:
    return Attribute("scaleFactor", "FLOAT32", value=f"{factor:g}"), Attribute("offset", "FLOAT32", value="0")


STRUCTURES = {
    "Vector": (Attribute("mag", "Struct:AnalogueValue_f"), Attribute("ang", "Struct:AnalogueValue_f")),
    "AnalogueValue_f": (Attribute("f", "FLOAT32"),),
    "AnalogueValue_i": (Attribute("i", "INT32"),),
    "Scale_A": _scale(CURRENT_LSB),
    "Scale_V": _scale(VOLTAGE_LSB),
}
"""What is part of another comes after it."""
ENUMERATIONS = {
    "BehaviourModeKind": {1: "on", 2: "blocked", 3: "test", 4: "test/blocked", 5: "off"},
    "HealthKind": {1: "Ok", 2: "Warning", 3: "Alarm"},
    "AutoReclosingKind": {1: "Ready", 2: "In Progress", 3: "Successful"},
    "CtlModelKind": {0: "status-only"},
}
BEHAVIOUR = ("Beh", "ENS_Beh")


def _measured(*names: str) -> tuple[tuple[str, str], ...]:
    return tuple((name, "MV") for name in names)


NODE_TYPES = {
    kind: NodeType(f"faultloop_{kind}", objects)
    for kind, objects in {
        "LLN0": (("Mod", "ENC_Mod"), BEHAVIOUR, ("Health", "ENS_Health"), ("NamPlt", "LPL")),
        "LPHD": (("PhyNam", "DPL"), ("PhyHealth", "ENS_Health"), ("Proxy", "SPS"), ("Sim", "SPC")),
        "PTRC": (BEHAVIOUR, ("Tr", "ACT")),
        "RREC": (BEHAVIOUR, ("OpCls", "ACT"), ("AutoRecSt", "ENS_AutoRecSt")),
        "PSCH": (BEHAVIOUR, ("Op", "ACT"), ("TxPrm", "ACT"), ("TxTr", "ACT")),
        "RBRF": (BEHAVIOUR, ("OpEx", "ACT")),
        "XCBR": (
            BEHAVIOUR,
            ("Loc", "SPS"),
            ("OpCnt", "INS"),
            ("Pos", "DPC"),
            ("BlkOpn", "SPC"),
            ("BlkCls", "SPC"),
        ),
        "MMXU": (BEHAVIOUR, ("Hz", "MV"), ("PhV", "WYE"), ("A", "WYE")),
        "GGIO": (BEHAVIOUR, *((f"IntIn{n}", "INS") for n in (1, 2, 3, 4)), *_measured("AnIn1", "AnIn2")),
        "TCTR": (BEHAVIOUR, ("AmpSv", "SAV_A")),
        "TVTR": (BEHAVIOUR, ("VolSv", "SAV_V")),
    }.items()
}


def add_templates(root: ET.Element, kinds: Iterable[str]) -> None:
    """The types of these classes of logical nodes, and all that they are made of."""
    templates = ET.SubElement(root, "DataTypeTemplates")
    nodes = [(kind, NODE_TYPES[kind]) for kind in kinds]
    for kind, node in nodes:
        element = ET.SubElement(templates, "LNodeType", id=node.id, lnClass=kind)
        for name, type in node.objects:
            ET.SubElement(element, "DO", name=name, type=type)
    wanted = {type for _, node in nodes for _, type in node.objects}
    wanted |= {inner for type in wanted for _, inner in OBJECT_TYPES[type].objects}
    attributes: list[Attribute] = []
    for id, type in OBJECT_TYPES.items():
        if id in wanted:
            attributes += type.attributes
            element = ET.SubElement(templates, "DOType", id=id, cdc=type.kind)
            for name, inner in type.objects:
                ET.SubElement(element, "SDO", name=name, type=inner)
            for attribute in type.attributes:
                _add(element, "DA", attribute)
    for id, parts in STRUCTURES.items():
        if f"Struct:{id}" in {attribute.type for attribute in attributes}:
            attributes += parts
            element = ET.SubElement(templates, "DAType", id=id)
            for part in parts:
                _add(element, "BDA", part)
    for id, values in ENUMERATIONS.items():
        if f"Enum:{id}" in {attribute.type for attribute in attributes}:
            element = ET.SubElement(templates, "EnumType", id=id)
            for value, text in values.items():
                ET.SubElement(element, "EnumVal", ord=str(value)).text = text


def _add(parent: ET.Element, tag: str, attribute: Attribute) -> None:
    basic, _, type = attribute.type.partition(":")
    keys = {"name": attribute.name, "bType": basic} | ({"type": type} if type else {})
    if attribute.constraint is not None:
        keys |= {"fc": attribute.constraint}
    element = ET.SubElement(parent, tag, keys)
    if attribute.value is not None:
        ET.SubElement(element, "Val").text = attribute.value
