/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-web shows of its work: the section of its own in its segment. */
#ifndef OPENRTU_WEB_STATS_H
#define OPENRTU_WEB_STATS_H

#include <stdatomic.h>
#include <stdint.h>

enum web_counter {
	WEB_COUNT_CONNECTIONS,
	WEB_COUNT_REFUSED, /* of no client, or one too many */
	WEB_COUNT_LATE,    /* without a whole request for too long */
	WEB_COUNT_DAMAGED, /* without a handshake of TLS */
	WEB_COUNT_REQUESTS,
	WEB_COUNT_DENIED,
	WEB_COUNT_LOGINS,
	WEB_COUNT_LOGINS_FAILED,
	WEB_COUNT_LOGINS_LIMITED,
	WEB_COUNT_COMMANDS,
	WEB_COUNT_OF_COUNTERS
};

struct web_stats {
	_Atomic uint32_t counters[WEB_COUNT_OF_COUNTERS];
};

#endif
