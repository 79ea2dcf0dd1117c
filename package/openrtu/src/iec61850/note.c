/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/note.h"

#include "iec61850/list.h"
#include "iec61850/value.h"
#include "map/limits.h"

static void mark(struct iec61850_block *block, uint32_t member, unsigned reason, int64_t now_ns)
{
	reason &= block->triggers;
	if (!block->enabled || reason == 0)
		return;
	block->reasons[member] |= (uint8_t)reason;
	if (block->due_ns == 0)
		block->due_ns = now_ns + block->buffer_ms * NS_PER_MS;
}

/*
 * Who asks for all while a point was not read yet is told so, and nobody else. Its first reading is then a change, also where it is
 * as the last entry of a former start has it.
 */
static void forget_unread(const struct iec61850_model *model, uint32_t point)
{
	struct map_sample now;

	if (map_read(model->map, point, &now) && now.time_ns == 0)
		model->image[point] = now;
}

void iec61850_note_asked(const struct iec61850_model *model, struct iec61850_block *block, unsigned reason,
			 int64_t now_ns)
{
	const struct iec61850_set *set = iec61850_set_of(model, block);

	for (uint32_t i = 0; i < set->count; i++) {
		forget_unread(model, model->members[set->first + i]);
		mark(block, i, reason, now_ns);
	}
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
unsigned iec61850_reasons_for(const struct iec61850_node *node, unsigned reason)
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
				     iec61850_reasons_for(model->nodes[i], reason), now_ns);
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
void iec61850_note_selection(struct iec61850_server *server, uint32_t point, int64_t now_ns)
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

void iec61850_note_selections(struct iec61850_server *server, int64_t now_ns)
{
	const struct map_config *config = server->model.config;

	for (uint32_t i = 0; i < config->point_count; i++)
		if (config->points[i].flags & MAP_POINT_SELECT)
			iec61850_note_selection(server, i, now_ns);
}

/* Of what has become invalid, or valid again, the time is that of its owner's loss or return: its value's is before. */
static void note_owner(struct iec61850_server *server, uint32_t module, int64_t since_ns, int64_t now_ns)
{
	const struct iec61850_model *model = &server->model;
	struct map_sample sample;

	for (uint32_t i = 0; i < model->config->point_count; i++) {
		if ((module != MAP_NONE && map_owner(model->map, i) != module) ||
		    !map_read(model->map, i, &sample))
			continue;
		if (sample.quality != model->image[i].quality && sample.time_ns < since_ns)
			sample.time_ns = since_ns;
		note(server, i, &sample, 0, now_ns);
	}
}

void iec61850_note_all(struct iec61850_server *server, int64_t now_ns)
{
	note_owner(server, MAP_NONE, 0, now_ns);
}

void iec61850_note_event(struct iec61850_server *server, const struct map_event *event, int64_t now_ns)
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
		note_owner(server, event->point, event->sample.time_ns, now_ns);
		return;
	case MAP_EVENT_CLOCK:
		return;
	}
}

void iec61850_note_settle(struct iec61850_server *server, const struct map_cursor *cursor)
{
	iec61850_buffer_settle(&server->model.buffer, cursor);
}
