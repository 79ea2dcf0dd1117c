# SPDX-License-Identifier: GPL-3.0-or-later
"""
Overlays on a base, as fdtoverlay and the kernel put them (libfdt's fdt_overlay.c), but in memory: a finding
still knows the overlay's line, and a mistake is told with its label instead of as FDT_ERR_NOTFOUND.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from nuc980.errors import UnusableInput
from nuc980.pins.board import near
from nuc980.pins.findings import Finding
from nuc980.pins.report import Checked
from nuc980.pins.tree import BODY, CELL, Node, Property, Tree

PHANDLES = ("phandle", "linux,phandle")


def check_overlays(
    base: Tree, overlays: Sequence[Tree], check: Callable[[Tree], list[Finding]]
) -> list[Checked]:
    """
    The findings of the base, and for each overlay those that it brings alone, or only together with those
    before it. Raises UnusableInput for an overlay that fits neither the base nor those before it.
    """
    found = check(base)
    checked = [Checked(base.file, tuple(found))]
    known, together = set(map(_what, found)), base
    for number, overlay in enumerate(overlays):
        by_itself = _alone(base, overlay) if number else applied(base, overlay)
        alone = [one for one in check(by_itself) if _what(one) not in known] if by_itself else []
        together = applied(together, overlay)
        known_now = known | set(map(_what, alone))
        joint = [finding for finding in check(together) if _what(finding) not in known_now] if number else []
        found = [*alone, *(_together(one, overlays[:number]) for one in joint)]
        behind = () if by_itself else tuple(tree.file for tree in overlays[:number])
        checked.append(Checked(overlay.file, tuple(found), behind=behind))
        known = known_now | set(map(_what, joint))
    return checked


def _alone(base: Tree, overlay: Tree) -> Tree | None:
    """The base with an overlay; None: it needs what an earlier one brings."""
    try:
        return applied(base, overlay)
    except UnusableInput:
        return None


def _what(finding: Finding) -> tuple[str, str, str]:
    return finding.rule, finding.node, finding.message


def _together(finding: Finding, before: Sequence[Tree]) -> Finding:
    names = ", ".join(str(tree.file) for tree in before)
    return replace(finding, message=f"{finding.message} (together with {names})")


def applied(base: Tree, overlay: Tree) -> Tree:
    """The base with an overlay; both stay as they were. Raises UnusableInput where they do not fit."""
    fragments = [node for node in overlay.root if _is_fragment(node)]
    if not fragments:
        raise UnusableInput(
            f"{overlay.file} is no overlay: it has no fragment; write /plugin/; behind /dts-v1/; and compile "
            "it again, or check it without --overlay"
        )
    root, added = copy.deepcopy((base.root, overlay.root))
    joint = _Joint(Tree(base.file, root, base.from_source), Tree(overlay.file, added, overlay.from_source))
    joint.apply()
    return Tree(base.file, root, base.from_source)


def _is_fragment(node: Node) -> bool:
    return any(child.name == BODY for child in node) or not {"target", "target-path"}.isdisjoint(
        node.properties
    )


@dataclass
class _Joint:
    """A base and an overlay that becomes a part of it."""

    base: Tree
    overlay: Tree

    def apply(self) -> None:
        references = self._number_anew()
        self._resolve_labels()
        places = [
            (fragment, self._target(fragment)) for fragment in self.overlay.root if _is_fragment(fragment)
        ]
        kept: dict[int, int] = {}
        for fragment, target in places:
            kept |= _keep_handles(target, self._body(fragment))
        for found, place in references:
            found.set_cell(place, kept.get(found.cell(place), found.cell(place)))
        for fragment, target in places:
            _merge(target, self._body(fragment))
        self._add_labels({fragment.name: target.path for fragment, target in places})

    def _refuse(self, what: str, remedy: str) -> UnusableInput:
        return UnusableInput(f"{self.overlay.file}: {what}; {remedy}")

    def _compile_again(self, what: str) -> UnusableInput:
        return self._refuse(what, f"compile it again: dtc -@ -O dtb -o {self.overlay.file.stem}.dtbo")

    # ---- references ------------------------------------------------------------------------------------

    def _number_anew(self) -> list[tuple[Property, int]]:
        """Handles of the overlay's own nodes come after the base's. Gives the references to them."""
        offset = max(self.base.by_phandle, default=0)
        for node in self.overlay.root.walk():
            for name in PHANDLES:
                for value in node.cells(name)[:1]:
                    node.properties[name].set_cell(0, value + offset)
        notes = self.overlay.find("/__local_fixups__")
        return [
            (self._set(node, name, place, offset, add=True), place)
            for node, name, place in (_local_references(notes, self.overlay.root) if notes else ())
        ]

    def _resolve_labels(self) -> None:
        """Where the overlay refers to a label of the base, it gets the handle of that node."""
        fixups = self.overlay.find("/__fixups__")
        for label in fixups.properties if fixups else ():
            handle = self._handle(label)
            for reference in fixups.strings(label):
                path, _, rest = reference.partition(":")
                name, _, place = rest.partition(":")
                if not place.isdecimal():
                    raise self._compile_again(f"__fixups__ has {reference!r}, which is no place")
                self._set(self.overlay.find(path), name, int(place), handle)

    def _set(self, node: Node | None, name: str, place: int, value: int, *, add: bool = False) -> Property:
        found = node.properties.get(name) if node else None
        if found is None or place % CELL or place + CELL > len(found.raw):
            where = f"{node.path}: {name}" if node else name
            raise self._compile_again(
                f"a note of dtc tells of a reference that is not there ({where}, {place})"
            )
        found.set_cell(place, value + (found.cell(place) if add else 0))
        return found

    def _handle(self, label: str) -> int:
        symbols = self.base.find("/__symbols__")
        if symbols is None:
            raise self._refuse(
                f"it refers to {label}, but {self.base.file} has no labels (no __symbols__)",
                f"compile {self.base.file} again with dtc -@",
            )
        path = next(iter(symbols.strings(label)), "")
        node = self._node(path)
        if node is None:
            raise self._refuse(
                f"it refers to {label}, but {self.base.file} has no such label"
                f"{near(label, symbols.properties)}",
                "correct the label, or name the base that has it",
            )
        if not (handle := next(iter(node.cells("phandle")), 0)):
            raise self._refuse(
                f"it refers to {label}, which has no phandle in {self.base.file}",
                f"compile {self.base.file} again with dtc -@",
            )
        return handle

    # ---- fragments -------------------------------------------------------------------------------------

    def _target(self, fragment: Node) -> Node:
        self._body(fragment)
        for path in fragment.strings("target-path")[:1]:
            if node := self._node(path):
                return node
            raise self._refuse(
                f"the target-path of {fragment.name}, {path or 'empty'}, is not in {self.base.file}",
                "correct the path, or name the base that has it",
            )
        for handle in fragment.cells("target")[:1]:
            if node := self.base.by_phandle.get(handle):
                return node
            raise self._compile_again(
                f"the target of {fragment.name} is handle {handle:#x}, which nothing has"
            )
        raise self._refuse(f"{fragment.name} has no target", "give it target = <&LABEL> or target-path")

    def _node(self, path: str) -> Node | None:
        """Of a whole path, or one that begins with an alias, as libfdt finds it."""
        alias, slash, below = path.partition("/")
        aliases = self.base.find("/aliases") if alias else None
        whole = "".join((*aliases.strings(alias)[:1], slash, below)) if aliases else path
        return self.base.find(whole) if whole.startswith("/") else None

    def _body(self, fragment: Node) -> Node:
        for child in fragment:
            if child.name == BODY:
                return child
        raise self._refuse(f"{fragment.name} has no {BODY} node", f"write what it changes into {BODY} {{ }}")

    def _add_labels(self, targets: dict[str, str]) -> None:
        """The overlay's labels, for those that come after it."""
        own = self.overlay.find("/__symbols__")
        symbols = self.base.find("/__symbols__")
        if own is None or symbols is None:
            return
        for label in own.properties:
            for path in own.strings(label)[:1]:
                fragment, _, rest = path.removeprefix("/").partition(f"/{BODY}")
                if fragment in targets:
                    moved = (targets[fragment].rstrip("/") + rest) or "/"
                    symbols.properties[label] = Property(label, moved.encode() + b"\0")


def _local_references(notes: Node, node: Node) -> Iterator[tuple[Node | None, str, int]]:
    """Node, property and place of each reference of an overlay to a node of its own."""
    for name in notes.properties:
        for place in notes.cells(name):
            yield node, name, place
    below = {child.name: child for child in node}
    for note in notes:
        if note.name in below:
            yield from _local_references(note, below[note.name])


def _keep_handles(target: Node, change: Node) -> dict[int, int]:
    """
    Takes away the handles that the overlay has for nodes of the base: a label on __overlay__ makes one. Who
    refers to the node goes by the base's handle; old fdtoverlays overwrite it (dtc 1.7.2 no more).
    """
    kept = {}
    for name in PHANDLES:
        if name in target.properties and name in change.properties:
            kept |= zip(change.cells(name), target.cells(name), strict=False)
            del change.properties[name]
    below = {child.name: child for child in target}
    for child in change:
        if child.name in below:
            kept |= _keep_handles(below[child.name], child)
    return kept


def _merge(target: Node, change: Node) -> None:
    target.properties.update(change.properties)
    target.places += change.places
    below = {child.name: child for child in target}
    for child in change:
        if child.name in below:
            _merge(below[child.name], child)
        else:
            child.parent = target
            target.children.append(child)
