/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/report.h"

#include <stdio.h>
#include <string.h>

#include "iec61850/tags.h"
#include "iec61850/value.h"

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

static void mark_all(const struct iec61850_device *device, struct iec61850_block *block, unsigned reason,
		     int64_t now_ns)
{
	const uint32_t count = device->members[iec61850_set_of(device, block)];

	for (uint32_t i = 0; i < count; i++)
		mark(block, i, reason, now_ns);
	if (block->due_ns != 0)
		block->due_ns = now_ns; /* who asks for all does not wait */
}

/* again: of an event that a former process had not taken, which the image may have already: it is a change all the same. */
static void note(struct iec61850_server *server, uint32_t point, const struct map_sample *sample, bool again,
		 int64_t now_ns)
{
	const struct iec61850_model *model = &server->model;
	const struct iec61850_place *place = &model->places[point];
	const struct iec61850_device *device = &model->devices[place->device];
	const unsigned reason =
	    (sample->value.u != model->image[point].value.u ? IEC61850_DATA_CHANGE : 0) |
	    (sample->quality != model->image[point].quality ? IEC61850_QUALITY_CHANGE : 0);

	model->image[point] = *sample;
	if (reason != 0 || again)
		iec61850_buffer_add(&server->model.buffer, point,
				    (uint8_t)(reason != 0 ? reason : (unsigned)IEC61850_DATA_CHANGE), sample);
	for (unsigned i = 0; reason != 0 && i < IEC61850_BLOCKS_A_SET; i++)
		mark(&device->blocks[place->set * IEC61850_BLOCKS_A_SET + i], place->member, reason, now_ns);
}

static void note_owner(struct iec61850_server *server, uint32_t module, int64_t now_ns)
{
	struct map_sample sample;

	for (uint32_t i = 0; i < server->model.config->point_count; i++)
		if ((module == MAP_NONE || map_owner(server->model.map, i) == module) &&
		    map_read(server->model.map, i, &sample))
			note(server, i, &sample, false, now_ns);
}

void iec61850_report_all(struct iec61850_server *server, int64_t now_ns)
{
	note_owner(server, MAP_NONE, now_ns);
}

void iec61850_report_event(struct iec61850_server *server, const struct map_event *event, int64_t now_ns)
{
	switch ((enum map_event_kind)event->kind) {
	case MAP_EVENT_CHANGE: /* those of an earlier start are buffered blocks' */
		if (event->time == MAP_TIME_MONOTONIC && event->point < server->model.config->point_count)
			note(server, event->point, &event->sample, server->catching_up, now_ns);
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
		hash = (hash ^ model->points[i]) * 16777619u;
	return hash;
}

static void load_block(struct iec61850_block *block, struct map_history_reader *reader)
{
	struct iec61850_kept_block *kept = (void *)reader->octets;

	block->kept = kept;
	block->reader = reader;
	if (!reader->used) {
		kept->triggers = IEC61850_DATA_CHANGE | IEC61850_QUALITY_CHANGE;
		kept->options = IEC61850_SEQUENCE | IEC61850_TIME_STAMP | IEC61850_REASON |
				IEC61850_OVERFLOW | IEC61850_ENTRY;
	}
	block->triggers = kept->triggers & IEC61850_TRIGGERS; /* it may be of a file */
	block->options = kept->options & IEC61850_ALL_OPTIONS;
	block->buffer_ms = kept->buffer_ms;
	block->integrity_ms = kept->integrity_ms;
	kept->id[sizeof(kept->id) - 1] = '\0';
	memcpy(block->id, kept->id, sizeof(block->id));
}

static void save_block(const struct iec61850_block *block)
{
	struct iec61850_kept_block *kept = block->kept;

	kept->triggers = block->triggers;
	kept->options = block->options;
	kept->buffer_ms = block->buffer_ms;
	kept->integrity_ms = block->integrity_ms;
	memcpy(kept->id, block->id, sizeof(kept->id));
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

		if (entry != NULL && entry->point < model->config->point_count)
			model->image[entry->point] = entry->sample;
	}
}

