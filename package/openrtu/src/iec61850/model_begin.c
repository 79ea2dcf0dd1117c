/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the model is made of: the configuration's points, logical nodes, data sets and control blocks. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "iec61850/model.h"
#include "map/hash.h"
#include "map/limits.h"
#include "map/type.h"

/* What a logical device has if nobody has chosen its data sets. */
enum { STATUS, MEASURED, DEFAULT_SETS };
#define BLOCKS_A_SET 2 /* of each kind */
static const struct {
	const char *name;
	enum iec61850_fc fc;
	const char *unbuffered, *buffered;
} defaults[DEFAULT_SETS] = {[STATUS] = {"status", IEC61850_ST, "urcbStatus", "brcbStatus"},
			    [MEASURED] = {"measured", IEC61850_MX, "urcbMeasured", "brcbMeasured"}};

static uint16_t ca_of(const struct map_config *config, uint32_t point)
{
	return config->sets[config->points[point].set].ca;
}

/* "" of GGIO1: before all others. */
static const char *ln_name_of(const struct iec61850_model *model, uint32_t point)
{
	return model->assigned[point] == NULL ? "" : model->assigned[point]->ln;
}

static int by_address(const void *a, const void *b, void *context)
{
	const struct iec61850_model *model = context;
	const struct map_config *config = model->config;
	const uint32_t one = *(const uint32_t *)a, other = *(const uint32_t *)b;
	const uint16_t ca = ca_of(config, one), other_ca = ca_of(config, other);
	const int by_ln = strcmp(ln_name_of(model, one), ln_name_of(model, other));

	if (ca != other_ca)
		return ca < other_ca ? -1 : 1;
	if (by_ln != 0)
		return by_ln;
	return config->points[one].ioa < config->points[other].ioa ? -1 : 1;
}

/* A logical node with all that its class has to have, until points take some of it. */
static struct iec61850_ln *add_ln(struct iec61850_model *model, struct iec61850_device *device,
				  unsigned class, const char *name)
{
	struct iec61850_ln *ln = &model->lns[model->ln_count++];

	*ln = (struct iec61850_ln){.class = &iec61850_ln_classes[class]};
	snprintf(ln->name, sizeof(ln->name), "%s", name);
	for (unsigned i = 0; i < ln->class->count; i++)
		if (ln->class->data[i].presence & IEC61850_MANDATORY) {
			ln->without |= 1u << i;
			ln->fixed++;
		}
	device->ln_count++;
	return ln;
}

static void add_point(struct iec61850_model *model, struct iec61850_ln *ln, uint32_t number)
{
	const struct iec61850_assignment *assigned = model->assigned[model->points[number]];

	if (ln->count++ == 0)
		ln->first = number;
	if (assigned == NULL || !(ln->class->data[assigned->data].presence & IEC61850_MANDATORY))
		return;
	ln->without &= ~(1u << assigned->data);
	ln->fixed--;
}

static struct iec61850_device *add_device(struct iec61850_model *model, uint16_t ca, uint32_t first)
{
	struct iec61850_device *device = &model->devices[model->device_count++];

	*device = (struct iec61850_device){.ca = ca, .first = first, .lns = &model->lns[model->ln_count]};
	add_ln(model, device, IEC61850_CLASS_LLN0, "LLN0");
	add_ln(model, device, IEC61850_CLASS_LPHD, "LPHD1");
	return device;
}

static void make_devices(struct iec61850_model *model)
{
	struct iec61850_device *device = NULL;
	struct iec61850_ln *ln = NULL;
	const char *name = NULL;

	for (uint32_t i = 0; i < model->config->point_count; i++) {
		const uint32_t point = model->points[i];
		const struct iec61850_assignment *assigned = model->assigned[point];

		if (device == NULL || device->ca != ca_of(model->config, point)) {
			device = add_device(model, ca_of(model->config, point), i);
			name = NULL;
		}
		if (name == NULL || strcmp(name, ln_name_of(model, point)) != 0) {
			name = ln_name_of(model, point);
			ln = assigned == NULL ? add_ln(model, device, IEC61850_CLASS_GGIO, "GGIO1")
					      : add_ln(model, device, assigned->class, name);
			ln->sorted = assigned == NULL;
		}
		add_point(model, ln, i);
		device->count++;
	}
}

