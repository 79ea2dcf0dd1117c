/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * One line, serial or a TCP connection: who is asked what, and when. Bytes and time come in, frames and results go out;
 * there is no clock, no port and no allocation in here.
 *
 * Late answers. A Modbus RTU answer does not say which request it answers: after a time-out, the answer
 * to the old request may come while a new one is under way, and two reads of one length look alike. So,
 * after a request that was not answered, its device gets only requests whose answer no missing one
 * could be mistaken for (another function or another byte count), until one of these is answered. A
 * device answers in order, so nothing older can follow then. The first such request is one short read,
 * which also tells a deaf device from a dead one. Where there is none, the device rests until
 * MODBUS_LATE_NS after the time-out; the other devices of the line go on. A port that was just opened
 * may still bring the answer to a request of a process that was killed: there, two short reads that
 * differ must be answered, which is enough for one such request. What is guaranteed: an answer that
 * begins less than MODBUS_LATE_NS after its time-out never becomes another register's value or another
 * command's confirmation, provided the device answers in order. Values that a process finds later than
 * that, because it did not run, are nobody's. The time-out meant here is response_timeout_ns, counted for each request
 * from the end of that of the one before, however early the line itself went on.
 *
 * Time-outs. The line waits for MODBUS_LATENCY_FACTOR times the longest latency that it has seen of the device's reads
 * of late, though not less than response_timeout_min_ns; twice as long after each request in a row that was not answered
 * (as RFC 6298, 5.5), and never longer than response_timeout_ns. It waits all of that
 * - while the device has not answered since the port was opened,
 * - for the answer to a command, whose fate must be known,
 * - for that to a read that was not answered the last time, and for the last one before the device counts as dead: a
 *   device, or a read, that became slower is not given up for a time-out that was learned.
 * What comes late, but within response_timeout_ns, shows the same: it is learned from, the requests that were not
 * answered count no more, and the response time of the one under way begins again, since the device begins with it only
 * then. A command waits until its device cannot be busy with a read any more.
 *
 * What a dead device costs. Probes begin with the time-out that was learned, and it doubles with each in vain. The pause
 * before a probe doubles too, and is long enough that, if the probe is in vain, the line has lost no more than one
 * MODBUS_DEAD_SHAREth of the time to it: from the death on, but for the requests by which the device was found dead. The
 * time in which it lived has paid for these; where that was too short, the first pause is the longer, by a minute at
 * most. While no device of the line lives, a probe costs nobody anything: then the pause only doubles. A device with
 * probe_max_ns is never left alone for longer than that, whatever its probes then cost.
 *
 * An answer of Modbus TCP (wire.framing) says by its transaction which request it answers: none can be mistaken for another's, so the
 * line goes on at once after a time-out. One request is under way at a time, as many devices want it. There are no
 * silences, no noise and no echo. What a gateway on the way says of a device that it cannot reach (exceptions 10 and 11)
 * is this device's silence.
 *
 * What the line writes by itself (kept.c). A device may have writes that it is to hold: each goes out when the device is
 * back, in their order, and again at the multiples of its period. It is a constant, several in turn, or what the latest command wrote. Nothing
 * is written to a device that is silent, and none of it counts as a command or for the device's life: what the device
 * refuses is told once, and what it does not answer costs the line no more than a dead device does.
 *
 * Pages (page.c). Some devices have many things at the same addresses, one of them at a time: a register says which. Before each read
 * of what is on a page the line writes that register, and then comes this read: nothing goes to the line in between, but to others
 * while the device needs its pause. A page that could not be chosen is not read: it is refused or unanswered as the read would be.
 *
 * What a device is (identity.h, identify.c). It is asked when all that is read of it was read once since it is there, and nothing with a
 * period becomes due while the answer is waited for. Each such request is followed by none for as long as keeps what they cost below
 * one MODBUS_DEAD_SHAREth of the line's time. Silence and refusals say nothing of the device's life or its reads, and count as no exceptions.
 *
 * What is passed on (passed.c). A request of somebody else's for a device of the line goes out as it came, and its answer goes back as it
 * comes: all that is looked at is unit, function and CRC; where nothing says how long the answer is, silence ends it. It goes when nothing is due,
 * nothing with a period becomes due until it should have been answered, and its device owes no answer: what comes is its own. So much
 * of the line's time as pass_share says is the most that such requests take, be there a scan without end behind them. Whether it is answered, and how,
 * says nothing of the device: no life, no latency, no pause, no counter of it changes.
 *
 * Whose turn it is. Commands go first, then what was written is read back, unless that is not wanted; after
 * MODBUS_COMMANDS_IN_ROW of them polling goes on by one request. Polling is, first, the reads that are due
 * (period.h), by deadline; after MODBUS_DUE_IN_ROW of them the scan, which is all reads without a period, goes
 * on by one request, so that a line that is asked for too much still reads everything. What the line writes by itself goes
 * ahead of polling, one for each of its requests at most; what a device is, and what is passed on, ahead of the scan. Living devices are
 * scanned in turn; after a probe that no dead one answered, they are scanned once before the next. So the age
 * of their values grows by one time-out, not with the number of the dead.
 */
