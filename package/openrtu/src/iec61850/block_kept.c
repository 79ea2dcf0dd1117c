/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/block_kept.h"

#include <string.h>

#include "iec61850/value.h"
#include "map/hash.h"

/* Of the points as they are numbered: entries are of such numbers. */
static uint32_t numbering(const struct iec61850_model *model)
{
	uint32_t hash = model->revision;

	for (uint32_t i = 0; i < model->config->point_count; i++)
		hash = map_hash_word(hash, model->points[i]);
	return hash;
}

/* Does not touch what is as it should be. */
static void copy_id(char to[IEC61850_RPT_ID_SIZE], const char from[IEC61850_RPT_ID_SIZE])
{
	if (strcmp(to, from) != 0)
		memcpy(to, from, IEC61850_RPT_ID_SIZE);
}

void iec61850_block_save(const struct iec61850_block *block)
{
	struct iec61850_kept_block *kept = block->kept;

	kept->triggers = block->triggers;
	kept->options = block->options;
	kept->buffer_ms = block->buffer_ms;
	kept->integrity_ms = block->integrity_ms;
	copy_id(kept->id, block->id);
}

static void load_block(struct iec61850_block *block, struct map_history_reader *reader)
{
	struct iec61850_kept_block *kept = (void *)reader->octets;

	block->kept = kept;
	block->reader = reader;
	kept->reserved_s = 0; /* for whom, only the former process knew */
	kept->id[sizeof(kept->id) - 1] = '\0';
	if (!reader->used)
		iec61850_block_save(block);
	block->triggers = kept->triggers & IEC61850_TRIGGERS; /* it may be of a file */
	block->options = kept->options & IEC61850_ALL_OPTIONS;
	block->buffer_ms = kept->buffer_ms;
	block->integrity_ms = kept->integrity_ms;
	copy_id(block->id, kept->id);
}

/*
 * The image as the last entries have it: what happens next is a change from there. Where the events begin with the gateway, nothing
 * is known of a point without an entry.
 */
static void take_image(struct iec61850_model *model, enum iec61850_begun begun)
{
	const struct iec61850_buffer *buffer = &model->buffer;

	for (uint32_t i = 0; i < model->config->point_count; i++)
		if (begun == IEC61850_GOES_ON_LATER)
			model->image[i] = (struct map_sample){.quality = MAP_INVALID};
		else
			map_read(model->map, i, &model->image[i]);
	for (uint32_t number = iec61850_buffer_oldest(buffer); number != buffer->next; number++) {
		const struct map_history_entry *entry = iec61850_buffer_entry(buffer, number);

		if (entry == NULL || entry->point >= model->config->point_count)
			continue;
		model->image[entry->point] = entry->sample;
		if (entry->time != MAP_TIME_MONOTONIC) /* of an earlier start, whose clock was another */
			model->image[entry->point].time_ns = 0;
	}
}

/* So many readers that blocks may have. */
static uint32_t kept_blocks(const struct iec61850_model *model)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < model->block_count; i++)
		if (model->blocks[i].buffered && model->blocks[i].kept_number >= count)
			count = model->blocks[i].kept_number + 1;
	return count;
}

void iec61850_blocks_begin(struct iec61850_server *server, void *section, struct map_cursor *cursor,
			   uint32_t start)
{
	struct iec61850_model *model = &server->model;
	struct iec61850_buffer *buffer = &model->buffer;

	const enum iec61850_begun begun = iec61850_buffer_begin(buffer, section, model->config,
								kept_blocks(model), numbering(model), start);

	server->catching_up = begun == IEC61850_GOES_ON;
	for (uint32_t i = 0; i < model->block_count; i++)
		if (model->blocks[i].buffered)
			load_block(&model->blocks[i], &buffer->history.readers[model->blocks[i].kept_number]);
	take_image(model, begun);
	for (uint32_t i = 0; i < model->config->point_count; i++)
		model->selected[i] = iec61850_is_selected(model, i);
	if (begun == IEC61850_GOES_ON)
		*cursor = iec61850_buffer_cursor(buffer);
	else if (begun == IEC61850_GOES_ON_LATER)
		*cursor =
		    (struct map_cursor){.lost = 0}; /* behind it is all that was since the gateway started */
	else
		iec61850_buffer_settle(buffer, cursor);
}