/* A member is what its name is, and what stands under it. */
static uint32_t hash_member(const struct iec61850_model *model, const struct iec61850_object *object,
			    uint32_t hash)
{
	const struct iec61850_class class = iec61850_class_of(model, object);
	char name[IEC61850_NAME_SIZE];

	iec61850_variable_name(model, object, name);
	hash = map_hash_octets(map_hash_octets(hash, name, strlen(name)), class.name, strlen(class.name));
	return class.has_range && object->node == NULL ? map_hash_word(hash, IEC61850_MV_RANGE) : hash;
}

/* Where each point is. */
static void make_places(struct iec61850_model *model)
{
	for (uint32_t i = 0; i < model->device_count; i++) {
		const struct iec61850_device *device = &model->devices[i];

		for (uint32_t ln = IEC61850_LNS_FIXED; ln < device->ln_count; ln++)
			for (uint32_t j = 0; j < device->lns[ln].count; j++) {
				const uint32_t number = device->lns[ln].fixed + j;
				const bool measured =
				    iec61850_nodes_of(model, device, ln, number, IEC61850_MX).count > 0;

				model->places[model->points[device->lns[ln].first + j]] =
				    (struct iec61850_place){.device = (uint16_t)i,
							    .ln = (uint16_t)ln,
							    .number = number & 0xffffff,
							    .member = IEC61850_NO_MEMBER,
							    .fc = measured ? IEC61850_MX : IEC61850_ST};
			}
	}
}

void iec61850_add_member(struct iec61850_model *model, uint32_t set, uint32_t member, uint32_t point,
			 const struct iec61850_node *node)
{
	struct iec61850_place *place = &model->places[point];
	struct iec61850_object object = iec61850_object_of(model, point);

	object.node = node;
	if (model->sets[set].count++ == 0)
		model->sets[set].revision = MAP_HASH_BASIS;
	model->members[member] = point;
	if (model->nodes[member] != node)
		model->nodes[member] = node;
	if (model->earlier[member] != place->member + 1)
		model->earlier[member] = place->member + 1;
	place->member = member;
	model->sets[set].revision = hash_member(model, &object, model->sets[set].revision);
	if (model->sets[set].revision == 0)
		model->sets[set].revision = 1; /* 0 would be: not configured */
}

void iec61850_clear_set(struct iec61850_model *model, uint32_t set)
{
	struct iec61850_set *of = &model->sets[set];

	for (uint32_t i = of->first; i < of->first + of->count; i++) {
		struct iec61850_place *place = &model->places[model->members[i]];
		uint32_t later = place->member;

		if (later == i) {
			place->member = iec61850_earlier(model, i);
			continue;
		}
		while (iec61850_earlier(model, later) != i)
			later = iec61850_earlier(model, later);
		model->earlier[later] = model->earlier[i];
	}
	of->count = 0;
}

static void add_member(struct iec61850_model *model, uint32_t set, uint32_t point,
		       const struct iec61850_node *node)
{
	iec61850_add_member(model, set, model->member_count++, point, node);
}

static uint32_t add_set(struct iec61850_model *model, struct iec61850_device *device, const char *ln,
			const char *name)
{
	model->sets[model->set_count] =
	    (struct iec61850_set){.ln = ln, .name = name, .first = model->member_count};
	if (device->set_count++ == 0)
		device->first_set = model->set_count;
	return model->set_count++;
}

/* A control block has a reason for each member of its data set, and an unbuffered one of a client's too. */
static uint32_t room_for(const struct iec61850_model *model, const struct iec61850_report *report,
			 uint32_t set)
{
	const uint32_t count = model->sets[set].count;

	return report->buffered || count > IEC61850_LIST_MEMBERS ? count : IEC61850_LIST_MEMBERS;
}

static uint32_t ln_called(const struct iec61850_device *device, const char *name)
{
	uint32_t ln = 0;

	while (strcmp(device->lns[ln].name, name) != 0)
		ln++;
	return ln;
}

