/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/mms.h"

#include "iec61850/value.h"

/* Tags of MMSpdu (ISO 9506-2, clause 7). */
enum {
	CONFIRMED_REQUEST = 0xa0,
	CONFIRMED_RESPONSE = 0xa1,
	CONFIRMED_ERROR = 0xa2,
	UNCONFIRMED = 0xa3,
	REJECT = 0xa4,
	INITIATE_REQUEST = 0xa8,
	INITIATE_RESPONSE = 0xa9,
	INITIATE_ERROR = 0xaa,
	CONCLUDE_REQUEST = 0x8b,
	CONCLUDE_RESPONSE = 0x8c,
};

/* Tags of ConfirmedServiceRequest. The response has the same, but for the ones that are primitive. */
enum {
	STATUS = 0x80,
	NAME_LIST = 0xa1,
	IDENTIFY = 0x82,
	READ = 0xa4,
	WRITE = 0xa5,
	ACCESS_ATTRIBUTES = 0xa6,
	LIST_ATTRIBUTES = 0xac,
	LIST_DEFINE = 0xab,
	LIST_DELETE = 0xad,
	FILE_OPEN = 0xbf48,
	FILE_READ = 0x9f49,
	FILE_CLOSE = 0x9f4a,
	FILE_DIRECTORY = 0xbf4d,
	STATUS_RESPONSE = 0xa0,
	IDENTIFY_RESPONSE = 0xa2,
};

/* Reasons of a reject (7.5). */
enum { OF_REQUEST = 0x81, UNRECOGNIZED_SERVICE = 1, OTHER_REASON = 0, INVALID_ARGUMENT = 4 };
enum { OF_PDU = 0x85, UNKNOWN_PDU = 0, INVALID_PDU = 1 };

/* Codes of an Initiate-ErrorPDU. */
enum { OTHER = 0, CALLED_INSUFFICIENT = 3 };

#define INVOKE_ID_MAX UINT32_MAX

/* ---- initiate ---------------------------------------------------------------------------- */

/* Parameters CBB: str1, str2, vnam, vlis. Services: those of iec61850_serve, information report, conclude (18.2). */
static const uint8_t parameters[] = {5, 0xe1, 0x00};
static const uint8_t services[] = {3, 0xee, 0x1c, 0, 0, 0, 0, 0, 0, 0, 0xe5, 0x10};

enum { NEST_MAX = 10, CALLING_MAX = 1, CALLED_MAX = 16, VERSION = 1 };

/* What is proposed of a parameter, or what holds if nothing is. False: it is no number, or below 0. */
static bool proposed(const struct ber_element *initiate, uint32_t tag, int64_t if_none, int64_t *out)
{
	struct ber_element element;

	*out = if_none;
	return !ber_find(initiate, tag, &element) || (ber_integer(&element, out) && *out >= 0);
}

/* Of class initiate (ISO 9506-2, 7.4.3). There is no code for a size, which is a local detail. */
static enum iec61850_initiation refuse_initiate(struct ber_writer *writer, int code)
{
	const size_t end = writer->at;

	ber_put_integer(writer, 0x88, code);
	ber_close(writer, 0xa0, end);
	ber_close(writer, INITIATE_ERROR, end);
	return IEC61850_NOT_INITIATED;
}

static int64_t at_most(int64_t number, int64_t most)
{
	return number < most ? number : most;
}

/* What is agreed on is no more than what was proposed. */
enum iec61850_initiation iec61850_initiate(const struct ber_element *request, uint32_t *max_pdu,
					   struct ber_writer *writer)
{
	const size_t end = writer->at;
	struct ber_element initiate;
	int64_t octets, calling, called, nest;

