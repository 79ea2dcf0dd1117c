# SPDX-License-Identifier: GPL-3.0-or-later
"""How the root file system of `make image-debian` is put together: users, libraries, what is missing."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from image.rootfs import (
    BOARD,
    PACKAGE,
    TABLE,
    USERS,
    UnusableInput,
    add_libraries,
    add_users,
    copy_tree,
    name_system,
    needs_openssl,
    read_table,
    users_of,
)

BASE = 61200  # rtud/main.c: the group of all modules; a module has its number above
GROUPS = "root:x:0:\ndialout:x:18:{members}\nnogroup:x:65534:\n"
FOLDER = "usr/lib/arm-linux-gnueabi"


@pytest.fixture
def etc(tmp_path: Path) -> Path:
    for name in ("passwd", "shadow"):
        (tmp_path / name).write_text("")
    (tmp_path / "group").write_text(GROUPS.format(members=""))
    return tmp_path


def compiled(file: Path, *options: str | Path) -> Path:
    """A library of this machine: what names what is the same in every ELF file."""
    file.parent.mkdir(parents=True, exist_ok=True)
    words = [
        "gcc",
        "-shared",
        "-nostdlib",
        "-o",
        file,
        "-x",
        "c",
        "/dev/null",
        "-x",
        "none",
        "-Wl,--no-as-needed",
    ]
    subprocess.run([*words, f"-Wl,-soname,{file.name}", *options], check=True)
    return file


@pytest.fixture
def packages(tmp_path: Path) -> Path:
    """One library that names another, and one that nobody names."""
    folder = tmp_path / "packages" / FOLDER
    inner = compiled(folder / "libinner.so.1")
    compiled(folder / "libouter.so.2", inner)
    compiled(folder / "libother.so.3")
    return tmp_path / "packages"


# ---- users


def numbers_of_kinds() -> dict[str, int]:
    """Of the modules whose user is fixed: what rtud gives their processes."""
    found = {}
    for file in (PACKAGE / "src/modules").glob("*/kind.c"):
        text = file.read_text()
        if number := re.search(r"#define (?:FIRST_)?USER\s+(\d+)", text):
            name = re.search(r'(?:\{|\t)"(rtu-\w+)", |\.name = "(rtu-\w+)"', text)
            assert name is not None, file
            found[name[1] or name[2]] = BASE + int(number[1])
    return found


def test_each_module_of_a_kind_with_a_number_has_a_name(etc: Path) -> None:
    users = users_of(PACKAGE / "openrtu.mk")
    beside = {"openrtu": BASE, "rtu-pull": BASE - 1}
    assert {user.name: user.uid for user in users} == numbers_of_kinds() | beside
    assert len(numbers_of_kinds()) == 9
    add_users(etc, users)
    rows = [line.split(":") for line in (etc / "passwd").read_text().splitlines()]
    assert {row[6] for row in rows} == {"/bin/false"}
    assert {row[0]: row[3] for row in rows if row[3] != str(BASE)} == {"rtu-pull": "61199"}
    groups = (etc / "group").read_text()
    assert groups == GROUPS.format(members="rtu-gps,rtu-modbus") + "openrtu:x:61200:\nrtu-pull:x:61199:\n"


def test_user_of_the_system_has_the_home_that_the_table_says(etc: Path) -> None:
    add_users(etc, users_of(USERS))
    assert (etc / "passwd").read_text() == "chrony:x:123:123:chrony:/run/chrony:/bin/false\n"


def test_board_is_called_as_in_the_image_of_buildroot(etc: Path) -> None:
    (etc / "hosts").write_text("127.0.0.1\tlocalhost\n")
    name_system(etc)
    assert [(etc / name).read_text() for name in ("hostname", "issue")] == ["openrtu\n", "OpenRTU\n"]
    assert (etc / "hosts").read_text() == "127.0.0.1\tlocalhost\n127.0.1.1\topenrtu\n"


def test_no_user_has_a_password(etc: Path) -> None:
    add_users(etc, users_of(PACKAGE / "openrtu.mk"))
    rows = [line.split(":") for line in (etc / "shadow").read_text().splitlines()]
    assert {row[1] for row in rows} == {"*"}


def test_skeleton_locks_root() -> None:
    lines = (BOARD / "skeleton/etc/shadow").read_text().splitlines()
    assert {line.split(":")[1] for line in lines if not line.startswith("#")} == {"*"}


def test_second_member_of_a_group_is_behind_the_first(etc: Path) -> None:
    users = users_of(PACKAGE / "openrtu.mk")
    add_users(etc, [*users, *[user for user in users if user.more_group]])
    assert "dialout:x:18:rtu-gps,rtu-modbus,rtu-gps,rtu-modbus\n" in (etc / "group").read_text()


def test_unknown_group_is_said(etc: Path) -> None:
    (etc / "group").write_text("root:x:0:\n")
    with pytest.raises(UnusableInput, match="no group dialout"):
        add_users(etc, users_of(PACKAGE / "openrtu.mk"))


def test_makefile_without_users_is_said(tmp_path: Path) -> None:
    (tmp_path / "openrtu.mk").write_text("OPENRTU_VERSION = 1\n")
    with pytest.raises(UnusableInput, match="no line of a user"):
        users_of(tmp_path / "openrtu.mk")


# ---- libraries


def test_libraries_are_those_that_are_named_and_what_they_name(tmp_path: Path, packages: Path) -> None:
    root = tmp_path / "root"
    compiled(root / "usr/bin/program", packages / FOLDER / "libouter.so.2")
    add_libraries(root, packages, [])
    assert {file.name for file in (root / FOLDER).iterdir()} == {"libouter.so.2", "libinner.so.1"}


def test_library_may_be_named_by_the_table(tmp_path: Path, packages: Path) -> None:
    root = tmp_path / "root"
    add_libraries(root, packages, ["libother.so.3"])
    assert (root / FOLDER / "libother.so.3").stat().st_mode & 0o777 == 0o755


@pytest.mark.slow
def test_library_that_no_package_has_is_said(tmp_path: Path, packages: Path) -> None:
    root = tmp_path / "root"
    compiled(root / "usr/bin/program", packages / FOLDER / "libouter.so.2")
    (packages / FOLDER / "libinner.so.1").unlink()
    with pytest.raises(UnusableInput, match=r"libouter\.so\.2 needs libinner\.so\.1, and no package has it"):
        add_libraries(root, packages, [])


# ---- files


def test_modes_are_not_those_of_the_checkout(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    for name, mode in (("program", 0o700), ("text", 0o600)):
        (source / name).write_text("x")
        (source / name).chmod(mode)
    copy_tree(source, tmp_path / "root")
    assert {file.name: file.stat().st_mode & 0o777 for file in (tmp_path / "root").iterdir()} == {
        "program": 0o755,
        "text": 0o644,
    }


def test_start_scripts_are_programs() -> None:
    scripts = [*BOARD.glob("skeleton/etc/init.d/*"), *BOARD.glob("rootfs-overlay/etc/init.d/*")]
    assert len(scripts) > 5
    assert [file for file in scripts if not file.stat().st_mode & 0o100] == []


def test_table_can_be_read() -> None:
    table = read_table(TABLE)
    least = set(table.packages(tls=False, update=False, pull=False))
    assert "libc6" in least
    assert set(table.packages(tls=True, update=False, pull=False)) - least == {"libatomic1", "libssl3"}
    assert set(table.packages(tls=False, update=True, pull=False)) - least == {
        "libatomic1",
        "libconfig9",
        "libssl3",
    }
    assert set(table.packages(tls=False, update=False, pull=True)) - least == {
        "jq",
        "libatomic1",
        "libjq1",
        "libonig5",
        "libssl3",
    }


@pytest.mark.parametrize("text", ["", "programs = ", "programs = {}\nlibraries = 3\n"])
def test_unusable_table_is_said(tmp_path: Path, text: str) -> None:
    (tmp_path / "system.toml").write_text(text)
    with pytest.raises(UnusableInput, match="it must be a table as"):
        read_table(tmp_path / "system.toml")


# ---- what a site asks for


@pytest.mark.parametrize(
    ("text", "asks"),
    [
        ('{"outstations_tls": {}}', True),
        ('{"port": [], "tls": {}}', True),
        ('{"snmp": {}}', True),
        ('{"web": {}}', True),
        ('{"iec61850": {"tls": {}}}', True),
        ('{"iec61850": {}}', False),
        ('{"port": []}', False),
        ('["tls"]', False),
    ],
)
def test_site_with_tls_gets_openssl(tmp_path: Path, text: str, asks: bool) -> None:
    (tmp_path / "config.json").write_text(text)
    assert needs_openssl(tmp_path) == asks


def test_site_without_a_configuration_asks_for_nothing(tmp_path: Path) -> None:
    assert not needs_openssl(tmp_path)


@pytest.mark.parametrize("content", [b'{"port": [', b"\xff\xfe"])
def test_site_whose_configuration_is_no_json_is_said(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "config.json").write_bytes(content)
    with pytest.raises(UnusableInput, match="is not JSON"):
        needs_openssl(tmp_path)
