/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/block.h"

#include <string.h>

#include "iec61850/block_kept.h"
#include "iec61850/list.h"
#include "iec61850/note.h"
#include "iec61850/tags.h"
#include "iec61850/value.h"

static void set_enabled(struct iec61850_model *model, struct iec61850_block *block, bool on)
{
	struct iec61850_block **at = &model->enabled;

	if (block->enabled == on)
		return;
	while (*at != (on ? NULL : block))
		at = &(*at)->next_enabled;
	if (on)
		block->next_enabled = NULL;
	*at = on ? block : block->next_enabled;
	block->enabled = on;
}

void iec61850_block_enable(struct iec61850_model *model, struct iec61850_block *block, bool on,
			   int64_t now_ns)
{
	memset(block->reasons, 0, iec61850_set_of(model, block)->count);
	set_enabled(model, block, on);
	block->due_ns = 0;
	block->number = 0;
	block->segment = 0;
	block->integrity_ns = now_ns + block->integrity_ms * NS_PER_MS;
}

/* What a block would have told is no more (7-2, 17.2.2.14). */
static void purge(struct iec61850_server *server, struct iec61850_block *block)
{
	block->kept->floor = block->kept->next = server->model.buffer.next;
	block->kept->overflow = false;
}

/* The number of the first entry that a block may still tell. */
static uint32_t first_of(const struct iec61850_server *server, const struct iec61850_block *block)
{
	const uint32_t oldest = iec61850_buffer_oldest(&server->model.buffer);

	return (int32_t)(block->kept->floor - oldest) > 0 ? block->kept->floor : oldest;
}

static uint32_t word_of(const uint8_t *octets)
{
	return (uint32_t)octets[0] << 24 | (uint32_t)octets[1] << 16 | (uint32_t)octets[2] << 8 | octets[3];
}

/* Reports go on behind this entry; behind none: with the first that is there (7-2, 17.2.3.2.4.2). */
static int write_entry(const struct iec61850_server *server, const struct ber_element *data,
		       struct iec61850_block *block)
{
	const struct iec61850_buffer *buffer = &server->model.buffer;
	const struct map_history_head *head = buffer->history.head;
	const uint32_t first = first_of(server, block);
	uint32_t start, number;
	bool gap;

	if (data->tag != IEC61850_TAG_OCTET_STRING || data->size != IEC61850_ENTRY_ID_OCTETS)
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	start = word_of(data->value);
	number = word_of(data->value + 4);
	if (start == 0 && number == 0) {
		block->kept->overflow = first != block->kept->floor;
		block->kept->next = first;
		return 0;
	}
	/* Who was told more than the journal has kept goes on behind the gap. */
	gap = start == head->former && (int32_t)(number - head->first) >= 0;
	if (gap)
		number = head->first - 1;
	if ((!gap && start != iec61850_buffer_start(buffer, number)) || (int32_t)(number + 1 - first) < 0 ||
	    (int32_t)(buffer->next - number) <= 0)
		return IEC61850_ACCESS_VALUE_INVALID;
	block->kept->overflow = gap;
	block->kept->next = number + 1;
	return 0;
}

static int write_number(const struct ber_element *data, uint32_t *out)
{
	int64_t value;

	if ((data->tag != IEC61850_TAG_UNSIGNED && data->tag != IEC61850_TAG_INTEGER) ||
	    !ber_integer(data, &value))
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	if (value < 0 || value > UINT32_MAX)
		return IEC61850_ACCESS_VALUE_INVALID;
	*out = (uint32_t)value;
	return 0;
}

/* 0: none. */
static int write_period(const struct ber_element *data, uint32_t *out)
{
	uint32_t period;
	const int error = write_number(data, &period);

	if (error != 0)
		return error;
	if (period > 0 && period < IEC61850_INTEGRITY_MS_MIN)
		return IEC61850_ACCESS_VALUE_INVALID;
	*out = period;
	return 0;
}

/* In the most significant places of 16. */
static int write_bits(const struct ber_element *data, size_t octets, uint16_t *out)
{
	if (data->tag != IEC61850_TAG_BIT_STRING || data->size != 1 + octets)
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	*out = (uint16_t)(data->value[1] << 8 | (octets > 1 ? data->value[2] : 0));
	return 0;
}

