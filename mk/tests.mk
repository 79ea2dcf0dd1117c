# SPDX-License-Identifier: GPL-3.0-or-later
# The tests.

PROBES      = tests/twin/probes
PAYLOAD     = tests/netboot/payload
PROGRAMS    = tests/linux/programs
C_FILES     = $(shell find $(SRC) $(LINESIM) $(PLANT) $(BENCH) $(PROBES) $(PAYLOAD) $(PROGRAMS) -name '*.[ch]')
# Once more with the modules built under AddressSanitizer and UBSan.
# Not of TLS that lasts or is of another maker: what they work on is OpenSSL, which no sanitizer has seen.
UNDER_SANITIZERS = tests/gateway/test_gateway.py tests/lines/test_lines.py tests/gateway/test_event_journal.py \
  $(filter-out tests/station/test_station_tls_%,$(wildcard tests/station/test_*.py)) tests/controlling/test_station_controlling.py
SHELL_FILES = .ci/run scripts/openrtu scripts/nuc980-pins scripts/nuc980-netboot scripts/kept tests/run/as-user.sh package/openrtu/container/*-* $(wildcard scripts/*.sh scripts/image/*.sh scripts/for-board/*.sh $(PROGRAMS)/*.sh board/*/*.sh package/*/S[0-9]* $(SRC)/*/*/*.sh \
  board/*/*/etc/init.d/* board/*/*/usr/sbin/*) board/nuc980/skeleton/init board/nuc980/skeleton/usr/share/udhcpc/default.script

lint: build/clang-format.done ## Test: check the sources: ruff, clang-format, cppcheck, shellcheck
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	@mkdir -p build/cppcheck
	cppcheck --quiet -j 2 --cppcheck-build-dir=build/cppcheck --enable=warning,performance,portability --error-exitcode=1 --inline-suppr \
	  --suppress=normalCheckLevelMaxBranches --library=scripts/cppcheck.cfg -I $(SRC) $(SRC) $(LINESIM) $(PLANT) $(BENCH) $(PROBES) $(PAYLOAD) $(PROGRAMS)
	shellcheck --external-sources $(SHELL_FILES)

# Of what has changed since; of all, if it is the style or the tool.
build/clang-format.done: .clang-format $(LINTED) $(C_FILES)
	@echo clang-format --dry-run -Werror
	@.venv/bin/clang-format --dry-run -Werror $(if $(filter .clang-format $(LINTED),$?),$(C_FILES),$?)
	@mkdir -p $(@D) && touch $@

# Many of these wait for a line, a timer or a guest: four at a time fill two cores. A file's tests share what they start.
WORKERS := 4
BESIDE = -n $(WORKERS) --dist loadfile --no-loadscope-reorder --max-worker-restart 0
PYTEST = OPENRTU_TIMES=build/times/$@.json $(PYTHON) tests/run/alone.py $(BESIDE)

test-quick: LISTS := packages packages-lint packages-boards packages-tests
test-quick: $(PACKAGES) $(LINTED) $(TESTED) ## Test: lint, C unit tests, the quick half of pytest
	$(MAKE) --jobs 3 .lint-logged unit .venv/collected
	@echo '   * pytest: some 4 000 quick tests, four at a time; a dot each'
	$(MAKE) .quick

.PHONY: .lint-logged
.lint-logged:
	$(LOGGED) lint $(MAKE) lint

# Nothing on the emulated board is quick, and nobody begins with the bench: each worker would read these files.
QUICK := --ignore=tests/linux --ignore=tests/twin --ignore=tests/bench -m "not slow and not soak"

.PHONY: .quick
.quick: build .venv/collected
	$(PYTEST) $(QUICK)

# Of what no instrumented build does: its filters of system calls and its memory.
CONFINED = test_modules_have_what_they_need_and_no_more test_the_parsed_file_is_given_back

# The unit tests and the quick half once more, of a build that counts what they reach.
coverage: build/coverage/build.ninja build/linesim/build.ninja $(TESTED) $(COVERED) ## Test: lines and branches that the quick tests reach, against the floors
	$(LOGGED) coverage ninja -C build/coverage
	$(LOGGED) linesim ninja -C build/linesim
	@find build/coverage -name '*.gcda' -delete
	@rm -f build/coverage/python*
	@chmod -R a+rwX build/coverage # each module, a user of its own, counts there
	$(LOGGED) coverage-unit $(MESON_TEST) -C build/coverage
	umask 0; OPENRTU_BUILD=build/coverage OPENRTU_TIMES=build/times/$@.json $(PYTHON) -m coverage run -m pytest $(BESIDE) $(QUICK) \
	  --ignore=tests/house --ignore=tests/packages --ignore=tests/plant --ignore=tests/shows \
	  $(CONFINED:%=--deselect tests/gateway/test_supervise.py::%)
	$(PYTHON) tests/run/covered.py

# pytest compiles a file of tests where it is first read, some CPU seconds for all. Workers begin together: each would do it.
.venv/collected: $(TESTED) $(shell find tests -name '*.py') pyproject.toml
	$(LOGGED) collected $(PYTHON) -m pytest --collect-only --quiet $(QUICK)
	@touch $@

# One area: all of it, or FILES='tests/…'.
FILES :=
AREA = $(PYTEST) $(or $(FILES),$(@:test-%=tests/%))

test-station: build $(TESTED) ## Test: the controlled station: IEC 104 and TLS
test-controlling: build $(TESTED) ## Test: the controlling station: outstations, the centre's collector
test-lines: build build/modbus-peers/npm.done $(TESTED) ## Test: the Modbus lines and their devices
test-gateway: build $(TESTED) ## Test: the gateway as a whole: reloads, kills, power cuts, rtuctl
test-config: build .asan $(TESTED) ## Test: the configuration, templates, lists of points
test-modules: build $(TESTED) ## Test: modules of others, the net between modules
test-logic: build $(TESTED) ## Test: Structured Text
test-snmp: build build/mibs/done build/exporter/done $(TESTED) ## Test: the SNMPv3 agent
test-iec61850: build $(TESTED) ## Test: the server of IEC 61850
test-goose: build $(TESTED) ## Test: GOOSE
test-position: build build/gpsd/done build/chronyd/done $(TESTED) ## Test: receivers and positions
test-web: build $(TESTED) ## Test: the gateway's page
test-tools: build $(TESTED) ## Test: openrtu's tools for devices
test-shows: build $(TESTED) ## Test: what make run-native shows, and says when it fails
test-plant: build $(TESTED) ## Test: the plant under virtual time
test-packages: build centre-page build/mibs/done $(WHEELING) $(PACKAGING) $(TESTED) ## Test: packages, containers, wheels
test-house: build fuzzers $(TESTED) ## Test: the tree itself, the fuzzers' seeds, what runs the tests
test-bench: build .compared $(TESTED) ## Test: what make bench measures with
test-pins: $(TESTED) ## Test: nuc980-pins
test-image: build/packages-cross.done build/packages-release.done $(TESTED) ## Test: the images' configuration and what makes them
test-netboot: build qemu uboot $(TESTED) ## Test: nuc980-netboot
test-twin: qemu uboot $(TESTED) ## Test: the emulated board alone
test-centre: build centre-page build/provider/npm.done build/axe/npm.done $(PACKAGING) build/packages-centre.done $(TESTED) ## Test: the control centre, its page in a browser
AREAS := $(filter-out linux,$(sort $(notdir $(patsubst %/,%,$(dir $(wildcard tests/*/test_*.py))))))
$(AREAS:%=test-%):
	$(AREA)

