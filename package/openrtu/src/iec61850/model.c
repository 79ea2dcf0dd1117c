/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/model.h"

#include <stdio.h>
#include <string.h>

#define COUNT(array) ((unsigned)(sizeof(array) / sizeof((array)[0])))
#define NODES(nodes)                                                                                         \
	{                                                                                                    \
		nodes, COUNT(nodes)                                                                          \
	}

static const struct iec61850_node report_block[] = {{"RptID", IEC61850_RPT_ID, NULL, 0},
						    {"RptEna", IEC61850_RPT_ENA, NULL, 0},
						    {"Resv", IEC61850_RESV, NULL, 0},
						    {"DatSet", IEC61850_DAT_SET, NULL, 0},
						    {"ConfRev", IEC61850_CONF_REV, NULL, 0},
						    {"OptFlds", IEC61850_OPT_FLDS, NULL, 0},
						    {"BufTm", IEC61850_BUF_TM, NULL, 0},
						    {"SqNum", IEC61850_SQ_NUM, NULL, 0},
						    {"TrgOps", IEC61850_TRG_OPS, NULL, 0},
						    {"IntgPd", IEC61850_INTG_PD, NULL, 0},
						    {"GI", IEC61850_GI, NULL, 0},
						    {"Owner", IEC61850_OWNER, NULL, 0}};
static const struct iec61850_node buffered_block[] = {{"RptID", IEC61850_RPT_ID, NULL, 0},
						      {"RptEna", IEC61850_RPT_ENA, NULL, 0},
						      {"DatSet", IEC61850_DAT_SET, NULL, 0},
						      {"ConfRev", IEC61850_CONF_REV, NULL, 0},
						      {"OptFlds", IEC61850_OPT_FLDS, NULL, 0},
						      {"BufTm", IEC61850_BUF_TM, NULL, 0},
						      {"SqNum", IEC61850_LONG_SQ_NUM, NULL, 0},
						      {"TrgOps", IEC61850_TRG_OPS, NULL, 0},
						      {"IntgPd", IEC61850_INTG_PD, NULL, 0},
						      {"GI", IEC61850_GI, NULL, 0},
						      {"PurgeBuf", IEC61850_PURGE_BUF, NULL, 0},
						      {"EntryID", IEC61850_ENTRY_ID, NULL, 0},
						      {"TimeofEntry", IEC61850_TIME_OF_ENTRY, NULL, 0},
						      {"ResvTms", IEC61850_RESV_TMS, NULL, 0},
						      {"Owner", IEC61850_OWNER, NULL, 0}};

static const char *const fc_names[IEC61850_FCS] = {"BR", "CF", "CO", "DC", "EX", "MX", "RP", "ST"};

const char *iec61850_fc_name(uint32_t fc)
{
	return fc_names[fc];
}

/* ---- data objects ------------------------------------------------------------------------ */

/* What a data object is, and the number behind its name; 0: it has none. */
struct what {
	const char *name;
	enum iec61850_cdc cdc;
	enum iec61850_enumeration enumeration;
	uint32_t number;
};

static struct what data_of(const struct iec61850_ln_class *class, unsigned number)
{
	const struct iec61850_data *data = &class->data[number];

	return (struct what){data->name, (enum iec61850_cdc)data->cdc,
			     (enum iec61850_enumeration)data->enumeration, 0};
}

static struct what what_of_point(const struct iec61850_model *model, uint32_t point)
{
	const struct iec61850_assignment *assigned = model->assigned[point];
	const struct map_point *of = &model->config->points[point];
	const struct iec61850_data data = assigned == NULL
					      ? iec61850_default_data(of)
					      : iec61850_ln_classes[assigned->class].data[assigned->data];

	return (struct what){data.name, iec61850_cdc_of(&data, of),
			     (enum iec61850_enumeration)data.enumeration,
			     assigned == NULL ? of->ioa : assigned->number};
}

/* The class's data of the number-th bit of those that are there without a point. */
static unsigned data_without(const struct iec61850_ln *ln, uint32_t number)
{
	unsigned bit = 0;

	for (;; bit++)
		if ((ln->without & 1u << bit) && number-- == 0)
			return bit;
}

static const struct iec61850_ln *ln_of(const struct iec61850_object *object)
{
	return &object->device->lns[object->ln];
}

