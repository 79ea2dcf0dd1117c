/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The journal's file: records one behind the other, each with its length, its number and a CRC-32. The first one holds
 * all events that somebody has not acknowledged; each further one those that came since. Every record holds the
 * places of all event queues. Numbers have the low octet first.
 *
 *	head	magic 4, length of the rest 4, number in the file 4, CRC-32 of all else 4
 *	rest	modules 1, queues 1, 0 2, events 4, then these queues and these events
 *	queue	kind 1, length of its name 1, its name, then for each module the first event not acknowledged 4
 *	event	CA 2, module 1, type 1, IOA 4, number in its module's ring 4, value 4, quality 1, detail 1, cause 1,
 *		enum map_event_time 1, nanoseconds since 1970 8
 *
 * Every record also holds what each retained point was, as an event with JOURNAL_RETAINED in the place of the cause: a
 * version before there were such points drops it as no event that can be, and reads the rest.
 *
 * In the same way a record holds what is new of the history (map/history.h): JOURNAL_HISTORY, the start (value), revision (IOA) and the
 * number with which the entries go on that follow, JOURNAL_ENTRY with the reason as module; and in each record after them the same of the entries
 * to come, and what is known of its readers, JOURNAL_READER, so many octets at a time: in IOA, value and nanoseconds.
 *
 * And what modules retain besides points (map/retained.h): JOURNAL_VALUE, with the name in IOA and number, the value, its upper half in
 * place of the nanoseconds.
 *
 * A point is what it is to a controlling station, CA, IOA and type: a changed configuration keeps what is still there.
 */
#ifndef OPENRTU_JOURNAL_RECORD_H
#define OPENRTU_JOURNAL_RECORD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "map/history.h"
#include "map/retained.h"
#include "map/station.h"

#define JOURNAL_FILE         "events"        /* in the journal's folder */
#define JOURNAL_FILE_NEW     "events.new"    /* the next one, until it is whole */
#define JOURNAL_FILE_UNREAD  "events.unread" /* the one that could not be read at a start */
#define JOURNAL_FILE_MAX     (8u << 20)      /* bytes */
#define JOURNAL_HEAD_SIZE    16u
#define JOURNAL_EVENT_SIZE   28u
#define JOURNAL_RECORD_LEAST 8u
#define JOURNAL_RETAINED     0x80u
#define JOURNAL_HISTORY      0x81u
#define JOURNAL_READER       0x82u
#define JOURNAL_READER_PART  16u
#define JOURNAL_ENTRY        0x83u
#define JOURNAL_VALUE        0x84u
/* Of a record without events, with so many modules; of the most, less than a quarter of the smallest file. */
#define JOURNAL_QUEUES_OF(modules)                                                                           \
	(JOURNAL_HEAD_SIZE + JOURNAL_RECORD_LEAST + MAP_QUEUES * (2u + MAP_ADDRESS_SIZE + (modules)*4u))
#define JOURNAL_QUEUES_SIZE JOURNAL_QUEUES_OF(MAP_MODULES_MAX)

enum journal_queue_kind { JOURNAL_GROUP, JOURNAL_ADDRESS };

struct journal_queue {
	uint8_t kind;                   /* enum journal_queue_kind */
	char name[MAP_ADDRESS_SIZE];    /* of the group, or the address */
	uint32_t next[MAP_MODULES_MAX]; /* the first event of each module that is not acknowledged */
};

struct journal_event {
	uint16_t ca;
	uint8_t module;
	uint8_t type; /* enum map_type */
	uint32_t ioa;
	uint32_t number; /* in its module's ring */
	uint32_t value;  /* union map_value's bits */
	uint8_t quality, detail, cause, time;
	int64_t wall_ns;
};

/* ---- writing ----------------------------------------------------------------------------- */

/* A record that grows in memory. size is at least JOURNAL_QUEUES_SIZE. */
struct journal_builder {
	uint8_t *bytes;
	size_t size, used;
	uint32_t events, states; /* states: of these, what retained points and values, and readers, were */
	uint32_t digest;         /* a CRC of these, without times of points */
};

void journal_begin(struct journal_builder *builder, uint32_t number, uint32_t modules,
		   const struct journal_queue *queues, uint32_t queue_count);
/* False: there is no room for another. */
bool journal_add(struct journal_builder *builder, const struct journal_event *event);
/* What a retained point was; number and cause are not looked at. Before all events. False: as above. */
bool journal_keep(struct journal_builder *builder, const struct journal_event *point);
/* A value that a module retains; the same. */
bool journal_keep_value(struct journal_builder *builder, struct map_retained_name name,
			struct map_retained_value value);
/* A place of the history that the journal has reached; false: as above. */
bool journal_place(struct journal_builder *builder, uint32_t start, uint32_t revision, uint32_t next);
/* What is known of a reader of the history, in as few pieces as hold it; false: there is no room for all. */
bool journal_keep_reader(struct journal_builder *builder, uint32_t reader, const uint32_t *octets);
/* Afterwards bytes[0..used) is a record. */
void journal_end(struct journal_builder *builder);

/* ---- reading ----------------------------------------------------------------------------- */

/* A record that was found whole. */
struct journal_record {
	uint32_t modules, queue_count, event_count;
	size_t size;           /* head included */
	const uint8_t *queues; /* queue_count of them, then event_count events */
	const uint8_t *events;
};

/* Looks for the record of that number at bytes. False: it is torn, broken or something else. */
bool journal_parse(const uint8_t *bytes, size_t size, uint32_t number, struct journal_record *out);
/* Takes the queue at *at and moves behind it. */
void journal_take_queue(const struct journal_record *record, const uint8_t **at, struct journal_queue *out);
/* index < event_count */
struct journal_event journal_event(const struct journal_record *record, uint32_t index);

/* Puts a piece of a reader into its octets. False: it is of no reader, or of no place in it. */
bool journal_take_reader(const struct journal_event *piece, struct map_history_reader *readers,
			 uint32_t reader_count);

#endif
