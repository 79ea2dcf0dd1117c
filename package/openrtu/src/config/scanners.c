/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/scanners.h"

#include <stdlib.h>
#include <string.h>

void config_add_scanner(struct config_loader *loader, const char *name, bool waits, int priority)
{
	struct config_scanner *scanner;

	if (loader->scanner_count == CONFIG_SCANNERS_MAX)
		abort(); /* the lines, programs and modules that a file may have outgrew it */
	scanner = &loader->scanners[loader->scanner_count++];
	scanner->waits = waits;
	scanner->priority = priority;
	snprintf(scanner->name, sizeof(scanner->name), "%s", name);
}

const struct config_scanner *config_find_scanner(const struct config_loader *loader, const char *name,
						 bool *many)
{
	const struct config_scanner *found = NULL;

	*many = false;
	for (uint32_t i = 0; i < loader->scanner_count; i++) {
		if (strcmp(loader->scanners[i].name, name) != 0)
			continue;
		*many = found != NULL;
		found = &loader->scanners[i];
	}
	return *many ? NULL : found;
}