uint32_t iec61850_point_of(const struct iec61850_model *model, const struct iec61850_object *object)
{
	const struct iec61850_ln *ln = ln_of(object);

	if (object->number < ln->fixed || object->number - ln->fixed >= ln->count)
		return MAP_NONE;
	return model->points[ln->first + object->number - ln->fixed];
}

/* Of no control block. */
static struct what what_of(const struct iec61850_model *model, const struct iec61850_object *object)
{
	const uint32_t point = iec61850_point_of(model, object);
	const struct iec61850_ln *ln = ln_of(object);

	return point != MAP_NONE ? what_of_point(model, point)
				 : data_of(ln->class, data_without(ln, object->number));
}

struct iec61850_block *iec61850_block_of(const struct iec61850_device *device, uint32_t ln, uint32_t number)
{
	const struct iec61850_ln *of = &device->lns[ln];
	const uint32_t before = of->fixed + of->count;

	return number >= before && number - before < of->block_count
		   ? &device->blocks[of->first_block + number - before]
		   : NULL;
}

uint32_t iec61850_object_count(const struct iec61850_device *device, uint32_t ln)
{
	return device->lns[ln].fixed + device->lns[ln].count + device->lns[ln].block_count;
}

enum iec61850_ctl_kind iec61850_ctl_model(const struct iec61850_model *model, uint32_t point)
{
	const struct iec61850_settings *settings = model->settings;
	const uint8_t flags = model->config->points[point].flags;

	const enum iec61850_cdc cdc = what_of_point(model, point).cdc;

	if (settings->controller_count == 0 || !(flags & MAP_POINT_COMMAND) ||
	    iec61850_cdc_services(cdc, IEC61850_DIRECT_NORMAL).count == 0)
		return IEC61850_STATUS_ONLY;
	if (flags & MAP_POINT_SELECT)
		return settings->normal_security ? IEC61850_SBO_NORMAL : IEC61850_SBO_ENHANCED;
	return settings->normal_security ? IEC61850_DIRECT_NORMAL : IEC61850_DIRECT_ENHANCED;
}

/* Mod, the only one without a point that has a ctlModel, only shows. */
static enum iec61850_ctl_kind control_of(const struct iec61850_model *model, uint32_t point)
{
	return point == MAP_NONE ? IEC61850_STATUS_ONLY : iec61850_ctl_model(model, point);
}

/* A normalized value is shown as a part of what the unit would be of, an angle in degrees. */
struct iec61850_unit iec61850_unit_of(const struct iec61850_model *model, const struct map_point *point)
{
	if (point->type == MAP_ANGLE)
		return iec61850_unit_parse("deg");
	return model->units[point->type == MAP_NORMALIZED ? 0 : point->unit];
}

static bool has_unit(const struct iec61850_model *model, uint32_t point)
{
	return point != MAP_NONE && iec61850_unit_of(model, &model->config->points[point]).si != 0;
}

/* Of a set-point it is what it may be set to, of others their deadband. */
static bool has_limits(const struct iec61850_model *model, uint32_t point, enum iec61850_cdc cdc)
{
	const struct map_point *of = point == MAP_NONE ? NULL : &model->config->points[point];

	return of != NULL && (cdc == IEC61850_APC ? of->step > 0 : of->deadband > 0);
}

static struct iec61850_nodes nodes_of_block(const struct iec61850_block *block, enum iec61850_fc fc)
{
	if (fc != (block->buffered ? IEC61850_BR : IEC61850_RP))
		return (struct iec61850_nodes){0};
	return block->buffered ? (struct iec61850_nodes)NODES(buffered_block)
			       : (struct iec61850_nodes)NODES(report_block);
}

struct iec61850_nodes iec61850_nodes_of(const struct iec61850_model *model,
					const struct iec61850_device *device, uint32_t ln, uint32_t number,
					enum iec61850_fc fc)
{
	const struct iec61850_block *block = iec61850_block_of(device, ln, number);
	const struct iec61850_object object = {.device = device, .ln = ln, .number = number};
	enum iec61850_ctl_kind control;
	enum iec61850_cdc cdc;
	uint32_t point;

