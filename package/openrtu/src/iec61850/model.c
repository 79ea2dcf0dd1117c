/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/model.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "map/type.h"

#define COUNT(array) ((unsigned)(sizeof(array) / sizeof((array)[0])))

/* ---- common data classes (IEC 61850-7-3) ------------------------------------------------- */

static const struct iec61850_node analogue[] = {{"f", IEC61850_FLOAT, NULL, 0}};

#define STATUS(name, leaf)                                                                                   \
	static const struct iec61850_node name[] = {                                                         \
	    {"stVal", leaf, NULL, 0}, {"q", IEC61850_QUALITY, NULL, 0}, {"t", IEC61850_TIME, NULL, 0}}
#define MEASURED(name, value)                                                                                \
	static const struct iec61850_node name[] = {{value, IEC61850_STRUCTURE, analogue, COUNT(analogue)},  \
						    {"q", IEC61850_QUALITY, NULL, 0},                        \
						    {"t", IEC61850_TIME, NULL, 0}}

STATUS(sps, IEC61850_BOOLEAN);
STATUS(dps, IEC61850_DOUBLE);
STATUS(ins, IEC61850_INTEGER);
STATUS(ens, IEC61850_ENUM);
MEASURED(mv, "mag");
MEASURED(apc, "mxVal");
static const struct iec61850_node bcr[] = {
    {"actVal", IEC61850_TOTAL, NULL, 0}, {"q", IEC61850_QUALITY, NULL, 0}, {"t", IEC61850_TIME, NULL, 0}};
static const struct iec61850_node described[] = {{"d", IEC61850_DESCRIPTION, NULL, 0}};
static const struct iec61850_node controlled[] = {{"ctlModel", IEC61850_CTL_MODEL, NULL, 0}};

/* The services of a command (8-1, 20.5 and annex E): which there are, the model says. */
static const struct iec61850_node origin[] = {{"orCat", IEC61850_ENUM, NULL, 0},
					      {"orIdent", IEC61850_OR_IDENT, NULL, 0}};
#define SERVICE(name, leaf, children)                                                                        \
	{                                                                                                    \
		name, leaf, children, COUNT(children)                                                        \
	}
#define CANCELLING(...)                                                                                      \
	{__VA_ARGS__}, {"origin", IEC61850_STRUCTURE, origin, COUNT(origin)},                                \
	    {"ctlNum", IEC61850_CTL_NUM, NULL, 0}, {"T", IEC61850_TIME, NULL, 0},                            \
	{                                                                                                    \
		"Test", IEC61850_BOOLEAN, NULL, 0                                                            \
	}
#define OPERATING(...)                                                                                       \
	CANCELLING(__VA_ARGS__),                                                                             \
	{                                                                                                    \
		"Check", IEC61850_CHECK, NULL, 0                                                             \
	}
