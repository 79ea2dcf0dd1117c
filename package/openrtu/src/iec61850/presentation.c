/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/presentation.h"

/* Tags of CP-type, CPA-type, CPR-type and User-data (8.2, 8.4). */
enum {
	CP_TYPE = 0x31,
	MODE = 0xa0,
	MODE_VALUE = 0x80,
	NORMAL_MODE = 0xa2,
	CALLED_SELECTOR = 0x82,
	RESPONDING_SELECTOR = 0x83,
	CONTEXTS = 0xa4,
	CONTEXT_RESULTS = 0xa5,
	USER_DATA = 0x61,
	SINGLE_TYPE = 0xa0,
};
enum { ACCEPTANCE = 0, PROVIDER_REJECTION = 2, NO_SUCH_SYNTAX = 1 };

static const uint8_t acse_syntax[] = {0x52, 0x01, 0x00, 0x01};      /* 2.2.1.0.1 */
static const uint8_t mms_syntax[] = {0x28, 0xca, 0x22, 0x02, 0x01}; /* 1.0.9506.2.1 */
static const uint8_t ber_syntax[] = {0x51, 0x01};                   /* 2.1.1 */

/* 30 0f  02 01 01  06 04 52 01 00 01  30 04 06 02 51 01 */
static bool read_context(const struct ber_element *context, struct iec61850_contexts *out)
{
	struct ber_reader reader = ber_inside(context);
	struct ber_element id, syntax, transfer;
	int64_t number;

	if (!ber_expect(&reader, BER_INTEGER, &id) || !ber_integer(&id, &number) || number < 1 ||
	    number > INT8_MAX || !ber_expect(&reader, BER_OBJECT_IDENTIFIER, &syntax) ||
	    !ber_expect(&reader, BER_SEQUENCE, &transfer) || out->count == IEC61850_CONTEXTS_MAX)
		return false;
	out->ids[out->count] = (int8_t)number;
	if (ber_is(&syntax, acse_syntax, sizeof(acse_syntax)))
		out->acse = (int8_t)number;
	else if (ber_is(&syntax, mms_syntax, sizeof(mms_syntax)))
		out->mms = (int8_t)number;
	out->known[out->count++] = out->acse == number || out->mms == number;
	return true;
}

/* The first PDV-list is looked at: neither ACSE nor MMS sends two. */
static bool read_list(const struct ber_element *user, int8_t context, struct ber_element *out)
{
	struct ber_element list, id;
	int64_t number;

	return ber_find(user, BER_SEQUENCE, &list) && ber_find(&list, BER_INTEGER, &id) &&
	       ber_integer(&id, &number) && number == context && ber_find(&list, SINGLE_TYPE, out);
}

bool iec61850_presentation_connect(const struct ber_element *octets, struct iec61850_contexts *contexts,
				   struct ber_element *called, struct ber_element *acse)
{
	struct ber_reader reader = ber_inside(octets);
	struct ber_element cp, normal, list, context, user;

	*contexts = (struct iec61850_contexts){0};
	if (!ber_expect(&reader, CP_TYPE, &cp) || !ber_find(&cp, NORMAL_MODE, &normal) ||
	    !ber_find(&normal, CONTEXTS, &list) || !ber_find(&normal, USER_DATA, &user))
		return false;
	if (!ber_find(&normal, CALLED_SELECTOR, called) || called->size > IEC61850_PRESENTATION_SELECTOR_MAX)
		called->size = 0;
	for (reader = ber_inside(&list); reader.at < reader.end;)
		if (!ber_expect(&reader, BER_SEQUENCE, &context) || !read_context(&context, contexts))
			return false;
	if (contexts->acse == 0 || contexts->mms == 0)
		return false;
	return read_list(&user, contexts->acse, acse);
}

bool iec61850_presentation_read(const struct ber_element *octets, int8_t context, struct ber_element *out)
{
	struct ber_reader reader = ber_inside(octets);
	struct ber_element user;

	return ber_expect(&reader, USER_DATA, &user) && read_list(&user, context, out);
}

/* What follows the mode, or in a CPR-type is all. */
static void put_parameters(struct ber_writer *writer, const struct iec61850_contexts *contexts,
			   const struct ber_element *called, size_t end)
{
	size_t list;

	iec61850_presentation_write(writer, contexts->acse, end);
	list = writer->at;
	for (unsigned i = contexts->count; i-- > 0;) {
		const size_t result = writer->at;

		if (contexts->known[i])
			ber_put(writer, 0x81, ber_syntax, sizeof(ber_syntax));
		else
			ber_put_integer(writer, 0x82, NO_SUCH_SYNTAX);
		ber_put_integer(writer, 0x80, contexts->known[i] ? ACCEPTANCE : PROVIDER_REJECTION);
		ber_close(writer, BER_SEQUENCE, result);
	}
	ber_close(writer, CONTEXT_RESULTS, list);
	if (called->size > 0)
		ber_put(writer, RESPONDING_SELECTOR, called->value, called->size);
}

void iec61850_presentation_accept(struct ber_writer *writer, const struct iec61850_contexts *contexts,
				  const struct ber_element *called, size_t end)
{
	size_t mode;

	put_parameters(writer, contexts, called, end);
	ber_close(writer, NORMAL_MODE, end);
	mode = writer->at;
	ber_put_integer(writer, MODE_VALUE, 1);
	ber_close(writer, MODE, mode);
	ber_close(writer, CP_TYPE, end);
}

void iec61850_presentation_reject(struct ber_writer *writer, const struct iec61850_contexts *contexts,
				  const struct ber_element *called, size_t end)
{
	put_parameters(writer, contexts, called, end);
	ber_close(writer, BER_SEQUENCE, end);
}

void iec61850_presentation_write(struct ber_writer *writer, int8_t context, size_t end)
{
	ber_close(writer, SINGLE_TYPE, end);
	ber_put_integer(writer, BER_INTEGER, context);
	ber_close(writer, BER_SEQUENCE, end);
	ber_close(writer, USER_DATA, end);
}
