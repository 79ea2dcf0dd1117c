# SPDX-License-Identifier: GPL-3.0-or-later
"""Update files, without a board: what is in them, what OpenSSL says to their signature, what is refused."""

import hashlib
import json
import re
import subprocess
from pathlib import Path

import pytest

from image.update import MOST, Signer, data_format, main, update_file
from nuc980.errors import UnusableInput
from nuc980.netboot.limits import ROOT_VOLUME
from nuc980.netboot.slots.layout import PLACES

ROOT = Path(__file__).resolve().parents[2]
KERNEL, TREE = b"kernel" * 1000, b"tree" * 100


def make_signer(folder: Path, purpose: str = "codeSigning", algorithm: str = "rsa:3072") -> Signer:
    signer = Signer(folder / "key.pem", folder / "certificate.pem")
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", algorithm, "-nodes", "-days", "1", "-subj", "/CN=test",
         "-addext", f"extendedKeyUsage={purpose}", "-keyout", signer.key, "-out", signer.certificate],
        check=True, capture_output=True,
    )  # fmt: skip
    return signer


@pytest.fixture(scope="module")
def signer(tmp_path_factory: pytest.TempPathFactory) -> Signer:
    return make_signer(tmp_path_factory.mktemp("signer"))


@pytest.fixture
def content(tmp_path: Path, signer: Signer) -> Path:
    """An update, unpacked."""
    file = update_file(KERNEL, TREE, "1.2.3", "station-7", signer)
    folder = tmp_path / "content"
    folder.mkdir()
    subprocess.run(["cpio", "--extract", "--quiet"], cwd=folder, input=file, check=True)
    return folder


@pytest.mark.slow
def test_same_input_same_bytes(signer: Signer) -> None:
    one, other = (update_file(KERNEL, TREE, "1.2.3", "station-7", signer) for _ in range(2))
    assert one == other


