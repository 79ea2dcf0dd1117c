# SPDX-License-Identifier: GPL-3.0-or-later
include $(sort $(wildcard $(BR2_EXTERNAL_OPENRTU_PATH)/../package/*/*.mk))

# The vendor's kernel copies its image and its device trees to a folder beside it, and fails when there is none.
define OPENRTU_LINUX_IMAGE_FOLDER
	mkdir -p $(@D)/../image
endef
LINUX_PRE_BUILD_HOOKS += OPENRTU_LINUX_IMAGE_FOLDER
