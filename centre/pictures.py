# SPDX-License-Identifier: GPL-3.0-or-later
"""The process pictures of a folder: what is shown of each, and to whom. docs/process-pictures.md."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from openrtu_tools.centre.drawing import OCTETS_MOST, Drawing, Mistake, read_drawing
from openrtu_tools.centre.model import Json, Model, Point
from openrtu_tools.centre.settings import Settings

PICTURES_MOST = 500
SEPARATOR = "/"


@dataclass
class Names:
    """Which points a picture's names are; of those that are none, why."""

    points: dict[str, int] = field(default_factory=dict)
    unknown: dict[str, str] = field(default_factory=dict)  # "unknown" or "twice"
    stations: set[int] = field(default_factory=set)  # also of points that are not there


class Pictures:
    """Read again when a file has changed. One that is refused is kept as such, and never served."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.read: dict[Path, Drawing] = {}

    def files(self) -> dict[str, Path]:
        """By name: a picture is only found by looking what is there."""
        try:
            found = sorted(self.folder.glob("*.svg")) if self.folder else []
        except OSError:
            found = []
        return {path.stem: path for path in found[:PICTURES_MOST]}

    def drawing(self, name: str) -> Drawing | None:
        path = self.files().get(name) if name else None
        return self._drawing(path) if path else None

    def drawings(self) -> dict[str, Drawing]:
        return {name: self._drawing(path) for name, path in self.files().items()}

    def _drawing(self, path: Path) -> Drawing:
        try:
            state = path.stat()
            version = f"{state.st_mtime_ns}-{state.st_size}"
            known = self.read.get(path)
            if known and known.version == version:
                return known
            drawing = load(path)
        except OSError as error:
            return Drawing(mistakes=[Mistake(1, f"{error.strerror}", refused=True)])
        drawing.version = version
        self.read[path] = drawing
        return drawing

    def points(self, name: str, model: Model) -> frozenset[int]:
        """Whose values a page needs that shows it."""
        drawing = self.drawing(name)
        return frozenset(resolve(drawing, model).points.values()) if drawing else frozenset()


def load(path: Path) -> Drawing:
    """Raises OSError."""
    with path.open("rb") as file:
        return read_drawing(file.read(OCTETS_MOST + 1))


def _splits(name: str) -> Iterable[tuple[str, str]]:
    """A station's and a point's name may have the sign between them, too."""
    parts = name.split(SEPARATOR)
    for count in range(1, len(parts)):
        yield SEPARATOR.join(parts[:count]), SEPARATOR.join(parts[count:])


def resolve(drawing: Drawing, model: Model) -> Names:
    """By the point's name, or by its address, CA.IOA."""
    wanted = {name for name, _, _ in drawing.names()}
    by_name: dict[str, list[int]] = {}
    for station in model.stations.values():
        by_name.setdefault(station.settings.name, []).append(station.id)
    names = Names()
    asked: dict[int, dict[str, str]] = {}  # of a station: by a point's name, the picture's
    for name in wanted:
        for station_name, point_name in _splits(name):
            for id_ in by_name.get(station_name, ()):
                asked.setdefault(id_, {})[point_name] = name
    names.stations = set(asked)
    found: dict[str, list[int]] = {}
    addressed: dict[str, int] = {}
    for point in model.points.values():
        if of_station := asked.get(point.station):
            _sort(point, of_station, found, addressed)
    for name in wanted:
        ids = found.get(name, [])
        if len(ids) == 1:
            names.points[name] = ids[0]
        elif name in addressed:
            names.points[name] = addressed[name]
        else:
            names.unknown[name] = "twice" if ids else "unknown"
    return names


def _sort(
    point: Point, asked: dict[str, str], found: dict[str, list[int]], addressed: dict[str, int]
) -> None:
    if name := asked.get(point.meaning.name):
        found.setdefault(name, []).append(point.id)
    if name := asked.get(f"{point.ca}.{point.ioa}"):
        addressed[name] = point.id


def view(name: str, drawing: Drawing, names: Names) -> Json:
    """What the page is told of one."""
    return {
        "name": name,
        "title": drawing.title or name,
        "version": drawing.version,
        "svg": drawing.markup,
        "css": drawing.css,
        "bound": drawing.bound,
        "points": names.points,
        "unknown": names.unknown,
        "refused": [f"{each.line}: {each.text}" for each in drawing.mistakes if each.refused],
        "mistakes": [f"{each.line}: {each.text}" for each in drawing.mistakes if not each.refused],
    }


# ---- before it is served: `openrtu centre FILE check` --------------------------------------------


def check_links(drawing: Drawing, folder: Path) -> list[Mistake]:
    """Pictures lead to those that lie beside them."""
    return [
        Mistake(line, f"there is no picture {each['picture']} beside it")
        for each, line in zip(drawing.bound, drawing.lines, strict=True)
        if "picture" in each and not (folder / f"{each['picture']}.svg").is_file()
    ]


def check_names(drawing: Drawing, settings: Settings) -> list[Mistake]:
    """Against the lists of points; of a station without one, against its common addresses."""
    addresses = {
        station["name"]: set(map(str, station.get("common_addresses", ())))
        for station in settings.collector["stations"]
    }
    mistakes = []
    for name, line, commands in drawing.names():
        if what := _wrong(name, commands, settings, addresses):
            mistakes.append(Mistake(line, what))
    return list(dict.fromkeys(mistakes))


def _wrong(name: str, commands: bool, settings: Settings, addresses: dict[str, set[str]]) -> str:
    stations = [(station, point) for station, point in _splits(name) if station in settings.stations]
    if not stations:
        return f"there is no station for {name}"
    what = ""
    for station, point in stations:
        points = settings.stations[station].points
        named = [meaning for meaning in points.values() if meaning.name == point]
        ca, _, ioa = point.partition(".")
        if not named and ca.isdigit() and ioa.isdigit():
            if (meaning := points.get((int(ca), int(ioa)))) is not None:
                named = [meaning]
            elif not points and ca in addresses.get(station, ()):
                return "" if not commands else f"{name} takes no commands: {station} has no list of points"
        if len(named) == 1:
            return "" if named[0].command or not commands else f"{name} takes no commands"
        what = what or (
            f"{name} is there {len(named)} times: name it by its address, CA.IOA"
            if named
            else f"{station} has no point {point}"
        )
    return what