#ifndef OPENRTU_MODBUS_LINE_H
#define OPENRTU_MODBUS_LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "ascii.h"
#include "connection.h"
#include "frame.h"
#include "histogram.h"
#include "identity.h"
#include "learned.h"
#include "map/time_ns.h"
#include "mbap.h"
#include "pause.h"
#include "period.h"
#include "plan.h"

#define MODBUS_NEVER           INT64_MAX
#define MODBUS_LATE_NS         NS_PER_S          /* how long after its time-out an answer may still come */
#define MODBUS_BABBLE_NS       NS_PER_S          /* a line that is not silent for so long is unusable */
#define MODBUS_BROADCAST_NS    (100 * NS_PER_MS) /* MODBUS over Serial Line, 2.4.1: turnaround 100..200 ms */
#define MODBUS_FIRST_PROBE_NS  NS_PER_S          /* back-off of a dead device or a refused object: */
#define MODBUS_RAREST_PROBE_NS (60 * NS_PER_S)   /* doubled from there to here */
#define MODBUS_DEAD_SHARE      20   /* a dead device costs at most this part of the line's time */
#define MODBUS_LATENCY_FACTOR  4    /* a time-out is so many latencies */
#define MODBUS_LATENCY_FADING  2048 /* each answer takes this part off the longest latency */
#define MODBUS_SILENT_READS    3    /* unanswered so often, a read is split: less may be noise */
#define MODBUS_UNANSWERED_MAX  8
#define MODBUS_OVERDUE_MAX     16
#define MODBUS_ECHO_MEMORY     8  /* one echo may be lost among noise */
#define MODBUS_COMMANDS_IN_ROW 8  /* then polling goes on by one read: a flood of them does not stop it */
#define MODBUS_DUE_IN_ROW      16 /* then the scan goes on by one read */

enum modbus_result {
	MODBUS_DONE,      /* the device confirmed it; a broadcast: it was sent */
	MODBUS_REFUSED,   /* the device answered with an exception */
	MODBUS_TIMED_OUT, /* no answer that could be understood: the device may or may not have acted */
	MODBUS_TOO_OLD,   /* not sent: its deadline passed in the queue */
	MODBUS_NOT_SENT,  /* the port was lost before its turn */
};

struct modbus_command {
	uint32_t device; /* index in the line's devices */
	uint32_t tag;    /* the caller's; not looked at */
	int64_t deadline_ns;
	uint8_t read_function; /* what it has changed is read ahead of its turn; 0: nothing is */
	uint16_t read_address;
	bool turned;                   /* the line's own: the device does not know the other function */
	struct modbus_request request; /* function 5, 6, 15, 16, 22 */
};

