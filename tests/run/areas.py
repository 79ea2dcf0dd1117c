# SPDX-License-Identifier: GPL-3.0-or-later
"""Which area a test is in, and which parts of `make test` a change of a file can reach."""

import re
from collections import defaultdict
from collections.abc import Iterable
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "tests/rig"  # what tests of several rooms work on

# A folder of tests is an area: a room of the product, or what is looked at. Each is a target of the Makefile.
AREAS = sorted({file.parent.name for file in (ROOT / "tests").glob("*/test_*.py")})
TARGETS = {area: f"test-{area}" for area in AREAS}

# The other targets that test something, and what they stand for below.
C = "lint unit asan cross"
DESK = (  # the gateway on this machine
    "test-sanitizers test-station test-controlling test-lines test-gateway test-config test-modules "
    "test-logic test-snmp test-iec61850 test-goose test-position test-web test-tools test-shows test-plant "
    "test-packages test-house test-bench"
)
BOARDS = "test-twin test-netboot test-linux"  # all that runs on the emulated board
ON_BOARD = (  # the gateway there
    "tests/linux/test_after_2038.py tests/linux/test_buffered_cuts.py tests/linux/test_data_volume.py "
    "tests/linux/test_gateway_*.py tests/linux/test_ntp.py tests/linux/test_receiver_clock.py "
    "tests/linux/test_realtime.py tests/linux/test_run.py tests/linux/test_system*.py "
    "tests/linux/test_trial_boots.py tests/linux/test_update_board.py tests/linux/test_update_cuts.py "
    "tests/linux/test_update_root.py tests/linux/test_watchdog_gateway.py"
)
NETBOOT = "test-netboot tests/twin/test_uboot.py test-linux test-bench"  # who boots over the debug UART
TREE = "tests/house/test_tree.py"  # it reads every file
CONFIG = "tests/config/test_config.py tests/config/test_config_schema.py"
CODES = "tests/house/test_codes.py tests/house/test_codes_added.py"  # what is made from C's numbers
KEYS = "tests/house/test_key_added.py"  # what is made of the rules of the configuration
PIP = "lint tests/packages/test_pip_install.py tests/tools/test_tools_mistakes.py"
SERIES = "tests/house/test_make_series.py tests/linux/test_series.py tests/twin/test_series_applied.py"
SITE = "tests/house/test_pages.py tests/centre/test_pages_site.py"
ALL = f"{C} fuzzers test-sanitizers {' '.join(TARGETS.values())}"

