# SPDX-License-Identifier: GPL-3.0-or-later
"""U-Boot's environment: read, kept, compared, put back; values of any kind through two real U-Boots."""

import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from netboot.double import FACTORY_ENVIRONMENT, Double, faults
from nuc980.netboot.commandline import LINE_ROOM, typed
from nuc980.netboot.console import Console
from nuc980.netboot.environment import (
    Environment,
    differences,
    keep,
    load,
    parse,
    plan_restore,
    printed,
    read_environment,
)
from nuc980.netboot.errors import LineUnsafe, UnusableInput
from nuc980.netboot.plan import SetVariable
from nuc980.netboot.transport import Line

VERSION = "U-Boot 2016.11 (Nov 20 2019 - 10:32:17 +0800)"
VIRT_UBOOT = Path("/usr/lib/u-boot/qemu_arm/u-boot.bin")

names = st.text(st.characters(min_codepoint=33, max_codepoint=126, exclude_characters="=#"), min_size=1)
values = st.text(st.characters(min_codepoint=32, max_codepoint=126) | st.just("\n"), min_size=1)


@pytest.fixture
def factory() -> Environment:
    return Environment(dict(FACTORY_ENVIRONMENT), 0x10000 - 4)


# ---- the text


busy = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # the host may be


@busy
@given(st.dictionaries(names, values, min_size=1), st.integers(1, 2**20))
def test_text_comes_back_as_it_was(variables: dict[str, str], room: int) -> None:
    environment = Environment(variables, room)
    assert parse(printed(environment), whole=True) == environment


def test_factorys_file_is_read() -> None:
    """As the report has it: no size at its end."""
    text = "".join(f"{name}={value}\n" for name, value in FACTORY_ENVIRONMENT.items())
    assert parse(text) == Environment(FACTORY_ENVIRONMENT)


@pytest.mark.slow
@pytest.mark.parametrize("size", [35 + 1, 35 + 1 + 2 * 2])
def test_both_ways_to_count_are_known(size: int) -> None:
    """2016.11 says two bytes more for each variable than 2023.01."""
    text = f"bootcmd=a; b=c; d='e'\nbootdelay=3\n\nEnvironment size: {size - 1}/65532 bytes\n"
    assert parse(text, whole=True).variables == {"bootcmd": "a; b=c; d='e'", "bootdelay": "3"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a=1\nb=2\n", "no 'Environment size'"),
        ("a=1\n\nEnvironment size: 6/65532 bytes\n", "5 bytes, and its own count says 6"),
        ("a=1\nnoise\n\nEnvironment size: 11/65532 bytes\n", "no variable: 'noise'"),
        ("a=1\\\n\nEnvironment size: 5/65532 bytes\n", "no variable"),
    ],
)
def test_what_printenv_does_not_print_is_refused(text: str, why: str) -> None:
    with pytest.raises(UnusableInput, match=why):
        parse(text, whole=True)


# ---- read from a board


@contextmanager
def prompt_of(double: Double) -> Iterator[Console]:
    with double, Line(double.port) as line:
        console = Console(line)
        console.reach()
        yield console


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["factory", "ours"])
def test_it_is_read_with_its_room(variant: str) -> None:
    stored = {**FACTORY_ENVIRONMENT, "odd": "back\\slash and\nline's end"}
    with prompt_of(Double(variant, environment=stored)) as console:
        environment = read_environment(console)
    assert environment.variables == stored
    assert environment.room == 0xFFFC


@pytest.mark.slow
def test_a_wrong_character_is_noticed() -> None:
    """Even when it comes twice: the readings agree, and are longer than U-Boot says."""
    noise = faults.Misprints("printenv", "bootdelay=3", "bootdelay=33", times=2)
    with prompt_of(Double(faults=[noise])) as console:
        assert read_environment(console).variables == FACTORY_ENVIRONMENT


@pytest.mark.slow
def test_each_time_another_is_refused() -> None:
    noise = [faults.Misprints("printenv", "bootdelay=3", f"bootdelay={n}") for n in range(4, 8)]
    with (
        prompt_of(Double(faults=noise)) as console,
        pytest.raises(LineUnsafe, match="Each reading"),
    ):
        read_environment(console)


# ---- kept


def test_the_first_one_is_never_overwritten(tmp_path: Path, factory: Environment) -> None:
    first = keep(tmp_path / "site", factory, VERSION, "/dev/ttyUSB0")
    assert first == tmp_path / "site/environment.txt"
    text = first.read_text()
    assert re.match(rf"# saved by .* from /dev/ttyUSB0\n# {re.escape(VERSION)}\nbaudrate=115200\n", text)
    assert load(first) == factory

    later = keep(tmp_path / "site", Environment({**factory.variables, "ipaddr": "1.2.3.4"}), VERSION, "x")
    assert first.read_text() == text
    assert later is not None and re.fullmatch(r"environment-\d{8}T\d{6}\.txt", later.name)
    assert load(later).variables["ipaddr"] == "1.2.3.4"


def test_many_of_one_second_are_kept(tmp_path: Path) -> None:
    """Short runs after each other, each with another variable, must not fail for want of a name."""
    files = [keep(tmp_path, Environment({"ipaddr": f"10.0.0.{at}"}), VERSION, "x") for at in range(5)]
    assert [load(path).variables["ipaddr"][-1] for path in files if path] == list("01234")


