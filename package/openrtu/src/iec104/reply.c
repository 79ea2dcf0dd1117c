/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Confirmations, refusals and the answers to read commands, which wait in a queue for room in k. */
#include "iec104/station_parts.h"

#include <string.h>

static void count_refusal(struct iec104_connection *connection, enum iec104_cause cause, bool negative)
{
	_Atomic uint32_t *counters = connection->session.counters;

	if (cause >= IEC104_UNKNOWN_TYPE)
		map_count(&counters[IEC104_COUNT_UNKNOWN_TYPE + (int)cause - (int)IEC104_UNKNOWN_TYPE], 1);
	else if (negative)
		map_count(&counters[IEC104_COUNT_NEGATIVE], 1);
}

void iec104_mirror(struct iec104_connection *connection, const uint8_t *asdu, size_t size,
		   enum iec104_cause cause, bool negative)
{
	struct iec104_replies *replies = &connection->replies;

	count_refusal(connection, cause, negative);
	if (sizeof(replies->bytes) - replies->end < size + 1) {
		replies->end = (uint16_t)(replies->end - replies->begin);
		memmove(replies->bytes, replies->bytes + replies->begin, replies->end);
		replies->begin = 0;
	}
	if (sizeof(replies->bytes) - replies->end < size + 1) {
		iec104_session_close(&connection->session, IEC104_UNREAD_ANSWERS);
		return;
	}
	replies->bytes[replies->end] = (uint8_t)size;
	memcpy(replies->bytes + replies->end + 1, asdu, size);
	iec104_asdu_mirror(replies->bytes + replies->end + 1, cause, negative);
	replies->end = (uint16_t)(replies->end + size + 1);
}

void iec104_refuse(const struct iec104_received *received, enum iec104_cause cause)
{
	iec104_mirror(received->connection, received->bytes, received->size, cause, true);
}

void iec104_confirm(const struct iec104_received *received, bool negative)
{
	iec104_mirror(received->connection, received->bytes, received->size,
		      received->asdu.cause == IEC104_DEACTIVATION ? IEC104_DEACTIVATION_CON
								  : IEC104_ACTIVATION_CON,
		      negative);
}

/* The oldest reply, or NULL. A read command stands in the queue as such, until its turn. */
static const uint8_t *first_reply(const struct iec104_connection *connection, size_t *size)
{
	const struct iec104_replies *replies = &connection->replies;

	if (replies->begin == replies->end)
		return NULL;
	*size = replies->bytes[replies->begin];
	return replies->bytes + replies->begin + 1;
}

static void drop_first_reply(struct iec104_connection *connection, size_t size)
{
	struct iec104_replies *replies = &connection->replies;

	replies->begin = (uint16_t)(replies->begin + size + 1);
	if (replies->begin == replies->end)
		replies->begin = replies->end = 0;
}

static bool is_read(const uint8_t *asdu, size_t size, struct iec104_asdu *read)
{
	return iec104_asdu_decode(asdu, size, read) && read->type == IEC104_C_RD_NA_1 && !read->negative;
}

bool iec104_send_confirmation(struct iec104_connection *connection, int64_t now_ns)
{
	struct iec104_asdu read;
	size_t size;
	const uint8_t *asdu = first_reply(connection, &size);

	if (asdu == NULL || is_read(asdu, size, &read))
		return false;
	iec104_session_send(&connection->session, asdu, size, now_ns);
	drop_first_reply(connection, size);
	return true;
}

/* Not a word of the value: the read command comes back with P/N = 1. */
static void refuse_read(struct iec104_connection *connection, const uint8_t *asdu, size_t size,
			int64_t now_ns)
{
	uint8_t refusal[IEC104_ASDU_HEADER + IEC104_IOA_SIZE];

	memcpy(refusal, asdu, sizeof(refusal));
	iec104_asdu_mirror(refusal, IEC104_REQUEST, true);
	count_refusal(connection, IEC104_REQUEST, true);
	iec104_session_send(&connection->session, refusal, sizeof(refusal), now_ns);
	drop_first_reply(connection, size);
}

bool iec104_answer_read(const struct iec104_station *station, struct iec104_connection *connection,
			int64_t now_ns)
{
	struct iec104_manner manner = {.cause = IEC104_REQUEST};
	struct iec104_builder builder;
	struct iec104_asdu read;
	struct map_sample samples[IEC104_SAMPLES];
	uint32_t point;
	size_t size;
	const uint8_t *asdu = first_reply(connection, &size);

	if (asdu == NULL || !is_read(asdu, size, &read))
		return false;
	point = map_find(station->map, read.ca, iec104_ioa_decode(read.objects));
	if (!iec104_read_point(station, connection, point, false, samples)) {
		iec104_retry_soon(connection, now_ns);
		return false;
	}
	if (iec104_event_waits(station, connection)) /* it may be older than the sample: it goes first */
		return true;
	if (!iec104_is_tellable(station, point, &samples[0])) {
		refuse_read(connection, asdu, size, now_ns);
		return true;
	}
	manner.originator = read.originator;
	manner.test = read.test;
	iec104_begin_asdu(station, &builder, point, &manner, false);
	iec104_add_samples(station, &builder, point, samples, false);
	iec104_send(connection, &builder, now_ns);
	drop_first_reply(connection, size);
	return true;
}
