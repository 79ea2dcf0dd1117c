/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The point map: what module processes know of each other.
 *
 * One shared segment a module, written by that module alone and mapped read-only by all others
 * (docs/architecture.md). rtud creates all segments, and its own carries the configuration, the
 * module table and the clock. Whoever attaches without a module name is an observer and writes nothing.
 *
 * Values are published through a latch (latch.h), events, requests, answers and log lines through
 * rings (ring.h). No call here blocks or allocates, except map_create, map_attach and map_detach.
 *
 * Times are CLOCK_MONOTONIC nanoseconds unless a name says wall. The wall time is the map's clock.
 */
#ifndef OPENRTU_MAP_H
#define OPENRTU_MAP_H

#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#include "codes.h"
#include "config.h"
#include "time_ns.h"
#include "value.h"

#define MAP_NONE                    UINT32_MAX
#define MAP_ERROR_SIZE              256
#define MAP_PATH_SIZE               256 /* of the path in the section of who asks for MAP_RELOAD; empty: rtud's file */
#define MAP_REPORT                  "rtud.report" /* in the map's folder: what came of it */
#define MAP_SETUP_FILES             "setup."      /* begin the names of those of MAP_SETUP */
#define MAP_HEARTBEAT_PERIOD_MS     25   /* how often a module that owns points calls map_heartbeat */
#define MAP_HEARTBEAT_LIMIT_MS      100  /* an owner silent for longer has no valid points; configurable */
#define MAP_IDLE_HEARTBEAT_LIMIT_MS 5000 /* the same for a module without points: it may sleep */
#define MAP_PAST_DAYS               400  /* what is older is no event's time */
#define MAP_RTUD                    0    /* rtud's index in the module table */
#define MAP_FORCES_MAX              16   /* points that are forced at once */

struct map;

/* ---- values ------------------------------------------------------------------------------ */

enum map_quality { MAP_GOOD = 0, MAP_QUALITIES(MAP_CODE) };
#define MAP_QUALITY_BITS (0 MAP_QUALITIES(MAP_OR_CODE))

/* What a frozen reading of a counter says beside its value, where the BCR has it (IEC 60870-5-101, 7.2.6.9). */
enum map_counter_detail {
	MAP_COUNTER_SEQUENCE = 0x1f, /* number of the freeze, modulo 32 */
	MAP_COUNTER_CARRY = 0x20,    /* it overflowed in the period that the freeze ended */
	MAP_COUNTER_ADJUSTED = 0x40, /* it was reset in that period, by request or at the device */
	MAP_COUNTER_FROZEN = 0x80,   /* of an event: it is a freeze, no change of quality; no BCR has it */
};

struct map_sample {
	union map_value value; /* which member: enum map_type */
	uint8_t quality;       /* enum map_quality, or-ed */
	uint8_t detail;        /* MAP_STEP: bit 0 transient; MAP_COUNTER: enum map_counter_detail */
	uint16_t reserved;
	int64_t time_ns; /* acquisition */
};

/* ---- modules ----------------------------------------------------------------------------- */

enum map_module_state { MAP_MODULE_STATES(MAP_CODE) };

struct map_module {
	char name[MAP_NAME_SIZE];
	char kind[MAP_KIND_SIZE];
	uint32_t flags; /* enum map_module_flag */
	uint32_t user;  /* as planned */
	uint8_t state;  /* enum map_module_state, as rtud sees it */
	bool alive;     /* derived: running, right generation, heart beats */
	int32_t pid;
	uint32_t generation; /* how often it was started */
	uint32_t restarts;   /* how often after a failure */
	uint32_t heartbeat_age_ms;
	uint32_t point_count;
	uint32_t lost_events; /* events this module read too late */
	int64_t started_ns;
};

/* ---- create, attach ---------------------------------------------------------------------- */

/*
 * Creates the segments of config->modules in the directory dir (on a tmpfs), and attaches as rtud, the first of them. Only
 * rtud calls it. Fills in points[].slot, .command and .extra, in config and in the map. Segments and folder belong to the
 * caller's user; group, unless 0, is the modules' and may read the segments and ring the bells.
 * Returns 0, or -1 with a message in error (MAP_ERROR_SIZE bytes).
 */
int map_create(struct map **map, const char *dir, const struct map_config *config, uint32_t group,
	       char *error);

