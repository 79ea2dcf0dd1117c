# SPDX-License-Identifier: GPL-3.0-or-later
"""
What can be known of the image's configuration without Buildroot. Each check takes the tree's root and gives
its findings, `file:line: what is wrong`; none found is an empty list.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

COMMIT = re.compile(r"[0-9a-f]{40}")
URL = re.compile(r"(?:https?|git|ssh)://[^\s\"')]+")
EXTERNAL = "$(BR2_EXTERNAL_OPENRTU_PATH)"
FRAGMENT = re.compile(r"board/\S+\.fragment\b")

# ---- settings: lines of a defconfig or of a kernel fragment ----------------------------------------

VALUE = r"(?:[ymn]|-?\d+|0x[0-9a-fA-F]+|\"(?:[^\"\\]|\\.)*\")"
SET = re.compile(rf"(?P<symbol>(?:BR2|CONFIG)_\w+)=(?P<value>{VALUE})")
NOT_SET = re.compile(r"# (?P<symbol>(?:BR2|CONFIG)_\w+) is not set")
DEAD = re.compile(r"#+\s*\+?(?:BR2|CONFIG)_\w+\s*(?:=|is not set)")


@dataclass(frozen=True)
class Setting:
    file: Path
    line: int
    text: str
    symbol: str
    value: str

    @property
    def place(self) -> str:
        return f"{self.file.name}:{self.line}"


def settings(file: Path) -> list[Setting]:
    """The lines that set something; what is malformed is not among them."""
    return [line for line in _lines(file) if isinstance(line, Setting)]


def _lines(file: Path) -> Iterator[Setting | str]:
    """A setting, or a finding."""
    for number, text in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        if found := SET.fullmatch(text) or NOT_SET.fullmatch(text):
            yield Setting(file, number, text, found["symbol"], found.groupdict().get("value", "n"))
        elif DEAD.match(text):
            yield f"{file.name}:{number}: commented out, or not written as Kconfig writes it: {text}"
        elif text.strip() and not text.startswith("#"):
            yield f"{file.name}:{number}: malformed: {text}"


def defconfigs(root: Path) -> list[Path]:
    return sorted((root / "configs").glob("*_defconfig"))


def fragments(root: Path) -> list[Path]:
    return sorted((root / "board").glob("*/linux/*.fragment"))


def value_of(file: Path, symbol: str) -> str:
    """Unquoted; empty when it is not set."""
    return next((each.value.strip('"') for each in settings(file) if each.symbol == symbol), "")


def named_files(root: Path, file: Path, symbol: str) -> list[Path]:
    """The files of this tree that a symbol's value names."""
    external = str(root / "br2-external")
    return [Path(word.replace(EXTERNAL, external)) for word in value_of(file, symbol).split()]


def fragments_of(root: Path, file: Path) -> list[Path]:
    return named_files(root, file, "BR2_LINUX_KERNEL_CONFIG_FRAGMENT_FILES")


def check_form(root: Path) -> list[str]:
    """No line that Kconfig would pass over in silence, such as `+CONFIG_…`."""
    files = [*defconfigs(root), *parts(root), *fragments(root)]
    return [line for file in files for line in _lines(file) if isinstance(line, str)]


def check_once(root: Path) -> list[str]:
    """No symbol twice: in a defconfig, or in the fragments that make one kernel."""
    found = []
    for file in defconfigs(root):
        present = [fragment for fragment in fragments_of(root, file) if fragment.is_file()]
        for group in ([file], present):
            found += _twice([each for one in group for each in settings(one)])
    return list(dict.fromkeys(found))


def _twice(group: Sequence[Setting]) -> list[str]:
    first: dict[str, Setting] = {}
    found = []
    for each in group:
        if (before := first.setdefault(each.symbol, each)) is not each:
            found.append(f"{each.place}: {each.text}, and {before.place} already has {before.text}")
    return found


