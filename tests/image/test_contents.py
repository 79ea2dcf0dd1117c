# SPDX-License-Identifier: GPL-3.0-or-later
"""What two images hold is compared, and the table of their differences is true."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from image.contents import (
    BOTH,
    BUILDROOT,
    DEBIAN,
    ROOT,
    TABLE,
    Facts,
    UnusableInput,
    facts_of,
    findings,
    main,
    read_list,
    read_table,
)
from image.cpio import Entry, archive
from image.rootfs import PACKAGE, USERS, users_of

WHERE = (DEBIAN, BUILDROOT, BOTH)
PASSWD = "root:x:0:0:root:/root:/bin/sh\nchrony:x:123:123::/run/chrony:/bin/false\n"
ACCOUNTS = (
    Entry.file("etc/passwd", PASSWD),
    Entry.file("etc/group", "# groups\nroot:x:0:\nchrony:x:123:\ndialout:x:18:rtu-modbus,rtu-gps\n"),
    Entry.file("etc/shadow", "root:$6$a$b:::::::\nchrony:*:::::::\n", 0o600),
)
FILES = (
    Entry.folder("etc"),
    Entry.folder("tmp", 0o1777),
    Entry.file("etc/fstab", "tmpfs /tmp tmpfs size=8m 0 0\n"),
    Entry.link("etc/mtab", "../proc/self/mounts"),
)


def packed(folder: Path, *entries: Entry) -> Path:
    file = folder / "initramfs.cpio"
    file.write_bytes(archive(entries))
    return file


@pytest.fixture
def facts(tmp_path: Path) -> Facts:
    return facts_of(packed(tmp_path, *FILES, *ACCOUNTS))


def table(folder: Path, *rows: str) -> Path:
    file = folder / "differences.toml"
    file.write_text("".join(f"[[difference]]\n{row}\n" for row in rows) or "difference = []\n")
    return file


def row(facts: str, where: str) -> str:
    return f'facts = ["{facts}"]\nin = "{where}"\nwhy = "because"\n'


# ---- reading


def test_users_are_told_by_what_they_may(facts: Facts) -> None:
    assert facts["user root"] == "0, group root, home /root, shell /bin/sh, with a password"
    assert facts["user chrony"] == "123, group chrony, home /run/chrony, shell /bin/false, locked"
    assert facts["group dialout"] == "18, rtu-gps, rtu-modbus"


def test_user_without_a_password_is_open(tmp_path: Path) -> None:
    shadow = Entry.file("etc/shadow", "root::::::::\n")
    assert facts_of(packed(tmp_path, *ACCOUNTS[:2], shadow))["user root"].endswith(", open")


def test_paths_have_owner_mode_and_content(facts: Facts) -> None:
    assert facts["mode tmp"] == "1777 0:0"
    assert facts["mode etc/shadow"] == "600 0:0"
    assert facts["link etc/mtab"] == "/proc/self/mounts"
    assert len(facts["file etc/fstab"]) == 64


def test_folder_says_the_same_as_its_archive(tmp_path: Path, facts: Facts) -> None:
    root = tmp_path / "root"
    for entry in (*FILES, *ACCOUNTS):
        path = root / entry.path
        if entry in FILES[:2]:
            path.mkdir(parents=True)
        elif entry == FILES[3]:
            path.symlink_to(entry.content.decode())
            continue
        else:
            path.write_bytes(entry.content)
        path.chmod(entry.mode & 0o7777)
    owner = f"{root.stat().st_uid}:{root.stat().st_gid}"
    assert facts_of(root) == {
        fact: value.replace("0:0", owner) if fact.startswith("mode ") else value
        for fact, value in facts.items()
    }


def test_list_can_be_read_again(tmp_path: Path, facts: Facts, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", str(tmp_path / "initramfs.cpio")]) == 0
    (tmp_path / "contents.json").write_text(capsys.readouterr().out)
    assert read_list(tmp_path / "contents.json") == facts


@pytest.mark.parametrize(
    "content", [b"", b"070701", b"no archive at all, but long enough to have a header" * 3]
)
def test_what_is_no_archive_is_said(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "initramfs.cpio").write_bytes(content)
    with pytest.raises(UnusableInput, match="no entry of a cpio archive"):
        facts_of(tmp_path / "initramfs.cpio")


# ---- comparing


def compared(tmp_path: Path, debian: Facts, buildroot: Facts, *rows: str) -> list[str]:
    return list(findings(debian, buildroot, read_table(table(tmp_path, *rows))))


def test_equal_images_have_no_finding(tmp_path: Path, facts: Facts) -> None:
    assert compared(tmp_path, facts, facts) == []


def test_each_difference_is_found(tmp_path: Path, facts: Facts) -> None:
    other = {key: value for key, value in facts.items() if key not in ("file etc/fstab", "mode etc/fstab")}
    other |= {"user chrony": "100", "mode tmp": "755 0:0", "file etc/issue": "1", "mode etc/issue": "644 0:0"}
    assert compared(tmp_path, facts, other) == [
        "file etc/fstab: only debian has it: " + facts["file etc/fstab"],
        "file etc/issue: only buildroot has it: 1",
        "mode tmp: debian has 1777 0:0, buildroot has 755 0:0",
        f"user chrony: debian has {facts['user chrony']}, buildroot has 100",
    ]


def test_row_excuses_only_what_it_names(tmp_path: Path, facts: Facts) -> None:
    other = facts | {"file etc/issue": "1", "mode etc/fstab": "666 0:0"}
    rows = row("file etc/iss*", "buildroot"), row("file etc/fstab", "both")
    assert compared(tmp_path, facts, other, *rows) == [
        "mode etc/fstab: debian has 644 0:0, buildroot has 666 0:0",
        'the row "file etc/fstab", in both, speaks of no difference',
    ]
    assert len(compared(tmp_path, other, facts, *rows)) == 4


def test_row_of_files_does_not_excuse_a_setuid_program(tmp_path: Path, facts: Facts) -> None:
    other = facts_of(packed(tmp_path, *FILES, *ACCOUNTS, Entry.file("bin/su", "\x7fELF", 0o4755)))
    found = compared(tmp_path, facts, other, row("file bin/*", "buildroot"))
    assert found[0].startswith("setuid bin/su: only buildroot has it")


def test_command_compares(tmp_path: Path, facts: Facts, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "contents.json").write_text(json.dumps(facts | {"link etc/x": "y"}))
    words = ["compare", str(tmp_path / "initramfs.cpio"), str(tmp_path / "contents.json"), "--table"]
    assert main([*words, str(table(tmp_path))]) == 1
    assert capsys.readouterr().out == "link etc/x: only buildroot has it: y\n"
    assert main([*words, str(table(tmp_path, row("link etc/x", "buildroot")))]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    "text", ["", "difference = 3\n", '[[difference]]\nfacts = ["x"]\nin = "here"\nwhy = "y"\n']
)
def test_unusable_table_is_said(tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "differences.toml").write_text(text)
    lists = [str(packed(tmp_path, *FILES))] * 2
    assert main(["compare", *lists, "--table", str(tmp_path / "differences.toml")]) == 2
    assert "differences.toml" in capsys.readouterr().err


def test_list_that_is_none_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "contents.json").write_text("[]")
    assert main(["compare", str(tmp_path / "contents.json"), str(tmp_path / "gone")]) == 2
    assert capsys.readouterr().err == f"contents: {tmp_path}/contents.json is no list of contents\n"


def test_table_of_the_tree_can_be_read() -> None:
    assert read_table(TABLE)


def test_no_row_excuses_a_file_that_both_take_of_the_tree() -> None:
    """What is mounted, who starts when, who may log in: both have the overlay's."""
    overlay = ROOT / "board/nuc980/rootfs-overlay"
    files = [str(file.relative_to(overlay)) for file in overlay.rglob("*") if not file.is_dir()]
    assert {"etc/fstab", "etc/init.d/S85sshd", "etc/ssh/sshd_config"} <= set(files)
    files += ["etc/init.d/S80rtud"]
    facts = [f"{kind} {file}" for file in files for kind in ("file", "mode")]
    differ = [
        fact for fact in facts for row in read_table(TABLE) for where in WHERE if row.covers(fact, where)
    ]
    assert differ == []


def test_no_row_excuses_a_user_of_the_gateway() -> None:
    names = [user.name for file in (USERS, PACKAGE / "openrtu.mk") for user in users_of(file)]
    assert len(names) > 5
    facts = [f"{kind} {name}" for name in names for kind in ("user", "group")]
    assert [
        fact for fact in facts for row in read_table(TABLE) for where in WHERE if row.covers(fact, where)
    ] == []
