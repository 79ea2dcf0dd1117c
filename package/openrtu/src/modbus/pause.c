/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pause.h"

#include "map/time_ns.h"

#define FAILURES_WANTED 3
#define FAILURES_MOST   48 /* where it was no pause again and again */
#define GIVEN_WANTED    2
#define DOUBTS          2               /* failures behind a pause that nothing has proved yet */
#define NEAR_NS         (2 * NS_PER_MS) /* a shorter one is not worth the try: so near, */
#define NEAR_PART       4               /* and within this part */
#define RETRY_MOST_NS   (64 * 60 * NS_PER_S)

static bool is_learned(const struct modbus_pause *pause)
{
	return pause->kept_ns > pause->least_ns;
}

static void forget_signs(struct modbus_pause *pause)
{
	pause->failures = pause->given = 0;
	pause->short_ns = pause->long_ns = 0;
}

static void drop(struct modbus_pause *pause)
{
	forget_signs(pause);
	pause->kept_ns = pause->tried_ns = pause->least_ns;
	pause->proved = false;
}

void modbus_pause_begin(struct modbus_pause *pause, int64_t least_ns)
{
	*pause = (struct modbus_pause){.least_ns = least_ns, .wanted = FAILURES_WANTED};
	drop(pause);
}

static void keep(struct modbus_pause *pause, int64_t kept_ns)
{
	pause->kept_ns = pause->tried_ns = pause->long_ns = kept_ns;
}

static void wait_for_retry(struct modbus_pause *pause, int64_t now_ns)
{
	pause->rest_ns =
	    pause->rest_ns == 0 ? MODBUS_PAUSE_RETRY_NS : earlier(2 * pause->rest_ns, RETRY_MOST_NS);
	pause->retry_ns = now_ns + pause->rest_ns;
}

void modbus_pause_take(struct modbus_pause *pause, int64_t learned_ns, int64_t now_ns)
{
	if (learned_ns <= pause->least_ns || learned_ns > MODBUS_PAUSE_MAX_NS)
		return;
	keep(pause, learned_ns);
	pause->short_ns = learned_ns - 1; /* it has been looked for */
	pause->told_ns = learned_ns;
	pause->proved = true;
	wait_for_retry(pause, now_ns);
}

/* ---- signs -------------------------------------------------------------------------------------------- */

static bool take_sign(struct modbus_pause *pause)
{
	if (pause->failures == 0)
		return false;
	if (pause->gap_ns <= pause->short_ns) {
		forget_signs(pause);
		return false;
	}
	if (pause->vain > 0) {
		pause->given++;
		pause->long_ns = pause->long_ns == 0 ? pause->gap_ns : earlier(pause->long_ns, pause->gap_ns);
	}
	if (pause->failures < pause->wanted || pause->given < GIVEN_WANTED ||
	    pause->long_ns > MODBUS_PAUSE_MAX_NS || pause->long_ns <= pause->least_ns)
		return false;
	keep(pause, pause->long_ns);
	pause->rest_ns = pause->retry_ns = 0;
	return true;
}

/* ---- what was learned --------------------------------------------------------------------------------- */

static bool is_near(const struct modbus_pause *pause)
{
	return pause->kept_ns <= pause->short_ns + NEAR_NS + pause->short_ns / NEAR_PART;
}

/*
 * The next one to try: half way to what is too short, or, now and then, none. A busy line may leave the device alone for longer than
 * what is to be tried: the search does not end then, and none is tried all the same.
 */
static void choose(struct modbus_pause *pause, enum modbus_patience patience, int64_t now_ns)
{
	pause->tried_ns = pause->kept_ns;
	if (patience == MODBUS_IS_KILLED)
		return;
	if (pause->retry_ns == 0)
		wait_for_retry(pause, now_ns);
	else if (now_ns >= pause->retry_ns)
		pause->tried_ns = pause->least_ns;
	else if (patience == MODBUS_IS_PATIENT && !is_near(pause))
		pause->tried_ns = later(pause->least_ns, (pause->short_ns + pause->kept_ns) / 2);
}

