/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-iec61850 shows of itself: the section of its segment. */
#ifndef OPENRTU_IEC61850_STATS_H
#define OPENRTU_IEC61850_STATS_H

#include <stdatomic.h>
#include <stdint.h>

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
	IEC61850_COUNT_OF_COUNTERS
};

struct iec61850_stats {
	_Atomic uint32_t counters[IEC61850_COUNT_OF_COUNTERS];
};

#endif
