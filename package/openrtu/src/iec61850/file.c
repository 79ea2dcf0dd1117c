/* SPDX-License-Identifier: GPL-3.0-or-later */
/* File services (ISO 9506-2, annex D; IEC 61850-8-1, clause 23): one file, the SCL file of this server, to be read. */
#include <stdio.h>
#include <string.h>

#include "iec61850/mms.h"

enum { FILE_OPEN = 0xbf48, FILE_READ = 0xbf49, FILE_CLOSE = 0x9f4a, FILE_DIRECTORY = 0xbf4d };
enum { GRAPHIC_STRING = 0x19, NAME = 0xa0, POSITION = 0x81, AFTER = 0xa1 };

#define FRAME     32 /* octets of the PDU around a part of the file */
#define NAME_SIZE (MAP_NAME_SIZE + sizeof(".cid"))

static void print_name(const struct iec61850_server *server, char out[NAME_SIZE])
{
	snprintf(out, NAME_SIZE, "%s.cid", server->model.settings->ied);
}

/* A FileName is one string; a path begins with / or not. False: it is of another form. */
static bool read_name(const struct ber_element *name, struct ber_element *out)
{
	struct ber_reader reader = ber_inside(name);

	*out = (struct ber_element){.value = name->value};
	if (reader.at == reader.end)
		return true;
	if (!ber_expect(&reader, GRAPHIC_STRING, out) || reader.at != reader.end)
		return false;
	if (out->size > 0 && out->value[0] == '/') {
		out->value++;
		out->size--;
	}
	return true;
}

static bool is_file(const struct iec61850_server *server, const struct ber_element *name)
{
	char own[NAME_SIZE];

	print_name(server, own);
	return server->file != NULL && ber_is(name, own, strlen(own));
}

static void put_attributes(const struct iec61850_server *server, struct ber_writer *writer)
{
	const size_t end = writer->at;

	if (server->file_date[0] != '\0')
		ber_put_text(writer, 0x81, server->file_date);
	ber_put_integer(writer, 0x80, (int64_t)server->file_size);
	ber_close(writer, 0xa1, end);
}

static void put_entry(const struct iec61850_server *server, struct ber_writer *writer)
{
	const size_t end = writer->at;
	char own[NAME_SIZE];
	size_t name;

	put_attributes(server, writer);
	name = writer->at;
	print_name(server, own);
	ber_put_text(writer, GRAPHIC_STRING, own);
	ber_close(writer, NAME, name);
	ber_close(writer, BER_SEQUENCE, end);
}

enum iec61850_error iec61850_file_directory(const struct iec61850_server *server,
					    const struct ber_element *request, struct ber_writer *writer)
{
	const size_t end = writer->at;
	struct ber_element given, name, after;
	const bool one = ber_find(request, NAME, &given);

	if (one && !read_name(&given, &name))
		return IEC61850_INVALID_REQUEST;
	if (one && name.size > 0 && !is_file(server, &name))
		return IEC61850_NO_FILE;
	if (server->file != NULL && !ber_find(request, AFTER, &after))
		put_entry(server, writer);
	ber_close(writer, BER_SEQUENCE, end);
	ber_close(writer, 0xa0, end);
	ber_close(writer, FILE_DIRECTORY, end);
	return IEC61850_NO_ERROR;
}

/* Of a client; of NULL: a free place. NULL: there is none. */
static struct iec61850_reading *find_reading(struct iec61850_server *server, const void *client)
{
	for (unsigned i = 0; i < IEC61850_ASSOCIATIONS_MAX; i++)
		if (server->readings[i].client == client)
			return &server->readings[i];
	return NULL;
}

void iec61850_file_release(struct iec61850_server *server, const void *client)
{
	struct iec61850_reading *reading = find_reading(server, client);

	if (reading != NULL)
		reading->client = NULL;
}

enum iec61850_error iec61850_file_open(struct iec61850_server *server, const struct ber_element *request,
				       struct ber_writer *writer)
{
	const size_t end = writer->at;
	struct iec61850_reading *reading = find_reading(server, server->client);
	struct ber_element given, name;
	int64_t position = 0;

	if (!ber_find(request, NAME, &given) || !read_name(&given, &name) ||
	    (ber_find(request, POSITION, &given) && !ber_integer(&given, &position)))
		return IEC61850_INVALID_REQUEST;
	if (!is_file(server, &name))
		return IEC61850_NO_FILE;
	if (position < 0 || position > (int64_t)server->file_size)
		return IEC61850_FILE_POSITION;
	if (reading == NULL) /* there are as many as associations */
		reading = find_reading(server, NULL);
	if (reading == NULL)
		return IEC61850_TOO_LONG;
	*reading = (struct iec61850_reading){
	    .client = server->client, .number = ++server->reading, .at = (size_t)position};
	put_attributes(server, writer);
	ber_put_integer(writer, 0x80, (int32_t)reading->number);
	ber_close(writer, FILE_OPEN, end);
	return IEC61850_NO_ERROR;
}

/* The client's file, if it is the one that the request names. */
static struct iec61850_reading *reading_of(struct iec61850_server *server, const struct ber_element *request)
{
	struct iec61850_reading *reading = find_reading(server, server->client);
	int64_t number;

	return reading != NULL && ber_integer(request, &number) && number == (int32_t)reading->number
		   ? reading
		   : NULL;
}

enum iec61850_error iec61850_file_read(struct iec61850_server *server, const struct ber_element *request,
				       struct ber_writer *writer)
{
	const size_t end = writer->at, room = end - writer->floor - FRAME;
	struct iec61850_reading *reading = reading_of(server, request);
	size_t size;

	if (reading == NULL)
		return IEC61850_NON_EXISTENT;
	size = server->file_size - reading->at;
	if (size > room)
		size = room;
	ber_put(writer, 0x81, (const uint8_t[]){reading->at + size < server->file_size ? 0xff : 0}, 1);
	ber_put(writer, 0x80, server->file + reading->at, size);
	ber_close(writer, FILE_READ, end);
	reading->at += size;
	return IEC61850_NO_ERROR;
}

enum iec61850_error iec61850_file_close(struct iec61850_server *server, const struct ber_element *request,
					struct ber_writer *writer)
{
	struct iec61850_reading *reading = reading_of(server, request);

	if (reading == NULL)
		return IEC61850_NON_EXISTENT;
	reading->client = NULL;
	ber_put(writer, FILE_CLOSE, NULL, 0);
	return IEC61850_NO_ERROR;
}
