# SPDX-License-Identifier: GPL-3.0-or-later
"""
What only a Buildroot checkout can say of the image's configuration (make check-image): is it in Buildroot's
style, do all settings survive into the .config, is it what savedefconfig would write, do packages resolve, do
the sources that are there match their hashes. Exit codes: 0 all well, 1 findings, 2 no usable checkout.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from image.checks import (
    Setting,
    buildroot_list,
    defconfigs,
    named_files,
    package_files,
    settings,
    symbols_in,
    value_of,
)
from image.symbols import names
from nuc980.errors import UnusableInput

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build"
DONE, FOUND, UNUSABLE = 0, 1, 2
# What is configured by fragments: its name, its package, where a defconfig names them.
FRAGMENTS = [
    ("Linux", "linux", "BR2_LINUX_KERNEL_CONFIG_FRAGMENT_FILES"),
    ("BusyBox", "busybox", "BR2_PACKAGE_BUSYBOX_CONFIG_FRAGMENT_FILES"),
]
NEEDED = {"linux": "BR2_LINUX_KERNEL", "openrtu": "BR2_PACKAGE_OPENRTU", "uboot": "BR2_TARGET_UBOOT"}


@dataclass(frozen=True)
class Buildroot:
    folder: Path

    def make(self, output: Path, *words: str) -> subprocess.CompletedProcess[str]:
        """Buildroot's make on an output folder, with none of the variables of a make that runs this."""
        environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
        external = f"BR2_EXTERNAL={ROOT / 'br2-external'}"
        command = ["make", "--no-print-directory", "-C", self.folder, f"O={output}", external, *words]
        return subprocess.run(command, env=environment, capture_output=True, text=True)

    @property
    def version(self) -> str:
        """As the Makefile says it; what git says of a checkout comes on top."""
        makefile = self.folder / "Makefile"
        found = re.search(r"^export BR2_VERSION := (\S+)$", read(makefile), re.MULTILINE)
        if found is None:
            raise UnusableInput(f"{self.folder} is not Buildroot: its Makefile exports no BR2_VERSION")
        return found[1]


