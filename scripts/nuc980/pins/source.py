# SPDX-License-Identifier: GPL-3.0-or-later
"""Device trees as written: values as cpp and dtc make them, and the line that each of them comes from."""

from __future__ import annotations

import functools
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from nuc980.errors import UnusableInput, printable
from nuc980.pins.dtb import MAGIC, parse_dtb, read_dtb
from nuc980.pins.tree import BODY, CELL, Node, Place, Tree

PATIENCE = 30  # seconds for each program: macros can expand for ever
MEMORY = 1 << 20  # KiB for each program: an #include of /dev/zero takes all there is
# A shell sets the bound: for a preexec_fn, Python would copy itself before it starts the program.
BOUND = ["/bin/sh", "-c", f'ulimit -v {MEMORY} && exec "$@"', "sh"]
SHOWN_ERRORS = 5  # lines of cpp's or dtc's
DTC = ["dtc", "-q", "-I", "dts"]
INSTALL = {"cpp": "install cpp", "dtc": "install device-tree-compiler"}
MISSING_PHANDLE = 0xFFFFFFFF  # what dtc -f writes for a reference to a label that does not exist
FORCED = "ERROR ("  # an error that dtc -f goes on after
MISSING_LABEL = "ERROR (phandle_references)"

STAND_IN = "nuc980-pins-stand-in-"  # the name of a node for a label that does not exist, and a number
NO_LABEL = re.compile(r'non-existent node or label "([\w]+)"')

# What dtc reads as one word: strings, comments; a line of cpp's that tells the place; what it ends at without
# a word, as if the file were over: a NUL, or a byte that is no ASCII.
WORDS = re.compile(
    rb'"(?:[^"\\]|\\.)*"|\x27(?:[^\x27\\\n]|\\.)*\x27|/\*.*?\*/|//[^\n]*'
    rb'|^\#(?:line)?[ \t]+(?P<line>\d+)[ \t]+"(?P<file>(?:[^"\\\n]|\\.)*)"[^\n]*\n'
    rb'|/include/\s*"(?P<included>[^"\n]+)"|(?P<odd>[\x00\x80-\xff]+)',
    re.DOTALL | re.MULTILINE,
)

# A property of dtc -T -T: "ranges;", "label: pins = <1 2>;"
PROPERTY = re.compile(r"(?:\w+: )*(?P<name>[^\s:;]+)(?: =|;)")
# A place of dtc -T -T: "board.dts:9:8-13:3", "board.dts:12:2-38"; of what dtc added "<no-file>:<no-line>"
PLACE = re.compile(r"(?P<file>.+):(?P<line>\d+):\d+-(?:\d+:)?\d+")


def read_tree(
    file: Path, include: Sequence[Path] = (), defines: Sequence[str] = (), *, symbols: bool = False
) -> Tree:
    """
    The tree of a DTB, or of a source, whichever the file's first bytes say; of a source with the labels that
    overlays refer to, if `symbols`. Raises UnusableInput for what is neither, and for an overlay.
    """
    tree = read_any(file, include, defines, symbols=symbols)
    if any(node.name == BODY for fragment in tree.root for node in fragment):
        raise UnusableInput(
            f"{file} is an overlay, which cannot be checked without its base; "
            f"name that first: nuc980-pins check --overlay BASE {file}"
        )
    return tree


def read_any(
    file: Path, include: Sequence[Path] = (), defines: Sequence[str] = (), *, symbols: bool = False
) -> Tree:
    """As read_tree, of an overlay as well."""
    # A pipe can be read once: what tells source from DTB would be missing in what is read then.
    refuse_pipe(file)
    try:
        with file.open("rb") as stream:
            compiled = stream.read(len(MAGIC)) == MAGIC
    except OSError as error:
        raise UnusableInput(f"{file}: {error.strerror}; name a device tree that can be read") from error
    return read_dtb(file) if compiled else read_source(file, include, defines, symbols=symbols)


def refuse_pipe(file: Path) -> None:
    """Raises UnusableInput for what may have no end, or nobody who writes."""
    if file.exists() and not (file.is_file() or file.is_dir()):
        raise UnusableInput(f"{file} is not a regular file; write its content into one, and name that")