# What a change of a path can reach: targets, or files of tests. The first pattern that fits counts; what
# fits none can reach all.
REACH = [
    # pages: who reads them
    ("mkdocs.yml", SITE),
    ("requirements-site.txt", SITE),
    ("scripts/packages-site.txt", SITE),
    ("scripts/site-source.py", f"lint {SITE}"),
    ("docs/site/*", SITE),
    ("docs/security.md", "tests/gateway/test_entrances.py"),
    ("docs/configuration.md", f"{CONFIG} {CODES} {KEYS}"),
    ("docs/development.md", f"tests/house/test_codes_added.py {KEYS}"),
    ("docs/first-device.md", "tests/house/test_docs_commands.py"),
    (
        "docs/examples/first-device.json",
        f"{CONFIG} tests/config/test_points.py tests/house/test_docs_commands.py",
    ),
    ("docs/limit.md", "tests/config/test_config.py"),
    ("docs/toolbox.md", "tests/house/test_docs_commands.py"),
    ("docs/interoperability.md", "tests/station/test_interoperability.py"),
    ("docs/faults.md", "tests/lines/test_line_faults.py"),
    (
        "docs/telecontrol.md",
        "tests/gateway/test_event_journal.py tests/gateway/test_retained.py "
        "tests/station/test_station_tls*.py",
    ),
    ("docs/positioning.md", "tests/station/test_station_position.py"),
    ("docs/centre.md", f"tests/controlling/test_centre.py {CONFIG} {CODES} {KEYS}"),
    ("docs/control-centre.md", f"test-centre {CONFIG} {KEYS}"),
    ("docs/operators-day.md", "tests/centre/test_operators_day.py"),
    ("docs/process-pictures.md", "tests/centre/test_centre_picture_check.py"),
    ("docs/examples/pictures/*", "tests/centre/test_centre_picture_check.py"),
    ("docs/concentrator.md", "tests/controlling/test_outstations*.py"),
    ("docs/examples/concentrator.json", "lint tests/controlling/test_outstations.py"),
    ("docs/traps.md", "tests/station/test_station_traps.py"),
    ("docs/realtime.md", "tests/linux/test_realtime.py"),
    ("docs/netboot.md", "tests/netboot/test_netboot_docs.py"),
    ("docs/update.md", "tests/netboot/test_slots.py"),
    ("docs/defconfig.md", "test-image"),
    ("docs/image-*.md", "test-image"),
    ("docs/device-tree.md", "test-pins"),
    ("docs/figures/run-native.svg", "tests/shows/test_show.py"),
    ("docs/figures/blocks.svg", "tests/logic/test_logic_blocks.py"),
    ("docs/figures/blocks/*", "tests/logic/test_logic_blocks.py"),
    ("docs/figures/iec61850-groups.svg", "tests/iec61850/test_iec61850_conformance.py"),
    ("docs/figures/goose-repetition.svg", "tests/iec61850/test_iec61850_conformance.py"),
    ("docs/figures/*", "tests/pins/test_picture.py tests/netboot/test_netboot_docs.py"),
    ("docs/goose.md", "test-goose"),
    ("docs/web.md", "tests/house/test_docs_commands.py"),
    ("docs/snmp.md", "test-snmp"),
    ("docs/examples/snmp/*", "tests/snmp/test_snmp.py"),
    ("docs/iec61850.md", "test-iec61850"),
    ("docs/conformance-61850.md", "tests/iec61850/test_iec61850_conformance.py"),
    ("docs/logic.md", "tests/logic/test_logic.py tests/house/test_docs_commands.py"),
    ("docs/blocks.md", "tests/logic/test_logic_blocks.py"),
    ("README.md", "tests/modules/test_foreign.py tests/house/test_pages.py"),
    ("docs/writing-a-module.md", "tests/modules/test_foreign.py tests/packages/test_debian_packages.py"),
    ("docs/examples/modules/plant.py", "lint tests/modules/test_plant.py"),
    ("docs/examples/modules/*", "lint tests/modules/test_foreign*.py tests/shows/test_show.py"),
    ("docs/synch.md", "tests/modules/test_synch.py"),
    (
        "docs/examples/logic/*",
        "tests/packages/test_debian_packages.py test-logic tests/modules/test_plant.py "
        "tests/shows/test_show.py",
    ),
    ("docs/examples/*.dts", "tests/pins/test_picture.py tests/packages/test_pip_install.py"),
    ("docs/examples/*.json", f"{CONFIG} tests/config/test_points.py tests/packages/test_pip_install.py"),
    ("*.md", f"{TREE} tests/house/test_pages.py"),
    ("LICENSES/*", TREE),
    ("REUSE.toml", TREE),
    # the software on the target
    ("package/openrtu/src/*/test_*.[ch]", C),
    ("package/openrtu/src/*fuzz*", f"{C} fuzzers tests/house/test_fuzz.py"),
    (
        "package/openrtu/src/VERSION",
        f"{C} {DESK} test-image {ON_BOARD} tests/linux/test_update_versions.py",
    ),
    (
        "package/openrtu/src/journal/record.c",
        f"{C} fuzzers {DESK} {ON_BOARD} tests/image/test_update_file.py",
    ),
    (
        "package/openrtu/src/rtud/config.schema.json",
        f"{C} fuzzers {DESK} {ON_BOARD} tests/image/test_gateway_programs.py",
    ),
    (
        "package/openrtu/src/centre/*",
        f"{C} fuzzers test-centre tests/controlling/test_centre.py tests/house/test_fuzz.py "
        f"tests/packages/test_installation.py {CODES}",
    ),
    (
        "package/openrtu/src/*web/*",
        f"{C} fuzzers {ON_BOARD} test-web tests/centre/test_web*_page.py"
        f" {CONFIG} tests/house/test_fuzz.py tests/packages/test_installation.py",
    ),
    *(
        (
            f"package/openrtu/src/rtud/{of_set_up}.*",
            f"{C} fuzzers {DESK} {ON_BOARD} tests/centre/test_web_setup_page.py",
        )
        for of_set_up in ("setup", "proposal", "proposed", "history")
    ),
    ("package/openrtu/src/*", f"{C} fuzzers {DESK} {ON_BOARD}"),
    (
        "package/openrtu/python/*",
        f"lint tests/modules/test_foreign*.py tests/packages/test_version.py "
        f"tests/centre/test_centre_higher.py {CODES}",
    ),
    ("package/openrtu/debian/*", "tests/packages/test_debian_packages.py"),
    ("package/openrtu/container/*", "lint tests/packages/test_containers.py tests/centre/test_compose.py"),
    ("package/openrtu/openrtu.mk", f"test-image tests/packages/test_version.py {ON_BOARD}"),
    ("package/openrtu/*", f"test-image {ON_BOARD}"),
    # the control centre
    (
        "centre/codes.py",
        f"{PIP} test-centre {CODES} tests/controlling/test_centre.py tests/position/test_position_object.py",
    ),
    (
        "centre/settings.py",
        f"{PIP} test-centre {CONFIG} tests/bench/test_store.py {CODES} {KEYS}",
    ),
    ("centre/apdu.py", f"{PIP} test-centre tests/controlling/test_asdu_decoders.py"),
    ("centre/*", f"{PIP} test-centre tests/bench/test_store.py {CODES}"),
    ("scripts/lab/centre_*.py", "lint test-centre"),
    ("scripts/lab/vehicles.py", "lint test-centre"),
    ("scripts/lab/fleet.py", "lint test-centre"),
    ("scripts/lab/roads.py", "lint test-centre"),
    # the tools
    (
        "scripts/openrtu_tools/logic/*",
        f"{PIP} test-logic tests/modules/test_plant.py tests/gateway/test_retained.py "
        f"tests/shows/test_show.py"
        " tests/gateway/test_reload_settings.py tests/modules/test_synch.py "
        "tests/house/test_docs_commands.py"
        " tests/gateway/test_event_journal.py tests/gateway/test_many_modules.py",
    ),
    ("scripts/keys.py", f"lint {CONFIG} tests/house/test_codes_added.py {KEYS}"),
    ("scripts/block-plots.py", "lint tests/logic/test_logic_blocks.py"),
    ("scripts/openrtu_tools/modbus/made.py", f"{PIP} test-tools {KEYS} tests/lines/test_device_library.py"),
    (
        "scripts/openrtu_tools/modbus/*",
        f"{PIP} test-tools tests/tools/test_openrtu_completion.py tests/lines/test_device_library.py "
        "tests/lines/test_modbus_udp.py tests/lines/test_pass_through.py",
    ),
    ("scripts/openrtu_tools/points.py", f"{PIP} tests/config/test_points.py {CONFIG}"),
    (
        "scripts/openrtu_tools/codes.py",
        f"{PIP} test-centre {CODES} test-logic tests/snmp/test_snmp.py",
    ),
    ("scripts/openrtu_tools/scl.py", f"{PIP} tests/iec61850/test_iec61850_cid.py"),
    ("scripts/openrtu_tools/snmp_keys.py", f"{PIP} test-snmp"),
    (
        "scripts/openrtu_tools/web_users.py",
        f"{PIP} test-web tests/centre/test_web*_page.py",
    ),
    ("scripts/openrtu_tools/devices.py", f"{PIP} test-tools tests/lines/test_device_library.py"),
    (
        "scripts/openrtu*",
        f"{PIP} test-centre test-logic tests/gateway/test_event_journal.py tests/config/test_points.py "
        "test-web tests/iec61850/test_iec61850_cid.py test-snmp tests/modules/test_plant.py "
        "tests/shows/test_show.py tests/packages/test_version.py tests/house/test_docs_commands.py "
        "tests/linux/test_run.py "
        "tests/tools/test_openrtu_completion.py test-tools tests/lines/test_modbus_udp.py "
        "tests/lines/test_pass_through.py",
    ),
    ("scripts/lab/twin_show.py", "test-twin"),
    (
        "scripts/lab/manager.py",
        "lint tests/packages/test_debian_packages.py tests/gateway/test_entrances.py test-snmp "
        "tests/gateway/test_reload.py "
        "tests/gateway/test_reload_running.py tests/shows/test_show.py "
        "tests/gateway/test_same_events.py tests/lines/test_modbus_udp.py "
        "tests/linux/test_system_tls.py",
    ),
    ("scripts/lab/managed.py", "lint tests/shows/test_show.py tests/linux/test_run.py"),
    ("scripts/lab/site.py", "lint test-linux test-image"),
    (
        "scripts/lab/*",
        f"{DESK} test-netboot test-linux test-centre",
    ),
    (
        "scripts/nuc980/pins/*",
        "test-pins test-twin test-netboot test-linux tests/house/test_docs_commands.py",
    ),
    ("scripts/nuc980-pins", "test-pins"),
    ("scripts/nuc980/netboot/slots/*", f"{NETBOOT} test-image"),
    (
        "scripts/nuc980/netboot/limits.py",
        f"{NETBOOT} tests/house/test_docs_commands.py tests/image/test_update_file.py",
    ),
    ("scripts/nuc980/netboot/errors.py", f"{NETBOOT} tests/shows/test_verdict.py"),
    ("scripts/nuc980/netboot/*", f"{NETBOOT} tests/house/test_docs_commands.py"),
    ("scripts/nuc980-netboot", "test-netboot"),
    ("scripts/nuc980/twin/*", f"{BOARDS} test-bench"),
    ("scripts/image/*", f"test-image {BOARDS}"),
    ("scripts/series.py", f"lint {SERIES}"),
    ("scripts/build-dtb.sh", f"test-pins test-image {BOARDS}"),
    ("scripts/build-for-board.sh", f"test-image {BOARDS}"),
    ("scripts/validate-dtb.sh", "test-pins"),
    ("scripts/build-qemu.sh", BOARDS),
    ("scripts/build-uboot.sh", BOARDS),
    ("scripts/patched-source.sh", BOARDS),
    ("scripts/debian-source.sh", f"test-image {BOARDS}"),
    (
        "scripts/source-date.sh",
        "test-image tests/packages/test_debian_packages.py tests/packages/test_containers.py "
        "tests/packages/test_pip_install.py"
        " tests/position/test_gps.py",
    ),
    ("scripts/cppcheck.cfg", "lint"),
    ("scripts/build-deb.sh", "tests/packages/test_debian_packages.py"),
    ("scripts/build-root.sh", "tests/packages/test_debian_packages.py"),
    ("scripts/private-root.sh", "tests/packages/test_debian_packages.py tests/packages/test_containers.py"),
    ("scripts/build-containers.sh", "tests/packages/test_containers.py tests/centre/test_compose.py"),
    ("scripts/oci-archive.py", "lint tests/packages/test_containers.py tests/centre/test_compose.py"),
    ("scripts/build-*.sh", "test-linux"),
    ("scripts/debian-package.sh", "test-linux test-bench"),
    ("scripts/no-buildroot.sh", "test-image"),
    ("scripts/offline-toolchain.sh", "test-image"),
    ("scripts/Containerfile", "test-image"),
    (
        "scripts/release/version.py",
        f"test-image tests/packages/test_version.py tests/packages/test_installation.py "
        f"tests/modules/test_foreign.py {ON_BOARD}"
        " tests/linux/test_update_versions.py tests/packages/test_debian_packages.py",
    ),
    ("scripts/release-files.sh", "test-image"),
    ("scripts/apt-repository.sh", "test-image"),
    ("scripts/packages-release.txt", "test-image"),
    ("scripts/setup-sysroot.sh", "cross test-linux"),
    ("scripts/armel.ini", "cross test-linux"),
    # the board
    ("board/nuc980/qemu/*", f"lint {SERIES} {BOARDS}"),
    ("board/nuc980/linux/*/*", f"{SERIES} test-image test-pins test-linux"),
    ("board/nuc980/u-boot/*", f"{SERIES} test-image test-pins {BOARDS}"),
    ("board/nuc980/boards/*/pins.yml", f"test-pins {BOARDS}"),
    ("board/*", "lint test-image test-pins test-netboot test-linux"),
    ("dts/*", f"{SERIES} test-pins test-image {BOARDS}"),
    ("patches/*/series.toml", SERIES),
    ("patches/qemu/*", f"{SERIES} test-image {BOARDS}"),
    ("patches/uboot/*", f"{SERIES} test-image {BOARDS}"),
    ("patches/linux/*", f"{SERIES} test-image test-pins test-linux"),
    ("configs/*", "test-image tests/linux/test_run.py"),
    ("br2-external/*", "test-image"),
    (".github/*", "test-image"),
    # the tests; a file of tests reaches itself
    ("tests/plant/*", "lint test-plant"),
    ("tests/linesim/*", f"lint {DESK} {ON_BOARD}"),
    (
        "tests/peers/centre_consumer.py",
        "tests/controlling/test_centre.py tests/position/test_position_object.py",
    ),
    (
        "tests/peers/outstation.py",
        "tests/controlling/test_outstations*.py tests/controlling/test_centre.py "
        "tests/iec61850/test_iec61850_buffered.py",
    ),
    ("tests/peers/goose*.py", "test-goose"),
    ("tests/peers/ddi.py", "tests/image/test_pull.py tests/linux/test_update_board.py"),
    ("tests/peers/mms.py", f"{DESK} tests/linux/test_network.py tests/linux/test_buffered_cuts.py"),
    ("tests/peers/*", f"{DESK} {ON_BOARD} test-netboot tests/centre/test_web_setup_page.py"),
    ("tests/rig/desk.py", f"{DESK} {ON_BOARD}"),
    ("tests/rig/capture.py", f"{DESK} tests/centre/test_centre_higher.py tests/linux/test_network.py"),
    ("tests/run/changed.py", "tests/house/test_changed.py"),
    ("tests/run/cover*", "tests/house/test_covered.py"),
    ("tests/logic/logic_reference.py", "tests/logic/test_logic.py tests/logic/test_logic_findings.py"),
    ("tests/logic/logic_findings.py", "tests/logic/test_logic.py tests/logic/test_logic_findings.py"),
    ("tests/house/fuzzing.py", "tests/house/test_fuzz.py"),
    ("tests/fixtures/corpus/*", "tests/house/test_fuzz.py"),
    ("tests/fixtures/*", DESK),
    ("tests/netboot/*", "lint test-netboot test-linux"),
    ("tests/bench/*", "lint test-bench"),
    ("tests/image/*", "test-image"),
    ("tests/linux/*", "lint test-linux"),
    ("tests/pins/*", "test-pins"),
    ("tests/twin/*", "lint test-twin"),
    ("tests/centre/*", "lint test-centre"),
]
# What reads or checks each file, whatever it is.
ALWAYS = f"lint {TREE}"