static void add_blocks(struct iec61850_model *model, struct iec61850_device *device,
		       const struct iec61850_report *report, uint32_t set, uint32_t *kept)
{
	const uint32_t ln = ln_called(device, model->sets[set].ln);

	for (unsigned i = 0; i < report->instances; i++) {
		char *const id = model->ids[model->block_count];
		struct iec61850_block *block = &model->blocks[model->block_count++];

		if (device->lns[ln].block_count++ == 0)
			device->lns[ln].first_block = device->block_count;
		*block = (struct iec61850_block){.device = device,
						 .ln = ln,
						 .name = report->name,
						 .index = (uint8_t)(i + 1),
						 .buffered = report->buffered,
						 .set = set,
						 .own_set = set,
						 .triggers = report->triggers,
						 .options = report->options,
						 .buffer_ms = report->buffer_ms,
						 .integrity_ms = report->integrity_ms,
						 .id = id,
						 .reasons = model->reasons + model->reason_count};
		if (report->id[0] != '\0')
			snprintf(id, sizeof(*model->ids), "%s", report->id);
		if (report->buffered)
			block->kept_number = (*kept)++;
		model->reason_count += room_for(model, report, set);
		device->block_count++;
	}
}

/* Places of buffered blocks are those of both data sets, whether they have members or not: a point that comes moves none. */
static void add_default_blocks(struct iec61850_model *model, struct iec61850_device *device,
			       const uint32_t of[DEFAULT_SETS], bool buffered, uint32_t *kept)
{
	const uint32_t first = *kept;

	if (buffered && first + IEC61850_KEPT_BLOCKS > IEC61850_KEPT_ALL)
		return;
	for (unsigned i = 0; i < DEFAULT_SETS; i++) {
		struct iec61850_report report = {.instances = BLOCKS_A_SET, .buffered = buffered};

		if (of[i] == IEC61850_NO_MEMBER)
			continue;
		if (buffered) {
			report.triggers = IEC61850_DATA_CHANGE | IEC61850_QUALITY_CHANGE;
			report.options = IEC61850_SEQUENCE | IEC61850_TIME_STAMP | IEC61850_REASON |
					 IEC61850_OVERFLOW | IEC61850_ENTRY;
			*kept = first + i * BLOCKS_A_SET;
		}
		add_blocks(model, device, &report, of[i], kept);
		for (unsigned j = 1; j <= BLOCKS_A_SET; j++) /* of the file's, which last */
			device->blocks[device->block_count - j].name =
			    buffered ? defaults[i].buffered : defaults[i].unbuffered;
	}
	if (buffered)
		*kept = first + IEC61850_KEPT_BLOCKS;
}

static void make_default_sets(struct iec61850_model *model, struct iec61850_device *device, uint32_t *kept)
{
	uint32_t of[DEFAULT_SETS];

	for (unsigned i = DEFAULT_SETS; i-- > 0;) { /* in the order of their names */
		of[i] = IEC61850_NO_MEMBER;
		for (uint32_t j = 0; j < device->count; j++) {
			const uint32_t point = model->points[device->first + j];

			if (model->places[point].fc != defaults[i].fc)
				continue;
			if (of[i] == IEC61850_NO_MEMBER)
				of[i] =
				    add_set(model, device, device->lns[IEC61850_LLN0].name, defaults[i].name);
			add_member(model, of[i], point, NULL);
		}
	}
	add_default_blocks(model, device, of, false, kept);
	add_default_blocks(model, device, of, true, kept);
}

/* The attribute of a point that the file has checked; NULL: all. */
static void add_chosen(struct iec61850_model *model, uint32_t set, const struct iec61850_chosen *chosen)
{
	struct iec61850_object object = iec61850_object_of(model, chosen->point);
	char name[IEC61850_NAME_SIZE];

	iec61850_object_name(model, &object, name);
	snprintf(name + strlen(name), sizeof(name) - strlen(name), "%s%s",
		 chosen->attribute[0] == '\0' ? "" : "$", chosen->attribute);
	for (char *c = name; *c != '\0'; c++)
		if (*c == '.')
			*c = '$';
	iec61850_find(model, object.device, (const uint8_t *)name, strlen(name), &object);
	add_member(model, set, chosen->point, object.node);
}

/* A data set of the file, with its control blocks. */
static void make_chosen_set(struct iec61850_model *model, struct iec61850_device *device, uint32_t number,
			    uint32_t *kept)
{
	const struct iec61850_data_set *chosen = &iec61850_data_sets(model->config)[number];
	const uint32_t set = add_set(model, device, chosen->ln, chosen->name);

	for (uint32_t i = 0; i < chosen->member_count; i++)
		add_chosen(model, set, &iec61850_members(model->config)[chosen->first_member + i]);
	if (chosen->conf_rev != 0)
		model->sets[set].revision = chosen->conf_rev;
	for (uint32_t i = 0; i < map_record_count(model->config, IEC61850_REPORTS); i++)
		if (iec61850_reports(model->config)[i].set == number)
			add_blocks(model, device, &iec61850_reports(model->config)[i], set, kept);
}

