/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "journal/record.h"

#include <string.h>

static const uint8_t magic[4] = {'O', 'R', 'J', '1'}; /* the digit: raise with every change of the format */

#define WITHOUT_TIME 19u /* octets of an event before what its time is */

/* ---- octets ------------------------------------------------------------------------------ */

static uint8_t *put(uint8_t *at, uint64_t number, unsigned octets)
{
	for (unsigned i = 0; i < octets; i++)
		*at++ = (uint8_t)(number >> 8 * i);
	return at;
}

static uint64_t take(const uint8_t **at, unsigned octets)
{
	uint64_t number = 0;

	for (unsigned i = 0; i < octets; i++)
		number |= (uint64_t) * (*at)++ << 8 * i;
	return number;
}

/* CRC-32 of IEEE 802.3, by half octets: a table of 64 bytes is as fast as the flash. */
static uint32_t crc_add(uint32_t crc, const uint8_t *bytes, size_t size)
{
	static const uint32_t table[16] = {
	    0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac, 0x76dc4190, 0x6b6b51f4, 0x4db26158, 0x5005713c,
	    0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c, 0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c};

	for (size_t i = 0; i < size; i++) {
		crc = table[(crc ^ bytes[i]) & 15] ^ crc >> 4;
		crc = table[(crc ^ bytes[i] >> 4) & 15] ^ crc >> 4;
	}
	return crc;
}

static uint32_t record_crc(const uint8_t *record, size_t size)
{
	uint32_t crc = crc_add(UINT32_MAX, record, JOURNAL_HEAD_SIZE - 4);

	return ~crc_add(crc, record + JOURNAL_HEAD_SIZE, size - JOURNAL_HEAD_SIZE);
}

/* ---- writing ----------------------------------------------------------------------------- */

static uint8_t *put_queue(uint8_t *at, const struct journal_queue *queue, uint32_t modules)
{
	size_t length = strnlen(queue->name, sizeof(queue->name) - 1);

	at = put(at, queue->kind, 1);
	at = put(at, length, 1);
	memcpy(at, queue->name, length);
	at += length;
	for (uint32_t i = 0; i < modules; i++)
		at = put(at, queue->next[i], 4);
	return at;
}

void journal_begin(struct journal_builder *builder, uint32_t number, uint32_t modules,
		   const struct journal_queue *queues, uint32_t queue_count)
{
	uint8_t *at = builder->bytes;

	memcpy(at, magic, sizeof(magic));
	put(at + 8, number, 4);
	at = put(at + JOURNAL_HEAD_SIZE, modules, 1);
	at = put(at, queue_count, 3);
	at = put(at, 0, 4);
	for (uint32_t i = 0; i < queue_count; i++)
		at = put_queue(at, &queues[i], modules);
	builder->used = (size_t)(at - builder->bytes);
	builder->events = builder->states = 0;
	builder->digest = UINT32_MAX;
}

bool journal_add(struct journal_builder *builder, const struct journal_event *event)
{
	uint8_t *at = builder->bytes + builder->used;

	if (builder->size - builder->used < JOURNAL_EVENT_SIZE)
		return false;
	at = put(at, event->ca, 2);
	at = put(at, event->module, 1);
	at = put(at, event->type, 1);
	at = put(at, event->ioa, 4);
	at = put(at, event->number, 4);
	at = put(at, event->value, 4);
	at = put(at, event->quality, 1);
	at = put(at, event->detail, 1);
	at = put(at, event->cause, 1);
	at = put(at, event->time, 1);
	put(at, (uint64_t)event->wall_ns, 8);
	builder->used += JOURNAL_EVENT_SIZE;
	builder->events++;
	return true;
}

bool journal_keep(struct journal_builder *builder, const struct journal_event *point)
{
	const uint8_t *at = builder->bytes + builder->used;
	struct journal_event entry = *point;

	entry.number = 0;
	entry.cause = JOURNAL_RETAINED;
	if (!journal_add(builder, &entry))
		return false;
	builder->states++;
	builder->digest = crc_add(builder->digest, at, WITHOUT_TIME);
	return true;
}

bool journal_keep_value(struct journal_builder *builder, struct map_retained_name name,
			struct map_retained_value value)
{
	const uint8_t *at = builder->bytes + builder->used;
	const struct journal_event entry = {.ioa = name.low,
					    .number = name.high,
					    .value = value.low,
					    .quality = (uint8_t)value.quality,
					    .cause = JOURNAL_VALUE,
					    .wall_ns = value.high};

	if (!journal_add(builder, &entry))
		return false;
	builder->states++;
	builder->digest = crc_add(builder->digest, at, JOURNAL_EVENT_SIZE);
	return true;
}

bool journal_place(struct journal_builder *builder, uint32_t start, uint32_t revision, uint32_t next)
{
	const struct journal_event place = {
	    .ioa = revision, .number = next, .value = start, .cause = JOURNAL_HISTORY};

	if (!journal_add(builder, &place))
		return false;
	builder->states++;
	return true;
}

static struct journal_event piece_of(uint32_t reader, uint32_t part, const uint32_t *octets)
{
	const uint32_t *words = octets + part * (JOURNAL_READER_PART / 4);

