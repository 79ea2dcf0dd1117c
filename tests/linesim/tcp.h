/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A line whose devices are behind Modbus TCP: MODBUS Messaging on TCP/IP Implementation Guide V1.0b. Several
 * masters may be connected; each gets its answers in the order of its requests.
 */
#ifndef LINESIM_TCP_H
#define LINESIM_TCP_H

#include <netinet/in.h>
#include <stdbool.h>
#include <stdint.h>

#include "loop.h"

#define TCP_SESSIONS_MAX 8
#define TCP_WAITING_MAX  8 /* answers of a session that have not begun */
#define TCP_FRAME_MAX    260

struct line;

struct tcp_answer {
	int64_t at_ns;
	struct slave *slave;
	size_t size;
	uint8_t bytes[TCP_FRAME_MAX];
};

struct tcp_session {
	struct loop_source source; /* fd -1: free */
	struct line *line;
	bool hung;        /* takes what comes, and answers nothing any more */
	int64_t heard_ns; /* its last request, or its begin */
	size_t request_size;
	uint8_t request[TCP_FRAME_MAX];
	size_t waiting_count;
	struct tcp_answer waiting[TCP_WAITING_MAX];
};

struct tcp {
	bool is_one; /* else the line is serial */
	struct sockaddr_in address;
	struct loop_source listener;
	bool closes;    /* after each answer */
	uint32_t tears; /* the session is closed in the place of each answer of that number; 0: of none */
	uint32_t answers;
	int64_t idle_ns; /* closes a session that asks nothing for so long; 0: never */
	struct tcp_session sessions[TCP_SESSIONS_MAX];
};

/* -1 with errno. */
int tcp_open(struct line *line);
void tcp_close(struct line *line);

/* As line_advance(). */
int64_t tcp_advance(struct line *line, int64_t now_ns);

/* The sessions that are there hang from now on; a new one works. */
void tcp_hang(struct line *line);

#endif
