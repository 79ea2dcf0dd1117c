# SPDX-License-Identifier: GPL-3.0-or-later
"""A CID that an engineer's tool has written, into a configuration: the way back from `rtud --scl --cid`.

docs/iec61850.md, "A CID back". Needs Python alone, so that it runs where the CID was edited; rtud, as root,
reads no XML. Exit codes: 0 taken, 1 the CID has what the gateway cannot be, 2 an unusable file: each printed.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from nuc980.errors import UnusableInput
from openrtu_tools import document
from openrtu_tools.document import Json

Key = tuple[str, str, str]  # logical device, logical node, data object

SIZE_MAX, DEPTH_MAX = 64 << 20, 32
SCL = "{http://www.iec.ch/61850/2003/SCL}"
ADDRESS_104 = "{http://www.iec.ch/61850-80-1/2007/IEC_60870-5-104}Address"
TRIGGERS = ("dchg", "qchg", "dupd", "period", "gi")
OPTIONS = ("seqNum", "timeStamp", "dataSet", "reasonCode", "dataRef", "entryID", "configRef", "bufOvfl")
PRESENT = {"gi": "true", "bufOvfl": "true"}  # what is set if it is not said (IEC 61850-6)
OF_BUFFERED = ("entryID", "bufOvfl")
NOT_SERVED = ("LogControl", "SettingControl", "SampledValueControl", "Log", "Inputs")
INSTANCES_MAX = 16


class SclError(UnusableInput):
    """A file that is not what it should be; its text says why."""


def parse(path: Path) -> Element:
    """An XML file without a document type, and so without entities, of bounded size and depth."""
    try:
        octets = path.read_bytes() if path.stat().st_size <= SIZE_MAX else None
    except OSError as error:
        raise SclError(f"{path}: {error.strerror}") from error
    if octets is None:
        raise SclError(f"{path}: is longer than {SIZE_MAX >> 20} MiB, which no CID of a gateway is")
    parser = expat.ParserCreate(namespace_separator="}")
    tree, depth = TreeBuilder(), 0

    def refuse(*_: object) -> None:
        raise SclError(f"{path}:{parser.CurrentLineNumber}: has a DOCTYPE, which no SCL file has: remove it")

    def named(name: str) -> str:
        return "{" + name if "}" in name else name

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEPTH_MAX:
            raise SclError(f"{path}:{parser.CurrentLineNumber}: is nested deeper than {DEPTH_MAX} elements")
        tree.start(named(name), {named(key): value for key, value in attributes.items()})

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        tree.end(named(name))

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = tree.data
    try:
        parser.Parse(octets, True)
    except expat.ExpatError as error:
        raise SclError(f"{path}: {error}") from error
    root = tree.close()
    if root.tag != SCL + "SCL":
        raise SclError(f"{path}: is no SCL file: its first element is {root.tag}")
    return root


def all_of(parent: Element, *names: str) -> list[Element]:
    return parent.findall("/".join(SCL + name for name in names))


def one_of(parent: Element, *names: str) -> Element | None:
    return parent.find("/".join(SCL + name for name in names))


def node_name(element: Element) -> str:
    number = element.get("inst", element.get("lnInst", ""))
    return element.get("prefix", "") + element.get("lnClass", "LLN0") + number


@dataclass
class Device:
    """A logical device: data objects, where 104 has them, data sets and control blocks."""

    objects: dict[Key, dict[str, str]] = field(default_factory=dict)  # type by FC and path
    models: dict[Key, str] = field(default_factory=dict)
    units: dict[Key, str] = field(default_factory=dict)
    limits: dict[Key, dict[str, float]] = field(default_factory=dict)  # of rangeC, by name
    texts: dict[Key, str] = field(default_factory=dict)  # d
    addresses: dict[Key, tuple[int, int]] = field(default_factory=dict)
    sets: dict[tuple[str, str], list[Element]] = field(default_factory=dict)  # by logical node and name
    reports: list[tuple[str, Element]] = field(default_factory=list)  # each with its logical node
    goose: list[Element] = field(default_factory=list)


class File:
    """One IED of an SCL file."""

    def __init__(self, path: Path, ied: str | None) -> None:
        self.root, self.errors = parse(path), list[str]()
        ieds = [each for each in all_of(self.root, "IED") if ied is None or each.get("name") == ied]
        if len(ieds) != 1:
            known = ", ".join(each.get("name", "") for each in all_of(self.root, "IED"))
            raise SclError(f"{path}: expected one IED, has {known or 'none'}: say which with --ied")
        self.ied = ieds[0]
        self.name = self.ied.get("name", "")
        templates = one_of(self.root, "DataTypeTemplates")
        self.types = {} if templates is None else {each.get("id", ""): each for each in templates}
        self.devices = {
            each.get("inst", ""): self._device(each)
            for each in all_of(self.ied, "AccessPoint", "Server", "LDevice")
        }

    def _attributes(self, parent: Element | None, fc: str, path: str, deep: int) -> Iterator[tuple[str, str]]:
        for each in [] if parent is None or deep > DEPTH_MAX else parent:
            if each.tag not in (SCL + "DA", SCL + "BDA"):
                continue
            name = f"{path}.{each.get('name')}" if path else each.get("name", "")
            of = each.get("fc", fc)
            yield f"{of} {name}", each.get("bType", "")
            if each.get("bType") == "Struct":
                yield from self._attributes(self.types.get(each.get("type", "")), of, name, deep + 1)

    def _device(self, element: Element) -> Device:
        device, inst = Device(), element.get("inst", "")
        for ln in [*all_of(element, "LN0"), *all_of(element, "LN")]:
            node = node_name(ln)
            for data in self.types.get(ln.get("lnType", ""), []):
                key = (inst, node, data.get("name", ""))
                kind = self.types.get(data.get("type", ""))
                device.objects[key] = dict(self._attributes(kind, "", "", 0))
                for each in [] if kind is None else all_of(kind, "DA"):
                    value = one_of(each, "Val")
                    if each.get("name") == "ctlModel" and value is not None:
                        device.models[key] = value.text or ""
            for data in all_of(ln, "DOI"):
                self._instance(device, (inst, node, data.get("name", "")), data)
            self._blocks(device, inst, node, ln)
        return device

    @staticmethod
    def _instance(device: Device, key: Key, data: Element) -> None:
        for each in all_of(data, "DAI"):
            value = one_of(each, "Val")
            if each.get("name") == "ctlModel" and value is not None:
                device.models[key] = value.text or ""
            if each.get("name") == "d" and value is not None:
                device.texts[key] = value.text or ""
        for each in (each for each in all_of(data, "SDI") if each.get("name") == "units"):
            values = [(part.get("name"), one_of(part, "Val")) for part in all_of(each, "DAI")]
            device.units[key] = " ".join(
                sorted(f"{name}={value.text or ''}" for name, value in values if value is not None)
            )
        for each in (each for each in all_of(data, "SDI") if each.get("name") == "rangeC"):
            values = [(part.get("name", ""), one_of(part, "DAI", "Val")) for part in all_of(each, "SDI")]
            device.limits[key] = {
                name: float(value.text or "") for name, value in values if value is not None
            }
        address = next(data.iter(ADDRESS_104), None)
        if address is not None:
            device.addresses[key] = int(address.get("casdu", "0")), int(address.get("ioa", "0"))

    def _blocks(self, device: Device, inst: str, node: str, ln: Element) -> None:
        where = f"{inst}/{node}"
        if node != "LLN0" and all_of(ln, "GSEControl"):
            self.errors.append(f"{where}: has GSEControl, which this gateway has in LLN0 alone")
        for name in NOT_SERVED:
            self.errors += [f"{where}: has {name}, which this gateway has not" for _ in all_of(ln, name)[:1]]
        device.sets |= {(node, each.get("name", "")): all_of(each, "FCDA") for each in all_of(ln, "DataSet")}
        device.reports += [(node, each) for each in all_of(ln, "ReportControl")]
        if node == "LLN0":
            device.goose = all_of(ln, "GSEControl")

    def address(self, *names: str, inst: str = "", block: str = "") -> tuple[dict[str, str], Element | None]:
        """The P elements of the IED's access point, or of a GOOSE control block; and what holds them."""
        for access in self.root.iter(SCL + "ConnectedAP"):
            if access.get("iedName") != self.name:
                continue
            for each in [access] if not names else all_of(access, *names):
                if not names or (each.get("ldInst"), each.get("cbName")) == (inst, block):
                    return {
                        p.get("type", ""): (p.text or "").strip() for p in all_of(each, "Address", "P")
                    }, each
        return {}, None