/*
 * Attaches to the map in dir as the module of that name (own segment writable, by the descriptor that rtud left
 * or else by name, generation taken over from the module
 * table, unfinished updates of the previous generation repaired, own points invalid), or as an observer when module is NULL.
 * Fails with a message for another layout version, a missing map, or a module that is not in the table.
 */
int map_attach(struct map **map, const char *dir, const char *module, char *error);
void map_detach(struct map *map);

/*
 * rtud has put another configuration into force (docs/reload.md). Who reads others' points takes it when he is ready for it,
 * and until then sees what was not changed as before. Modules keep their numbers; points and sets get others.
 */
bool map_is_changed(const struct map *map);
/*
 * Takes it. before is what map_config said until now; what it refers to stays readable until map_forget, or the next time.
 * 0, or -1 with a message in error (MAP_ERROR_SIZE bytes) and everything as it was.
 */
int map_renew(struct map *map, struct map_config *before, char *error);
void map_forget(struct map *map);
/* The number that a point of before has now, known by its addresses; MAP_NONE: it is gone. */
uint32_t map_number_now(const struct map *map, const struct map_config *before, uint32_t point);

const struct map_config *map_config(const struct map *map);
/* Of all protocols, as the configuration in force has them, whichever is in use here. */
uint32_t map_select_timeout_s(const struct map *map);
uint32_t map_command_timeout_s(const struct map *map);
uint32_t map_self(const struct map *map); /* own index in the module table, MAP_NONE for an observer */
uint32_t map_module_count(const struct map *map);
/* What is known of a module. index < map_module_count. */
void map_module(const struct map *map, uint32_t index, struct map_module *out);
bool map_alive(const struct map *map, uint32_t module);
/* The first module of a kind; MAP_NONE: there is none. */
uint32_t map_module_of_kind(const struct map *map, const char *kind);
/* There is one, and it is alive. */
bool map_kind_alive(const struct map *map, const char *kind);
/* So many events were overwritten before this module read them: map_module shows the sum. */
void map_count_lost_events(struct map *map, uint32_t events);
/* How often all modules were started together: 1, and one more with each MAP_RESTART. */
uint32_t map_starts(const struct map *map);
/* A number in the own segment, 0 at first, that survives the module's restart: what it means is the module's. */
uint32_t *map_kept_number(struct map *map);
/* This process has made a system call that its filter forbids; -1: it has not. For rtud, which finds it dead. Signal-safe. */
void map_note_forbidden(struct map *map, int call);
/* How old a module's heartbeat may be. */
uint32_t map_heartbeat_limit_ms(const struct map *map, uint32_t module);
/* How old it may become until rtud takes the module for hung, and kills it. */
uint32_t map_patience_ms(const struct map *map, uint32_t module);
uint32_t map_owner(const struct map *map, uint32_t point);
/* The number of the configuration that is in use here. */
uint32_t map_epoch(const struct map *map);
/* Finds a point by common address and IOA; MAP_NONE when there is none. O(log n). */
uint32_t map_find(const struct map *map, uint16_t ca, uint32_t ioa);

/* "I run." Own segment; every MAP_HEARTBEAT_PERIOD_MS by an owner of points, each second by others. */
void map_heartbeat(struct map *map);
/* The same for who has just read the clock: on ARMv5 that is a system call. */
void map_heartbeat_at(struct map *map, int64_t now_ns);
/* False once rtud has ended this generation: the module must exit. (When rtud itself goes, the kernel ends the module.) */
bool map_may_run(const struct map *map);

/* ---- points ------------------------------------------------------------------------------ */

/*
 * Reads a point: stored quality, plus invalid when its owner is not alive. False when a writer overtook
 * every one of a bounded number of tries (out is then not written): try again later.
 */
bool map_read(const struct map *map, uint32_t point, struct map_sample *out);
/* The same of several points of one set, as one publishing has left them. */
bool map_read_together(const struct map *map, const uint32_t *points, size_t count, struct map_sample *out);

/* What somebody has read of a set. All zero: nothing yet. */
struct map_seen {
	uint32_t sequence; /* of the set's latch */
	bool alive;        /* its owner was */
	bool whole;        /* false: a writer overtook every try */
};

/*
 * The same for who reads the same points again and again. False when out was not written: what was read before holds still
 * if seen->whole says so.
 */
bool map_read_changed(const struct map *map, const uint32_t *points, size_t count, struct map_seen *seen,
		      struct map_sample *out);