def check_known(root: Path) -> list[str]:
    """Every symbol was seen in what is pinned, or is our own packages'; what nobody sets is in no list."""
    found = []
    for file, used in (
        (buildroot_list(root), buildroot_settings(root)),
        (linux_list(root), linux_settings(root)),
    ):
        known = symbols_in(file)
        found += [
            f"{each.place}: {each.symbol} is not in {file.name}; write it anew, if the release has it"
            for each in used
            if name_of(each) not in known
        ]
        idle = known - {name_of(each) for each in used}
        found += [f"configs/{file.name}:1: nothing sets {name}" for name in sorted(idle)]
    return found


def buildroot_list(root: Path) -> Path:
    return root / "configs" / "buildroot-symbols.txt"


def linux_list(root: Path) -> Path:
    return root / "configs" / "linux-symbols.txt"


def symbols_in(file: Path) -> set[str]:
    """The names of a list that scripts/image/symbols.py has written."""
    return {line for line in file.read_text().splitlines() if not line.startswith("#")}


def name_of(setting: Setting) -> str:
    """As Kconfig has it: Linux adds a word in front."""
    return setting.symbol.removeprefix("CONFIG_")


def buildroot_settings(root: Path) -> list[Setting]:
    """Of all defconfigs and their parts, but for our own packages."""
    own: set[str] = set()
    for file in [root / "br2-external" / "Config.in", *(root / "package").glob("*/Config.in")]:
        if file.is_file():
            own |= set(re.findall(r"^\s*config (\w+)", file.read_text(), re.MULTILINE))
    files = [*defconfigs(root), *parts(root)]
    return [each for file in files for each in settings(file) if each.symbol not in own]


def linux_settings(root: Path) -> list[Setting]:
    return [each for file in fragments(root) for each in settings(file)]


def makefiles(root: Path) -> str:
    """The Makefile and what it includes, as one text."""
    return "".join(file.read_text() for file in (root / "Makefile", *sorted((root / "mk").glob("*.mk"))))


def check_named_files(root: Path) -> list[str]:
    """What a defconfig names is there, and every fragment is in use: by a defconfig, or by the Makefile."""
    found, used = [], set()
    for file in defconfigs(root):
        for each in settings(file):
            paths = named_files(root, file, each.symbol) if EXTERNAL in each.value else []
            found += [f"{each.place}: there is no {path}" for path in paths if not path.exists()]
        used |= {fragment.resolve() for fragment in fragments_of(root, file)}
    used |= {(root / path).resolve() for path in FRAGMENT.findall(makefiles(root))}
    idle = [fragment for fragment in fragments(root) if fragment.resolve() not in used]
    return found + [f"{fragment.name}:1: nothing uses this fragment" for fragment in idle]


def check_links(root: Path) -> list[str]:
    """br2-external/configs is a folder with a link for each defconfig: Buildroot follows no folder's link."""
    folder = root / "br2-external" / "configs"
    if folder.is_symlink() or not folder.is_dir():
        return ["br2-external/configs:1: it must be a folder, with a link for each defconfig"]
    links = {link.name: link for link in folder.iterdir()}
    wanted = {file.name for file in defconfigs(root)}
    found = [f"br2-external/configs:1: no link to {name}" for name in sorted(wanted - set(links))]
    found += [f"br2-external/configs/{name}:1: links to no defconfig" for name in sorted(set(links) - wanted)]
    for name in sorted(wanted & set(links)):
        if not links[name].is_symlink() or links[name].resolve() != (root / "configs" / name).resolve():
            found.append(f"br2-external/configs/{name}:1: must be a link to ../../configs/{name}")
    return found


