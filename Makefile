# SPDX-License-Identifier: GPL-3.0-or-later
# The one front door. Every target brings what it needs, so `make run` and `make test` are enough on a fresh machine.

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
.PHONY: help setup build dtb qemu uboot linux linux-debug system unit asan cross fuzzers fuzz image checkout menuconfig linux-menuconfig savedefconfig sdk sbom legal-info check-image lint test-quick test-sanitizers test-native test-twin test-linux test soak lab run run-native twin bench clean netboot distclean

SRC     := package/openrtu/src
LINESIM := tests/linesim
BENCH   := tests/bench
PYTHON  := .venv/bin/python

PACKAGES := build/packages.done
VENV     := .venv/done
SYSROOT  := build/arm-sysroot/done

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-16s %s\n", $$1, $$2 }' Makefile

# ---- what is needed ------------------------------------------------------------------------------

setup: $(PACKAGES) $(VENV) ## bring what is missing: Debian packages, Python packages into .venv

build/%.done: scripts/%.txt scripts/setup-packages.sh
	scripts/setup-packages.sh $<
	mkdir -p $(@D) && touch $@

$(VENV): requirements.txt scripts/setup-python.sh | $(PACKAGES)
	scripts/setup-python.sh $(@D) $<
	touch $@

$(SYSROOT): scripts/setup-sysroot.sh | $(PACKAGES)
	scripts/setup-sysroot.sh $(@D)
	touch $@

# ---- C -------------------------------------------------------------------------------------------

MESON_TEST = meson test --print-errorlogs --timeout-multiplier 4

build: build/native/build.ninja build/linesim/build.ninja build/bench/build.ninja ## build all for this machine
	ninja -C build/native
	ninja -C build/linesim
	ninja -C build/bench

unit: build ## run the C unit tests
	$(MESON_TEST) -C build/native

asan: build/asan/build.ninja ## build with AddressSanitizer and UBSan, run the C unit tests
	ninja -C build/asan
	$(MESON_TEST) -C build/asan

cross: build/arm/build.ninja ## cross-compile for ARMv5, run the C unit tests under qemu-arm
	ninja -C build/arm
	$(MESON_TEST) -C build/arm

fuzzers: build/fuzz/build.ninja ## build the fuzzers (clang, libFuzzer, AddressSanitizer, UBSan)
	ninja -C build/fuzz fuzzers

FUZZ_SECONDS := 60

fuzz: fuzzers $(VENV) ## search with the fuzzers, each for FUZZ_SECONDS=60, and go on from there the next time
	$(PYTHON) tests/fuzzing.py --seconds $(FUZZ_SECONDS)

build/native/build.ninja: | $(PACKAGES)
	meson setup $(@D) $(SRC) -Dtests=enabled -Dtls=true

build/asan/build.ninja: | $(PACKAGES)
	meson setup $(@D) $(SRC) -Dtests=enabled -Dtls=true -Db_sanitize=address,undefined -Dc_args=-fno-sanitize-recover=all

# clang misses the fields that designated initialisers leave at zero, which is what they are for.
build/fuzz/build.ninja: | $(PACKAGES)
	CC=clang meson setup $(@D) $(SRC) -Dfuzz=true -Dtests=disabled -Db_lundef=false -Db_sanitize=address,undefined \
	  -Dc_args='-fno-sanitize-recover=all -Wno-missing-field-initializers'

build/arm/build.ninja: build/sysroot.ini
	meson setup $(@D) $(SRC) -Dtests=enabled -Dtls=true --cross-file $< --cross-file scripts/armel.ini

build/sysroot.ini: | $(SYSROOT)
	printf "[constants]\nsysroot = '%s'\n" "$(abspath $(dir $(SYSROOT)))" > $@

build/linesim/build.ninja: | $(PACKAGES)
	meson setup $(@D) $(LINESIM)

build/bench/build.ninja: | $(PACKAGES)
	meson setup $(@D) $(BENCH)

