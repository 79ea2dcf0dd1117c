/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/association.h"

#include "iec61850/acse.h"
#include "iec61850/block.h"
#include "iec61850/control.h"
#include "iec61850/report.h"
#include "iec61850/session.h"

#define ASSOCIATE_NS (10 * NS_PER_S) /* from the connection to the association */
#define STUCK_NS     (30 * NS_PER_S)
#define REST_NS      (60 * NS_PER_S) /* an association that asks nothing for so long may give way */

void iec61850_association_open(struct iec61850_association *association, uint32_t max_pdu, int64_t now_ns)
{
	iec61850_transport_open(&association->transport);
	association->max_pdu = max_pdu;
	association->associated = association->leaving = false;
	association->opened_ns = association->heard_ns = association->moved_ns = now_ns;
}

static void send(struct iec61850_association *association, const struct ber_writer *writer, size_t end)
{
	iec61850_transport_send(&association->transport, writer->octets + writer->at, end - writer->at);
}

/* The layers below MMS, around what writer holds since end. */
static void envelop(struct iec61850_association *association, struct ber_writer *writer, size_t end)
{
	writer->floor = 0;
	iec61850_presentation_write(writer, association->contexts.mms, end);
	iec61850_session_write(writer, IEC61850_SPDU_DATA, end, NULL);
	if (!writer->full)
		send(association, writer, end);
}

static void put_answer(struct iec61850_association *association, const struct iec61850_session *connect,
		       const struct ber_element *called, bool accepted, struct ber_writer *writer, size_t end)
{
	iec61850_acse_answer(writer, association->contexts.mms, accepted, end);
	if (accepted) {
		iec61850_presentation_accept(writer, &association->contexts, called, end);
		iec61850_session_write(writer, IEC61850_SPDU_ACCEPT, end, &connect->called);
	} else {
		iec61850_presentation_reject(writer, &association->contexts, called, end);
		iec61850_session_write(writer, IEC61850_SPDU_REFUSE, end, NULL);
	}
}

/* False: what comes is no request for an association with MMS. One that wants too little is told so, and left. */
static bool associate(struct iec61850_association *association, const struct iec61850_session *connect,
		      struct iec61850_server *server, struct ber_writer *writer)
{
	const size_t end = writer->at;
	enum iec61850_initiation initiation;
	struct ber_element called, acse, mms;

	if (connect->kind != IEC61850_SPDU_CONNECT ||
	    !iec61850_presentation_connect(&connect->user_data, &association->contexts, &called, &acse) ||
	    !iec61850_acse_request(&acse, &mms))
		return false;
	initiation = iec61850_initiate(&mms, &association->max_pdu, writer);
	if (initiation == IEC61850_NO_INITIATE)
		return false;
	put_answer(association, connect, &called, initiation == IEC61850_INITIATED, writer, end);
	if (writer->full)
		return false;
	send(association, writer, end);
	association->associated = initiation == IEC61850_INITIATED;
	association->leaving = !association->associated;
	if (association->associated)
		iec61850_count(server, IEC61850_COUNT_ASSOCIATIONS);
	return true;
}

/* The client has said its last: whatever it carries, it gets what answers a release. */
static void release(struct iec61850_association *association, struct ber_writer *writer)
{
	const size_t end = writer->at;

	iec61850_acse_released(writer);
	iec61850_presentation_write(writer, association->contexts.acse, end);
	iec61850_session_write(writer, IEC61850_SPDU_DISCONNECT, end, NULL);
	send(association, writer, end);
	association->leaving = true;
}

static bool serve(struct iec61850_association *association, const struct iec61850_session *data,
		  struct iec61850_server *server, struct ber_writer *writer)
{
	const size_t end = writer->at;
	struct ber_element mms;

	if (!iec61850_presentation_read(&data->user_data, association->contexts.mms, &mms))
		return false;
	writer->floor = end - association->max_pdu;
	if (iec61850_serve(server, &mms, writer) != IEC61850_SILENT)
		envelop(association, writer, end);
	return true;
}

