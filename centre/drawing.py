# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a process picture: an SVG and what its elements are bound to. docs/process-pictures.md.

What is served is written anew from what is known here: elements, attributes and properties that are not named
below do not reach a browser, whatever an XML parser of others makes of the file. What could run, or ask
somebody else, is refused by name, so that who drew it learns of it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from openrtu_tools.centre.bindings import ATTRIBUTES, OF_EDITORS, BindingError, read_binding

Json = dict[str, Any]

SVG, XLINK, XML = (
    "http://www.w3.org/2000/svg",
    "http://www.w3.org/1999/xlink",
    "http://www.w3.org/XML/1998/namespace",
)
# What editors keep for themselves; it is left out without a word.
EDITORS = (
    "http://www.inkscape.org/namespaces/inkscape",
    "http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd",
    "http://creativecommons.org/ns#",
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "http://purl.org/dc/elements/1.1/",
)
OCTETS_MOST = 4 * 1024 * 1024
ELEMENTS_MOST = 20_000
DEPTH_MOST = 64
DRAWN_MOST = 100_000  # elements, each as often as it is referred to
MISTAKES_MOST = 100

SHAPES = {"path", "rect", "circle", "ellipse", "line", "polyline", "polygon", "text", "tspan", "use"}
REFERRED = {
    "defs", "symbol", "linearGradient", "radialGradient", "stop", "clipPath", "mask", "marker", "pattern",
}  # fmt: skip
ELEMENTS = SHAPES | REFERRED | {"svg", "g", "title", "desc", "style"}
WITH_TEXT = {"text", "tspan", "title", "desc", "style"}
LEFT_OUT = {"metadata", "view", "filter"}
FILTER = re.compile(r"fe(?!Image)[A-Z]\w*")  # a part of one
WHY = {
    "script": "a picture runs nothing",
    "foreignObject": "a picture is no page",
    "image": "a picture has no pictures of others in it: draw it, or trace it to paths",
    "a": "a link to another picture is data-picture",
    "animate": "a picture moves by its values alone",
    "set": "a picture moves by its values alone",
    "animateTransform": "a picture moves by its values alone",
    "animateMotion": "a picture moves by its values alone",
    "textPath": "write the text without a path, or make it a path",
}
_PROPERTIES = """
alignment-baseline baseline-shift clip-path clip-rule color display dominant-baseline fill fill-opacity
fill-rule font-family font-size font-stretch font-style font-variant font-weight letter-spacing marker
marker-end marker-mid marker-start mask opacity paint-order shape-rendering stop-color stop-opacity stroke
stroke-dasharray stroke-dashoffset stroke-linecap stroke-linejoin stroke-miterlimit stroke-opacity
stroke-width text-anchor text-decoration text-rendering vector-effect visibility white-space word-spacing
"""
PROPERTIES = frozenset(_PROPERTIES.split())
_GEOMETRY = """
class clipPathUnits cx cy d dx dy fr fx fy gradientTransform gradientUnits height lengthAdjust markerHeight
markerUnits markerWidth maskContentUnits maskUnits offset orient pathLength patternContentUnits
patternTransform patternUnits points preserveAspectRatio r refX refY rotate rx ry spreadMethod textLength
transform viewBox width x x1 x2 y y1 y2
"""
GEOMETRY = frozenset(_GEOMETRY.split())
SOURCES = ("href", "src", "data", "action", "formaction")
CSS_TRICKS = {"\\": "an escape", "@": "an @ rule", "/*": "a comment without end", "<": "<"}
OWN = "p-"  # before each id, so that none is one of the page's

