/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The services of MMS (ISO 9506) that the server has: a PDU in, at most one PDU out. */
#ifndef OPENRTU_IEC61850_MMS_H
#define OPENRTU_IEC61850_MMS_H

#include "ber/ber.h"
#include "iec61850/model.h"
#include "iec61850/stats.h"

#define IEC61850_VARIABLES_MAX 1024 /* of one request */

/* A member of a data set: its data object, and its place in the set. */
struct iec61850_chosen {
	uint32_t number, member;
};

struct iec61850_server {
	struct iec61850_model model;
	struct iec61850_stats *stats;
	/* What one request needs, whosever it is. */
	struct ber_element variables[IEC61850_VARIABLES_MAX];
	uint8_t *names;                 /* max_pdu octets */
	struct iec61850_chosen *chosen; /* as many as there are points */
	/* Whose turn it is, and when. */
	const void *client;
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

/* Answers an Initiate. The greatest PDU of the association is in max_pdu afterwards. False: it is none, or wants too little. */
bool iec61850_initiate(const struct ber_element *request, uint32_t *max_pdu, struct ber_writer *writer);
/* Answers any other PDU, which octets hold. writer has room for a PDU of the association's greatest size. */
enum iec61850_outcome iec61850_serve(struct iec61850_server *server, const struct ber_element *octets,
				     struct ber_writer *writer);

/* ---- for the files of the services --------------------------------------------------------- */

/* Classes and codes of errors (ISO 9506-2, 7.4.3). */
enum iec61850_error {
	IEC61850_NO_ERROR,
	IEC61850_UNDEFINED = 0x0201,       /* definition: object-undefined */
	IEC61850_UNSUPPORTED = 0x0204,     /* definition: object-attribute-inconsistent */
	IEC61850_TOO_LONG = 0x0301,        /* resource: memory-unavailable */
	IEC61850_NON_EXISTENT = 0x0702,    /* access: object-non-existent */
	IEC61850_INVALID_REQUEST = 0xffff, /* no error: the request is rejected */
};

/* An ObjectName that is a domain's: the variable of it. False: it is another, or there is none of this name. */
bool iec61850_variable(const struct iec61850_server *server, const struct ber_element *name,
		       struct iec61850_object *out);
/* The data set of an ObjectName: behind_last is for iec61850_member_before. False: there is none of this name. */
bool iec61850_variable_list(const struct iec61850_server *server, const struct ber_element *name,
			    struct iec61850_object *behind_last);
enum iec61850_error iec61850_name_list(struct iec61850_server *server, const struct ber_element *request,
				       struct ber_writer *writer);
enum iec61850_error iec61850_read(struct iec61850_server *server, const struct ber_element *request,
				  struct ber_writer *writer);
enum iec61850_error iec61850_write(struct iec61850_server *server, const struct ber_element *request,
				   struct ber_writer *writer);

#endif