@dataclass
class Taker:
    """Compares what a CID says with what the gateway is, and changes its configuration."""

    config: Json
    own: File
    cid: File
    errors: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    points: dict[tuple[int, int], str] = field(default_factory=dict)

    def take(self) -> None:
        self.errors += self.cid.errors
        for device in self.own.devices.values():
            self.points |= {address: device.texts.get(key, "") for key, address in device.addresses.items()}
        for inst in self.own.devices.keys() - self.cid.devices.keys():
            self.errors.append(f"{inst}: the file lacks this logical device, which the map has")
        for inst in self.cid.devices.keys() - self.own.devices.keys():
            self.errors.append(f"{inst}: the map has no such logical device")
        self.take_addresses()
        publish: list[Json] = []
        chosen: list[Json] = []
        for inst in sorted(self.own.devices.keys() & self.cid.devices.keys()):
            own, cid = self.own.devices[inst], self.cid.devices[inst]
            self.take_names(own, cid)
            self.compare(own, cid)
            publish += [self.goose(inst, block) for block in cid.goose]
            if self.blocks(own) != self.blocks(cid) or self.has_chosen(own):
                chosen += self.data_sets(inst, cid)
        self.put("iec61850", "data_sets", chosen)
        self.put_goose(publish)

    def put(self, section: str, key: str, value: Any) -> None:
        target = self.config[section]
        if value == target.get(key, [] if isinstance(value, list) else None):
            return
        self.notes.append(f"{section}.{key}: taken from the file")
        target[key] = value

    # ---- names and addresses

    def take_addresses(self) -> None:
        parts, _ = self.cid.address()
        self.put("iec61850", "ied", self.cid.name) if self.cid.name != self.own.name else None
        host, port = parts.get("IP") or parts.get("IPv6"), parts.get("MMS-Port", "102")
        mine, _ = self.own.address()
        if host is not None and host not in (mine.get("IP"), mine.get("IPv6")):
            self.put("iec61850", "address", host)
        if parts and port != mine.get("MMS-Port", "102"):
            self.put("iec61850", "port", int(port))

    def objects_named(self, name: str, inside: Any) -> Iterator[Json]:
        if isinstance(inside, dict):
            if inside.get("name") == name and ("address" in inside or "ioa" in inside):
                yield inside
            for key, value in inside.items():
                if key not in ("iec61850", "templates"):
                    yield from self.objects_named(name, value)
        elif isinstance(inside, list):
            for each in inside:
                yield from self.objects_named(name, each)

    def take_names(self, own: Device, cid: Device) -> None:
        """What has another name than before has its address of 104 still."""
        before = {address: key for key, address in own.addresses.items()}
        for key, address in cid.addresses.items():
            now = ".".join(key[1:])
            if address not in before:
                self.errors.append(
                    f"{'/'.join(key[:2])}.{key[2]}: the map has no CA {address[0]} IOA {address[1]}"
                )
            elif before[address] != key:
                found = list(self.objects_named(self.points[address], self.config))
                if len(found) == 1:
                    found[0]["ln"] = now
                    self.notes.append(f'"{self.points[address]}": is {now}')
                else:
                    self.errors.append(
                        f'"{self.points[address]}": give it "ln": "{now}" by hand, and begin anew'
                    )

    # ---- what both have

    def compare(self, own: Device, cid: Device) -> None:
        places = {address: key for key, address in cid.addresses.items()}
        moved = {key: places[address] for key, address in own.addresses.items() if address in places}
        names = {moved.get(key, key): key for key in own.objects}
        # What the class of a node has to have comes with its first point.
        new_nodes = {key[:2] for key in moved.values()} - {key[:2] for key in own.objects}
        for key in names.keys() - cid.objects.keys():
            self.notes.append(
                f"{'/'.join(key[:2])}.{key[2]}: the file lacks this data object, clients will see it"
            )
        for key in cid.objects.keys() - names.keys():
            if key[:2] in new_nodes:
                continue
            self.errors.append(f"{'/'.join(key[:2])}.{key[2]}: the map has no such data object")
        for key in sorted(cid.objects.keys() & names.keys()):
            where, before = f"{'/'.join(key[:2])}.{key[2]}", names[key]
            for path, kind in cid.objects[key].items():
                if own.objects[before].get(path) != kind and before == key:
                    self.errors.append(
                        f"{where}: {path} is {own.objects[before].get(path, 'not there')}, not {kind}"
                    )
            if key in cid.units and cid.units[key] != own.units.get(before):
                self.errors.append(
                    f"{where}: is in {own.units.get(before, 'no unit')}, not in {cid.units[key]}: "
                    'the point\'s "unit" makes it'
                )
            for limit, value in cid.limits.get(key, {}).items():
                mine = own.limits.get(before, {}).get(limit)
                if value != mine:
                    self.errors.append(
                        f"{where}: {limit} of rangeC is {mine}, not {value}: "
                        '"limits" of "iec61850" in the configuration makes it'
                    )
            if cid.models.get(key) != own.models.get(before) and key in cid.models:
                wanted = cid.models[key]
                self.errors.append(
                    f"{where}: ctlModel is {own.models.get(before, 'not there')}, not {wanted}: "
                    "select, control_security and controllers of the configuration make it"
                )

    # ---- data sets

    @staticmethod
    def blocks(device: Device) -> tuple[Any, ...]:
        return (
            {name: [sorted(member.items()) for member in members] for name, members in device.sets.items()},
            [
                (node, sorted(each.items()), [(part.tag, sorted(part.items())) for part in each])
                for node, each in device.reports
            ],
        )

    def has_chosen(self, device: Device) -> bool:
        """Whether the configuration names data sets of it: all of them are written again."""
        chosen = [each["points"] for each in self.config["iec61850"].get("data_sets", [])]
        names = {member.partition("[")[0] for members in chosen for member in members}
        return any(self.points[address] in names for address in device.addresses.values())

    def members(self, inst: str, name: str, node: str = "LLN0") -> list[tuple[str, str | None]]:
        """Points and attributes of a data set."""
        found, device = [], self.cid.devices[inst]
        for each in device.sets.get((node, name), []):
            key = (each.get("ldInst", ""), node_name(each), each.get("doName", ""))
            address = device.addresses.get(key)
            fc, attribute = each.get("fc", ""), each.get("daName")
            if address not in self.points or fc not in ("ST", "MX"):
                self.errors.append(
                    f"{inst}/{node}.{name}: {'/'.join(key[:2])}.{key[2]} [{fc}] is no point with ST or MX"
                )
            else:
                found.append((self.points[address], attribute))
        if (node, name) not in device.sets:
            self.errors.append(f"{inst}/{node}: has no data set {name}, which a control block names")
        return found

    def data_sets(self, inst: str, device: Device) -> list[Json]:
        found = []
        for node, each in device.reports:
            if (node, each.get("datSet")) not in device.sets:
                self.errors.append(
                    f"{inst}/{node}: has no data set {each.get('datSet')}, which a control block names"
                )
        of_goose = {("LLN0", each.get("datSet")) for each in device.goose} - {
            (node, each.get("datSet")) for node, each in device.reports
        }
        for node, name in device.sets:
            if (node, name) in of_goose:
                continue
            members = self.members(inst, name, node)
            points = [point if attribute is None else f"{point}[{attribute}]" for point, attribute in members]
            one: Json = {"name": name, "points": list(dict.fromkeys(points))}
            if node != "LLN0":
                one["ln"] = node
            reports = [each for of, each in device.reports if of == node and each.get("datSet") == name]
            revisions = {int(each.get("confRev", "0")) for each in reports}
            if len(revisions) > 1:
                self.errors.append(
                    f"{inst}/{node}.{name}: its control blocks have several confRev, expected one"
                )
            elif revisions and revisions != {0}:
                one["conf_rev"] = revisions.pop()
            if reports:
                one["reports"] = [self.report(f"{inst}/{node}", each) for each in reports]
            found.append(one)
        return found

    def report(self, place: str, element: Element) -> Json:
        name, buffered = element.get("name", ""), element.get("buffered", "false") == "true"
        enabled, where = one_of(element, "RptEnabled"), f"{place}.{element.get('name')}"
        count = 1 if enabled is None else int(enabled.get("max", "1"))
        if element.get("indexed", "true") != "true":
            self.notes.append(f"{where}: is not indexed in the file, clients see {name}01")
        if count > INSTANCES_MAX:
            self.errors.append(f"{where}: RptEnabled is {count}, expected {INSTANCES_MAX} at most")
        one: Json = {"name": name, "instances": count}
        if buffered:
            one["buffered"] = True
        if element.get("rptID"):
            one["id"] = element.get("rptID")
        for key, part, words in (("triggers", "TrgOps", TRIGGERS), ("options", "OptFields", OPTIONS)):
            present = one_of(element, part)
            given = {} if present is None else present.attrib
            one[key] = [
                word
                for word in words
                if given.get(word, PRESENT.get(word, "false")) in ("true", "1")
                and (buffered or word not in OF_BUFFERED)
            ]
        for key, attribute in (("buffer_ms", "bufTime"), ("integrity_ms", "intgPd")):
            if int(element.get(attribute, "0")) != 0:
                one[key] = int(element.get(attribute, "0"))
        return one

    # ---- GOOSE

    def goose(self, inst: str, element: Element) -> Json:
        name, data_set = element.get("name", ""), element.get("datSet", "")
        members = self.members(inst, data_set)
        parts, holder = self.cid.address("GSE", inst=inst, block=name)
        ld = f"{self.cid.name}{inst}"
        one: Json = {
            "name": name[:16],
            "control_block": f"{ld}/LLN0$GO${name}",
            "data_set": f"{ld}/LLN0${data_set}",
            "id": element.get("appID", name),
            "conf_rev": int(element.get("confRev", "1")),
            "points": list(dict.fromkeys(point for point, _ in members)),
        }
        before = self.config.get("goose", {}).get("publish", [])
        known = next((each for each in before if each.get("control_block") == one["control_block"]), {})
        one["name"] = known.get("name", one["name"])
        if holder is None or "MAC-Address" not in parts or "APPID" not in parts:
            self.errors.append(f"{ld}/LLN0.{name}: has no GSE with MAC-Address and APPID under Communication")
            return one
        one["destination"] = parts["MAC-Address"].replace("-", ":").lower()
        one["app_id"] = int(parts["APPID"], 16)
        if "VLAN-ID" in parts:
            one["vlan"] = int(parts["VLAN-ID"], 16)
            one["vlan_priority"] = int(parts.get("VLAN-PRIORITY", "4"))
        for key, tag in (("min_ms", "MinTime"), ("max_ms", "MaxTime")):
            limit = one_of(holder, tag)
            if limit is not None:
                one[key] = int(limit.text or "0")
        quality = any(attribute == "q" for _, attribute in members)
        time = any(attribute == "t" for _, attribute in members)
        one["quality"], one["time"] = quality, time
        for point in one["points"]:
            have = [attribute for name, attribute in members if name == point]
            wanted = len(have) == 1 + quality + time and have[1:] == ["q"] * quality + ["t"] * time
            if not wanted or have[0] is None:
                self.errors.append(
                    f'{ld}/LLN0.{data_set}: has of "{point}" {", ".join(str(each) for each in have)}: '
                    "expected of each point its value, then q and t of all or of none"
                )
        return one

    def put_goose(self, publish: list[Json]) -> None:
        if not publish and "goose" not in self.config:
            return
        goose = self.config.setdefault("goose", {})
        others = [
            each
            for each in goose.get("publish", [])
            if not each["control_block"].startswith((self.own.name + "CA", self.cid.name + "CA"))
        ]
        if [plain(each) for each in others + publish] == [plain(each) for each in goose.get("publish", [])]:
            return
        if "interface" not in goose:
            self.errors.append(
                'goose: the file has GOOSE control blocks: give the configuration "goose" an "interface"'
            )
        goose["publish"] = others + [plain(each) for each in publish]
        self.notes.append("goose.publish: taken from the file")