def check_common_part(root: Path) -> list[str]:
    """A board's systems differ only where configs/README.md says so; `…` stands for any ending."""
    readme = (root / "configs" / "README.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| ((?:`BR2_[\w…]+`(?:, )?)+) \|", readme, re.MULTILINE)
    allowed = [
        re.escape(name).replace("…", r"\w*") for cell in cells for name in re.findall(r"`([^`]+)`", cell)
    ]
    boards: dict[str, list[list[Setting]]] = {}
    for file in defconfigs(root):
        if value_of(file, "BR2_LINUX_KERNEL") == "y":
            boards.setdefault(file.name.split("_")[0], []).append(settings(file))
    return [
        f"{each.place}: {each.text} is not in every defconfig, and configs/README.md does not say why"
        for images in boards.values()
        for image in images
        for each in image
        if not all(each.text in {other.text for other in others} for others in images)
        and not any(re.fullmatch(name, each.symbol) for name in allowed)
    ]


NAMED_PARTS = re.compile(r"^# Parts: (.+)$", re.MULTILINE)


def parts_of(file: Path) -> list[Path]:
    """The parts that a defconfig names in its head."""
    found = NAMED_PARTS.search(file.read_text(encoding="utf-8"))
    return [file.parent / "parts" / f"{name}.config" for name in (found[1].split() if found else [])]


def parts(root: Path) -> list[Path]:
    return sorted((root / "configs" / "parts").glob("*.config"))


def check_parts(root: Path) -> list[str]:
    """A defconfig is the sum of its parts and of lines that no other has."""
    found, shared, own = [], {}, {}
    for file in defconfigs(root):
        named = parts_of(file)
        found += [f"{file.name}:2: there is no {part}" for part in named if not part.is_file()]
        lines = {each.text: each for each in settings(file)}
        of_parts = [each for part in named if part.is_file() for each in settings(part)]
        found += [
            f"{each.place}: {file.name} lacks {each.text}: PYTHONPATH=scripts python3 -m image.parts adds it"
            for each in of_parts
            if each.text not in lines
        ]
        shared |= {each.text: each for each in of_parts}
        for text in lines.keys() - {each.text for each in of_parts}:
            own.setdefault(text, []).append(lines[text])
    for text, places in own.items():
        if text in shared:
            found.append(
                f"{places[0].place}: {text} is of {shared[text].file.name}, which its head does not name"
            )
        elif len(places) > 1:
            found.append(f"{places[0].place}: {text} is in {places[1].file.name} too: it belongs into a part")
    return found


# ---- docs/defconfig.md -------------------------------------------------------------------------------


def check_explained(root: Path) -> list[str]:
    """Each line of the defconfigs is explained in docs/defconfig.md, and nothing else."""
    page = (root / "docs" / "defconfig.md").read_text(encoding="utf-8")
    found = []
    for file in defconfigs(root):
        explained = _explained(page, file.name)
        lines = [each.text for each in settings(file)]
        found += [
            f"{file.name}: docs/defconfig.md does not explain {line}"
            for line in lines
            if line not in explained
        ]
        found += [
            f"{file.name}: docs/defconfig.md explains {line}" for line in explained if line not in lines
        ]
        found += [f"docs/defconfig.md: twice: {line}" for line in set(explained) if explained.count(line) > 1]
    return found


def _explained(page: str, name: str) -> list[str]:
    """The lines in the page's tables, but for headings `Only in` others and `not in` this one."""
    rows = []
    for section in re.split(r"^## ", page, flags=re.MULTILINE):
        heading = section.partition("\n")[0]
        if (f"`{name}`" in heading) == heading.startswith("Only in"):
            rows += re.findall(r"^\| `((?:# )?BR2_[^`]*)` \| *[^\s|]", section, re.MULTILINE)
    return rows


# ---- what is downloaded is pinned --------------------------------------------------------------------


def check_pinned(root: Path) -> list[str]:
    """By commit, or by a hash that Buildroot is told to insist on."""
    found = [
        f"{file.name}: {what}" for file in defconfigs(root) for what in _unpinned_of_defconfig(root, file)
    ]
    for file in sorted((root / "package").glob("*/*.mk")):
        found += [f"{file.name}: {what}" for what in _unpinned_of_package(file)]
    return found + _unpinned_of_kas(root / "configs" / "kas.yml")


