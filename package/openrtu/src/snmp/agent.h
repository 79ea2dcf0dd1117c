/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The agent, without its messages: what OPENRTU-MIB.txt says of the map. It knows neither the wire nor who is who there: a
 * message's user and time are arguments.
 */
#ifndef OPENRTU_SNMP_AGENT_H
#define OPENRTU_SNMP_AGENT_H

#include "map/map.h"
#include "map/type.h"
#include "snmp/config.h"
#include "snmp/machine.h"
#include "snmp/shared.h"
#include "snmp/sink.h"
#include "snmp/tree.h"
#include "snmp/write.h"

/* Points by CA and IOA, as a table has them. */
enum snmp_list {
	SNMP_ALL,
	SNMP_SINGLES,
	SNMP_DOUBLES,
	SNMP_STEPS,
	SNMP_BITSTRINGS,
	SNMP_MEASURED,
	SNMP_TOTALS,
	SNMP_TEXTS,
	SNMP_COMMANDS,
	SNMP_CYCLIC,
	SNMP_GROUPED, /* by interrogation group before that */
	SNMP_LISTS
};

struct snmp_points {
	uint32_t *points;
	uint32_t count;
};

/* A command that came by SNMP, until it is inactive again. */
struct snmp_command {
	uint32_t spin;
	uint8_t state; /* enum map_command_state; MAP_INACTIVE: it is not ours */
	uint8_t result, detail;
	uint8_t user;
	uint32_t id;         /* of the request that is open; 0: none */
	uint32_t number;     /* of the last request */
	uint32_t generation; /* of the point's owner when it was asked */
	int32_t shown;       /* value and qualifier as they were set */
	uint8_t qualifier;
	int64_t issued_ms;          /* as it was set, INT64_MAX: not */
	int64_t time_ns;            /* when it got its state */
	int64_t until_ns;           /* of a selection, or of what is asked */
	struct map_request request; /* as it was selected */
};

/* The counters of a station that can be frozen: a row of rtuFreezeTable. */
struct snmp_freeze {
	uint32_t spin;
	uint16_t ca;    /* 65535: of all stations */
	uint8_t action; /* enum map_freeze, as it was set last */
	uint8_t group;
	uint8_t state; /* enum map_command_state */
	uint8_t result;
};

/* The freeze that is under way, of which there is one at a time. */
struct snmp_freezing {
	uint32_t row;
	map_modules waiting; /* for these owners */
	uint32_t ids[MAP_MODULES_MAX], generations[MAP_MODULES_MAX];
	int64_t until_ns;
};

/* The parameters of a measured value: a row of rtuParameterTable. */
struct snmp_parameter {
	uint32_t spin;
	uint32_t seen; /* a number of what was in force */
	uint8_t result;
};

/* Parameters that were asked of an owner, of one row. */
struct snmp_loading {
	uint32_t row;
	uint32_t first_id, last_id; /* 0: none */
	uint32_t generation;
	int64_t until_ns;
};

/* The points of a common address. */
struct snmp_station {
	uint16_t ca;
	uint32_t first, count; /* in the list of all */
	uint32_t asked;        /* of them, from the first on, while it is not initialised */
};

/* Points that are sent cyclically, or as a background scan: places in their list. */
struct snmp_cyclic {
	uint32_t *turns; /* by place: the last turn that it came in, 0: none yet */
	uint32_t *order; /* places in the order of turn and address */
	uint32_t *spare; /* for another order */
	uint32_t never;  /* places in order that came in no turn */
	int64_t from_ns; /* periods that end behind this are of the next turn */
	int64_t due_ns;  /* when the first of them ends */
};

#define SNMP_IMAGE_POINTS 100 /* of a row of rtuImageTable, at most */

/* Points packed: a row of rtuImageTable, or of rtuGroupTable. */
struct snmp_image {
	uint32_t first; /* place in its list of points */
	uint32_t count;
};

struct snmp_images {
	struct snmp_image *images;
	uint32_t count;
};

/* A setting of the clock. */
struct snmp_clock_setting {
	uint32_t spin;
	uint32_t id; /* of the request that is open; 0: none */
	int64_t set_ms;
	int64_t delay_ms;
	int64_t until_ns;
	uint8_t result;
};

/* What the engine counts of messages, in the order of their objects. */
enum snmp_statistic {
	SNMP_BAD_VERSIONS, /* SNMPv2-MIB */
	SNMP_PARSE_ERRORS,
	SNMP_UNKNOWN_MODELS, /* SNMP-MPD-MIB */
	SNMP_INVALID_MESSAGES,
	SNMP_USM_LEVELS, /* SNMP-USER-BASED-SM-MIB, this and the next five */
	SNMP_USM_WINDOWS,
	SNMP_USM_USERS,
	SNMP_USM_ENGINES,
	SNMP_USM_DIGESTS,
	SNMP_USM_DECRYPTIONS,
};