void iec61850_report_begin(struct iec61850_server *server, void *section, struct map_cursor *cursor,
			   uint32_t start)
{
	struct iec61850_model *model = &server->model;
	struct iec61850_buffer *buffer = &model->buffer;

	const enum iec61850_begun begun =
	    iec61850_buffer_begin(buffer, section, model->config, numbering(model), start);

	server->catching_up = begun == IEC61850_GOES_ON;
	for (uint32_t i = 0; i < model->device_count && i < IEC61850_KEPT_DEVICES; i++)
		for (uint32_t j = 0; j < IEC61850_KEPT_BLOCKS; j++)
			load_block(&model->devices[i].blocks[IEC61850_UNBUFFERED + j],
				   &buffer->history.readers[i * IEC61850_KEPT_BLOCKS + j]);
	take_image(model, begun);
	if (begun == IEC61850_GOES_ON)
		*cursor = iec61850_buffer_cursor(buffer);
	else if (begun == IEC61850_GOES_ON_LATER)
		*cursor =
		    (struct map_cursor){.lost = 0}; /* behind it is all that was since the gateway started */
	else
		iec61850_buffer_settle(buffer, cursor);
}

/* ---- control blocks ---------------------------------------------------------------------- */

static void enable(const struct iec61850_device *device, struct iec61850_block *block, bool on,
		   int64_t now_ns)
{
	memset(block->reasons, 0, device->members[iec61850_set_of(device, block)]);
	block->enabled = on;
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

/* The data set is fixed: its own name may be written. */
static int write_set(struct iec61850_server *server, const struct iec61850_object *object,
		     const struct ber_element *data, const struct iec61850_block *block)
{
	char device[IEC61850_NAME_SIZE], name[IEC61850_REFERENCE_SIZE];

	iec61850_device_name(&server->model, object->device, device);
	snprintf(name, sizeof(name), "%s/%s", device,
		 iec61850_set_name(iec61850_set_of(object->device, block)));
	if (data->tag != IEC61850_TAG_VISIBLE_STRING)
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	return ber_is(data, name, strlen(name)) ? 0 : IEC61850_ACCESS_VALUE_INVALID;
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
		return write_number(data, &block->integrity_ms);
	case IEC61850_ENTRY_ID:
		return write_entry(server, data, block);
	default:
		return IEC61850_ACCESS_DENIED;
	}
}

/* Of a buffered block: another setting purges what was kept for the former one. */
static int write_kept(struct iec61850_server *server, const struct iec61850_object *object,
		      const struct ber_element *data, struct iec61850_block *block)
{
	const struct iec61850_block before = *block;
	const int error = write_attribute(server, object, data, block);

	if (block->kept == NULL || error != 0)
		return error;
	if (before.triggers != block->triggers || before.buffer_ms != block->buffer_ms ||
	    before.integrity_ms != block->integrity_ms || strcmp(before.id, block->id) != 0)
		purge(server, block);
	save_block(block);
	return 0;
}

