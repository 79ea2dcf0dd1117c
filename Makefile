# SPDX-License-Identifier: GPL-3.0-or-later
# The one front door. Every target brings what it needs, so `make run` and `make test` are enough on a fresh machine.

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory
# Containers set it to stay small. Here each of some thousand starts of Python would compile what it imports.
unexport PYTHONDONTWRITEBYTECODE
.PHONY: help setup tools build centre centre-page wheels site release install man codes deb containers dtb qemu uboot linux linux-debug image-debian update image-buildroot image-offline source unit compile asan cross musl fuzzers fuzz checkout menuconfig linux-menuconfig savedefconfig sdk newer sbom cves legal-info check-image lint test-quick test-station test-lines test-gateway test-bench test-pins test-image test-netboot test-twin test-centre test-linux test-debug-kernel test-offline test-sanitizers test-native test-user test-changed test busy soak lab run run-native twin bench bench-polls bench-map bench-pictures clean netboot distclean

SRC     := package/openrtu/src
LINESIM := tests/linesim
BENCH   := tests/bench
PYTHON  := .venv/bin/python
LOGGED  := @scripts/logged.sh

# Debian packages, and Python packages in .venv: each target brings the lists that it uses.
PACKAGES := build/packages.done
EMULATED := build/packages.done build/packages-boards.done build/packages-cross.done build/packages-twin.done
PACKAGE_LISTS := packages packages-boards packages-cross packages-fuzz packages-lint packages-man packages-tests
VENV     := .venv/python.done
BOARDS   := .venv/python-boards.done
CENTRE   := .venv/python-centre.done
IMAGING  := .venv/python-images.done
LINTED   := .venv/python-lint.done
TOOLS    := .venv/python-tools.done
WHEELING := .venv/python-wheels.done
TESTED   := .venv/python-tests.done
SYSROOT  := build/arm-sysroot/done

# A target's line ends with its group and what it does: `## Build: ...`.
HELP_GROUPS := See it,Build,A board,Test,Maintain

help: ## Maintain: show this list
	@awk -F ':.*## ' -v groups='$(HELP_GROUPS)' '/^[a-z-]+:.*## / { \
	  colon = index($$2, ": "); group = substr($$2, 1, colon - 1); \
	  lines[group] = lines[group] sprintf("  make %-17s %s\n", $$1, substr($$2, colon + 2)) \
	} END { \
	  n = split(groups, order, ","); \
	  for (i = 1; i <= n; i++) printf("%s%s\n%s", (i > 1 ? "\n" : ""), order[i], lines[order[i]]) \
	}' Makefile

# ---- what is needed ------------------------------------------------------------------------------

setup: LISTS := $(PACKAGE_LISTS)
setup: $(PACKAGE_LISTS:%=build/%.done) $(TESTED) $(LINTED) ## Maintain: bring what most tests need: Debian packages, Python packages into .venv

tools: $(BOARDS) $(CENTRE) $(TOOLS) ## Build: what the tools of scripts/ import, into .venv

# LISTS names those that a goal needs besides: who is not root gets one command for all of them.
build/%.done: scripts/%.txt scripts/setup-packages.sh
	@scripts/setup-packages.sh $< $(LISTS:%=scripts/%.txt)
	@mkdir -p $(@D) && touch $@

# The first one makes .venv anew, so the others come again behind it.
$(VENV): scripts/python.txt requirements.txt scripts/setup-python.sh | $(PACKAGES)
	@scripts/setup-python.sh $<
	@touch $@

.venv/%.done: scripts/%.txt $(VENV)
	@scripts/setup-python.sh $<
	@touch $@

$(BOARDS): | build/packages-boards.done
$(LINTED): | build/packages-lint.done
$(TESTED): $(BOARDS) $(CENTRE) $(IMAGING) $(TOOLS) | build/packages-tests.done

$(SYSROOT): scripts/setup-sysroot.sh | build/packages-cross.done
	$(LOGGED) arm-sysroot scripts/setup-sysroot.sh $(@D)
	@touch $@

# ---- C -------------------------------------------------------------------------------------------

# Against hangs only: under qemu-arm on a busy host a test of 2 s has taken 120.
MESON_TEST = meson test --no-rebuild --print-errorlogs --timeout-multiplier 20

build: build/native/build.ninja build/linesim/build.ninja ## Build: the gateway for this machine, and the simulated devices
	$(LOGGED) native ninja -C build/native
	$(LOGGED) linesim ninja -C build/linesim

.PHONY: .compared
.compared: build/bench/build.ninja
	$(LOGGED) bench ninja -C build/bench

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
	  $(PYTHON) -m pytest -q tests/test_logic_blocks.py -k each_plot

fuzzers: build/fuzz/build.ninja ## Test: build the fuzzers (clang, libFuzzer, AddressSanitizer, UBSan)
	$(LOGGED) fuzzers ninja -C build/fuzz fuzzers

FUZZ_SECONDS := 60

fuzz: fuzzers $(VENV) ## Test: search with the fuzzers for FUZZ_SECONDS=60 each; keeps what it learned
	$(PYTHON) tests/fuzzing.py --seconds $(FUZZ_SECONDS)

# A build that a former version of the tree has configured gets the options that came since.
BUILD_OPTIONS := $(SRC)/meson_options.txt
# A stranger's compiler may warn of what ours does not: what is installed, or packaged, is no place to stop for it.
SETUP = meson setup $(if $(wildcard $@),--reconfigure) $(@D) $(SRC)
STRICT = $(SETUP) -Dwerror=true

build/native/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES)
	$(LOGGED) $(notdir $(@D))-setup $(STRICT) -Dtests=enabled -Dtls=true -Dsnmp=true -Dweb=true

# -O1 and the lines alone in the debug information: half of the time that the compiler takes, and the same checks.
build/asan/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES)
	$(LOGGED) $(notdir $(@D))-setup $(STRICT) -Dtests=enabled -Dtls=true -Dsnmp=true -Dweb=true -Db_sanitize=address,undefined \
	  -Doptimization=1 -Dc_args='-fno-sanitize-recover=all -g1'

