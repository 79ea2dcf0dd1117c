/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/report.h"

#include <stdio.h>
#include <string.h>

#include "iec61850/list.h"
#include "iec61850/tags.h"
#include "iec61850/value.h"
#include "map/hash.h"
#include "map/limits.h"

/* ---- pending ----------------------------------------------------------------------------- */

static void mark(struct iec61850_block *block, uint32_t member, unsigned reason, int64_t now_ns)
{
	reason &= block->triggers;
	if (!block->enabled || reason == 0)
		return;
	block->reasons[member] |= (uint8_t)reason;
	if (block->due_ns == 0)
		block->due_ns = now_ns + block->buffer_ms * NS_PER_MS;
}

static void mark_all(const struct iec61850_model *model, struct iec61850_block *block, unsigned reason,
		     int64_t now_ns)
{
	const uint32_t count = iec61850_set_of(model, block)->count;

	for (uint32_t i = 0; i < count; i++)
		mark(block, i, reason, now_ns);
	if (block->due_ns != 0)
		block->due_ns = now_ns; /* who asks for all does not wait */
}

/* Why an attribute is told: a value if it changes, a quality if that does, a time with neither (7-2, 17.2.1). */
static unsigned reasons_of(const struct iec61850_node *node)
{
	const unsigned always = IEC61850_INTEGRITY | IEC61850_GENERAL;

	if (node == NULL)
		return IEC61850_TRIGGERS;
	if (node->leaf == IEC61850_QUALITY)
		return always | IEC61850_QUALITY_CHANGE;
	return node->leaf == IEC61850_TIME ? always : always | IEC61850_DATA_CHANGE | IEC61850_DATA_UPDATE;
}

/* Those of a point's reasons for which an attribute of it, or all, is told. */
static unsigned reasons_for(const struct iec61850_node *node, unsigned reason)
{
	const unsigned changes = IEC61850_DATA_CHANGE | IEC61850_QUALITY_CHANGE | IEC61850_DATA_UPDATE;

	if (node != NULL && node->leaf == IEC61850_RANGE && !(reason & IEC61850_RANGE_CHANGE))
		reason &= ~(unsigned)IEC61850_DATA_CHANGE;
	if (node != NULL && (node->leaf == IEC61850_SELD) != ((reason & IEC61850_SELECTION_CHANGE) != 0))
		reason &= ~changes;
	return reason & reasons_of(node);
}

/* Marks the point in each data set that has it. */
static void mark_point(const struct iec61850_model *model, uint32_t point, unsigned reason, int64_t now_ns)
{
	const struct iec61850_device *device = &model->devices[model->places[point].device];

	for (uint32_t i = model->places[point].member; i != IEC61850_NO_MEMBER;
	     i = iec61850_earlier(model, i))
		for (uint32_t j = 0; j < device->block_count; j++)
			if (!device->blocks[j].buffered && iec61850_set_has(model, device->blocks[j].set, i))
				mark(&device->blocks[j], i - model->sets[device->blocks[j].set].first,
				     reasons_for(model->nodes[i], reason), now_ns);
}

static unsigned selected_then(const struct iec61850_model *model, uint32_t point)
{
	return model->selected[point] ? IEC61850_WAS_SELECTED : 0;
}

static void keep(struct iec61850_server *server, uint32_t point, unsigned reason,
		 const struct map_sample *sample)
{
	reason |= selected_then(&server->model, point);
	iec61850_buffer_add(&server->model.buffer, point, (uint8_t)reason, sample, sample->time_ns);
}

/* Why a sample is told; 0: it is not. A counter's detail is the number of its freeze, which clients do not see. */
static unsigned reason_of(const struct map_config *config, uint32_t number, const struct map_sample *sample,
			  const struct map_sample *before)
{
	const struct map_point *point = &config->points[number];
	const bool crossed =
	    map_range_of(config, number, sample->value) != map_range_of(config, number, before->value);
	const bool changed = sample->value.u != before->value.u ||
			     (point->type == MAP_STEP && sample->detail != before->detail);

	return (changed ? IEC61850_DATA_CHANGE : 0) | (crossed ? IEC61850_RANGE_CHANGE : 0) |
	       (sample->quality != before->quality ? IEC61850_QUALITY_CHANGE : 0);
}

