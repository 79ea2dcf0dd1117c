# SPDX-License-Identifier: GPL-3.0-or-later
# The emulated board: QEMU, U-Boot, Linux, all from the distribution's sources.

# Make sees a part that is new, not one that is gone, such as a patch: each build notes those that it had.
gone = $(if $(filter-out $(2),$(file <build/$(1)/parts)),FORCE)

QEMU_PARTS := scripts/build-qemu.sh scripts/patched-source.sh $(wildcard patches/qemu/*.patch) \
  $(shell find board/nuc980/qemu -type f -not -name '.*')

qemu: build/qemu/done ## Build: the emulated board: QEMU with the machine nuc980

build/qemu/done: $(QEMU_PARTS) $(call gone,qemu,$(QEMU_PARTS)) build/qemu/debian.dsc | $(EMULATED)
	$(LOGGED) qemu scripts/build-qemu.sh build/qemu/debian $(@D)
	@echo $(QEMU_PARTS) > $(@D)/parts
	@touch $@

UBOOT_PARTS := scripts/build-uboot.sh scripts/patched-source.sh $(wildcard patches/uboot/*.patch dts/nuvoton/*.dts*) \
  $(shell find board/nuc980/u-boot -type f -not -name '.*')

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
  $(wildcard patches/linux/6.1/*.patch) \
  $(shell find dts/bindings board/nuc980/linux/arch board/nuc980/linux/drivers board/nuc980/linux/include -type f -not -name '.*')

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

# What we add to Linux, U-Boot and QEMU, for their maintainers: docs/upstreaming.md. AUTHOR='Name <address>' signs.
AUTHOR :=
series: $(VENV) ## Maintain: our Linux, U-Boot and QEMU as series for git am (AUTHOR=)
	$(PYTHON) scripts/series.py build/series $(if $(AUTHOR),--author "$$AUTHOR")

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