build/fuzz/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES) build/packages-fuzz.done
	$(LOGGED) $(notdir $(@D))-setup env CC=clang $(STRICT) -Dfuzz=true -Dtests=disabled -Dsnmp=true -Dweb=true -Db_lundef=false -Db_sanitize=address,undefined \
	  -Dc_args='-fno-sanitize-recover=all -g1'

build/arm/build.ninja: build/sysroot.ini $(BUILD_OPTIONS)
	$(LOGGED) $(notdir $(@D))-setup $(STRICT) -Dtests=enabled -Dtls=true --cross-file $< --cross-file scripts/armel.ini

compile: build/compiled-$(CC)/build.ninja ## Test: compile all of it with CC=clang-14 or another, with warnings as errors
	$(LOGGED) compiled-$(CC) ninja -C build/compiled-$(CC)

build/compiled-%/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES)
	$(LOGGED) $(notdir $(@D))-setup env CC=$* $(STRICT) -Dtests=enabled -Dtls=true -Dsnmp=true -Dweb=true

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

build/bench/build.ninja: | $(PACKAGES) build/packages-tests.done
	$(LOGGED) $(notdir $(@D))-setup meson setup $(@D) $(BENCH)

# ---- the control centre's page ---------------------------------------------------------------------

PAGE       := build/centre/page
PAGE_FILES := $(shell find centre/page -type f)

codes: $(VENV) ## Maintain: what has its numbers from C, after a change of them
	$(PYTHON) scripts/codes.py

centre-page: $(PAGE)/done ## Build: the control centre's page

$(PAGE)/done: build/centre/npm.done $(PAGE_FILES)
	@rm -rf $(@D)
	$(LOGGED) centre-page node centre/page/build.mjs build/centre/node_modules $(@D)
	@touch $@

build/centre/npm.done: centre/page/package.json centre/page/package-lock.json
build/provider/npm.done: tests/centre/provider/package.json tests/centre/provider/package-lock.json
build/axe/npm.done: tests/centre/axe/package.json tests/centre/axe/package-lock.json
build/centre/npm.done build/provider/npm.done build/axe/npm.done:
	@command -v npm > /dev/null || scripts/setup-packages.sh scripts/packages-npm.txt
	@mkdir -p $(@D) && cp $^ $(@D)
	$(LOGGED) npm-$(notdir $(@D)) npm --prefix $(@D) ci --ignore-scripts --no-audit --no-fund
	@touch $@

# ---- the tools -------------------------------------------------------------------------------------

WHEELS := build/wheels
# setuptools would take what an earlier build has left.
LEFT := build/python package/openrtu/python/build

wheels: centre-page $(WHEELING) ## Build: openrtu-tools and the modules' library openrtu, for pip, in build/wheels
	rm -rf $(WHEELS) $(LEFT)
	$(LOGGED) wheels env SOURCE_DATE_EPOCH=$$(scripts/source-date.sh) $(PYTHON) -m pip wheel --disable-pip-version-check --no-build-isolation \
	  --no-deps --wheel-dir $(WHEELS) . ./package/openrtu/python
	rm -rf $(LEFT)

# ---- the pages as a site -------------------------------------------------------------------------

SITE_VENV := build/pages/venv

site: $(SITE_VENV)/done ## Build: the pages as a site to search, also without network
	scripts/site-source.py build/pages/source
	$(LOGGED) site env NO_MKDOCS_2_WARNING=1 $(SITE_VENV)/bin/mkdocs build --strict

# Of its own: what MkDocs needs and what the tools need do not bind each other.
$(SITE_VENV)/done: requirements-site.txt | build/packages-site.done
	@rm -rf $(@D) && /usr/bin/python3 -m venv $(@D)
	$(LOGGED) site-python $(@D)/bin/pip install --disable-pip-version-check --requirement $<
	@touch $@

# ---- a release ---------------------------------------------------------------------------------------

PARTS ?=

release: build/packages-release.done ## Build: what a release publishes, in build/release (PARTS=)
	rm -rf build/release
	PARTS='$(PARTS)' scripts/release-files.sh --make build/release build

# ---- on a Linux machine --------------------------------------------------------------------------

PREFIX  := /usr/local
DESTDIR :=
# Each prefix has a build of its own: rtud knows where its modules are.
INSTALLED = build/installed$(subst /,_,$(PREFIX))
MAN = build/man

$(INSTALLED)/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES) build/packages-man.done
	$(LOGGED) $(notdir $(@D))-setup $(SETUP) --prefix=$(PREFIX) --sysconfdir=/etc -Dtests=disabled -Dtls=true -Dsnmp=true -Dweb=true -Dman=true \
	  -Dsystemd=true -Ddesk=true

install: $(INSTALLED)/build.ninja ## Build: install the gateway on this machine (PREFIX=/usr/local, DESTDIR=)
	$(LOGGED) installed ninja -C $(INSTALLED)
	meson install -C $(INSTALLED) --no-rebuild $(if $(DESTDIR),--destdir "$$(realpath -m '$(DESTDIR)')")
	[ -e '$(DESTDIR)/etc/openrtu/gateway.json' ] || \
	  install -D -m 644 $(SRC)/systemd/gateway.json '$(DESTDIR)/etc/openrtu/gateway.json'

