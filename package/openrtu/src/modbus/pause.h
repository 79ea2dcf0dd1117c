/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The pause that a device needs behind its answer before it hears the next request: learned from when it answers.
 *
 * A device that does not answer so soon, and answers each time when it was left alone for longer, needs a pause; one that
 * answers as soon as it failed to does not. What it answered behind is kept then. If that is answered at once, which it
 * would not be where the request itself was the cause, shorter ones are tried until the shortest is known within a
 * quarter. From time to time none is tried: noise, too, may have been the cause. A command takes part in no try. Of a device
 * that is dead after one request without an answer, none is tried when it comes back.
 */
#ifndef OPENRTU_MODBUS_PAUSE_H
#define OPENRTU_MODBUS_PAUSE_H

#include <stdbool.h>
#include <stdint.h>

#define MODBUS_PAUSE_MAX_NS   20000000000LL /* what is longer is no pause */
#define MODBUS_PAUSE_RETRY_NS 5000000000LL  /* until none is tried, the first time; it doubles */

struct modbus_pause {
	int64_t least_ns; /* the configuration's */
	int64_t kept_ns;  /* in force for what must arrive; least_ns: nothing was learned */
	int64_t tried_ns; /* in force for reads: kept_ns, or a shorter one */
	int64_t gap_ns;   /* before the request under way; 0: it is the first */
	int64_t short_ns; /* the longest that it did not answer behind */
	int64_t long_ns;  /* the shortest that it answered behind and that is longer; 0: none */
	int64_t retry_ns; /* when none is tried again */
	int64_t rest_ns;  /* from one such try to the next */
	int64_t told_ns;  /* what was said */
	uint8_t failures; /* requests so soon, none answered, since the last that was */
	uint8_t given;    /* answers behind a longer one, each after a failure */
	uint8_t wanted;   /* so many failures are enough */
	uint8_t vain;     /* requests without an answer in a row */
	bool proved;      /* it is answered behind kept_ns, at once */
};

/* What a request without an answer does to the device. */
enum modbus_patience {
	MODBUS_IS_KILLED,  /* by one */
	MODBUS_IS_REVIVED, /* it was dead until this answer: at most it is again */
	MODBUS_IS_PATIENT, /* one more or less is nothing */
};

void modbus_pause_begin(struct modbus_pause *pause, int64_t least_ns);
/* What a former process had learned. */
void modbus_pause_take(struct modbus_pause *pause, int64_t learned_ns, int64_t now_ns);

/* What was learned, 0: nothing. */
static inline int64_t modbus_pause_learned_ns(const struct modbus_pause *pause)
{
	return pause->kept_ns > pause->least_ns ? pause->kept_ns : 0;
}

/* A request begins, so long behind the last frame to or of the device; 0: there was none. */
static inline void modbus_pause_asked(struct modbus_pause *pause, int64_t gap_ns)
{
	pause->gap_ns = gap_ns;
}

/*
 * It was answered, or not in time. True: what was learned is new, and another cause is out of question for what was not
 * answered so far.
 */
bool modbus_pause_answered(struct modbus_pause *pause, enum modbus_patience patience, int64_t now_ns);
/* True: a shorter pause than it needs is to blame, which was tried. */
bool modbus_pause_unanswered(struct modbus_pause *pause, int64_t now_ns);
/* What was not answered comes late: the device has heard it. */
void modbus_pause_was_late(struct modbus_pause *pause);
/* What is to be said now, once; 0: nothing. */
int64_t modbus_pause_news(struct modbus_pause *pause, enum modbus_patience patience);

#endif