	if (block != NULL)
		return nodes_of_block(block, fc);
	cdc = what_of(model, &object).cdc;
	point = iec61850_point_of(model, &object);
	control = control_of(model, point);
	if (fc == IEC61850_CF)
		return iec61850_cdc_settings(cdc, control, has_limits(model, point, cdc),
					     has_unit(model, point));
	return fc == IEC61850_CO ? iec61850_cdc_services(cdc, control) : iec61850_cdc_nodes(cdc, control, fc);
}

bool iec61850_has(const struct iec61850_model *model, const struct iec61850_device *device, uint32_t ln,
		  enum iec61850_fc fc)
{
	const uint32_t count = iec61850_object_count(device, ln);

	for (uint32_t i = 0; i < count; i++)
		if (iec61850_nodes_of(model, device, ln, i, fc).count > 0)
			return true;
	return false;
}

struct iec61850_class iec61850_class_of(const struct iec61850_model *model,
					const struct iec61850_object *object)
{
	const uint32_t point = iec61850_point_of(model, object);
	const struct what what = what_of(model, object);

	return (struct iec61850_class){.name = iec61850_cdc_names[what.cdc],
				       .enumeration = what.enumeration,
				       .controllable = iec61850_cdc_is_controllable(what.cdc),
				       .has_limits = has_limits(model, point, what.cdc),
				       .has_unit = has_unit(model, point),
				       .has_range = what.cdc == IEC61850_MV_RANGE,
				       .control = control_of(model, point)};
}

struct iec61850_object iec61850_object_of(const struct iec61850_model *model, uint32_t point)
{
	const struct iec61850_place *place = &model->places[point];

	return (struct iec61850_object){.device = &model->devices[place->device],
					.ln = place->ln,
					.fc = place->fc,
					.number = place->number};
}

/* ---- names ------------------------------------------------------------------------------- */

/* A data object's own name. */
static void print_what(const struct what *what, char out[IEC61850_NAME_SIZE])
{
	if (what->number > 0)
		snprintf(out, IEC61850_NAME_SIZE, "%s%u", what->name, (unsigned)what->number);
	else
		snprintf(out, IEC61850_NAME_SIZE, "%s", what->name);
}

void iec61850_device_name(const struct iec61850_model *model, const struct iec61850_device *device,
			  char out[IEC61850_NAME_SIZE])
{
	snprintf(out, IEC61850_NAME_SIZE, "%sCA%u", model->settings->ied, (unsigned)device->ca);
}

/* A device's name ends with its common address. */
static uint32_t number_behind(const uint8_t *name, size_t size)
{
	size_t digits = 0;
	uint32_t number = 0;

	while (digits < size && name[size - digits - 1] >= '0' && name[size - digits - 1] <= '9')
		digits++;
	for (; digits > 0; digits--)
		number = 10 * number + (uint32_t)(name[size - digits] - '0');
	return number;
}

const struct iec61850_device *iec61850_find_device(const struct iec61850_model *model, const uint8_t *name,
						   size_t size)
{
	const uint32_t ca = number_behind(name, size);

	for (uint32_t i = 0; i < model->device_count; i++) {
		char text[IEC61850_NAME_SIZE];

		if (model->devices[i].ca != ca)
			continue;
		iec61850_device_name(model, &model->devices[i], text);
		if (strlen(text) == size && memcmp(text, name, size) == 0)
			return &model->devices[i];
	}
	return NULL;
}

static void print_block(const struct iec61850_block *block, char out[IEC61850_NAME_SIZE])
{
	snprintf(out, IEC61850_NAME_SIZE, "%s%02u", block->name, (unsigned)block->index);
}

void iec61850_object_name(const struct iec61850_model *model, const struct iec61850_object *object,
			  char out[IEC61850_NAME_SIZE])
{
	const struct iec61850_ln *ln = ln_of(object);
	const struct iec61850_block *block;
	char own[IEC61850_NAME_SIZE];

	if (object->fc == IEC61850_WHOLE) {
		snprintf(out, IEC61850_NAME_SIZE, "%s", ln->name);
		return;
	}
	if (object->number == IEC61850_WHOLE) {
		snprintf(out, IEC61850_NAME_SIZE, "%s$%s", ln->name, fc_names[object->fc]);
		return;
	}
	block = iec61850_block_of(object->device, object->ln, object->number);
	if (block != NULL) {
		print_block(block, own);
	} else {
		const struct what what = what_of(model, object);

		print_what(&what, own);
	}
	snprintf(out, IEC61850_NAME_SIZE, "%s$%s$%.30s", ln->name, fc_names[object->fc], own);
}