/* Whether a buffered block tells updates of a point that change nothing: only then they are kept. */
static bool keeps_updates(const struct iec61850_model *model, uint32_t point)
{
	const struct iec61850_device *device = &model->devices[model->places[point].device];

	for (uint32_t i = 0; i < device->block_count; i++)
		if (device->blocks[i].buffered && (device->blocks[i].triggers & IEC61850_DATA_UPDATE) &&
		    iec61850_last_member(model, point, device->blocks[i].set) != IEC61850_NO_MEMBER)
			return true;
	return false;
}

/* otherwise: the reason of what is neither another value nor another quality; 0: it is not told. */
static void note(struct iec61850_server *server, uint32_t point, const struct map_sample *sample,
		 unsigned otherwise, int64_t now_ns)
{
	const struct iec61850_model *model = &server->model;
	const unsigned changed = reason_of(model->config, point, sample, &model->image[point]);
	const unsigned reason = changed != 0 ? changed : otherwise;

	if (reason == 0)
		return; /* the image keeps the time of the last change */
	model->image[point] = *sample;
	if (reason != IEC61850_DATA_UPDATE || keeps_updates(model, point))
		keep(server, point, reason, sample);
	mark_point(model, point, reason, now_ns);
}

/* Of before the state: buffered reports alone tell what was, and behind it the state again. */
static void note_past(struct iec61850_server *server, uint32_t point, const struct map_sample *sample)
{
	const struct iec61850_model *model = &server->model;
	const unsigned reason = reason_of(model->config, point, sample, &model->image[point]);

	if (reason == 0)
		return;
	keep(server, point, reason, sample);
	keep(server, point, reason, &model->image[point]);
}

static bool has_selection(const struct iec61850_model *model, uint32_t point)
{
	const enum iec61850_ctl_kind kind = iec61850_ctl_model(model, point);

	return kind == IEC61850_SBO_NORMAL || kind == IEC61850_SBO_ENHANCED;
}

/* Neither the value nor its time changes. */
void iec61850_report_selection(struct iec61850_server *server, uint32_t point, int64_t now_ns)
{
	const struct iec61850_model *model = &server->model;
	const unsigned reason = IEC61850_DATA_CHANGE | IEC61850_SELECTION_CHANGE;

	if (point >= model->config->point_count ||
	    iec61850_is_selected(model, point) == model->selected[point])
		return;
	model->selected[point] = !model->selected[point];
	if (!has_selection(model, point))
		return;
	iec61850_buffer_add(&server->model.buffer, point, (uint8_t)(reason | selected_then(model, point)),
			    &model->image[point], now_ns);
	mark_point(model, point, reason, now_ns);
}

void iec61850_report_selections(struct iec61850_server *server, int64_t now_ns)
{
	const struct map_config *config = server->model.config;

	for (uint32_t i = 0; i < config->point_count; i++)
		if (config->points[i].flags & MAP_POINT_SELECT)
			iec61850_report_selection(server, i, now_ns);
}

static void note_owner(struct iec61850_server *server, uint32_t module, int64_t now_ns)
{
	struct map_sample sample;

	for (uint32_t i = 0; i < server->model.config->point_count; i++)
		if ((module == MAP_NONE || map_owner(server->model.map, i) == module) &&
		    map_read(server->model.map, i, &sample))
			note(server, i, &sample, 0, now_ns);
}

void iec61850_report_all(struct iec61850_server *server, int64_t now_ns)
{
	note_owner(server, MAP_NONE, now_ns);
}

void iec61850_report_event(struct iec61850_server *server, const struct map_event *event, int64_t now_ns)
{
	switch ((enum map_event_kind)event->kind) {
	case MAP_EVENT_CHANGE: /* those of an earlier start are buffered blocks' */
		if (event->time != MAP_TIME_MONOTONIC || event->point >= server->model.config->point_count)
			return;
		if (event->past)
			note_past(server, event->point, &event->sample);
		else /* What a former process had not taken, the image may have already: it is a change. */
			note(server, event->point, &event->sample,
			     server->catching_up ? IEC61850_DATA_CHANGE | IEC61850_RANGE_CHANGE
						 : IEC61850_DATA_UPDATE,
			     now_ns);
		return;
	case MAP_EVENT_MODULE_DOWN:
	case MAP_EVENT_MODULE_UP:
		note_owner(server, event->point, now_ns);
		return;
	case MAP_EVENT_CLOCK:
		return;
	}
}