def area_of(test: str) -> str:
    """The folder below tests/; "" for what is no test.

    >>> [area_of(test) for test in ("tests/pins/test_dts.py::test_x", "tests/rig/desk.py")]
    ['pins', '']
    """
    path = Path(test.partition("::")[0])
    return path.parts[1] if path.match("tests/*/test_*.py") else ""


@cache
def tests() -> list[str]:
    return sorted(str(file.relative_to(ROOT)) for file in (ROOT / "tests").rglob("test_*.py"))


@cache
def files_of(word: str) -> list[str]:
    """The files of tests that a pattern fits; of a target, the target."""
    return [test for test in tests() if fnmatchcase(test, word)] or [word]


@cache
def importers() -> dict[str, set[str]]:
    """Which files of tests and modules of the rig take something from a module of tests/, by its name."""
    found: dict[str, set[str]] = defaultdict(set)
    for file in (*tests(), *(f"tests/rig/{module.name}" for module in RIG.glob("*.py"))):
        text = (ROOT / file).read_text()
        for module, names in re.findall(r"^(?:from|import) ([\w.]+)(?: import (.*))?", text, re.MULTILINE):
            for taken in names.split(", ") if module == RIG.name else [module.rpartition(".")[2]]:
                found[taken].add(file)
    return found


