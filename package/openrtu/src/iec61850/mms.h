/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The services of MMS (ISO 9506) that the server has: a PDU in, at most one PDU out. */
#ifndef OPENRTU_IEC61850_MMS_H
#define OPENRTU_IEC61850_MMS_H

#include "ber/ber.h"
#include "iec61850/model.h"
#include "iec61850/stats.h"

#define IEC61850_VARIABLES_MAX 1024 /* of one request */

#define IEC61850_CONTROLS_EACH 8 /* commands of one client at a time */
#define IEC61850_CONTROLS      (IEC61850_ASSOCIATIONS_MAX * IEC61850_CONTROLS_EACH)
#define IEC61850_WISH_SIZE     160 /* octets of a command's parameters: 112 in their shortest form */

/* What a service of a command says. */
struct iec61850_wish {
	union map_value value;
	bool out_of_range; /* the point has no such value */
	bool test;
	uint8_t number;   /* ctlNum */
	uint8_t category; /* orCat */
	uint8_t identity_size;
	uint8_t identity[IEC61850_OR_IDENT_SIZE]; /* orIdent */
	uint16_t octet_count;
	uint8_t octets[IEC61850_WISH_SIZE]; /* its elements, as they came */
};

/* A file that a client reads: it has one at a time. */
struct iec61850_reading {
	const void *client; /* NULL: none */
	uint32_t number;    /* its FRSM */
	size_t at;
};

enum iec61850_phase {
	IEC61850_CONTROL_OVER,
	IEC61850_SELECTING,
	IEC61850_SELECTED,
	IEC61850_RESELECTING, /* with the value that a selection by SBO had not */
	IEC61850_OPERATING,   /* the device has not confirmed it yet */
	IEC61850_EXECUTING,   /* it has */
	IEC61850_CANCELLING,
	IEC61850_ORPHANED, /* it has ended with the point's owner, whose next process is to release it */
};

/* A command of a client, from its selection to its end: iec61850/control.h. */
struct iec61850_control {
	const void *client; /* NULL: it has gone */
	int64_t invoke_id;  /* of the service that is to be answered */
	struct iec61850_object object;
	struct iec61850_wish wish;
	struct map_request request;
	uint32_t generation; /* of the point's owner */
	uint8_t phase;       /* enum iec61850_phase */
	uint8_t owes;        /* what is to be said, in bits */
	uint8_t cause;       /* AddCause; 0: it was not refused */
	bool accepted;       /* the service that is to be answered was */
};

struct iec61850_server {
	struct iec61850_model model;
	struct map *map;
	struct iec61850_stats *stats;
	/* What one request needs, whosever it is. */
	struct ber_element variables[IEC61850_VARIABLES_MAX];
	uint32_t *chosen; /* members of a data set: model.longest_set */
	struct iec61850_control controls[IEC61850_CONTROLS];
	unsigned control_count; /* places of which were used: the others are free */
	const uint8_t *file;    /* the SCL file; NULL: there is none */
	size_t file_size;
	char file_date[sizeof("20000101000000Z")]; /* when it was written; empty: nobody knows */
	struct iec61850_reading readings[IEC61850_ASSOCIATIONS_MAX];
	uint32_t reading; /* number of the last one */
	/* Whose turn it is, what it asks, and when. */
	const void *client;
	uint32_t session; /* of it, as selections are told apart */
	struct iec61850_peer peer;
	bool may_control;
	bool catching_up;                      /* with the events of a former process */
	const struct map_history_entry *entry; /* that is being told; NULL: none */
	int64_t invoke_id;
	int64_t now_ns;
};

static inline void iec61850_count(const struct iec61850_server *server, enum iec61850_counter counter)
{
	map_count(&server->stats->counters[counter], 1);
}

enum iec61850_outcome {
	IEC61850_ANSWERED,
	IEC61850_SILENT, /* nothing is to be said */
};