void iec61850_report_settle(struct iec61850_server *server, const struct map_cursor *cursor)
{
	iec61850_buffer_settle(&server->model.buffer, cursor);
}

/* ---- what outlives the process ----------------------------------------------------------- */

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

static void save_block(const struct iec61850_block *block)
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
		save_block(block);
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

void iec61850_report_begin(struct iec61850_server *server, void *section, struct map_cursor *cursor,
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

/* ---- control blocks ---------------------------------------------------------------------- */

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

static void enable(struct iec61850_model *model, struct iec61850_block *block, bool on, int64_t now_ns)
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
	save_block(block);
	return 0;
}

static int write_switch(struct iec61850_server *server, const struct iec61850_object *object, bool on,
			struct iec61850_block *block)
{
	switch (object->node->leaf) {
	case IEC61850_RPT_ENA:
		enable(&server->model, block, on, server->now_ns);
		if (!on && !block->reserved && !(block->kept != NULL && block->kept->reserved_s > 0))
			block->owner = NULL;
		return 0;
	case IEC61850_GI:
		if (!block->enabled)
			return IEC61850_ACCESS_UNAVAILABLE;
		if (on)
			mark_all(&server->model, block, IEC61850_GENERAL, server->now_ns);
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

/* ---- reports ----------------------------------------------------------------------------- */

/* Chooses the first members that are pending, limit at most. Returns how many; more: there are others. */
static uint32_t choose(struct iec61850_server *server, const struct iec61850_block *block, uint32_t limit,
		       bool *more)
{
	const uint32_t members = iec61850_set_of(&server->model, block)->count;
	uint32_t count = 0;

	*more = false;
	for (uint32_t member = 0; member < members; member++) {
		if (block->reasons[member] == 0)
			continue;
		if (count == limit) {
			*more = true;
			break;
		}
		server->chosen[count++] = member;
	}
	return count;
}

/* Why an entry is told of a member of the model's; 0: it is not. */
static unsigned reason_told(const struct iec61850_server *server, const struct iec61850_block *block,
			    const struct map_history_entry *entry, uint32_t member)
{
	return block->triggers & reasons_for(server->model.nodes[member], entry->reason);
}

/* Why a member of the block's set is in the report. */
static unsigned reason_now(const struct iec61850_server *server, const struct iec61850_block *block,
			   uint32_t member)
{
	return server->entry == NULL ? block->reasons[member]
				     : reason_told(server, block, server->entry,
						   iec61850_set_of(&server->model, block)->first + member);
}

static void put_member(struct iec61850_server *server, struct ber_writer *writer,
		       const struct iec61850_object *object, unsigned reason)
{
	const uint32_t point = iec61850_point_of(&server->model, object);
	const struct map_history_entry *entry = server->entry;
	struct map_sample sample = entry != NULL ? entry->sample : server->model.image[point];

	if (reason & (IEC61850_GENERAL | IEC61850_INTEGRITY))
		iec61850_read_point(&server->model, point, &sample);
	iec61850_put_sample(writer, &server->model, object, &sample,
			    entry != NULL ? entry->time : (uint8_t)MAP_TIME_MONOTONIC,
			    entry != NULL ? (entry->reason & IEC61850_WAS_SELECTED) != 0
					  : iec61850_is_selected(&server->model, point));
}

/* What is said of the chosen members, from the last to the first: reasons, values, references, inclusion. */
static void put_members(struct iec61850_server *server, struct ber_writer *writer,
			const struct iec61850_device *device, const struct iec61850_block *block,
			uint32_t count)
{
	const struct iec61850_set *set = iec61850_set_of(&server->model, block);
	const size_t octets = (set->count + 7) / 8;
	uint8_t *included = iec61850_room(writer);

	for (uint32_t i = count; (block->options & IEC61850_REASON) && i-- > 0;)
		iec61850_put_bits(writer, (uint16_t)(reason_now(server, block, server->chosen[i]) << 8), 6);
	for (uint32_t i = count; i-- > 0 && !writer->full;) {
		const struct iec61850_object object = iec61850_member(&server->model, set, server->chosen[i]);

		put_member(server, writer, &object, reason_now(server, block, server->chosen[i]));
	}
	for (uint32_t i = count; (block->options & IEC61850_REFERENCE) && i-- > 0 && !writer->full;) {
		const struct iec61850_object object = iec61850_member(&server->model, set, server->chosen[i]);
		char name[IEC61850_NAME_SIZE];

		iec61850_variable_name(&server->model, &object, name);
		iec61850_put_reference(writer, &server->model, device, name);
	}
	if (writer->full || octets + 1 > writer->at - writer->floor) {
		writer->full = true;
		return;
	}
	memset(included, 0, octets + 1);
	included[0] = (uint8_t)(8 * octets - set->count);
	for (uint32_t i = 0; i < count; i++)
		included[1 + server->chosen[i] / 8] |= (uint8_t)(0x80 >> server->chosen[i] % 8);
	ber_put(writer, IEC61850_TAG_BIT_STRING, included, octets + 1);
}

/* Of an entry it is when it happened. */
static int64_t time_of_report(const struct iec61850_server *server)
{
	const struct map_clock clock = map_clock_read(server->model.map);
	const struct map_history_entry *entry = server->entry;
	const struct map_event event = {.time = entry != NULL ? entry->time : (uint8_t)MAP_TIME_MONOTONIC,
					.sample.time_ns = entry != NULL ? entry->noted_ns : server->now_ns};

	return map_event_wall_ns(&event, clock);
}

static void put_head(struct iec61850_server *server, struct ber_writer *writer,
		     const struct iec61850_object *object, const struct iec61850_block *block, bool more)
{
	const struct iec61850_model *model = &server->model;
	const struct iec61850_set *set = iec61850_set_of(model, block);
	char reference[IEC61850_REFERENCE_SIZE];

	if (block->options & IEC61850_SEGMENTATION) {
		ber_put(writer, IEC61850_TAG_BOOLEAN, (const uint8_t[]){more}, 1);
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, block->segment);
	}
	if (block->options & IEC61850_CONF_REVISION)
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, set->revision);
	if (block->options & IEC61850_ENTRY)
		iec61850_put_entry_id(writer, model,
				      server->entry != NULL ? server->entry->number : block->kept->next - 1);
	if (block->options & IEC61850_OVERFLOW)
		ber_put(writer, IEC61850_TAG_BOOLEAN, (const uint8_t[]){block->kept->overflow != 0}, 1);
	iec61850_set_reference(model, object->device, set, reference);
	if (block->options & IEC61850_SET_NAME)
		ber_put_text(writer, IEC61850_TAG_VISIBLE_STRING, reference);
	if (block->options & IEC61850_TIME_STAMP)
		iec61850_put_binary_time(writer, time_of_report(server));
	if (block->options & IEC61850_SEQUENCE)
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED,
				block->kept != NULL ? block->number : (uint8_t)block->number);
	iec61850_put_bits(writer, block->options, 10);
	iec61850_put_block_id(writer, model, object, block);
}

