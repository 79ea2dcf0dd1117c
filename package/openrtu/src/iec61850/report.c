/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/report.h"

#include <string.h>

#include "iec61850/block.h"
#include "iec61850/list.h"
#include "iec61850/note.h"
#include "iec61850/tags.h"
#include "iec61850/value.h"

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
	return block->triggers & iec61850_reasons_for(server->model.nodes[member], entry->reason);
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
	iec61850_block_enable(&server->model, block, false, server->now_ns); /* not even one member fits */
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
		iec61850_block_enable(&server->model, block, false, server->now_ns);
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
		iec61850_note_asked(&server->model, block, IEC61850_INTEGRITY, server->now_ns);
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