/* Buffered blocks that are chosen: they have the first places. */
static uint32_t chosen_kept(const struct map_config *config)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < map_record_count(config, IEC61850_REPORTS); i++)
		if (iec61850_reports(config)[i].buffered)
			count += iec61850_reports(config)[i].instances;
	return count;
}

/* The file's data sets are in the order of their names. */
static void make_sets(struct iec61850_model *model)
{
	const uint32_t chosen = map_record_count(model->config, IEC61850_DATA_SETS);
	uint32_t kept = 0, default_kept = chosen_kept(model->config);

	for (uint32_t i = 0; i < model->device_count; i++) {
		struct iec61850_device *device = &model->devices[i];

		device->blocks = &model->blocks[model->block_count];
		for (uint32_t j = 0; j < chosen; j++) {
			const struct iec61850_data_set *set = &iec61850_data_sets(model->config)[j];

			if (model->places[iec61850_members(model->config)[set->first_member].point].device ==
			    i)
				make_chosen_set(model, device, j, &kept);
		}
		if (device->set_count == 0)
			make_default_sets(model, device, &default_kept);
	}
}

/* Room for the data sets of clients. */
static void make_lists(struct iec61850_model *model)
{
	model->longest_set = IEC61850_LIST_MEMBERS;
	for (uint32_t i = 0; i < model->set_count; i++)
		if (model->sets[i].count > model->longest_set)
			model->longest_set = model->sets[i].count;
	for (uint32_t i = 0; i < IEC61850_LISTS; i++)
		model->sets[model->set_count + i].first = model->member_count + i * IEC61850_LIST_MEMBERS;
}

static uint32_t hash_assignment(uint32_t hash, const struct iec61850_assignment *assigned)
{
	const uint32_t words[] = {assigned->class, assigned->data, assigned->number};

	return map_hash_octets(map_hash_octets(hash, assigned->ln, strlen(assigned->ln)), words,
			       sizeof(words));
}

static uint32_t hash_limits(uint32_t hash, const struct map_limits *limits)
{
	const float numbers[] = {limits->high_high, limits->high, limits->low, limits->low_low};

	return map_hash_octets(hash, numbers, sizeof(numbers));
}

static uint32_t hash_section(const struct map_config *config, uint32_t id, size_t size, uint32_t hash)
{
	const uint32_t count = map_record_count(config, id);

	return count == 0 ? hash : map_hash_octets(hash, map_records(config, id, size), count * size);
}

static uint32_t hash_chosen(const struct map_config *config, uint32_t hash)
{
	hash = hash_section(config, IEC61850_DATA_SETS, sizeof(struct iec61850_data_set), hash);
	hash = hash_section(config, IEC61850_MEMBERS, sizeof(struct iec61850_chosen), hash);
	return hash_section(config, IEC61850_REPORTS, sizeof(struct iec61850_report), hash);
}

/* What the model is made of. */
static uint32_t number_of_configuration(const struct iec61850_model *model)
{
	uint32_t hash = MAP_HASH_BASIS;

	for (uint32_t i = 0; i < model->config->point_count; i++) {
		const struct map_point *point = &model->config->points[model->points[i]];
		const uint32_t words[] = {ca_of(model->config, model->points[i]), point->ioa, point->type,
					  point->flags};
		const struct iec61850_unit unit = iec61850_unit_of(model, point);

		hash = map_hash_octets(hash, words, sizeof(words));
		if (unit.si != 0)
			hash = map_hash_octets(hash, &unit, sizeof(unit));
		if (point->flags & MAP_POINT_LIMITS)
			hash = hash_limits(hash, map_limits_of(model->config, model->points[i]));
		if (model->assigned[model->points[i]] != NULL)
			hash = hash_assignment(hash, model->assigned[model->points[i]]);
	}
	return hash_chosen(model->config, hash);
}

bool iec61850_model_begin(struct iec61850_model *model, const struct map *map)
{
	const bool begun = iec61850_model_of(model, map_config(map));

	model->map = map;
	model->started_ns = map_now_ns();
	return begun;
}