/* It was not answered behind what was kept: it needs longer than that, by what was answered now. */
static void lengthen(struct modbus_pause *pause)
{
	int64_t longer_ns = pause->kept_ns + pause->kept_ns / NEAR_PART;

	if (pause->gap_ns <= pause->kept_ns || longer_ns > MODBUS_PAUSE_MAX_NS)
		return;
	pause->short_ns = pause->kept_ns;
	keep(pause, earlier(longer_ns, pause->gap_ns));
}

static void use(struct modbus_pause *pause, enum modbus_patience patience, int64_t now_ns)
{
	if (pause->vain == 0 && pause->gap_ns <= pause->short_ns) {
		drop(pause);
		return;
	}
	if (pause->vain == 0 && pause->gap_ns < pause->kept_ns)
		keep(pause, later(pause->gap_ns, pause->least_ns));
	if (pause->vain == 1 && pause->proved && pause->failures > 0)
		lengthen(pause);
	if (pause->vain == 0) {
		pause->proved = true;
		pause->wanted = FAILURES_WANTED;
	}
	if (!pause->proved)
		return;
	pause->failures = 0;
	choose(pause, patience, now_ns);
}

bool modbus_pause_answered(struct modbus_pause *pause, enum modbus_patience patience, int64_t now_ns)
{
	bool learned = false;

	if (pause->gap_ns == 0)
		return false;
	if (is_learned(pause))
		use(pause, patience, now_ns);
	else
		learned = take_sign(pause);
	if (learned)
		pause->failures = 0;
	pause->vain = 0;
	return learned;
}

static void fail_sign(struct modbus_pause *pause)
{
	pause->short_ns = later(pause->short_ns, pause->gap_ns);
	if (pause->failures < UINT8_MAX)
		pause->failures++;
	if (pause->long_ns <= pause->short_ns)
		pause->long_ns = pause->given = 0;
}

/* A try that failed says what is too short; else the pause may not be what the device wants. */
static bool fail_learned(struct modbus_pause *pause, int64_t now_ns)
{
	bool tried = pause->vain == 1 && pause->gap_ns < pause->kept_ns;

	if (tried) {
		pause->short_ns = later(pause->short_ns, pause->gap_ns);
		if (pause->retry_ns != 0 && now_ns >= pause->retry_ns)
			wait_for_retry(pause, now_ns);
	} else {
		pause->failures++;
	}
	pause->tried_ns = pause->kept_ns;
	if (!pause->proved && pause->failures >= DOUBTS) {
		drop(pause);
		pause->wanted = (uint8_t)earlier(2 * pause->wanted, FAILURES_MOST);
	}
	return tried;
}

bool modbus_pause_unanswered(struct modbus_pause *pause, int64_t now_ns)
{
	if (pause->gap_ns == 0)
		return false;
	if (pause->vain < UINT8_MAX)
		pause->vain++;
	if (is_learned(pause))
		return fail_learned(pause, now_ns);
	fail_sign(pause);
	return false;
}

void modbus_pause_was_late(struct modbus_pause *pause)
{
	if (!is_learned(pause))
		forget_signs(pause);
	else if (!pause->proved)
		drop(pause);
}

int64_t modbus_pause_news(struct modbus_pause *pause, enum modbus_patience patience)
{
	int64_t away_ns = pause->kept_ns - pause->told_ns;

	if (!is_learned(pause) || !pause->proved || (patience == MODBUS_IS_PATIENT && !is_near(pause)) ||
	    (away_ns <= pause->told_ns / NEAR_PART && -away_ns <= pause->told_ns / NEAR_PART))
		return 0;
	pause->told_ns = pause->kept_ns;
	return pause->kept_ns;
}