NAME = re.compile(r"[\w.:-]+")
VALUE = re.compile(r"[\w\s.,%#()+'\"/-]*")
NO_NAME = re.compile(r"[^\w-]")
FUNCTIONS = {"rgb", "rgba", "hsl", "hsla", "url"}
REFERENCE = re.compile(r"url\(\s*(['\"]?)#([\w.:-]+)\1\s*\)")
ANY_URL = re.compile(r"url\s*\(", re.IGNORECASE)
SELECTOR = re.compile(r"(?:\*|[\w-]+)?(?:[.#][\w-]+)*(?:\s*>\s*|\s+|$)")
LENGTH = re.compile(r"([0-9.]+)\s*(?:px|mm|cm|in|pt|pc)?")


@dataclass(frozen=True)
class Mistake:
    line: int
    text: str
    refused: bool = False  # it could do harm: the picture is not shown


@dataclass
class Drawing:
    """What the page gets, and what is wrong."""

    title: str = ""
    version: str = ""  # of its file
    markup: str = ""
    css: str = ""
    bound: list[Json] = field(default_factory=list)  # by the number in data-bound
    lines: list[int] = field(default_factory=list)  # of each of these
    mistakes: list[Mistake] = field(default_factory=list)

    @property
    def is_refused(self) -> bool:
        return any(mistake.refused for mistake in self.mistakes)

    def names(self) -> list[tuple[str, int, bool]]:
        """Of points, as the picture calls them: the line, and whether it is to take commands."""
        named = []
        for each, line in zip(self.bound, self.lines, strict=True):
            if "point" in each:
                named.append((each["point"], line, False))
            if "command" in each:
                named.append((each["command"], line, True))
        return named


@dataclass
class _Node:
    tag: str
    line: int
    depth: int
    attributes: dict[str, str] = field(default_factory=dict)
    children: list[_Node | str] = field(default_factory=list)
    owner: int | None = None  # the binding that has its point
    in_defs: bool = False

    def elements(self) -> list[_Node]:
        return [child for child in self.children if isinstance(child, _Node)]


class _StopError(Exception):
    """There is no sense in reading on."""


# Of a file of 4 MiB: each looks at a character once or twice.


def _functions(value: str) -> set[str]:
    """What is called.

    >>> _functions("translate(1) URL (#a) ((2))") == {"translate", "url"}
    True
    """
    names = {NO_NAME.split(before.rstrip())[-1].lower() for before in value.split("(")[:-1]}
    return names - {""}


def _without_comments(css: str) -> str:
    """One that does not end stays.

    >>> _without_comments("a/* /* */b/*/*/c/**/d/*e"), _without_comments("/*/")
    ('a b c d/*e', '/*/')
    """
    kept, at = [], 0
    while (begin := css.find("/*", at)) >= 0 and (end := css.find("*/", begin + 2)) >= 0:
        kept.append(css[at:begin])
        at = end + 2
    return " ".join([*kept, css[at:]])


def read_drawing(octets: bytes) -> Drawing:
    return _Reader().read(octets)


