/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/polls.h"

#include "map/time_ns.h"

#define QOI_STATION 20
#define QCC_ALL     5
/* A station that has only just started may not answer yet. */
#define REPEAT_NS (10 * NS_PER_S)

void iec104_polls_begin(struct iec104_poll *polls, uint32_t count, int64_t now_ns)
{
	for (uint32_t i = 0; i < count; i++)
		polls[i].due_ns = polls[i].at_start ? now_ns : now_ns + polls[i].period_ns;
}

struct iec104_poll *iec104_polls_next(struct iec104_poll *polls, uint32_t count)
{
	struct iec104_poll *next = NULL;

	for (uint32_t i = 0; i < count; i++)
		if (next == NULL || polls[i].due_ns < next->due_ns)
			next = &polls[i];
	return next;
}

void iec104_polls_renew(struct iec104_poll *polls, uint32_t count, uint16_t ca, int64_t now_ns)
{
	for (uint32_t i = 0; i < count; i++)
		if (polls[i].kind == IEC104_POLL_INTERROGATION && polls[i].ca == ca)
			polls[i].due_ns = now_ns;
}

void iec104_polls_doubt(struct iec104_poll *polls, uint32_t count, uint16_t ca, int64_t now_ns)
{
	for (uint32_t i = 0; i < count; i++)
		if (polls[i].kind == IEC104_POLL_INTERROGATION && polls[i].ca == ca)
			polls[i].due_ns =
			    earlier(polls[i].due_ns, later(now_ns, polls[i].sent_ns + REPEAT_NS));
}

void iec104_polls_failed(struct iec104_poll *polls, uint32_t count,
			 const struct iec104_controlling_request *request, int64_t now_ns)
{
	if (request->type != IEC104_C_IC_NA_1)
		return;
	for (uint32_t i = 0; i < count; i++)
		if (polls[i].kind == IEC104_POLL_INTERROGATION && polls[i].ca == request->ca)
			polls[i].due_ns = earlier(polls[i].due_ns, now_ns + REPEAT_NS);
}

uint32_t iec104_poll_post(const struct iec104_poll *poll, struct iec104_controlling *controlling,
			  struct iec104_moment now)
{
	switch ((enum iec104_poll_kind)poll->kind) {
	case IEC104_POLL_CLOCK:
		return iec104_controlling_set_clock(controlling, poll->ca, now);
	case IEC104_POLL_INTERROGATION:
		return iec104_controlling_interrogate(controlling, poll->ca, QOI_STATION, now);
	case IEC104_POLL_COUNTERS:
		return iec104_controlling_interrogate_counters(controlling, poll->ca, QCC_ALL, now);
	case IEC104_POLL_READ:
		return iec104_controlling_read(controlling, poll->ca, poll->ioa, now);
	}
	return 0;
}

void iec104_poll_put_off(struct iec104_poll *poll, int64_t now_ns)
{
	poll->sent_ns = now_ns;
	if (poll->period_ns == 0)
		poll->due_ns = INT64_MAX;
	else
		poll->due_ns += poll->period_ns * (1 + (now_ns - poll->due_ns) / poll->period_ns);
}
