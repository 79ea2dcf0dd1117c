/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An association of a client: its layers in their order, from octets to services and back. No I/O; time is an argument. */
#ifndef OPENRTU_IEC61850_ASSOCIATION_H
#define OPENRTU_IEC61850_ASSOCIATION_H

#include "iec61850/mms.h"
#include "iec61850/presentation.h"
#include "iec61850/transport.h"

/* Why a connection ends. */
enum iec61850_end {
	IEC61850_STAYS,
	IEC61850_RELEASED,     /* the client wants it */
	IEC61850_DAMAGED,      /* what came is no message of these protocols, or asks for what we have not */
	IEC61850_SILENT_START, /* no association came about in time */
	IEC61850_STUCK,        /* the client does not take what it asked for */
	IEC61850_NOT_SECURE,   /* its certificate is no longer good, or its keys are too old */
};

struct iec61850_association {
	struct iec61850_transport transport;
	struct iec61850_contexts contexts;
	uint32_t max_pdu;
	uint32_t session; /* as the server's: of this association alone */
	bool associated, leaving;
	struct iec61850_peer peer;
	bool may_control;
	int64_t opened_ns;
	int64_t heard_ns; /* the last request */
	int64_t moved_ns; /* the output was empty, or some of it went */
};

/* A new connection, in memory that the transport has. */
void iec61850_association_open(struct iec61850_association *association, uint32_t max_pdu, int64_t now_ns);
/*
 * Answers what has come, until an answer has to go first. scratch: IEC61850_MESSAGE_SIZE(max_pdu) octets of no meaning, which
 * associations share. Call it when octets have come or gone, and each second or so.
 */
enum iec61850_end iec61850_association_run(struct iec61850_association *association,
					   struct iec61850_server *server, uint8_t *scratch, int64_t now_ns);
/* The output has gone so far. */
void iec61850_association_written(struct iec61850_association *association, size_t size, int64_t now_ns);
/* The client is gone: what it had is others' again. */
void iec61850_association_end(struct iec61850_association *association, struct iec61850_server *server);
/* How long nothing was asked; of one that may give way to another. 0: it may not yet. */
int64_t iec61850_association_idle_ns(const struct iec61850_association *association, int64_t now_ns);

#endif
