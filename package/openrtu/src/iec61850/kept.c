/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/kept.h"

#include <string.h>

static const struct iec61850_kept_place *place(const struct iec61850_kept *kept)
{
	return &kept->places[atomic_load_explicit(&kept->which, memory_order_relaxed) & 1];
}

bool iec61850_buffer_begin(struct iec61850_buffer *buffer, void *section, const struct map_config *config,
			   uint32_t revision, uint32_t start)
{
	uint8_t *octets = section;

	*buffer = (struct iec61850_buffer){
	    .kept = (void *)(octets + IEC61850_KEPT_AT),
	    .blocks = (void *)(octets + IEC61850_BLOCKS_AT),
	    .entries = (void *)(octets + IEC61850_ENTRIES_AT),
	    .size = iec61850_settings(config)->report_buffer,
	    .next = 1,
	};
	if (buffer->kept->start != 0 && buffer->kept->revision == revision) {
		buffer->next = place(buffer->kept)->next;
		return true;
	}
	buffer->kept->start = 0; /* until all of it is as it begins */
	memset(buffer->entries, 0, buffer->size * sizeof(*buffer->entries));
	memset(buffer->blocks, 0, IEC61850_KEPT_ALL * sizeof(*buffer->blocks));
	for (uint32_t i = 0; i < IEC61850_KEPT_ALL; i++)
		buffer->blocks[i].next = buffer->blocks[i].floor = buffer->next;
	buffer->kept->revision = revision;
	buffer->kept->start = start != 0 ? start : 1;
	return false;
}

void iec61850_buffer_add(struct iec61850_buffer *buffer, uint32_t point, uint32_t reason,
			 const struct map_sample *sample)
{
	struct iec61850_entry *entry = &buffer->entries[buffer->next & (buffer->size - 1)];

	entry->number = 0;
	atomic_signal_fence(memory_order_seq_cst); /* a kill leaves it whole or void */
	entry->point = point;
	entry->reason = reason;
	entry->sample = *sample;
	atomic_signal_fence(memory_order_seq_cst);
	entry->number = buffer->next++;
	if (buffer->next == 0) /* no entry has the number 0 */
		buffer->next = 1;
}

void iec61850_buffer_settle(struct iec61850_buffer *buffer, const struct map_cursor *cursor)
{
	const uint32_t other = !(atomic_load_explicit(&buffer->kept->which, memory_order_relaxed) & 1);

	buffer->kept->places[other] = (struct iec61850_kept_place){.cursor = *cursor, .next = buffer->next};
	buffer->kept->places[other].cursor.lost = 0;
	atomic_store_explicit(&buffer->kept->which, other, memory_order_release);
}

struct map_cursor iec61850_buffer_cursor(const struct iec61850_buffer *buffer)
{
	return place(buffer->kept)->cursor;
}

const struct iec61850_entry *iec61850_buffer_entry(const struct iec61850_buffer *buffer, uint32_t number)
{
	const struct iec61850_entry *entry = &buffer->entries[number & (buffer->size - 1)];

	return number != 0 && (int32_t)(buffer->next - number) > 0 && entry->number == number ? entry : NULL;
}

uint32_t iec61850_buffer_oldest(const struct iec61850_buffer *buffer)
{
	uint32_t number = buffer->next > buffer->size ? buffer->next - buffer->size : 1;

	while (number != buffer->next && iec61850_buffer_entry(buffer, number) == NULL)
		number++;
	return number;
}
