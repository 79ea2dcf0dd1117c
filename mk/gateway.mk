# SPDX-License-Identifier: GPL-3.0-or-later
# The gateway in C: for this machine, as ARM code, under sanitizers, with other compilers, its fuzzers.

# Against hangs only: under qemu-arm on a busy host a test of 2 s has taken 120.
MESON_TEST = meson test --no-rebuild --print-errorlogs --timeout-multiplier 20

build: build/native/build.ninja build/linesim/build.ninja build/plant/build.ninja ## Build: the gateway for this machine, and what simulates its devices and its time
	$(LOGGED) native ninja -C build/native
	$(LOGGED) linesim ninja -C build/linesim
	$(LOGGED) plant ninja -C build/plant

.PHONY: .compared
.compared: build/bench/build.ninja
	$(LOGGED) bench ninja -C build/bench

keys: build $(CENTRE) ## Maintain: the schema and the tables of keys, after a change of the rules
	$(PYTHON) scripts/keys.py build/native

unit: build ## Test: the C unit tests
	$(LOGGED) unit $(MESON_TEST) -C build/native

asan: .asan ## Test: the C unit tests under AddressSanitizer and UBSan
	$(LOGGED) asan-unit $(MESON_TEST) -C build/asan

.PHONY: .asan
.asan: build/asan/build.ninja
	$(LOGGED) asan ninja -C build/asan

# What a program does there, it does here: the plots of all blocks are the same.
cross: build/arm/build.ninja $(TESTED) ## Test: the C unit tests and programs of logic, as ARMv5 code under qemu-arm
	$(LOGGED) arm ninja -C build/arm meson-test-prereq logic/logic-desk
	$(LOGGED) arm-unit $(MESON_TEST) -C build/arm
	$(LOGGED) arm-logic env OPENRTU_BUILD=build/arm \
	  OPENRTU_LOGIC_DESK='qemu-arm -cpu arm926 -L $(dir $(SYSROOT)) build/arm/logic/logic-desk' \
	  $(PYTHON) -m pytest -q tests/logic/test_logic_blocks.py -k each_plot

fuzzers: build/fuzz/build.ninja ## Test: build the fuzzers (clang, libFuzzer, AddressSanitizer, UBSan)
	$(LOGGED) fuzzers ninja -C build/fuzz fuzzers

FUZZ_SECONDS := 60

fuzz: fuzzers $(VENV) ## Test: search with the fuzzers for FUZZ_SECONDS=60 each; keeps what it learned
	$(PYTHON) tests/house/fuzzing.py --seconds $(FUZZ_SECONDS)

# A build that a former version of the tree has configured gets the options that came since.
BUILD_OPTIONS := $(SRC)/meson_options.txt
# A stranger's compiler may warn of what ours does not: what is installed, or packaged, is no place to stop for it.
SETUP = meson setup $(if $(wildcard $@),--reconfigure) $(@D) $(SRC)
STRICT = $(SETUP) -Dwerror=true

build/native/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES)
	$(LOGGED) $(notdir $(@D))-setup $(STRICT) -Dtests=enabled -Dtls=true -Dsnmp=true -Dweb=true -Dschema=true

# -O1 and the lines alone in the debug information: half of the time that the compiler takes, and the same checks.
build/asan/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES)
	$(LOGGED) $(notdir $(@D))-setup $(STRICT) -Dtests=enabled -Dtls=true -Dsnmp=true -Dweb=true -Db_sanitize=address,undefined \
	  -Doptimization=1 -Dc_args='-fno-sanitize-recover=all -g1'

# Not optimized: each line and branch is there as it was written.
build/coverage/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES) build/packages-coverage.done
	$(LOGGED) $(notdir $(@D))-setup $(STRICT) -Dtests=enabled -Dtls=true -Dsnmp=true -Dweb=true -Dschema=true -Db_coverage=true \
	  -Doptimization=0 -Dc_args=-g1

build/fuzz/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES) build/packages-fuzz.done
	$(LOGGED) $(notdir $(@D))-setup env CC=clang $(STRICT) -Dfuzz=true -Dtests=disabled -Dsnmp=true -Dweb=true -Db_lundef=false -Db_sanitize=address,undefined \
	  -Dc_args='-fno-sanitize-recover=all -g1'

build/arm/build.ninja: build/sysroot.ini $(BUILD_OPTIONS)
	$(LOGGED) $(notdir $(@D))-setup $(STRICT) -Dtests=enabled -Dtls=true --cross-file $< --cross-file scripts/armel.ini

compile: build/compiled-$(CC)/build.ninja ## Test: compile all of it with CC=clang-14 or another, with warnings as errors
	$(LOGGED) compiled-$(CC) ninja -C build/compiled-$(CC)

build/compiled-%/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES)
	$(LOGGED) $(notdir $(@D))-setup env CC=$* $(STRICT) -Dtests=enabled -Dtls=true -Dsnmp=true -Dweb=true -Dschema=true

# Without TLS, SNMP and the page, whose libraries would be more to build than all of the gateway.
musl: build/musl/build.ninja ## Test: the gateway linked with musl, and its C unit tests
	$(LOGGED) musl ninja -C build/musl
	$(LOGGED) musl-unit $(MESON_TEST) -C build/musl

MUSL_LIBRARIES := jansson libseccomp cmocka
MUSL_ROOT      := $(abspath build/musl-libraries/root)

build/musl/build.ninja: $(BUILD_OPTIONS) build/musl-libraries/done
	$(LOGGED) $(notdir $(@D))-setup env CC=musl-gcc PKG_CONFIG_LIBDIR=$(MUSL_ROOT)/lib/pkgconfig $(STRICT) -Dtests=enabled \
	  -Dc_args='-isystem $(MUSL_ROOT)/include' -Dc_link_args='-Wl,-rpath,$(MUSL_ROOT)/lib'

build/musl-libraries/done: scripts/build-musl.sh $(MUSL_LIBRARIES:%=build/musl-libraries/%.dsc) | build/packages-musl.done
	$(LOGGED) musl-libraries scripts/build-musl.sh $(@D) $(MUSL_LIBRARIES)
	@touch $@

build/musl-libraries/%.dsc: scripts/debian-source.sh | build/packages-musl.done
	@mkdir -p $(@D)
	$(LOGGED) $*-source scripts/debian-source.sh $* $(@D)/$*

build/sysroot.ini: | $(PACKAGES) $(SYSROOT)
	@printf "[constants]\nsysroot = '%s'\n" "$(abspath $(dir $(SYSROOT)))" > $@

build/linesim/build.ninja: | $(PACKAGES)
	$(LOGGED) $(notdir $(@D))-setup meson setup $(@D) $(LINESIM)

build/plant/build.ninja: | $(PACKAGES)
	$(LOGGED) $(notdir $(@D))-setup meson setup $(@D) $(PLANT)

build/bench/build.ninja: | $(PACKAGES) build/packages-tests.done
	$(LOGGED) $(notdir $(@D))-setup meson setup $(@D) $(BENCH)

house: build ## Maintain: the tree in figures: what is long, there twice, or for nobody
	$(PYTHON) scripts/house.py
