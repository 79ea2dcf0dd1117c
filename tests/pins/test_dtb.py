# SPDX-License-Identifier: GPL-3.0-or-later
"""DTB files: what dtc makes is read exactly, whatever else there is gives UnusableInput."""

import random
import struct
import subprocess
from pathlib import Path

import pytest

from nuc980.errors import UnusableInput
from nuc980.pins.dtb import LARGEST, LONGEST_NAME, parse_dtb, read_dtb
from nuc980.pins.tree import Tree

FILE = Path("some.dtb")
SOURCE = """
/dts-v1/;
/memreserve/ 0x1000 0x2000;
/ {
    model = "small";
    zeta { reg = <1>; };
    alpha: alpha@10 { reg = <0x10>; status = "disabled"; inner: inner { empty; peer = <&alpha>; }; };
};
"""
BEGIN, END, PROP, NOP, FINISH = 1, 2, 3, 4, 9


def compiled(source: str, *options: str) -> bytes:
    done = subprocess.run(
        ["dtc", "-q", "-I", "dts", "-O", "dtb", *options, "-"],
        input=source.encode(),
        capture_output=True,
        check=True,
    )
    return done.stdout


@pytest.fixture(scope="module")
def small() -> bytes:
    return compiled(SOURCE)


def blob(structure: bytes, strings: bytes = b"", version: int = 17) -> bytes:
    """A DTB around a structure block, whatever is in there."""
    at_strings = 40 + 16 + len(structure)
    total = at_strings + len(strings)
    sizes = (version, 16, 0, len(strings), len(structure))
    header = struct.pack(">10I", 0xD00DFEED, total, 56, at_strings, 40, *sizes)
    return header + bytes(16) + structure + strings


def cells(*values: int) -> bytes:
    return struct.pack(f">{len(values)}I", *values)


def begin(name: bytes) -> bytes:
    return cells(BEGIN) + name + bytes(4 - len(name) % 4)


def prop(offset: int, value: bytes = b"") -> bytes:
    return cells(PROP, len(value), offset) + value + bytes(-len(value) % 4)


def nested(depth: int) -> bytes:
    return begin(b"") + begin(b"n") * (depth - 1) + cells(END) * depth + cells(FINISH)


def refusal(data: bytes) -> str:
    with pytest.raises(UnusableInput) as raised:
        parse_dtb(data, FILE)
    message = str(raised.value)
    assert message.startswith("some.dtb is not a usable device tree: ")
    assert message.endswith("; compile it again with dtc, or copy it again")
    return message


def tree_or_refusal(data: bytes) -> Tree | None:
    try:
        return parse_dtb(data, FILE)
    except UnusableInput:
        return None


def test_order_parents_and_places_of_what_dtc_made(small: bytes) -> None:
    tree = parse_dtb(small, FILE)
    assert [node.path for node in tree.root.walk()] == ["/", "/zeta", "/alpha@10", "/alpha@10/inner"]
    alpha = tree.find("/alpha@10")
    assert list(alpha.properties)[:2] == ["reg", "status"]
    assert alpha.place_of("reg") is None and not tree.from_source
    inner = tree.find("/alpha@10/inner")
    assert inner.properties["empty"].raw == b""
    assert tree.by_phandle[inner.cells("peer")[0]] is alpha
    assert not inner.enabled and tree.find("/zeta").enabled


def test_labels_of_a_tree_compiled_with_symbols() -> None:
    assert parse_dtb(compiled(SOURCE), FILE).find("/alpha@10").labels == ()
    tree = parse_dtb(compiled(SOURCE, "-@"), FILE)
    assert tree.find("/alpha@10").labels == ("alpha",)
    assert tree.find("/alpha@10/inner").labels == ("inner",)


@pytest.mark.parametrize(
    ("value", "raw"),
    [
        ("<0x61626300>", b"abc\0"),
        ("[61 00 00 62]", b"a\0\0b"),
        (r'"a\0\0b"', b"a\0\0b\0"),
        (r'"Stra\xc3\x9fe"', "Straße".encode() + b"\0"),
        (r'"a\nb"', b"a\nb\0"),
        (r'"a", <1>, [ff]', b"a\0\0\0\0\1\xff"),
        ("[80 ff 00]", b"\x80\xff\0"),
        (r'"", ""', b"\0\0"),
    ],
)
def test_bytes_of_a_property_are_exact(value: str, raw: bytes) -> None:
    tree = parse_dtb(compiled(f"/dts-v1/; / {{ value = {value}; }};"), FILE)
    assert tree.root.properties["value"].raw == raw


def test_round_trip_through_dtc_keeps_every_byte(small: bytes) -> None:
    again = subprocess.run(
        ["dtc", "-q", "-I", "dtb", "-O", "dts", "-"], input=small, capture_output=True, check=True
    ).stdout.decode()
    first, second = parse_dtb(small, FILE), parse_dtb(compiled(again), FILE)

    def content(tree: Tree) -> list[tuple[str, list[tuple[str, bytes]]]]:
        return [(n.path, [(p.name, p.raw) for p in n.properties.values()]) for n in tree.root.walk()]

    assert content(first) == content(second)


