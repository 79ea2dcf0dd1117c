/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * How the segments lie in memory. Private to this room.
 *
 * Every offset follows from the configuration, which rtud alone writes, so each process computes it for itself and
 * believes no other writer's segment about sizes.
 */
#ifndef OPENRTU_MAP_LAYOUT_H
#define OPENRTU_MAP_LAYOUT_H

#include "map/latch.h"
#include "map/lines.h"
#include "map/map.h"
#include "map/repeats.h"
#include "map/ring.h"
#include "map/station.h"
#include "map/type.h"

#define MAP_MAGIC    0x5552544Fu /* "ORTU" */
#define CONFIG_MAGIC 0x4352544Fu /* "ORTC" */
#define MAP_LAYOUT   19u         /* raise with every change of what lies in the segments */

/* The first bytes of every segment, written by its owner. */
struct segment_header {
	uint32_t magic; /* this and the next three: written by rtud, and believed in its own segment only */
	uint32_t layout;
	uint32_t fingerprint; /* sizes of all records: catches another compiler's idea of them */
	uint32_t size;
	_Atomic uint32_t generation;             /* of the process that attached last */
	_Atomic uint32_t heartbeat_ms;           /* CLOCK_MONOTONIC, low 32 bits */
	_Atomic uint32_t next_request;           /* id of the next request */
	uint32_t kept;                           /* map_kept_number */
	_Atomic uint32_t forbidden;              /* map_note_forbidden, and one more; 0: none */
	_Atomic uint32_t lost_events;            /* map_count_lost_events */
	_Atomic uint32_t synch[MAP_SYNCH_WORDS]; /* map_synch_say */
	uint32_t made;                           /* for the configuration of this epoch; by rtud */
	_Atomic uint32_t ready;   /* the process that this segment was made for waits for its turn */
	_Atomic uint32_t carried; /* rtud has filled it in with what the former segment held */
	uint32_t request_next[MAP_MODULES_MAX]; /* read so far of each module's requests */
	uint32_t answer_next[MAP_MODULES_MAX];
};

/* A command's state as one latched record. */
struct command_cell {
	map_latch latch;
	uint32_t reserved;
	struct map_command copies[2];
};

/* A counter's total: what makes a reading of the device's value, and the reading that was frozen last. */
struct map_total {
	struct map_sample frozen; /* time_ns 0: never */
	uint32_t offset;          /* the device's value at the last reset */
	uint8_t since;            /* MAP_COUNTER_CARRY, MAP_COUNTER_ADJUSTED since the last freeze */
	uint8_t reserved[3];
};

struct total_cell {
	map_latch latch;
	uint32_t reserved;
	struct map_total copies[2];
};

/* The text that a point has, and the one before or the next: which is which, the point's value says. */
struct text_cell {
	char texts[2][MAP_TEXT_SIZE];
};

/* Parameters of a measured value, each independent of the others and written at once. */
struct parameter_cell {
	_Atomic uint32_t state; /* 1 << enum map_parameter: loaded, of MAP_CYCLIC stopped */
	_Atomic uint32_t values[4];
};

/* An event queue. The counters are read singly; the place is a latched record, so that a crash leaves a whole one. */
struct queue_cell {
	map_latch latch;
	_Atomic uint32_t lost, unacknowledged, used;
	char name[MAP_ADDRESS_SIZE]; /* an address, or empty: free. A group's is in the configuration. */
	uint16_t reserved;
	struct map_queue_place places[2];
};

/* A point that rtud's table forces, as rtud has it. The owner's slot is what both know it by. */
struct force_entry {
	uint32_t module, slot;
	union map_value value;
	uint32_t reserved;
	int64_t since_ns; /* which force it is */
	int64_t until_ns; /* 0: the entry is unused */
};

/* What a forced point shows, and what its owner says meanwhile: two copies, by the latch of the point's set. */
struct cover {
	_Atomic uint32_t slot; /* and one more; 0: the cover is unused */
	uint32_t reserved;
	int64_t since_ns; /* of the entry that it is for */
	struct map_sample shown, below[2];
};

/* A counter of the module's own section that has a name. */
struct counter_entry {
	char name[MAP_COUNTER_SIZE];
	_Atomic uint32_t place; /* in words of that section, and one more; 0: there is none */
	uint32_t carried;       /* of a name without a place: what the former process had counted */
};

/* A module as the configuration has it: what its segment looks like. */
struct module_entry {
	struct map_module_plan plan;
	uint32_t set_count;
	uint32_t point_count; /* with those that are gone */
	uint32_t live_count;  /* without them */
	uint32_t command_count;
	uint32_t total_count;
	uint32_t parameter_count;
	uint32_t text_count;
	uint32_t first_owned; /* its points, by their slots, from there on in the table of owned points */
	uint32_t made;        /* the epoch for which its segment was made, which is in the file's name */
};

/* How a module is, as rtud knows it. In rtud's segment. */
struct module_status {
	_Atomic uint32_t state; /* enum map_module_state */
	_Atomic uint32_t pid;
	_Atomic uint32_t generation;
	_Atomic uint32_t restarts;
	_Atomic uint32_t started_s; /* CLOCK_MONOTONIC */
	uint32_t restored;          /* events from the journal, which are the first of its ring */
};

