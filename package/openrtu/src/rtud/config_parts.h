/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the files of rtud know of each other that put a configuration together of what the rooms read. */
#ifndef OPENRTU_RTUD_CONFIG_PARTS_H
#define OPENRTU_RTUD_CONFIG_PARTS_H

#include "config/part.h"
#include "rtud/config.h"
#include "rtud/kinds.h"

/* The file's parts, and what each has kept so far. */
struct rtud_loader {
	struct config_loader files;
	const struct config_part *parts[KINDS_MAX];
	void *own[KINDS_MAX];
	size_t part_count;
};

/* ---- config_file.c ----------------------------------------------------------------------- */

#define CONFIG_FILE_KEYS_MAX 64 /* of the outermost object */

/* The keys of the parts behind those of the file itself. Returns how many. */
size_t config_file_rules(const struct config_part *const parts[], size_t part_count,
			 struct config_rule rules[CONFIG_FILE_KEYS_MAX]);
/* Takes the parts of all kinds. root: any JSON. False: no memory. */
bool config_begin_file(struct rtud_loader *loader, const json_t *root);
/* Fills the settings of all modules, then what the parts make of their keys. False: no memory. */
bool config_read_file(struct rtud_loader *loader, const json_t *root);
void config_end_file(struct rtud_loader *loader);

/* ---- config_build.c ---------------------------------------------------------------------- */

/* Reports what needs a module that is not there. root: a file without errors, which has been read. */
void config_check_modules(struct config_loader *loader, const json_t *root, struct config_modules modules);

/* ---- config_points.c --------------------------------------------------------------------- */

/* Prints the points of a configuration that has been read. False without memory. */
bool config_list_points(const struct rtud_loader *loader, enum config_list list, FILE *out);

#endif