/* What the owner of a point has said last, whether it lives or not, and whether the point is forced or not. False: as map_read. */
bool map_read_own(const struct map *map, uint32_t point, struct map_sample *out);

enum map_cause { MAP_CAUSES(MAP_CODE) };

/* Whether a spontaneous update is an event. */
enum map_event_rule {
	MAP_EVENT_BY_CHANGE,  /* its quality changed, or its value left the deadband around the last event */
	MAP_EVENT_BY_QUALITY, /* its quality changed: its owner says itself when its value is worth one */
	MAP_EVENT_ALWAYS,
};

enum map_update_flag {
	MAP_UPDATE_KEEPS_VALUE = 1u << 0, /* only quality and time are new: the sample's value is not read */
	MAP_UPDATE_NARROW = 1u << 1,      /* of a counter that has 16 bits at its source */
	MAP_UPDATE_PAST = 1u << 2,        /* of before what is published: an event, and no state */
};

struct map_update {
	uint32_t point;
	uint8_t cause;      /* enum map_cause */
	uint8_t flags;      /* enum map_update_flag */
	uint8_t event_rule; /* enum map_event_rule */
	uint8_t reserved;
	struct map_sample sample;
};

/*
 * Publishes new samples of points of one set in one step: readers see all or none. Each point is among them once at most.
 * Makes an event of each point whose update's rule says so, or whose update is return information: whoever commanded sees
 * what became of it, also when nothing changed. Owner only.
 *
 * A sample's value is what its source says: of a measured value with a loaded smoothing, what the filter makes of it is
 * published; of a counter the reading, which is the source's value less what it was at the last reset, modulo 2^32, since the
 * source itself is never written. A source that falls back has been reset or exchanged: the reading begins anew with it, and
 * is adjusted. A narrow counter's reading goes on where that wraps, which must be published before it has counted 32 768; when
 * it falls back further, the reading goes on from where it was, and is adjusted. An invalid sample changes no reading.
 *
 * A state never goes back in time: whoever is told a point by two ways, as an interrogation and a station's events, says of an
 * event of before that it is past. An owner judges that by its source's order; the map does not compare times, since a source's
 * clock may be set.
 */
void map_publish(struct map *map, const struct map_update *updates, size_t count);

/* What its owner has published last of an own point, whether it is forced or not. Owner only. */
struct map_sample map_own_sample(const struct map *map, uint32_t point);

/* ---- forced points ----------------------------------------------------------------------- */

/* A point that shows a value of whoever acts on site, as substituted, until a moment. Its owner goes on below. */
struct map_force {
	uint32_t point;
	union map_value value;
	int64_t since_ns, until_ns;
};

/* The forces that there are. Returns how many. */
unsigned map_forces(const struct map *map, struct map_force out[MAP_FORCES_MAX]);
/* What the owner of a forced point says meanwhile. False: it is not forced, or cannot be read now. */
bool map_read_below(const struct map *map, uint32_t point, struct map_sample *out);
/* Why a point cannot be forced, as it goes on behind its name; NULL: it can. */
const char *map_unforceable(const struct map_config *config, uint32_t point);

/* ---- events ------------------------------------------------------------------------------ */

enum map_event_kind {
	MAP_EVENT_CHANGE,      /* point, sample */
	MAP_EVENT_MODULE_DOWN, /* point is a module's index: all its points are invalid since sample.time_ns */
	MAP_EVENT_MODULE_UP,   /* point is a module's index: its points may be valid again, read them */
	MAP_EVENT_CLOCK,       /* the map's clock was set */
};

/* What an event's time is. The monotonic clock begins anew with each start, the events of an earlier one do not. */
enum map_event_time {
	MAP_TIME_MONOTONIC,
	MAP_TIME_WALL,       /* since 1970, UTC */
	MAP_TIME_WALL_UNSET, /* the same by a clock that was never set */
};

struct map_event {
	uint32_t point;
	uint8_t kind;  /* enum map_event_kind */
	uint8_t cause; /* MAP_EVENT_CHANGE: enum map_cause */
	uint8_t time;  /* enum map_event_time; not monotonic: restored from the journal */
	uint8_t past;  /* by MAP_UPDATE_PAST: the point was newer already */
	struct map_sample sample;
};