def _unpinned_of_defconfig(root: Path, file: Path) -> Iterator[str]:
    hashes = "\n".join(each.read_text() for each in sorted((root / "patches").rglob("*.hash")))
    if value_of(file, "BR2_DOWNLOAD_FORCE_CHECK_HASHES") != "y":
        yield "BR2_DOWNLOAD_FORCE_CHECK_HASHES is not set: files without a hash would be accepted"
    for each in settings(file):
        if each.symbol.endswith("_REPO_VERSION"):
            commit = each.value.strip('"')
            if not COMMIT.fullmatch(commit):
                yield f"{each.line}: {commit} is not a commit: a branch or tag moves"
            elif commit not in hashes:
                yield f"{each.line}: no hash in patches/ for the archive of commit {commit}"
        elif each.symbol.endswith("_CUSTOM_VERSION_VALUE"):
            version = each.value.strip('"')
            if not re.search(rf"^sha256  [0-9a-f]{{64}}  [\w-]+-{re.escape(version)}\.tar\.", hashes, re.M):
                yield f"{each.line}: no hash in patches/ for the archive of {version}"
        elif not each.symbol.endswith("_REPO_URL"):
            for url in URL.findall(each.value):
                if not re.search(
                    rf"^sha(?:256|512)  [0-9a-f]+  {re.escape(url.split('/')[-1])}$", hashes, re.M
                ):
                    yield f"{each.line}: no hash in patches/ for {url}"


def _unpinned_of_package(file: Path) -> Iterator[str]:
    """A package from a folder of this tree, too, has hashes: those of its licence texts."""
    text = file.read_text()
    version = re.search(r"_VERSION = (\S+)", text)
    by_git = re.search(r"_SITE_METHOD = git|_SITE = (?:git|ssh)://", text)
    if by_git and not (version and COMMIT.fullmatch(version[1])):
        yield "fetched with git, but its version is not a commit"
    if not file.with_suffix(".hash").is_file():
        yield f"there is no {file.stem}.hash"


def _unpinned_of_kas(file: Path) -> list[str]:
    repositories: dict[str, Any] = yaml.safe_load(file.read_text()).get("repos", {})
    return [
        f"{file.name}: {name} is pinned by no commit"
        for name, row in repositories.items()
        if row and "url" in row and not COMMIT.fullmatch(str(row.get("commit", "")))
    ]


# ---- the workflows -------------------------------------------------------------------------------------