man: $(INSTALLED)/build.ninja $(BOARDS) $(CENTRE) ## Build: the man pages, of the tools too
	$(LOGGED) installed ninja -C $(INSTALLED)
	mkdir -p $(MAN)
	cp $(INSTALLED)/man/*.[18] $(MAN)
	$(SRC)/man/page.py scripts/nuc980-pins 1 'check the device tree of a NUC980 board' $(MAN)/nuc980-pins.1
	$(SRC)/man/page.py scripts/nuc980-netboot 1 'boot and flash a NUC980 board' $(MAN)/nuc980-netboot.1
	$(SRC)/man/page.py scripts/openrtu 1 "OpenRTU's tools for engineers" $(MAN)/openrtu.1

# as "amd64 arm64 armhf"; without it, this machine's
DEB_ARCHS :=

# What the tools import and Debian 12 does not have, or in a version that is too old.
VENDORED := build/deb-vendored

$(VENDORED)/done: requirements.txt $(VENV)
	@rm -rf $(@D)
	$(LOGGED) $(notdir $(@D)) $(PYTHON) -m pip install --disable-pip-version-check --no-deps --no-compile --target $(@D) \
	  --constraint $< paho-mqtt pyfdt tftpy
	@touch $@

# What the Debian packages are made with, and of.
PACKAGING := build/packages-man.done build/packages-deb.done build/packages-release.done wheels $(VENDORED)/done

deb: $(PACKAGES) $(PACKAGING) ## Build: the Debian packages, in build/deb (DEB_ARCHS="amd64 arm64 armhf")
	scripts/build-deb.sh build/deb $(DEB_ARCHS)

containers: deb build/linesim/build.ninja ## Build: images for containers and a compose.yaml, in build/containers
	$(LOGGED) linesim ninja -C build/linesim
	$(LOGGED) containers scripts/build-containers.sh build/containers build/deb

# ---- device tree ---------------------------------------------------------------------------------

# Of board/nuc980/boards: docs/your-board.md. U-Boot, and the image from Debian's packages, have a folder for each other board.
BOARD := gateway
OF_BOARD := $(if $(filter-out gateway,$(BOARD)),boards/$(BOARD)/)
DTS := dts/nuvoton/nuc980-$(BOARD).dts
# of the board file, as SWITCHES="GATEWAY_PDMA=1 GATEWAY_RTC=1"; a build with switches has a folder of its own
SWITCHES :=
EMPTY :=
DTB := build/dtb/$(addsuffix /,$(subst $(EMPTY) $(EMPTY),_,$(strip $(SWITCHES))))nuc980-$(BOARD).dtb

dtb: $(BOARDS) ## Build: the board's device tree: generate, compile, check (BOARD=, SWITCHES=)
	scripts/nuc980-pins generate
	scripts/build-dtb.sh $(DTS) $(DTB) $(SWITCHES)
	scripts/nuc980-pins check --board $(BOARD) $(addprefix -D ,$(SWITCHES)) $(DTS) $(DTB)
	scripts/validate-dtb.sh $(DTB)

# ---- the twin ------------------------------------------------------------------------------------

# Make sees a part that is new, not one that is gone, such as a patch: each build notes those that it had.
gone = $(if $(filter-out $(2),$(file <build/$(1)/parts)),FORCE)

QEMU_PARTS := scripts/build-qemu.sh scripts/patched-source.sh $(wildcard patches/qemu/*.patch) \
  $(shell find board/nuc980/qemu -type f -not -name '.*')

qemu: build/qemu/done ## Build: the emulated board: QEMU with the machine nuc980

build/qemu/done: $(QEMU_PARTS) $(call gone,qemu,$(QEMU_PARTS)) build/qemu/debian.dsc | $(EMULATED)
	$(LOGGED) qemu scripts/build-qemu.sh build/qemu/debian $(@D)
	@echo $(QEMU_PARTS) > $(@D)/parts
	@touch $@

UBOOT_PARTS := scripts/build-uboot.sh scripts/patched-source.sh $(wildcard patches/uboot/*.patch dts/nuvoton/*.dts*)

uboot: build/$(OF_BOARD)u-boot/done ## Build: a board's U-Boot (BOARD=)

build/u-boot/done: $(UBOOT_PARTS) $(call gone,u-boot,$(UBOOT_PARTS)) build/u-boot/debian.dsc | $(EMULATED)
	$(LOGGED) u-boot env NUC980_BOARD=gateway scripts/build-uboot.sh build/u-boot/debian $(@D)
	@echo $(UBOOT_PARTS) > $(@D)/parts
	@touch $@

build/boards/%/u-boot/done: build/u-boot/done
	$(LOGGED) u-boot-$* env NUC980_BOARD=$* scripts/build-uboot.sh build/u-boot/debian $(@D)
	@touch $@

# The one that was tried; with another one from the archive the patches apply, or the build says which does not.
LINUX_VERSION := 6.1.176-1
LINUX_FRAGMENTS := board/nuc980/linux/hardening.fragment
LINUX_PARTS := scripts/build-linux.sh scripts/patched-source.sh $(LINUX_FRAGMENTS) \
  $(wildcard patches/linux/6.1/*.patch) $(shell find dts/bindings -type f -not -name '.*')

linux: build/linux/done ## Build: the board's Linux: Debian's 6.1 with PREEMPT_RT and our port

# Its source alone, for make image-offline, which compiles it otherwise.
build/linux/source.inputs: $(LINUX_PARTS) $(call gone,linux,$(LINUX_PARTS)) build/linux/debian.dsc
	$(LOGGED) linux-patches scripts/build-linux.sh build/linux/debian
	@echo $(LINUX_PARTS) > $(@D)/parts
	@touch $@

build/linux/done: $(LINUX_PARTS) build/linux/source.inputs | $(EMULATED)
	$(LOGGED) linux scripts/build-linux.sh build/linux/debian $(@D) $(LINUX_FRAGMENTS)
	@touch $@

build/linux/debian.dsc: scripts/debian-source.sh | $(EMULATED)
	$(LOGGED) linux-source scripts/debian-source.sh linux=$(LINUX_VERSION) $(@D)/debian

linux-debug: build/linux-debug/done ## Build: a Linux that watches itself (locks, DMA, memory), for the tests

build/linux-debug/done: build/linux/done board/nuc980/linux/debug.fragment
	$(LOGGED) linux-debug scripts/build-linux.sh build/linux/debian $(@D) board/nuc980/linux/debug.fragment
	@touch $@

# Its recordings of receivers and what it makes of them, and its program, which nobody has to install.
build/gpsd/done: build/gpsd/debian.dsc scripts/debian-package.sh | $(EMULATED)
	$(LOGGED) gpsd scripts/debian-package.sh $(@D)/packages gpsd libbluetooth3 libdbus-1-3 libusb-1.0-0
	@touch $@

# What weighs a receiver's time; installed it would be a service, and take the place of the one that is there.
build/chronyd/done: scripts/debian-package.sh | $(EMULATED)
	$(LOGGED) chronyd scripts/debian-package.sh $(@D) chrony libcap2 libseccomp2
	@touch $@

# MIBs that ours refers to: Debian has the texts of the IETF's in this package of its main archive.
build/mibs/done: scripts/debian-package.sh | $(EMULATED)
	$(LOGGED) mibs scripts/debian-package.sh $(@D) erlang-snmp
	@touch $@

# What graphs a station that speaks SNMP; installed it would be a service.
build/exporter/done: scripts/debian-package.sh | $(EMULATED)
	$(LOGGED) exporter scripts/debian-package.sh $(@D) prometheus-snmp-exporter
	@touch $@

build/%/debian.dsc: scripts/debian-source.sh | $(EMULATED)
	$(LOGGED) $*-source scripts/debian-source.sh $* $(@D)/debian

# ---- the image from Debian's packages ------------------------------------------------------------

# A build for a site has a folder of its own.
SYSTEM = build/$(OF_BOARD)system$(if $(SITE),-$(subst $(EMPTY) $(EMPTY),_,$(shell basename '$(SITE_SETTINGS)')))
# With OpenSSL only where the site's configuration asks for TLS.
FOR_SITE := $(or $(SITE),$(SITE_SETTINGS))
GATEWAY := $(or $(if $(FOR_SITE),$(shell PYTHONPATH=scripts python3 -m image.rootfs gateway '$(FOR_SITE)' 2> /dev/null)),gateway)
SYSTEM_PARTS := build/linux/done build/busybox/done build/chrony/done build/root/packages.done build/root/$(GATEWAY).done \
  build/dtb/nuc980-$(BOARD).dtb

# A site with certificates takes updates.
SYSTEM_PARTS += $(if $(FOR_SITE),$(if $(wildcard $(FOR_SITE)/update.pem),build/swupdate/done))
SYSTEM_PARTS += $(if $(FOR_SITE),$(if $(wildcard $(FOR_SITE)/update-server),build/curl/done))

image-debian: $(SYSTEM_PARTS) ## Build: a board's image from Debian's packages (SITE=folder: its settings; BOARD=)
	$(LOGGED) $(notdir $(SYSTEM)) scripts/build-system.sh $(SYSTEM) $(GATEWAY) $(LINUX_FRAGMENTS)

# Of image-debian, unless IMAGE= was typed: what goes onto a board.
IMAGE_TYPED   := $(filter command,$(origin IMAGE))
IMAGE_DEBIAN  := $(if $(IMAGE_TYPED),,image-debian)
IMAGE_FOLDER   = $(if $(IMAGE_TYPED),build/$(IMAGE)/images,$(SYSTEM))

update: $(if $(and $(SITE),$(KEY),$(CERTIFICATE)),$(IMAGE_DEBIAN) $(BOARDS)) ## Build: a signed update of that image, or IMAGE= (SITE= KEY= CERTIFICATE=)
ifeq ($(and $(SITE),$(KEY),$(CERTIFICATE)),)
	@echo "make update SITE=folder KEY=file CERTIFICATE=file: who gets it, and who signs it (docs/update.md)" >&2; exit 2
endif
	@mkdir -p $(dir $(SYSTEM))
	PYTHONPATH=scripts $(PYTHON) -m image.update $(IMAGE_FOLDER) --board nuc980-$(BOARD) --site '$(notdir $(SITE_SETTINGS))' \
	  --key '$(KEY)' --certificate '$(CERTIFICATE)' --out $(SYSTEM).swu

build/busybox/done: scripts/build-busybox.sh board/nuc980/busybox.config build/busybox/debian.dsc | $(SYSROOT)
	$(LOGGED) busybox scripts/build-busybox.sh build/busybox/debian $(@D)
	@touch $@

build/swupdate/done: scripts/build-swupdate.sh board/nuc980/swupdate.config build/swupdate/debian.dsc | $(SYSROOT)
	$(LOGGED) swupdate scripts/build-swupdate.sh build/swupdate/debian $(@D)
	@touch $@

build/curl/done: scripts/build-curl.sh build/curl/debian.dsc | $(SYSROOT)
	$(LOGGED) curl scripts/build-curl.sh build/curl/debian $(@D)
	@touch $@

# Into the sysroot, so once more when that is another.
build/net-snmp/done: scripts/build-net-snmp.sh build/net-snmp/debian.dsc $(SYSROOT)
	$(LOGGED) net-snmp scripts/build-net-snmp.sh build/net-snmp/debian $(@D)
	@touch $@

build/net-snmp-agent/done: build/net-snmp/done
	$(LOGGED) net-snmp-agent scripts/build-net-snmp.sh build/net-snmp/debian $(@D) agent
	@touch $@

build/libmicrohttpd/done: scripts/build-libmicrohttpd.sh build/libmicrohttpd/debian.dsc $(SYSROOT)
	$(LOGGED) libmicrohttpd scripts/build-libmicrohttpd.sh build/libmicrohttpd/debian $(@D)
	@touch $@

build/chrony/done: scripts/build-chrony.sh build/chrony/debian.dsc | $(SYSROOT)
	$(LOGGED) chrony scripts/build-chrony.sh build/chrony/debian $(@D)
	@touch $@

build/root/packages.done: board/nuc980/system.toml scripts/debian-package.sh | $(EMULATED)
	@mkdir -p $(@D)
	@packages=$$(PYTHONPATH=scripts python3 -m image.rootfs packages) && \
	  scripts/logged.sh root-packages env ARCHITECTURE=armel scripts/debian-package.sh $(@D)/packages $$packages
	@touch $@

build/root/gateway.done: build/arm-release/build.ninja
build/root/gateway-tls.done: build/arm-release-tls/build.ninja build/net-snmp/done build/libmicrohttpd/done
build/root/gateway.done build/root/gateway-tls.done: $(shell find $(SRC) -type f)
	$(LOGGED) $(notdir $(@:.done=)) ninja -C $(patsubst build/root/gateway%.done,build/arm-release%,$@)
	@rm -rf $(@:.done=)
	$(LOGGED) $(notdir $(@:.done=))-install env DESTDIR=$(CURDIR)/$(@:.done=) \
	  meson install -C $(patsubst build/root/gateway%.done,build/arm-release%,$@) --strip --no-rebuild --quiet
	@touch $@

build/arm-release-tls/build.ninja: | build/net-snmp/done build/libmicrohttpd/done
build/arm-release/build.ninja build/arm-release-tls/build.ninja: build/sysroot.ini $(BUILD_OPTIONS)
	$(LOGGED) $(notdir $(@D))-setup $(SETUP) --prefix=/usr -Dtests=disabled -Dcentre=false -Dlibrary=false \
	  $(foreach option,tls snmp web,-D$(option)=$(if $(findstring -tls,$@),true,false)) \
	  --cross-file $< --cross-file scripts/armel.ini

build/dtb/nuc980-%.dtb: $(wildcard dts/nuvoton/*) scripts/build-dtb.sh | build/packages-boards.done
	@scripts/build-dtb.sh dts/nuvoton/nuc980-$*.dts $@

# ---- the image -----------------------------------------------------------------------------------

IMAGE         ?= nuc980_gateway
IMAGES        := $(if $(IMAGE_TYPED),$(IMAGE),nuc980_gateway nuc980_netboot)
BUILDROOT_DIR ?= build/buildroot
buildroot      = $(MAKE) -C $(BUILDROOT_DIR) O=$(CURDIR)/build/$(1) BR2_EXTERNAL=$(CURDIR)/br2-external
BUILDROOT      = $(call buildroot,$(IMAGE))
MAKEOVERRIDES :=# what was typed here means nothing to Buildroot
export BR2_DL_DIR     ?= $(CURDIR)/build/dl
export BR2_CCACHE_DIR ?= $(CURDIR)/build/ccache

# Buildroot builds a tar where the machine's is too old, and its configure refuses root unless told that this is meant.
ifeq ($(shell id -u),0)
export FORCE_UNSAFE_CONFIGURE := 1
endif

ifdef SITE
export SITE_SETTINGS := $(shell realpath -e '$(SITE)/.' 2> /dev/null)
endif
export NUC980_BOARD := $(BOARD)

image-buildroot: $(IMAGES:%=build/%/images/manifest.json) ## Build: a board's images with Buildroot (SITE=folder, IMAGE=, BOARD=)

# The same from Debian's sources and compiler, without what Buildroot downloads: configs/offline.toml.
OFFLINE        = PYTHONPATH=scripts python3 -m image.offline
OFFLINE_IMAGES := nuc980_gateway_lts-offline nuc980_uboot-offline
OFFLINE_WANTED = $(filter %-offline,$(IMAGES))

image-offline: $(OFFLINE_IMAGES:%=build/%/images/manifest.json) ## Build: that of Linux 6.1, from Debian's sources alone (BUILDROOT_DIR=, SITE=)

# Everything that one build needs beside this tree and the machine's packages, for a machine without network.
source: $(if $(OFFLINE_WANTED),build/offline/overrides.mk $(BUILDROOT_DIR)/Makefile,$(IMAGES:%=build/%/.config)) ## Build: all sources of IMAGES= in build/source, for a build without network
	rm -rf build/source
	mkdir -p build/source/{build,dl}
	rsync --archive --exclude=.git $(BUILDROOT_DIR)/ build/source/buildroot
ifeq ($(OFFLINE_WANTED),)
	$(foreach image,$(IMAGES),BR2_DL_DIR=$(CURDIR)/build/source/dl $(call buildroot,$(image)) source &&) true
else
	for name in $$($(OFFLINE) targets); do mkdir -p build/source/$${name%/*}; cp --archive $${name%/*}/debian{,.dsc} build/source/$${name%/*}; done
endif

# The names of before.
.PHONY: system image
system: image-debian
image: image-buildroot

checkout: $(BUILDROOT_DIR)/Makefile ## Build: bring Buildroot (BUILDROOT_DIR=folder: use that one)

menuconfig: ## Maintain: change a Buildroot image's configuration (IMAGE=nuc980_netboot)
savedefconfig: ## Maintain: write what menuconfig changed back into configs/
linux-menuconfig: ## Maintain: change that image's kernel; ends with the lines for a fragment
sdk: ## Maintain: pack the cross toolchain and the target's libraries
legal-info: ## Maintain: collect licences and sources
sbom: ## Maintain: write the image's bill of materials (CycloneDX)
cves: ## Maintain: the known vulnerabilities of an image (IMAGE=, NVD=folder of CVEs at hand)

menuconfig sdk legal-info: build/$(IMAGE)/.config
	$(BUILDROOT) $@

linux-menuconfig: build/$(IMAGE)/.config
	$(BUILDROOT) $@ linux-diff-config

savedefconfig: build/$(IMAGE)/.config
	$(BUILDROOT) $@ BR2_DEFCONFIG=$(CURDIR)/build/$(IMAGE)/saved
	{ sed '/^BR2_/,$$d' configs/$(IMAGE)_defconfig; cat build/$(IMAGE)/saved; } > build/$(IMAGE)/new
	cp build/$(IMAGE)/new configs/$(IMAGE)_defconfig

newer: $(IMAGING) ## Maintain: newer releases of Linux and Buildroot (WRITE=1: move to them)
	@PYTHONPATH=scripts $(PYTHON) -m image.newer $(if $(WRITE),--write) || [ $$? = 1 ]

# The list of SPDX licences, which Buildroot would fetch.
LICENCES := $(BR2_DL_DIR)/cyclonedx/spdx-1.6.schema.json

$(LICENCES): $(IMAGING)
	@install -D -m 644 .venv/lib/python3*/site-packages/cyclonedx/schema/_res/spdx.SNAPSHOT.schema.json $@