/* A place in every module's event ring. A plain value: copy it to look ahead, assign it back to commit. */
struct map_cursor {
	uint32_t next[MAP_MODULES_MAX];
	uint32_t lost; /* events overwritten before they were read, since map_cursor_to_end */
};

/* Sets the cursor behind the newest event: all before count as read. */
void map_cursor_to_end(const struct map *map, struct map_cursor *cursor);
/* How many events are behind the cursor, those among them that nobody would believe or that are overwritten. */
uint32_t map_events_behind(const struct map *map, const struct map_cursor *cursor);
/* The oldest event behind the cursor, over all modules, those restored from the journal first, and moves on. False: there is none now. */
bool map_event_next(const struct map *map, struct map_cursor *cursor, struct map_event *out);
/* The same of one module alone. */
bool map_event_next_of(const struct map *map, struct map_cursor *cursor, uint32_t module,
		       struct map_event *out);

/* ---- bells ------------------------------------------------------------------------------- */

/*
 * A descriptor for poll/epoll that becomes readable when another module has left something: events (for
 * rtu-iec104 and other readers of events), requests, answers. map_bell_clear before looking, or a ring is missed.
 */
int map_bell_fd(const struct map *map);
/* True: it was rung since the last time. */
bool map_bell_clear(struct map *map);
/* The same for who looks at every turn, rung or not: it costs a system call only if something was taken since. */
void map_bell_clear_if_taken(struct map *map);
/*
 * For a module with real-time priority, which a ring takes to the core at once: rings, and what was taken after them, count
 * by periods of its own timer. True: it is so much in this one that whoever rings has gone wild; the bell is not to be
 * waited for until the next one, when all that was left is still there.
 */
bool map_bell_is_wild(const struct map *map);
void map_bell_new_period(struct map *map);

/* ---- synchronisation --------------------------------------------------------------------- */

#define MAP_SYNCH_WORDS 32

/*
 * A word of the own segment for the module that coordinates scans (MAP_COORDINATES), which is rung. number: of the participant,
 * below MAP_SYNCH_WORDS; what the word says is theirs. It stays there when the process ends.
 */
void map_synch_say(struct map *map, uint32_t number, uint32_t word);
/* What a module has said last; 0: nothing yet. */
uint32_t map_synch_said(const struct map *map, uint32_t module, uint32_t number);
/* Its answer, which is in the section of the coordinator's own, is there. */
void map_synch_ring(const struct map *map, uint32_t module);

/* ---- commands ---------------------------------------------------------------------------- */

enum map_command_state { MAP_COMMAND_STATES(MAP_CODE) };

enum map_command_result { MAP_COMMAND_RESULTS(MAP_CODE) };

enum map_action {
	MAP_SELECT,
	MAP_EXECUTE,
	MAP_CANCEL,    /* interrupts the selection */
	MAP_RELEASE,   /* the requester has seen the final state: back to inactive; no answer */
	MAP_SET_CLOCK, /* to rtud: the wall time at time_ns was wall_ns */
	MAP_RESTART,   /* to rtud: stops all modules and starts them anew, soon after its answer */
	MAP_FREEZE,    /* to an owner of counters: detail is enum map_freeze, value.u which counters */
	MAP_PARAMETER, /* detail is enum map_parameter; value as the point has it, of MAP_CYCLIC 0 or 1 */
	MAP_RELOAD, /* to rtud, by who acts on site: the file that his section names; detail 1: only to check it */
	MAP_MODULE, /* to rtud, by a module that acts for people on site: point is a module, detail enum map_wish */
	MAP_FORCE, /* to rtud, by such a module: point shows value for hold_ms; 0: it is no longer forced */
	MAP_SETUP, /* to rtud, by a module that MAP_ASKS_SETUP: what its section says, detail is enum setup_wish */
};

/* What rtud shall do with a module's process. One that is stopped stays so until it is started, or rtud is. */
enum map_wish { MAP_WISH_STOP, MAP_WISH_START, MAP_WISH_RESTART };

/* The parameters of a measured value, as KPA of the QPM numbers them (IEC 60870-5-101, 7.2.6.24), and its cyclic transmission. */
enum map_parameter { MAP_THRESHOLD = 1, MAP_SMOOTHING, MAP_LOW_LIMIT, MAP_HIGH_LIMIT, MAP_CYCLIC };