def plain(publication: Json) -> Json:
    """A publication without what is so anyway."""
    anyway = {"id": publication["name"], "conf_rev": 1, "quality": True, "time": False}
    anyway |= {"vlan_priority": 4, "min_ms": 4, "max_ms": 1000}
    return {key: value for key, value in publication.items() if anyway.get(key) != value}


def read_config(path: Path) -> Json:
    config = document.read(path)
    if not isinstance(config.get("iec61850"), dict):
        raise SclError(f'{path}: has no object "iec61850", and so no server to configure: add one')
    goose = config.get("goose", {})
    if not isinstance(goose, dict):
        raise SclError(f"{path}: goose: is not an object")
    for number, each in enumerate(document.objects(goose, "publish", f"{path}: goose.")):
        for key in ("name", "control_block"):
            document.text(each, key, f"{path}: goose.publish[{number}].")
    return config


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("config", type=Path, help="the configuration as it is")
    parser.add_argument("cid", type=Path, help="the CID, or an SCD that has the gateway")
    parser.add_argument(
        "--own", type=Path, required=True, help="what rtud --scl --cid says of the configuration"
    )
    parser.add_argument("--ied", help="which IED of the CID is the gateway, if it has several")


def run(parsed: argparse.Namespace) -> int:
    try:
        taker = Taker(read_config(parsed.config), File(parsed.own, None), File(parsed.cid, parsed.ied))
        taker.take()
    except (ValueError, KeyError) as error:
        raise SclError(f"{parsed.cid}: has what is no number where one is expected: {error}") from error
    for text in [*taker.notes, *taker.errors]:
        print(text, file=sys.stderr)
    if taker.errors:
        return 1
    json.dump(taker.config, sys.stdout, indent=2, ensure_ascii=False)
    print()
    return 0