def test_every_truncation_is_refused(small: bytes) -> None:
    for length in range(len(small)):
        refusal(small[:length])


def test_padding_behind_the_tree_is_none_of_it(small: bytes) -> None:
    assert parse_dtb(small + bytes(100), FILE).root.strings("model") == ["small"]


def test_mutations_give_a_tree_or_a_refusal(small: bytes) -> None:
    dice = random.Random(980)
    read = 0
    for _ in range(4000):
        broken = bytearray(small)
        for _ in range(dice.randint(1, 4)):
            broken[dice.randrange(len(broken))] = dice.choice((0, 1, 3, 0x7F, 0xFF, dice.randrange(256)))
        tree = tree_or_refusal(bytes(broken))
        read += tree is not None
        for node in tree.root.walk() if tree else ():
            assert node.path.isprintable()
    assert 400 < read < 3600, "the mutations reach both ends"


def test_random_bytes_are_refused() -> None:
    dice = random.Random(980)
    for length in range(400):
        refusal(dice.randbytes(length))
        refusal(bytes.fromhex("d00dfeed") + dice.randbytes(length))


def test_sound_tree_of_this_test_is_read() -> None:
    structure = begin(b"") + prop(0, b"1") + begin(b"a") + cells(NOP, END, END, FINISH)
    tree = parse_dtb(blob(structure, b"name\0"), FILE)
    assert tree.root.properties["name"].raw == b"1" and tree.find("/a") is not None


@pytest.mark.parametrize(
    ("cause", "data"),
    [
        ("the file is empty", b""),
        ("does not begin with d00dfeed", b"/dts-v1/; / { };" + bytes(40)),
        ("cut off in the header", blob(b"")[:39]),
        ("format version 16", blob(begin(b"") + cells(END, FINISH), version=16)),
        ("larger than", blob(begin(b"") + cells(END, FINISH)) + bytes(LARGEST)),
        ("FDT_ERR_", blob(begin(b"") + cells(END))),
        ("FDT_ERR_", blob(begin(b"") + cells(FINISH))),
        ("exactly one root", blob(cells(FINISH))),
        ("exactly one root", blob(prop(0) + begin(b"") + cells(END, FINISH), b"p\0")),
        ("FDT_ERR_", blob(begin(b"") + cells(END) + begin(b"") + cells(END, FINISH))),
        ("nested deeper", blob(nested(65))),
        ("two children of / ", blob(begin(b"") + (begin(b"a") + cells(END)) * 2 + cells(END, FINISH))),
        ("two properties p ", blob(begin(b"") + prop(0) + prop(0) + cells(END, FINISH), b"p\0")),
        ("has a slash", blob(begin(b"") + begin(b"a/b") + cells(END, END, FINISH))),
        ("has a slash", blob(begin(b"") + begin(b"") + cells(END, END, FINISH))),
        ("cannot be printed", blob(begin(b"") + begin(b"\x1b[2J") + cells(END, END, FINISH))),
        ("cannot be printed", blob(begin(b"") + prop(0) + cells(END, FINISH), b"\x1b[2J\0")),
        ("ascii", blob(begin(b"") + begin(b"\xff") + cells(END, END, FINISH))),
        (
            "name is longer",
            blob(begin(b"") + prop(0) + cells(END, FINISH), b"p" * (LONGEST_NAME + 1)),
        ),
    ],
)
def test_hostile_trees(cause: str, data: bytes) -> None:
    assert cause in refusal(data)


def test_nesting_just_allowed() -> None:
    tree = parse_dtb(blob(nested(64)), FILE)
    assert sum(1 for _ in tree.root.walk()) == 64


@pytest.mark.slow
def test_many_children_are_read_in_linear_time() -> None:
    children = b"".join(begin(b"%06d" % i) + cells(END) for i in range(40_000))
    assert len(parse_dtb(blob(begin(b"") + children + cells(END, FINISH)), FILE).root.children) == 40_000


@pytest.mark.slow
def test_many_labels_are_read_in_linear_time() -> None:
    names = b"".join(b"%05d\0" % i for i in range(30_000))
    labels = b"".join(prop(6 * i, b"/a\0") for i in range(30_000)) + prop(0, b"/a\0" * 10_000)
    symbols = begin(b"__symbols__") + labels.replace(prop(0, b"/a\0"), b"", 1) + cells(END)
    tree = parse_dtb(blob(begin(b"") + begin(b"a") + cells(END) + symbols + cells(END, FINISH), names), FILE)
    assert len(tree.find("/a").labels) == 30_000


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    unreadable = tmp_path / "unreadable.dtb"
    unreadable.symlink_to(unreadable)  # root reads whatever has no read permission
    for file in (tmp_path, tmp_path / "missing.dtb", unreadable):
        with pytest.raises(UnusableInput, match=f"{file}: .*; name a device tree that can be read"):
            read_dtb(file)


def test_file_is_read(tmp_path: Path, small: bytes) -> None:
    file = tmp_path / "small.dtb"
    file.write_bytes(small)
    tree = read_dtb(file)
    assert tree.file == file and tree.root.strings("model") == ["small"]
