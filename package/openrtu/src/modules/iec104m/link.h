/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * One connection to an outstation: made, lost, made again (channel/attempts.h). It is open without
 * data transfer until its owner starts it; the session tests it meanwhile (t3).
 */
#ifndef OPENRTU_MODULES_IEC104M_LINK_H
#define OPENRTU_MODULES_IEC104M_LINK_H

#include "channel/attempts.h"
#include "channel/tcp.h"
#include "iec104/controlling.h"
#include "iec104/octets.h"
#include "iec104/outstations.h"

#define LINK_INPUT_SIZE  1024
#define LINK_OUTPUT_SIZE 512

enum link_state { LINK_DOWN, LINK_CONNECTING, LINK_SECURING, LINK_OPEN, LINK_STARTING, LINK_STARTED };

struct link {
	const struct iec104_outstation *outstation;
	const struct iec104_controlling_settings *settings;
	const struct iec104_controlling_listener *listener;
	const char *address;
	enum link_state state;
	struct channel channel; /* its fd is -1: there is none */
	struct channel_station security;
	int64_t due_ns; /* down: the next attempt; connecting and securing: the last moment for it */
	struct attempts attempts;
	bool pending;       /* octets have come that poll does not tell of */
	uint32_t failures;  /* connections that ended or could not be made */
	const char *reason; /* of the last */
	bool to_be_said;    /* the last, in the log */
	char error[TCP_ERROR_SIZE];
	struct iec104_memory memory;
	uint8_t input[LINK_INPUT_SIZE], output[LINK_OUTPUT_SIZE];
	struct iec104_controlling controlling;
};

/* False: there is no memory. What it refers to must outlive it. */
bool link_init(struct link *link, const struct iec104_outstation *outstation, unsigned number,
	       const struct iec104_controlling_settings *settings,
	       const struct iec104_controlling_listener *listener);

/* Asks for data transfer on an open link. */
void link_start(struct link *link, struct iec104_moment now);
/* Octets have come, or poll has told of an error. */
void link_receive(struct link *link);
/* All there is to do now. */
void link_run(struct link *link, struct iec104_moment now);
int64_t link_deadline(const struct link *link);
/* What poll shall tell of. */
short link_events(struct link *link);
void link_close(struct link *link);

#endif