struct snmp_agent {
	struct map *map;
	const struct map_config *config;
	const struct snmp_settings *settings;
	struct snmp_shared *shared;
	struct snmp_root roots[SNMP_ROOTS];
	struct snmp_points lists[SNMP_LISTS];
	struct snmp_command *commands; /* as the list of commands */
	bool commanded;                /* one of them may be ours */
	struct snmp_freeze *freezes;
	uint32_t freeze_count;
	struct snmp_freezing freezing;
	struct snmp_parameter *parameters; /* as the list of measured values */
	struct snmp_loading loadings[SNMP_ROWS_SET_MAX];
	int64_t compared_ns; /* the parameters were looked at last */
	struct snmp_clock_setting clock_setting;
	struct snmp_station *stations;
	uint32_t station_count, initialised_count;
	struct snmp_cyclic cyclic;
	struct snmp_images images, group_images;
	uint32_t tickets;       /* of selections */
	uint32_t configuration; /* a number of its points */
	int64_t started_ns;
	uint8_t engine_id[32];
	uint8_t engine_id_size;
	uint32_t boots;
	struct snmp_position position;
	struct snmp_sink_run sinks[SNMP_SINKS_MAX];
	struct snmp_machine machine;
	uint32_t (*statistic)(enum snmp_statistic which); /* of the messages, NULL: nobody counts */
	/* What holds for a message. */
	int64_t now_ns;
	struct map_clock clock;
	bool is_clock_master; /* who sent the message */
	uint32_t sampled;     /* the point that was read last, so that a row is of one moment */
	bool sampled_good;
	struct map_sample sample;
};

/* False: there is no memory. */
bool snmp_begin(struct snmp_agent *agent, struct map *map, struct snmp_shared *shared);
void snmp_end(struct snmp_agent *agent);
/* A new message: what is read for it is of now. */
void snmp_new_message(struct snmp_agent *agent);
/* A point's sample, once a row. False: none. */
bool snmp_sample(struct snmp_agent *agent, uint32_t point, struct map_sample *out);
/* Common address of a point. */
static inline uint16_t snmp_ca(const struct snmp_agent *agent, uint32_t point)
{
	return agent->config->sets[agent->config->points[point].set].ca;
}

/* ---- values.c ---------------------------------------------------------------------------- */

#define SNMP_NEVER INT64_MIN /* of a time */

void snmp_put_number(struct snmp_value *out, enum snmp_syntax syntax, int64_t number);
static inline void snmp_put_truth(struct snmp_value *out, bool truth)
{
	snmp_put_number(out, SNMP_INTEGER, truth ? 1 : 2);
}
void snmp_put_text(struct snmp_value *out, const char *text);
/* RtuTime: milliseconds since 1970; SNMP_NEVER: all ones. */
void snmp_put_time(struct snmp_value *out, int64_t time_ms);
/* ... of a moment of this machine, 0: never. */
void snmp_put_moment(const struct snmp_agent *agent, struct snmp_value *out, int64_t time_ns);
/* RtuQuality: the QDS, whose bits are BITS; of a counter what its BCR says besides. */
void snmp_put_quality(struct snmp_value *out, uint8_t quality, uint8_t counter_detail);
void snmp_put_float(struct snmp_value *out, float number);
/* RtuInformationType. */
int64_t snmp_type_number(enum map_type type);
/* A value as rtuSingleValue, … rtuTotalValue have it. */
int64_t snmp_shown_value(enum map_type type, unsigned decimals, union map_value value);
/* Decimals in rtuMeasuredValue. */
unsigned snmp_decimals(const struct map_point *point);
/* What they multiply a float with. */
double snmp_scale(unsigned decimals);
float snmp_float_of(enum map_type type, union map_value value);

/* ---- events.c ---------------------------------------------------------------------------- */

/* Goes on where a former process of the module ended. */
void snmp_events_begin(struct snmp_agent *agent);
/* Numbers what the map has new. True: there is more. */
bool snmp_events_take(struct snmp_agent *agent);
/* Numbers an event of the agent's own. */
void snmp_event_add(struct snmp_agent *agent, const struct snmp_event *event);
/* ... that happens now. */
void snmp_event_add_now(struct snmp_agent *agent, struct snmp_event event);
/* The fields of an event that say which point it is of. */
#define SNMP_OF_POINT(agent, point_)                                                                         \
	.ca = snmp_ca(agent, point_), .ioa = (agent)->config->points[point_].ioa & 0xffffffu,                \
	.type = (agent)->config->points[point_].type & 0xfu,                                                 \
	.decimals = snmp_decimals(&(agent)->config->points[point_]) & 0xfu
/* Number of the oldest event that is kept; behind the last one: there is none. */
uint32_t snmp_event_first(const struct snmp_agent *agent);
/* The event of a number between first and last. */
const struct snmp_event *snmp_event_at(const struct snmp_agent *agent, uint32_t number);
/* A column of rtuEventTable. */
void snmp_event_read(const struct snmp_agent *agent, uint32_t column, uint32_t number,
		     struct snmp_value *out);

