# SPDX-License-Identifier: GPL-3.0-or-later
"""What scripts/house.py counts, and that nothing of the product is there twice or for nobody."""

import subprocess
from pathlib import Path, PurePosixPath

import pytest

import house

ROOT = Path(__file__).resolve().parents[2]
C = """
static int first(int a,
                 int b)
{
%s
}

static int second(void)
{
%s
}
"""
BODY = "\n".join(f"\ta += {number};" for number in range(house.LEAST_DOUBLE))
PYTHON = "def {0}():\n    if a:\n" + "".join(f"        b({number})\n" for number in range(6))


def test_functions_and_their_bodies() -> None:
    first, second = house.functions_of_c("a.c", C % (BODY, "\treturn 1;"))
    assert (first.name, len(first.body)) == ("first", house.LEAST_DOUBLE)
    assert (second.name, second.body) == ("second", ("\treturn 1;",))
    assert house.doubles([first, second]) == []
    assert house.doubles([*house.functions_of_c("a.c", C % (BODY, BODY))]) != []
    assert house.doubles([*house.functions_of_python("a.py", PYTHON.format("x") + PYTHON.format("y"))]) != []


def test_what_nobody_uses_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.c").write_text("int used(void) { return 1; }\nint idle(void) { return used(); }\n")
    (tmp_path / "b.c").write_text("int used(void);\nint main(void) { return used(); }\n")
    subprocess.run(["cc", "-c", "a.c", "b.c"], cwd=tmp_path, check=True)
    assert house.unused(tmp_path) == ["idle (a)"]


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("package/openrtu/src/map/a.c", "gateway"),
        ("package/openrtu/src/map/test_a.c", "tests"),
        ("board/nuc980/linux/drivers/rtc/a.c", "drivers"),
        ("centre/page/js/a.js", "centre"),
        ("docs/figures/a.svg", "documentation"),
        ("scripts/a.py", "tools"),
        ("a", "configuration"),
    ],
)
def test_each_file_is_of_one_kind(path: str, kind: str) -> None:
    assert house.kind_of(PurePosixPath(path)) == kind


@pytest.mark.slow
def test_nothing_is_there_twice_or_for_nobody(programs: Path) -> None:
    said = list(house.told(ROOT, programs))
    assert "functions of C that are there twice: 0" in said
    assert "functions of Python that are there twice: 0" in said
    assert "symbols that no other file uses: 0" in said
