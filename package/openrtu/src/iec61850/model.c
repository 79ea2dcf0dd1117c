/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/model.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "map/type.h"

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
						    {"GI", IEC61850_GI, NULL, 0}};
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
						      {"TimeofEntry", IEC61850_TIME_OF_ENTRY, NULL, 0}};

static const struct {
	const char *name;
	enum iec61850_fc fc;
} sets[IEC61850_SETS] = {
    [IEC61850_STATUS] = {"LLN0$status", IEC61850_ST}, [IEC61850_MEASURED] = {"LLN0$measured", IEC61850_MX}};

static const char *const block_names[IEC61850_BLOCKS] = {"urcbStatus01",   "urcbStatus02",  "urcbMeasured01",
							 "urcbMeasured02", "brcbStatus01",  "brcbStatus02",
							 "brcbMeasured01", "brcbMeasured02"};
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

/* What GGIO has for a point. Without a command an xxC shows its status only. */
static struct what default_of(const struct map_point *point)
{
	const bool command = (point->flags & MAP_POINT_COMMAND) != 0;

	switch ((enum map_type)point->type) {
	case MAP_SINGLE:
		return command ? (struct what){"SPCSO", IEC61850_SPC, 0, point->ioa}
			       : (struct what){"Ind", IEC61850_SPS, 0, point->ioa};
	case MAP_DOUBLE:
		return (struct what){"DPCSO", IEC61850_DPC, 0, point->ioa};
	case MAP_STEP:
	case MAP_BITSTRING:
	case MAP_INTEGER:
		return command ? (struct what){"ISCSO", IEC61850_INC, 0, point->ioa}
			       : (struct what){"IntIn", IEC61850_INS, 0, point->ioa};
	case MAP_NORMALIZED:
	case MAP_SCALED:
	case MAP_FLOAT:
	case MAP_ANGLE:
		return command ? (struct what){"AnOut", IEC61850_APC, 0, point->ioa}
			       : (struct what){"AnIn", IEC61850_MV, 0, point->ioa};
	case MAP_COUNTER:
		break;
	}
	return (struct what){"CntVal", IEC61850_BCR, 0, point->ioa};
}

static struct what data_of(const struct iec61850_ln_class *class, unsigned number)
{
	const struct iec61850_data *data = &class->data[number];

	return (struct what){data->name, (enum iec61850_cdc)data->cdc,
			     (enum iec61850_enumeration)data->enumeration, 0};
}

static struct what what_of_point(const struct iec61850_model *model, uint32_t point)
{
	const struct iec61850_assignment *assigned = model->assigned[point];
	struct what what;

	if (assigned == NULL)
		return default_of(&model->config->points[point]);
	what = data_of(&iec61850_ln_classes[assigned->class], assigned->data);
	what.number = assigned->number;
	return what;
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
	const uint32_t fixed = device->lns[ln].fixed;

	return ln == IEC61850_LLN0 && number >= fixed && number - fixed < IEC61850_BLOCKS
		   ? &device->blocks[number - fixed]
		   : NULL;
}

uint32_t iec61850_object_count(const struct iec61850_device *device, uint32_t ln)
{
	return device->lns[ln].fixed + device->lns[ln].count + (ln == IEC61850_LLN0 ? IEC61850_BLOCKS : 0);
}

