/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Read and Write (ISO 9506-2, 14.7 and 14.8). What a client may set, it sets by control blocks and commands only. */
#include <string.h>

#include "iec61850/block.h"
#include "iec61850/control.h"
#include "iec61850/mms.h"
#include "iec61850/tags.h"
#include "iec61850/value.h"

enum { WITH_SPECIFICATION = 0x80, SPECIFICATION = 0xa1, VARIABLES = 0xa0, LIST_NAME = 0xa1 };
enum { VARIABLE_NAME = 0xa0, ALTERNATE_ACCESS = 0xa5 };

enum { FAILURE = 0x80, SUCCESS = 0x81, DATA = 0xa0 }; /* FAILURE: of an AccessResult, or of a WriteResponse */

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
		return IEC61850_ACCESS_UNSUPPORTED;
	return iec61850_variable(server, &name, out) ? 0 : IEC61850_ACCESS_NON_EXISTENT;
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
		error = IEC61850_ACCESS_UNAVAILABLE;
	}
	if (error != 0)
		ber_put_integer(writer, FAILURE, error);
}

static enum iec61850_error read_list(struct iec61850_server *server, const struct ber_element *name,
				     struct ber_writer *writer)
{
	const size_t end = writer->at;
	const struct iec61850_set *set = iec61850_variable_list(server, name);

	if (set == NULL)
		return IEC61850_NON_EXISTENT;
	for (uint32_t i = set->count; !writer->full && i-- > 0;) {
		const struct iec61850_object object = iec61850_member(&server->model, set, i);
		const size_t member = writer->at;

		iec61850_count(server, IEC61850_COUNT_READS);
		if (!iec61850_put_value(writer, &server->model, &object)) {
			writer->at = member;
			ber_put_integer(writer, FAILURE, IEC61850_ACCESS_UNAVAILABLE);
		}
	}
	ber_close(writer, 0xa1, end);
	ber_close(writer, 0xa4, end);
	return IEC61850_NO_ERROR;
}

/* A Read of one variable that is SBO selects (7-2, 20.3.2). */
static bool selects(const struct iec61850_server *server, const struct ber_element *variable,
		    struct iec61850_object *out)
{
	return find(server, variable, out) == 0 && out->node != NULL && out->node->leaf == IEC61850_SBO;
}

enum iec61850_error iec61850_read(struct iec61850_server *server, const struct ber_element *request,
				  struct ber_writer *writer)
{
	const size_t end = writer->at;
	struct ber_element with, specification, list;
	struct iec61850_object object;
	int count, error;

	if (!ber_find(request, SPECIFICATION, &specification))
		return IEC61850_INVALID_REQUEST;
	if (ber_find(&specification, LIST_NAME, &list))
		return read_list(server, &list, writer);
	if (!ber_find(&specification, VARIABLES, &list))
		return IEC61850_INVALID_REQUEST;
	count = read_variables(server, &list);
	if (count < 0)
		return IEC61850_INVALID_REQUEST;
	if (count == 1 && selects(server, &server->variables[0], &object)) {
		const enum iec61850_error later = iec61850_control_select(server, &object, &error);

		if (later != IEC61850_NO_ERROR)
			return later;
	}
	while (count-- > 0 && !writer->full)
		put_result(server, &server->variables[count], writer);
	ber_close(writer, 0xa1, end);
	if (ber_find(request, WITH_SPECIFICATION, &with) && with.size == 1 && with.value[0] != 0)
		ber_put(writer, 0xa0, specification.value, specification.size);
	ber_close(writer, 0xa4, end);
	return IEC61850_NO_ERROR;
}

/* How many variables before this one have succeeded or not does not matter: each has its own answer. */
static void write_one(struct iec61850_server *server, const struct ber_element *variable,
		      const struct ber_element *data, struct ber_writer *writer)
{
	struct iec61850_object object;
	int error = find(server, variable, &object);

	if (error == 0 && object.fc == IEC61850_CO)
		error = IEC61850_ACCESS_UNSUPPORTED; /* a command is a Write of its own */
	if (error == 0)
		error = iec61850_block_write(server, &object, data);
	if (error != 0)
		ber_put_integer(writer, FAILURE, error);
	else
		ber_put(writer, SUCCESS, NULL, 0);
}

/* A service of a command: its answer comes when the device's has, but for what is no such service. */
static enum iec61850_error write_control(struct iec61850_server *server, const struct iec61850_object *object,
					 struct ber_reader *reader, struct ber_writer *writer)
{
	const size_t end = writer->at;
	enum iec61850_error later;
	struct ber_element data;
	int error;

	if (!ber_next(reader, &data))
		return IEC61850_INVALID_REQUEST;
	later = iec61850_control_write(server, object, &data, &error);
	if (later != IEC61850_NO_ERROR)
		return later;
	ber_put_integer(writer, FAILURE, error);
	ber_close(writer, 0xa5, end);
	return IEC61850_NO_ERROR;
}

/* The answers are written from the first on, since later writes may build on earlier ones: into the room, then as a whole. */
enum iec61850_error iec61850_write(struct iec61850_server *server, const struct ber_element *request,
				   struct ber_writer *writer)
{
	const size_t end = writer->at;
	struct ber_reader reader = ber_inside(request);
	struct ber_element list, data;
	uint8_t *answers = iec61850_room(writer);
	struct iec61850_object object;
	size_t size = 0;
	int count;

	if (!ber_expect(&reader, VARIABLES, &list) || !ber_expect(&reader, DATA, &data))
		return IEC61850_INVALID_REQUEST;
	count = read_variables(server, &list);
	if (count < 0)
		return IEC61850_INVALID_REQUEST;
	reader = ber_inside(&data);
	if (count == 1 && find(server, &server->variables[0], &object) == 0 && object.fc == IEC61850_CO)
		return write_control(server, &object, &reader, writer);
	for (int i = 0; i < count; i++) {
		uint8_t octets[8];
		struct ber_writer one = {.octets = octets, .at = sizeof(octets)};

		if (!ber_next(&reader, &data) || end - writer->floor < size + sizeof(octets))
			return IEC61850_INVALID_REQUEST;
		write_one(server, &server->variables[i], &data, &one);
		memcpy(answers + size, octets + one.at, sizeof(octets) - one.at);
		size += sizeof(octets) - one.at;
	}
	ber_put_octets(writer, answers, size);
	ber_close(writer, 0xa5, end);
	return IEC61850_NO_ERROR;
}