struct modbus_device_counters {
	uint32_t requests, answers, exceptions, timeouts;
	uint32_t errors; /* CRC, wrong answers */
	uint32_t latency_us;
	uint32_t missed_periods;    /* in which a read with a period was not sent */
	uint32_t too_late;          /* answers behind response_timeout_ns */
	uint32_t kept, kept_failed; /* writes of the line's own, that were confirmed; that were not */
};

struct modbus_line_counters {
	uint32_t requests, answers, exceptions, timeouts, crc_errors;
	/* Sound frames, when another is awaited: of another unit, function, length, or else different. */
	uint32_t wrong_units, wrong_functions, wrong_lengths, wrong_answers;
	uint32_t late_answers;   /* sound frames of a device that owed one; on TCP, of what timed out */
	uint32_t unasked_frames; /* sound frames when nothing is awaited */
	uint32_t echoes;         /* requests that came back */
	uint32_t noise_bytes;
	uint32_t stuck_s; /* seconds, one after the other, without silence */
	uint32_t commands;
	uint32_t scan_us;
	uint32_t scans;                       /* in which something was answered */
	struct modbus_histogram transactions; /* from the request to the end of its answer */
};

/* What a device has at the same addresses, one page at a time. */
struct modbus_pages {
	/* Filled in by the caller, who owns the memory. */
	uint16_t address; /* of the holding register that chooses one */
	uint8_t count;
	uint16_t values[MODBUS_PAGES_MAX]; /* that are written there */

	/* The line's own. */
	bool turned;
	uint32_t chosen; /* 1 + the read whose page is there, and which comes next; 0: none */
};

/* A request that is passed on, and what the caller knows it by. */
struct modbus_passed {
	uint32_t device;     /* index in the line's devices */
	uint32_t tag;        /* the caller's; not looked at */
	int64_t deadline_ns; /* it is sent until then, or not at all */
	size_t length;
	uint8_t body[MODBUS_BODY_MAX]; /* unit, function and data; at least the first two */
};

/* What a device is to hold. */
struct modbus_kept {
	/* Filled in by the caller, who owns the memory. */
	uint32_t tag; /* that of the commands to the same place */
	/* What is written in turn; NULL: what the latest of these wrote. */
	struct modbus_request *constants;
	uint32_t constant_count;
	int64_t period_ns; /* 0: it is written when the device is back alone */

	/* For the caller to look at: how the latest one ended. */
	enum modbus_result result;
	uint8_t exception;

	/* The line's own. */
	struct modbus_request request; /* that was commanded; function 0: nothing yet */
	bool news;                     /* it is another one; the caller's to clear */
	uint32_t next;                 /* of the constants */
	bool turned;
	uint32_t failures; /* unanswered in a row */
	int64_t backoff_ns, due_ns;
};

struct modbus_device {
	/* Filled in by the caller, who owns the memory. */
	uint8_t unit;    /* MODBUS_BROADCAST on a serial line: written, never read */
	uint8_t retries; /* unanswered requests in a row beyond the first before it counts as dead */
	struct modbus_limits limits;
	int64_t response_timeout_ns;     /* end of request to first byte of the answer: the ceiling */
	int64_t response_timeout_min_ns; /* the floor: less is never waited for */
	int64_t
	    probe_max_ns; /* the longest pause before a probe; 0: MODBUS_RAREST_PROBE_NS, or its share's */
	int64_t pause_ns; /* the least between its answer and the next request to it */
	bool
	    writes_multiple; /* one coil or register is written with function 15 or 16, until the device refuses that */
	struct modbus_object *objects; /* sorted by modbus_line_init */
	uint32_t object_count;
	struct modbus_read *reads; /* room for object_count of them */
	struct modbus_kept *kept;  /* in the order in which they are written; NULL: none */
	uint32_t kept_count;
	struct modbus_identity *identity; /* NULL: it is not asked for it */
	struct modbus_pages *pages;       /* NULL: it has none */

