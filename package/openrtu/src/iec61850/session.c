/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/session.h"

/* Identifiers of parameters (8.3). */
enum { REASON = 0x32, CALLED_SELECTOR = 0x34, USER_DATA = 0xc1 };

static const uint8_t give_tokens_and_data[] = {IEC61850_SPDU_DATA, 0, IEC61850_SPDU_DATA, 0};

/* A length of one octet, or of 255 and two more (8.2.5). */
static bool read_header(struct ber_reader *reader, struct ber_element *out)
{
	if (reader->end - reader->at < 2)
		return false;
	out->tag = *reader->at++;
	out->size = *reader->at++;
	if (out->size == 0xff) {
		if (reader->end - reader->at < 2)
			return false;
		out->size = (size_t)reader->at[0] << 8 | reader->at[1];
		reader->at += 2;
	}
	if ((size_t)(reader->end - reader->at) < out->size)
		return false;
	out->value = reader->at;
	reader->at += out->size;
	return true;
}

static bool read_parameters(const struct ber_element *spdu, struct iec61850_session *out)
{
	struct ber_reader reader = ber_inside(spdu);
	struct ber_element parameter;

	while (reader.at < reader.end) {
		if (!read_header(&reader, &parameter))
			return false;
		if (parameter.tag == USER_DATA)
			out->user_data = parameter;
		if (parameter.tag == CALLED_SELECTOR && parameter.size <= IEC61850_SESSION_SELECTOR_MAX)
			out->called = parameter;
	}
	return true;
}

bool iec61850_session_read(const uint8_t *octets, size_t size, struct iec61850_session *out)
{
	struct ber_reader reader = {octets, octets + size};
	struct ber_element spdu;

	*out = (struct iec61850_session){.user_data.value = octets, .called.value = octets};
	if (size >= sizeof(give_tokens_and_data) && octets[0] == IEC61850_SPDU_DATA) {
		out->kind = IEC61850_SPDU_DATA;
		out->user_data.value = octets + sizeof(give_tokens_and_data);
		out->user_data.size = size - sizeof(give_tokens_and_data);
		return octets[1] == 0 && octets[2] == IEC61850_SPDU_DATA && octets[3] == 0;
	}
	if (!read_header(&reader, &spdu) || reader.at != reader.end)
		return false;
	out->kind = (uint8_t)spdu.tag;
	switch (out->kind) {
	case IEC61850_SPDU_CONNECT:
	case IEC61850_SPDU_FINISH:
	case IEC61850_SPDU_ABORT:
		return read_parameters(&spdu, out);
	default:
		return false;
	}
}

static void put_header(struct ber_writer *writer, uint8_t kind, size_t end)
{
	const size_t size = end - writer->at;
	const uint8_t header[] = {kind, 0xff, (uint8_t)(size >> 8), (uint8_t)size};

	if (size < 0xff) {
		ber_put_octets(writer, (const uint8_t[]){kind, (uint8_t)size}, 2);
		return;
	}
	ber_put_octets(writer, header, sizeof(header));
}

void iec61850_session_write(struct ber_writer *writer, enum iec61850_spdu kind, size_t end,
			    const struct ber_element *called)
{
	/* Connect/accept item: no extended concatenation, version 2; the duplex functional unit alone. */
	static const uint8_t accept[] = {0x05, 6, 0x13, 1, 0, 0x16, 1, 2, 0x14, 2, 0, 2};
	static const uint8_t by_user[] = {2}; /* rejected by the called user, whose data follow */
	size_t selector;

	if (kind == IEC61850_SPDU_DATA) {
		ber_put_octets(writer, give_tokens_and_data, sizeof(give_tokens_and_data));
		return;
	}
	if (kind == IEC61850_SPDU_REFUSE) {
		ber_put_octets(writer, by_user, sizeof(by_user));
		put_header(writer, REASON, end);
	} else {
		put_header(writer, USER_DATA, end);
	}
	if (kind == IEC61850_SPDU_ACCEPT) {
		selector = writer->at;
		if (called->size > 0) {
			ber_put_octets(writer, called->value, called->size);
			put_header(writer, CALLED_SELECTOR, selector);
		}
		ber_put_octets(writer, accept, sizeof(accept));
	}
	put_header(writer, (uint8_t)kind, end);
}