#define CONTROLS(value, ...)                                                                                 \
	static const struct iec61850_node value##_operate[] = {OPERATING(__VA_ARGS__)};                      \
	static const struct iec61850_node value##_cancel[] = {CANCELLING(__VA_ARGS__)};                      \
	static const struct iec61850_node value##_direct[] = {                                               \
	    SERVICE("Oper", IEC61850_OPER, value##_operate)};                                                \
	static const struct iec61850_node value##_sbo[] = {                                                  \
	    {"SBO", IEC61850_SBO, NULL, 0},                                                                  \
	    SERVICE("Oper", IEC61850_OPER, value##_operate),                                                 \
	    SERVICE("Cancel", IEC61850_CANCEL, value##_cancel)};                                             \
	static const struct iec61850_node value##_sbow[] = {                                                 \
	    SERVICE("SBOw", IEC61850_SBOW, value##_operate),                                                 \
	    SERVICE("Oper", IEC61850_OPER, value##_operate),                                                 \
	    SERVICE("Cancel", IEC61850_CANCEL, value##_cancel)}

CONTROLS(binary, "ctlVal", IEC61850_BOOLEAN, NULL, 0);
CONTROLS(integer, "ctlVal", IEC61850_INTEGER, NULL, 0);
CONTROLS(set_point, "ctlVal", IEC61850_STRUCTURE, analogue, COUNT(analogue));
static const struct iec61850_node pulses[] = {{"pulsQty", IEC61850_UNIT, NULL, 0}};
static const struct iec61850_node plate[] = {{"vendor", IEC61850_VENDOR, NULL, 0},
					     {"swRev", IEC61850_REVISION, NULL, 0},
					     {"d", IEC61850_DESCRIPTION, NULL, 0},
					     {"configRev", IEC61850_CONFIGURATION, NULL, 0}};
static const struct iec61850_node name_space[] = {{"ldNs", IEC61850_NAME_SPACE, NULL, 0}};
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
static const struct iec61850_node physical_plate[] = {{"vendor", IEC61850_VENDOR, NULL, 0}};

enum cdc { SPS, INS, ENS, ENC, MV, BCR, SPC, DPC, INC, APC, LPL, DPL, CDCS };
static const char *const cdc_names[CDCS] = {"SPS", "INS", "ENS", "ENC", "MV",  "BCR",
					    "SPC", "DPC", "INC", "APC", "LPL", "DPL"};

#define NODES(nodes)                                                                                         \
	{                                                                                                    \
		nodes, COUNT(nodes)                                                                          \
	}
static const struct iec61850_nodes classes[CDCS][IEC61850_FCS] = {
    [SPS] = {[IEC61850_ST] = NODES(sps), [IEC61850_DC] = NODES(described)},
    [INS] = {[IEC61850_ST] = NODES(ins), [IEC61850_DC] = NODES(described)},
    [ENS] = {[IEC61850_ST] = NODES(ens)},
    [ENC] = {[IEC61850_ST] = NODES(ens), [IEC61850_CF] = NODES(controlled)},
    [MV] = {[IEC61850_MX] = NODES(mv), [IEC61850_DC] = NODES(described)},
    [BCR] = {[IEC61850_ST] = NODES(bcr), [IEC61850_CF] = NODES(pulses), [IEC61850_DC] = NODES(described)},
    [SPC] = {[IEC61850_ST] = NODES(sps), [IEC61850_CF] = NODES(controlled), [IEC61850_DC] = NODES(described)},
    [DPC] = {[IEC61850_ST] = NODES(dps), [IEC61850_CF] = NODES(controlled), [IEC61850_DC] = NODES(described)},
    [INC] = {[IEC61850_ST] = NODES(ins), [IEC61850_CF] = NODES(controlled), [IEC61850_DC] = NODES(described)},
    [APC] = {[IEC61850_MX] = NODES(apc), [IEC61850_CF] = NODES(controlled), [IEC61850_DC] = NODES(described)},
    [LPL] = {[IEC61850_DC] = NODES(plate), [IEC61850_EX] = NODES(name_space)},
    [DPL] = {[IEC61850_DC] = NODES(physical_plate)},
};

#define MODELS(value)                                                                                        \
	{                                                                                                    \
		[IEC61850_DIRECT_NORMAL] = NODES(value##_direct),                                            \
		[IEC61850_SBO_NORMAL] = NODES(value##_sbo),                                                  \
		[IEC61850_DIRECT_ENHANCED] = NODES(value##_direct),                                          \
		[IEC61850_SBO_ENHANCED] = NODES(value##_sbow)                                                \
	}
static const struct iec61850_nodes services[CDCS][IEC61850_CTL_MODELS] = {
    [SPC] = MODELS(binary), [DPC] = MODELS(binary), [INC] = MODELS(integer), [APC] = MODELS(set_point)};

/* ---- logical nodes (IEC 61850-7-4) ------------------------------------------------------- */

struct fixed {
	const char *name;
	enum cdc cdc;
	enum iec61850_enumeration enumeration;
};

static const struct fixed lln0[] = {{"Beh", ENS, IEC61850_BEHAVIOUR_KIND},
				    {"Health", ENS, IEC61850_HEALTH_KIND},
				    {"Mod", ENC, IEC61850_BEHAVIOUR_KIND},
				    {"NamPlt", LPL, IEC61850_NO_ENUMERATION}};
static const struct fixed lphd1[] = {{"PhyHealth", ENS, IEC61850_HEALTH_KIND},
				     {"PhyNam", DPL, IEC61850_NO_ENUMERATION},
				     {"Proxy", SPS, IEC61850_NO_ENUMERATION}};
static const struct fixed ggio1[] = {{"Beh", ENS, IEC61850_BEHAVIOUR_KIND}};

static const struct {
	const char *name;
	const struct fixed *fixed; /* what it has beside points */
	unsigned count;
} nodes[IEC61850_LNS] = {[IEC61850_LLN0] = {"LLN0", lln0, COUNT(lln0)},
			 [IEC61850_LPHD1] = {"LPHD1", lphd1, COUNT(lphd1)},
			 [IEC61850_GGIO1] = {"GGIO1", ggio1, COUNT(ggio1)}};

static const struct {
	const char *name;
	enum iec61850_fc fc;
} sets[IEC61850_SETS] = {
    [IEC61850_STATUS] = {"LLN0$status", IEC61850_ST}, [IEC61850_MEASURED] = {"LLN0$measured", IEC61850_MX}};

static const char *const block_names[IEC61850_BLOCKS] = {"urcbStatus01",   "urcbStatus02",  "urcbMeasured01",
							 "urcbMeasured02", "brcbStatus01",  "brcbStatus02",
							 "brcbMeasured01", "brcbMeasured02"};
static const char *const fc_names[IEC61850_FCS] = {"BR", "CF", "CO", "DC", "EX", "MX", "RP", "ST"};

const char *iec61850_ln_name(enum iec61850_ln ln)
{
	return nodes[ln].name;
}

const char *iec61850_fc_name(uint32_t fc)
{
	return fc_names[fc];
}

/* What GGIO has for a point. Without a command an xxC shows its status only. */
static struct fixed kind_of(const struct map_point *point)
{
	const bool command = (point->flags & MAP_POINT_COMMAND) != 0;

	switch ((enum map_type)point->type) {
	case MAP_SINGLE:
		return command ? (struct fixed){"SPCSO", SPC, 0} : (struct fixed){"Ind", SPS, 0};
	case MAP_DOUBLE:
		return (struct fixed){"DPCSO", DPC, 0};
	case MAP_STEP:
	case MAP_BITSTRING:
	case MAP_INTEGER:
		return command ? (struct fixed){"ISCSO", INC, 0} : (struct fixed){"IntIn", INS, 0};
	case MAP_NORMALIZED:
	case MAP_SCALED:
	case MAP_FLOAT:
	case MAP_ANGLE:
		return command ? (struct fixed){"AnOut", APC, 0} : (struct fixed){"AnIn", MV, 0};
	case MAP_COUNTER:
		break;
	}
	return (struct fixed){"CntRs", BCR, 0};
}

static const struct map_point *point_at(const struct iec61850_model *model,
					const struct iec61850_device *device, uint32_t number)
{
	return &model->config->points[model->points[device->first + number - nodes[IEC61850_GGIO1].count]];
}

static bool is_point(enum iec61850_ln ln, uint32_t number)
{
	return ln == IEC61850_GGIO1 && number >= nodes[ln].count;
}

struct iec61850_block *iec61850_block_of(const struct iec61850_device *device, enum iec61850_ln ln,
					 uint32_t number)
{
	return ln == IEC61850_LLN0 && number >= nodes[ln].count ? &device->blocks[number - nodes[ln].count]
								: NULL;
}

uint32_t iec61850_object_count(const struct iec61850_device *device, enum iec61850_ln ln)
{
	switch (ln) {
	case IEC61850_LLN0:
		return nodes[ln].count + IEC61850_BLOCKS;
	case IEC61850_GGIO1:
		return nodes[ln].count + device->count;
	default:
		return nodes[ln].count;
	}
}

static bool is_buffered(const struct iec61850_device *device, const struct iec61850_block *block)
{
	return block - device->blocks >= IEC61850_UNBUFFERED;
}

enum iec61850_ctl_model iec61850_ctl_model(const struct iec61850_model *model, uint32_t point)
{
	const struct iec61850_settings *settings = model->settings;
	const uint8_t flags = model->config->points[point].flags;

	if (settings->controller_count == 0 || !(flags & MAP_POINT_COMMAND))
		return IEC61850_STATUS_ONLY;
	if (flags & MAP_POINT_SELECT)
		return settings->normal_security ? IEC61850_SBO_NORMAL : IEC61850_SBO_ENHANCED;
	return settings->normal_security ? IEC61850_DIRECT_NORMAL : IEC61850_DIRECT_ENHANCED;
}

static struct iec61850_nodes nodes_of_point(const struct iec61850_model *model, uint32_t number,
					    enum iec61850_fc fc)
{
	const enum cdc cdc = kind_of(&model->config->points[number]).cdc;

	return fc == IEC61850_CO ? services[cdc][iec61850_ctl_model(model, number)] : classes[cdc][fc];
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
					const struct iec61850_device *device, enum iec61850_ln ln,
					uint32_t number, enum iec61850_fc fc)
{
	const struct iec61850_block *block = iec61850_block_of(device, ln, number);

	if (block != NULL)
		return nodes_of_block(model, device, block, fc);
	if (is_point(ln, number))
		return nodes_of_point(model, model->points[device->first + number - nodes[ln].count], fc);
	return classes[nodes[ln].fixed[number].cdc][fc];
}

bool iec61850_has(const struct iec61850_model *model, const struct iec61850_device *device,
		  enum iec61850_ln ln, enum iec61850_fc fc)
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
	const struct fixed what = point == MAP_NONE ? nodes[object->ln].fixed[object->number]
						    : kind_of(&model->config->points[point]);

	return (struct iec61850_class){
	    .name = cdc_names[what.cdc],
	    .enumeration = what.enumeration,
	    .controllable = point != MAP_NONE && classes[what.cdc][IEC61850_CF].nodes == controlled,
	    .control = point == MAP_NONE ? IEC61850_STATUS_ONLY : iec61850_ctl_model(model, point)};
}

struct iec61850_object iec61850_object_of(const struct iec61850_model *model, uint32_t point)
{
	const struct iec61850_place *place = &model->places[point];

	return (struct iec61850_object){.device = &model->devices[place->device],
					.ln = IEC61850_GGIO1,
					.fc = sets[place->set].fc,
					.number = place->number};
}

uint32_t iec61850_point_of(const struct iec61850_model *model, const struct iec61850_object *object)
{
	if (!is_point(object->ln, object->number))
		return MAP_NONE;
	return model->points[object->device->first + object->number - nodes[object->ln].count];
}

/* ---- names ------------------------------------------------------------------------------- */

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
	const char *ln = nodes[object->ln].name;

	if (object->fc == IEC61850_WHOLE)
		snprintf(out, IEC61850_NAME_SIZE, "%s", ln);
	else if (object->number == IEC61850_WHOLE)
		snprintf(out, IEC61850_NAME_SIZE, "%s$%s", ln, fc_names[object->fc]);
	else if (iec61850_block_of(object->device, object->ln, object->number) != NULL)
		snprintf(out, IEC61850_NAME_SIZE, "%s$%s$%s", ln, fc_names[object->fc],
			 block_names[object->number - nodes[object->ln].count]);
	else if (!is_point(object->ln, object->number))
		snprintf(out, IEC61850_NAME_SIZE, "%s$%s$%s", ln, fc_names[object->fc],
			 nodes[object->ln].fixed[object->number].name);
	else {
		const struct map_point *point = point_at(model, object->device, object->number);

		snprintf(out, IEC61850_NAME_SIZE, "%s$%s$%s%u", ln, fc_names[object->fc], kind_of(point).name,
			 (unsigned)point->ioa);
	}
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
static bool find_point(const struct iec61850_model *model, const struct iec61850_device *device,
		       const struct part *name, uint32_t *number)
{
	uint32_t ioa = 0, low = 0, high = device->count;
	size_t letters = 0;
	const struct map_point *point;

	while (letters < name->size && (name->text[letters] < '0' || name->text[letters] > '9'))
		letters++;
	if (letters == name->size || name->text[letters] == '0' || name->size - letters > 7)
		return false;
	for (size_t i = letters; i < name->size; i++) {
		if (name->text[i] < '0' || name->text[i] > '9')
			return false;
		ioa = 10 * ioa + (uint32_t)(name->text[i] - '0');
	}
	while (low < high) {
		const uint32_t middle = low + (high - low) / 2;

		if (model->config->points[model->points[device->first + middle]].ioa < ioa)
			low = middle + 1;
		else
			high = middle;
	}
	*number = nodes[IEC61850_GGIO1].count + low;
	if (low == device->count)
		return false;
	point = point_at(model, device, *number);
	return point->ioa == ioa && strlen(kind_of(point).name) == letters &&
	       memcmp(kind_of(point).name, name->text, letters) == 0;
}

static bool find_object(const struct iec61850_model *model, const struct part *name,
			struct iec61850_object *out)
{
	for (uint32_t i = 0; i < nodes[out->ln].count; i++)
		if (is(name, nodes[out->ln].fixed[i].name)) {
			out->number = i;
			return true;
		}
	for (uint32_t i = 0; out->ln == IEC61850_LLN0 && i < IEC61850_BLOCKS; i++)
		if (is(name, block_names[i])) {
			out->number = nodes[out->ln].count + i;
			return true;
		}
	return out->ln == IEC61850_GGIO1 && find_point(model, out->device, name, &out->number);
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
	for (unsigned i = 0; i < IEC61850_LNS; i++)
		if (is(name, nodes[i].name)) {
			out->ln = (enum iec61850_ln)i;
			return true;
		}
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
					.number = nodes[IEC61850_LLN0].count + block};
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
					.ln = IEC61850_GGIO1,
					.fc = sets[set].fc,
					.number = nodes[IEC61850_GGIO1].count - 1};
}

bool iec61850_next_member(const struct iec61850_model *model, struct iec61850_object *object)
{
	const uint32_t count = iec61850_object_count(object->device, object->ln);

	while (++object->number < count)
		if (iec61850_nodes_of(model, object->device, object->ln, object->number,
				      (enum iec61850_fc)object->fc)
			.count > 0)
			return true;
	return false;
}

bool iec61850_member_before(const struct iec61850_model *model, struct iec61850_object *object)
{
	while (object->number-- > nodes[object->ln].count)
		if (iec61850_nodes_of(model, object->device, object->ln, object->number,
				      (enum iec61850_fc)object->fc)
			.count > 0)
			return true;
	return false;
}

/* ---- begin, end -------------------------------------------------------------------------- */

static uint16_t ca_of(const struct map_config *config, uint32_t point)
{
	return config->sets[config->points[point].set].ca;
}

static int by_address(const void *a, const void *b, void *context)
{
	const struct map_config *config = context;
	const uint32_t one = *(const uint32_t *)a, other = *(const uint32_t *)b;
	const uint16_t ca = ca_of(config, one), other_ca = ca_of(config, other);

	if (ca != other_ca)
		return ca < other_ca ? -1 : 1;
	return config->points[one].ioa < config->points[other].ioa ? -1 : 1;
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

static void make_devices(struct iec61850_model *model)
{
	struct iec61850_device *device = NULL;

	for (uint32_t i = 0; i < model->config->point_count; i++) {
		const uint16_t ca = ca_of(model->config, model->points[i]);

		if (device == NULL || device->ca != ca) {
			device = &model->devices[model->device_count++];
			*device = (struct iec61850_device){.ca = ca, .first = i};
		}
		device->count++;
	}
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
				    i, device->members[set]++, object.number, (uint8_t)set};
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

/* What the model is made of. */
static uint32_t number_of_configuration(const struct iec61850_model *model)
{
	uint32_t hash = HASH_BASIS;

	for (uint32_t i = 0; i < model->config->point_count; i++) {
		const struct map_point *point = &model->config->points[model->points[i]];
		const uint32_t words[] = {ca_of(model->config, model->points[i]), point->ioa, point->type,
					  point->flags};

		hash = hash_of(hash, words, sizeof(words));
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
	if (model->points == NULL || model->devices == NULL || model->blocks == NULL ||
	    model->reasons == NULL || model->places == NULL || model->image == NULL)
		return false;
	for (uint32_t i = 0; i < config->point_count; i++)
		model->points[i] = i;
	qsort_r(model->points, config->point_count, sizeof(*model->points), by_address,
		(void *)(uintptr_t)config);
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
}