static int write_switch(struct iec61850_server *server, const struct iec61850_object *object, bool on,
			struct iec61850_block *block)
{
	switch (object->node->leaf) {
	case IEC61850_RPT_ENA:
		enable(object->device, block, on, server->now_ns);
		if (!on && !block->reserved)
			block->owner = NULL;
		return 0;
	case IEC61850_GI:
		if (!block->enabled)
			return IEC61850_ACCESS_UNAVAILABLE;
		if (on)
			mark_all(object->device, block, IEC61850_GENERAL, server->now_ns);
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

int iec61850_block_write(struct iec61850_server *server, const struct iec61850_object *object,
			 const struct ber_element *data)
{
	struct iec61850_block *block = iec61850_block_of(object->device, object->ln, object->number);

	if (block == NULL || object->node == NULL)
		return IEC61850_ACCESS_DENIED;
	if (block->owner != NULL && block->owner != server->client)
		return IEC61850_ACCESS_UNAVAILABLE;
	block->owner = server->client;
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

static uint32_t block_count(const struct iec61850_server *server)
{
	return server->model.device_count * IEC61850_BLOCKS;
}

void iec61850_blocks_release(struct iec61850_server *server, const void *client)
{
	for (uint32_t i = 0; i < block_count(server); i++) {
		struct iec61850_block *block = &server->model.blocks[i];

		if (block->owner == client) {
			block->owner = NULL;
			block->enabled = block->reserved = false;
		}
	}
}

bool iec61850_blocks_owned(const struct iec61850_server *server, const void *client)
{
	for (uint32_t i = 0; i < block_count(server); i++)
		if (server->model.blocks[i].owner == client)
			return true;
	return false;
}

/* ---- reports ----------------------------------------------------------------------------- */

/* Chooses the first members that are pending, limit at most. Returns how many; more: there are others. */
static uint32_t choose(struct iec61850_server *server, const struct iec61850_device *device,
		       const struct iec61850_block *block, uint32_t limit, bool *more)
{
	struct iec61850_object object = iec61850_before_first(device, iec61850_set_of(device, block));
	uint32_t count = 0, member = 0;

	*more = false;
	for (; iec61850_next_member(&server->model, &object); member++) {
		if (block->reasons[member] == 0)
			continue;
		if (count == limit) {
			*more = true;
			break;
		}
		server->chosen[count++] = (struct iec61850_chosen){object.number, member};
	}
	return count;
}

static void put_member(struct iec61850_server *server, struct ber_writer *writer,
		       const struct iec61850_object *object, unsigned reason)
{
	const uint32_t point = iec61850_point_of(&server->model, object);
	const struct map_history_entry *entry = server->entry;
	struct map_sample sample = entry != NULL ? entry->sample : server->model.image[point];

	if (reason & (IEC61850_GENERAL | IEC61850_INTEGRITY))
		map_read(server->model.map, point, &sample);
	iec61850_put_sample(writer, &server->model, object, &sample,
			    entry != NULL ? entry->time : (uint8_t)MAP_TIME_MONOTONIC);
}

/* What is said of the chosen members, from the last to the first: reasons, values, references, inclusion. */
static void put_members(struct iec61850_server *server, struct ber_writer *writer,
			const struct iec61850_device *device, const struct iec61850_block *block,
			uint32_t count)
{
	const enum iec61850_set set = iec61850_set_of(device, block);
	const size_t octets = (device->members[set] + 7) / 8;
	struct iec61850_object object = iec61850_before_first(device, set);

	for (uint32_t i = count; (block->options & IEC61850_REASON) && i-- > 0;)
		iec61850_put_bits(writer, (uint16_t)(block->reasons[server->chosen[i].member] << 8), 6);
	for (uint32_t i = count; i-- > 0 && !writer->full;) {
		object.number = server->chosen[i].number;
		put_member(server, writer, &object, block->reasons[server->chosen[i].member]);
	}
	for (uint32_t i = count; (block->options & IEC61850_REFERENCE) && i-- > 0 && !writer->full;) {
		char name[IEC61850_NAME_SIZE];

		object.number = server->chosen[i].number;
		iec61850_object_name(&server->model, &object, name);
		iec61850_put_reference(writer, &server->model, device, name);
	}
	if (writer->full || octets + 1 > writer->at - writer->floor) {
		writer->full = true;
		return;
	}
	memset(server->names, 0, octets + 1);
	server->names[0] = (uint8_t)(8 * octets - device->members[set]);
	for (uint32_t i = 0; i < count; i++)
		server->names[1 + server->chosen[i].member / 8] |=
		    (uint8_t)(0x80 >> server->chosen[i].member % 8);
	ber_put(writer, IEC61850_TAG_BIT_STRING, server->names, octets + 1);
}

/* Of an entry it is when it happened. */
static int64_t time_of_report(const struct iec61850_server *server)
{
	const struct map_clock clock = map_clock_read(server->model.map);
	const struct map_history_entry *entry = server->entry;
	const struct map_event event = {.time = entry != NULL ? entry->time : (uint8_t)MAP_TIME_MONOTONIC,
					.sample.time_ns =
					    entry != NULL ? entry->sample.time_ns : server->now_ns};

	return map_event_wall_ns(&event, clock);
}

static void put_head(struct iec61850_server *server, struct ber_writer *writer,
		     const struct iec61850_object *object, const struct iec61850_block *block, bool more)
{
	const struct iec61850_model *model = &server->model;

	if (block->options & IEC61850_SEGMENTATION) {
		ber_put(writer, IEC61850_TAG_BOOLEAN, (const uint8_t[]){more}, 1);
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, block->segment);
	}
	if (block->options & IEC61850_CONF_REVISION)
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, iec61850_conf_rev(object->device, block));
	if (block->options & IEC61850_ENTRY)
		iec61850_put_entry_id(writer, model,
				      server->entry != NULL ? server->entry->number : block->kept->next - 1);
	if (block->options & IEC61850_OVERFLOW)
		ber_put(writer, IEC61850_TAG_BOOLEAN, (const uint8_t[]){block->kept->overflow != 0}, 1);
	if (block->options & IEC61850_SET_NAME)
		iec61850_put_reference(writer, model, object->device,
				       iec61850_set_name(iec61850_set_of(object->device, block)));
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
		block->reasons[server->chosen[i].member] = 0;
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
	uint32_t limit = server->model.config->point_count, count;
	bool more;

	while ((count = choose(server, object->device, block, limit, &more)) > 0) {
		put_report(server, writer, object, block, count, more);
		if (!writer->full) {
			sent(server, block, count, more);
			return true;
		}
		writer->at = end;
		writer->full = false;
		limit = count / 2;
	}
	enable(object->device, block, false, server->now_ns); /* not even one member fits */
	return false;
}

/* Whether an entry is a report of this block. */
static bool tells(const struct iec61850_server *server, const struct iec61850_device *device,
		  const struct iec61850_block *block, const struct map_history_entry *entry)
{
	const struct iec61850_place *place = &server->model.places[entry->point];

	return (entry->reason & block->triggers) != 0 && &server->model.devices[place->device] == device &&
	       place->set == iec61850_set_of(device, block);
}

static bool put_one(struct iec61850_server *server, struct ber_writer *writer,
		    const struct iec61850_object *object, struct iec61850_block *block,
		    const struct map_history_entry *entry)
{
	const struct iec61850_place *place = &server->model.places[entry->point];
	const uint8_t pending = block->reasons[place->member];

	server->chosen[0] = (struct iec61850_chosen){place->number, place->member};
	server->entry = entry;
	block->reasons[place->member] = (uint8_t)(entry->reason & block->triggers);
	put_report(server, writer, object, block, 1, false);
	block->reasons[place->member] = pending;
	block->kept->told_ns = time_of_report(server);
	server->entry = NULL;
	if (writer->full) { /* not even one member fits */
		enable(object->device, block, false, server->now_ns);
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

	if (kept->next != buffer->next && iec61850_buffer_entry(buffer, kept->next) == NULL) {
		kept->next = iec61850_buffer_oldest(buffer);
		kept->overflow = true;
	}
	while (kept->next != buffer->next) {
		const struct map_history_entry *entry = iec61850_buffer_entry(buffer, kept->next);

		if (entry != NULL && entry->point < server->model.config->point_count &&
		    tells(server, object->device, block, entry)) {
			if (!put_one(server, writer, object, block, entry))
				return false;
			kept->overflow = false;
			kept->next++;
			return true;
		}
		kept->next++;
	}
	return false;
}

static bool is_due(struct iec61850_server *server, const struct iec61850_device *device,
		   struct iec61850_block *block)
{
	if (!block->enabled || block->owner != server->client)
		return false;
	if (block->integrity_ms > 0 && (block->triggers & IEC61850_INTEGRITY) &&
	    block->integrity_ns <= server->now_ns) {
		block->integrity_ns = server->now_ns + block->integrity_ms * NS_PER_MS;
		mark_all(device, block, IEC61850_INTEGRITY, server->now_ns);
	}
	return block->due_ns != 0 && block->due_ns <= server->now_ns;
}

bool iec61850_report_put(struct iec61850_server *server, struct ber_writer *writer)
{
	for (uint32_t i = 0; i < block_count(server); i++) {
		struct iec61850_block *block = &server->model.blocks[i];
		const struct iec61850_device *device = &server->model.devices[i / IEC61850_BLOCKS];
		const struct iec61850_object object = iec61850_block_object(device, i % IEC61850_BLOCKS);

		/* What is kept comes before what is asked for now, which is newer. */
		if (block->kept != NULL && block->enabled && block->owner == server->client &&
		    put_kept(server, writer, &object, block))
			return true;
		if (is_due(server, device, block) && put_block(server, writer, &object, block))
			return true;
	}
	return false;
}

int64_t iec61850_report_due_ns(const struct iec61850_server *server)
{
	int64_t due_ns = INT64_MAX;

	for (uint32_t i = 0; i < block_count(server); i++) {
		const struct iec61850_block *block = &server->model.blocks[i];

		if (!block->enabled)
			continue;
		if (block->kept != NULL && block->kept->next != server->model.buffer.next)
			return 0;
		if (block->due_ns != 0 && block->due_ns < due_ns)
			due_ns = block->due_ns;
		if (block->integrity_ms > 0 && block->integrity_ns < due_ns)
			due_ns = block->integrity_ns;
	}
	return due_ns;
}