# ---- device tree ---------------------------------------------------------------------------------

DTS := dts/nuvoton/nuc980-gateway.dts
# of the board file, as SWITCHES="GATEWAY_PDMA=1 GATEWAY_RTC=1"; a build with switches has a folder of its own
SWITCHES :=
EMPTY :=
DTB := build/dtb/$(addsuffix /,$(subst $(EMPTY) $(EMPTY),_,$(strip $(SWITCHES))))nuc980-gateway.dtb

dtb: $(VENV) ## generate, compile and check the board's device tree (SWITCHES=...: its first lines)
	scripts/nuc980-pins generate
	scripts/build-dtb.sh $(DTS) $(DTB) $(SWITCHES)
	scripts/nuc980-pins check $(addprefix -D ,$(SWITCHES)) $(DTS) $(DTB)
	scripts/validate-dtb.sh $(DTB)

# ---- the twin ------------------------------------------------------------------------------------

QEMU_PARTS := scripts/build-qemu.sh scripts/patched-source.sh $(shell find board/nuc980/qemu patches/qemu -type f)

qemu: build/qemu/done ## build the emulated board: QEMU with the machine nuc980

build/qemu/done: $(QEMU_PARTS) build/qemu/debian.dsc | build/packages-twin.done
	scripts/build-qemu.sh build/qemu/debian $(@D)
	touch $@

UBOOT_PARTS := scripts/build-uboot.sh scripts/patched-source.sh $(shell find patches/uboot dts/nuvoton -type f)

uboot: build/u-boot/done ## build the board's U-Boot

build/u-boot/done: $(UBOOT_PARTS) build/u-boot/debian.dsc | build/packages-twin.done
	scripts/build-uboot.sh build/u-boot/debian $(@D)
	touch $@