static int write_id(const struct ber_element *data, struct iec61850_block *block)
{
	if (data->tag != IEC61850_TAG_VISIBLE_STRING)
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	if (data->size >= IEC61850_RPT_ID_SIZE || memchr(data->value, '\0', data->size) != NULL)
		return IEC61850_ACCESS_VALUE_INVALID;
	memcpy(block->id, data->value, data->size);
	block->id[data->size] = '\0';
	return 0;
}

static bool is_set(const struct iec61850_server *server, const struct iec61850_object *object,
		   const struct ber_element *data, uint32_t set)
{
	char name[IEC61850_REFERENCE_SIZE];

	iec61850_set_reference(&server->model, object->device, &server->model.sets[set], name);
	return ber_is(data, name, strlen(name));
}

/* Its own data set, or of an unbuffered block one that a client has made. */
static int write_set(struct iec61850_server *server, const struct iec61850_object *object,
		     const struct ber_element *data, struct iec61850_block *block)
{
	const struct iec61850_model *model = &server->model;

	if (data->tag != IEC61850_TAG_VISIBLE_STRING)
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	if (is_set(server, object, data, block->own_set)) {
		block->set = block->own_set;
		return 0;
	}
	for (uint32_t i = 0; !block->buffered && i < IEC61850_LISTS; i++)
		if (iec61850_list_is_of(&model->lists[i], object->device, server->client) &&
		    is_set(server, object, data, model->set_count + i)) {
			block->set = model->set_count + i;
			return 0;
		}
	return IEC61850_ACCESS_VALUE_INVALID;
}

/* So many seconds the block stays its client's without an association; 0 gives it back (7-2, 17.2.3.2.2.14). */
static int write_reservation(const struct ber_element *data, struct iec61850_block *block)
{
	int64_t value;

	if ((data->tag != IEC61850_TAG_UNSIGNED && data->tag != IEC61850_TAG_INTEGER) ||
	    !ber_integer(data, &value))
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	if (value < 0 || value > INT16_MAX) /* -1 is of a configuration that gives a block to one client */
		return IEC61850_ACCESS_VALUE_INVALID;
	block->kept->reserved_s = (int16_t)value;
	if (value == 0)
		block->owner = NULL;
	return 0;
}

static int write_attribute(struct iec61850_server *server, const struct iec61850_object *object,
			   const struct ber_element *data, struct iec61850_block *block)
{
	uint16_t bits = 0;
	int error;

	switch (object->node->leaf) {
	case IEC61850_RPT_ID:
		return write_id(data, block);
	case IEC61850_DAT_SET:
		return write_set(server, object, data, block);
	case IEC61850_OPT_FLDS:
		error = write_bits(data, 2, &bits);
		if (error == 0)
			block->options =
			    bits & (block->kept != NULL ? IEC61850_ALL_OPTIONS : IEC61850_OPTIONS);
		return error;
	case IEC61850_TRG_OPS:
		error = write_bits(data, 1, &bits);
		block->triggers = error == 0 ? (uint8_t)(bits >> 8) & IEC61850_TRIGGERS : block->triggers;
		return error;
	case IEC61850_BUF_TM:
		return write_number(data, &block->buffer_ms);
	case IEC61850_INTG_PD:
		return write_period(data, &block->integrity_ms);
	case IEC61850_ENTRY_ID:
		return write_entry(server, data, block);
	case IEC61850_RESV_TMS:
		return write_reservation(data, block);
	default:
		return IEC61850_ACCESS_DENIED;
	}
}

/* Of a buffered block: another setting purges what was kept for the former one. */
static int write_kept(struct iec61850_server *server, const struct iec61850_object *object,
		      const struct ber_element *data, struct iec61850_block *block)
{
	const struct iec61850_block before = *block;
	char id[IEC61850_RPT_ID_SIZE];
	int error;

	memcpy(id, block->id, sizeof(id));
	error = write_attribute(server, object, data, block);
	if (block->kept == NULL || error != 0)
		return error;
	if (before.triggers != block->triggers || before.buffer_ms != block->buffer_ms ||
	    before.integrity_ms != block->integrity_ms || strcmp(id, block->id) != 0)
		purge(server, block);
	iec61850_block_save(block);
	return 0;
}