sbom: build/$(IMAGE)/.config $(LICENCES)
	$(BUILDROOT) --silent show-info > build/$(IMAGE)/show-info.json
	$(if $(filter %-offline,$(IMAGE)),$(OFFLINE) describe build/$(IMAGE)/show-info.json)
	$(BUILDROOT_DIR)/utils/generate-cyclonedx --project-name $(IMAGE) --project-version $(file < $(SRC)/VERSION) \
	  --in-file build/$(IMAGE)/show-info.json --out-file build/$(IMAGE)/sbom.cdx.json 2> build/$(IMAGE)/sbom.log || { \
	  echo "sbom: $$(tail -n 1 build/$(IMAGE)/sbom.log)" >&2; exit 2; }
	PYTHONPATH=scripts $(PYTHON) -m image.sbom build/$(IMAGE)/sbom.cdx.json --packages build/$(IMAGE)/show-info.json \
	  --buildroot $(BUILDROOT_DIR) --target build/$(IMAGE)/target

cves: sbom
	@PYTHONPATH=scripts $(PYTHON) -m image.cves $(BUILDROOT_DIR) build/$(IMAGE)/sbom.cdx.json \
	  $(if $(NVD),'$(NVD)',$(BR2_DL_DIR)/buildroot-nvd --fetch) || [ $$? = 1 ]
	$(if $(filter %-offline,$(IMAGE)),@echo 'What Debian mended within a release is open above: docs/security.md')