/* What a freeze does, as FRZ of the QCC has it (IEC 60870-5-101, 7.2.6.23). */
enum map_freeze { MAP_FREEZE_ONLY = 1, MAP_FREEZE_AND_RESET = 2, MAP_RESET_ONLY = 3 };

/* Which counters a MAP_FREEZE means, in value.u: those of the point's device, or of all of its owner's. */
#define MAP_FREEZE_GROUP       0xffu /* only of this counter group; 0: of any */
#define MAP_FREEZE_ALL_DEVICES 0x100u

struct map_request {
	uint32_t id;         /* given by map_request_post */
	uint32_t point;      /* MAP_NONE for MAP_SET_CLOCK, MAP_RESTART; a module for MAP_MODULE */
	uint32_t generation; /* of the owner it was meant for; given by map_request_post */
	uint16_t requester;  /* module index; given by map_request_post */
	uint8_t action;      /* enum map_action */
	uint8_t detail;      /* MAP_STEP: bit 0 transient; MAP_FREEZE, MAP_PARAMETER, MAP_MODULE: see there */
	uint32_t
	    session; /* who in the requester selected: connection and originator; compared, not understood. MAP_FORCE: map_epoch */
	union map_value value;
	uint16_t pulse_ms; /* of a coil: the value for so long, then off; 0: persistent */
	int8_t step;       /* -1 lower, 1 higher: by the point's step from its last value; value is 0 then */
	uint8_t owner;     /* whom it is for; given by map_request_post */
	int64_t time_ns;   /* when it was issued */
	int64_t deadline_ns; /* refused when not begun by then */
	int64_t wall_ns;     /* MAP_SET_CLOCK: since 1970, UTC */
	int64_t hold_ms;     /* MAP_FORCE */
	/* The point's addresses, by which an owner of another configuration knows it; given by map_request_post. */
	uint32_t ioa;
	uint16_t ca;
	uint8_t reserved[2];
};

struct map_answer {
	uint32_t id;
	uint32_t point;
	uint16_t requester;
	uint8_t state;  /* enum map_command_state */
	uint8_t result; /* enum map_command_result */
	uint8_t detail; /* exception code */
	uint8_t action; /* of the request it answers */
	uint8_t reserved[2];
	int64_t time_ns;
};

struct map_command {
	uint8_t state;  /* enum map_command_state */
	uint8_t result; /* enum map_command_result */
	uint8_t detail;
	int8_t step;       /* as requested */
	uint16_t pulse_ms; /* as requested */
	uint16_t requester;
	uint32_t id;
	uint32_t session;
	uint32_t generation; /* of the requester's module */
	union map_value value;
	int64_t time_ns;  /* of the last change of state */
	int64_t until_ns; /* end of the selection */
	int64_t off_ns;   /* when the pulse's end is due at the device; 0: none is */
};

/*
 * Posts a request in the own segment and rings the owner. Returns its id, or 0 when the owner is not
 * alive (nothing was posted: answer negative). Exactly one answer follows while the owner lives, except
 * MAP_RELEASE, which has none. A MAP_EXECUTE is answered by MAP_EXECUTING when it begins, MAP_EXECUTING with
 * MAP_RESULT_DONE when the device has confirmed it, and the end, before which the return information was published. An
 * owner's MAP_EVENT_MODULE_DOWN is the answer to all that is open at it: unknown fate.
 */
uint32_t map_request_post(struct map *map, struct map_request request);
/*
 * The next request for this module. It is gone from the queue before it is returned, so that no crash repeats it. False:
 * there is none, or so many were taken since map_bell_clear that the own bell was rung and the caller's loop shall go
 * round first: a requester gone wild holds nobody up.
 */
bool map_request_next(struct map *map, struct map_request *out);

/*
 * Runs a request to a point's command through the state machine and answers it. True: the owner shall now write the
 * value to the device and call map_command_finish. Owner only.
 */
bool map_command_request(struct map *map, const struct map_request *request);
/* The device has confirmed an executing command, which goes on: to its read-back, or to the end of its pulse. Owner only. */
void map_command_confirm(struct map *map, uint32_t point);
/*
 * When the pulse of a point must be ended at the device; 0: it has none, or it was ended. While there is one, all other
 * commands of the point are refused, whatever became of the one that began it; it outlives the owner's process, and
 * what that left executing with a pulse is to be ended at once. Owner only.
 */
