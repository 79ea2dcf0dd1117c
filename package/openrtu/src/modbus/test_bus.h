/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A line and its devices in virtual time: the bus delivers bytes one by one, at the speed of the wire; of TCP, with
 * line.wire of modbus_wire_tcp, they come at once, or with spread_ns between two.
 */
#ifndef OPENRTU_MODBUS_TEST_BUS_H
#define OPENRTU_MODBUS_TEST_BUS_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "modbus/line.h"

#define MS           1000000LL
#define SECOND       1000000000LL
#define DEVICES_MAX  3
#define OBJECTS_MAX  64
#define ADDRESSES    1024
#define COMMANDS_MAX 8
#define KEPT_MAX     4
#define WIRE_MAX     8192
#define TRACE_MAX    4096
#define TIMEOUT_NS   (100 * MS)
#define REACTION_NS  (5 * MS)
#define EXCESS       7

enum fault {
	SOUND,
	MUTE,
	CORRUPT,    /* a bit of the data; on TCP, whose checksum would find it, none */
	TRUNCATED,  /* its last two bytes are missing */
	WRONG_UNIT, /* the rest, CRC included, is sound */
	WRONG_FUNCTION,
	WRONG_LENGTH,   /* EXCESS bytes more than asked for: not what a probe may ask for */
	WRONG_ECHO,     /* a write is confirmed with another value */
	NOISE_BEFORE,   /* three bytes, then the answer */
	NOISE_BEHIND,   /* the answer, then two zeros */
	BABBLE_BEHIND,  /* the answer, then four */
	STRANGER_FIRST, /* another unit's sound answer, then the right one */
};

/* A device: it answers one request after the other. Register a holds 256 * unit + a, coil a is a % 3 == 0. */
struct slave {
	uint8_t unit;
	bool present;
	enum fault fault;
	unsigned faults;     /* how many answers it spoils */
	int64_t reaction_ns; /* request to answer */
	unsigned late;       /* how many answers take late_ns */
	int64_t late_ns;
	int64_t long_ns;         /* on top of the reaction: of reads of more than one register */
	int64_t write_ns;        /* ... of writes */
	int64_t free_ns;         /* when it has dealt with all so far */
	bool one_ear;            /* what is asked until then is lost, not done later */
	int64_t pause_ns;        /* the same for so long behind that; what is lost begins it anew */
	bool endless;            /* of its text, CR and LF are missing */
	uint8_t exception;       /* its answer to everything, when not 0 */
	uint8_t write_exception; /* the same, to writes */
	uint32_t unknown;        /* functions that it does not know, a bit each */
	bool dumb;               /* and does not answer */
	const char *identity[7]; /* objects of function 43, which it knows if it has the first */
	bool basic_only;         /* and refuses to give more than the first three, by exception 3 */
	uint8_t identified;      /* objects that it puts into one answer; 0: all */
	int missing;             /* address it answers with exception 2; -1: none */
	uint16_t blank, blanks;  /* so many addresses from there on that it answers with exception 2 */
	uint16_t most;           /* not 0: a read of more is answered with exception 3 */
	int deaf;                /* address it does not answer to when read together with others */
	uint16_t registers[ADDRESSES];
};

/* The moods of whoever is at the end of a connection; 0: it has none. */
struct peer {
	int64_t idle_ns;     /* hangs up so long behind its last answer */
	int64_t settle_ns;   /* does not answer what comes sooner behind the connect, */
	bool hangs_up_early; /* or hangs up then */
	bool hangs_up_at_identification;
	bool hangs_up_at; /* hangs up instead of an answer to more than one register from hated on */
	uint16_t hated;
	unsigned hangs_after; /* answers of one connection; then it answers nothing on it any more */
};

struct wire_byte {
	int64_t time_ns;
	uint8_t byte;
};

struct sent {
	int64_t time_ns;
	struct modbus_request request;
};

