/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/kept.h"

#include <string.h>

/* A block that nobody has used begins with all that is there. */
static void begin_block(const struct iec61850_buffer *buffer, uint32_t number, uint32_t oldest)
{
	struct iec61850_kept_block *block = iec61850_buffer_block(buffer, number);

	if (!buffer->history.readers[number].used)
		block->next = block->floor = oldest;
}

/* What the journal has of a block may be newer than what it has of the entries: those between are lost. */
static void bound_block(const struct iec61850_buffer *buffer, uint32_t number)
{
	struct iec61850_kept_block *block = iec61850_buffer_block(buffer, number);

	if ((int32_t)(block->next - buffer->next) > 0) {
		block->next = buffer->next;
		block->overflow = true;
	}
	if ((int32_t)(block->floor - buffer->next) > 0)
		block->floor = buffer->next;
}

/* What nobody has ever used stays untouched, and so takes no memory. */
static void empty(const struct iec61850_buffer *buffer)
{
	if (buffer->history.head->revision == 0)
		return;
	memset(buffer->history.entries, 0, buffer->history.size * sizeof(*buffer->history.entries));
	memset(buffer->history.readers, 0, IEC61850_KEPT_ALL * sizeof(*buffer->history.readers));
}

enum iec61850_begun iec61850_buffer_begin(struct iec61850_buffer *buffer, void *section,
					  const struct map_config *config, uint32_t blocks, uint32_t revision,
					  uint32_t start)
{
	struct map_history_head *head;
	enum iec61850_begun begun = IEC61850_GOES_ON;

	*buffer = (struct iec61850_buffer){
	    .history = map_history_at((uint8_t *)section + IEC61850_HISTORY_AT, IEC61850_KEPT_ALL,
				      iec61850_settings(config)->report_buffer),
	    .next = 1,
	};
	head = buffer->history.head;
	if (head->revision != revision || (head->start == 0 && head->former == 0))
		begun = IEC61850_BEGINS_ANEW;
	else if (head->start == 0)
		begun = IEC61850_GOES_ON_LATER;
	if (begun == IEC61850_BEGINS_ANEW) {
		head->start = head->former = 0; /* until all of it is as it begins */
		empty(buffer);
	} else {
		buffer->next = map_history_place(&buffer->history)->next;
	}
	if (buffer->next == 0) /* no entry has the number 0 */
		buffer->next = 1;
	for (uint32_t i = 0; i < blocks; i++)
		bound_block(buffer, i);
	for (uint32_t i = 0, oldest = iec61850_buffer_oldest(buffer); i < blocks; i++)
		if (begun != IEC61850_GOES_ON || iec61850_buffer_block(buffer, i)->next == 0)
			begin_block(buffer, i, oldest);
	if (begun == IEC61850_GOES_ON)
		return begun;
	head->revision = revision;
	head->first = buffer->next;
	iec61850_buffer_settle(buffer, &(const struct map_cursor){.lost = 0});
	head->start = start != 0 ? start : 1;
	return begun;
}

void iec61850_buffer_add(struct iec61850_buffer *buffer, uint32_t point, uint8_t reason,
			 const struct map_sample *sample, int64_t noted_ns)
{
	struct map_history_entry *entry = &buffer->history.entries[buffer->next & (buffer->history.size - 1)];

	atomic_store_explicit(&entry->number, 0, memory_order_relaxed);
	atomic_thread_fence(
	    memory_order_release); /* a kill leaves it whole or void, and so does a reader see it */
	entry->point = point;
	entry->start = buffer->history.head->start;
	entry->reason = reason;
	entry->time = MAP_TIME_MONOTONIC;
	entry->noted_ns = noted_ns;
	entry->sample = *sample;
	atomic_store_explicit(&entry->number, buffer->next++, memory_order_release);
	if (buffer->next == 0)
		buffer->next = 1;
}

void iec61850_buffer_settle(struct iec61850_buffer *buffer, const struct map_cursor *cursor)
{
	struct map_history_head *head = buffer->history.head;
	const uint32_t other = !(atomic_load_explicit(&head->which, memory_order_relaxed) & 1);

	head->places[other] = (struct map_history_place){.cursor = *cursor, .next = buffer->next};
	head->places[other].cursor.lost = 0;
	atomic_store_explicit(&head->which, other, memory_order_release);
}

struct map_cursor iec61850_buffer_cursor(const struct iec61850_buffer *buffer)
{
	return map_history_place(&buffer->history)->cursor;
}

const struct map_history_entry *iec61850_buffer_entry(const struct iec61850_buffer *buffer, uint32_t number)
{
	const struct map_history_entry *entry = &buffer->history.entries[number & (buffer->history.size - 1)];

	return number != 0 && (int32_t)(buffer->next - number) > 0 &&
		       atomic_load_explicit(&entry->number, memory_order_relaxed) == number
		   ? entry
		   : NULL;
}

uint32_t iec61850_buffer_start(const struct iec61850_buffer *buffer, uint32_t number)
{
	const struct map_history_entry *entry = iec61850_buffer_entry(buffer, number);

	if (entry != NULL)
		return entry->start;
	return (int32_t)(number - buffer->history.head->first) >= 0 ? buffer->history.head->start
								    : buffer->history.head->former;
}

uint32_t iec61850_buffer_oldest(const struct iec61850_buffer *buffer)
{
	uint32_t number = buffer->next > buffer->history.size ? buffer->next - buffer->history.size : 1;

	while (number != buffer->next && iec61850_buffer_entry(buffer, number) == NULL)
		number++;
	return number;
}

uint32_t iec61850_buffer_first(const struct iec61850_buffer *buffer, const struct iec61850_kept_block *block,
			       bool *overflow)
{
	const bool gone = block->next != buffer->next && iec61850_buffer_entry(buffer, block->next) == NULL;

	*overflow = gone || block->overflow != 0;
	return gone ? iec61850_buffer_oldest(buffer) : block->next;
}