void map_pulse_set_end(struct map *map, uint32_t point, int64_t off_ns);
int64_t map_pulse_end(const struct map *map, uint32_t point); /* of any point: 0 for another's */
/* Ends an executing command with the device's answer. Owner only. */
void map_command_finish(struct map *map, uint32_t point, enum map_command_result result, uint8_t detail);
/* Refuses a selection that map_command_request has not seen: the owner does not want it. Owner only. */
void map_command_refuse(struct map *map, const struct map_request *request, enum map_command_result result);
/* Why the value is sent that a request leaves: by whom the command was. */
enum map_cause map_cause_of(const struct map *map, const struct map_request *request);
/* The next answer to a request of this module. False: as for map_request_next. */
bool map_answer_next(struct map *map, struct map_answer *out);
/* The next answer to a request of any module, for who shows what all do instead of map_answer_next. Others' ring no bell here. */
bool map_answer_of_any_next(struct map *map, struct map_answer *out);
/*
 * The command side of a point. A selection whose time is over, or whose requester's process is another one by now, is
 * interrupted. False as for map_read.
 */
bool map_command_read(const struct map *map, uint32_t point, struct map_command *out);

const char *map_command_state_name(enum map_command_state state);
const char *map_command_result_name(enum map_command_result result);

/* ---- totals ------------------------------------------------------------------------------ */

/*
 * Freezes counters with a period of their own when the map's clock enters a new one, and makes an event of each
 * frozen reading. Each second or so; owner only.
 */
void map_totals_tick(struct map *map);
/*
 * The reading of a counter that was frozen last, with its sequence number; what was true then stays true when
 * its owner dies. A counter that was never frozen: as map_read. False as for map_read.
 */
bool map_total_read(const struct map *map, uint32_t point, struct map_sample *out);

/* ---- parameters of measured values ------------------------------------------------------- */

/* What is in force: what was loaded, or else what the configuration says. */
struct map_parameters {
	uint32_t loaded;           /* 1 << enum map_parameter; MAP_CYCLIC: stopped */
	union map_value values[4]; /* of those loaded, from MAP_THRESHOLD on, as they came */
	double threshold;          /* in the unit of the value, as deadband */
	double smoothing_s;        /* time constant of a first-order filter; 0: none */
	double low, high;          /* crossing either makes an event; infinite: none */
	bool cyclic;               /* is sent periodically */
};

/* Any point; only measured values have anything loaded. */
void map_parameters_read(const struct map *map, uint32_t point, struct map_parameters *out);

/* ---- clock ------------------------------------------------------------------------------- */

/* Where the clock's time is from. */
enum map_clock_source {
	MAP_CLOCK_UNSET,        /* the system's clock at the start, or what nobody vouches for any more */
	MAP_CLOCK_BY_MASTER,    /* a controlling station */
	MAP_CLOCK_SYNCHRONISED, /* the system's clock, which is synchronised */
	MAP_CLOCK_HELD,         /* the same until it was lost; the clock runs on by itself */
};

struct map_clock {
	int64_t offset_ns; /* wall = monotonic + offset, of now: map_wall_ns */
	int64_t leap_ns;   /* when the last leap second was; 0: none since the start */
	int64_t since_ns;  /* the source is this one */
	int64_t seen_ns;   /* the system's was synchronised last */
	int64_t until_ns;  /* of one that is held: time tags are valid until then */
	uint32_t error_us; /* the most that it is wrong, as last known while the system was synchronised */
	int8_t leap_s;     /* what that leap second took off the offset: 1 was inserted, -1 left out */
	int8_t leap_due_s; /* the same of one that comes at the end of this day, 0: none */
	uint8_t source;    /* enum map_clock_source */
	bool set;          /* time tags are valid */
};

int64_t map_now_ns(void); /* CLOCK_MONOTONIC */
/*
 * Begins a cycle of the caller's loop, and gives its time. Until the next one map_read and map_alive take a heartbeat
 * that was young enough then for young enough: reading the clock for each point would be most of an interrogation's
 * cost (ARMv5 has no vDSO). For who reads many points; the cycle shall be short beside MAP_HEARTBEAT_LIMIT_MS.
 */
int64_t map_begin_cycle(struct map *map);
struct map_clock map_clock_read(const struct map *map);

