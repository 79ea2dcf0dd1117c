/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What rtu-centre and its consumer send each other on the Unix socket, octet by octet as in docs/centre.md: a packet to the
 * consumer is a batch, a header and records; a packet from it is one request or several. All is little-endian.
 */
#ifndef OPENRTU_CENTRE_RECORDS_H
#define OPENRTU_CENTRE_RECORDS_H

#include <stdint.h>

#include "map/map.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the structures below are what is sent");

#define CENTRE_MAGIC         0x31555452u /* "RTU1" */
#define CENTRE_NAME_SIZE     32          /* of a station, its zero included */
#define CENTRE_OCTETS_SIZE   24          /* of a connection, in a record */
#define CENTRE_REQUESTS_SIZE 2048        /* of a packet of requests at most */
#define CENTRE_BATCH_MAX     1024        /* records: a batch fits the socket's usual buffer */

enum centre_kind {
	CENTRE_STATION = 1, /* a station of the configuration, before all else of it */
	CENTRE_LINK,        /* its connection has another state */
	CENTRE_INFORMATION, /* an information object */
	CENTRE_POSITION,    /* a position */
	CENTRE_PROGRESS,    /* a request has another state */
	CENTRE_OTHER,       /* an ASDU that says none of these */
	CENTRE_OCTETS,      /* of a connection that is traced, as they came or went */
};

enum centre_flag {
	CENTRE_LAST = 1u << 0, /* of its ASDU, which is acknowledged to the station once this record is */
	CENTRE_TEST = 1u << 1, /* T: sent for a test, no process information */
	CENTRE_TAGGED = 1u << 2,
	CENTRE_TIME_INVALID = 1u << 3,
	CENTRE_NEGATIVE = 1u << 4, /* P/N */
	CENTRE_SENT = 1u << 5,     /* octets: to the station */
	CENTRE_GAP = 1u << 6,      /* octets: some before them are left out */
};

enum centre_link {
	CENTRE_WAITING, /* for its turn, or for its next attempt */
	CENTRE_CONNECTING,
	CENTRE_STARTING, /* connected, STARTDT act is not confirmed; not told */
	CENTRE_UP,
	CENTRE_DOWN,     /* in a record only: why, and when the next attempt is */
	CENTRE_STANDBY,  /* connected, while another link of the station has data transfer */
	CENTRE_SECURING, /* connected, the handshake of TLS is under way; not told */
};

/* Why a request was not sent, beside enum map_command_result. */
enum centre_result {
	CENTRE_NOT_UP = 64, /* the station is not connected: it never gets this request */
	CENTRE_BUSY,        /* too much is open, at the station or at the consumer */
	CENTRE_NOT_KNOWN,   /* no such station, or no accepted selection of this id */
};

struct centre_record {
	uint8_t kind;
	uint8_t flags;
	uint16_t ca;
	uint32_t station;    /* its place in the configuration, from 0 */
	uint32_t connection; /* of the station: 1, 2, ... */
	uint32_t ioa;
	union {
		char name[CENTRE_NAME_SIZE]; /* CENTRE_STATION */
		struct {
			int64_t seen_ns;                    /* since 1970, UTC */
			uint8_t octets[CENTRE_OCTETS_SIZE]; /* CENTRE_OCTETS; ca says how many */
		};
		struct {
			int64_t received_ns; /* since 1970, UTC, by the clock of this machine */
			int64_t wall_ns;     /* CENTRE_TAGGED: since 1970, UTC */
			uint8_t type;        /* of the ASDU; of a request, the type it was sent as */
			uint8_t cause;
			uint8_t quality; /* enum map_quality */
			uint8_t
			    detail; /* as struct iec104_information; of a position: fix, satellites << 4; of a link: its number */
			union {
				struct {
					union map_value value;
					uint16_t elapsed_ms;
					uint8_t content; /* enum iec104_content */
				} information;
				struct {
					int32_t latitude, longitude; /* 1e-7 degree */
					int32_t altitude_dm;
				} position;
				struct {
					uint8_t state;  /* enum map_command_state */
					uint8_t result; /* enum map_command_result, enum centre_result */
					uint16_t reserved;
					uint32_t id_low, id_high; /* of the consumer's request; 0: a poll */
				} progress;
				struct {
					uint8_t state;  /* enum centre_link */
					uint8_t reason; /* enum iec104_closing; 0: see error */
					uint16_t reserved;
					uint32_t error;    /* errno */
					uint32_t retry_ms; /* until the next attempt */
				} link;
			};
		};
	};
};
_Static_assert(sizeof(struct centre_record) == 48, "as documented");

struct centre_batch {
	uint32_t magic;
	uint16_t record_size;
	uint16_t count;
	uint64_t sequence; /* 1, 2, ... of each connected consumer */
	struct centre_record records[];
};
_Static_assert(sizeof(struct centre_batch) == 16, "as documented");

enum centre_request_kind {
	CENTRE_ACKNOWLEDGE = 1, /* all batches up to the one whose sequence is id */
	CENTRE_COMMAND,
	CENTRE_EXECUTE, /* the accepted selection of this id */
	CENTRE_CANCEL,
	CENTRE_INTERROGATE, /* qualifier: QOI */
	CENTRE_COUNTERS,    /* qualifier: QCC */
	CENTRE_READ,
	CENTRE_SET_CLOCK,
	CENTRE_TEST_COMMAND, /* value: the 16 bits that the station mirrors */
	CENTRE_RESET,        /* qualifier: QRP */
	CENTRE_TRACE,        /* the octets of its connections; value 1: from now on, 0: no more */
};

enum centre_request_flag {
	CENTRE_SELECT = 1u << 0,
	CENTRE_WITH_TIME = 1u << 1,
};

struct centre_request {
	uint8_t kind;
	uint8_t type; /* of a command: enum map_type */
	uint16_t ca;
	uint32_t station;
	uint64_t id; /* the consumer's own, not 0 */
	uint32_t ioa;
	union map_value value;
	uint8_t flags; /* enum centre_request_flag */
	uint8_t qualifier;
	int8_t step; /* of a regulating step: -1, 1 */
	uint8_t reserved[5];
};
_Static_assert(sizeof(struct centre_request) == 32, "as documented");

#endif
