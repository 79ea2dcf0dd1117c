/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Reads the gateway's configuration file: the project report, section 4.4 and figures 4.8 and 4.9, and the optional keys of
 * docs/configuration.md. config.schema.json says the same as a JSON Schema.
 */
#ifndef OPENRTU_RTUD_CONFIG_H
#define OPENRTU_RTUD_CONFIG_H

#include <stdbool.h>
#include <stdio.h>

#include "map/config.h"

/* The exit code of a program that was asked to check the file. */
enum config_result {
	CONFIG_GOOD,
	CONFIG_WRONG,    /* JSON, but not a configuration: every error was reported */
	CONFIG_UNUSABLE, /* unreadable, too large, not JSON, or it needs a module that is not there */
};

/* The modules that there are programs of. */
struct config_modules {
	bool iec104, iec61850, modbus, snmp, tls, web;
};

/*
 * Reads the file into out, whose arrays the caller frees with config_free; instead: as in config/files.h. Every error becomes one line in messages, with its
 * place and what was expected. Anything but CONFIG_GOOD leaves out empty.
 */
enum config_result config_load(const char *path, const char *instead, struct config_modules modules,
			       struct map_config *out, FILE *messages);
void config_free(struct map_config *config);

/*
 * Of a good file, what it describes and the shortest scan of each line, on stdout; with requests (--plan) how it comes about.
 * Returns the exit code.
 */
int config_print(const char *path, const struct map_config *config, bool requests);

enum config_list { CONFIG_CSV, CONFIG_MARKDOWN };

/*
 * rtud --points: prints a line for each point on stdout, by CA and IOA: docs/configuration.md, "The list of points".
 * Errors as config_load. Returns the exit code.
 */
int config_points(const char *path, struct config_modules modules, enum config_list list);

#endif
