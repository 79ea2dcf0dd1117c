/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Tools of the devices' makers that connect by Modbus TCP, and whose requests are passed on to a line of this process (line.h, "What is passed
 * on"). It lives in the line's process: a request is octets that the map has no words for, and who talks to a line is the one who
 * has it. rtud opens the socket; without one there is nothing of this.
 *
 * Each connection has one request under way; what it sends meanwhile stays in its socket. An answer goes to the connection whose
 * request it is of, or to none. What the configuration does not allow is answered with exception 10, as what found no room on the line for
 * PASSING_WAIT_NS; with 11, what the device did not answer.
 */
#ifndef OPENRTU_MODULES_MODBUS_PASSING_H
#define OPENRTU_MODULES_MODBUS_PASSING_H

#include <stdbool.h>
#include <stdint.h>

#include "map/map.h"
#include "map/repeats.h"
#include "modbus/config.h"
#include "modbus/line.h"

#define PASSING_WAIT_NS (5 * NS_PER_S)
#define PASSING_IDLE_NS (60 * NS_PER_S) /* a connection that says nothing for so long is closed */

struct passing_tool {
	int fd; /* -1: nobody */
	char peer[MAP_ADDRESS_SIZE];
	uint8_t frame[MODBUS_MBAP_FRAME_MAX]; /* its request, or the beginning of one */
	size_t count;
	bool waiting; /* its request is whole, and has no answer */
	bool
	    refused; /* and gets none but a refusal, with the next heartbeat: nobody asks faster for nothing */
	uint32_t tag; /* of that request on the line; 0: it is not there yet */
	int64_t deadline_ns;
	int64_t heard_ns;
};

struct passing {
	const struct modbus_pass *pass; /* NULL: nothing is passed on in this process */
	struct map *map;
	struct modbus_line *line;
	int listener, epoll_fd;
	struct passing_tool tools[MODBUS_PASS_CONNECTIONS_MAX];
	uint32_t turn;              /* whose request is next */
	uint32_t tag;               /* the latest */
	struct map_repeats refused; /* lines about what is not allowed */
};

/* line: the one that the pass is of. listener: the socket that rtud opened. False: it cannot be waited for. */
bool passing_begin(struct passing *passing, struct map *map, const struct modbus_pass *pass,
		   struct modbus_line *line, int listener, int epoll_fd);
/* What epoll tells of is one of these. */
bool passing_has(const struct passing *passing, const void *pointer);
void passing_wake(struct passing *passing, const void *pointer, int64_t now_ns);
/* Gives the line the next request. True: there was one. To be called in each turn, and when one has ended. */
bool passing_offer(struct passing *passing, int64_t now_ns);
/* modbus_events.passed */
void passing_ended(struct passing *passing, const struct modbus_passed *passed, enum modbus_result result,
		   const uint8_t *body, size_t length, int64_t now_ns);
/* Now and then: sends away who says nothing. */
void passing_watch(struct passing *passing, int64_t now_ns);

#endif