test-linux: WORKERS := 2 # a guest that starts fills a core
test-linux: linux image-debian build/swupdate/done build/curl/done lab qemu uboot build build/arm/build.ninja $(TESTED) ## Test: Linux on the emulated board
	$(LOGGED) arm ninja -C build/arm logic/logic-desk
	$(MAKE) image-debian SITE=tests/linux/site-tls
	$(MAKE) image-debian uboot BOARD=numaker
	$(AREA)

# A kernel and boots of its own that take as long as an area: the drivers change seldom.
test-debug-kernel: linux-debug image-debian qemu uboot build $(TESTED) ## Test: the drivers on a kernel that watches itself, half an hour
	$(PYTHON) -m pytest -m soak tests/linux/test_debug_kernel.py

# For the site of `make run`: its key opens the board.
test-offline: build qemu uboot $(TESTED) ## Test: the image of image-offline on the emulated board, an hour with its build
	@$(LAB).site build/site --updates
	$(MAKE) image-offline BUILDROOT_DIR='$(BUILDROOT_DIR)' SITE=build/site/field
	$(PYTHON) -m pytest -m soak -k offline tests/linux/test_image_offline.py tests/linux/test_update_root.py

test-sanitizers: build .asan $(TESTED) ## Test: the gateway's tests, its modules under AddressSanitizer and UBSan
	OPENRTU_BUILD=build/asan $(PYTEST) $(UNDER_SANITIZERS)