	if (!ber_find(request, INITIATE_REQUEST, &initiate) ||
	    !proposed(&initiate, 0x80, *max_pdu, &octets) ||
	    !proposed(&initiate, 0x81, CALLING_MAX, &calling) || !proposed(&initiate, 0x82, -1, &called) ||
	    called < 0 || !proposed(&initiate, 0x83, NEST_MAX, &nest))
		return IEC61850_NO_INITIATE;
	if (octets < IEC61850_PDU_MIN)
		return refuse_initiate(writer, OTHER);
	if (called < 1)
		return refuse_initiate(writer, CALLED_INSUFFICIENT);
	*max_pdu = (uint32_t)at_most(octets, *max_pdu);
	ber_put(writer, 0x82, services, sizeof(services));
	ber_put(writer, 0x81, parameters, sizeof(parameters));
	ber_put_integer(writer, 0x80, VERSION);
	ber_close(writer, 0xa4, end);
	ber_put_integer(writer, 0x83, at_most(nest, NEST_MAX));
	ber_put_integer(writer, 0x82, at_most(called, CALLED_MAX));
	ber_put_integer(writer, 0x81, at_most(calling, CALLING_MAX)); /* what we call: nothing */
	ber_put_integer(writer, 0x80, *max_pdu);
	ber_close(writer, INITIATE_RESPONSE, end);
	return IEC61850_INITIATED;
}

/* ---- services that are short ------------------------------------------------------------- */

static enum iec61850_error status(struct ber_writer *writer)
{
	const size_t end = writer->at;

	ber_put_integer(writer, 0x81, 0); /* operational */
	ber_put_integer(writer, 0x80, 0); /* state changes allowed */
	ber_close(writer, STATUS_RESPONSE, end);
	return IEC61850_NO_ERROR;
}

static enum iec61850_error identify(struct ber_writer *writer)
{
	const size_t end = writer->at;

	ber_put_text(writer, 0x82, OPENRTU_VERSION);
	ber_put_text(writer, 0x81, "gateway");
	ber_put_text(writer, 0x80, "OpenRTU");
	ber_close(writer, IDENTIFY_RESPONSE, end);
	return IEC61850_NO_ERROR;
}

static enum iec61850_error access_attributes(const struct iec61850_server *server,
					     const struct ber_element *request, struct ber_writer *writer)
{
	const size_t end = writer->at;
	struct iec61850_object object;
	struct ber_element name;

	if (!ber_find(request, 0xa0, &name))
		return ber_find(request, 0xa1, &name) ? IEC61850_UNSUPPORTED : IEC61850_INVALID_REQUEST;
	if (!iec61850_variable(server, &name, &object))
		return IEC61850_NON_EXISTENT;
	iec61850_put_type(writer, &server->model, &object);
	ber_close(writer, 0xa2, end);
	ber_put(writer, 0x80, (const uint8_t[]){0}, 1); /* cannot be deleted */
	ber_close(writer, ACCESS_ATTRIBUTES, end);
	return IEC61850_NO_ERROR;
}

static enum iec61850_error list_attributes(const struct iec61850_server *server,
					   const struct ber_element *request, struct ber_writer *writer)
{
	const size_t end = writer->at;
	const struct iec61850_set *set = iec61850_variable_list(server, request);

	if (set == NULL)
		return IEC61850_NON_EXISTENT;
	for (uint32_t i = set->count; !writer->full && i-- > 0;) {
		const struct iec61850_object object = iec61850_member(&server->model, set, i);
		const size_t member = writer->at;
		char name[IEC61850_NAME_SIZE];

		iec61850_variable_name(&server->model, &object, name);
		ber_put_text(writer, BER_VISIBLE_STRING, name);
		iec61850_device_name(&server->model, object.device, name);
		ber_put_text(writer, BER_VISIBLE_STRING, name);
		ber_close(writer, 0xa1, member);
		ber_close(writer, 0xa0, member);
		ber_close(writer, BER_SEQUENCE, member);
	}
	ber_close(writer, 0xa1, end);
	ber_put(writer, 0x80,
		(const uint8_t[]){(uint32_t)(set - server->model.sets) >= server->model.set_count}, 1);
	ber_close(writer, LIST_ATTRIBUTES, end);
	return IEC61850_NO_ERROR;
}

/* ---- a request --------------------------------------------------------------------------- */

static bool carry_out(struct iec61850_server *server, const struct ber_element *service,
		      struct ber_writer *writer, enum iec61850_error *error)
{
	switch (service->tag) {
	case STATUS:
		*error = status(writer);
		return true;
	case NAME_LIST:
		*error = iec61850_name_list(server, service, writer);
		return true;
	case IDENTIFY:
		*error = identify(writer);
		return true;
	case READ:
		*error = iec61850_read(server, service, writer);
		return true;
	case WRITE:
		*error = iec61850_write(server, service, writer);
		return true;
	case ACCESS_ATTRIBUTES:
		*error = access_attributes(server, service, writer);
		return true;
	case LIST_ATTRIBUTES:
		*error = list_attributes(server, service, writer);
		return true;
	case LIST_DEFINE:
		*error = iec61850_list_define(server, service, writer);
		return true;
	case LIST_DELETE:
		*error = iec61850_list_delete(server, service, writer);
		return true;
	case FILE_OPEN:
		*error = iec61850_file_open(server, service, writer);
		return true;
	case FILE_READ:
		*error = iec61850_file_read(server, service, writer);
		return true;
	case FILE_CLOSE:
		*error = iec61850_file_close(server, service, writer);
		return true;
	case FILE_DIRECTORY:
		*error = iec61850_file_directory(server, service, writer);
		return true;
	default:
		return false;
	}
}

