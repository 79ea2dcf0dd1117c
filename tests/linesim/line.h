/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * One simulated RS-485 line: a pty whose bytes take their time, and the slaves on it. Clauses are those
 * of MODBUS over Serial Line V1.02. Times are CLOCK_MONOTONIC nanoseconds.
 *
 * A pty carries a whole request at once. The line gives each byte its place on the wire: the first begins when
 * it was read, every other when the one before it has ended. A request is complete after 3.5 characters of
 * silence, the answer begins after the device's latency, and each of its bytes is written when its stop bit
 * ends.
 *
 * The line is half duplex: when the master speaks into an answer, a late answer into a request, or an answer
 * into another, that is a collision: what is left of both is spoiled.
 */
#ifndef LINESIM_LINE_H
#define LINESIM_LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "loop.h"
#include "slave.h"
#include "tcp.h"

#define LINE_FRAME_MAX   256 /* clause 2.5.1 */
#define LINE_NOISE_MAX   256
#define LINE_ANSWER_MAX  (LINE_FRAME_MAX + LINE_FRAME_MAX) /* an echo or noise, and the answer */
#define LINE_WAITING_MAX 8 /* answers not begun yet; a further one is dropped */
#define LINE_NAME_SIZE   64

/* What goes over the wire as one answer. size 0: none. */
struct line_answer {
	struct slave *slave; /* NULL: nobody of this line says it */
	enum slave_fault_kind fault;
	int64_t start_ns;
	size_t size;
	size_t pause_at; /* 3.5 characters of silence before this byte; 0: none */
	uint8_t bytes[LINE_ANSWER_MAX];
};

struct line_stats {
	uint32_t requests; /* to slaves of the line, broadcasts included */
	uint32_t foreign;  /* to units that are not on the line */
	uint32_t answers;
	uint32_t crc_errors;
	uint32_t collisions;
	uint32_t dropped; /* answers given up: the master spoke first, or too many were waiting */
	int64_t busy_ns;  /* wire time of all bytes, both ways */
};

struct line {
	uint16_t port;
	char name[LINE_NAME_SIZE]; /* of the symbolic link */
	int64_t char_ns;
	int64_t silence_ns;    /* that ends a request */
	int64_t unfinished_ns; /* that ends bytes which are no sound request */
	int64_t latency_ns;
	struct slave *slaves[SLAVE_UNIT_MAX + 1]; /* by unit, NULL: not on the line */

	struct tcp tcp;
	struct loop_source pty;
	int far_end; /* the pty's slave side, kept open: without it a master that closes hangs the line up */
	struct loop_source closings; /* inotify: a master closed the port */
	bool whole;                  /* an answer is written at its end, and not byte by byte */
	bool unplugged;
	int64_t jammed_ns; /* until when what jams the line has been written, 0: nothing does */
	uint32_t random;
	struct line_stats stats;

	struct {
		uint8_t bytes[LINE_FRAME_MAX];
		size_t size;       /* counted on beyond LINE_FRAME_MAX */
		size_t renewed_at; /* its bytes before the last silence; 0: none */
		int64_t end_ns;
		bool spoiled;
	} request;
	struct {
		struct line_answer answer;
		size_t sent;
		bool spoiled;
	} sending;
	struct line_answer waiting[LINE_WAITING_MAX];
};

/*
 * What a device makes of a request's PDU, and its fault of the answer's, which is put into pdu. Returns its size.
 */
size_t line_execute(const struct line *line, struct slave *slave, const struct slave_fault *fault,
		    const uint8_t *request, size_t size, uint8_t pdu[SLAVE_PDU_MAX]);

/* Takes the serial parameters. baud > 0 bit/s; bits: of a character, start, parity and stop bits included. */
void line_set_pace(struct line *line, unsigned baud, unsigned bits, int64_t latency_ns);
/*
 * After line_set_pace: the end of a request needs this silence at least, and fifty times as much while its CRC is wrong:
 * the host of an emulator may have stopped it between two bytes. A sound request behind unfinished bytes is taken, without them.
 */
void line_set_silence(struct line *line, int64_t least_ns);

/* Creates the pty, links directory/name to it, and watches it; of a TCP line its socket. -1 with errno. */
int line_open(struct line *line, int directory);
void line_close(struct line *line, int directory);

/* Does what is due by now_ns. Returns when it wants to be called again, LOOP_NEVER: after the next byte. */
int64_t line_advance(struct line *line, int64_t now_ns);

/* Cuts the line between the master and all slaves, or joins it. What is on the wire vanishes. */
void line_set_plugged(struct line *line, bool plugged);

/* Somebody sends without end, and what the master sends collides with it; or nobody does any more. */
void line_set_jammed(struct line *line, bool jammed, int64_t now_ns);

/* Somebody who is no slave of this line sends these bytes, at most LINE_ANSWER_MAX. */
void line_say(struct line *line, const uint8_t *bytes, size_t size, int64_t now_ns);

#endif
