# SPDX-License-Identifier: GPL-3.0-or-later
# The image by Buildroot.

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

# Lists of what they hold: scripts/image/contents.py.
compare-images: image-debian ## Test: two images hold the same, but for board/nuc980/differences.toml (IMAGE=)
	@PYTHONPATH=scripts python3 -m image.contents compare $(SYSTEM).parts/initramfs.cpio \
	  build/$(if $(IMAGE_TYPED),$(IMAGE),nuc980_gateway_lts-offline)/contents.json

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
