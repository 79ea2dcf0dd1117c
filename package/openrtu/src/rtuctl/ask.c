/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is asked of rtud itself, and waiting for its answer. */
#include "rtuctl/ask.h"

#include <poll.h>

#include "map/time_ns.h"

#define LOOK_MS     100
#define DEADLINE_MS 5000 /* rtud begins at once, or something is wrong with it */

static bool take_answer(struct map *map, uint32_t id, struct map_answer *out)
{
	map_bell_clear(map);
	while (map_answer_next(map, out))
		if (out->id == id)
			return true;
	return false;
}

bool rtuctl_ask(struct map *map, struct map_request request, uint32_t patience_ms, struct map_answer *out)
{
	struct pollfd bell = {.fd = map_bell_fd(map), .events = POLLIN};
	int64_t limit_ns = map_now_ns() + patience_ms * NS_PER_MS;
	uint32_t id;

	request.time_ns = map_now_ns();
	request.deadline_ns = request.time_ns + DEADLINE_MS * NS_PER_MS;
	id = map_request_post(map, request);
	while (id != 0 && map_now_ns() < limit_ns) {
		bool alive = map_alive(map, MAP_RTUD); /* first: what it answered before it ended counts */

		if (take_answer(map, id, out))
			return true;
		if (!alive)
			return false;
		poll(&bell, 1, LOOK_MS);
	}
	return false;
}
