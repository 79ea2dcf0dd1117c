/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The files of a configuration: read once each, parsed as JSON, with the templates in them. What is in them the rooms know, each
 * of its own part.
 */
#ifndef OPENRTU_CONFIG_FILES_H
#define OPENRTU_CONFIG_FILES_H

#include <sys/types.h>

#include "config/index.h"
#include "config/keys.h"
#include "config/names.h"
#include "map/config.h"

#define CONFIG_FILE_SIZE_MAX (4u * 1024u * 1024u)
#define CONFIG_POINTS_MAX    65535
#define CONFIG_FILES_MAX     32 /* the file itself and those that it includes */
#define CONFIG_SCANNERS_MAX  96

#define CONFIG_KEY_TEMPLATES "templates"
#define CONFIG_KEY_INCLUDE   "include"

/* A file that was read. */
struct config_file {
	struct config_source source;
	const struct config_file *includer; /* NULL: it was asked for */
	char *path, *text;                  /* the source's, to be freed */
	json_t *root;
	uint64_t device, inode;
};

/* A device that is described once, for many. */
struct config_template {
	const char *name;
	const json_t *json;
	const struct config_source *source;
	bool wrong; /* that has been said */
};

/* What scans: config/scanners.h. */
struct config_scanner {
	char name[MAP_NAME_SIZE];
	bool waits;
	int priority; /* SCHED_FIFO, 0: none */
};

/* What a configuration is read from, what is wrong with it, and what becomes of it. */
struct config_loader {
	struct config_report report;
	struct map_config *config;
	struct config_file files[CONFIG_FILES_MAX];
	uint32_t file_count;
	size_t bytes; /* of all files */
	struct config_template *templates;
	uint32_t template_count;
	json_t *kept;                  /* array of what was put together of template and instance */
	uint32_t sets_max, points_max; /* that the parts can add at most */
	struct config_scanner scanners[CONFIG_SCANNERS_MAX];
	uint32_t scanner_count;
	struct config_index index; /* of the points */
	/* What a point's key CONFIG_KEY_LN says is for one room to understand. NULL: it is not there. */
	void (*take_ln)(struct config_loader *loader, const struct config_place *place, uint32_t point,
			const char *text);
};

/* of: the place of the point in the file. */
static inline void config_take_ln(struct config_loader *loader, const struct config_place *of, uint32_t point,
				  const char *text)
{
	const struct config_place here = config_key_of(of, CONFIG_KEY_LN);

	if (loader->take_ln != NULL)
		loader->take_ln(loader, &here, point, text);
}

/* An array of zeros, of at least one element, so that NULL means no memory. */
void *config_allocate(uint32_t count, size_t size);

/*
 * Reads the file that was asked for, what it includes, and the templates of all. instead: another file, whose text is read in its
 * place; NULL: none. False: it is not JSON or not readable.
 */
bool config_read_files(struct config_loader *loader, const char *path, const char *instead);
void config_free_files(struct config_loader *loader);
/* Says what is wrong with the outermost keys of files that are included. */
void config_check_included(struct config_loader *loader);
/* NULL: there is none of this name. */
struct config_template *config_find_template(const struct config_loader *loader, const char *name);
/* The template's file, as it is read for a device. instance: NULL for none. */
struct config_place config_template_file(const struct config_template *template,
					 const struct config_place *instance);

#endif
