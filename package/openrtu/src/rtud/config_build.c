/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a build left out that the file needs. */
#include "modbus/config.h"
#include "rtud/config_parts.h"

static void refuse(struct config_loader *loader, const char *key, const char *what)
{
	const struct config_place file = {.in = NULL};
	const struct config_place here = config_key_of(&file, key);

	config_error(&loader->report, &here, "this build has no %s", what);
}

static void refuse_in(struct config_loader *loader, const char *object, const char *key, const char *what)
{
	const struct config_place file = {.in = NULL};
	const struct config_place in = config_key_of(&file, object), here = config_key_of(&in, key);

	config_error(&loader->report, &here, "this build has no %s", what);
}

void config_check_modules(struct config_loader *loader, const json_t *root, struct config_modules modules)
{
	static const char *const iec104_keys[] = {"iec104", "masters", "redundancy_groups", "originators",
						  "journal"};

	for (size_t i = 0; i < sizeof(iec104_keys) / sizeof(iec104_keys[0]); i++)
		if (!modules.iec104 && json_object_get(root, iec104_keys[i]) != NULL)
			refuse(loader, iec104_keys[i],
			       "rtu-iec104: remove the key, or build with -Diec104=true, in Buildroot "
			       "BR2_PACKAGE_OPENRTU_IEC104");
	if (!modules.iec104 && json_object_get(root, "outstations") != NULL)
		refuse(loader, "outstations",
		       "rtu-104m: remove the key, or build with -Diec104=true, in Buildroot "
		       "BR2_PACKAGE_OPENRTU_IEC104");
	if (!(modules.tls && modules.iec104) && json_object_get(root, "tls") != NULL)
		refuse(loader, "tls",
		       "rtu-iec104-tls: remove the object, or build with -Dtls=true, in Buildroot "
		       "BR2_PACKAGE_OPENRTU_TLS");
	if (!(modules.tls && modules.iec104) && json_object_get(root, "outstations_tls") != NULL)
		refuse(loader, "outstations_tls",
		       "rtu-104m-tls: remove the object, or build with -Dtls=true, in Buildroot "
		       "BR2_PACKAGE_OPENRTU_TLS");
	if (!modules.snmp && json_object_get(root, "snmp") != NULL)
		refuse(loader, "snmp",
		       "rtu-snmp: remove the object, or build with -Dsnmp=true, in Buildroot "
		       "BR2_PACKAGE_OPENRTU_SNMP");
	if (!modules.web && json_object_get(root, "web") != NULL)
		refuse(loader, "web",
		       "rtu-web: remove the object, or build with -Dweb=true, in Buildroot "
		       "BR2_PACKAGE_OPENRTU_WEB");
	if (!modules.iec61850 && json_object_get(root, "iec61850") != NULL)
		refuse(loader, "iec61850",
		       "rtu-iec61850: remove the object, or build with -Diec61850=true, in Buildroot "
		       "BR2_PACKAGE_OPENRTU_IEC61850");
	if (!modules.tls && json_object_get(json_object_get(root, "iec61850"), "tls") != NULL)
		refuse_in(loader, "iec61850", "tls",
			  "rtu-iec61850-tls: remove the object, or build with -Dtls=true, in Buildroot "
			  "BR2_PACKAGE_OPENRTU_TLS");
	if (!modules.modbus && modbus_port_count(loader->config) > 0)
		refuse(loader, "port",
		       "rtu-modbus: make no port active, or build with -Dmodbus=true, in Buildroot "
		       "BR2_PACKAGE_OPENRTU_MODBUS");
}