/* Puts the path of a node behind a name. False: it is not inside. */
static bool add_path(struct iec61850_nodes inside, const struct iec61850_node *node,
		     char name[IEC61850_NAME_SIZE])
{
	const size_t length = strlen(name);

	for (unsigned i = 0; i < inside.count; i++) {
		const struct iec61850_node *each = &inside.nodes[i];

		snprintf(name + length, IEC61850_NAME_SIZE - length, "$%s", each->name);
		if (each == node ||
		    add_path((struct iec61850_nodes){each->children, each->count}, node, name))
			return true;
	}
	name[length] = '\0';
	return false;
}

void iec61850_variable_name(const struct iec61850_model *model, const struct iec61850_object *object,
			    char out[IEC61850_NAME_SIZE])
{
	iec61850_object_name(model, object, out);
	if (object->node != NULL)
		add_path(iec61850_nodes_of(model, object->device, object->ln, object->number,
					   (enum iec61850_fc)object->fc),
			 object->node, out);
}

/* A name may have letters that a VisibleString has not. */
void iec61850_description(const struct iec61850_model *model, const struct iec61850_object *object,
			  char out[MAP_NAME_SIZE])
{
	const struct map_config *config = model->config;
	const uint32_t point = iec61850_point_of(model, object);
	const uint32_t first = model->points[object->device->first];

	if (point != MAP_NONE)
		map_point_name(config, &config->points[point], out);
	else
		snprintf(out, MAP_NAME_SIZE, "%s", config->sets[config->points[first].set].name);
	for (char *c = out; *c != '\0'; c++)
		if (*c < ' ' || *c > '~')
			*c = '?';
}

/* A part of a name, between two $. */
struct part {
	const uint8_t *text;
	size_t size;
};

/* The next part of a name. False: it has no more. */
static bool next_part(struct part *rest, struct part *out)
{
	const uint8_t *dollar;

	if (rest->text == NULL)
		return false;
	dollar = memchr(rest->text, '$', rest->size);
	*out = *rest;
	if (dollar == NULL) {
		rest->text = NULL;
		return true;
	}
	out->size = (size_t)(dollar - rest->text);
	rest->size -= out->size + 1;
	rest->text = dollar + 1;
	return true;
}

static bool is(const struct part *part, const char *name)
{
	return strlen(name) == part->size && memcmp(name, part->text, part->size) == 0;
}

/* The point of a data object's name: letters, then the IOA without leading zeros. */
/* Of the points of GGIO1, which are in the order of their IOAs. */
static bool find_by_ioa(const struct iec61850_model *model, const struct iec61850_ln *ln,
			const struct part *name, uint32_t *number)
{
	uint32_t ioa = 0, low = 0, high = ln->count;
	size_t letters = 0;

	while (letters < name->size && (name->text[letters] < '0' || name->text[letters] > '9'))
		letters++;
	if (name->size - letters > 7)
		return false;
	for (size_t i = letters; i < name->size; i++)
		ioa = 10 * ioa + (uint32_t)(name->text[i] - '0');
	while (low < high) {
		const uint32_t middle = low + (high - low) / 2;

		if (model->config->points[model->points[ln->first + middle]].ioa < ioa)
			low = middle + 1;
		else
			high = middle;
	}
	*number = ln->fixed + low;
	return low < ln->count;
}

static bool is_named(const struct iec61850_model *model, const struct iec61850_object *object,
		     const struct part *name)
{
	const struct what what = what_of(model, object);
	char own[IEC61850_NAME_SIZE];

	print_what(&what, own);
	return is(name, own);
}

static bool find_object(const struct iec61850_model *model, const struct part *name,
			struct iec61850_object *out)
{
	const struct iec61850_ln *ln = ln_of(out);
	const uint32_t count = ln->fixed + ln->count;

	for (uint32_t i = 0; i < ln->block_count; i++) {
		char own[IEC61850_NAME_SIZE];

		print_block(&out->device->blocks[ln->first_block + i], own);
		if (is(name, own)) {
			out->number = count + i;
			return true;
		}
	}
	for (out->number = 0; out->number < (ln->sorted ? ln->fixed : count); out->number++)
		if (is_named(model, out, name))
			return true;
	return ln->sorted && find_by_ioa(model, ln, name, &out->number) && is_named(model, out, name);
}

