/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * When a peer is tried again that could not be reached, or was lost. The pause doubles with each failure, and is the first one
 * again when the peer has been of use. That it took a connection shows nothing: some take one and hang up.
 */
#ifndef OPENRTU_CHANNEL_RETRY_H
#define OPENRTU_CHANNEL_RETRY_H

#include <stdbool.h>
#include <stdint.h>

#include "map/time_ns.h"

struct retry {
	int64_t first_ns, most_ns;
	int64_t pause_ns;  /* behind the next failure */
	int64_t opened_ns; /* the connection; 0: there is none */
};

static inline struct retry retry_begin(int64_t first_ns, int64_t most_ns)
{
	return (struct retry){.first_ns = first_ns, .most_ns = most_ns, .pause_ns = first_ns};
}

static inline void retry_opened(struct retry *retry, int64_t now_ns)
{
	retry->opened_ns = now_ns;
}

/* The connection has lasted as long as the pause before it. */
static inline bool retry_has_lasted(const struct retry *retry, int64_t now_ns)
{
	return retry->opened_ns != 0 && now_ns - retry->opened_ns >= retry->pause_ns;
}

static inline void retry_was_useful(struct retry *retry)
{
	retry->pause_ns = retry->first_ns;
}

/* The attempt failed, or the connection is lost: so long until the next one. */
static inline int64_t retry_failed(struct retry *retry)
{
	const int64_t pause_ns = retry->pause_ns;

	retry->opened_ns = 0;
	retry->pause_ns = later(pause_ns, earlier(2 * pause_ns, retry->most_ns));
	return pause_ns;
}

#endif
