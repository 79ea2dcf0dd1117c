/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What only rtud may do to the map: begin and end generations of modules, tell everyone, set the clock.
 */
#ifndef OPENRTU_MAP_SUPERVISE_H
#define OPENRTU_MAP_SUPERVISE_H

#include "map/history.h"
#include "map/map.h"
#include "map/station.h"

#define MAP_SEGMENT_FD 3

/* All modules have been stopped upon MAP_RESTART, and will be started. */
void map_modules_restarting(struct map *map);
/* Begins a new generation, before the process is forked. */
void map_module_starting(struct map *map, uint32_t module);
/* The generation's process; after the fork. */
void map_module_started(struct map *map, uint32_t module, int32_t pid);
/* The process of this generation has attached. */
bool map_module_attached(const struct map *map, uint32_t module);
void map_module_running(struct map *map, uint32_t module);
/* Ends the generation. failed: counts as a restart to come; otherwise it stops on purpose. */
void map_module_ended(struct map *map, uint32_t module, bool failed);
/* What the module says of itself: the number of the forbidden system call that ended it; -1: none did. */
int map_module_forbidden(const struct map *map, uint32_t module);
/* The module's process is being exchanged; its points are as valid as before. */
void map_module_switching(struct map *map, uint32_t module);
/* The process of this generation, or the one that goes on in it, has begun. */
bool map_module_has_taken_over(const struct map *map, uint32_t module);
/* The point shows that value from now on, whatever its owner says. False: MAP_FORCES_MAX points are forced already. */
bool map_force(struct map *map, const struct map_force *force);
/* False: it was not forced. */
bool map_unforce(struct map *map, uint32_t point);
/* Of all segments, in bytes: what each process maps. */
size_t map_size(const struct map *map);
/* Puts MAP_EVENT_MODULE_DOWN, MAP_EVENT_MODULE_UP or MAP_EVENT_CLOCK before all readers of events. */
void map_announce(struct map *map, enum map_event_kind kind, uint32_t module);

/* An event of before a power cut: a change of a point, with a wall time. */
struct map_kept_event {
	struct map_event event;
	uint32_t wanted; /* a bit for each queue that has not acknowledged it */
};

/* A retained point of before a power cut: its value, and a time of now's clock. */
struct map_kept_sample {
	uint32_t point;
	struct map_sample sample;
};

/* The history of before a power cut, and its readers; start 0: there was none. */
struct map_kept_history {
	uint32_t start, revision, next;    /* next: the number behind the last entry */
	struct map_history_entry *entries; /* oldest first, of points that there are, with wall times */
	uint32_t entry_count;
	struct map_history_reader *readers; /* as many as the plan has */
	uint32_t reader_count;
};

/* A value that a module retained before a power cut. */
struct map_kept_value {
	uint32_t name; /* its place in MAP_RETAINED */
	uint32_t low, high;
	uint8_t quality;
};

/* What the journal held. Queues of addresses lie behind the groups', the one unused longest first. */
struct map_kept {
	struct map_kept_event *events; /* oldest first */
	uint32_t event_count;
	struct map_kept_sample *samples;
	uint32_t sample_count;
	struct map_kept_value *values;
	uint32_t value_count;
	struct map_kept_history history;
	char addresses[MAP_QUEUES][MAP_ADDRESS_SIZE]; /* empty: a group's, or none */
};

/*
 * Puts events back into their owners' rings, queues to the places they had, and retained points and values to where the owner's first
 * process finds them as if a former one had left them. After map_create, before any module is started. Returns 0, or -1 with a message in error.
 */
int map_restore(struct map *map, const struct map_kept *kept, char *error);

void map_clock_write(struct map *map, struct map_clock clock);
/* Answers a request that is carried out at once, such as MAP_SET_CLOCK: done, or refused for this reason. */
void map_request_answer(struct map *map, const struct map_request *request, enum map_command_result result);

/*
 * Opens a module's segment for the process that rtud starts: it finds it at MAP_SEGMENT_FD. All segments are files of
 * rtud's user: a module that wrote to the file by name could truncate it too, and SIGBUS every other.
 * Returns a descriptor that is closed on exec, or -1 with errno.
 */
int map_segment_open(const struct map *map, uint32_t module);

/*
 * Whether a map can be made for it: modules, users, sets. size: of all its files, in bytes. Returns 0, or -1 with a message in
 * error.
 */
int map_check(const struct map_config *config, size_t *size, char *error);

/* ---- a configuration that follows another while the modules run: change.c, map.c --------------- */

/* As the configuration in use here plans the module. */
const struct map_module_plan *map_plan_of(const struct map *map, uint32_t module);
bool map_is_gone(const struct map *map, uint32_t module);
/*
 * Creates the files of the configuration that shall follow, in which modules have the numbers that they have; kept: modules
 * that are the same in both. Takes no part in what runs: a process beside rtud may call it.
 * Returns 0, or -1 with a message in error.
 */
int map_prepare(const struct map *map, const struct map_config *config, map_modules kept, uint32_t group,
		char *error);
/* The configuration that is in use here, or so many epochs later, to look at. */
int map_attach_again(struct map **out, const struct map *map, uint32_t later, char *error);
/* The module has a segment of its own in it, and so needs another process. */
bool map_is_made_for(const struct map *next, uint32_t module);
/* That process has attached, and waits until the configuration is in force. */
bool map_module_is_ready(const struct map *next, uint32_t module);
/* A command that the module carries out has not ended, or a pulse of it. */
bool map_has_commands_under_way(const struct map *map, uint32_t module);
/* Modules of a switch, and what becomes of their own sections. */
struct map_switching {
	map_modules valid;    /* their points were */
	map_modules seamless; /* they go on in the generation that they are in, with what was asked of them */
	map_modules again;    /* kept ones that start again in the new configuration */
	/* Of a new segment or one of again: from is what the former process left, to the new one's; NULL: nothing passes over. */
	void (*carry)(const struct map *map, const struct map *next, uint32_t module, const void *from,
		      void *to);
};

/*
 * Puts next into force, once the processes of all modules that it changes or has no more have ended: what they left passes
 * over to the new segments. -1 with a message in error: nothing has changed.
 */
int map_switch(const struct map *map, const struct map *next, const struct map_switching *how, char *error);
/* Removes the files that only the former configuration has. */
void map_unlink_former(const struct map *map, const struct map *next);
/* Removes the files of one that was prepared, or begun to be. */
void map_abandon(const struct map *map);

/* ------------------------------------------------------------------------------------------ */

/* The folder's lock and the segments' files are kept by the process that created them; this removes the files. */
void map_remove(struct map *map);

#endif