check-image: $(IMAGING) ## Test: the Buildroot configurations, with Buildroot's own tools
	PYTHONPATH=scripts $(PYTHON) -m image.check $(BUILDROOT_DIR)

$(patsubst %,build/%/images/manifest.json,$(sort $(IMAGES) $(OFFLINE_IMAGES))): build/%/images/manifest.json: build/%/.config FORCE # +: with -j, several packages at a time
	+$(LOGGED) $* env CCACHE_DIR=$(BR2_CCACHE_DIR) $(call buildroot,$*)

$(patsubst %,build/%/.config,$(filter-out %-development %-offline,$(IMAGES))): build/%/.config: configs/%_defconfig $(BUILDROOT_DIR)/Makefile | build/packages-image.done
	$(call buildroot,$*) $*_defconfig

# What development needs besides. Never the image of a station: its name says so wherever it is shown.
build/%-development/.config: configs/%_defconfig configs/parts/development.config $(BUILDROOT_DIR)/Makefile | build/packages-image.done
	@mkdir -p $(@D)
	cat $(wordlist 1,2,$^) > $(@D)/$*-development_defconfig
	$(call buildroot,$*-development) BR2_DEFCONFIG=$(CURDIR)/$(@D)/$*-development_defconfig defconfig

# Buildroot has no word for a program that the machine has: offline.py marks the package as built.
build/%-offline/.config: configs/%_defconfig configs/parts/offline.config $(BUILDROOT_DIR)/Makefile build/offline/overrides.mk build/offline/toolchain/done \
  | $(EMULATED) build/packages-image.done build/packages-offline.done
	@mkdir -p $(@D)
	cat $(filter configs/%,$^) > $(@D)/$*-offline_defconfig
	$(call buildroot,$*-offline) BR2_DEFCONFIG=$(CURDIR)/$(@D)/$*-offline_defconfig defconfig
	$(call buildroot,$*-offline) --silent show-info > $(@D)/show-info.json
	$(OFFLINE) seed $(@D) $(@D)/show-info.json || { rm $@; exit 2; }

