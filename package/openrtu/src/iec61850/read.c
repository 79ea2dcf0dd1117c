/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Read and Write (ISO 9506-2, 14.7 and 14.8). What a client may set, it sets by control blocks and commands only. */
#include "iec61850/mms.h"
#include "iec61850/value.h"

enum { WITH_SPECIFICATION = 0x80, SPECIFICATION = 0xa1, VARIABLES = 0xa0, LIST_NAME = 0xa1 };
enum { VARIABLE_NAME = 0xa0, ALTERNATE_ACCESS = 0xa5 };

/* DataAccessError (14.4.3). */
enum {
	TEMPORARILY_UNAVAILABLE = 2,
	OBJECT_ACCESS_DENIED = 3,
	OBJECT_ACCESS_UNSUPPORTED = 9,
	OBJECT_NON_EXISTENT = 10,
};

#define FAILURE 0x80 /* of an AccessResult, or of a WriteResponse */

/* The variables of a list, in the server's. -1: this is no list, or too long. */
static int read_variables(struct iec61850_server *server, const struct ber_element *list)
{
	struct ber_reader reader = ber_inside(list);
	int count = 0;

	while (reader.at < reader.end) {
		if (count == IEC61850_VARIABLES_MAX ||
		    !ber_expect(&reader, BER_SEQUENCE, &server->variables[count]))
			return -1;
		count++;
	}
	return count;
}

/* 0, or why a variable cannot be read. */
static int find(const struct iec61850_server *server, const struct ber_element *variable,
		struct iec61850_object *out)
{
	struct ber_element name, part;

	if (!ber_find(variable, VARIABLE_NAME, &name) || ber_find(variable, ALTERNATE_ACCESS, &part))
		return OBJECT_ACCESS_UNSUPPORTED;
	return iec61850_variable(server, &name, out) ? 0 : OBJECT_NON_EXISTENT;
}

static void put_result(struct iec61850_server *server, const struct ber_element *variable,
		       struct ber_writer *writer)
{
	struct iec61850_object object;
	const size_t end = writer->at;
	int error = find(server, variable, &object);

	iec61850_count(server, IEC61850_COUNT_READS);
	if (error == 0 && !iec61850_put_value(writer, &server->model, &object)) {
		writer->at = end;
		error = TEMPORARILY_UNAVAILABLE;
	}
	if (error != 0)
		ber_put_integer(writer, FAILURE, error);
}

enum iec61850_error iec61850_read(struct iec61850_server *server, const struct ber_element *request,
				  struct ber_writer *writer)
{
	const size_t end = writer->at;
	struct ber_element with, specification, list;
	int count;

	if (!ber_find(request, SPECIFICATION, &specification))
		return IEC61850_INVALID_REQUEST;
	if (!ber_find(&specification, VARIABLES, &list))
		return ber_find(&specification, LIST_NAME, &list) ? IEC61850_NON_EXISTENT
								  : IEC61850_INVALID_REQUEST;
	count = read_variables(server, &list);
	if (count < 0)
		return IEC61850_INVALID_REQUEST;
	while (count-- > 0 && !writer->full)
		put_result(server, &server->variables[count], writer);
	ber_close(writer, 0xa1, end);
	if (ber_find(request, WITH_SPECIFICATION, &with) && with.size == 1 && with.value[0] != 0)
		ber_put(writer, 0xa0, specification.value, specification.size);
	ber_close(writer, 0xa4, end);
	return IEC61850_NO_ERROR;
}

enum iec61850_error iec61850_write(struct iec61850_server *server, const struct ber_element *request,
				   struct ber_writer *writer)
{
	const size_t end = writer->at;
	struct ber_element list;
	int count;

	if (!ber_find(request, VARIABLES, &list))
		return IEC61850_INVALID_REQUEST;
	count = read_variables(server, &list);
	if (count < 0)
		return IEC61850_INVALID_REQUEST;
	while (count-- > 0) {
		struct iec61850_object object;
		const int error = find(server, &server->variables[count], &object);

		ber_put_integer(writer, FAILURE, error == 0 ? OBJECT_ACCESS_DENIED : error);
	}
	ber_close(writer, 0xa5, end);
	return IEC61850_NO_ERROR;
}
