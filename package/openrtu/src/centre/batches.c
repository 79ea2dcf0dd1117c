/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/batches.h"

#include <stdlib.h>
#include <string.h>

static struct centre_batch *batch_of(const struct centre_batches *batches, uint64_t sequence)
{
	return (void *)(batches->memory + (sequence % batches->slots) * batches->batch_size);
}

static void open_batch(struct centre_batches *batches, uint64_t sequence)
{
	batches->filling = sequence;
	*batch_of(batches, sequence) = (struct centre_batch){
	    .magic = CENTRE_MAGIC, .record_size = sizeof(struct centre_record), .sequence = sequence};
}

bool centre_batches_init(struct centre_batches *batches, uint32_t slots, uint32_t records,
			 uint32_t in_flight_max)
{
	*batches = (struct centre_batches){.batch_size = sizeof(struct centre_batch) +
							 records * sizeof(struct centre_record),
					   .records = records,
					   .slots = slots,
					   .in_flight_max = in_flight_max};
	batches->memory = calloc(slots, batches->batch_size);
	if (batches->memory == NULL)
		return false;
	centre_batches_reset(batches);
	return true;
}

void centre_batches_free(struct centre_batches *batches)
{
	free(batches->memory);
}

void centre_batches_reset(struct centre_batches *batches)
{
	batches->acknowledged = batches->sent = 0;
	open_batch(batches, 1);
}

size_t centre_batches_room(const struct centre_batches *batches)
{
	uint64_t used = batches->filling - batches->acknowledged;

	return (size_t)(batches->slots - used) * batches->records +
	       (batches->records - batch_of(batches, batches->filling)->count);
}

struct centre_record *centre_batches_add(struct centre_batches *batches)
{
	struct centre_batch *batch = batch_of(batches, batches->filling);

	if (batch->count == batches->records) {
		open_batch(batches, batches->filling + 1);
		batch = batch_of(batches, batches->filling);
	}
	memset(&batch->records[batch->count], 0, sizeof(batch->records[0]));
	return &batch->records[batch->count++];
}

const struct centre_batch *centre_batches_next(const struct centre_batches *batches, size_t *size)
{
	const struct centre_batch *batch = batch_of(batches, batches->sent + 1);

	if (batches->sent - batches->acknowledged >= batches->in_flight_max ||
	    batches->sent == batches->filling || batch->count == 0)
		return NULL;
	*size = sizeof(*batch) + batch->count * sizeof(batch->records[0]);
	return batch;
}

void centre_batches_sent(struct centre_batches *batches)
{
	batches->sent++;
	if (batches->sent == batches->filling)
		open_batch(batches, batches->filling + 1);
}

bool centre_batches_acknowledge(struct centre_batches *batches, uint64_t sequence,
				void (*released)(void *context, const struct centre_record *record),
				void *context)
{
	if (sequence <= batches->acknowledged || sequence > batches->sent)
		return false;
	while (batches->acknowledged < sequence) {
		const struct centre_batch *batch = batch_of(batches, ++batches->acknowledged);

		for (uint32_t i = 0; i < batch->count; i++)
			if ((batch->records[i].flags & CENTRE_LAST) != 0)
				released(context, &batch->records[i]);
	}
	return true;
}

uint64_t centre_batches_open(const struct centre_batches *batches)
{
	uint64_t open = 0;

	for (uint64_t sequence = batches->acknowledged + 1; sequence <= batches->filling; sequence++)
		open += batch_of(batches, sequence)->count;
	return open;
}