static void put_report(struct iec61850_server *server, struct ber_writer *writer,
		       const struct iec61850_object *object, const struct iec61850_block *block,
		       uint32_t count, bool more)
{
	const size_t end = writer->at;
	size_t name;

	put_members(server, writer, object->device, block, count);
	put_head(server, writer, object, block, more);
	ber_close(writer, IEC61850_TAG_RESULTS, end);
	name = writer->at;
	ber_put_text(writer, IEC61850_TAG_VMD_SPECIFIC, "RPT");
	ber_close(writer, IEC61850_TAG_LIST_NAME, name);
	ber_close(writer, IEC61850_TAG_INFORMATION_REPORT, end);
	ber_close(writer, IEC61850_TAG_UNCONFIRMED, end);
}

/* What did not fit is due at once, as a further segment or a report of its own. */
static void sent(struct iec61850_server *server, struct iec61850_block *block, uint32_t count, bool more)
{
	for (uint32_t i = 0; i < count; i++)
		block->reasons[server->chosen[i]] = 0;
	if (block->kept != NULL)
		block->kept->overflow = false;
	block->due_ns = more ? server->now_ns : 0;
	if (more && (block->options & IEC61850_SEGMENTATION)) {
		block->segment++;
		return;
	}
	block->segment = 0;
	block->number++;
}

static bool put_block(struct iec61850_server *server, struct ber_writer *writer,
		      const struct iec61850_object *object, struct iec61850_block *block)
{
	const size_t end = writer->at;
	uint32_t limit = iec61850_set_of(&server->model, block)->count, count;
	bool more;

	while ((count = choose(server, block, limit, &more)) > 0) {
		put_report(server, writer, object, block, count, more);
		if (!writer->full) {
			sent(server, block, count, more);
			return true;
		}
		writer->at = end;
		writer->full = false;
		limit = count / 2;
	}
	enable(&server->model, block, false, server->now_ns); /* not even one member fits */
	return false;
}