build/nuc980_gateway_lts-offline/.config: configs/parts/offline-system.config

build/offline/overrides.mk: configs/offline.toml scripts/image/offline.py
	$(MAKE) $$($(OFFLINE) targets)
	$(OFFLINE) overrides $@

build/offline/toolchain/done: scripts/offline-toolchain.sh $(SYSROOT) | $(EMULATED) build/packages-offline.done
	scripts/offline-toolchain.sh $(@D) $(dir $(SYSROOT))

build/buildroot/Makefile: configs/kas.yml | $(IMAGING)
	KAS_WORK_DIR=build KAS_BUILD_DIR=build/kas .venv/bin/kas checkout --skip setup_environ --skip write_bbconfig $< \
	  || { scripts/no-buildroot.sh $<; exit 2; }
	touch $@

%/Makefile:
	@echo "BUILDROOT_DIR=$* is not a Buildroot checkout" >&2; exit 2

FORCE:

# ---- tests ---------------------------------------------------------------------------------------

PROBES      = tests/twin/probes
PAYLOAD     = tests/netboot/payload
PROGRAMS    = tests/linux/programs
C_FILES     = $(shell find $(SRC) $(LINESIM) $(BENCH) $(PROBES) $(PAYLOAD) $(PROGRAMS) -name '*.[ch]')
# Once more with the modules built under AddressSanitizer and UBSan.
UNDER_SANITIZERS = tests/test_gateway.py tests/test_lines.py tests/test_event_journal.py $(wildcard tests/test_station_*.py)
SHELL_FILES = .ci/run scripts/openrtu scripts/nuc980-pins scripts/nuc980-netboot scripts/kept tests/as-user.sh package/openrtu/container/*-* $(wildcard scripts/*.sh scripts/image/*.sh $(PROGRAMS)/*.sh board/*/*.sh package/*/S[0-9]* $(SRC)/*/*/*.sh \
  board/*/*/etc/init.d/* board/*/*/usr/sbin/*) board/nuc980/skeleton/init board/nuc980/skeleton/usr/share/udhcpc/default.script

lint: $(LINTED) ## Test: check the sources: ruff, clang-format, cppcheck, shellcheck
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	@echo clang-format --dry-run -Werror
	@.venv/bin/clang-format --dry-run -Werror $(C_FILES)
	@mkdir -p build/cppcheck
	cppcheck --quiet -j 2 --cppcheck-build-dir=build/cppcheck --enable=warning,performance,portability --error-exitcode=1 --inline-suppr \
	  --suppress=normalCheckLevelMaxBranches --library=scripts/cppcheck.cfg -I $(SRC) $(SRC) $(LINESIM) $(BENCH) $(PROBES) $(PAYLOAD) $(PROGRAMS)
	shellcheck --external-sources $(SHELL_FILES)

# Many of these wait for a line, a timer or a guest: four at a time fill two cores. A file's tests share what they start.
WORKERS := 4
PYTEST = OPENRTU_TIMES=build/times/$@.json $(PYTHON) tests/alone.py -n $(WORKERS) --dist loadfile --no-loadscope-reorder \
  --max-worker-restart 0

test-quick: LISTS := packages packages-lint packages-boards packages-tests
test-quick: $(PACKAGES) $(LINTED) $(TESTED) ## Test: lint, C unit tests, the quick half of pytest
	$(MAKE) --jobs 3 .lint-logged unit .venv/collected
	@echo '   * pytest: some 4 000 quick tests, five at a time; a dot each'
	$(MAKE) .quick

.PHONY: .lint-logged
.lint-logged:
	$(LOGGED) lint $(MAKE) lint

# Nothing on the emulated board is quick, and nobody begins with the bench: each worker would read these files.
QUICK := --ignore=tests/linux --ignore=tests/twin --ignore=tests/bench -m "not slow and not soak"

# They wait three quarters of their time: five fill two cores.
.PHONY: .quick
.quick: WORKERS := 5
.quick: build .venv/collected
	$(PYTEST) $(QUICK)

# pytest compiles a file of tests where it is first read, 5 CPU seconds for all. Workers begin together: each would do it.
.venv/collected: $(TESTED) $(shell find tests -name '*.py') pyproject.toml
	$(LOGGED) collected $(PYTHON) -m pytest --collect-only --quiet $(QUICK)
	@touch $@

# One area: all of it, or FILES='tests/…'.
FILES :=
AREA = $(PYTEST) $(or $(FILES),--area $(@:test-%=%))

test-station: build $(TESTED) ## Test: the controlled station: IEC 104 and TLS
test-lines: build $(TESTED) ## Test: the Modbus lines
test-gateway: build .asan fuzzers centre-page $(WHEELING) $(PACKAGING) build/gpsd/done build/chronyd/done build/mibs/done build/exporter/done $(TESTED) ## Test: the gateway as a whole, its configuration, the tree
test-bench: build .compared $(TESTED) ## Test: what make bench measures with
test-pins: $(TESTED) ## Test: nuc980-pins
test-image: build/packages-cross.done build/packages-release.done $(TESTED) ## Test: the images' configuration and what makes them
test-netboot: build qemu uboot $(TESTED) ## Test: nuc980-netboot
test-twin: qemu uboot $(TESTED) ## Test: the emulated board alone
test-centre: build centre-page build/provider/npm.done build/axe/npm.done $(PACKAGING) build/packages-centre.done $(TESTED) ## Test: the control centre, its page in a browser
test-station test-lines test-gateway test-bench test-pins test-image test-netboot test-twin test-centre:
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

test-native: build .compared .asan fuzzers qemu uboot centre-page build/provider/npm.done build/axe/npm.done $(WHEELING) $(PACKAGING) build/packages-centre.done build/gpsd/done build/chronyd/done build/mibs/done build/exporter/done $(TESTED) ## Test: all of pytest but Linux on the emulated board
	$(PYTEST) --ignore=tests/linux

test-user: ## Test: the README's two commands as a user without rights (takes root)
	tests/as-user.sh

test-changed: $(TESTED) ## Test: what a change can reach, and why (BASE=commit: since that one)
	$(PYTHON) tests/changed.py $(BASE)

# Two things run beside each other. First the parts that compile, with the kernels and the images in the time that their
# tests wait (nice); then test-native, which waits half of its time, with test-linux, which fills a core for each guest.
# What several of them need is built before, by one make. Of the downloads and the configuring, which wait as well, two run
# at a time.
SHARED     := build .compared qemu uboot centre-page build/provider/npm.done build/axe/npm.done $(WHEELING) $(PACKAGING) build/packages-centre.done build/sysroot.ini \
  build/gpsd/done build/chronyd/done build/mibs/done
ONLY_LINUX := linux build/boards/numaker/u-boot/done build/swupdate/done build/curl/done $(SYSTEM_PARTS) build/root/gateway-tls.done
PARTS      := lint unit asan cross fuzzers test-sanitizers

test: $(TESTED) $(LINTED) ## Test: all but soak, test-debug-kernel, test-offline; then what it cost
	rm -rf build/times
	mkdir -p build/log; failed=; parts=; begun=0; linux=; native=; \
	ended() { parts+="$$(printf '\n%6d s  %s' $$((SECONDS - begun)) "$$1")"; begun=$$SECONDS; }; \
	$(MAKE) --jobs 2 $(SHARED) $(TESTED) || failed+=" build"; ended build; \
	trap 'kill -- $${linux:+-$$linux} $${native:+-$$native} 2> /dev/null || true' EXIT; \
	set -m; { nice $(MAKE) --jobs 2 $(ONLY_LINUX) && nice $(MAKE) image-debian lab; } \
	  > build/log/test-linux-build.log 2>&1 & linux=$$!; set +m; \
	echo "test: builds $(ONLY_LINUX) beside the first parts; log: build/log/test-linux-build.log"; \
	for part in $(PARTS); do \
	  $(MAKE) $$part || failed+=" $$part"; ended $$part; \
	done; \
	set -m; $(MAKE) test-native > build/log/test-native.log 2>&1 & native=$$!; set +m; \
	echo "test: runs test-native beside test-linux; log: build/log/test-native.log"; \
	wait $$linux || tail -n 40 build/log/test-linux-build.log; ended "rest of test-linux's builds"; \
	$(MAKE) test-linux || failed+=" test-linux"; ended test-linux; \
	tail -n +1 -f --pid=$$native build/log/test-native.log; \
	wait $$native || failed+=" test-native"; ended "rest of test-native"; \
	$(PYTHON) tests/times.py $$(find build/times -name '*.json' 2> /dev/null); \
	echo "the parts:$$parts"; \
	[ -z "$$failed" ] || { echo "make test: failed:$$failed" >&2; exit 1; }

BUSY := 8
TIMES := 20

busy: $(VENV) ## Test: the shows and test-quick beside busy processes (BUSY=8, TIMES=20, TARGETS=)
	$(PYTHON) tests/busy.py --processes $(BUSY) --times $(TIMES) $(TARGETS)

soak: build qemu uboot linux linux-debug image-debian build/swupdate/done build/curl/done $(TESTED) ## Test: hours: 1000 kills of each module, 500 boots, 200 netboots, 2000 power cuts
	$(PYTHON) -m pytest -m soak

# ---- see it --------------------------------------------------------------------------------------

LAB := PYTHONPATH=scripts $(PYTHON) -m lab
AT_PORT = $(if $(PORT),--port '$(PORT)')

run-native: build $(VENV) ## See it: the gateway on this machine, built and shown in a minute (KEEP=1; PORT=)
	@$(LAB) $(AT_PORT) $(if $(KEEP),--keep)

# The system of `make run`, for a site of its own; its engineer brings the configuration with SNMPv3 later.
lab: $(VENV) $(EMULATED) ## Build: the image that `make run` boots
	@$(LAB).site build/site
	@$(MAKE) image-debian SITE=build/site/lab GATEWAY=gateway-tls

# 20 stations with simulated devices and receivers, or STATIONS=file, the centre's file of one's own.
centre: build centre-page $(VENV) $(BOARDS) $(CENTRE) ## See it: a control centre with 20 RTUs (KEEP=1; PORT=; STATIONS=file)
	@$(LAB).centre_show $(AT_PORT) $(if $(KEEP),--keep) $(if $(STATIONS),--stations '$(STATIONS)')

ifndef IMAGE_TYPED
run: build qemu uboot lab $(BOARDS) ## See it: the emulated board, from reset to the control room (KEEP=1; PORT=; IMAGE=)
	@$(LAB).board_show $(AT_PORT) $(if $(KEEP),--keep)
else ifndef SITE
run: qemu uboot $(BOARDS)
	@$(LAB).image '$(IMAGE)'
else # which it was made with
run: build qemu uboot $(BOARDS)
	@$(LAB).board_show $(AT_PORT) $(if $(KEEP),--keep) --image '$(IMAGE)'
endif

twin: qemu uboot $(BOARDS) ## See it: the emulated board: from reset to a file over TFTP, its pins, a wrong pin
	@$(LAB).twin_show

bench-polls: build .compared $(TESTED) ## Maintain: of the bench the polls of positions and their octets alone: figure 9
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/polls.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/octets.py

bench-map: build centre-page build/packages-centre.done $(TESTED) ## Maintain: frames a second of the control centre's map
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/frames.py

bench-pictures: build centre-page build/packages-centre.done $(TESTED) ## Maintain: frames a second of a process picture
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/picture_frames.py

bench: build .compared qemu uboot build/root/gateway-tls.done build/net-snmp-agent/done $(TESTED) ## Maintain: measure ours beside what else does it (docs/bench.md; LIB60870=folder)
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/bench.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/stations.py $(if $(LIB60870),--lib60870 '$(LIB60870)')
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/lines.py
	$(MAKE) bench-polls
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/store.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/history.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/logic_scans.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/reload.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/module_scans.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/managers.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/mms_servers.py
	scripts/build-dtb.sh $(DTS) $(DTB)
	$(PYTHON) $(BENCH)/pins.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/tftp.py

# ---- a real board --------------------------------------------------------------------------------

netboot: $(IMAGE_DEBIAN) $(BOARDS) ## A board: boot it over UART and Ethernet (PORT=, BOARD_IP=, SITE=, IMAGE=, BOARD=)
	scripts/nuc980-netboot boot --port $(PORT) $(if $(SITE),--site $(SITE_SETTINGS)) $(if $(BOARD_IP),--board-ip $(BOARD_IP)) \
	  --console $(IMAGE_FOLDER)/uImage $(IMAGE_FOLDER)/nuc980-$(BOARD).dtb

# ---- away with it --------------------------------------------------------------------------------

clean: ## Maintain: remove what was built
	rm -rf build

distclean: clean ## Maintain: remove the Python environment as well
	rm -rf .venv .pytest_cache .ruff_cache

# ---- what was typed ------------------------------------------------------------------------------

# Before anything is built. Last, where all that has a default has it.
TYPED := $(foreach name,PORT STATIONS BOARD_IP IMAGE IMAGES SITE BOARD DTS SWITCHES KEY CERTIFICATE FUZZ_SECONDS LIB60870 NVD,$(name)='$(subst ','\'',$($(name)))') \
  IMAGE_TYPED=$(IMAGE_TYPED)
REFUSED := $(shell $(TYPED) scripts/check-arguments.sh $(MAKECMDGOALS))
$(if $(REFUSED),$(error $(REFUSED)))