/* The wall time of a moment, of which there may be a leap second since. */
static inline int64_t map_wall_ns(struct map_clock clock, int64_t time_ns)
{
	return time_ns + clock.offset_ns + (time_ns < clock.leap_ns ? clock.leap_s * NS_PER_S : 0);
}

/* When an event happened, by the clock as it is now, or as it was before a power cut. */
static inline int64_t map_event_wall_ns(const struct map_event *event, struct map_clock clock)
{
	return event->time == MAP_TIME_MONOTONIC ? map_wall_ns(clock, event->sample.time_ns)
						 : event->sample.time_ns;
}
/* Whether that clock was set. */
static inline bool map_event_time_is_set(const struct map_event *event, struct map_clock clock)
{
	return event->time == MAP_TIME_MONOTONIC ? clock.set : event->time == MAP_TIME_WALL;
}

/* ---- log --------------------------------------------------------------------------------- */

enum map_log_level { MAP_LOG_LEVELS(MAP_CODE) };

#define MAP_LOG_TEXT_SIZE 112

struct map_log_line {
	int64_t time_ns;
	uint8_t level; /* enum map_log_level */
	uint8_t reserved[3];
	char text[MAP_LOG_TEXT_SIZE];
};

/*
 * Of a module's lines: more at once are left out, and counted in a line. Less than a log keeps. The last of them are for warnings
 * and errors: what is said without end hides no fault.
 */
#define MAP_LOG_AT_ONCE   120
#define MAP_LOG_RESERVED  20
#define MAP_LOG_PERIOD_NS (200 * NS_PER_MS)

/* Writes a line to the own log ring; rtud prints it. Longer text is cut. */
void map_log(struct map *map, enum map_log_level level, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/*
 * The next line of a module's log behind *position, without control characters. *lost grows by the lines that were overwritten
 * before it, which are skipped.
 */
bool map_log_next(const struct map *map, uint32_t module, uint32_t *position, struct map_log_line *out,
		  uint32_t *lost);

/* ---- a module's own section --------------------------------------------------------------- */

/*
 * What a module shows of itself beside its points: so many octets of its segment as its kind asks for, all zero at first. Its
 * owner writes them, others read them. Their meaning is the kind's. NULL: it has none of this size.
 */
void *map_section(const struct map *map, uint32_t module, size_t size);

#define MAP_COUNTER_SIZE 32 /* of a counter's name, terminator included */

/* A counter, as its module shows it. */
struct map_counter {
	char name[MAP_COUNTER_SIZE];
	uint32_t value;
};

/*
 * Names a counter in the own section, so that others can show it without knowing the section. A process names its counters once,
 * in the same order each time. Longer names are cut. False: it has named as many as its plan says.
 */
bool map_name_counter(struct map *map, const _Atomic uint32_t *counter, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* A module's named counter, number 0 and on, with a printable name. False: it has no more. */
bool map_counter(const struct map *map, uint32_t module, uint32_t number, struct map_counter *out);

/*
 * How often durations were how long: below 1 us, then number i from 2^(i-1) to below 2^i us, the last whatever is
 * longer.
 */
#define MAP_BUCKETS 21
struct map_histogram {
	_Atomic uint32_t counts[MAP_BUCKETS];
	_Atomic uint32_t longest_us;
};

static inline uint32_t map_bucket_of(int64_t us)
{
	uint32_t bucket = 0;

	while (bucket < MAP_BUCKETS - 1 && us >= INT64_C(1) << bucket)
		bucket++;
	return bucket;
}

/* Adds a duration to a histogram that this process alone writes. */
void map_histogram_add(struct map_histogram *histogram, int64_t duration_ns);

/* How punctual a module is that scans. */
struct map_scans {
	struct map_histogram wakeups;   /* how late it woke at the beginning of a period */
	struct map_histogram durations; /* of a scan, from its inputs to its outputs */
	_Atomic uint32_t count;         /* scans */
	_Atomic uint32_t missed;        /* periods that passed without one */
};

/* Of a module whose plan says MAP_SHOWS_SCANS; NULL: of another. */
const struct map_scans *map_scans_of(const struct map *map, uint32_t module);

/* Adds to a counter that this process alone writes; a plain store, since ARMv5 has no atomic addition. */
static inline void map_count(_Atomic uint32_t *counter, uint32_t by)
{
	atomic_store_explicit(counter, atomic_load_explicit(counter, memory_order_relaxed) + by,
			      memory_order_relaxed);
}

#endif