/* A section of the configuration, of which the file has the records. */
struct section_entry {
	uint32_t id, record_size, count;
};

/*
 * The first bytes of a configuration's file, which nobody writes to once it is there. A changed configuration is another
 * file, of the next epoch: who has mapped the former one may go on with it.
 */
struct config_header {
	uint32_t magic, layout, fingerprint, size; /* as in segment_header */
	uint32_t epoch;
	uint32_t set_count, point_count, gone_set_count, gone_point_count, names_size, section_count;
	uint32_t module_count;
	struct map_settings settings;
	struct section_entry sections[MAP_SECTIONS_MAX];
	struct module_entry modules[MAP_MODULES_MAX];
};

/* Where the tables of a configuration's file begin. */
struct config_layout {
	size_t sets, points, by_address, owned, names;
	size_t sections[MAP_SECTIONS_MAX];
	size_t size;
};

/* What rtud's segment holds besides the sections that every segment has. */
struct directory {
	_Atomic uint32_t epoch;  /* of the configuration in force */
	_Atomic uint32_t starts; /* map_starts */
	_Atomic uint32_t select_timeout_s,
	    command_timeout_s; /* of that configuration, for all that go on in another */
	map_latch clock_latch;
	struct map_clock clock[2];
	map_latch forces_latch;
	uint32_t reserved;
	struct force_entry forces[2][MAP_FORCES_MAX];
	struct module_status modules[MAP_MODULES_MAX];
};

/* Where the sections of one segment begin; 0 where it has none. */
struct layout {
	size_t directory; /* rtud's only, first */
	size_t requests, answers, events, log;
	size_t latches; /* one a set of the module's */
	size_t samples[2];
	size_t commands, totals, parameters, texts, covers;
	size_t queues;
	size_t own, counters;
	size_t size;
	struct map_rings rings;
};

/* One segment as mapped here. */
struct segment {
	struct segment_header *header;
	struct ring requests, answers, events, log;
	map_latch *latches;
	struct map_sample *samples[2];
	struct command_cell *commands;
	struct total_cell *totals;
	struct parameter_cell *parameters;
	struct text_cell *texts;
	struct cover *covers; /* MAP_FORCES_MAX; NULL: it owns no points */
	struct queue_cell *queues;
	void *own; /* map_section */
	struct counter_entry *counters;
	size_t size;
	int bell;
};

/* What a point's last event said; private to its owner. */
struct reported {
	union map_value value;
	uint8_t quality, detail;
	bool valid;
};

/* Where a measured value's filter is; private to its owner. */
struct smoothed {
	double value;
	int64_t time_ns; /* 0: it begins with what was published last */
};

struct map {
	int directory_fd; /* of the map's folder; rtud holds its lock through it */
	uint32_t self;
	struct directory *directory;
	const struct config_header *file;   /* of the configuration that is in use here */
	const struct config_header *before; /* of the one before, until map_forget; NULL: none */
	uint32_t followed;                  /* epoch of the requesters: requesters_follow */
	uint32_t module_count;
	struct module_entry
	    modules[MAP_MODULES_MAX]; /* the file's, and of another epoch those of requesters */
	struct map_config config;     /* its arrays lie in the file */
	const uint32_t *by_address;
	const uint32_t *owned; /* points, by module and slot */
	struct segment segments[MAP_MODULES_MAX];
	struct reported *reported;
	struct smoothed *smoothed;
	int64_t cycle_ns; /* when the caller's loop began its cycle, 0: it has not said */
	uint32_t cycle_ms;
	uint32_t named;                     /* counters of the own section */
	int64_t ticked_s;                   /* wall time of the last map_totals_tick, 0: none yet */
	uint32_t taken;                     /* requests and answers since the bell was cleared */
	uint32_t taken_of[MAP_MODULES_MAX]; /* of them, requests of a module with MAP_REQUESTS_LISTED */
	map_modules refused;                /* modules of which the log has a request that it may not make */
	uint32_t covers;                    /* own points that are forced */
	uint32_t forces_seen;               /* sequence of rtud's table that the covers follow */
	uint32_t load;               /* what others have given this module to do in this period, in records */
	struct map_lines lines;      /* of the own log */
	struct map_repeats withheld; /* of them, as the log says it */
	struct map_lines *commanded; /* lines about commands, by own command */
	uint32_t commanded_count;
};

uint32_t layout_fingerprint(void);
/* The sections of a module's segment. */
struct layout layout_of(const struct module_entry *entry);
struct config_layout config_layout_of(const struct map_config *config);
void segment_place(struct segment *segment, void *memory, const struct layout *layout);

/* ---- map.c: files ------------------------------------------------------------------------ */

#define FILE_NAME_SIZE (MAP_NAME_SIZE + 20)

/* Their names in the map's folder. */
void segment_file(char name[FILE_NAME_SIZE], const char *module, uint32_t made);
void bell_file(char name[FILE_NAME_SIZE], const char *module);
void config_file(char name[FILE_NAME_SIZE], uint32_t epoch);
/* Writes the message and returns -1. */
__attribute__((format(printf, 2, 3))) int map_fail(char *error, const char *format, ...);

