/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-modbus shows of its lines and devices: the section of its own in its segment. */
#ifndef OPENRTU_MODBUS_STATS_H
#define OPENRTU_MODBUS_STATS_H

#include <stdatomic.h>

#include "map/map.h"
#include "modbus/frame.h"
#include "modbus/frames.h"
#include "modbus/identity.h"

#define MODBUS_KIND "modbus"

/* 32-bit counters that wrap. Each is written by the line's owner alone and read by anyone, singly. */
struct modbus_line_stats {
	_Atomic uint32_t requests;
	_Atomic uint32_t answers;
	_Atomic uint32_t exceptions;
	_Atomic uint32_t timeouts;
	_Atomic uint32_t crc_errors;
	_Atomic uint32_t wrong_units;     /* sound frames, when another is awaited: of another slave, */
	_Atomic uint32_t wrong_functions; /* another function, */
	_Atomic uint32_t wrong_lengths;   /* another length, */
	_Atomic uint32_t wrong_answers;   /* or a confirmation of another write */
	_Atomic uint32_t late_answers;    /* of a slave that owed one after a time-out */
	_Atomic uint32_t unasked_frames;  /* sound frames when nothing is awaited */
	_Atomic uint32_t echoes;          /* requests that came back */
	_Atomic uint32_t noise_bytes;     /* that are no frame */
	_Atomic uint32_t stuck_s;         /* seconds without silence */
	_Atomic uint32_t commands;
	_Atomic uint32_t scan_us;          /* last time all that has no period was read once */
	_Atomic uint32_t port_errors;      /* open, read, write failed */
	_Atomic uint32_t open;             /* 1: the port is open */
	struct map_histogram wakeups;      /* how late the process woke at a time that the line had named */
	struct map_histogram transactions; /* from the request to the end of its answer */
	/* Of a TCP connection: modbus/connection.h. */
	_Atomic uint32_t closes;    /* by the peer, that were no fault */
	_Atomic uint32_t hung;      /* connections that brought nothing, and were made anew */
	_Atomic uint32_t idle_ms;   /* behind which the peer hung up, at least; 0: it never did */
	_Atomic uint32_t settle_us; /* learned, from a connection to the first request on it; 0: none */
};

/*
 * What a device has shown that it takes and what not, by the reads in force: modbus/learned.h says what follows from it.
 * Functions 1..4; bits or registers; 0: none.
 */
struct modbus_learned_stats {
	_Atomic uint32_t given_bits, given_registers; /* of the longest read that it gives */
	_Atomic uint32_t refused_bits,
	    refused_registers; /* of the shortest that it refused, and gives in parts */
	_Atomic uint32_t silent_bits, silent_registers; /* the same of reads that it did not answer */
	/* A hole in a read that it refused, on either side of which it gives what was asked for; count 0: none. */
	_Atomic uint32_t hole_function, hole_address, hole_count, hole_exception;
	_Atomic uint32_t hole_read; /* bits or registers of that read */
	/* The first object that it does not give by itself, and how many there are. Exception 0: no answer. */
	_Atomic uint32_t lacking_function, lacking_address, lacking_exception, lacking_count;
	_Atomic uint32_t holes_given; /* reads over holes that it gives */
	_Atomic uint32_t unclear;     /* reads that it gives in parts only, for no known reason */
	_Atomic uint32_t open;        /* reads of which it is not known yet whether it gives them */
};

struct modbus_device_stats {
	_Atomic uint32_t requests;
	_Atomic uint32_t answers;
	_Atomic uint32_t exceptions;
	_Atomic uint32_t timeouts;
	_Atomic uint32_t errors;            /* crc, wrong answers */
	_Atomic uint32_t missed_periods;    /* in which a read with a period was not begun */
	_Atomic uint32_t pause_us;          /* learned, that it needs behind its answers; 0: none */
	_Atomic uint32_t kept, kept_failed; /* writes of the gateway's own: confirmed, not confirmed */
	/* Functions that write one of them, learned by exception 1 to the other one; 0: none. */
	_Atomic uint32_t writes_coils, writes_registers;
	/* What the process that runs knows: the next one begins anew. */
	_Atomic uint32_t alive; /* 1: the last request was answered */
	_Atomic uint32_t too_late,
	    latest_ms;                     /* answers behind response_timeout_ms; how late the latest was */
	_Atomic uint32_t next_probe_ms;    /* back-off now in force, 0 when alive */
	_Atomic uint32_t latency_us;       /* last: end of request to first byte */
	_Atomic uint32_t planned_requests; /* reads of one scan */
	_Atomic uint32_t latency_least_us, latency_typical_us, latency_most_us; /* 0: there was no answer */
	struct modbus_learned_stats learned;
};

/* What was commanded last where the gateway itself writes that (config.h, struct modbus_keep). */
struct modbus_commanded_stats {
	_Atomic uint32_t request; /* function, count and address: bits 24..31, 16..23, 0..15; 0: nothing */
	_Atomic uint32_t values[MODBUS_WRITE_MAX / 2]; /* two each, the first in bits 0..15 */
};

/* What a device says of itself: identity.h. */
struct modbus_identity_stats {
	_Atomic uint32_t silences;
	/* What the process that runs knows. */
	_Atomic uint32_t state;
	_Atomic uint32_t size; /* octets of texts; 0: there are none, or they are being written */
	_Atomic uint32_t texts[MODBUS_IDENTITY_SIZE / sizeof(uint32_t)];
};

/* Of a line, that have names for all: map_name_counter. */
#define MODBUS_LINE_COUNTERS 18

/* Owner: to count in. Others get the same memory read-only. */
struct modbus_line_stats *modbus_line_stats(const struct map *map, uint32_t line);
struct modbus_device_stats *modbus_device_stats(const struct map *map, uint32_t device);
struct modbus_frames *modbus_line_frames(const struct map *map, uint32_t line);
/* Of a device that is asked what it is: modbus_is_asked. */
struct modbus_identity_stats *modbus_identity_stats(const struct map *map, uint32_t device);
/* Of a point that the gateway itself writes, without values of its own. */
struct modbus_commanded_stats *modbus_commanded_stats(const struct map *map, uint32_t point);
/* What a process shows of now, which is nothing when it does not run: a line is open, a device answers. */
bool modbus_line_is_open(const struct map *map, uint32_t line);
bool modbus_device_answers(const struct map *map, uint32_t device);

/* Owner: names the counters of a line by its port, as in "p1.crc_errors". */
void modbus_name_counters(struct map *map, uint32_t line);

/* rtud: to another configuration's section, of the lines and devices that both have in that process. */
void modbus_carry_stats(const struct map_config *before, const void *from, const struct map_config *now,
			void *to, uint16_t process);

/* Whether this program was built for the records that the map has of Modbus. What reads them asks first. */
bool modbus_is_known(const struct map *map);
/* What the module of a process' lines asks for. */
size_t modbus_stats_size(const struct map_config *config, uint16_t process);

#endif