def check_workflows(root: Path) -> list[str]:
    """Valid, each action pinned by commit with its release beside it, and only make targets that exist."""
    targets = set(re.findall(r"^([a-z][a-z-]*):", makefiles(root), re.MULTILINE))
    found = []
    for file in sorted((root / ".github" / "workflows").glob("*.y*ml")):
        text = file.read_text()
        try:
            jobs = yaml.safe_load(text)["jobs"].values()
        except (yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
            found.append(f"{file.name}: not a workflow: {error}")
            continue
        for line in re.findall(r"^.*\buses:.*$", text, re.MULTILINE):
            if not re.fullmatch(r"\s*(?:- )?uses: [\w.-]+/[\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", line):
                found.append(f"{file.name}: pin by commit, with the release as comment: {line.strip()}")
        commands = "\n".join(step.get("run", "") for job in jobs for step in job["steps"])
        words = [
            word for line in re.findall(r"^\s*make\s+(.*)", commands, re.MULTILINE) for word in line.split()
        ]
        made = {word for word in words if re.fullmatch(r"[a-z][a-z-]*", word)}
        found += [f"{file.name}: there is no target {name}" for name in sorted(made - targets)]
    return found


# ---- Buildroot's style ---------------------------------------------------------------------------------


def check_style(root: Path) -> list[str]:
    """Buildroot's rules for the form of lines and headers; `make check-image` runs its own check-package."""
    found = []
    for file in package_files(root):
        text = file.read_text(encoding="utf-8")
        name = str(file.relative_to(root))
        found += [f"{name}:{what}" for what in _untidy(text)]
        found += [f"{name}:{what}" for what in RULES.get(file.suffix, lambda _text, _file: [])(text, file)]
    return found


def package_files(root: Path) -> list[Path]:
    """What Buildroot reads as part of its tree."""
    external = [root / "br2-external" / name for name in ("Config.in", "external.mk", "external.desc")]
    packages = [file for file in sorted((root / "package").glob("*/*")) if file.is_file()]
    return [file for file in external if file.is_file()] + packages


def _untidy(text: str) -> Iterator[str]:
    lines = text.split("\n")
    if lines.pop() != "":
        yield f"{len(lines) + 1}: no end of line at the end of the file"
    for number, line in enumerate(lines, 1):
        if line != line.rstrip():
            yield f"{number}: white space at the end of the line"
        if not line.isascii():
            yield f"{number}: not ASCII"
        if number > 1 and line == lines[number - 2] == "":
            yield f"{number}: two empty lines"
    if lines and lines[-1] == "":
        yield f"{len(lines)}: empty line at the end"


def _make_rules(text: str, file: Path) -> Iterator[str]:
    lines = text.splitlines()
    if file.name != "external.mk":
        bar = "#" * 80
        head = [lines[at] if at < len(lines) else "" for at in (0, 1, 3, 4, 5)]
        if head != [bar, "#", "#", bar, ""]:
            yield "1: the header is a bar of 80 #, a #, the name, a #, the bar, an empty line"
        prefix = file.stem.upper().replace("-", "_") + "_"
        for number, line in enumerate(lines, 1):
            variable = re.match(r"(?:define )?([A-Z0-9]+_[A-Z0-9_]+)", line)
            if variable and not variable[1].startswith((prefix, f"HOST_{prefix}")):
                yield f"{number}: {variable[1]} does not begin with {prefix}"
    for number, line in enumerate(lines, 1):
        if re.match(r"\s*(?:else )?ifn?def\s", line):
            yield f"{number}: ifeq or ifneq, not ifdef"
        if re.match(r"[^#].*[^$]\${\w+}", line):
            yield f"{number}: $(NAME), not ${{NAME}}"
        if re.search(r"(?:  |\t ?)\\$", line):
            yield f"{number}: one space before the backslash"


def _config_rules(text: str, file: Path) -> Iterator[str]:
    in_help = False
    for number, line in enumerate(text.splitlines(), 1):
        word = line.split()[0] if line.split() else ""
        if re.match(r"(?:config|menuconfig|choice|endchoice|comment|menu|endmenu|if|endif|source)\b", line):
            in_help = False
        elif in_help and line and not re.match(r"\t  .{1,62}$", line) and "://" not in line:
            yield f"{number}: a help text is a tab, two spaces and at most 62 characters"
        elif word in ("bool", "string", "default", "depends", "select", "prompt", "help") and not in_help:
            if not line.startswith(f"\t{word}"):
                yield f"{number}: {word} is indented by one tab"
            if line == "\tdefault n":
                yield f"{number}: n is the default"
            in_help = word == "help"


def _hash_rules(text: str, file: Path) -> Iterator[str]:
    length = {"md5": 32, "sha1": 40, "sha256": 64, "sha512": 128}
    for number, line in enumerate(text.splitlines(), 1):
        found = re.fullmatch(r"(\w+)  ([0-9a-f]+)  \S+", line)
        if line and not line.startswith("#") and not (found and len(found[2]) == length.get(found[1])):
            yield f"{number}: the form is: type, hash, file, two spaces between"


RULES: dict[str, Callable[[str, Path], Iterator[str]]] = {
    ".mk": _make_rules,
    ".in": _config_rules,
    ".hash": _hash_rules,
}

CHECKS: list[Callable[[Path], list[str]]] = [
    check_form,
    check_once,
    check_known,
    check_named_files,
    check_links,
    check_common_part,
    check_parts,
    check_explained,
    check_pinned,
    check_workflows,
    check_style,
]