def test_the_same_is_not_kept_twice(tmp_path: Path, factory: Environment) -> None:
    keep(tmp_path, factory, VERSION, "x")
    again = Environment({**factory.variables, "filesize": "2e65d8", "fileaddr": "7fc0"}, factory.room)
    assert keep(tmp_path, again, VERSION, "x") is None
    assert len(list(tmp_path.iterdir())) == 1


def test_half_a_file_is_not_taken_for_the_environment(tmp_path: Path, factory: Environment) -> None:
    """The host lost its power while it wrote."""
    first = keep(tmp_path, factory, VERSION, "x")
    assert first is not None
    first.write_text(first.read_text()[:150])
    second = keep(tmp_path, factory, VERSION, "x")
    assert second is not None and load(second) == factory
    assert first.stat().st_size == 150


def test_a_file_cut_or_changed_is_refused(tmp_path: Path, factory: Environment) -> None:
    path = keep(tmp_path, factory, VERSION, "x")
    assert path is not None
    path.write_text(path.read_text().replace("bootdelay=3", "bootdelay=30"))
    with pytest.raises(UnusableInput, match="changed by hand"):
        load(path)
    path.write_text(re.sub(r"\nEnvironment size.*", "", path.read_text()))
    assert load(path).variables["bootdelay"] == "30"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(UnusableInput, match="not text"):
        load(path)


# ---- put back


def test_what_differs_is_set_and_the_rest_removed() -> None:
    here = {"a": "1", "b": "2", "new": "x", "filesize": "7", "ethact": "emac", "baudrate": "115200"}
    wanted = {"a": "1", "b": "3", "gone": "y", "fileaddr": "9", "stdin": "nc", "baudrate": "9600"}
    shown = [str(each) for each in differences(here, wanted)]
    assert shown == [
        "- b=2\n+ b=3",
        "  baudrate is left to U-Boot: 115200",
        "  ethact is left to U-Boot: emac",
        "  fileaddr is left to U-Boot: not set",
        "  filesize is left to U-Boot: 7",
        "+ gone=y",
        "- new=x",
        "  stdin is left to U-Boot: not set",
    ]
    steps = plan_restore(here, wanted, save=True).steps
    assert [command for step in steps for command in step.commands()] == [
        "setenv b '3'",
        "setenv gone 'y'",
        "setenv new",
        "printenv",
        "printenv",
        "saveenv",
    ]


def test_nothing_is_typed_when_nothing_differs() -> None:
    assert plan_restore({"a": "1", "filesize": "7"}, {"a": "1"}, save=False).steps == ()


@pytest.mark.slow
@pytest.mark.parametrize("value", ["two\nlines", "schön", "tab\there"])
def test_what_cannot_be_typed_is_refused_before_anything_is(value: str) -> None:
    with pytest.raises(UnusableInput, match=r"odd: .* printable ASCII"):
        plan_restore({}, {"a": "1", "odd": value}, save=False)


# ---- values through U-Boot's shell


printable = st.characters(min_codepoint=32, max_codepoint=126)
shell = st.sampled_from("'\"\\$;&|#{}()[]<>*?!~` =ab")
short = st.text(printable, min_size=1, max_size=200) | st.text(shell, min_size=1, max_size=100)
long = st.text(printable, min_size=230, max_size=700) | st.text(shell, min_size=230, max_size=500)
typed_values = short | long


@pytest.mark.slow
@busy
@given(typed_values)
def test_each_line_fits(value: str) -> None:
    for command in SetVariable("bootcmd", value).commands():
        assert len(typed(command, 9999)) <= LINE_ROOM


@pytest.fixture(scope="module")
def on_the_twin(qemu: Path, uboot: Path) -> Iterator[Console]:
    with _started([qemu, "-M", "nuc980,pace=off", "-bios", uboot]) as console:
        yield console


@pytest.fixture(scope="module")
def on_virt() -> Iterator[Console]:
    """Debian's U-Boot for QEMU's machine virt."""
    with _started(["qemu-system-arm", "-M", "virt", "-bios", VIRT_UBOOT]) as console:
        yield console


@contextmanager
def _started(command: list[str | Path]) -> Iterator[Console]:
    process = subprocess.Popen(
        [*command, "-display", "none", "-nodefaults", "-nic", "none", "-serial", "pty"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        assert process.stdout
        output = process.stdout.readline()
        found = re.search(r"/dev/pts/\d+", output)
        assert found, output
        with Line(found[0]) as line:
            console = Console(line)
            console.reach()
            yield console
    finally:
        process.kill()
        process.wait()


together = settings(
    max_examples=200, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)


def sets_and_reads(console: Console, value: str) -> None:
    for command in SetVariable("value", value).commands():
        console.run(command).required()
    assert read_environment(console).variables["value"] == value


@pytest.mark.slow
@together
@given(value=typed_values)
def test_value_comes_back_from_our_uboot(on_the_twin: Console, value: str) -> None:
    sets_and_reads(on_the_twin, value)


@pytest.mark.slow
@settings(together, max_examples=60)
@given(value=typed_values)
def test_value_comes_back_from_debians_uboot(on_virt: Console, value: str) -> None:
    sets_and_reads(on_virt, value)
