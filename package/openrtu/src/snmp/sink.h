/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Who is notified: a reader of the numbered events with a place of its own. Some informs wait for their answers at a time; one
 * that gets none is sent again, ever later. A sink that answers none of them is silent: it is told once a minute what it has
 * missed, and goes on from there when it answers.
 */
#ifndef OPENRTU_SNMP_SINK_H
#define OPENRTU_SNMP_SINK_H

#include <stdbool.h>
#include <stdint.h>

#include "snmp/config.h"

struct snmp_agent;

/* Events in one message that waits for its answer. */
struct snmp_flight {
	uint32_t first, last;
	uint8_t tries;
	bool used;      /* it waits, or waits to be sent again */
	bool answered;  /* but one before it is not */
	int64_t due_ns; /* when it is sent again; 0: it waits for its answer */
};

struct snmp_sink_run {
	struct snmp_flight flights[SNMP_WINDOW_MAX];
	uint32_t next; /* number of the first event that was never sent */
	bool silent;
	bool probing; /* the probe waits for its answer */
	int64_t probe_ns;
};

enum snmp_sending { SNMP_SEND_NOTHING, SNMP_SEND_EVENTS, SNMP_SEND_PROBE };

/* What is to be sent to a sink now. Of events flight has the first; how many more go with it the message decides. */
enum snmp_sending snmp_sink_next(struct snmp_agent *agent, uint32_t sink, struct snmp_flight **flight);
/* Events were sent, up to this one. */
void snmp_sink_sent(struct snmp_agent *agent, uint32_t sink, struct snmp_flight *flight, uint32_t last);
void snmp_sink_probed(struct snmp_agent *agent, uint32_t sink);
/* An inform was answered, or was not in time and is sent again then. flight NULL: the probe. reason: of a report; NULL: none came. */
void snmp_sink_answered(struct snmp_agent *agent, uint32_t sink, struct snmp_flight *flight);
void snmp_sink_unanswered(struct snmp_agent *agent, uint32_t sink, struct snmp_flight *flight, int64_t due_ns,
			  const char *reason);
/* Whether something waits to be sent, or for its answer. */
bool snmp_sink_is_busy(const struct snmp_agent *agent, uint32_t sink);
void snmp_sinks_begin(struct snmp_agent *agent);

#endif
