/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * One GOOSE message: its frame on Ethernet (IEC 61850-8-1, annex C) and its PDU (IECGoosePdu, annex A). Octets and times are
 * arguments; nothing is allocated.
 */
#ifndef OPENRTU_GOOSE_MESSAGE_H
#define OPENRTU_GOOSE_MESSAGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define GOOSE_ETHERTYPE      0x88b8
#define GOOSE_FRAME_MAX      1518 /* 1 500 octets behind an Ethernet header with a VLAN's tag */
#define GOOSE_REFERENCE_SIZE 130  /* ObjectReference of 129 characters, terminator included */
#define GOOSE_ITEMS_MAX      128  /* of a data set, each leaf of a structure */

/* What stands in a data set. */
enum goose_kind {
	GOOSE_BOOLEAN,  /* bits 0, 1 */
	GOOSE_BITS,     /* the first of size bits is the highest of bits; 32 at most */
	GOOSE_INTEGER,  /* integer */
	GOOSE_UNSIGNED, /* bits */
	GOOSE_FLOAT,    /* real */
	GOOSE_TIME,     /* time */
	GOOSE_OTHER,    /* sound, and of a kind that no point has */
};

/* UtcTime (IEC 61850-8-1, 8.1.3.7). */
struct goose_time {
	int64_t utc_ns; /* since 1970; the format resolves 60 ns */
	uint8_t quality;
};

/* Bits of UtcTime's quality: leap seconds are known, the clock has failed, it is not synchronised; and no accuracy given. */
#define GOOSE_TIME_LEAPS       0x80
#define GOOSE_TIME_FAILED      0x40
#define GOOSE_TIME_UNSET       0x20
#define GOOSE_TIME_UNSPECIFIED 0x1f

struct goose_item {
	uint8_t kind; /* enum goose_kind */
	uint8_t size; /* GOOSE_BITS */
	union {
		uint32_t bits;
		int32_t integer;
		float real;
		struct goose_time time;
	};
};

/* Where a message goes and whose it is. */
struct goose_address {
	uint8_t destination[6], source[6];
	uint16_t app_id;
	bool tagged;
	uint16_t vlan;         /* 0..4095 */
	uint8_t vlan_priority; /* 0..7 */
};

/* A text of a PDU, not terminated. */
struct goose_text {
	const char *at;
	size_t size;
};

struct goose_message {
	struct goose_address address;
	struct goose_text control, data_set, id; /* references of control block and data set; GoID */
	uint32_t alive_ms;                       /* timeAllowedtoLive */
	struct goose_time time;                  /* of the last change of state */
	uint32_t state, sequence;                /* stNum, sqNum */
	uint32_t conf_rev;
	bool simulation, needs_commissioning;
	uint32_t entries;               /* numDatSetEntries: a structure counts once */
	uint32_t item_count;            /* its leaves */
	const struct goose_item *items; /* of what is encoded */
};

/* Returns how many octets of the frame are used; 0: they do not hold the message. */
size_t goose_encode(const struct goose_message *message, uint8_t frame[GOOSE_FRAME_MAX]);

/*
 * False: it is no GOOSE message, or a damaged one. The texts lie in the frame; items gets the leaves of the data set, in their
 * order. A frame whose tag the kernel has taken has none here.
 */
bool goose_decode(const uint8_t *frame, size_t size, struct goose_message *out,
		  struct goose_item items[GOOSE_ITEMS_MAX]);

#endif