@pytest.mark.slow
def test_description_comes_first_and_is_signed(content: Path, signer: Signer) -> None:
    done = subprocess.run(
        ["openssl", "cms", "-verify", "-binary", "-inform", "DER", "-in", "sw-description.sig",
         "-content", "sw-description", "-CAfile", signer.certificate, "-purpose", "any"],
        cwd=content, capture_output=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == (content / "sw-description").read_bytes()


def test_description_has_each_hash_for_each_slot(content: Path) -> None:
    described = (content / "sw-description").read_text()
    for name in ("kernel", "tree", "check"):
        assert described.count(f'sha256 = "{hashlib.sha256((content / name).read_bytes()).hexdigest()}"') == 2
    assert 'version = "1.2.3";' in described
    assert 'hardware-compatibility: [ "station-7" ];' in described


def test_root_in_ubi_is_written_before_kernel_and_tree(signer: Signer) -> None:
    """Into the volume of the slot, which SWUpdate makes; the script gets its size and hash, too."""
    root = b"root" * 1000
    file = update_file(KERNEL, TREE, "1.2.3", "station-7", signer, root=root)
    described = file[: file.index(b"sw-description.sig")].decode(errors="replace")
    for slot in PLACES:
        begin = described.index(f"{slot}: {{ partitions:")
        words = described[begin : described.find("};\n", begin)]
        assert f'name = "root_{slot}"; device = "rootfs"; size = {ROOT_VOLUME};' in words
        assert re.findall(r'type = "(?:ubivol|flash)"; (\w+ = "[^"]+")', words) == [
            f'volume = "root_{slot}"',
            f'mtdname = "kernel-{slot}"',
            f'mtdname = "tree-{slot}"',
        ]
        assert f' {len(root)} {hashlib.sha256(root).hexdigest()} {ROOT_VOLUME}"' in words


def test_more_than_a_board_has_memory_for(signer: Signer) -> None:
    """What `rtu-update` gives to a file holds the largest."""
    script = (ROOT / "board/nuc980/rootfs-overlay/usr/sbin/rtu-update").read_text()
    room = re.search(r'^WORK_SIZE="(\d+)m"$', script, re.MULTILINE)
    assert room is not None
    assert int(room[1]) << 20 > MOST
    with pytest.raises(UnusableInput, match="memory takes"):
        update_file(KERNEL, TREE, "1.2.3", "station-7", signer, root=bytes(MOST))


def test_tree_is_wrapped_for_u_boot(content: Path) -> None:
    shown = subprocess.run(["mkimage", "-l", content / "tree"], capture_output=True, text=True, check=True)
    assert "Flat Device Tree" in shown.stdout
    assert (content / "tree").read_bytes()[64:] == TREE


@pytest.mark.parametrize("version", ["", "1.2.3-rc1", "1.2-rc.1", "v1", "1.2.3.4.5", '1"; x = "'])
def test_version_that_boards_cannot_compare(version: str, signer: Signer) -> None:
    with pytest.raises(UnusableInput, match="no version"):
        update_file(KERNEL, TREE, version, "station-7", signer)


def test_name_that_would_end_the_description(signer: Signer) -> None:
    with pytest.raises(UnusableInput, match="no name of a site"):
        update_file(KERNEL, TREE, "1.2.3", 'x" ]; y: [ "', signer)


def test_kernel_without_room(signer: Signer) -> None:
    with pytest.raises(UnusableInput, match="a slot takes"):
        update_file(bytes(PLACES["a"].kernel.room + 1), TREE, "1.2.3", "station-7", signer)


@pytest.mark.slow
def test_certificate_for_something_else(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match="not for signing code"):
        update_file(KERNEL, TREE, "1.2.3", "station-7", make_signer(tmp_path, "serverAuth"))


@pytest.mark.slow
def test_key_of_another_certificate(tmp_path: Path, signer: Signer) -> None:
    other = make_signer(tmp_path)
    with pytest.raises(UnusableInput, match="openssl cannot use"):
        update_file(KERNEL, TREE, "1.2.3", "station-7", Signer(other.key, signer.certificate))


def test_command(tmp_path: Path, signer: Signer, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "uImage").write_bytes(KERNEL)
    write_manifest(tmp_path, "1.2.3.7", {"uImage": KERNEL, **dict.fromkeys(TREES, TREE)})
    words = [
        str(tmp_path), "--key", str(signer.key), "--certificate", str(signer.certificate),
        "--site", "station-7", "--out", str(tmp_path / "update.swu"),
    ]  # fmt: skip
    assert main(words) == 2
    assert capsys.readouterr().err == f"update: {tmp_path}/nuc980-gateway.dtb: No such file or directory\n"
    assert not (tmp_path / "update.swu").exists()
    for board in ("nuc980-gateway", "nuc980-numaker"):
        (tmp_path / f"{board}.dtb").write_bytes(TREE)
        assert main([*words, "--board", board]) == 0
        described = (tmp_path / "update.swu").read_bytes()
        assert f"    {board} = {{\n".encode() in described
        assert b'version = "1.2.3.7";' in described
        assert "version 1.2.3.7" in capsys.readouterr().out


TREES = ("nuc980-gateway.dtb", "nuc980-numaker.dtb")


def write_manifest(folder: Path, version: str | None, files: dict[str, bytes]) -> None:
    rows = [{"name": name, "sha256": hashlib.sha256(data).hexdigest()} for name, data in files.items()]
    (folder / "manifest.json").write_text(json.dumps({"version": version, "files": rows}))


@pytest.mark.parametrize(
    ("version", "files", "why"),
    [
        ("1.2.3", {"uImage": KERNEL, TREES[0]: TREE}, "without a number"),
        (None, {"uImage": KERNEL, TREES[0]: TREE}, "without a number"),
        ("1.2.3.7", {"uImage": KERNEL[1:], TREES[0]: TREE}, "uImage is not what"),
        ("1.2.3.7", {"uImage": KERNEL, TREES[0]: b"another"}, "nuc980-gateway.dtb is not what"),
        ("1.2.3.7", {"uImage": KERNEL}, "nuc980-gateway.dtb is not what"),
    ],
)
def test_update_claims_no_version_that_its_image_has_not(
    tmp_path: Path,
    signer: Signer,
    capsys: pytest.CaptureFixture[str],
    version: str | None,
    files: dict[str, bytes],
    why: str,
) -> None:
    (tmp_path / "uImage").write_bytes(KERNEL)
    (tmp_path / TREES[0]).write_bytes(TREE)
    write_manifest(tmp_path, version, files)
    words = ["--key", str(signer.key), "--certificate", str(signer.certificate), "--site", "station-7"]
    assert main([str(tmp_path), *words, "--out", str(tmp_path / "update.swu")]) == 2
    assert why in capsys.readouterr().err
    assert not (tmp_path / "update.swu").exists()
    with pytest.raises(SystemExit):
        main([str(tmp_path), *words, "--out", str(tmp_path / "update.swu"), "--version", "9.9.9"])


def test_folder_without_a_manifest(
    tmp_path: Path, signer: Signer, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--key", str(signer.key), "--certificate", str(signer.certificate), "--site", "station-7"]
    for text in (None, "{", "{}", "[]"):
        if text is not None:
            (tmp_path / "manifest.json").write_text(text)
        assert main([str(tmp_path), *words, "--out", str(tmp_path / "update.swu")]) == 2
        assert "manifest" in capsys.readouterr().err


def test_data_format_is_that_of_the_journal() -> None:
    """The digit in the journal's first octets, `ORJ1`: who raises it has to say so in data-format."""
    source = (ROOT / "package/openrtu/src/journal/record.c").read_text()
    digit = re.search(r"magic\[4\] = \{'O', 'R', 'J', '(\d)'\}", source)
    assert digit is not None
    assert data_format("writes") == int(digit[1]) <= data_format("reads")


def test_data_format_comes_to_the_board_as_the_scripts_last_argument(signer: Signer) -> None:
    described = update_file(KERNEL, TREE, "1.2.3", "station-7", signer, writes=7).decode(errors="replace")
    assert len(re.findall(r'data = "[ab] \d+ [0-9a-f]{64} \d+ [0-9a-f]{64} 7"', described)) == 2