/* True: what waited goes out: an answer first, then reports, since the value that a command has changed is told before its end. */
static bool tell(struct iec61850_association *association, struct iec61850_server *server, uint8_t *scratch)
{
	const size_t end = IEC61850_MESSAGE_SIZE(server->model.settings->max_pdu);
	struct ber_writer writer = {.octets = scratch, .at = end, .floor = end - association->max_pdu};

	if (!iec61850_control_put(server, &writer, false)) {
		if (iec61850_report_put(server, &writer))
			iec61850_count(server, IEC61850_COUNT_REPORTS);
		else if (!iec61850_control_put(server, &writer, true))
			return false;
	}
	envelop(association, &writer, end);
	return true;
}

static enum iec61850_end take(struct iec61850_association *association, struct iec61850_server *server,
			      uint8_t *scratch)
{
	const struct iec61850_transport *transport = &association->transport;
	const size_t end = IEC61850_MESSAGE_SIZE(server->model.settings->max_pdu);
	struct ber_writer writer = {.octets = scratch, .at = end};
	struct iec61850_session session;

	if (!iec61850_session_read(transport->message, transport->message_end, &session))
		return IEC61850_DAMAGED;
	if (!association->associated)
		return associate(association, &session, server, &writer) ? IEC61850_STAYS : IEC61850_DAMAGED;
	switch (session.kind) {
	case IEC61850_SPDU_DATA:
		return serve(association, &session, server, &writer) ? IEC61850_STAYS : IEC61850_DAMAGED;
	case IEC61850_SPDU_FINISH:
		release(association, &writer);
		return IEC61850_STAYS;
	case IEC61850_SPDU_ABORT:
		return IEC61850_RELEASED;
	default:
		return IEC61850_DAMAGED;
	}
}

enum iec61850_end iec61850_association_run(struct iec61850_association *association,
					   struct iec61850_server *server, uint8_t *scratch, int64_t now_ns)
{
	struct iec61850_transport *transport = &association->transport;
	enum iec61850_end end = IEC61850_STAYS;

	server->client = association;
	server->session = association->session;
	server->may_control = association->may_control;
	server->peer = association->peer;
	server->now_ns = now_ns;
	while (end == IEC61850_STAYS && iec61850_transport_is_free(transport)) {
		association->moved_ns = now_ns;
		if (association->leaving)
			return IEC61850_RELEASED;
		switch (iec61850_transport_next(transport)) {
		case IEC61850_NOTHING:
			if (association->associated && tell(association, server, scratch))
				break;
			return association->associated || now_ns - association->opened_ns < ASSOCIATE_NS
				   ? IEC61850_STAYS
				   : IEC61850_SILENT_START;
		case IEC61850_WRONG:
			return IEC61850_DAMAGED;
		case IEC61850_ENDED:
			return IEC61850_RELEASED;
		case IEC61850_MESSAGE:
			association->heard_ns = now_ns;
			end = take(association, server, scratch);
			break;
		}
	}
	if (end == IEC61850_STAYS && now_ns - association->moved_ns >= STUCK_NS)
		return IEC61850_STUCK;
	return end;
}

void iec61850_association_written(struct iec61850_association *association, size_t size, int64_t now_ns)
{
	iec61850_transport_written(&association->transport, size);
	association->moved_ns = now_ns;
}

void iec61850_association_end(struct iec61850_association *association, struct iec61850_server *server)
{
	iec61850_blocks_release(server, association);
	iec61850_controls_release(server, association);
	iec61850_file_release(server, association);
	iec61850_lists_release(server, association);
}

int64_t iec61850_association_idle_ns(const struct iec61850_association *association, int64_t now_ns)
{
	const int64_t idle_ns = now_ns - association->heard_ns;

	return !association->associated || idle_ns >= REST_NS ? idle_ns : 0;
}
