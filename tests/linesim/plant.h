/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The simulated plant: all lines and slaves, as the gateway's configuration file (the project report, section 4.4) and
 * the file of initial values say. Keys that mean nothing to a line are not looked at: rtud --check judges the
 * file.
 */
#ifndef LINESIM_PLANT_H
#define LINESIM_PLANT_H

#include "line.h"

#define PLANT_LINES_MAX  64
#define PLANT_ERROR_SIZE 256

struct plant {
	size_t line_count;
	struct line lines[PLANT_LINES_MAX];
};

/*
 * serves_tcp: ports with a host are lines, too, whose devices are behind Modbus TCP; else they are left out.
 * Both return 0, or -1 with what is wrong and where in error (PLANT_ERROR_SIZE bytes); the program ends then.
 * Nothing is freed: a plant lives as long as the program.
 */
int plant_load_config(struct plant *plant, const char *path, int64_t latency_ns, bool serves_tcp,
		      char *error);
int plant_load_values(struct plant *plant, const char *path, char *error);

/* By the port's "value"; NULL: there is no such active port. */
struct line *plant_line(struct plant *plant, const char *port);
/* By "port.unit", as "3.67"; NULL: there is no such slave. */
struct slave *plant_slave(struct plant *plant, const char *name);

/* A decimal number in min..max and nothing else. */
bool plant_number(const char *text, long min, long max, long *value);

#endif
