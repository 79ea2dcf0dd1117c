/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a device says of itself: function 43/14, device identification (MODBUS Application Protocol V1.1b3, 6.21). Its stream of the
 * basic and the regular objects is asked for, by as many requests as the device wants. One that refuses or does not answer is left
 * alone until it is back, and for good after MODBUS_IDENTITY_SILENCES without an answer: some hang, or hang up, at a function that
 * they do not know.
 */
#ifndef OPENRTU_MODBUS_IDENTITY_H
#define OPENRTU_MODBUS_IDENTITY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "modbus/frame.h"

/* Its objects, as the configuration and lists call them, and as the specification does. */
#define MODBUS_IDENTITY_NAMES(name)                                                                          \
	name("vendor_name", "VendorName, object 0.") name("product_code", "ProductCode, object 1.")          \
	    name("revision", "MajorMinorRevision, object 2.") name("vendor_url", "VendorUrl, object 3.")     \
		name("product_name", "ProductName, object 4.") name("model_name", "ModelName, object 5.")    \
		    name("application_name", "UserApplicationName, object 6.")

#define MODBUS_IDENTITY_OBJECTS  7
#define MODBUS_IDENTITY_SIZE     128 /* of all texts, each with its number and length */
#define MODBUS_IDENTITY_TEXT     40  /* octets that are kept of one */
#define MODBUS_IDENTITY_REQUESTS 8
#define MODBUS_IDENTITY_SILENCES 2

enum modbus_identity_state {
	MODBUS_IDENTITY_UNASKED, /* or not to the end */
	MODBUS_IDENTITY_KNOWN,
	MODBUS_IDENTITY_REFUSED,
	MODBUS_IDENTITY_SILENT,
};

struct modbus_identity {
	uint8_t texts[MODBUS_IDENTITY_SIZE]; /* each: its number, its length, its octets */
	uint8_t size;                        /* of these */
	uint8_t state;                       /* enum modbus_identity_state */
	uint8_t silences;                    /* requests without an answer */
	bool news;                           /* the caller's to clear */
	/* Its own. */
	uint8_t access, next; /* of the next request: regular or basic, the object */
	uint8_t requests;     /* answered, of this time */
};

/* The device is there: for the first time, or again. */
void modbus_identity_begin(struct modbus_identity *identity);
/* There is something to ask. */
bool modbus_identity_is_wanted(const struct modbus_identity *identity);
struct modbus_request modbus_identity_request(const struct modbus_identity *identity, uint8_t unit);
/* body: a whole answer, which was judged to be one. */
void modbus_identity_answered(struct modbus_identity *identity, const uint8_t *body);
void modbus_identity_refused(struct modbus_identity *identity, uint8_t exception);
void modbus_identity_unanswered(struct modbus_identity *identity);

/* The text of an object in UTF-8, from size octets of texts; empty: there is none. */
#define MODBUS_IDENTITY_WORDS (2 * MODBUS_IDENTITY_TEXT + 1)
extern const char *const modbus_identity_names[MODBUS_IDENTITY_OBJECTS];
void modbus_identity_text(const uint8_t *texts, size_t size, uint8_t object, char out[MODBUS_IDENTITY_WORDS]);
/* Whether it is this one, in Latin-1; empty: there is none. */
bool modbus_identity_is(const uint8_t *texts, size_t size, uint8_t object, const char *latin);

#endif
