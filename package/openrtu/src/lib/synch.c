/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Waiting for the net: the library asks and waits, and the heart beats meanwhile. */
#include <errno.h>
#include <poll.h>

#include "lib/handle.h"

#define BEATS_A_LIMIT 4 /* as in scan.c */

/* SYNCH_OPEN: the module shall end. */
static enum synch_result await(struct openrtu *rtu)
{
	struct pollfd waited[] = {{.fd = rtu->stop_fd, .events = POLLIN},
				  {.fd = map_bell_fd(rtu->map), .events = POLLIN}};

	while (map_may_run(rtu->map)) {
		enum synch_result result;

		map_heartbeat(rtu->map);
		map_bell_clear(rtu->map);
		result = synched_answer(&rtu->synched);
		if (result != SYNCH_OPEN)
			return result;
		if (poll(waited, 2, (int)(rtu->module->heartbeat_limit_ms / BEATS_A_LIMIT)) > 0 &&
		    waited[0].revents != 0)
			break;
	}
	rtu->stopped = true;
	return SYNCH_OPEN;
}

bool synch_begin_scan(struct openrtu *rtu)
{
	if (!synched_waits(&rtu->synched))
		return true;
	synched_ask_begin(&rtu->synched);
	return await(rtu) != SYNCH_OPEN;
}

void synch_end_scan(struct openrtu *rtu)
{
	if (!rtu->stopped && synched_ask_end(&rtu->synched))
		await(rtu);
}

int openrtu_synch(struct openrtu *rtu, const char *name, bool blocking)
{
	uint8_t transition = SYNCH_NOTHING;

	if (synched_takes_part(&rtu->synched))
		transition = synch_point_named(&rtu->synched.net, rtu->synched.number, name);
	if (transition == SYNCH_NOTHING)
		return -ENOENT;
	if (rtu->stopped)
		return -EINTR;
	synched_ask(&rtu->synched, transition, blocking);
	switch (await(rtu)) {
	case SYNCH_FIRED:
		return 1;
	case SYNCH_NOT_NOW:
		return 0;
	case SYNCH_OPEN:
		return -EINTR;
	default:
		return -ECANCELED;
	}
}
