/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a line tells goes into the map and to the commands under way. */
#ifndef OPENRTU_MODULES_MODBUS_LINE_RESULTS_H
#define OPENRTU_MODULES_MODBUS_LINE_RESULTS_H

#include "map/lines.h"
#include "map/map.h"
#include "map/trouble.h"
#include "modbus/config.h"
#include "modbus/line.h"
#include "modules/modbus/commands.h"
#include "modules/modbus/quality.h"

#define LINE_NEWS_NOBODY (-1)

/* What the log knows of a device. */
struct line_news {
	bool is_late;     /* its last answer came too late, and that has been said */
	int16_t stranger; /* who answered for it, which has been said; LINE_NEWS_NOBODY: nobody */
	bool is_misfit;   /* its last answer had another length, and that has been said */
	uint8_t differs;  /* bits: the objects in which it is not what it shall be, which has been said */
	struct map_repeats late, strangers, misfits, pauses, turns;
	struct map_trouble death;
	struct map_lines refusals; /* lines about them */
};

/* Of one line. Filled in by the caller, who owns the memory. */
struct line_results {
	struct map *map;
	const struct modbus_port *config;
	const struct modbus_line *line;
	/* The process', the same for all its lines. */
	struct commands *commands;
	struct quality *quality;
	struct map_update *updates;        /* room for the largest device */
	const struct modbus_point *points; /* of the configuration */
	struct line_news *news;            /* of its devices */
	struct passing *passing;           /* of the line that it passes on to */
	int8_t *exponents;                 /* of all points: what their scale registers say (convert.h) */
	int64_t scan_ns;                   /* what the line's scan took while this process was not silent */
};

/* What a line is to be given; its context is a struct line_results. */
extern const struct modbus_events line_results_events;

/* The device has a value that the process before read, and that is told still. */
bool line_results_vouch(const struct line_results *results, uint32_t device);

/* What is old is judged by the last whole scan, if it began and ended between these two times. */
void line_results_note_scan(struct line_results *results, int64_t from_ns, int64_t to_ns);
/*
 * Whether some value is good and too old for that: older than twice its period, or twice the scan, and longer than the
 * heartbeat may be silent.
 */
bool line_results_are_old(const struct line_results *results, int64_t now_ns);
/* Tells as not topical what is. */
void line_results_give_up_old(struct line_results *results, int64_t now_ns);

#endif
