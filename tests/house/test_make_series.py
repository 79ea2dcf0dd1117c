# SPDX-License-Identifier: GPL-3.0-or-later
"""`make series` as far as it needs no source of others: each file in one patch, the messages, the mails."""

import re
import shutil
from pathlib import Path

import pytest

import series
from rig.git_am import changed_files, new_files
from series import PROJECTS, UnusableInput, series_of

ROOT = Path(__file__).resolve().parents[2]
AUTHOR = "The OpenRTU authors <openrtu@localhost>"


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the series are made from, to be changed."""
    folder = tmp_path_factory.mktemp("tree")
    for part in ("patches", "board/nuc980", "dts"):
        shutil.copytree(ROOT / part, folder / part, symlinks=True)
    return folder


@pytest.mark.parametrize("project", PROJECTS)
def test_each_patch_has_a_message_and_says_what_it_changes(project: str) -> None:
    made = series_of(project)
    assert len({patch.subject for patch in made.patches}) == len(made.patches)
    for patch in made.patches:
        assert patch.author == AUTHOR
        assert len(patch.subject) <= 75 and not patch.subject.endswith(".")
        assert patch.text.strip() and "SPDX" not in patch.text
        assert max(map(len, patch.text.splitlines())) <= 80
        assert not re.search(
            r"^(---|diff -|Index: |From )", patch.text, re.MULTILINE
        )  # git am would end there
        assert re.search(r"^--- ", patch.diff, re.MULTILINE)
    assert len(new_files(made)) == len(set(new_files(made)))


@pytest.mark.parametrize("project", PROJECTS)
def test_a_series_names_its_maintainers(project: str) -> None:
    assert "MAINTAINERS" in changed_files(series_of(project))


def test_the_kernels_bindings_come_first_and_alone() -> None:
    subjects = [patch.subject for patch in series_of("linux").patches]
    bindings = [subject for subject in subjects if subject.startswith("dt-bindings: ")]
    assert subjects[: len(bindings)] == bindings
    for patch in series_of("linux").patches:
        in_bindings = {
            "/bindings/" in name for name in re.findall(r"^\+\+\+ b/(.+)$", patch.diff, re.MULTILINE)
        }
        assert in_bindings == {patch.subject in bindings}


@pytest.mark.parametrize("project", PROJECTS)
def test_the_mails_are_numbered_and_signed(project: str) -> None:
    (_, cover), *mails = series_of(project).mails(1_000_000_000)
    total = len(mails)
    assert "\nDate: Sun, 09 Sep 2001 01:46:40 -0000\n" in cover
    assert "Signed-off-by" not in cover and "\ndiff --git " not in cover
    for number, (name, text) in enumerate(mails, 1):
        assert re.match(rf"{number:04}-[\w.-]+\.patch$", name)
        assert f"\nSubject: [PATCH {number:0{len(str(total))}}/{total}] " in text
        assert text.count("Signed-off-by: ") == 1
        assert f"\n\nSigned-off-by: {AUTHOR}\n---\n " in text


def test_the_statistics_are_of_all_files_from_any_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """git leaves out what is outside of the folder of a clone that it is called in."""
    monkeypatch.chdir(ROOT / "docs")
    (_, cover), *_ = series_of("uboot").mails(0)
    assert re.search(r"^ MAINTAINERS +\| +\d+ \+*$", cover, re.MULTILINE)


@pytest.mark.slow
def test_a_file_in_no_patch_is_told(tree: Path) -> None:
    new = tree / "board/nuc980/linux/drivers/spi/spi-nuc980.c"
    new.parent.mkdir()
    new.write_text("int spi;\n")
    with pytest.raises(UnusableInput, match=r"drivers/spi/spi-nuc980\.c is in 0 patches"):
        series_of("linux", tree)
    shutil.rmtree(new.parent)


@pytest.mark.parametrize("content", [b"", b"int spi;", b"int spi;\r\n", b"\xff\n"])
def test_a_file_that_a_mail_would_change_is_told(tree: Path, content: bytes) -> None:
    file = tree / "board/nuc980/u-boot/drivers/net/nuc980_emac.c"
    before = file.read_bytes()
    file.write_bytes(content)
    with pytest.raises(UnusableInput, match=r"nuc980_emac\.c: .* each with a newline"):
        series_of("uboot", tree)
    file.write_bytes(before)


def test_a_line_ends_at_its_newline_alone(tree: Path) -> None:
    """Not at a form feed, which the kernel has between parts of a file."""
    file = tree / "board/nuc980/u-boot/drivers/net/nuc980_emac.c"
    before = file.read_bytes()
    file.write_bytes(b"int one;\n\x0c\nint two;\n")
    diffs = "".join(patch.diff for patch in series_of("uboot", tree).patches)
    assert "+++ b/drivers/net/nuc980_emac.c\n@@ -0,0 +1,3 @@\n+int one;\n+\x0c\n+int two;\n" in diffs
    file.write_bytes(before)


def test_a_file_in_two_patches_is_told(tree: Path) -> None:
    table = tree / "patches/uboot/series.toml"
    text = table.read_text()
    table.write_text(text.replace('["drivers/net/*"]', '["drivers/net/*", "drivers/serial/*"]'))
    with pytest.raises(UnusableInput, match=r"serial_nuc980\.c is in 2 patches"):
        series_of("uboot", tree)
    table.write_text(text)


def test_a_pattern_without_a_file_is_told(tree: Path) -> None:
    table = tree / "patches/uboot/series.toml"
    text = table.read_text()
    table.write_text(text.replace('["drivers/net/*"]', '["drivers/net/*", "drivers/spi/*"]'))
    with pytest.raises(UnusableInput, match=r"there is no file drivers/spi/\*"):
        series_of("uboot", tree)
    table.write_text(text)


def test_a_patch_in_no_series_is_told(tree: Path) -> None:
    more = tree / "patches/qemu/0099-more.patch"
    more.write_text("From: A <a@b>\nSubject: [PATCH] more\n\ntext\n\n--- a/x\n+++ b/x\n")
    with pytest.raises(UnusableInput, match=r"0099-more\.patch"):
        series_of("qemu", tree)
    more.unlink()


@pytest.mark.slow
def test_the_signer_may_be_a_person(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert series.main([str(tmp_path), "--author", "Ada Byron <ada@example.org>"]) == 0
    assert capsys.readouterr().out.count("patches and the cover letter") == len(PROJECTS)
    for mail in tmp_path.rglob("*.patch"):
        assert "openrtu@localhost" not in mail.read_text()
    first = next((tmp_path / "qemu").glob("0001-*")).read_text()
    assert "\nFrom: Ada Byron <ada@example.org>\n" in first
    assert "\nSigned-off-by: Ada Byron <ada@example.org>\n" in first


@pytest.mark.parametrize("author", ["Ada", "Ada <>", "ada@example.org", "Ada <ada>"])
def test_a_signer_has_name_and_address(
    tmp_path: Path, author: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        series.main([str(tmp_path / "out"), "--author", author])
    assert left.value.code == 2
    assert "is not a name with an address" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