def read_source(
    file: Path, include: Sequence[Path] = (), defines: Sequence[str] = (), *, symbols: bool = False
) -> Tree:
    """
    The tree of a source, with places and labels; `symbols` adds dtc's note of the labels. `include` are
    folders for #include and /include/, after the file's own; `defines` are macros, NAME or NAME=VALUE. A
    pinctrl-N that refers to a label that does not exist has MISSING_PHANDLE there. Raises UnusableInput with
    what cpp or dtc say.
    """
    source = _preprocessed(file, include, defines)
    if odd := _odd_byte(file, source, [file.parent, *include]):
        raise UnusableInput(
            f"{file}: {odd}, outside comments and strings: dtc stops reading there without a word; remove it"
        )
    folders = [f"-i{folder}" for folder in (file.parent, *include)]
    compiled = _run([*DTC, *folders, "-f", *["-@"] * symbols, "-O", "dtb", "-"], file, source)
    forced = [line for line in compiled.messages if FORCED in line]
    mistakes = UnusableInput(f"{file}: dtc says\n{compiled.errors}\ncorrect the first of these lines")
    if compiled.failed or any(MISSING_LABEL not in line for line in forced):
        raise mistakes
    tree = parse_dtb(compiled.output, file)
    # A group of pins that is missing is for the check to name, at its line; what else is missing is not.
    if _missing_groups(tree) < len(forced):
        raise mistakes
    if forced and all(map(NO_LABEL.search, forced)):
        tree = _with_stand_ins(
            file, source, folders, sorted(set(NO_LABEL.findall("\n".join(forced)))), symbols
        )
    annotated = _run([*DTC, *folders, "-f", "-T", "-T", "-O", "dts", "-"], file, source)
    _annotate(tree, annotated.output.decode(errors="replace"))
    return Tree(file, tree.root, from_source=True)


@dataclass(frozen=True)
class _Done:
    """What a program left behind."""

    failed: bool
    output: bytes
    messages: list[str]

    @property
    def errors(self) -> str:
        """The first lines that tell of errors, or the first of all."""
        telling = [line for line in self.messages if "error" in line.lower()] or self.messages
        shown = "\n".join(f"  {line}" for line in telling[:SHOWN_ERRORS]) or "  nothing, but it failed"
        # The lines quote the source, and go to a terminal.
        return printable(shown, "\n")


def _run(command: Sequence[str], file: Path, data: bytes = b"") -> _Done:
    if not shutil.which(command[0]):
        raise UnusableInput(f"{command[0]} is missing; {INSTALL[command[0]]}")
    try:
        # No pipe: who reads no further, as dtc after a mistake, would end us (SIGPIPE).
        with tempfile.TemporaryFile() as stdin:
            stdin.write(data)
            stdin.seek(0)
            done = subprocess.run(
                [*BOUND, *command],
                stdin=stdin,
                capture_output=True,
                timeout=PATIENCE,
                env={**os.environ, "LC_ALL": "C"},
            )
    except subprocess.TimeoutExpired as error:
        raise UnusableInput(
            f"{file}: {command[0]} did not end within {PATIENCE} s; check the #include lines of the file"
        ) from error
    return _Done(done.returncode != 0, done.stdout, done.stderr.decode(errors="replace").splitlines())


def _preprocessed(file: Path, include: Sequence[Path], defines: Sequence[str]) -> bytes:
    # As the kernel calls it (scripts/Makefile.lib, cmd_dtc): no system headers, no macros but ours.
    command = ["cpp", "-nostdinc", "-undef", "-D__DTS__", "-x", "assembler-with-cpp"]
    command += [f"-I{folder}" for folder in (file.parent, *include)]
    command += [f"-D{macro}" for macro in defines]
    name = f"./{file}" if str(file).startswith("-") else str(file)
    done = _run([*command, name], file)
    if done.failed:
        raise UnusableInput(
            f"{file}: cpp says\n{done.errors}\n"
            "correct the first of these lines; for a missing include, pass its folder with -I FOLDER"
        )
    return done.output