/* Chooses the members of an entry that are a report of this block. Returns how many. */
static uint32_t choose_told(struct iec61850_server *server, const struct iec61850_block *block,
			    const struct map_history_entry *entry)
{
	const struct iec61850_model *model = &server->model;
	uint32_t count = 0;

	if (entry->point >= model->config->point_count)
		return 0;
	for (uint32_t i = iec61850_last_member(model, entry->point, block->set); i != IEC61850_NO_MEMBER;
	     i = iec61850_member_before(model, i, block->set))
		if (reason_told(server, block, entry, i) != 0)
			server->chosen[count++] = i - model->sets[block->set].first;
	for (uint32_t i = 0; i < count / 2; i++) { /* the last came first */
		const uint32_t member = server->chosen[i];

		server->chosen[i] = server->chosen[count - 1 - i];
		server->chosen[count - 1 - i] = member;
	}
	return count;
}

static bool put_one(struct iec61850_server *server, struct ber_writer *writer,
		    const struct iec61850_object *object, struct iec61850_block *block,
		    const struct map_history_entry *entry, uint32_t count)
{
	server->entry = entry;
	put_report(server, writer, object, block, count, false);
	block->kept->told_ns = time_of_report(server);
	server->entry = NULL;
	if (writer->full) { /* not even one member fits */
		enable(&server->model, block, false, server->now_ns);
		return false;
	}
	block->number++;
	return true;
}

/* The next report of what is kept for a block. */
static bool put_kept(struct iec61850_server *server, struct ber_writer *writer,
		     const struct iec61850_object *object, struct iec61850_block *block)
{
	struct iec61850_kept_block *kept = block->kept;
	const struct iec61850_buffer *buffer = &server->model.buffer;
	bool overflow;

	kept->next = iec61850_buffer_first(buffer, kept, &overflow);
	kept->overflow = overflow;
	while (kept->next != buffer->next) {
		const struct map_history_entry *entry = iec61850_buffer_entry(buffer, kept->next);
		const uint32_t count = entry == NULL ? 0 : choose_told(server, block, entry);

		if (count > 0) {
			if (!put_one(server, writer, object, block, entry, count))
				return false;
			kept->overflow = false;
			kept->next++;
			return true;
		}
		kept->next++;
	}
	return false;
}

static bool is_due(struct iec61850_server *server, struct iec61850_block *block)
{
	if (block->integrity_ms > 0 && (block->triggers & IEC61850_INTEGRITY) &&
	    block->integrity_ns <= server->now_ns) {
		block->integrity_ns = server->now_ns + block->integrity_ms * NS_PER_MS;
		mark_all(&server->model, block, IEC61850_INTEGRITY, server->now_ns);
	}
	return block->due_ns != 0 && block->due_ns <= server->now_ns;
}

/* The next report of a block of server->client. */
static bool put_next(struct iec61850_server *server, struct ber_writer *writer, struct iec61850_block *block)
{
	const struct iec61850_object object = iec61850_block_object(block);

	/* What is kept comes before what is asked for now, which is newer. */
	if (block->kept != NULL && put_kept(server, writer, &object, block))
		return true;
	return is_due(server, block) && put_block(server, writer, &object, block);
}

bool iec61850_report_put(struct iec61850_server *server, struct ber_writer *writer)
{
	struct iec61850_block *next;

	for (struct iec61850_block *block = server->model.enabled; block != NULL; block = next) {
		/* A block whose report fits into no PDU is not enabled any more. */
		next = block->next_enabled;
		if (block->owner == server->client && put_next(server, writer, block))
			return true;
	}
	return false;
}

int64_t iec61850_report_due_ns(const struct iec61850_server *server)
{
	int64_t due_ns = INT64_MAX;

	for (const struct iec61850_block *block = server->model.enabled; block != NULL;
	     block = block->next_enabled) {
		if (block->kept != NULL && block->kept->next != server->model.buffer.next)
			return 0;
		if (block->due_ns != 0 && block->due_ns < due_ns)
			due_ns = block->due_ns;
		if (block->integrity_ms > 0 && block->integrity_ns < due_ns)
			due_ns = block->integrity_ns;
	}
	return due_ns;
}