	/* For the caller to look at. */
	struct modbus_device_counters counters;
	struct modbus_latency latency;
	int64_t latest_ns; /* how late the latest of these was */
	struct modbus_pause pause;
	struct modbus_write_functions {
		uint8_t coils, registers; /* learned by exception 1 to the other one; 0: nothing was */
		uint32_t unproven;        /* of these, not answered yet otherwise: a bit for each function */
	} writes;
	uint32_t read_count;
	bool news;          /* of what it takes (learned.h); the caller's to clear */
	int64_t backoff_ns; /* in force while it is dead, else 0 */
	int64_t timeout_ns; /* in force now; 0: nothing was learned, it is response_timeout_ns */
	bool alive;
	bool
	    vouched; /* for a process before this: its values are told still, and end as those of one that lives */

	/* The line's own. */
	bool broadcast;     /* it is none: all hear what it is told */
	uint32_t cursor;    /* the next read of this scan */
	uint32_t failures;  /* unanswered requests in a row; of a dead device, probes */
	int64_t slowest_ns; /* latency of its reads, fading; 0: none since the port was opened */
	int64_t lost_ns;    /* to its unanswered requests in a row */
	int64_t paid_ns;    /* when what was lost before was its share of the line's time */
	int64_t next_probe_ns;
	int64_t lone_probe_ns; /* the same while no device of the line lives */
	int64_t asked_ns; /* when it had the oldest unanswered request to answer; a dead one, the latest */
	int64_t trust_ns; /* when no answer can come any more to what is unanswered */
	int64_t kept_free_ns; /* until then no write of the line's own is tried that was not answered */
	bool refusing;        /* its last answer was an exception */
	uint8_t echoes;       /* answered reads without an echo until none is expected any more */
	bool inherited;       /* whoever had the port before may have left a request unanswered */
	uint8_t unanswered_count;
	struct modbus_unanswered {
		uint8_t function;
		uint16_t bytes;
		int64_t sent_ns; /* 0: a late answer has come since */
	} unanswered[MODBUS_UNANSWERED_MAX];
	int64_t heard_ns;  /* the end of its last answer, be it late: before, it did not begin with another */
	int64_t spoken_ns; /* the end of the last frame to it or of it */
};

/* What the line tells. Called from within modbus_line_receive, _poll and _close. */
struct modbus_events {
	/* A read was answered; data: modbus_bit, modbus_register, counted from read->address. */
	void (*read)(void *context, uint32_t device, const struct modbus_read *read, const uint8_t *data,
		     int64_t now_ns);
	/*
	 * The device lives but does not give these objects any more, or for another reason than before;
	 * exception 0: it is silent when asked for them.
	 */
	void (*refused)(void *context, uint32_t device, const struct modbus_read *read, uint8_t exception,
			int64_t now_ns);
	/* A device died or answers again. Every device begins as dead. */
	void (*alive)(void *context, uint32_t device, bool alive, int64_t now_ns);
	/* A command has ended. */
	void (*command)(void *context, const struct modbus_command *command, enum modbus_result result,
			uint8_t exception);
	/* A device has not answered since the line began, and has had its tries. Left out: nobody wants to know. */
	void (*mute)(void *context, uint32_t device);
	/* The answer to what had timed out: so long after it was asked, or the device had ended what it was asked before. */
	void (*late)(void *context, uint32_t device, int64_t latency_ns, int64_t now_ns);
	/* The device needs that pause behind its answer. */
	void (*pause)(void *context, uint32_t device, int64_t pause_ns, int64_t now_ns);
	/* The device does not know a function that writes, and has answered the other one, with which it is written from now on. */
	void (*turned)(void *context, uint32_t device, uint8_t unknown, uint8_t function, int64_t now_ns);
	/* What the line writes by itself ends otherwise than the last time. */
	void (*kept)(void *context, uint32_t device, const struct modbus_kept *kept, int64_t now_ns);
	/* What was passed on has ended; body: its answer, an exception too, if the result is MODBUS_DONE. */
	void (*passed)(void *context, const struct modbus_passed *passed, enum modbus_result result,
		       const uint8_t *body, size_t length, int64_t now_ns);
	/* What was asked of the device, another unit answers. */
	void (*stranger)(void *context, uint32_t device, uint8_t unit, int64_t now_ns);
	/* The device has said what it is: its identity is known, again or for the first time. Left out: nobody wants to know. */
	void (*identified)(void *context, uint32_t device);
	/* The device answers a read with so many octets of data, which should be so many. */
	void (*misfit)(void *context, uint32_t device, size_t length, size_t expected, int64_t now_ns);
};

