/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What buffered reports are made of: a history of the changes of all points (map/history.h), in the section of the module's
 * segment behind its counters. A buffered report control block is a reader of it: an EntryID is an entry's start and number.
 */
#ifndef OPENRTU_IEC61850_KEPT_H
#define OPENRTU_IEC61850_KEPT_H

#include <assert.h>

#include "iec61850/config.h"
#include "iec61850/stats.h"
#include "map/history.h"

#define IEC61850_KEPT_BLOCKS 4 /* of a logical device whose data sets nobody has chosen */
#define IEC61850_KEPT_DEVICES                                                                                \
	128 /* that have buffered blocks: the section keeps its size when devices come and go */
#define IEC61850_KEPT_ALL        (IEC61850_KEPT_DEVICES * IEC61850_KEPT_BLOCKS)
#define IEC61850_ENTRY_ID_OCTETS 8

/* Of a control block: what its client has set, and how far it was told. */
struct iec61850_kept_block {
	uint32_t next;  /* number of the first entry that was not told */
	uint32_t floor; /* of the first one that was not purged */
	uint32_t buffer_ms, integrity_ms;
	int64_t told_ns; /* when what was told last happened, in wall time */
	uint16_t options;
	uint8_t triggers;
	uint8_t overflow;   /* not 0: entries were lost, which is not told yet */
	int16_t reserved_s; /* ResvTms */
	char id[IEC61850_RPT_ID_SIZE];
};

static_assert(sizeof(struct iec61850_kept_block) <= MAP_HISTORY_READER_SIZE, "a reader holds a block");

struct iec61850_buffer {
	struct map_history history;
	uint32_t next; /* number of the next entry, those among them that are not settled yet */
};

enum iec61850_begun {
	IEC61850_BEGINS_ANEW,
	IEC61850_GOES_ON,       /* behind the events that the former process has taken */
	IEC61850_GOES_ON_LATER, /* of a former gateway: all events of this one are behind it, after a gap */
};

#define IEC61850_HISTORY_AT MAP_HISTORY_ALIGNED(sizeof(struct iec61850_stats))

/* Octets of the section. config has "iec61850". */
static inline size_t iec61850_section_size(const struct map_config *config)
{
	return IEC61850_HISTORY_AT +
	       map_history_size(IEC61850_KEPT_ALL, iec61850_settings(config)->report_buffer);
}

/*
 * Finds everything in a section of this size, which a former process or the journal has filled, for the same points or not. blocks: so
 * many readers are used, the first ones. Where the numbers begin anew or have a gap, start is that of what follows, and the place is the
 * caller's to set.
 */
enum iec61850_begun iec61850_buffer_begin(struct iec61850_buffer *buffer, void *section,
					  const struct map_config *config, uint32_t blocks, uint32_t revision,
					  uint32_t start);
static inline struct iec61850_kept_block *iec61850_buffer_block(const struct iec61850_buffer *buffer,
								uint32_t number)
{
	return (void *)buffer->history.readers[number].octets;
}
/* Adds an entry of what happened then; it counts, after a crash too, from iec61850_buffer_settle on. */
void iec61850_buffer_add(struct iec61850_buffer *buffer, uint32_t point, uint8_t reason,
			 const struct map_sample *sample, int64_t noted_ns);
/* All that was added is from events before this cursor. */
void iec61850_buffer_settle(struct iec61850_buffer *buffer, const struct map_cursor *cursor);
struct map_cursor iec61850_buffer_cursor(const struct iec61850_buffer *buffer);
/* NULL: it is no longer there, or not yet. */
const struct map_history_entry *iec61850_buffer_entry(const struct iec61850_buffer *buffer, uint32_t number);
/* The start of the entry of that number, that it had if it is no longer there. */
uint32_t iec61850_buffer_start(const struct iec61850_buffer *buffer, uint32_t number);
/* The number of the first entry that is there, or of the next one. */
uint32_t iec61850_buffer_oldest(const struct iec61850_buffer *buffer);
/* The number of the first entry that waits for a block, or of the next one. overflow: some that waited are lost. */
uint32_t iec61850_buffer_first(const struct iec61850_buffer *buffer, const struct iec61850_kept_block *block,
			       bool *overflow);

#endif