test-native: build .compared .asan fuzzers qemu uboot centre-page build/provider/npm.done build/axe/npm.done build/modbus-peers/npm.done $(WHEELING) $(PACKAGING) build/packages-centre.done build/gpsd/done build/chronyd/done build/mibs/done build/exporter/done $(TESTED) ## Test: all of pytest but Linux on the emulated board
	$(PYTEST) --ignore=tests/linux

test-user: ## Test: the README's two commands as a user without rights (takes root)
	tests/run/as-user.sh

test-changed: $(TESTED) ## Test: what a change can reach, and why (BASE=commit: since that one)
	$(PYTHON) tests/run/changed.py $(BASE)

# What several parts of `make test` need, built before them by one make; and what test-linux alone needs: tests/run/run.py.
.PHONY: .shared .linux-alone
.shared: build .compared qemu uboot centre-page build/provider/npm.done build/axe/npm.done build/modbus-peers/npm.done $(WHEELING) $(PACKAGING) build/packages-centre.done build/sysroot.ini \
  build/gpsd/done build/chronyd/done build/mibs/done $(TESTED)
.linux-alone: linux build/boards/numaker/u-boot/done build/swupdate/done build/curl/done $(SYSTEM_PARTS) build/root/gateway-tls.done

test: $(TESTED) $(LINTED) ## Test: all but soak, test-debug-kernel, test-offline (ONLY=)
	$(PYTHON) tests/run/run.py $(if $(ONLY),--only $(ONLY))

BUSY := 8
TIMES := 20

busy: $(VENV) ## Test: the shows and test-quick beside busy processes (BUSY=8, TIMES=20, TARGETS=)
	$(PYTHON) tests/run/busy.py --processes $(BUSY) --times $(TIMES) $(TARGETS)

plant: build $(VENV) ## Test: gateways under virtual time, with faults (SEEDS=20, HOURS=0.1, SEED=)
	@$(PYTHON) tests/plant/plant_run.py $(if $(SEEDS),--seeds $(SEEDS)) $(if $(HOURS),--hours $(HOURS)) $(if $(SEED),--seed $(SEED)) $(if $(WORLD),--world $(WORLD))

plant-faults: build $(VENV) $(TESTED) ## Test: whether the plant finds each fault of the past (FAULTS=)
	@$(PYTHON) tests/plant/plant_faults.py $(FAULTS)

ROOMS := ber goose gps iec104 iec61850 map modbus snmp
MUTANTS := 300

mutation: build $(TESTED) ## Test: which small faults, put into rooms of C, the tests notice (ROOMS=)
	$(PYTHON) tests/mutating/score.py $(ROOMS) --mutants $(MUTANTS)

soak: build qemu uboot linux linux-debug image-debian build/swupdate/done build/curl/done $(TESTED) ## Test: hours: 1000 kills of each module, 500 boots, 200 netboots, 2000 power cuts
	$(PYTHON) -m pytest -m soak