def read(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise UnusableInput(
            f"SKIPPED, nothing was checked: {file}: {error.strerror}. `make checkout` brings Buildroot; "
            "with one that is already here: make check-image BUILDROOT_DIR=folder"
        ) from error


def say(line: str) -> None:
    print(f"check-image: {line}", flush=True)


# ---- each check gives its findings -----------------------------------------------------------------


def style(buildroot: Buildroot) -> Iterator[str]:
    """check-package on the real paths: through a link, or by its own search, it finds nothing to check."""
    passed_over = {"external.mk", "external.desc"}  # by check-package itself
    files = [file for file in package_files(ROOT) if file.name not in passed_over]
    files += [*defconfigs(ROOT), *sorted((ROOT / "patches").rglob("*.hash"))]
    files += [file for file in sorted((ROOT / "board").rglob("S[0-9][0-9]*")) if file.is_file()]
    program = buildroot.folder / "utils" / "check-package"
    ignored = ROOT / "board" / ".checkpackageignore"
    words = [sys.executable, program, "--br2-external", "-vvv", "--ignore-list", ignored, *files]
    done = subprocess.run(words, capture_output=True, text=True)
    processed = re.search(r"^(\d+) lines processed", done.stderr, re.MULTILINE)
    if processed is None:
        raise UnusableInput(f"{program} did not run: {done.stderr.strip().splitlines()[-1:]}")
    ignored = re.findall(r"^(.*): ignored$", done.stdout, re.MULTILINE)
    checked = len(files) - len(ignored)
    say(f"style: check-package read {checked} files, {processed[1]} lines")
    if checked == 0 or processed[1] == "0":
        yield "check-package found nothing to check"
    if done.returncode:
        yield from (line for line in done.stdout.splitlines() if ".py:" not in line)


def symbols(buildroot: Buildroot) -> Iterator[str]:
    """What `make test` takes for known is known to this Buildroot."""
    listed, known = symbols_in(buildroot_list(ROOT)), names(buildroot.folder, "Config.in", {})
    say(f"symbols: {len(listed & known)} of the {len(listed)} in the list are in Buildroot")
    for name in sorted(listed - known):
        yield f'{name} is not in this Buildroot: docs/image-buildroot.md, "Update Buildroot"'


def survival(buildroot: Buildroot, defconfig: Path, output: Path) -> Iterator[str]:
    """All settings of a defconfig are in the .config that Buildroot makes of it."""
    done = buildroot.make(output, defconfig.name)
    if done.returncode:
        yield f"{defconfig.name}: make {defconfig.name} failed: {done.stderr.strip()}"
        return
    given = settings(defconfig)
    lost = list(lost_settings(given, output / ".config"))
    say(f"{defconfig.name}: {len(given) - len(lost)} of {len(given)} settings are in .config")
    yield from lost


def lost_settings(given: Iterable[Setting], config: Path) -> Iterator[str]:
    """A symbol that is not set may be absent: what it depends on is off as well."""
    made = {each.symbol: each.value for each in settings(config)}
    for each in given:
        if made.get(each.symbol, "n") != each.value:
            yield f"{each.place}: {each.text} did not survive, it is {made.get(each.symbol, 'not there')}"


def form(buildroot: Buildroot, defconfig: Path, output: Path) -> Iterator[str]:
    """savedefconfig gives the file back, but for the comments."""
    saved = output / "saved"
    done = buildroot.make(output, "savedefconfig", f"BR2_DEFCONFIG={saved}")
    if done.returncode:
        yield f"{defconfig.name}: make savedefconfig failed: {done.stderr.strip()}"
        return
    ours = [each.text for each in settings(defconfig)]
    theirs = [each.text for each in settings(saved)]
    if ours == theirs:
        say(f"{defconfig.name}: savedefconfig gives its {len(ours)} lines back")
        return
    yield from (f"{defconfig.name}: savedefconfig drops {line}" for line in ours if line not in theirs)
    yield from (f"{defconfig.name}: savedefconfig adds {line}" for line in theirs if line not in ours)
    if sorted(ours) == sorted(theirs):
        yield f"{defconfig.name}: savedefconfig writes the lines in another order"


def packages(buildroot: Buildroot, defconfig: Path, output: Path) -> tuple[dict[str, Any], list[str]]:
    """What show-info knows of each package, and findings."""
    done = buildroot.make(output, "--silent", "show-info")
    try:
        known = json.loads(done.stdout)
    except json.JSONDecodeError:
        return {}, [f"{defconfig.name}: show-info failed: {done.stderr.strip() or done.stdout[:200]}"]
    missing = [
        name for name, symbol in NEEDED.items() if value_of(defconfig, symbol) == "y" and name not in known
    ]
    say(f"{defconfig.name}: show-info resolves {len(known)} packages")
    found = [f"{defconfig.name}: show-info knows no {name}" for name in missing]
    if value_of(defconfig, "BR2_INIT_NONE") == "y":
        found += [f"{defconfig.name}: no system, and it builds {name}" for name in sorted(userland(known))]
    return known, found


def userland(known: dict[str, Any]) -> Iterator[str]:
    """The packages for the target that are neither a boot loader nor what each configuration has."""
    for name, package in known.items():
        if package.get("type") == "target" and not name.startswith(("skeleton", "toolchain", "uboot")):
            yield name


def hashes(buildroot: Buildroot, known: dict[str, Any]) -> Iterator[str]:
    """Buildroot's check-hash on the sources that are downloaded; nothing is fetched or thrown away."""
    folder = Path(os.environ.get("BR2_DL_DIR") or buildroot.folder / "dl")
    sources = {
        folder / row["dl_dir"] / each["source"]: row["hashes"]
        for row in known.values()
        for each in row.get("downloads", [])
    }
    here = {file: files for file, files in sources.items() if file.is_file()}
    say(f"hashes: {len(here)} of {len(sources)} sources are in {folder}")
    if not here:
        say("hashes: SKIPPED, no source is downloaded yet (make image-buildroot brings them)")
    program = buildroot.folder / "support" / "download" / "check-hash"
    for file, files in sorted(here.items()):
        words = [program, file, file.name, *files]
        done = subprocess.run(words, cwd=buildroot.folder, capture_output=True, text=True)
        if done.returncode or not files:
            yield done.stderr.strip() or f"{file.name}: no file with hashes"


def survived(defconfig: Path, program: str, package: str, symbol: str) -> Iterator[str]:
    """All settings of the fragments that `symbol` names are in the .config that `package` was built with."""
    name = defconfig.name.removesuffix("_defconfig")
    built = (BUILD / name / "build").glob(f"{package}-*/.config")
    configs = [file for file in built if not file.parent.name.startswith("linux-headers")]
    if not configs:
        say(f"{defconfig.name}: SKIPPED, fragments of {program}: it is not built yet (make image-buildroot)")
    given = [each for file in named_files(ROOT, defconfig, symbol) for each in settings(file)]
    for config in configs:
        lost = list(lost_settings(given, config))
        say(f"{defconfig.name}: {len(given) - len(lost)} of {len(given)} settings are in {program}'s .config")
        yield from lost


def development(buildroot: Buildroot, output: Path) -> Iterator[str]:
    """What development adds survives too; as the Makefile adds it."""
    part = ROOT / "configs" / "parts" / "development.config"
    both = output / "defconfig"
    both.write_text((ROOT / "configs" / "nuc980_gateway_defconfig").read_text() + part.read_text())
    done = buildroot.make(output, f"BR2_DEFCONFIG={both}", "defconfig")
    if done.returncode:
        yield f"{part.name}: make defconfig failed: {done.stderr.strip()}"
        return
    lost = list(lost_settings(settings(part), output / ".config"))
    say(f"{part.name}: {len(settings(part)) - len(lost)} of {len(settings(part))} settings are in .config")
    yield from lost


def findings(buildroot: Buildroot) -> Iterator[str]:
    yield from style(buildroot)
    yield from symbols(buildroot)
    known: dict[str, Any] = {}
    for defconfig in defconfigs(ROOT):
        output = BUILD / "check" / defconfig.name  # not where the image is built: that may have changes
        output.mkdir(parents=True, exist_ok=True)
        yield from survival(buildroot, defconfig, output)
        if (output / ".config").is_file():
            yield from form(buildroot, defconfig, output)
            resolved, unresolved = packages(buildroot, defconfig, output)
            known |= resolved
            yield from unresolved
            if value_of(defconfig, NEEDED["linux"]) == "y":
                for program, package, symbol in FRAGMENTS:
                    yield from survived(defconfig, program, package, symbol)
    output = BUILD / "check" / "development"
    output.mkdir(parents=True, exist_ok=True)
    yield from development(buildroot, output)
    yield from hashes(buildroot, known)


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="check-image", description="Check the image's configuration with Buildroot."
    )
    parser.add_argument("buildroot", type=Path, help="a Buildroot checkout")
    buildroot = Buildroot(parser.parse_args(words).buildroot.resolve())
    try:
        pinned = re.search(r"^\s*tag: *[\"']?([\w.-]+)", read(ROOT / "configs" / "kas.yml"), re.MULTILINE)
        if pinned and buildroot.version != pinned[1]:
            raise UnusableInput(
                f"{buildroot.folder} is Buildroot {buildroot.version}, and configs/kas.yml pins {pinned[1]}"
            )
        found = list(findings(buildroot))
    except UnusableInput as error:
        print(f"check-image: {error}", file=sys.stderr)
        return UNUSABLE
    for line in found:
        print(f"check-image: {line}", file=sys.stderr)
    say(f"{len(found)} findings" if found else "nothing found")
    return FOUND if found else DONE


if __name__ == "__main__":
    sys.exit(main())