class _Reader:
    def __init__(self) -> None:
        self.drawing = Drawing()
        self.parser = expat.ParserCreate(namespace_separator=" ")
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._begin
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.EntityDeclHandler = self._doctype
        self.parser.ProcessingInstructionHandler = self._instruction
        self.root: _Node | None = None
        self.open: list[_Node] = []
        self.skipping = 0  # elements that are open, and left out
        self.count = 0
        self.css: list[str] = []

    def read(self, octets: bytes) -> Drawing:
        if len(octets) > OCTETS_MOST:
            self._refuse(f"the file has more than {OCTETS_MOST // 1024 // 1024} MiB", 1)
            return self.drawing
        try:
            self.parser.Parse(octets, True)
        except _StopError:
            pass
        except (expat.ExpatError, ValueError, LookupError) as error:
            self._refuse(f"this is no XML: {error}")
        if self.root and not self.drawing.is_refused:
            self._finish(self.root)
        if self.drawing.is_refused:
            self.drawing.markup, self.drawing.css = "", ""
            self.drawing.bound, self.drawing.lines = [], []
        return self.drawing

    # ---- what is wrong ------------------------------------------------------------------------

    def _mistake(self, text: str, line: int | None = None, refused: bool = False) -> None:
        if len(self.drawing.mistakes) < MISTAKES_MOST:
            at = self.parser.CurrentLineNumber if line is None else line
            self.drawing.mistakes.append(Mistake(at, text, refused))
        elif refused:
            raise _StopError

    def _refuse(self, text: str, line: int | None = None) -> None:
        self._mistake(text, line, refused=True)

    def _doctype(self, *_: Any) -> None:
        self._refuse("it has a DOCTYPE, which can name other files and grow without bound")
        raise _StopError

    def _instruction(self, target: str, _: str) -> None:
        self._refuse(f"<?{target}?> is not taken")

    # ---- elements -----------------------------------------------------------------------------

    def _begin(self, name: str, given: dict[str, str]) -> None:
        self.count += 1
        if self.count > ELEMENTS_MOST:
            self._refuse(f"it has more than {ELEMENTS_MOST} elements")
            raise _StopError
        if len(self.open) + self.skipping >= DEPTH_MOST:
            self._refuse(f"its elements are nested deeper than {DEPTH_MOST}")
            raise _StopError
        space, _, tag = name.rpartition(" ")
        if not self.root and (space, tag) != (SVG, "svg"):
            self._refuse(f'its first element is <{tag}>, not <svg xmlns="{SVG}">')
            raise _StopError
        if self.skipping or space in EDITORS or (space == SVG and tag in LEFT_OUT):
            self._look_at_left_out(space, tag, given)
            self.skipping += 1
            return
        if space != SVG:
            self._refuse(f"<{tag}> is of {space or 'no namespace'}, not of SVG")
            self.skipping += 1
            return
        if tag not in ELEMENTS or (tag == "svg" and self.root):
            self._refuse_element(tag)
            self.skipping += 1
            return
        self._take(tag, given)

    def _refuse_element(self, tag: str) -> None:
        why = WHY.get(tag, "")
        self._refuse(f"<{tag}> is not taken{f': {why}' if why else ''}")

    def _look_at_left_out(self, space: str, tag: str, given: dict[str, str]) -> None:
        """It is not drawn; what runs is refused there, too: it was put there on purpose."""
        if (space, tag) == (SVG, "filter"):
            self._mistake("<filter> is left out: blurs and shadows are too slow")
        if space == SVG and tag not in ELEMENTS | LEFT_OUT and not FILTER.fullmatch(tag):
            self._refuse_element(tag)
        for name in given:
            if " " not in name and name.lower().startswith("on"):
                self._refuse(f"{name} is an event handler: a picture runs nothing")

    def _take(self, tag: str, given: dict[str, str]) -> None:
        parent = self.open[-1] if self.open else None
        node = _Node(tag, self.parser.CurrentLineNumber, len(self.open))
        if parent:
            node.owner, node.in_defs = parent.owner, parent.in_defs or parent.tag in REFERRED
            parent.children.append(node)
        else:
            self.root = node
        self.open.append(node)
        bound = {}
        for name, value in given.items():
            space, _, local = name.rpartition(" ")
            if not space and local.startswith("data-"):
                bound[local] = value
            else:
                self._attribute(node, space, local, value)
        self._bind(node, bound)

    def _end(self, _: str) -> None:
        if self.skipping:
            self.skipping -= 1
            return
        node = self.open.pop()
        if node.tag == "style":
            self._sheet(node)

    def _text(self, text: str) -> None:
        if not self.skipping and self.open and self.open[-1].tag in WITH_TEXT:
            self.open[-1].children.append(text)

    # ---- attributes ---------------------------------------------------------------------------

    def _attribute(self, node: _Node, space: str, name: str, value: str) -> None:
        if space in EDITORS or (space == XML and name != "space"):
            return
        if name.lower().startswith("on"):
            self._refuse(f"{name} is an event handler: a picture runs nothing")
        elif name.lower() in SOURCES and (not space or space == XLINK):
            self._source(node, name, value)
        elif ANY_URL.search(value) and not self._is_own(value):
            self._refuse(f"{name}: {value[:60]!r} leads out of the picture")
        elif space == XML:
            node.attributes["xml:space"] = "preserve" if value == "preserve" else "default"
        elif space:
            return
        elif name == "style":
            node.attributes["data-style"] = self._declarations(value)
        elif name == "id":
            if NAME.fullmatch(value):
                node.attributes["id"] = OWN + value
        elif name in PROPERTIES:
            if (taken := self._value(name, value)) is not None:
                node.attributes[name] = taken
        elif name in GEOMETRY:
            node.attributes[name] = value

    def _source(self, node: _Node, name: str, value: str) -> None:
        target = value.strip()
        if name == "href" and target.startswith("#") and NAME.fullmatch(target[1:]):
            node.attributes["href"] = f"#{OWN}{target[1:]}"
        elif value:
            self._refuse(f"{name}: {value[:60]!r} leads out of the picture; only #name of this file is taken")

    def _is_own(self, value: str) -> bool:
        return not ANY_URL.search(REFERENCE.sub("", value))

    def _value(self, name: str, value: str) -> str | None:
        value = value.strip()
        if not self._is_own(value):
            self._refuse(f"{name}: {value[:60]!r} leads out of the picture")
            return None
        if not VALUE.fullmatch(value) or _functions(value) - FUNCTIONS:
            self._refuse(f"{name}: {value[:60]!r} is not taken")
            return None
        return REFERENCE.sub(lambda found: f"url(#{OWN}{found[2]})", value)

    # ---- style --------------------------------------------------------------------------------

    def _plain(self, text: str) -> str | None:
        """CSS without comments; nothing in it hides what it is, or fetches."""
        text = _without_comments(text)
        for sign, what in CSS_TRICKS.items():
            if sign in text:
                self._refuse(f"style: {what} is not taken")
                return None
        if not self._is_own(text):
            self._refuse("style: an url() leads out of the picture")
            return None
        return text

    def _declarations(self, text: str) -> str:
        """Those of known properties; what an editor keeps beside them is left out."""
        plain = self._plain(text)
        taken = []
        for declaration in (plain or "").split(";"):
            name, _, value = declaration.partition(":")
            name = name.strip().lower()
            value = re.sub(r"!\s*important\s*$", "", value)
            if name in PROPERTIES and (known := self._value(name, value)) is not None:
                taken.append(f"{name}:{known}")
        return ";".join(taken)

    def _sheet(self, node: _Node) -> None:
        plain = self._plain("".join(child for child in node.children if isinstance(child, str)))
        node.children = []
        if plain is None:
            return
        *rules, rest = plain.split("}")
        if rest.strip() or any(rule.count("{") != 1 for rule in rules):
            self._refuse("style: this is no list of rules", node.line)
            return
        for rule in rules:
            selectors, _, body = rule.partition("{")
            known = [self._selector(each.strip(), node.line) for each in selectors.split(",")]
            self.css.append(f"{','.join(filter(None, known))}{{{self._declarations(body)}}}")

    def _selector(self, selector: str, line: int) -> str:
        at = 0
        while at < len(selector) and (found := SELECTOR.match(selector, at)) and found.end() > at:
            at = found.end()
        if at < len(selector) or not selector:
            self._refuse(f"style: the selector {selector[:60]!r} is not taken", line)
            return ""
        return selector.replace("#", f"#{OWN}")

    # ---- bindings -----------------------------------------------------------------------------

    def _bind(self, node: _Node, given: dict[str, str]) -> None:
        binding: Json = {}
        for name, text in given.items():
            if name in OF_EDITORS:
                continue
            if name not in ATTRIBUTES:
                self._mistake(f"{name} is none of {', '.join(ATTRIBUTES)}")
                continue
            try:
                binding[name.removeprefix("data-")] = read_binding(name, text)
            except BindingError as error:
                self._mistake(f"{name}: {error}")
        if not binding:
            return
        if node.in_defs or node.tag not in SHAPES | {"g"}:
            self._mistake(f"<{node.tag}> is not drawn here by itself: bind what uses it, or a group or shape")
            return
        if binding.keys() & {"text", "words"} and node.tag not in ("text", "tspan"):
            self._mistake(f"data-text and data-words are for <text> and <tspan>, not for <{node.tag}>")
            return
        number = len(self.drawing.bound)
        if "point" in binding:
            node.owner = number
        elif node.owner is None and binding.keys() - {"picture", "command"}:
            self._mistake("it has no data-point, nor has a group around it")
            return
        if binding.get("command") == "":
            if "point" not in binding:
                self._mistake("data-command without a name is for an element with data-point")
                return
            binding["command"] = binding["point"]
        node.attributes["data-bound"] = str(number)
        self.drawing.bound.append({**binding, "owner": node.owner})
        self.drawing.lines.append(node.line)

    # ---- the whole ----------------------------------------------------------------------------

    def _finish(self, root: _Node) -> None:
        self._view_box(root)
        self._measure(root)
        self.drawing.title = next(
            ("".join(map(str, each.children)).strip() for each in root.elements() if each.tag == "title"), ""
        )
        self.drawing.css = "\n".join(self.css)
        self.drawing.markup = _written(root)

    def _view_box(self, root: _Node) -> None:
        numbers = re.split(r"[\s,]+", root.attributes.get("viewBox", "").strip())
        try:
            _, _, width, height = map(float, numbers)
        except ValueError:
            sizes = [LENGTH.fullmatch(root.attributes.get(name, "").strip()) for name in ("width", "height")]
            try:
                width, height = (float(size[1]) if size else 0.0 for size in sizes)
            except ValueError:
                width = height = 0.0
            root.attributes["viewBox"] = f"0 0 {width:g} {height:g}"
        if not (0 < width < 1e6 and 0 < height < 1e6):
            self._refuse("it has neither a viewBox nor a width and a height", root.line)
        for name in ("width", "height", "x", "y"):
            root.attributes.pop(name, None)

    def _measure(self, root: _Node) -> None:
        """What is referred to is drawn each time: a few lines could be millions of shapes."""
        by_id: dict[str, _Node] = {}
        nodes = [root]
        for node in nodes:
            nodes += node.elements()
            if "id" in node.attributes:
                by_id.setdefault(node.attributes["id"], node)
        sizes: dict[int, int] = {}

        def size(node: _Node, depth: int) -> int:
            if depth > DEPTH_MOST * 2:
                raise _TooMuchError
            if id(node) in sizes:
                if not sizes[id(node)]:
                    raise _TooMuchError  # it refers to itself
                return sizes[id(node)]
            sizes[id(node)] = 0
            total = 1
            for child in node.elements():
                total += size(child, depth + 1)
            for target in _references(node):
                if target in by_id:
                    total += size(by_id[target], depth + 1)
            if total > DRAWN_MOST:
                raise _TooMuchError
            sizes[id(node)] = total
            return total

        try:
            size(root, 0)
        except _TooMuchError:
            self._refuse("its parts refer to each other in a circle, or too often", root.line)


class _TooMuchError(Exception):
    pass


def _references(node: _Node) -> list[str]:
    found = []
    for name, value in node.attributes.items():
        if name == "href":
            found.append(value[1:])
        elif "url(" in value:
            found += [each[2] for each in REFERENCE.finditer(value)]
    return found


def _written(node: _Node) -> str:
    attributes = "".join(f" {name}={quoteattr(value)}" for name, value in node.attributes.items())
    if node.tag == "svg":
        attributes = f' xmlns="{SVG}"{attributes}'
    if node.tag in ("style", "desc"):
        return ""
    inner = "".join(escape(child) if isinstance(child, str) else _written(child) for child in node.children)
    return f"<{node.tag}{attributes}>{inner}</{node.tag}>"