def takers(path: str) -> set[str]:
    """The files of tests that import the module, or a module of the rig that does."""
    direct = importers()[Path(path).stem]
    return {test for file in direct for test in ([file] if area_of(file) else takers(file))}


def reach(path: str) -> set[str]:
    """What a change of the file can reach: targets of the Makefile, and files of tests."""
    words = next((words for pattern, words in REACH if fnmatchcase(path, pattern)), "").split()
    if area_of(path) and path != TREE:
        words = [path, *takers(path)]
    elif not words:
        words = sorted(takers(path)) if path.startswith("tests/rig/") else ALL.split()
    return {found for word in (*words, *ALWAYS.split()) for found in files_of(word)}


def parts(paths: Iterable[str]) -> dict[str, dict[str, list[str]]]:
    """The targets that changes of these files reach, in the order of a run, and why.

    Of each target: "" for all of it or its files of tests, with the changed files that reach them.
    """
    chosen: dict[str, dict[str, list[str]]] = {target: {} for target in ALL.split()}
    for path in paths:
        for word in sorted(reach(path)):
            target, only = (word, "") if word in chosen else (TARGETS[area_of(word)], word)
            chosen[target].setdefault(only, []).append(path)
    whole = {target: {"": reasons[""]} for target, reasons in chosen.items() if "" in reasons}
    return {target: whole.get(target, reasons) for target, reasons in chosen.items() if reasons}
