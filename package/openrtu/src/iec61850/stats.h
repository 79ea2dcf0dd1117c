/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-iec61850 shows of itself: the section of its segment. */
#ifndef OPENRTU_IEC61850_STATS_H
#define OPENRTU_IEC61850_STATS_H

#include <stdatomic.h>
#include <stdint.h>

#include "iec61850/config.h"

enum iec61850_counter {
	IEC61850_COUNT_CONNECTIONS,
	IEC61850_COUNT_REFUSED,      /* of no client, or there was no place */
	IEC61850_COUNT_ASSOCIATIONS, /* that came about */
	IEC61850_COUNT_DROPPED,      /* silent, slow, or gave way to another */
	IEC61850_COUNT_DAMAGED,      /* what is no message ended the connection */
	IEC61850_COUNT_REQUESTS,
	IEC61850_COUNT_ERRORS, /* requests that were answered by an error or a reject */
	IEC61850_COUNT_READS,  /* variables */
	IEC61850_COUNT_REPORTS,
	IEC61850_COUNT_EVENTS_LOST,
	IEC61850_COUNT_COMMANDS,         /* executions that were asked for */
	IEC61850_COUNT_COMMANDS_REFUSED, /* services of commands that were refused, or failed */
	IEC61850_COUNT_HANDSHAKES_REFUSED,
	IEC61850_COUNT_OF_COUNTERS
};

/* What rtuctl shows of clients, of the control blocks that they have, and of what waits in buffered ones. */
#define IEC61850_SHOWN_BLOCKS 64
#define IEC61850_SHOWN_QUEUES 64
#define IEC61850_SHOWN_NAME   96 /* of a logical device and a name in it */

struct iec61850_shown_association {
	char peer[MAP_ADDRESS_SIZE];
	bool associated;
	uint32_t pdu; /* octets that were agreed */
	int64_t since_ns;
	char certificate[CHANNEL_NAME_SIZE]; /* its common name; empty: there is none */
};

struct iec61850_shown_block {
	char name[IEC61850_SHOWN_NAME];
	char peer[MAP_ADDRESS_SIZE];
	bool enabled;
	uint16_t reports; /* SqNum of the next one */
};

/* Of a buffered block that a client has written to since the points are as they are. */
struct iec61850_shown_queue {
	char name[IEC61850_SHOWN_NAME];
	char peer[MAP_ADDRESS_SIZE]; /* empty: no client has it */
	bool enabled;
	bool overflow;     /* the next report will have BufOvfl */
	bool dated;        /* false: nothing waits, or it is of a clock that was never set */
	int64_t oldest_ns; /* when the first that waits happened; before this start: negative */
	uint32_t waiting;
};

struct iec61850_shown {
	uint32_t association_count, block_count, queue_count;
	uint32_t kept; /* entries of the buffer */
	struct iec61850_shown_association associations[IEC61850_ASSOCIATIONS_MAX];
	struct iec61850_shown_block blocks[IEC61850_SHOWN_BLOCKS];
	struct iec61850_shown_queue queues[IEC61850_SHOWN_QUEUES];
};

struct iec61850_stats {
	_Atomic uint32_t counters[IEC61850_COUNT_OF_COUNTERS];
	_Atomic uint32_t which; /* copy that readers take; the other one is being written */
	struct iec61850_shown shown[2];
};

#endif