/* ---- create.c ---------------------------------------------------------------------------- */

/*
 * Creates the configuration's file of that epoch, and the segments and bells that are to be made for it: made says of each
 * module for which epoch its segment was, or is to be.
 */
int config_create(int directory_fd, const struct map_config *config, uint32_t epoch, const uint32_t *made,
		  uint32_t group, char *error);

/* What processes look at that have another configuration than the one in force. */
void settings_put(const struct map *map, const struct map_settings *settings);

/* Removes the files of the map's folder, those whose names have the mark in them; NULL: all. */
void map_sweep(int directory_fd, const char *mark);

/* ------------------------------------------------------------------------------------------ */

static inline uint32_t slot_of(const struct map *map, uint32_t point)
{
	return map->config.points[point].slot;
}
/* The point in a slot of its owner; MAP_NONE: it has no such slot. */
static inline uint32_t point_in(const struct map *map, uint32_t module, uint32_t slot)
{
	const struct module_entry *entry = &map->modules[module];

	return slot < entry->point_count ? map->owned[entry->first_owned + slot] : MAP_NONE;
}
static inline map_latch *latch_of(const struct map *map, uint32_t point)
{
	const struct map_set *set = &map->config.sets[map->config.points[point].set];

	return &map->segments[set->module].latches[set->latch];
}

/* The cover of a slot of that segment; NULL: it is not forced. */
static inline struct cover *cover_in(const struct segment *segment, uint32_t slot)
{
	for (unsigned i = 0; segment->covers != NULL && i < MAP_FORCES_MAX; i++)
		if (atomic_load_explicit(&segment->covers[i].slot, memory_order_acquire) == slot + 1)
			return &segment->covers[i];
	return NULL;
}

/* Rings the bell of a module; a full pipe has been heard already. */
void bell_ring(const struct map *map, uint32_t module);
void bell_ring_event_readers(const struct map *map);

/* CLOCK_MONOTONIC in words that any core stores at once. The first wraps after 49.7 days: for differences only. */
uint32_t now_ms(void);
uint32_t now_s(void);
/* Whether a time in another's segment can be true. One that lies ahead would overflow sums, and pass later events. */
bool is_past(const struct map *map, int64_t time_ns);

/* A command for an own point has ended. */
void command_log_end(struct map *map, uint32_t point, const struct map_command *command);

/* Lines of the own log that were left out are said, when it is time. */
void log_say_withheld(struct map *map, int64_t now_ns);

/* What attaching as an owner repairs after a former generation. */
void points_recover(struct map *map);
void commands_recover(struct map *map);
void totals_recover(struct map *map);

/* Carries out a MAP_FREEZE. False: it is none of enum map_freeze. */
bool totals_freeze(struct map *map, const struct map_request *request);
/* Carries out a MAP_PARAMETER. False: the point has no such parameter, or not this value. */
bool parameter_load(struct map *map, const struct map_request *request);
/* A measured value has crossed one of its limits. */
bool parameters_crossed(const struct map_parameters *parameters, enum map_type type, union map_value from,
			union map_value to);
static inline bool is_measured(const struct map_point *point)
{
	return map_class_of(point) == MAP_CLASS_MEASURED;
}
/* The own cell of a counter. */
struct total_cell *total_own(const struct map *map, uint32_t point);
/* What its owner, who is the only writer, wrote last. */
struct map_total total_current(const struct total_cell *cell);
void total_store(struct total_cell *cell, const struct map_total *total);
/* Makes the reading of what a counter's source says, before it is published; notes an overflow of the reading. */
void total_count(struct map *map, uint32_t point, bool narrow, struct map_sample *sample);
/* Smooths a measured value before it is published. */
void parameter_smooth(struct map *map, uint32_t point, struct map_sample *sample);
/* An update's flag within this room: the sample is what shall be published. */
#define UPDATE_AS_IS (1u << 7)
/* What others read of an own point: of a forced one not what map_own_sample gives. */
struct map_sample shown_sample(const struct map *map, uint32_t point);

/* ---- force.c ----------------------------------------------------------------------------- */

/* Own points show what rtud's table says, from now on. */
void forces_follow(struct map *map);
void forces_recover(struct map *map);
/* rtud: the slots have other numbers in a configuration that follows; MAP_NONE: the point is gone. */
void forces_renumber(const struct map *map,
		     uint32_t (*renumber)(const void *context, uint32_t module, uint32_t slot),
		     const void *context);

/* ---- map.c ------------------------------------------------------------------------------- */

/* An owner that goes on with a former configuration hears modules that request, and rings those that hear of events, as of now. */
void requesters_follow(struct map *map);

/* ------------------------------------------------------------------------------------------ */

/* The kind of an event that was overwritten before its ring grew: nobody is told it, and who had not read it has lost it. */
#define EVENT_OVERWRITTEN 0xff

/* Puts an event of an update, whatever the last one said. */
void event_put(struct map *map, const struct map_update *update);

#endif