struct bus {
	struct modbus_line line;
	struct modbus_device devices[DEVICES_MAX];
	struct modbus_object objects[DEVICES_MAX][OBJECTS_MAX];
	struct modbus_read reads[DEVICES_MAX][OBJECTS_MAX];
	struct modbus_kept kept[DEVICES_MAX][KEPT_MAX];
	struct modbus_request constants[DEVICES_MAX][KEPT_MAX];
	struct modbus_identity identities[DEVICES_MAX];
	struct modbus_command commands[COMMANDS_MAX];
	struct slave slaves[DEVICES_MAX];
	struct wire_byte wire[WIRE_MAX];
	size_t wire_count;
	unsigned deliveries; /* how often what had arrived was given to the line */
	int64_t now_ns;
	int64_t busy_ns;   /* end of the last character on the wire */
	int64_t spread_ns; /* between two octets, besides the wire's speed */
	int64_t waited_ns; /* for the answer to the request under way */
	int64_t lost_ns[DEVICES_MAX], lost_by_death_ns[DEVICES_MAX]; /* of that, in vain */
	struct peer peer;
	bool apart;           /* there is no connection */
	bool refusing;        /* there will be none */
	unsigned connections; /* made */
	int64_t connected_ns;
	int64_t hang_up_ns;   /* when the peer hangs up; 0: not yet known */
	unsigned answered;    /* on this connection */
	uint16_t transaction; /* of the latest request on TCP */
	bool echoing;         /* the transceiver hears what it sends */
	uint32_t chance;      /* not 0: the process runs late, at random */
	unsigned still;       /* polls in a row that neither sent nor let time pass */
	struct sent sent[TRACE_MAX];
	size_t sent_count;
	unsigned reads_done[DEVICES_MAX], objects_read[DEVICES_MAX];
	uint64_t refused_addresses[DEVICES_MAX];                    /* a bit each, of 64 the first again */
	int64_t last_read_ns[DEVICES_MAX], longest_ns[DEVICES_MAX]; /* between two reads */
	unsigned deaths[DEVICES_MAX], births[DEVICES_MAX];
	int64_t died_ns[DEVICES_MAX];
	unsigned pauses[DEVICES_MAX]; /* said */
	int64_t pause_ns[DEVICES_MAX];
	unsigned turns; /* of functions */
	unsigned kept_news[DEVICES_MAX];
	unsigned lates[DEVICES_MAX], identified[DEVICES_MAX], strangers[DEVICES_MAX];
	int64_t late_ns[DEVICES_MAX]; /* the latest */
	uint8_t stranger;             /* the latest */
	unsigned misfits[DEVICES_MAX];
	size_t misfit, fit; /* octets that the latest had, and should have had */
	unsigned commands_done;
	uint32_t last_tag;
	enum modbus_result last_result;
	uint8_t last_exception;
	uint32_t tags[16];
	unsigned passes; /* what was passed on and has ended; the latest: */
	enum modbus_result pass_result;
	uint32_t pass_tag;
	size_t pass_length;
	uint8_t pass_answer[MODBUS_BODY_MAX];
};

extern struct bus bus;

/* An empty bus. Devices are added, objects to the latest of them; then the line starts. */
void set_up(void);
void add_device(uint8_t unit, uint8_t retries);
void add_objects(uint8_t function, uint16_t address, uint16_t count);
/* What it is to hold: the value in a register, or with function 0 what commands with that tag write. */
void add_kept(uint8_t function, uint16_t address, uint16_t value, int64_t period_ns, uint32_t tag);
/* It is asked what it is. */
void add_identity(void);
void start(void);
/* On TCP from then on, with frames of Modbus TCP or with such; to be called before the line starts. */
void use_tcp(void);
void use_connection(enum modbus_framing framing);
/* The same in datagrams. */
void use_udp(void);
/* A serial line of that speed with Modbus ASCII. */
void use_ascii(uint32_t baud);
/* One device with eight holding registers, scanned at least once. */
void start_simple(uint8_t retries);

/*
 * Starts the line with a device that answers late, again and again. Its reads are of one length and look alike: on_read finds each
 * value that is taken for another's.
 */
void expect_late_answers_apart(void);

void run_for(int64_t ns);
/* Until the device is dead; it must be within the time. */
void run_until_dead(uint32_t device, int64_t within_ns);
/* What has arrived by now comes in one piece. */
void deliver(void);

/* A write that is good for ten seconds. */
void command(uint32_t device, uint8_t function, uint16_t address, uint16_t value, uint32_t tag);

/* Has a body passed on that may wait for five seconds. False: there is one that has not ended. */
bool pass(uint32_t device, const uint8_t *body, size_t length, uint32_t tag);

/* How many requests of this kind were sent. */
unsigned sent_with(uint8_t unit, uint8_t function);
void forget_trace(void);

/* Bytes that no device sends, from that moment on. */
void put_on_wire(int64_t time_ns, const uint8_t *bytes, size_t length);
/* Appends the CRC; returns the frame's length with it. */
size_t seal(uint8_t *frame, size_t length);

uint32_t random_next(uint32_t *seed);

#endif
