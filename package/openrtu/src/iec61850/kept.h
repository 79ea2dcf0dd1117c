/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What buffered reports are made of: the changes of all points in one order, each with a number, in the section of the module's
 * segment behind its counters. It outlives the process. A buffered report control block is a place in it: an EntryID is the start of
 * the numbers, and a number.
 */
#ifndef OPENRTU_IEC61850_KEPT_H
#define OPENRTU_IEC61850_KEPT_H

#include "iec61850/config.h"
#include "iec61850/stats.h"
#include "map/map.h"

#define IEC61850_RPT_ID_SIZE 130 /* VISIBLE STRING129 */
#define IEC61850_KEPT_BLOCKS 4   /* of a logical device */
#define IEC61850_KEPT_DEVICES                                                                                \
	128 /* that have buffered blocks: the section keeps its size when devices come and go */
#define IEC61850_KEPT_ALL        (IEC61850_KEPT_DEVICES * IEC61850_KEPT_BLOCKS)
#define IEC61850_ENTRY_ID_OCTETS 8

/* A change. */
struct iec61850_entry {
	uint32_t number; /* written last; another one: this entry is no more, or not yet */
	uint32_t point;  /* its place in the model's order */
	uint32_t reason; /* enum iec61850_trigger */
	uint32_t reserved;
	struct map_sample sample;
};

/* Of a control block: what its client has set, and how far it was told. */
struct iec61850_kept_block {
	uint32_t next;  /* number of the first entry that was not told */
	uint32_t floor; /* of the first one that was not purged */
	uint32_t buffer_ms, integrity_ms;
	int64_t told_ns; /* when what was told last happened */
	uint16_t options;
	uint8_t triggers;
	bool overflow; /* entries were lost, which is not told yet */
	char id[IEC61850_RPT_ID_SIZE];
};

/* Which events became entries, and the number of the next one: both move in one step. */
struct iec61850_kept_place {
	struct map_cursor cursor;
	uint32_t next;
};

struct iec61850_kept {
	uint32_t start;    /* another one for each time that the numbers begin anew; 0: they have not begun */
	uint32_t revision; /* of the model that the points are of */
	_Atomic uint32_t which;
	struct iec61850_kept_place places[2];
};

/* Where in the section what is. */
struct iec61850_buffer {
	struct iec61850_kept *kept;
	struct iec61850_kept_block *blocks;
	struct iec61850_entry *entries;
	uint32_t size; /* of entries: a power of two */
	uint32_t next; /* number of the next entry, those among them that are not settled yet */
};

#define IEC61850_ALIGNED(size) (((size) + 7u) & ~(size_t)7u)
#define IEC61850_KEPT_AT       IEC61850_ALIGNED(sizeof(struct iec61850_stats))
#define IEC61850_BLOCKS_AT     (IEC61850_KEPT_AT + IEC61850_ALIGNED(sizeof(struct iec61850_kept)))

#define IEC61850_ENTRIES_AT                                                                                  \
	(IEC61850_BLOCKS_AT + IEC61850_ALIGNED(IEC61850_KEPT_ALL * sizeof(struct iec61850_kept_block)))

/* Octets of the section. config has "iec61850". */
static inline size_t iec61850_section_size(const struct map_config *config)
{
	return IEC61850_ENTRIES_AT +
	       (size_t)iec61850_settings(config)->report_buffer * sizeof(struct iec61850_entry);
}

/*
 * Finds everything in a section of this size. True: the former process has left it, for the same points; false: it begins anew, with
 * start, and the place is the caller's to set.
 */
bool iec61850_buffer_begin(struct iec61850_buffer *buffer, void *section, const struct map_config *config,
			   uint32_t revision, uint32_t start);
/* Adds an entry; it counts, after a crash too, from iec61850_buffer_settle on. */
void iec61850_buffer_add(struct iec61850_buffer *buffer, uint32_t point, uint32_t reason,
			 const struct map_sample *sample);
/* All that was added is from events before this cursor. */
void iec61850_buffer_settle(struct iec61850_buffer *buffer, const struct map_cursor *cursor);
struct map_cursor iec61850_buffer_cursor(const struct iec61850_buffer *buffer);
/* NULL: it is no longer there, or not yet. */
const struct iec61850_entry *iec61850_buffer_entry(const struct iec61850_buffer *buffer, uint32_t number);
/* The number of the first entry that is there, or of the next one. */
uint32_t iec61850_buffer_oldest(const struct iec61850_buffer *buffer);

#endif