enum modbus_line_state {
	MODBUS_CLOSED,
	MODBUS_IDLE,       /* or waiting for silence */
	MODBUS_WAITING,    /* for an answer */
	MODBUS_TURNAROUND, /* after a broadcast */
};

enum modbus_purpose {
	MODBUS_SCAN,
	MODBUS_PROBE,
	MODBUS_COMMAND,
	MODBUS_KEEP,
	MODBUS_IDENTIFY,
	MODBUS_PASS,
	MODBUS_CHOOSE, /* the page of what is read next */
};

struct modbus_line {
	/* Filled in by the caller, who owns the memory. */
	const struct modbus_events *events;
	void *context;
	struct modbus_device *devices;
	uint32_t device_count;
	struct modbus_command *commands; /* FIFO */
	uint32_t command_capacity;
	struct modbus_wire wire;
	uint8_t pass_share; /* percent of the line's time, 1..99, that what is passed on may take */

	/* For the caller to look at. */
	struct modbus_line_counters counters;
	enum modbus_line_state state;

	/* The line's own. */
	const struct modbus_framer *framer; /* since it was opened */
	uint32_t command_count;
	uint32_t commands_in_row; /* since the last poll */
	uint32_t due_in_row;      /* since the last read of the scan */
	bool kept_last;           /* since the last poll, something of its own was written */
	uint32_t living;          /* devices */
	uint32_t turn;            /* the device being scanned */
	uint32_t probe_turn;      /* the device to be probed next, if it is dead and due */
	bool probed_in_vain;      /* in this scan */
	bool urgent;              /* some read may be marked urgent */
	bool scan_begun;          /* some device was read in this scan */
	bool scan_held;           /* some device was not read to its end, for its pause */
	int64_t scan_began_ns;
	int64_t scan_ended_ns;
	int64_t whole_scan_began_ns; /* of the scan that counters.scan_us is of */
	int64_t identify_free_ns;    /* until then no device is asked what it is */
	struct modbus_passed passed; /* the latest; */
	bool passing;                /* it has not ended */
	int64_t pass_free_ns;        /* until then nothing is passed on */

	/* When whoever runs this line was last back from an absence: what is there then came nobody knows when. */
	int64_t back_ns;
	int64_t silent_ns;   /* when the line may be used, if nothing more comes */
	int64_t restless_ns; /* since when silence is being waited for */
	int64_t last_byte_ns;
	int64_t listen_ns; /* when the answer under way can be complete; 0: none is, or it may be now */

	/* The transaction under way. */
	enum modbus_purpose purpose;
	struct modbus_request request;
	struct modbus_command command;
	uint32_t device;
	uint32_t read, kept;
	int64_t sent_ns; /* its last character has left */
	int64_t deadline_ns;
	bool garbled; /* something began like the answer */
	bool echoed;  /* the request came back */

	uint8_t frame[MODBUS_MBAP_FRAME_MAX];
	size_t frame_length;
	uint8_t received[2 * MODBUS_FRAME_MAX];
	size_t received_count;
	size_t strays; /* of these, the first that belong to no answer */