def _with_stand_ins(
    file: Path, source: bytes, folders: Sequence[str], labels: Sequence[str], symbols: bool
) -> Tree:
    """
    The tree of a source whose groups of these labels are missing. After a missing label, dtc -f resolves no
    path (serial0 = &uart0): so each gets a node, whose handle then becomes MISSING_PHANDLE.
    """
    nodes = " ".join(f"{label}: {STAND_IN}{number} {{ }};" for number, label in enumerate(labels))
    compiled = _run(
        [*DTC, *folders, *["-@"] * symbols, "-O", "dtb", "-"], file, source + f"\n/ {{ {nodes} }};\n".encode()
    )
    if compiled.failed:
        raise UnusableInput(f"{file}: dtc says\n{compiled.errors}\ncorrect the first of these lines")
    tree = parse_dtb(compiled.output, file)
    stand_ins = [node for node in tree.root if node.name.startswith(STAND_IN)]
    handles = {handle for node in stand_ins for handle in node.cells("phandle")}
    for node in tree.root.walk():
        for name in (name for name in node.properties if name.startswith("pinctrl-")):
            for place, handle in enumerate(node.cells(name)):
                if handle in handles:
                    node.properties[name].set_cell(place * CELL, MISSING_PHANDLE)
    tree.root.children = [node for node in tree.root if node not in stand_ins]
    if notes := tree.find("/__symbols__"):
        notes.properties = {name: its for name, its in notes.properties.items() if name not in labels}
    return tree


def _odd_byte(file: Path, source: bytes, folders: Sequence[Path], deepest: int = 8) -> str | None:
    """The place of the first byte that ends dtc's reading in silence, also in a file of /include/."""
    name, line, counted = str(file), 1, 0
    for found in WORDS.finditer(source):
        if found["file"]:
            name, line, counted = os.fsdecode(found["file"]), int(found["line"]), found.end()
        elif found["odd"]:
            here = line + source.count(b"\n", counted, found.start())
            return f"{name}:{here} has {_shown_bytes(found['odd'])}"
        elif found["included"] and deepest:
            wanted = os.fsdecode(found["included"])
            inner = next((one for folder in folders if (one := folder / wanted).is_file()), None)
            if inner and (odd := _odd_byte(inner, inner.read_bytes(), folders, deepest - 1)):
                return odd
    return None


def _shown_bytes(odd: bytes) -> str:
    try:
        return " ".join(f"U+{ord(letter):04X}" for letter in odd.decode()[:4])
    except UnicodeDecodeError:
        return " ".join(f"byte {byte:#04x}" for byte in odd[:4])


def _missing_groups(tree: Tree) -> int:
    return sum(
        node.cells(name).count(MISSING_PHANDLE)
        for node in tree.root.walk()
        for name in node.properties
        if name.startswith("pinctrl-")
    )


def _annotate(tree: Tree, annotated: str) -> None:
    """Gives the nodes and properties their places and labels from the output of dtc -T -T."""
    here = Path.cwd()
    open_nodes: list[Node | None] = []
    children: list[dict[str, Node]] = []  # of each, by name
    for text, places in _annotated_lines(annotated, here):
        if text.endswith("{"):
            *labels, name = text[:-1].split()
            node = children[-1].get(name) if open_nodes else tree.root
            open_nodes.append(node)
            children.append({child.name: child for child in node or ()})
            if node:
                node.places = places
                node.labels = tuple(label.rstrip(":") for label in labels)
        elif text == "};":
            open_nodes.pop()
            children.pop()
        elif places and open_nodes and open_nodes[-1]:
            _set_place(open_nodes[-1], text, places[-1])


def _set_place(node: Node, text: str, place: Place) -> None:
    found = PROPERTY.match(text)
    its = node.properties.get(found["name"]) if found else None
    if its:
        its.place = place


def _annotated_lines(annotated: str, here: Path) -> Iterator[tuple[str, tuple[Place, ...]]]:
    """Each line's text, and the places in the comment at its end."""
    for line in annotated.splitlines():
        text, comment, end = line.strip().rpartition(" /* ")
        if not comment:
            text, end = end, ""
        found = (PLACE.fullmatch(place) for place in end.removesuffix(" */").split(", "))
        yield text, tuple(Place(_shown(place["file"], here), int(place["line"])) for place in found if place)


@functools.cache
def _shown(name: str, here: Path) -> str:
    """A file as seen from the current folder, where that is above: what an editor can follow."""
    file = Path(name)
    return str(file.relative_to(here) if file.is_absolute() and file.is_relative_to(here) else file)
