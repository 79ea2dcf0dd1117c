/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a controlling station asks a controlled one by itself: a plan of polls, of which one is under way at a time. What was
 * missed meanwhile is left out, not made up for. A plan is an array, which its owner keeps.
 */
#ifndef OPENRTU_IEC104_POLLS_H
#define OPENRTU_IEC104_POLLS_H

#include "iec104/controlling.h"

enum iec104_poll_kind {
	IEC104_POLL_CLOCK, /* in this order at the start */
	IEC104_POLL_INTERROGATION,
	IEC104_POLL_COUNTERS,
	IEC104_POLL_READ,
};

struct iec104_poll {
	uint8_t kind; /* enum iec104_poll_kind */
	bool at_start;
	uint16_t ca;
	uint32_t ioa;      /* of a read */
	int64_t period_ns; /* 0: at the start only */
	int64_t due_ns;    /* CLOCK_MONOTONIC, while data transfer is started */
	int64_t sent_ns;   /* the last; 0: none */
};

/* Data transfer has started. */
void iec104_polls_begin(struct iec104_poll *polls, uint32_t count, int64_t now_ns);
/* The one that is due first; NULL: there is none. */
struct iec104_poll *iec104_polls_next(struct iec104_poll *polls, uint32_t count);
/* A station was initialised: it has to be asked for everything (IEC 60870-5-5, 6.1.5). */
void iec104_polls_renew(struct iec104_poll *polls, uint32_t count, uint16_t ca, int64_t now_ns);
/* What it said contradicts what is known of its points: it is asked again soon, which only it can decide. */
void iec104_polls_doubt(struct iec104_poll *polls, uint32_t count, uint16_t ca, int64_t now_ns);
/* It has ended without success: soon an interrogation is tried again, without which nobody knows the points. */
void iec104_polls_failed(struct iec104_poll *polls, uint32_t count,
			 const struct iec104_controlling_request *request, int64_t now_ns);
/* Sends it. Returns the request's id, or 0 as iec104_controlling_read. */
uint32_t iec104_poll_post(const struct iec104_poll *poll, struct iec104_controlling *controlling,
			  struct iec104_moment now);
/* It was sent: it is due again in its period. */
void iec104_poll_put_off(struct iec104_poll *poll, int64_t now_ns);

#endif