	/* Of ASCII. frame and received have what an RTU line would have. */
	struct modbus_ascii ascii;
	int64_t ascii_began_ns; /* its first character */
	uint8_t text[MODBUS_ASCII_REQUEST_MAX];

	/* Of TCP. */
	struct modbus_connection connection;
	uint16_t transaction; /* of the latest request */
	struct modbus_overdue {
		uint16_t transaction;
		uint8_t unit, function;
		uint32_t device;
		int64_t sent_ns;               /* 0: its answer has come */
	} overdue[MODBUS_OVERDUE_MAX];         /* what timed out last */
	uint32_t overdue_count;                /* ever; the next one's place */
	uint8_t stream[MODBUS_MBAP_FRAME_MAX]; /* a frame's beginning */
	size_t stream_count;
};

struct modbus_output {
	const uint8_t *frame; /* to be sent at once; valid until the next call */
	size_t length;        /* 0: nothing to send */
	int64_t deadline_ns;  /* when to poll again at the latest */
	int64_t listen_ns; /* what arrives before completes no answer: it may stay in the port until then */
	bool
	    reconnect; /* the connection is hung: it must be closed, and the next one is made when the line is due */
};

/* How long to wait after one more try that failed. backoff_ns: after the one before, 0 for the first. */
int64_t modbus_next_backoff(int64_t backoff_ns);

/* What the line loses to a probe that is not answered within the time-out. */
int64_t modbus_vain_probe_ns(const struct modbus_wire *wire, int64_t timeout_ns);

/* The functions that a former process had learned; 0, or what is none: nothing. */
void modbus_take_functions(struct modbus_device *device, uint32_t coils, uint32_t registers);

/* Plans the reads of all devices. The line is closed then. */
void modbus_line_init(struct modbus_line *line);

/* The port is there: every device is probed, and scanned when it answers. */
void modbus_line_open(struct modbus_line *line, int64_t now_ns);

/*
 * The peer of a connection has hung up. True: that is no fault. The line stays open, and when it is due, and not before, a
 * connection is to be made for it. False: the port is lost.
 */
bool modbus_line_interrupted(struct modbus_line *line, int64_t now_ns);
/* It has something to ask now. */
bool modbus_line_is_due(const struct modbus_line *line, int64_t now_ns);
/* Its next connection is there. Without one, the line must not be polled while it is due. */
void modbus_line_connected(struct modbus_line *line, int64_t now_ns);

/* The port is lost: devices die, the command under way ends as timed out, others as not sent. */
void modbus_line_close(struct modbus_line *line, int64_t now_ns);

/*
 * Queues a command; it goes ahead of polling, and is sent once at most. False when the line is closed
 * or the queue full. Poll then.
 */
bool modbus_line_command(struct modbus_line *line, const struct modbus_command *command);

/* Passes a request on when there is room for it: one at a time. False: the line is closed, or another one has not ended. Poll then. */
bool modbus_line_pass(struct modbus_line *line, const struct modbus_passed *passed);
/* What is asked so changes nothing, as far as the standard says: body as modbus_passed has it. */
bool modbus_reads_only(const uint8_t *body, size_t length);
/*
 * Whether a body of two octets at least is as long as its function says: behind one that is not, a device on a serial line
 * may find another request, or miss the next one. Of functions with no length of their own, always.
 */
bool modbus_is_whole(const uint8_t *body, size_t length);

/*
 * Takes bytes that arrived by now_ns. Before a poll from listen_ns on, everything that is readable must have been given.
 * False: on TCP, what comes is not Modbus, and never will be again: the connection must be closed.
 */
bool modbus_line_receive(struct modbus_line *line, const uint8_t *bytes, size_t length, int64_t now_ns);

/*
 * Does what is due at now_ns. A returned frame is taken to leave now_ns, at the line's speed. Call it
 * at the deadline, and after modbus_line_receive, _open and _command.
 */
struct modbus_output modbus_line_poll(struct modbus_line *line, int64_t now_ns);

#endif
