/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/counters.h"

#include <string.h>

#include "iec104/config.h"
#include "map/time_ns.h"

bool iec104_is_known(const struct map *map)
{
	return iec104_settings(map_config(map)) != NULL && iec104_stats_of(map) != NULL;
}

struct iec104_stats *iec104_stats_of(const struct map *map)
{
	uint32_t module = map_module_of_kind(map, IEC104_KIND);

	return module == MAP_NONE ? NULL : map_section(map, module, sizeof(struct iec104_stats));
}

/* The name is its writer's, and goes to the reader's terminal. */
static void copy_printable(char to[IEC104_PEER_SIZE], const char *from)
{
	memcpy(to, from, IEC104_PEER_SIZE);
	to[IEC104_PEER_SIZE - 1] = '\0';
	for (char *c = to; *c != '\0'; c++)
		if (*c < ' ' || *c > '~')
			*c = '?';
}

bool iec104_shown_connection(const struct map *map, unsigned place, struct iec104_shown_connection *out)
{
	const struct iec104_connection_stats *stats = &iec104_stats_of(map)->connections[place];

	*out = (struct iec104_shown_connection){
	    .queue = atomic_load(&stats->queue),
	    .since_ns = (int64_t)atomic_load(&stats->since_s) * NS_PER_S,
	    .started = atomic_load(&stats->started) != 0,
	    .next_ns = atomic_load(&stats->next_ns),
	    .next_nr = atomic_load(&stats->next_nr),
	    .unacknowledged = atomic_load(&stats->unacknowledged),
	    .owed = atomic_load(&stats->owed),
	};
	copy_printable(out->peer, stats->peer);
	return atomic_load(&stats->open) != 0;
}

const char *iec104_counter_name(enum iec104_counter counter)
{
	static const char *const names[IEC104_COUNT_OF_COUNTERS] = {
	    [IEC104_COUNT_I_IN] = "i_frames_in",
	    [IEC104_COUNT_S_IN] = "s_frames_in",
	    [IEC104_COUNT_STARTDT_ACT_IN] = "startdt_act_in",
	    [IEC104_COUNT_STARTDT_CON_IN] = "startdt_con_in",
	    [IEC104_COUNT_STOPDT_ACT_IN] = "stopdt_act_in",
	    [IEC104_COUNT_STOPDT_CON_IN] = "stopdt_con_in",
	    [IEC104_COUNT_TESTFR_ACT_IN] = "testfr_act_in",
	    [IEC104_COUNT_TESTFR_CON_IN] = "testfr_con_in",
	    [IEC104_COUNT_I_OUT] = "i_frames_out",
	    [IEC104_COUNT_S_OUT] = "s_frames_out",
	    [IEC104_COUNT_STARTDT_ACT_OUT] = "startdt_act_out",
	    [IEC104_COUNT_STARTDT_CON_OUT] = "startdt_con_out",
	    [IEC104_COUNT_STOPDT_ACT_OUT] = "stopdt_act_out",
	    [IEC104_COUNT_STOPDT_CON_OUT] = "stopdt_con_out",
	    [IEC104_COUNT_TESTFR_ACT_OUT] = "testfr_act_out",
	    [IEC104_COUNT_TESTFR_CON_OUT] = "testfr_con_out",
	    [IEC104_COUNT_ACCEPTED] = "connections_accepted",
	    [IEC104_COUNT_NOT_LISTED] = "refused_address_not_listed",
	    [IEC104_COUNT_TOO_MANY] = "refused_too_many",
	    [IEC104_COUNT_BAD_APDU] = "closed_bad_apdu",
	    [IEC104_COUNT_BAD_ASDU] = "closed_bad_asdu",
	    [IEC104_COUNT_BAD_NS] = "closed_bad_ns",
	    [IEC104_COUNT_BAD_NR] = "closed_bad_nr",
	    [IEC104_COUNT_I_WHILE_STOPPED] = "closed_i_while_stopped",
	    [IEC104_COUNT_T1_I_FRAME] = "closed_t1_i_frame",
	    [IEC104_COUNT_T1_TESTFR] = "closed_t1_testfr",
	    [IEC104_COUNT_UNREAD_ANSWERS] = "closed_unread_answers",
	    [IEC104_COUNT_TAKEN_OVER] = "closed_taken_over",
	    [IEC104_COUNT_GAVE_WAY] = "closed_gave_way",
	    [IEC104_COUNT_NOT_SECURE] = "closed_not_secure",
	    [IEC104_COUNT_NOT_AS_BEFORE] = "closed_not_as_before",
	    [IEC104_COUNT_CLOSED_BY_PEER] = "closed_by_peer",
	    [IEC104_COUNT_CLOSED_BY_STATION] = "closed_by_station",
	    [IEC104_COUNT_UNKNOWN_TYPE] = "refused_44_unknown_type",
	    [IEC104_COUNT_UNKNOWN_CAUSE] = "refused_45_unknown_cause",
	    [IEC104_COUNT_UNKNOWN_CA] = "refused_46_unknown_ca",
	    [IEC104_COUNT_UNKNOWN_IOA] = "refused_47_unknown_ioa",
	    [IEC104_COUNT_NEGATIVE] = "negative_confirmations",
	    [IEC104_COUNT_ORIGINATOR] = "refused_originator",
	    [IEC104_COUNT_EVENTS_SENT] = "events_sent",
	    [IEC104_COUNT_EVENTS_LOST] = "events_lost",
	};

	return names[counter];
}
