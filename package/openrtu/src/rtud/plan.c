/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/plan.h"

#include <libgen.h>
#include <limits.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "map/supervise.h"
#include "rtud/kinds.h"
#include "rtud/programs.h"

/* ---- programs ---------------------------------------------------------------------------- */

void plan_note_programs(const struct map_config *config, const char *folder, FILE *messages)
{
	for (uint32_t i = 0; i < config->module_count; i++) {
		struct map_module module = {.name = ""};
		struct kind_run run;

		memcpy(module.name, config->modules[i].name, sizeof(module.name));
		memcpy(module.kind, config->modules[i].kind, sizeof(module.kind));
		run = kinds_run(&module, config);
		if (run.program != NULL && !programs_are_known(folder, run.program->name))
			fprintf(messages,
				"note: the gateway would run without %s: there is no program %s in %s\n",
				module.name, run.program->name, folder);
	}
}

/* ---- ports ------------------------------------------------------------------------------- */

static bool is_any(const char *address)
{
	return strcmp(address, "0.0.0.0") == 0 || strcmp(address, "::") == 0;
}

static bool collide(const struct kind_port *a, const struct kind_port *b)
{
	return a->type == b->type && a->port == b->port &&
	       (is_any(a->address) || is_any(b->address) || strcmp(a->address, b->address) == 0);
}

static bool listens(const struct map_config *config, uint32_t module, struct kind_port *out)
{
	const struct map_module_plan *plan = &config->modules[module];
	const struct kind *kind = plan->flags & MAP_IS_GONE ? NULL : kinds_find(plan->kind);

	return kind != NULL && kind->listens != NULL && kind->listens(config, plan->name, out);
}

static bool has_ports(const struct map_config *config, FILE *messages)
{
	bool possible = true;

	for (uint32_t i = 0; i < config->module_count; i++) {
		struct kind_port one, other;

		if (!listens(config, i, &one))
			continue;
		for (uint32_t j = i + 1; j < config->module_count; j++)
			if (listens(config, j, &other) && collide(&one, &other)) {
				fprintf(messages, "%s and %s would listen at one port, %u of %s\n",
					config->modules[i].name, config->modules[j].name, one.port,
					one.type == SOCK_STREAM ? "TCP" : "UDP");
				possible = false;
			}
	}
	return possible;
}

/* ---- the map ----------------------------------------------------------------------------- */

/* Of the file system that the folder will be on. False: nobody knows. */
static bool find_room(const char *folder, unsigned long long *bytes)
{
	char path[PATH_MAX], *parent;
	struct statvfs room;

	if (strlen(folder) >= sizeof(path))
		return false;
	strcpy(path, folder);
	while (statvfs(path, &room) != 0) {
		if (strcmp(path, "/") == 0 || strcmp(path, ".") == 0)
			return false;
		parent = dirname(path);
		memmove(path, parent, strlen(parent) + 1);
	}
	*bytes = (unsigned long long)room.f_blocks * room.f_frsize;
	return true;
}

/* What is free there, a map that is there already has taken. */
static bool has_map(const struct map_config *config, const char *map, FILE *messages)
{
	unsigned long long room;
	char error[MAP_ERROR_SIZE];
	size_t size;

	if (map_check(config, &size, error) < 0) {
		fprintf(messages, "%s\n", error);
		return false;
	}
	if (!find_room(map, &room) || size <= room)
		return true;
	fprintf(messages, "the map needs %zu KiB, and the file system of %s has %llu KiB in all\n",
		size / 1024, map, room / 1024);
	return false;
}

/* ------------------------------------------------------------------------------------------ */

bool plan_is_possible(const struct map_config *config, const char *map, FILE *messages)
{
	const bool room = has_map(config, map, messages), ports = has_ports(config, messages);

	return room && ports;
}

bool plan_modules(struct map_config *config, const char *map, FILE *messages)
{
	if (kinds_plan(config))
		return plan_is_possible(config, map, messages);
	fprintf(messages, "too many processes: %d modules at most\n", MAP_MODULES_MAX);
	return false;
}
