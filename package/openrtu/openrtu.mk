################################################################################
#
# openrtu    SPDX-License-Identifier: GPL-3.0-or-later
#
################################################################################

OPENRTU_SITE = $(BR2_EXTERNAL_OPENRTU_PATH)/../package/openrtu/src
OPENRTU_VERSION = $(shell cat $(OPENRTU_SITE)/VERSION)
OPENRTU_SITE_METHOD = local
OPENRTU_LICENSE = GPL-3.0-or-later
OPENRTU_LICENSE_FILES = GPL-3.0-or-later.txt
OPENRTU_DEPENDENCIES = host-pkgconf jansson libseccomp

# The unit tests run on the build machine (make test), and a newer compiler's
# warning shall not stop a release.
OPENRTU_CONF_OPTS = -Dtests=disabled -Dwerror=false -Dcentre=false -Dsunspec=false

# Buildroot copies the source out of the tree, which is dated as a whole.
OPENRTU_NINJA_ENV = SOURCE_DATE_EPOCH=$$($(BR2_EXTERNAL_OPENRTU_PATH)/../scripts/source-date.sh)

# The licence's text is not in src/ but once in the tree.
define OPENRTU_ADD_LICENSE
	$(INSTALL) -m 0644 $(BR2_EXTERNAL_OPENRTU_PATH)/../LICENSES/GPL-3.0-or-later.txt $(@D)
endef
OPENRTU_POST_RSYNC_HOOKS += OPENRTU_ADD_LICENSE

# rtud, started as root, runs each module as a user of its own, from 61201 on,
# with the group 61200 and no capability. The kind of a module says which (user,
# in src/modules/*/kind.c). Here they get names: the northbound module has 61201,
# the first line process 61203, whichever of them are built. The user of rtu-pull is
# no module's, and in a group of its own.
define OPENRTU_USERS
	openrtu 61200 openrtu 61200 * - - - OpenRTU
	$(OPENRTU_IEC104_USER)
	$(OPENRTU_MODBUS_USER)
	$(OPENRTU_SNMP_USER)
	$(OPENRTU_IEC61850_USER)
	$(OPENRTU_WEB_USER)
	rtu-gps 61215 openrtu 61200 * - - dialout OpenRTU positions
	rtu-journal 61202 openrtu 61200 * - - - OpenRTU journal
	rtu-goose 61219 openrtu 61200 * - - - OpenRTU GOOSE
	rtu-pull 61199 rtu-pull 61199 * - - - OpenRTU updates that the board fetches
endef

ifeq ($(BR2_PACKAGE_OPENRTU_IEC104),y)
OPENRTU_CONF_OPTS += -Diec104=true
define OPENRTU_IEC104_USER
	rtu-iec104 61201 openrtu 61200 * - - - OpenRTU IEC 60870-5-104
	rtu-104m 61214 openrtu 61200 * - - - OpenRTU outstations
endef
else
OPENRTU_CONF_OPTS += -Diec104=false
endif

ifeq ($(BR2_PACKAGE_OPENRTU_TLS),y)
OPENRTU_CONF_OPTS += -Dtls=true
OPENRTU_DEPENDENCIES += openssl
else
OPENRTU_CONF_OPTS += -Dtls=false
endif

ifeq ($(BR2_PACKAGE_OPENRTU_MODBUS),y)
OPENRTU_CONF_OPTS += -Dmodbus=true
define OPENRTU_MODBUS_USER
	rtu-modbus 61203 openrtu 61200 * - - dialout OpenRTU Modbus RTU
endef
else
OPENRTU_CONF_OPTS += -Dmodbus=false
endif

ifeq ($(BR2_PACKAGE_OPENRTU_SNMP),y)
OPENRTU_CONF_OPTS += -Dsnmp=true
OPENRTU_DEPENDENCIES += netsnmp openssl
define OPENRTU_SNMP_USER
	rtu-snmp 61216 openrtu 61200 * - - - OpenRTU SNMPv3
endef
else
OPENRTU_CONF_OPTS += -Dsnmp=false
endif

ifeq ($(BR2_PACKAGE_OPENRTU_WEB),y)
OPENRTU_CONF_OPTS += -Dweb=true
OPENRTU_DEPENDENCIES += host-python3 libmicrohttpd openssl
define OPENRTU_WEB_USER
	rtu-web 61218 openrtu 61200 * - - - OpenRTU page
endef
else
OPENRTU_CONF_OPTS += -Dweb=false
endif

ifeq ($(BR2_PACKAGE_OPENRTU_IEC61850),y)
OPENRTU_CONF_OPTS += -Diec61850=true
define OPENRTU_IEC61850_USER
	rtu-iec61850 61217 openrtu 61200 * - - - OpenRTU IEC 61850
endef
else
OPENRTU_CONF_OPTS += -Diec61850=false
endif

OPENRTU_CONF_OPTS += -Dlibrary=$(if $(BR2_PACKAGE_OPENRTU_LIBRARY),true,false)
ifeq ($(BR2_PACKAGE_OPENRTU_LIBRARY),y)
OPENRTU_INSTALL_STAGING = YES
endif

define OPENRTU_INSTALL_INIT_SYSV
	$(INSTALL) -D -m 0755 $(BR2_EXTERNAL_OPENRTU_PATH)/../package/openrtu/S80rtud \
		$(TARGET_DIR)/etc/init.d/S80rtud
endef

$(eval $(meson-package))
