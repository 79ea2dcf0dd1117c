# SPDX-License-Identifier: GPL-3.0-or-later
"""
make check-image finds what it is for. A stand-in for Buildroot, of which each part can be told to misbehave:
the real one is not there in `make test`.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from image import check
from image.checks import symbols_in

ROOT = Path(__file__).resolve().parents[2]
MAKEFILE = """\
export BR2_VERSION := {version}
%_defconfig:
	sed '{lose}' "$(BR2_EXTERNAL)/configs/$@" > "$(O)/.config"
defconfig:
	sed '{lose}' "$(BR2_DEFCONFIG)" > "$(O)/.config"
savedefconfig:
	sed '{save}' "$(O)/.config" > "$(BR2_DEFCONFIG)"
show-info:
	@echo '{info}'
"""
CHECK_HASH = """\
#!/bin/sh
echo "$2 against $3" >&2
exit {code}
"""
CHECK_PACKAGE = """\
import sys
print("{warning}")
print("{lines} lines processed", file=sys.stderr)
sys.exit({code})
"""
LINUX = '"linux": {"dl_dir": "linux", "downloads": [{"source": "linux.tar.gz"}], "hashes": ["h"]}'
INFO = f'{{{LINUX}, "openrtu": {{}}, "uboot": {{}}}}'


class StandIn:
    """A Buildroot that is all right, unless it is changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.make = {"version": "2026.02.3", "lose": "", "save": "", "info": INFO}
        self.hash = {"code": "0"}
        self.package = {"warning": "", "lines": "100", "code": "0"}
        listed = symbols_in(ROOT / "configs" / "buildroot-symbols.txt")
        folder.mkdir()
        (folder / "Config.in").write_text("".join(f"config {name}\n" for name in listed))

    def run(self) -> int:
        (self.folder / "utils").mkdir()
        (self.folder / "Makefile").write_text(MAKEFILE.format(**self.make))
        (self.folder / "utils" / "check-package").write_text(CHECK_PACKAGE.format(**self.package))
        check_hash = self.folder / "support" / "download" / "check-hash"
        check_hash.parent.mkdir(parents=True)
        check_hash.write_text(CHECK_HASH.format(**self.hash))
        check_hash.chmod(0o755)
        return check.main([str(self.folder)])


@pytest.fixture
def buildroot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StandIn:
    monkeypatch.setattr(check, "BUILD", tmp_path / "build")
    monkeypatch.setenv("BR2_DL_DIR", str(tmp_path / "dl"))
    source = tmp_path / "dl" / "linux" / "linux.tar.gz"
    source.parent.mkdir(parents=True)
    source.touch()
    return StandIn(tmp_path / "buildroot")


def test_good_configuration_passes(buildroot: StandIn, capsys: pytest.CaptureFixture[str]) -> None:
    assert buildroot.run() == 0
    output = capsys.readouterr().out
    assert "nothing found" in output
    assert "1 of 1 sources" in output
    assert output.count("SKIPPED, fragments of Linux") == output.count("SKIPPED, fragments of BusyBox") == 3


FAULTS = {
    "nothing read": ("package", {"lines": "0"}, "found nothing to check"),
    "bad style": ("package", {"warning": "openrtu.mk:3: bad", "code": "1"}, "openrtu.mk:3: bad"),
    "setting lost": ("make", {"lose": "/BR2_CCACHE/d"}, "BR2_CCACHE=y did not survive"),
    "setting changed": ("make", {"lose": "s/BR2_CCACHE=y/# BR2_CCACHE is not set/"}, "did not survive"),
    "setting that came on": ("make", {"lose": "s/^# \\(BR2_.*\\) is not set/\\1=y/"}, "did not survive"),
    "line too many": ("make", {"save": "/BR2_CCACHE/d"}, "savedefconfig drops BR2_CCACHE=y"),
    "line too few": ("make", {"save": "$$aBR2_NEW=y"}, "savedefconfig adds BR2_NEW=y"),
    "other order": ("make", {"save": "/BR2_CCACHE/{h;d};$$G"}, "in another order"),
    "no package of ours": ("make", {"info": '{"linux": {}}'}, "show-info knows no openrtu"),
    "programs beside U-Boot": (
        "make",
        {"info": INFO.replace('"uboot": {}', '"uboot": {}, "bash": {"type": "target"}')},
        "nuc980_uboot_defconfig: no system, and it builds bash",
    ),
    "unresolved": ("make", {"info": "make: *** stop"}, "show-info failed"),
    "wrong hash": ("hash", {"code": "2"}, "linux.tar.gz against h"),
    "no hash": ("make", {"info": INFO.replace('"h"', "")}, "linux.tar.gz"),
}


@pytest.mark.slow
@pytest.mark.sample(4)
@pytest.mark.parametrize("what", FAULTS)
def test_fault_is_found(buildroot: StandIn, what: str, capsys: pytest.CaptureFixture[str]) -> None:
    part, change, expected = FAULTS[what]
    getattr(buildroot, part).update(change)
    assert buildroot.run() == 1
    assert expected in capsys.readouterr().err


def test_old_list_of_symbols_is_found(buildroot: StandIn, capsys: pytest.CaptureFixture[str]) -> None:
    file = buildroot.folder / "Config.in"
    file.write_text(file.read_text().replace("config BR2_CCACHE\n", ""))
    assert buildroot.run() == 1
    assert "BR2_CCACHE is not in this Buildroot" in capsys.readouterr().err


def test_lost_kernel_setting_is_found(
    buildroot: StandIn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    built = tmp_path / "build" / "nuc980_gateway" / "build" / "linux-custom" / ".config"
    built.parent.mkdir(parents=True)
    fragment = ROOT / "board" / "nuc980" / "linux" / "rt.fragment"
    built.write_text(fragment.read_text().replace("CONFIG_PREEMPT_RT=y", "# CONFIG_PREEMPT_RT is not set"))
    assert buildroot.run() == 1
    assert "CONFIG_PREEMPT_RT=y did not survive" in capsys.readouterr().err


def test_crond_that_comes_back_is_found(
    buildroot: StandIn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each system turns it off, and a BusyBox that was built with it is found."""
    for system in ("gateway", "gateway_lts", "netboot"):
        built = tmp_path / "build" / f"nuc980_{system}" / "build" / "busybox-1.37.0" / ".config"
        built.parent.mkdir(parents=True)
        built.write_text("CONFIG_CROND=y\n# CONFIG_CRONTAB is not set\n")
    assert buildroot.run() == 1
    assert capsys.readouterr().err.count("# CONFIG_CROND is not set did not survive") == 3


def test_without_source_it_says_so(
    buildroot: StandIn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(tmp_path / "dl")
    assert buildroot.run() == 0
    assert "hashes: SKIPPED" in capsys.readouterr().out


def test_without_checkout_it_is_skipped_loudly(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check.main([str(tmp_path)]) == 2
    assert "SKIPPED, nothing was checked" in capsys.readouterr().err


def test_another_release_is_refused(buildroot: StandIn, capsys: pytest.CaptureFixture[str]) -> None:
    buildroot.make["version"] = "2025.02.9"
    assert buildroot.run() == 2
    assert "configs/kas.yml pins 2026.02.3" in capsys.readouterr().err