/* What sets and blocks there can be at most: those of the file, and those of devices without. */
static bool allocate_sets(struct iec61850_model *model)
{
	const struct map_config *config = model->config;
	const uint32_t chosen = map_record_count(config, IEC61850_DATA_SETS);
	size_t members, blocks = (size_t)model->device_count * 2 * DEFAULT_SETS * BLOCKS_A_SET;
	/* A point is a member of one default data set at most. */
	size_t reasons = (size_t)config->point_count * 2 * BLOCKS_A_SET + blocks / 2 * IEC61850_LIST_MEMBERS;

	for (uint32_t i = 0; i < map_record_count(config, IEC61850_REPORTS); i++) {
		const struct iec61850_report *report = &iec61850_reports(config)[i];

		blocks += report->instances;
		reasons += (size_t)report->instances *
			   (iec61850_data_sets(config)[report->set].member_count + IEC61850_LIST_MEMBERS);
	}
	model->sets = calloc((size_t)model->device_count * DEFAULT_SETS + chosen + IEC61850_LISTS,
			     sizeof(*model->sets));
	members = (size_t)config->point_count + map_record_count(config, IEC61850_MEMBERS) +
		  (size_t)IEC61850_LISTS * IEC61850_LIST_MEMBERS;
	model->members = calloc(members, sizeof(*model->members));
	model->nodes = calloc(members, sizeof(*model->nodes));
	model->earlier = calloc(members, sizeof(*model->earlier));
	model->blocks = calloc(blocks + 1, sizeof(*model->blocks));
	model->ids = calloc(blocks + 1, sizeof(*model->ids));
	model->reasons = calloc(reasons + 1, 1);
	return model->sets != NULL && model->members != NULL && model->nodes != NULL &&
	       model->earlier != NULL && model->blocks != NULL && model->ids != NULL &&
	       model->reasons != NULL;
}

static void read_units(struct iec61850_model *model)
{
	const struct map_unit *units = map_records(model->config, MAP_UNITS, sizeof(*units));

	for (uint32_t i = 0; units != NULL && i < map_record_count(model->config, MAP_UNITS); i++)
		model->units[i + 1] = iec61850_unit_parse(units[i].text);
}

bool iec61850_model_of(struct iec61850_model *model, const struct map_config *config)
{
	*model = (struct iec61850_model){.config = config,
					 .settings = iec61850_settings(config),
					 .points = calloc(config->point_count + 1, sizeof(*model->points)),
					 .devices = calloc(config->set_count + 1, sizeof(*model->devices))};
	model->places = calloc(config->point_count + 1, sizeof(*model->places));
	model->image = calloc(config->point_count + 1, sizeof(*model->image));
	model->selected = calloc(config->point_count + 1, sizeof(*model->selected));
	model->assigned = calloc(config->point_count + 1, sizeof(*model->assigned));
	/* Each device has GGIO1 at most besides those of the configuration. */
	model->lns = calloc((size_t)config->set_count * (IEC61850_LNS_FIXED + 1) +
				map_record_count(config, IEC61850_ASSIGNMENTS) + 1,
			    sizeof(*model->lns));
	if (model->points == NULL || model->devices == NULL || model->places == NULL ||
	    model->image == NULL || model->selected == NULL || model->assigned == NULL || model->lns == NULL)
		return false;
	for (uint32_t i = 0; i < config->point_count; i++)
		model->points[i] = i;
	for (uint32_t i = 0; i < map_record_count(config, IEC61850_ASSIGNMENTS); i++)
		model->assigned[iec61850_assignments(config)[i].point] = &iec61850_assignments(config)[i];
	read_units(model);
	qsort_r(model->points, config->point_count, sizeof(*model->points), by_address, model);
	make_devices(model);
	make_places(model);
	if (!allocate_sets(model))
		return false;
	make_sets(model);
	make_lists(model);
	model->revision = number_of_configuration(model);
	return true;
}

void iec61850_model_end(struct iec61850_model *model)
{
	free(model->points);
	free(model->devices);
	free(model->sets);
	free(model->members);
	free(model->nodes);
	free(model->earlier);
	free(model->blocks);
	free(model->ids);
	free(model->reasons);
	free(model->places);
	free(model->image);
	free(model->selected);
	free(model->assigned);
	free(model->lns);
}
