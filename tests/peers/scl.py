# SPDX-License-Identifier: GPL-3.0-or-later
"""An SCL file as IEC 61850-8-1 maps it to MMS: what a client that believes the file expects of the server."""

from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

from lxml import etree

NS = {"": "http://www.iec.ch/61850/2003/SCL"}
NS_104 = "http://www.iec.ch/61850-80-1/2007/IEC_60870-5-104"
BASIC = {  # tag of MMS, and its size; below 0: at most
    "BOOLEAN": (0x83, None),
    "Dbpos": (0x84, 2),
    "Enum": (0x85, 8),
    "INT8": (0x85, 8),
    "INT32": (0x85, 32),
    "INT64": (0x85, 64),
    "INT8U": (0x86, 8),
    "INT32U": (0x86, 32),
    "FLOAT32": (0xA7, None),
    "Quality": (0x84, -13),
    "Check": (0x84, -2),
    "Timestamp": (0x91, None),
    "VisString255": (0x8A, -255),
    "ObjRef": (0x8A, -129),
    "Octet64": (0x89, -64),
}
COMMON = "RptID RptEna {} DatSet ConfRev OptFlds BufTm SqNum TrgOps IntgPd GI"
BLOCK = {  # IEC 61850-8-1, tables 61 and 62
    "RP": (COMMON.format("Resv") + " Owner").split(),
    "BR": (COMMON.format("") + " PurgeBuf EntryID TimeofEntry ResvTms Owner").split(),
}


@cache
def schema() -> Any:
    """IEC's schema 2007B4, which the package carries."""
    return etree.XMLSchema(etree.parse(str(files("scl_loader") / "resources/SCL_Schema/SCL.xsd")))


def errors(text: bytes) -> list[str]:
    found = schema()
    found.validate(etree.fromstring(text))
    return [str(error) for error in found.error_log]


@dataclass
class Device:
    names: set[str] = field(default_factory=set)
    types: dict[str, Any] = field(default_factory=dict)  # of LN$FC$DO
    sets: dict[str, list[str]] = field(default_factory=dict)
    values: dict[str, str] = field(default_factory=dict)  # of an enumeration: the number
    revisions: dict[str, int] = field(default_factory=dict)  # of control blocks


class File:
    def __init__(self, text: bytes) -> None:
        self.root = etree.fromstring(text)
        self.ied = self.root.find("IED", NS)
        self.types = {each.get("id"): each for each in self.root.find("DataTypeTemplates", NS)}
        self.devices = {
            self.ied.get("name") + each.get("inst"): self._device(each)
            for each in self.ied.iterfind(".//LDevice", NS)
        }

    def _parts(self, parent: Any) -> list[tuple[str, Any]]:
        return [
            (each.get("name"), self._type(each))
            for each in parent
            if each.tag.endswith("DA")  # DA, BDA
        ]

    def _type(self, attribute: Any) -> Any:
        if attribute.get("bType") == "Struct":
            return self._parts(self.types[attribute.get("type")])
        return BASIC[attribute.get("bType")]

    def _value(self, attribute: Any, text: str) -> str:
        if attribute.get("bType") != "Enum":
            return text
        numbers = {each.text or "": each.get("ord") for each in self.types[attribute.get("type")]}
        return numbers[text]

    def _instance(self, device: Device, node: str, of: str, kind: str, element: Any) -> None:
        """Values of a data object, or of a structure in it."""
        attributes = {each.get("name"): each for each in self.types[kind]}
        for part in (each for each in element if each.tag.endswith(("DAI", "SDI"))):
            attribute = attributes[part.get("name")]
            fc = attribute.get("fc")  # of a structure's parts: none
            name = f"{node}${fc}${of}${part.get('name')}" if fc else f"{of}${part.get('name')}"
            value = part.find("Val", NS)
            if value is not None:
                device.values[name] = self._value(attribute, value.text or "")
            elif part.tag.endswith("SDI"):
                self._instance(device, node, name, attribute.get("type"), part)

    def _add(self, device: Device, name: str, kind: Any) -> None:
        device.names.add(name)
        if isinstance(kind, list):
            for part, inner in kind:
                self._add(device, f"{name}${part}", inner)

    def _objects(self, device: Device, node: str, ln: Any) -> None:
        device.names.add(node)
        for each in self.types[ln.get("lnType")].iterfind("DO", NS):
            by_fc: dict[str, list[tuple[str, Any]]] = {}
            for attribute in self.types[each.get("type")].iterfind("DA", NS):
                fc = attribute.get("fc")
                by_fc.setdefault(fc, []).append((attribute.get("name"), self._type(attribute)))
                value = attribute.find("Val", NS)
                if value is not None:
                    name = f"{node}${fc}${each.get('name')}${attribute.get('name')}"
                    device.values[name] = self._value(attribute, value.text)
            for fc, parts in by_fc.items():
                device.names.add(f"{node}${fc}")
                self._add(device, f"{node}${fc}${each.get('name')}", parts)
                device.types[f"{node}${fc}${each.get('name')}"] = parts
        kinds = {each.get("name"): each.get("type") for each in self.types[ln.get("lnType")]}
        for each in ln.iterfind("DOI", NS):
            self._instance(device, node, each.get("name"), kinds[each.get("name")], each)

    def _device(self, element: Any) -> Device:
        device = Device()
        for ln in element:
            node = f"{ln.get('prefix', '')}{ln.get('lnClass')}{ln.get('inst')}"
            self._objects(device, node, ln)
            goose = {each.get("datSet") for each in ln.iterfind("GSEControl", NS)}
            for data_set in ln.iterfind("DataSet", NS):
                if data_set.get("name") not in goose:
                    device.sets[f"{node}${data_set.get('name')}"] = [
                        self._member(member) for member in data_set
                    ]
            for block in ln.iterfind("ReportControl", NS):
                fc = "BR" if block.get("buffered") == "true" else "RP"
                for i in range(int(block.find("RptEnabled", NS).get("max"))):
                    name = f"{node}${fc}${block.get('name')}{i + 1:02}"
                    device.names |= {f"{node}${fc}", name} | {f"{name}${part}" for part in BLOCK[fc]}
                    device.revisions[name] = int(block.get("confRev"))
        return device

    @staticmethod
    def _member(member: Any) -> str:
        node = f"{member.get('prefix', '')}{member.get('lnClass')}{member.get('lnInst')}"
        attribute = "".join(f"${part}" for part in member.get("daName", "").split(".") if part)
        return f"{node}${member.get('fc')}${member.get('doName')}{attribute}"
