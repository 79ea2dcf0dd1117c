/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The read plan of one device: which requests bring all its objects in the least time on the wire.
 */
#ifndef OPENRTU_MODBUS_PLAN_H
#define OPENRTU_MODBUS_PLAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "frame.h"
#include "map/time_ns.h"

/* Assumed of a device: from the silence that ends a request to the answer's first character. */
#define MODBUS_REACTION_NS 5000000LL

/* MODBUS Application Protocol V1.1b3, 7: what a device that takes less than it is asked for says of it. */
#define MODBUS_ILLEGAL_FUNCTION 1
#define MODBUS_ILLEGAL_ADDRESS  2
#define MODBUS_ILLEGAL_VALUE    3 /* the quantity */

#define MODBUS_PAGES_MAX 31 /* of a device */

/* What a device offers at one address. Its bits or registers always travel in one answer. */
struct modbus_object {
	uint32_t tag;            /* the caller's; not looked at */
	uint16_t address;        /* from 0 */
	uint16_t function : 4;   /* that reads it: 1..4 */
	uint16_t width : 12;     /* bits or registers, with what lies between those that belong together */
	uint32_t period_ms : 27; /* it is read so often, 0: in turn */
	uint32_t page : 5; /* that is chosen before it is read: its place among the device's and 1; 0: none */
};

/* What one request may read of a device, and how soon it answers; all 0: nothing is known of it. */
struct modbus_limits {
	uint16_t bits;       /* 1..MODBUS_BITS_MAX, 0: so many */
	uint16_t registers;  /* 1..MODBUS_REGISTERS_MAX, 0: so many */
	bool no_holes;       /* only addresses that some object has */
	int64_t reaction_ns; /* 0: MODBUS_REACTION_NS */
};

/* One request of the plan: the objects first .. first + objects - 1 of the sorted table. */
struct modbus_read {
	uint32_t first;
	uint32_t objects;
	uint16_t address;
	uint16_t count; /* bits or registers */
	uint8_t function;
	bool holed;     /* carries addresses that no object has */
	bool given;     /* it was answered with data */
	uint8_t page;   /* as of its objects */
	uint32_t whole; /* 1 + the first object of the refused read that this is the second part of, else 0 */
	uint8_t whole_exception; /* that it was refused with, 0: it was not answered */
	uint16_t failures;       /* in a row, while the device answered other requests */
	bool urgent;             /* wanted before its turn */
	uint8_t exception;       /* that it was refused with last */
	int64_t pause_ns;        /* not 0: an object that the device does not give is asked for this seldom */
	int64_t not_before_ns;   /* when it is asked for again */
	int64_t period_ns;       /* not 0: see period.h */
	int64_t due_ns;          /* 0: at once */
};

/* Inside a frame: what a busy system's driver may add; what a network may, that sends a lost segment again. */
#define MODBUS_GAP_NS     (50 * NS_PER_MS)
#define MODBUS_TCP_GAP_NS (500 * NS_PER_MS)

/* Durations of one line. */
struct modbus_wire {
	int64_t char_ns;
	int64_t silence_ns; /* between frames: 3.5 characters */
	int64_t
	    before_ns; /* from the order to send until the first character: the port switches the direction */
	int64_t least_ns; /* from one request to the next, whatever it takes */
	int64_t gap_ns;   /* the most between two octets of a frame */
	bool connection;  /* and no wire: the durations of one are 0 */
	bool datagrams;   /* the same, a frame each */
	uint8_t framing;  /* enum modbus_framing */
};

/*
 * Of a TCP connection. Nothing but the device holds back its requests, and a fast one would keep this processor busy: so there
 * are 100 a second at most.
 */
struct modbus_wire modbus_wire_tcp(enum modbus_framing framing);
/* The same of Modbus TCP's frames in datagrams. */
struct modbus_wire modbus_wire_udp(void);

/* Durations at that speed. bits_per_char: start, data, parity and stop bits, 10..12. */
struct modbus_wire modbus_wire(uint32_t baud, unsigned bits_per_char);
/* The same for ASCII, where an octet is two characters: char_ns is that of an octet. */
struct modbus_wire modbus_wire_ascii(uint32_t baud, unsigned bits_per_char);

/* What the device takes, or is assumed to. */
int64_t modbus_reaction_ns(const struct modbus_limits *limits);

/*
 * The least time that a read of count bits or registers takes of the line: its request and its answer, a silence
 * after each (the device knows by the first that the request has ended), the device's reaction, and what the port
 * takes before it sends. On TCP, the reaction, or what the next request waits for.
 */
int64_t modbus_read_ns(const struct modbus_wire *wire, uint8_t function, uint16_t count, int64_t reaction_ns);

/* What it takes besides to choose the page of what is read, by a write of one register. */
int64_t modbus_page_ns(const struct modbus_wire *wire, int64_t reaction_ns);

/* Sorts by period, page, function, address: the order modbus_plan needs. */
void modbus_objects_sort(struct modbus_object *objects, size_t count);

/*
 * Plans the reads of count sorted objects into reads, which has room for count of them. Returns how
 * many reads it made. Neighbours of one period and page are merged within the limits, over a hole too when carrying the
 * hole takes less time than another request. An object that is wider than the limits is a read of its own.
 */
uint32_t modbus_plan(const struct modbus_wire *wire, const struct modbus_limits *limits,
		     const struct modbus_object *objects, uint32_t count, struct modbus_read *reads);

/*
 * Replaces reads[index] by two parts of it, for a device that refuses the whole with this exception (0: does not answer
 * it); *count grows by one. When the device says that an address is illegal, the parts are what is on either side
 * of the widest hole, the one nearest to the middle; else, and where there is none, the halves. False when it is a
 * single object and nothing was changed.
 */
bool modbus_plan_split(const struct modbus_object *objects, struct modbus_read *reads, uint32_t *count,
		       uint32_t index, uint8_t exception);

#endif