static const struct iec61850_node *find_node(const struct iec61850_node *in, unsigned count,
					     const struct part *name)
{
	for (unsigned i = 0; i < count; i++)
		if (is(name, in[i].name))
			return &in[i];
	return NULL;
}

static bool find_ln(const struct part *name, struct iec61850_object *out)
{
	for (out->ln = 0; out->ln < out->device->ln_count; out->ln++)
		if (is(name, ln_of(out)->name))
			return true;
	return false;
}

static bool find_fc(const struct part *name, struct iec61850_object *out)
{
	for (out->fc = 0; out->fc < IEC61850_FCS; out->fc++)
		if (is(name, fc_names[out->fc]))
			return true;
	return false;
}

bool iec61850_find(const struct iec61850_model *model, const struct iec61850_device *device,
		   const uint8_t *name, size_t size, struct iec61850_object *out)
{
	struct part rest = {name, size}, part;
	struct iec61850_nodes inside;

	*out = (struct iec61850_object){.device = device, .fc = IEC61850_WHOLE, .number = IEC61850_WHOLE};
	if (!next_part(&rest, &part) || !find_ln(&part, out))
		return false;
	if (!next_part(&rest, &part))
		return true;
	if (!find_fc(&part, out))
		return false;
	if (!next_part(&rest, &part))
		return iec61850_has(model, device, out->ln, (enum iec61850_fc)out->fc);
	if (!find_object(model, &part, out))
		return false;
	inside = iec61850_nodes_of(model, device, out->ln, out->number, (enum iec61850_fc)out->fc);
	if (inside.count == 0)
		return false;
	while (next_part(&rest, &part)) {
		out->node = find_node(inside.nodes, inside.count, &part);
		if (out->node == NULL)
			return false;
		inside = (struct iec61850_nodes){out->node->children, out->node->count};
	}
	return true;
}

struct iec61850_object iec61850_block_object(const struct iec61850_block *block)
{
	const struct iec61850_ln *ln = &block->device->lns[block->ln];
	const uint32_t number = (uint32_t)(block - block->device->blocks);

	return (struct iec61850_object){.device = block->device,
					.ln = block->ln,
					.fc = block->buffered ? IEC61850_BR : IEC61850_RP,
					.number = ln->fixed + ln->count + number - ln->first_block};
}

/* ---- data sets --------------------------------------------------------------------------- */

void iec61850_set_name(const struct iec61850_set *set, char out[IEC61850_NAME_SIZE])
{
	if (set->ln == NULL)
		snprintf(out, IEC61850_NAME_SIZE, "%s", set->name);
	else
		snprintf(out, IEC61850_NAME_SIZE, "%.17s$%.32s", set->ln, set->name);
}

const struct iec61850_set *iec61850_find_set(const struct iec61850_model *model,
					     const struct iec61850_device *device, const uint8_t *name,
					     size_t size)
{
	const struct part part = {name, size};

	for (uint32_t i = 0; i < device->set_count; i++) {
		char own[IEC61850_NAME_SIZE];

		iec61850_set_name(&model->sets[device->first_set + i], own);
		if (is(&part, own))
			return &model->sets[device->first_set + i];
	}
	return NULL;
}

struct iec61850_object iec61850_member(const struct iec61850_model *model, const struct iec61850_set *set,
				       uint32_t member)
{
	struct iec61850_object object = iec61850_object_of(model, model->members[set->first + member]);

	object.node = model->nodes[set->first + member];
	return object;
}

/* From this member on, of those of the same point. */
static uint32_t member_from(const struct iec61850_model *model, uint32_t member, uint32_t set)
{
	while (member != IEC61850_NO_MEMBER && !iec61850_set_has(model, set, member))
		member = iec61850_earlier(model, member);
	return member;
}

uint32_t iec61850_last_member(const struct iec61850_model *model, uint32_t point, uint32_t set)
{
	return member_from(model, model->places[point].member, set);
}

uint32_t iec61850_member_before(const struct iec61850_model *model, uint32_t member, uint32_t set)
{
	return member_from(model, iec61850_earlier(model, member), set);
}