# The one that was tried; with another one from the archive the patches apply, or the build says which does not.
LINUX_VERSION := 6.1.176-1
LINUX_FRAGMENTS := board/nuc980/linux/hardening.fragment
LINUX_PARTS := scripts/build-linux.sh scripts/patched-source.sh $(LINUX_FRAGMENTS) \
  $(wildcard patches/linux/6.1/*) $(shell find dts/bindings -type f)

linux: build/linux/done ## build the board's Linux: Debian's 6.1 with PREEMPT_RT and our port

build/linux/done: $(LINUX_PARTS) build/linux/debian.dsc | build/packages-twin.done
	scripts/build-linux.sh build/linux/debian $(@D) $(LINUX_FRAGMENTS)
	touch $@

build/linux/debian.dsc: scripts/debian-source.sh | build/packages-twin.done
	scripts/debian-source.sh linux=$(LINUX_VERSION) $(@D)/debian

linux-debug: build/linux-debug/done ## build a Linux that watches itself (locks, DMA, memory), for the tests

build/linux-debug/done: build/linux/done board/nuc980/linux/debug.fragment
	scripts/build-linux.sh build/linux/debian $(@D) board/nuc980/linux/debug.fragment
	touch $@

build/%/debian.dsc: scripts/debian-source.sh | build/packages-twin.done
	scripts/debian-source.sh $* $(@D)/debian

# ---- the image from Debian's packages ------------------------------------------------------------

# A build for a site has a folder of its own.
SYSTEM = build/system$(if $(SITE),-$(subst $(EMPTY) $(EMPTY),_,$(shell basename '$(OPENRTU_SITE)')))
# With OpenSSL only where the site's configuration asks for TLS.
FOR_SITE := $(or $(SITE),$(OPENRTU_SITE))
GATEWAY := $(or $(if $(FOR_SITE),$(shell scripts/image/rootfs.py gateway '$(FOR_SITE)')),gateway)
SYSTEM_PARTS := build/linux/done build/busybox/done build/chrony/done build/root/packages.done build/root/$(GATEWAY).done \
  build/dtb/nuc980-gateway.dtb

system: $(SYSTEM_PARTS) ## build the image for the board from Debian's packages (SITE=folder: with its settings)
	scripts/build-system.sh $(SYSTEM) $(GATEWAY) $(LINUX_FRAGMENTS)

build/busybox/done: scripts/build-busybox.sh board/nuc980/busybox.config build/busybox/debian.dsc | $(SYSROOT)
	scripts/build-busybox.sh build/busybox/debian $(@D)
	touch $@

build/chrony/done: scripts/build-chrony.sh build/chrony/debian.dsc | $(SYSROOT)
	scripts/build-chrony.sh build/chrony/debian $(@D)
	touch $@

build/root/packages.done: board/nuc980/system.toml scripts/debian-package.sh | build/packages-twin.done
	mkdir -p $(@D)
	packages=$$(scripts/image/rootfs.py packages) && ARCHITECTURE=armel scripts/debian-package.sh $(@D)/packages $$packages
	touch $@

build/root/gateway.done: build/arm-release/build.ninja
build/root/gateway-tls.done: build/arm-release-tls/build.ninja
build/root/gateway.done build/root/gateway-tls.done: $(shell find $(SRC) -type f)
	ninja -C $(patsubst build/root/gateway%.done,build/arm-release%,$@)
	rm -rf $(@:.done=)
	DESTDIR=$(CURDIR)/$(@:.done=) meson install -C $(patsubst build/root/gateway%.done,build/arm-release%,$@) \
	  --strip --no-rebuild --quiet
	touch $@

build/arm-release/build.ninja build/arm-release-tls/build.ninja: build/sysroot.ini
	meson setup $(@D) $(SRC) --prefix=/usr -Dtests=disabled -Dtls=$(if $(findstring -tls,$@),true,false) \
	  --cross-file $< --cross-file scripts/armel.ini

build/dtb/nuc980-gateway.dtb: $(wildcard dts/nuvoton/*) scripts/build-dtb.sh | $(PACKAGES)
	scripts/build-dtb.sh $(DTS) $@

# ---- the image -----------------------------------------------------------------------------------

IMAGES        := nuc980_gateway nuc980_netboot
IMAGE         ?= nuc980_gateway
BUILDROOT_DIR ?= build/buildroot
buildroot      = $(MAKE) -C $(BUILDROOT_DIR) O=$(CURDIR)/build/$(1) BR2_EXTERNAL=$(CURDIR)/br2-external
BUILDROOT      = $(call buildroot,$(IMAGE))
MAKEOVERRIDES :=# what was typed here means nothing to Buildroot
export BR2_DL_DIR     ?= $(CURDIR)/build/dl
export BR2_CCACHE_DIR ?= $(CURDIR)/build/ccache

ifdef SITE
export OPENRTU_SITE := $(shell realpath -e '$(SITE)/.' 2> /dev/null)
$(if $(OPENRTU_SITE),,$(error SITE=$(SITE) is no folder; docs/image.md says what belongs in it))
endif

image: $(IMAGES:%=build/%/images/manifest.json) ## build the images for the board (SITE=folder: with its settings)

checkout: $(BUILDROOT_DIR)/Makefile ## bring Buildroot (BUILDROOT_DIR=folder: use that one)

menuconfig: ## change an image's configuration (IMAGE=nuc980_netboot: of the other one)
savedefconfig: ## write what menuconfig changed back into configs/
linux-menuconfig: ## change the kernel's configuration; ends with the lines for a fragment
sdk: ## pack the cross toolchain and the libraries of the target
legal-info: ## collect licences and sources
sbom: ## write the image's bill of materials (CycloneDX)

menuconfig sdk legal-info: build/$(IMAGE)/.config
	$(BUILDROOT) $@

linux-menuconfig: build/$(IMAGE)/.config
	$(BUILDROOT) $@ linux-diff-config

savedefconfig: build/$(IMAGE)/.config
	$(BUILDROOT) $@ BR2_DEFCONFIG=$(CURDIR)/build/$(IMAGE)/saved
	{ sed '/^BR2_/,$$d' configs/$(IMAGE)_defconfig; cat build/$(IMAGE)/saved; } > build/$(IMAGE)/new
	cp build/$(IMAGE)/new configs/$(IMAGE)_defconfig

sbom: build/$(IMAGE)/.config
	$(BUILDROOT) --silent show-info > build/$(IMAGE)/show-info.json
	$(BUILDROOT_DIR)/utils/generate-cyclonedx --project-name openrtu --in-file build/$(IMAGE)/show-info.json \
	  --out-file build/$(IMAGE)/sbom.cdx.json 2> build/$(IMAGE)/sbom.log || { echo "sbom: $$(tail -n 1 \
	  build/$(IMAGE)/sbom.log); Buildroot fetches the list of SPDX licences for it, once" >&2; exit 2; }

check-image: $(VENV) ## check the configurations with Buildroot's own tools
	PYTHONPATH=scripts $(PYTHON) -m image.check $(BUILDROOT_DIR)

$(IMAGES:%=build/%/images/manifest.json): build/%/images/manifest.json: build/%/.config FORCE
	$(call buildroot,$*)

$(IMAGES:%=build/%/.config): build/%/.config: configs/%_defconfig $(BUILDROOT_DIR)/Makefile | build/packages-image.done
	$(call buildroot,$*) $*_defconfig

build/buildroot/Makefile: configs/kas.yml | $(VENV)
	KAS_WORK_DIR=build KAS_BUILD_DIR=build/kas .venv/bin/kas checkout --skip setup_environ --skip write_bbconfig $< \
	  || { scripts/no-buildroot.sh $<; exit 2; }
	touch $@

%/Makefile:
	@echo "BUILDROOT_DIR=$* is no Buildroot checkout" >&2; exit 2

FORCE:

# ---- tests ---------------------------------------------------------------------------------------

PROBES      = tests/twin/probes
PAYLOAD     = tests/netboot/payload
PROGRAMS    = tests/linux/programs
C_FILES     = $(shell find $(SRC) $(LINESIM) $(BENCH) $(PROBES) $(PAYLOAD) $(PROGRAMS) -name '*.[ch]')
# Once more with the modules built under AddressSanitizer and UBSan.
UNDER_SANITIZERS = tests/test_gateway.py tests/test_lines.py tests/test_event_journal.py $(wildcard tests/test_station_*.py)
SHELL_FILES = .ci/run scripts/nuc980-pins scripts/nuc980-netboot $(wildcard scripts/*.sh $(PROGRAMS)/*.sh board/*/*.sh package/*/S[0-9]* \
  board/*/*/etc/init.d/* board/*/*/usr/sbin/*) board/nuc980/skeleton/init board/nuc980/skeleton/usr/share/udhcpc/default.script

lint: $(VENV) ## check the sources: ruff, clang-format, cppcheck, shellcheck
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	clang-format --dry-run -Werror $(C_FILES)
	cppcheck --quiet -j 2 --enable=warning,performance,portability --error-exitcode=1 --inline-suppr \
	  -I $(SRC) $(SRC) $(LINESIM) $(BENCH) $(PROBES) $(PAYLOAD) $(PROGRAMS)
	shellcheck --external-sources $(SHELL_FILES)

test-quick: lint unit $(VENV) ## the tests of two minutes: lint, C unit tests, quick pytest
	$(PYTHON) -m pytest -n 4 --dist loadscope -m "not slow and not soak"

test-twin: qemu uboot $(VENV) ## the tests of the emulated board
	$(PYTHON) -m pytest tests/twin

PARTS := lint unit asan cross fuzzers test-sanitizers test-native test-linux

test: $(VENV) ## all tests, to the end; then what they cost, and which parts failed
	rm -rf build/times
	failed=; for part in $(PARTS); do $(MAKE) $$part || failed+=" $$part"; done; \
	$(PYTHON) tests/times.py build/times/*.json; \
	[ -z "$$failed" ] || { echo "make test: failed:$$failed" >&2; exit 1; }

# Many of these wait for a line, a timer or a guest: two at a time fill two cores. A file's tests share what they start.
PYTEST = OPENRTU_TIMES=build/times/$@.json $(PYTHON) -m pytest -n 2 --dist loadfile --max-worker-restart 0

test-sanitizers: build asan $(VENV) ## the gateway's tests with modules under AddressSanitizer and UBSan
	OPENRTU_BUILD=build/asan $(PYTEST) $(UNDER_SANITIZERS)

test-native: build asan fuzzers qemu uboot $(VENV) ## all pytest but those of Linux on the emulated board
	$(PYTEST) --ignore=tests/linux

test-linux: linux linux-debug system lab qemu uboot $(VENV) ## all tests of Linux on the emulated board
	scripts/build-dtb.sh $(DTS) build/dtb/GATEWAY_PDMA=1/nuc980-gateway.dtb GATEWAY_PDMA=1
	$(MAKE) system SITE=tests/linux/site-tls
	$(PYTEST) tests/linux

soak: build qemu uboot linux system $(VENV) ## the long tests: 1000 kills of each module, 500 boots, 200 netboots, 100 power cuts
	$(PYTHON) -m pytest -m soak

# ---- see it --------------------------------------------------------------------------------------

LAB := PYTHONPATH=scripts $(PYTHON) -m lab

# The system of `make run`, for a site of its own.
lab: $(VENV) ## build the image that `make run` shows
	$(LAB).site build/site
	$(MAKE) system SITE=build/site/lab

ifneq ($(origin IMAGE),command line)
run: build $(VENV) ## show the emulated board, from reset to the control room (KEEP=1: stay up; IMAGE=folder: boot that)
	$(LAB).build build/log qemu uboot linux lab
	$(LAB).board_show $(if $(KEEP),--keep)
else
run: $(VENV)
	$(LAB).build build/log qemu uboot
	$(LAB).image $(IMAGE)
endif

run-native: build $(VENV) ## show the gateway alone, on this machine (KEEP=1: stay up for your own master)
	$(LAB) $(if $(KEEP),--keep)

twin: qemu uboot $(VENV) ## show the emulated board: from reset to a file over TFTP, its pins, a wrong pin
	PYTHONPATH=scripts $(PYTHON) -m nuc980.twin

bench: build qemu uboot $(VENV) ## measure the gateway beside the report's method, its station beside c104's, its lines beside pymodbus', nuc980-pins beside dt-validate, TFTP beside tftpd-hpa (LIB60870=folder: its station beside lib60870 in C too)
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/bench.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/stations.py $(if $(LIB60870),--lib60870 '$(LIB60870)')
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/lines.py
	scripts/build-dtb.sh $(DTS) $(DTB)
	$(PYTHON) $(BENCH)/pins.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/tftp.py

# ---- a real board --------------------------------------------------------------------------------

ifeq ($(filter netboot,$(MAKECMDGOALS))$(PORT),netboot)
$(error netboot: PORT=/dev/ttyUSB0 or the like is missing: where the board's debug UART is)
endif
NETBOOTED = $(if $(filter command line,$(origin IMAGE)),build/$(IMAGE)/images,$(SYSTEM))

netboot: $(if $(filter command line,$(origin IMAGE)),,system) $(VENV) ## boot a board over its debug UART and Ethernet (PORT=, BOARD_IP=, SITE=; IMAGE=name: what make image built)
	scripts/nuc980-netboot boot --port $(PORT) $(if $(SITE),--site $(OPENRTU_SITE)) $(if $(BOARD_IP),--board-ip $(BOARD_IP)) \
	  --console $(NETBOOTED)/uImage $(NETBOOTED)/nuc980-gateway.dtb

# ---- away with it --------------------------------------------------------------------------------

clean: ## remove what was built
	rm -rf build

distclean: clean ## remove the Python environment as well
	rm -rf .venv .pytest_cache .ruff_cache
