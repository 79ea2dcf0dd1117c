/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A room's part of the configuration file: the outermost keys that are its own, and how they are read. rtud puts the parts of all
 * kinds of modules together, in the order of its table.
 */
#ifndef OPENRTU_CONFIG_PART_H
#define OPENRTU_CONFIG_PART_H

#include "config/files.h"

/* What is left out is nothing to do. */
struct config_part {
	const struct config_rule *keys;
	size_t key_count;
	size_t own_size; /* of what it keeps from step to step, own: zeros at first */
	/* Adds its sections, and to the loader's sets_max and points_max. root: any JSON. False: no memory. */
	bool (*begin)(struct config_loader *loader, void *own, const json_t *root);
	/*
	 * Reads its keys; values are theirs. The settings of all modules have been read. The first sets are the devices of
	 * the lines, which are added here; any other part adds its sets in finish.
	 */
	void (*read)(struct config_loader *loader, void *own, const struct config_value *values);
	/* All parts have been read, and the devices are there: adds its own sets. False: no memory. */
	bool (*finish)(struct config_loader *loader, void *own);
	/* All sets are there: finds those of others that it names. False: no memory. */
	bool (*link)(struct config_loader *loader, void *own);
	/* The configuration is read, or could not be: frees what own refers to. */
	void (*end)(void *own);
};

#endif
