/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The sending side of one control block: numbers and times of its messages (IEC 61850-8-1, 18.1.2.5). A change is sent at once
 * and again, each time after twice as long, until the longest interval. Times are arguments.
 */
#ifndef OPENRTU_GOOSE_PUBLISHER_H
#define OPENRTU_GOOSE_PUBLISHER_H

#include "goose/config.h"
#include "map/map.h"

struct goose_publisher {
	const struct goose_publication *publication;
	const uint32_t *members; /* points */
	const struct map_point *points;
	struct map_sample *samples; /* of the members */
	uint32_t state, sequence;   /* of the next message */
	struct goose_time time;     /* of the last change */
	int64_t interval_ns, due_ns;
	bool has_changed; /* since the last message */
};

/* samples: room for one of each member. state: stNum that a former process has sent last; 0: there was none. */
void goose_publisher_init(struct goose_publisher *publisher, const struct map_config *config, uint32_t number,
			  struct map_sample *samples, uint32_t state);

/* A member's sample. True: it differs from what was sent, or will be, in value or quality. */
bool goose_publisher_set(struct goose_publisher *publisher, uint32_t member, const struct map_sample *sample);
/* The member has changed since the last message, which it is to be seen in before it changes again. */
bool goose_publisher_has_changed(const struct goose_publisher *publisher, uint32_t member);

/* When the next message is due: at once behind a change. */
int64_t goose_publisher_deadline(const struct goose_publisher *publisher);
/*
 * The message that is due now, and the next one's time. time: of now. Returns how many octets of the frame are used; 0: the
 * data set is too long for one, which the configuration does not let be.
 */
size_t goose_publisher_send(struct goose_publisher *publisher, const uint8_t source[6],
			    struct goose_time time, int64_t now_ns, uint8_t frame[GOOSE_FRAME_MAX]);

/* The octets of its longest message; 0: no frame holds it. */
size_t goose_longest(const struct goose_publication *publication, const uint32_t *members,
		     const struct map_point *points);

#endif