	return (struct journal_event){.ioa = words[0],
				      .number = reader << 8 | part,
				      .value = words[1],
				      .cause = JOURNAL_READER,
				      .wall_ns = (int64_t)((uint64_t)words[3] << 32 | words[2])};
}

bool journal_keep_reader(struct journal_builder *builder, uint32_t reader, const uint32_t *octets)
{
	const uint32_t part_words = JOURNAL_READER_PART / 4;
	uint32_t words = MAP_HISTORY_READER_SIZE / 4;

	while (words > 0 && octets[words - 1] == 0)
		words--;
	for (uint32_t part = 0; part * part_words < words; part++) {
		const uint8_t *at = builder->bytes + builder->used;
		const struct journal_event piece = piece_of(reader, part, octets);

		if (!journal_add(builder, &piece))
			return false;
		builder->states++;
		builder->digest = crc_add(builder->digest, at, JOURNAL_EVENT_SIZE);
	}
	return true;
}

bool journal_take_reader(const struct journal_event *piece, struct map_history_reader *readers,
			 uint32_t reader_count)
{
	const uint32_t reader = piece->number >> 8, part = piece->number & UINT8_MAX;
	uint32_t *words;

	if (reader >= reader_count || (part + 1) * JOURNAL_READER_PART > MAP_HISTORY_READER_SIZE)
		return false;
	words = readers[reader].octets + part * (JOURNAL_READER_PART / 4);
	words[0] = piece->ioa;
	words[1] = piece->value;
	words[2] = (uint32_t)piece->wall_ns;
	words[3] = (uint32_t)((uint64_t)piece->wall_ns >> 32);
	readers[reader].used = 1;
	return true;
}

void journal_end(struct journal_builder *builder)
{
	put(builder->bytes + 4, builder->used - JOURNAL_HEAD_SIZE, 4);
	put(builder->bytes + JOURNAL_HEAD_SIZE + 4, builder->events, 4);
	put(builder->bytes + 12, record_crc(builder->bytes, builder->used), 4);
}

/* ---- reading ----------------------------------------------------------------------------- */

/* Where the queues end; NULL: they would not end within the record. */
static const uint8_t *skip_queues(const struct journal_record *record, const uint8_t *end)
{
	const uint8_t *at = record->queues;

	for (uint32_t i = 0; i < record->queue_count; i++) {
		if (end - at < 2 || at[0] > JOURNAL_ADDRESS || at[1] >= MAP_ADDRESS_SIZE ||
		    (size_t)(end - at) < 2u + at[1] + record->modules * 4u)
			return NULL;
		at += 2u + at[1] + record->modules * 4u;
	}
	return at;
}

static bool read_rest(const uint8_t *at, const uint8_t *end, struct journal_record *out)
{
	out->modules = (uint32_t)take(&at, 1);
	out->queue_count = (uint32_t)take(&at, 3);
	out->event_count = (uint32_t)take(&at, 4);
	out->queues = at;
	if (out->modules > MAP_MODULES_MAX || out->queue_count > MAP_QUEUES)
		return false;
	out->events = skip_queues(out, end);
	return out->events != NULL &&
	       (uint64_t)out->event_count * JOURNAL_EVENT_SIZE == (uint64_t)(end - out->events);
}

bool journal_parse(const uint8_t *bytes, size_t size, uint32_t number, struct journal_record *out)
{
	const uint8_t *at = bytes + sizeof(magic);
	uint32_t length, crc;

	if (size < JOURNAL_HEAD_SIZE + JOURNAL_RECORD_LEAST || memcmp(bytes, magic, sizeof(magic)) != 0)
		return false;
	length = (uint32_t)take(&at, 4);
	if (length < JOURNAL_RECORD_LEAST || length > size - JOURNAL_HEAD_SIZE || take(&at, 4) != number)
		return false;
	crc = (uint32_t)take(&at, 4);
	out->size = JOURNAL_HEAD_SIZE + length;
	return crc == record_crc(bytes, out->size) && read_rest(at, bytes + out->size, out);
}

void journal_take_queue(const struct journal_record *record, const uint8_t **at, struct journal_queue *out)
{
	size_t length;

	*out = (struct journal_queue){.kind = (uint8_t)take(at, 1)};
	length = (size_t)take(at, 1);
	memcpy(out->name, *at, length);
	*at += length;
	for (uint32_t i = 0; i < record->modules; i++)
		out->next[i] = (uint32_t)take(at, 4);
}

struct journal_event journal_event(const struct journal_record *record, uint32_t index)
{
	const uint8_t *at = record->events + (size_t)index * JOURNAL_EVENT_SIZE;
	struct journal_event event;

	event.ca = (uint16_t)take(&at, 2);
	event.module = (uint8_t)take(&at, 1);
	event.type = (uint8_t)take(&at, 1);
	event.ioa = (uint32_t)take(&at, 4);
	event.number = (uint32_t)take(&at, 4);
	event.value = (uint32_t)take(&at, 4);
	event.quality = (uint8_t)take(&at, 1);
	event.detail = (uint8_t)take(&at, 1);
	event.cause = (uint8_t)take(&at, 1);
	event.time = (uint8_t)take(&at, 1);
	event.wall_ns = (int64_t)take(&at, 8);
	return event;
}