static bool is_buffered(const struct iec61850_device *device, const struct iec61850_block *block)
{
	return block - device->blocks >= IEC61850_UNBUFFERED;
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

static struct iec61850_nodes nodes_of_block(const struct iec61850_model *model,
					    const struct iec61850_device *device,
					    const struct iec61850_block *block, enum iec61850_fc fc)
{
	const bool buffered = is_buffered(device, block);

	if (fc != (buffered ? IEC61850_BR : IEC61850_RP) ||
	    device->members[iec61850_set_of(device, block)] == 0 ||
	    (buffered && device - model->devices >= IEC61850_KEPT_DEVICES))
		return (struct iec61850_nodes){0};
	return buffered ? (struct iec61850_nodes)NODES(buffered_block)
			: (struct iec61850_nodes)NODES(report_block);
}

struct iec61850_nodes iec61850_nodes_of(const struct iec61850_model *model,
					const struct iec61850_device *device, uint32_t ln, uint32_t number,
					enum iec61850_fc fc)
{
	const struct iec61850_block *block = iec61850_block_of(device, ln, number);
	const struct iec61850_object object = {.device = device, .ln = ln, .number = number};
	uint32_t point;
	enum iec61850_cdc cdc;

	if (block != NULL)
		return nodes_of_block(model, device, block, fc);
	cdc = what_of(model, &object).cdc;
	if (fc != IEC61850_CO)
		return iec61850_cdc_nodes(cdc, fc);
	point = iec61850_point_of(model, &object);
	if (point == MAP_NONE)
		return (struct iec61850_nodes){0};
	return iec61850_cdc_services(cdc, iec61850_ctl_model(model, point));
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
	const struct iec61850_nodes settings = iec61850_cdc_nodes(what.cdc, IEC61850_CF);

	return (struct iec61850_class){
	    .name = iec61850_cdc_names[what.cdc],
	    .enumeration = what.enumeration,
	    .controllable = settings.count > 0 && settings.nodes->leaf == IEC61850_CTL_MODEL,
	    .control = point == MAP_NONE ? IEC61850_STATUS_ONLY : iec61850_ctl_model(model, point)};
}

struct iec61850_object iec61850_object_of(const struct iec61850_model *model, uint32_t point)
{
	const struct iec61850_place *place = &model->places[point];

	return (struct iec61850_object){.device = &model->devices[place->device],
					.ln = place->ln,
					.fc = sets[place->set].fc,
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

const struct iec61850_device *iec61850_find_device(const struct iec61850_model *model, const uint8_t *name,
						   size_t size)
{
	for (uint32_t i = 0; i < model->device_count; i++) {
		char text[IEC61850_NAME_SIZE];

		iec61850_device_name(model, &model->devices[i], text);
		if (strlen(text) == size && memcmp(text, name, size) == 0)
			return &model->devices[i];
	}
	return NULL;
}

void iec61850_object_name(const struct iec61850_model *model, const struct iec61850_object *object,
			  char out[IEC61850_NAME_SIZE])
{
	const struct iec61850_ln *ln = ln_of(object);
	char own[IEC61850_NAME_SIZE];

	if (object->fc == IEC61850_WHOLE) {
		snprintf(out, IEC61850_NAME_SIZE, "%s", ln->name);
		return;
	}
	if (object->number == IEC61850_WHOLE) {
		snprintf(out, IEC61850_NAME_SIZE, "%s$%s", ln->name, fc_names[object->fc]);
		return;
	}
	if (iec61850_block_of(object->device, object->ln, object->number) != NULL) {
		snprintf(own, sizeof(own), "%s", block_names[object->number - ln->fixed]);
	} else {
		const struct what what = what_of(model, object);

		print_what(&what, own);
	}
	snprintf(out, IEC61850_NAME_SIZE, "%s$%s$%.30s", ln->name, fc_names[object->fc], own);
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

	for (uint32_t i = 0; out->ln == IEC61850_LLN0 && i < IEC61850_BLOCKS; i++)
		if (is(name, block_names[i])) {
			out->number = ln->fixed + i;
			return true;
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

static bool find_fc(const struct iec61850_model *model, const struct part *name, struct iec61850_object *out)
{
	for (uint32_t i = 0; i < IEC61850_FCS; i++)
		if (is(name, fc_names[i])) {
			out->fc = i;
			return iec61850_has(model, out->device, out->ln, (enum iec61850_fc)i);
		}
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
	if (!find_fc(model, &part, out))
		return false;
	if (!next_part(&rest, &part))
		return true;
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

struct iec61850_object iec61850_block_object(const struct iec61850_device *device, uint32_t block)
{
	return (struct iec61850_object){.device = device,
					.ln = IEC61850_LLN0,
					.fc = block < IEC61850_UNBUFFERED ? IEC61850_RP : IEC61850_BR,
					.number = device->lns[IEC61850_LLN0].fixed + block};
}

/* ---- data sets --------------------------------------------------------------------------- */

uint32_t iec61850_conf_rev(const struct iec61850_device *device, const struct iec61850_block *block)
{
	return device->revisions[iec61850_set_of(device, block)];
}

const char *iec61850_set_name(enum iec61850_set set)
{
	return sets[set].name;
}

enum iec61850_set iec61850_find_set(const struct iec61850_device *device, const uint8_t *name, size_t size)
{
	const struct part part = {name, size};

	for (unsigned i = 0; i < IEC61850_SETS; i++)
		if (is(&part, sets[i].name) && device->members[i] > 0)
			return (enum iec61850_set)i;
	return IEC61850_SETS;
}

struct iec61850_object iec61850_before_first(const struct iec61850_device *device, enum iec61850_set set)
{
	return (struct iec61850_object){.device = device,
					.ln = IEC61850_LNS_FIXED,
					.fc = sets[set].fc,
					.number = device->lns[IEC61850_LNS_FIXED].fixed - 1};
}

struct iec61850_object iec61850_behind_last(const struct iec61850_device *device, enum iec61850_set set)
{
	const uint32_t last = device->ln_count - 1;

	return (struct iec61850_object){
	    .device = device, .ln = last, .fc = sets[set].fc, .number = iec61850_object_count(device, last)};
}

/* Of a point's data object. */
static bool is_member(const struct iec61850_model *model, const struct iec61850_object *object)
{
	return iec61850_nodes_of(model, object->device, object->ln, object->number,
				 (enum iec61850_fc)object->fc)
		   .count > 0;
}

bool iec61850_next_member(const struct iec61850_model *model, struct iec61850_object *object)
{
	const struct iec61850_device *device = object->device;

	for (;;) {
		while (++object->number < iec61850_object_count(device, object->ln))
			if (is_member(model, object))
				return true;
		if (object->ln + 1 == device->ln_count)
			return false;
		object->number = device->lns[++object->ln].fixed - 1;
	}
}

bool iec61850_member_before(const struct iec61850_model *model, struct iec61850_object *object)
{
	for (;;) {
		while (object->number-- > ln_of(object)->fixed)
			if (is_member(model, object))
				return true;
		if (object->ln == IEC61850_LNS_FIXED)
			return false;
		object->number = iec61850_object_count(object->device, --object->ln);
	}
}

/* ---- begin, end -------------------------------------------------------------------------- */

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

/* FNV-1a */
#define HASH_BASIS 2166136261u
static uint32_t hash_of(uint32_t hash, const void *octets, size_t size)
{
	for (size_t i = 0; i < size; i++)
		hash = (hash ^ ((const uint8_t *)octets)[i]) * 16777619u;
	return hash;
}

/* A member is what its name is, and what stands under it. */
static uint32_t hash_member(const struct iec61850_model *model, const struct iec61850_object *object,
			    uint32_t hash)
{
	const char *const class = iec61850_class_of(model, object).name;
	char name[IEC61850_NAME_SIZE];

	iec61850_object_name(model, object, name);
	return hash_of(hash_of(hash, name, strlen(name)), class, strlen(class));
}

/* A control block has a reason for each member of its data set. */
static void make_blocks(struct iec61850_model *model)
{
	uint8_t *reasons = model->reasons;

	for (uint32_t i = 0; i < model->device_count; i++) {
		struct iec61850_device *device = &model->devices[i];

		device->blocks = &model->blocks[i * IEC61850_BLOCKS];
		for (unsigned set = 0; set < IEC61850_SETS; set++) {
			struct iec61850_object object = iec61850_before_first(device, (enum iec61850_set)set);
			uint32_t hash = HASH_BASIS;

			while (iec61850_next_member(model, &object)) {
				model->places[iec61850_point_of(model, &object)] = (struct iec61850_place){
				    i, device->members[set]++, object.ln, object.number, (uint8_t)set};
				hash = hash_member(model, &object, hash);
			}
			device->revisions[set] = hash == 0 ? 1 : hash; /* 0 would be: not configured */
		}
		for (unsigned j = 0; j < IEC61850_BLOCKS; j++) {
			struct iec61850_block *block = &device->blocks[j];

			block->reasons = reasons;
			reasons += device->members[iec61850_set_of(device, block)];
		}
	}
}

static uint32_t hash_assignment(uint32_t hash, const struct iec61850_assignment *assigned)
{
	const uint32_t words[] = {assigned->class, assigned->data, assigned->number};

	return hash_of(hash_of(hash, assigned->ln, strlen(assigned->ln)), words, sizeof(words));
}

/* What the model is made of. */
static uint32_t number_of_configuration(const struct iec61850_model *model)
{
	uint32_t hash = HASH_BASIS;

	for (uint32_t i = 0; i < model->config->point_count; i++) {
		const struct map_point *point = &model->config->points[model->points[i]];
		const uint32_t words[] = {ca_of(model->config, model->points[i]), point->ioa, point->type,
					  point->flags};

		hash = hash_of(hash, words, sizeof(words));
		if (model->assigned[model->points[i]] != NULL)
			hash = hash_assignment(hash, model->assigned[model->points[i]]);
	}
	return hash;
}

bool iec61850_model_begin(struct iec61850_model *model, const struct map *map)
{
	const bool begun = iec61850_model_of(model, map_config(map));

	model->map = map;
	model->started_ns = map_now_ns();
	return begun;
}

bool iec61850_model_of(struct iec61850_model *model, const struct map_config *config)
{
	*model = (struct iec61850_model){.config = config,
					 .settings = iec61850_settings(config),
					 .points = calloc(config->point_count + 1, sizeof(*model->points)),
					 .devices = calloc(config->set_count + 1, sizeof(*model->devices))};
	model->blocks = calloc((size_t)config->set_count * IEC61850_BLOCKS + 1, sizeof(*model->blocks));
	/* A point is a member of one data set at most. */
	model->reasons = calloc((size_t)config->point_count * IEC61850_BLOCKS / IEC61850_SETS + 1, 1);
	model->places = calloc(config->point_count + 1, sizeof(*model->places));
	model->image = calloc(config->point_count + 1, sizeof(*model->image));
	model->assigned = calloc(config->point_count + 1, sizeof(*model->assigned));
	/* Each device has GGIO1 at most besides those of the configuration. */
	model->lns = calloc((size_t)config->set_count * (IEC61850_LNS_FIXED + 1) +
				map_record_count(config, IEC61850_ASSIGNMENTS) + 1,
			    sizeof(*model->lns));
	if (model->points == NULL || model->devices == NULL || model->blocks == NULL ||
	    model->reasons == NULL || model->places == NULL || model->image == NULL ||
	    model->assigned == NULL || model->lns == NULL)
		return false;
	for (uint32_t i = 0; i < config->point_count; i++)
		model->points[i] = i;
	for (uint32_t i = 0; i < map_record_count(config, IEC61850_ASSIGNMENTS); i++)
		model->assigned[iec61850_assignments(config)[i].point] = &iec61850_assignments(config)[i];
	qsort_r(model->points, config->point_count, sizeof(*model->points), by_address, model);
	make_devices(model);
	make_blocks(model);
	model->revision = number_of_configuration(model);
	return true;
}

void iec61850_model_end(struct iec61850_model *model)
{
	free(model->points);
	free(model->devices);
	free(model->blocks);
	free(model->reasons);
	free(model->places);
	free(model->image);
	free(model->assigned);
	free(model->lns);
}
