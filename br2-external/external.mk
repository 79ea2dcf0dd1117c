# SPDX-License-Identifier: GPL-3.0-or-later
include $(sort $(wildcard $(BR2_EXTERNAL_OPENRTU_PATH)/../package/*/*.mk))

# What is for our boards alone is known by their root file system: others may use this tree for its packages.
ifneq ($(filter %/board/nuc980/rootfs-overlay,$(call qstrip,$(BR2_ROOTFS_OVERLAY))),)

# The vendor's kernel copies its image and its device trees to a folder beside it, and fails when there is none.
define OPENRTU_LINUX_IMAGE_FOLDER
	mkdir -p $(@D)/../image
endef
LINUX_PRE_BUILD_HOOKS += OPENRTU_LINUX_IMAGE_FOLDER

# CVEs name releases, and the vendor's kernel is a commit, which Buildroot takes for the version by now. The real-time patch
# is for exactly one release: patch-5.10.140-rt73.
openrtu_rt_release := $(word 2,$(subst -, ,$(filter patch-%,$(notdir $(LINUX_PATCHES)))))
ifneq ($(openrtu_rt_release),)
LINUX_CPE_ID_VERSION = $(openrtu_rt_release)
endif

# Buildroot makes BusyBox run as root whoever starts it, for su and passwd. Nobody but root has a shell here.
BUSYBOX_PERMISSIONS =

endif

# Our ports are source files beside the patches: what uses these patches gets them, into the source, before each build what has
# changed, and to the sources that legal-info collects. The vendor's kernel has hashes among the patches, and no patch.
openrtu_patches := $(filter $(BR2_EXTERNAL_OPENRTU_PATH)/../patches,$(call qstrip,$(BR2_GLOBAL_PATCH_DIR)))

ifneq ($(and $(openrtu_patches),$(wildcard $(openrtu_patches)/linux/$(LINUX_VERSION)/*.patch)),)
openrtu_linux := $(realpath $(addprefix $(BR2_EXTERNAL_OPENRTU_PATH)/../board/nuc980/linux/,arch drivers include))
define OPENRTU_LINUX_SOURCES
	rsync -r --checksum $(openrtu_linux) $(@D)
endef
LINUX_POST_PATCH_HOOKS += OPENRTU_LINUX_SOURCES
LINUX_PRE_BUILD_HOOKS += OPENRTU_LINUX_SOURCES

define OPENRTU_LINUX_LEGAL_INFO
	mkdir -p $(LINUX_REDIST_SOURCES_DIR)/nuc980
	cp -R $(openrtu_linux) $(LINUX_REDIST_SOURCES_DIR)/nuc980
endef
LINUX_POST_LEGAL_INFO_HOOKS += OPENRTU_LINUX_LEGAL_INFO
endif

ifneq ($(openrtu_patches),)
openrtu_uboot := $(realpath $(wildcard $(BR2_EXTERNAL_OPENRTU_PATH)/../board/nuc980/u-boot/*))
define OPENRTU_UBOOT_SOURCES
	rsync -r --checksum $(openrtu_uboot) $(@D)
endef
UBOOT_POST_PATCH_HOOKS += OPENRTU_UBOOT_SOURCES
UBOOT_PRE_BUILD_HOOKS += OPENRTU_UBOOT_SOURCES

define OPENRTU_UBOOT_LEGAL_INFO
	mkdir -p $(UBOOT_REDIST_SOURCES_DIR)/nuc980
	cp -R $(openrtu_uboot) $(UBOOT_REDIST_SOURCES_DIR)/nuc980
endef
UBOOT_POST_LEGAL_INFO_HOOKS += OPENRTU_UBOOT_LEGAL_INFO
endif

# Buildroot builds local sources and device trees once: what changed since then would not be in the image.
openrtu_sources := $(shell find $(BR2_EXTERNAL_OPENRTU_PATH)/../package/openrtu -type f)
$(OPENRTU_TARGET_RSYNC) $(OPENRTU_TARGET_BUILD): $(openrtu_sources)
$(LINUX_TARGET_BUILD): $(if $(openrtu_linux),$(shell find $(openrtu_linux) -type f))
$(UBOOT_TARGET_BUILD): $(if $(openrtu_uboot),$(shell find $(openrtu_uboot) -type f))
ifneq ($(filter %/board/nuc980/rootfs-overlay,$(call qstrip,$(BR2_ROOTFS_OVERLAY))),)
$(LINUX_TARGET_BUILD): $(shell find $(BR2_EXTERNAL_OPENRTU_PATH)/../dts/nuvoton -type f)
endif