enum snmp_event_column {
	SNMP_EVENT_KIND = 2,
	SNMP_EVENT_CA,
	SNMP_EVENT_IOA,
	SNMP_EVENT_TYPE,
	SNMP_EVENT_VALUE,
	SNMP_EVENT_FLOAT,
	SNMP_EVENT_QUALITY,
	SNMP_EVENT_TIME,
	SNMP_EVENT_TIME_VALID,
	SNMP_EVENT_CAUSE,
};

/* ---- commands.c -------------------------------------------------------------------------- */

enum snmp_command_column {
	SNMP_COMMAND_SPIN = 1,
	SNMP_COMMAND_STATE,
	SNMP_COMMAND_VALUE,
	SNMP_COMMAND_QUALIFIER,
	SNMP_COMMAND_ISSUED,
	SNMP_COMMAND_RESULT,
	SNMP_COMMAND_DETAIL,
	SNMP_COMMAND_NUMBER,
	SNMP_COMMAND_OWNER,
	SNMP_COMMAND_PROTOCOL,
	SNMP_COMMAND_TIME,
	SNMP_COMMAND_LEFT,
};

enum snmp_protocol {
	SNMP_BY_NONE = 1,
	SNMP_BY_SNMP,
	SNMP_BY_IEC104,
	SNMP_BY_LOCAL,
	SNMP_BY_OTHER,
};

void snmp_commands_begin(struct snmp_agent *agent);
/* Ends what has ended by itself. True: a command is ours. */
bool snmp_commands_tick(struct snmp_agent *agent);
void snmp_command_answered(struct snmp_agent *agent, const struct map_answer *answer);
/* Tells what another module's command has become. */
void snmp_command_of_others(struct snmp_agent *agent, const struct map_answer *answer);
/* enum snmp_protocol of a requester. */
uint8_t snmp_protocol_of(const struct map_module *module);
const char *snmp_user_name(const struct snmp_agent *agent, uint8_t user);

/* ---- freeze.c, parameters.c, clock.c: what a manager asks besides -------------------------- */

/* False: there is no memory. */
bool snmp_freezes_begin(struct snmp_agent *agent);
bool snmp_freezes_tick(struct snmp_agent *agent);
void snmp_freeze_answered(struct snmp_agent *agent, const struct map_answer *answer);
bool snmp_parameters_begin(struct snmp_agent *agent);
bool snmp_parameters_tick(struct snmp_agent *agent);
void snmp_parameter_answered(struct snmp_agent *agent, const struct map_answer *answer);
bool snmp_clock_tick(struct snmp_agent *agent);
void snmp_clock_answered(struct snmp_agent *agent, const struct map_answer *answer);
/* ---- initialised.c, cyclic.c: what the station does by itself -------------------------------- */

/* False: there is no memory. */
bool snmp_stations_begin(struct snmp_agent *agent);
void snmp_stations_tick(struct snmp_agent *agent);
bool snmp_cyclic_begin(struct snmp_agent *agent);
void snmp_cyclic_end(struct snmp_agent *agent);
void snmp_cyclic_tick(struct snmp_agent *agent);

/* Takes the answers to all requests, and ends what has ended by itself. True: something is under way. */
bool snmp_tick(struct snmp_agent *agent);

#define SNMP_ANSWER_GRACE_NS                                                                                 \
	(2 * NS_PER_S) /* behind a request's deadline its owner has answered, or never will */

/* When a request that is posted now has been answered, or never will be. */
static inline int64_t snmp_answer_ns(const struct snmp_agent *agent)
{
	return agent->now_ns + agent->config->settings.command_timeout_s * NS_PER_S + SNMP_ANSWER_GRACE_NS;
}

/* ---- tables ------------------------------------------------------------------------------ */

/* Rows of a list, by common address and IOA. */
void snmp_point_index(const struct snmp_agent *agent, enum snmp_list list, uint32_t row,
		      uint32_t out[SNMP_INDEX_MAX]);

extern const struct snmp_table snmp_system_scalars[7], snmp_resources_changed, snmp_resource_table,
    snmp_engine_scalars[4];
extern const struct snmp_table snmp_interface_count, snmp_interface_tables[4], snmp_interface_extras[4],
    snmp_interfaces_changed;
extern const struct snmp_table snmp_machine_uptime, snmp_memory_size, snmp_storage_table;
extern const struct snmp_table snmp_message_groups[3], snmp_dispatch_group, snmp_context_group,
    snmp_usm_group;
extern const struct snmp_table snmp_station_scalars[5], snmp_device_table, snmp_initialised_table;
extern const struct snmp_table snmp_point_table, snmp_value_tables[6];
extern const struct snmp_table snmp_command_table, snmp_command_scalars[3];
extern const struct snmp_table snmp_total_table, snmp_freeze_table, snmp_parameter_table, snmp_clock_group;
extern const struct snmp_table snmp_cyclic_last, snmp_cyclic_table, snmp_poll_table;
extern const struct snmp_table snmp_event_scalars[4], snmp_event_table, snmp_sink_table;
extern const struct snmp_table snmp_module_table, snmp_counter_table, snmp_health_scalars[3];
extern const struct snmp_table snmp_image_table, snmp_group_table;

#endif
