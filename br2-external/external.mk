# SPDX-License-Identifier: GPL-3.0-or-later
include $(sort $(wildcard $(BR2_EXTERNAL_OPENRTU_PATH)/../package/*/*.mk))

# The vendor's kernel copies its image and its device trees to a folder beside it, and fails when there is none.
define OPENRTU_LINUX_IMAGE_FOLDER
	mkdir -p $(@D)/../image
endef
LINUX_PRE_BUILD_HOOKS += OPENRTU_LINUX_IMAGE_FOLDER

# CVEs name releases, and the vendor's kernel is a commit, which Buildroot takes for the version by now. The real-time patch
# is for exactly one release: patch-5.10.140-rt73.
LINUX_CPE_ID_VERSION = $(word 2,$(subst -, ,$(notdir $(LINUX_PATCHES))))

# Buildroot makes BusyBox run as root whoever starts it, for su and passwd. Nobody but root has a shell here.
BUSYBOX_PERMISSIONS =

# Buildroot builds local sources and device trees once: what changed since then would not be in the image.
openrtu_sources := $(shell find $(BR2_EXTERNAL_OPENRTU_PATH)/../package/openrtu -type f)
$(OPENRTU_TARGET_RSYNC) $(OPENRTU_TARGET_BUILD): $(openrtu_sources)
$(LINUX_TARGET_BUILD): $(shell find $(BR2_EXTERNAL_OPENRTU_PATH)/../dts/nuvoton -type f)