enum iec61850_initiation {
	IEC61850_NO_INITIATE,
	IEC61850_INITIATED,     /* the greatest PDU of the association is in max_pdu */
	IEC61850_NOT_INITIATED, /* it wants too little: the answer is an Initiate-ErrorPDU */
};

/* Answers an Initiate. */
enum iec61850_initiation iec61850_initiate(const struct ber_element *request, uint32_t *max_pdu,
					   struct ber_writer *writer);
/* Answers any other PDU, which octets hold. writer has room for a PDU of the association's greatest size. */
enum iec61850_outcome iec61850_serve(struct iec61850_server *server, const struct ber_element *octets,
				     struct ber_writer *writer);

/* ---- for the files of the services --------------------------------------------------------- */

/* Where octets may lie for a moment, until they are put as a whole: what writer has not filled. */
static inline uint8_t *iec61850_room(const struct ber_writer *writer)
{
	return writer->octets + writer->floor;
}

/* Classes and codes of errors (ISO 9506-2, 7.4.3). */
enum iec61850_error {
	IEC61850_NO_ERROR,
	IEC61850_LATER,                    /* no error: the answer comes by itself */
	IEC61850_UNDEFINED = 0x0201,       /* definition: object-undefined */
	IEC61850_UNSUPPORTED = 0x0204,     /* definition: type-inconsistent */
	IEC61850_EXISTS = 0x0205,          /* definition: object-exists */
	IEC61850_INCONSISTENT = 0x0206,    /* definition: object-attribute-inconsistent */
	IEC61850_TOO_LONG = 0x0301,        /* resource: memory-unavailable */
	IEC61850_NO_SUCH_ACCESS = 0x0701,  /* access: object-access-unsupported */
	IEC61850_NON_EXISTENT = 0x0702,    /* access: object-non-existent */
	IEC61850_FILE_POSITION = 0x0b05,   /* file: position-invalid */
	IEC61850_NO_FILE = 0x0b07,         /* file: file-non-existent */
	IEC61850_INVALID_REQUEST = 0xffff, /* no error: the request is rejected */
};

/* An ObjectName that is a domain's: the variable of it. False: it is another, or there is none of this name. */
bool iec61850_variable(const struct iec61850_server *server, const struct ber_element *name,
		       struct iec61850_object *out);
/* The data set of an ObjectName. NULL: there is none of this name. */
const struct iec61850_set *iec61850_variable_list(const struct iec61850_server *server,
						  const struct ber_element *name);
enum iec61850_error iec61850_name_list(struct iec61850_server *server, const struct ber_element *request,
				       struct ber_writer *writer);
enum iec61850_error iec61850_read(struct iec61850_server *server, const struct ber_element *request,
				  struct ber_writer *writer);
/* An ObjectName of a data set: the logical device, NULL if it is an association's own, and the item. False: it is another. */
bool iec61850_list_name(const struct iec61850_server *server, const struct ber_element *name,
			const struct iec61850_device **device, struct ber_element *item);
enum iec61850_error iec61850_list_define(struct iec61850_server *server, const struct ber_element *request,
					 struct ber_writer *writer);
enum iec61850_error iec61850_list_delete(struct iec61850_server *server, const struct ber_element *request,
					 struct ber_writer *writer);
/* A client is gone, and its control blocks are others'. */
void iec61850_lists_release(struct iec61850_server *server, const void *client);
enum iec61850_error iec61850_file_open(struct iec61850_server *server, const struct ber_element *request,
				       struct ber_writer *writer);
enum iec61850_error iec61850_file_read(struct iec61850_server *server, const struct ber_element *request,
				       struct ber_writer *writer);
enum iec61850_error iec61850_file_close(struct iec61850_server *server, const struct ber_element *request,
					struct ber_writer *writer);
enum iec61850_error iec61850_file_directory(const struct iec61850_server *server,
					    const struct ber_element *request, struct ber_writer *writer);
/* A client is gone. */
void iec61850_file_release(struct iec61850_server *server, const void *client);
enum iec61850_error iec61850_write(struct iec61850_server *server, const struct ber_element *request,
				   struct ber_writer *writer);

#endif