static void put_reject(struct ber_writer *writer, const int64_t *invoke_id, uint8_t of, int reason)
{
	const size_t end = writer->at;

	ber_put_integer(writer, of, reason);
	if (invoke_id != NULL)
		ber_put_integer(writer, 0x80, *invoke_id);
	ber_close(writer, REJECT, end);
}

static void put_error(struct ber_writer *writer, int64_t invoke_id, enum iec61850_error error)
{
	const size_t end = writer->at;

	ber_put_integer(writer, (uint8_t)(0x80 | error >> 8), error & 0xff);
	ber_close(writer, 0xa0, end);
	ber_close(writer, 0xa2, end);
	ber_put_integer(writer, 0x80, invoke_id);
	ber_close(writer, CONFIRMED_ERROR, end);
}

/* a0 0e  02 01 01  82 00: an invoke identifier, then the service. Modifiers were not agreed on. */
static enum iec61850_outcome serve_request(struct iec61850_server *server, const struct ber_element *request,
					   struct ber_writer *writer)
{
	enum iec61850_error error = IEC61850_NO_ERROR;
	struct ber_reader reader = ber_inside(request);
	const size_t end = writer->at;
	struct ber_element id, service;
	int64_t invoke_id;
	bool known;

	if (!ber_expect(&reader, BER_INTEGER, &id) || !ber_integer(&id, &invoke_id) || invoke_id < 0 ||
	    invoke_id > INVOKE_ID_MAX || !ber_next(&reader, &service)) {
		put_reject(writer, NULL, OF_PDU, INVALID_PDU);
		iec61850_count(server, IEC61850_COUNT_ERRORS);
		return IEC61850_ANSWERED;
	}
	server->invoke_id = invoke_id;
	known = carry_out(server, &service, writer, &error);
	if (error == IEC61850_LATER) {
		writer->at = end;
		return IEC61850_SILENT;
	}
	ber_put_integer(writer, BER_INTEGER, invoke_id);
	ber_close(writer, CONFIRMED_RESPONSE, end);
	if (writer->full)
		error = IEC61850_TOO_LONG;
	if (known && error == IEC61850_NO_ERROR)
		return IEC61850_ANSWERED;
	writer->at = end;
	writer->full = false;
	iec61850_count(server, IEC61850_COUNT_ERRORS);
	if (!known)
		put_reject(writer, &invoke_id, OF_REQUEST, UNRECOGNIZED_SERVICE);
	else if (error == IEC61850_INVALID_REQUEST)
		put_reject(writer, &invoke_id, OF_REQUEST, INVALID_ARGUMENT);
	else
		put_error(writer, invoke_id, error);
	return IEC61850_ANSWERED;
}

enum iec61850_outcome iec61850_serve(struct iec61850_server *server, const struct ber_element *octets,
				     struct ber_writer *writer)
{
	struct ber_reader reader = ber_inside(octets);
	struct ber_element pdu;

	iec61850_count(server, IEC61850_COUNT_REQUESTS);
	if (!ber_next(&reader, &pdu)) {
		put_reject(writer, NULL, OF_PDU, INVALID_PDU);
		return IEC61850_ANSWERED;
	}
	switch (pdu.tag) {
	case CONFIRMED_REQUEST:
		return serve_request(server, &pdu, writer);
	case CONCLUDE_REQUEST:
		ber_put(writer, CONCLUDE_RESPONSE, NULL, 0);
		return IEC61850_ANSWERED;
	case UNCONFIRMED:
	case REJECT:
		return IEC61850_SILENT;
	default:
		put_reject(writer, NULL, OF_PDU, UNKNOWN_PDU);
		return IEC61850_ANSWERED;
	}
}