static int write_switch(struct iec61850_server *server, const struct iec61850_object *object, bool on,
			struct iec61850_block *block)
{
	switch (object->node->leaf) {
	case IEC61850_RPT_ENA:
		iec61850_block_enable(&server->model, block, on, server->now_ns);
		if (!on && !block->reserved && !(block->kept != NULL && block->kept->reserved_s > 0))
			block->owner = NULL;
		return 0;
	case IEC61850_GI:
		if (!block->enabled)
			return IEC61850_ACCESS_UNAVAILABLE;
		if (on)
			iec61850_note_asked(&server->model, block, IEC61850_GENERAL, server->now_ns);
		return 0;
	case IEC61850_PURGE_BUF:
		if (block->enabled)
			return IEC61850_ACCESS_UNAVAILABLE;
		if (on)
			purge(server, block);
		return 0;
	default:
		if (block->enabled)
			return IEC61850_ACCESS_UNAVAILABLE;
		block->reserved = on;
		if (!on)
			block->owner = NULL;
		return 0;
	}
}

/* Of another client, or kept for one that is gone. */
static bool is_of_another(const struct iec61850_server *server, const struct iec61850_block *block)
{
	if (block->owner != NULL)
		return block->owner != server->client;
	return block->reserved_ns > server->now_ns &&
	       memcmp(&block->peer, &server->peer, sizeof(block->peer)) != 0;
}

int iec61850_block_write(struct iec61850_server *server, const struct iec61850_object *object,
			 const struct ber_element *data)
{
	struct iec61850_block *block = iec61850_block_of(object->device, object->ln, object->number);

	if (block == NULL || object->node == NULL)
		return IEC61850_ACCESS_DENIED;
	if (is_of_another(server, block))
		return IEC61850_ACCESS_UNAVAILABLE;
	if (block->owner == NULL && iec61850_set_of(&server->model, block)->ln == NULL)
		block->set = block->own_set; /* what an association has for itself, another has not */
	block->owner = server->client;
	block->peer = server->peer;
	block->reserved_ns = 0;
	if (block->reader != NULL)
		block->reader->used = 1;
	switch (object->node->leaf) {
	case IEC61850_RPT_ENA:
	case IEC61850_RESV:
	case IEC61850_GI:
	case IEC61850_PURGE_BUF:
		if (data->tag != IEC61850_TAG_BOOLEAN || data->size != 1)
			return IEC61850_ACCESS_TYPE_INCONSISTENT;
		return write_switch(server, object, data->value[0] != 0, block);
	default:
		return block->enabled ? IEC61850_ACCESS_UNAVAILABLE : write_kept(server, object, data, block);
	}
}

void iec61850_blocks_release(struct iec61850_server *server, const void *client)
{
	for (uint32_t i = 0; i < server->model.block_count; i++) {
		struct iec61850_block *block = &server->model.blocks[i];

		if (block->owner == client) {
			block->owner = NULL;
			block->reserved = false;
			set_enabled(&server->model, block, false);
			if (block->kept != NULL && block->kept->reserved_s > 0)
				block->reserved_ns = server->now_ns + block->kept->reserved_s * NS_PER_S;
		}
	}
}

void iec61850_blocks_tick(struct iec61850_server *server)
{
	for (uint32_t i = 0; i < server->model.block_count; i++) {
		struct iec61850_block *block = &server->model.blocks[i];

		if (block->reserved_ns == 0 || block->reserved_ns > server->now_ns)
			continue;
		block->reserved_ns = 0;
		block->kept->reserved_s = 0;
	}
}

bool iec61850_blocks_owned(const struct iec61850_server *server, const void *client)
{
	for (uint32_t i = 0; i < server->model.block_count; i++)
		if (server->model.blocks[i].owner == client)
			return true;
	return false;
}
