/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/acse.h"

/* Tags of the APDUs (9.1). */
enum {
	AARQ = 0x60,
	AARE = 0x61,
	RLRE = 0x63,
	CONTEXT_NAME = 0xa1,
	RESULT = 0xa2,
	DIAGNOSTIC = 0xa3,
	DIAGNOSTIC_OF_USER = 0xa1,
	USER_INFORMATION = 0xbe,
	EXTERNAL = 0x28,
	SINGLE_TYPE = 0xa0,
};

static const uint8_t mms_context[] = {0x28, 0xca, 0x22, 0x02, 0x03}; /* 1.0.9506.2.3 */

bool iec61850_acse_request(const struct ber_element *acse, struct ber_element *mms)
{
	static const uint32_t path[] = {AARQ, USER_INFORMATION, EXTERNAL, SINGLE_TYPE};

	return ber_follow(acse, path, sizeof(path) / sizeof(path[0]), mms);
}

enum { ACCEPTED = 0, REJECTED_PERMANENT = 1 };
enum { NO_DIAGNOSTIC = 0, NO_REASON = 1 };

void iec61850_acse_answer(struct ber_writer *writer, int8_t context, bool accepted, size_t end)
{
	size_t part;

	ber_close(writer, SINGLE_TYPE, end);
	ber_put_integer(writer, BER_INTEGER, context);
	ber_close(writer, EXTERNAL, end);
	ber_close(writer, USER_INFORMATION, end);
	part = writer->at;
	ber_put_integer(writer, BER_INTEGER, accepted ? NO_DIAGNOSTIC : NO_REASON);
	ber_close(writer, DIAGNOSTIC_OF_USER, part);
	ber_close(writer, DIAGNOSTIC, part);
	part = writer->at;
	ber_put_integer(writer, BER_INTEGER, accepted ? ACCEPTED : REJECTED_PERMANENT);
	ber_close(writer, RESULT, part);
	part = writer->at;
	ber_put(writer, BER_OBJECT_IDENTIFIER, mms_context, sizeof(mms_context));
	ber_close(writer, CONTEXT_NAME, part);
	ber_close(writer, AARE, end);
}

void iec61850_acse_released(struct ber_writer *writer)
{
	const size_t end = writer->at;

	ber_put_integer(writer, 0x80, 0); /* reason: normal */
	ber_close(writer, RLRE, end);
}
