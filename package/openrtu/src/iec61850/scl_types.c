/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The types in an SCL file: each once, however many objects have it. */
#include <stdlib.h>
#include <string.h>

#include "iec61850/leaf.h"
#include "iec61850/scl_parts.h"
#include "iec61850/value.h"
#include "map/type.h"

#define ID_SIZE      256 /* tAnyName */
#define COUNT(array) ((unsigned)(sizeof(array) / sizeof((array)[0])))

static const struct {
	const char *name;
	const char *values[12]; /* from the first number on */
	int first;
} enumerations[IEC61850_ENUMERATIONS] = {
    [IEC61850_BEHAVIOUR_KIND] = {"BehaviourModeKind", {"on", "blocked", "test", "test/blocked", "off"}, 1},
    [IEC61850_HEALTH_KIND] = {"HealthKind", {"Ok", "Warning", "Alarm"}, 1},
    [IEC61850_SWITCH_KIND] = {"SwitchFunctionKind",
			      {"Load Break", "Disconnector", "Earthing Switch", "High Speed Earthing Switch"},
			      1},
    [IEC61850_RECLOSING_KIND] = {"AutoReclosingKind",
				 {"Ready", "InProgress", "Successful", "WaitingForTrip", "TripFromProtection",
				  "FaultDisappeared", "WaitToComplete", "CBclosed", "CycleUnsuccessful",
				  "Unsuccessful", "Aborted", "NotReady"},
				 1},
    [IEC61850_CAPABILITY_KIND] = {"SwitchingCapabilityKind",
				  {"None", "Open", "Close-Open", "Open-Close-Open", "Close-Open-Close-Open",
				   "Open-Close-Open-Close-Open", "more"},
				  1},
    [IEC61850_ON_WAVE_KIND] = {"POWCapKind", {"None", "Close", "Open", "Close and Open"}, 1},
    [IEC61850_DIRECTION_KIND] = {"FaultDirectionKind", {"unknown", "forward", "backward", "both"}, 0},
    [IEC61850_CTL_MODEL_KIND] = {"CtlModelKind",
				 {"status-only", "direct-with-normal-security", "sbo-with-normal-security",
				  "direct-with-enhanced-security", "sbo-with-enhanced-security"},
				 0},
    [IEC61850_ORIGINATOR_KIND] = {"OriginatorCategoryKind",
				  {"not-supported", "bay-control", "station-control", "remote-control",
				   "automatic-bay", "automatic-station", "automatic-remote", "maintenance",
				   "process"},
				  0},
    [IEC61850_RANGE_KIND] = {"RangeKind", {"normal", "high", "low", "high-high", "low-low"}, 0},
    [IEC61850_SI_UNIT_KIND] = {"SIUnitKind", {NULL}, 0},
    [IEC61850_MULTIPLIER_KIND] = {"MultiplierKind", {NULL}, 0},
};

/* What a number means. NULL: there is no such number. */
static const char *literal(unsigned kind, int number)
{
	const int place = number - enumerations[kind].first;

	if (kind == IEC61850_SI_UNIT_KIND)
		return iec61850_si_unit_name(number);
	if (kind == IEC61850_MULTIPLIER_KIND)
		return iec61850_multiplier_name(number);
	return place >= 0 && place < (int)COUNT(enumerations[kind].values) ? enumerations[kind].values[place]
									   : NULL;
}

/* The name of a data object's type: its class, and what of it is another one in some. */
static void type_id(const struct iec61850_class *class, char out[ID_SIZE])
{
	snprintf(out, ID_SIZE, "%s", class->name);
	if (class->enumeration != IEC61850_NO_ENUMERATION)
		snprintf(out, ID_SIZE, "%s_%s", class->name, enumerations[class->enumeration].name);
	else if (class->controllable)
		snprintf(out, ID_SIZE, "%s_%s", class->name,
			 literal(IEC61850_CTL_MODEL_KIND, (int)class->control));
	snprintf(out + strlen(out), ID_SIZE - strlen(out), "%s%s%s", class->has_limits ? "_limits" : "",
		 class->has_unit ? "_units" : "", class->has_range ? "_range" : "");
}

/* An attribute's enumeration. orCat is the other one but stVal. */
static enum iec61850_enumeration enumeration_of(const struct iec61850_node *node,
						const struct iec61850_class *class)
{
	if (node->leaf == IEC61850_CTL_MODEL)
		return IEC61850_CTL_MODEL_KIND;
	if (node->leaf == IEC61850_DIRECTION)
		return IEC61850_DIRECTION_KIND;
	if (node->leaf == IEC61850_RANGE)
		return IEC61850_RANGE_KIND;
	if (node->leaf == IEC61850_SI_UNIT)
		return IEC61850_SI_UNIT_KIND;
	if (node->leaf == IEC61850_MULTIPLIER)
		return IEC61850_MULTIPLIER_KIND;
	return strcmp(node->name, "orCat") == 0 ? IEC61850_ORIGINATOR_KIND : class->enumeration;
}

/* What is the same for all objects of the type. */
static const char *constant_of(const struct iec61850_scl *scl, const struct iec61850_node *node,
			       const struct iec61850_class *class, char number[IEC61850_SCL_TEXT_SIZE])
{
	const struct map_settings *settings = &scl->model->config->settings;

	switch (node->leaf) {
	case IEC61850_CTL_MODEL:
		return literal(IEC61850_CTL_MODEL_KIND, (int)class->control);
	case IEC61850_VENDOR:
		return "OpenRTU";
	case IEC61850_REVISION:
		return OPENRTU_VERSION;
	case IEC61850_NAME_SPACE:
		return IEC61850_DATA_NAME_SPACE;
	case IEC61850_UNIT:
		return "1";
	case IEC61850_DEADBAND:
		return "100000"; /* IEC61850_DEADBAND_WHOLE */
	case IEC61850_SBO_TIMEOUT:
		snprintf(number, IEC61850_SCL_TEXT_SIZE, "%lld", settings->select_timeout_s * MS_PER_S);
		return number;
	case IEC61850_OPER_TIMEOUT:
		snprintf(number, IEC61850_SCL_TEXT_SIZE, "%lld", settings->command_timeout_s * MS_PER_S);
		return number;
	default:
		return NULL;
	}
}

/* element: DA or BDA, with those of its attributes that are not of all. */
static void put_attribute(const struct iec61850_scl *scl, const char *element, const char *more,
			  const struct iec61850_node *node, const struct iec61850_class *class,
			  const char *in)
{
	char number[IEC61850_SCL_TEXT_SIZE];
	const char *const basic = iec61850_leaf_types[node->leaf].basic;
	const char *const constant = constant_of(scl, node, class, number);

	fprintf(scl->out, "   <%s name=\"%s\"%s bType=\"%s\"", element, node->name, more, basic);
	if (node->count > 0)
		fprintf(scl->out, " type=\"%s_%s\"", in, node->name);
	else if (strcmp(basic, "Enum") == 0)
		fprintf(scl->out, " type=\"%s\"", enumerations[enumeration_of(node, class)].name);
	if (constant == NULL)
		fputs("/>\n", scl->out);
	else
		fprintf(scl->out, "><Val>%s</Val></%s>\n", constant, element);
}

/* The types of structures in a type, each of which is named as its place. */
static void put_structures(const struct iec61850_scl *scl, struct iec61850_nodes inside,
			   const struct iec61850_class *class, const char *in)
{
	for (unsigned i = 0; i < inside.count; i++) {
		const struct iec61850_node *node = &inside.nodes[i];
		const struct iec61850_nodes children = {node->children, node->count};
		char id[ID_SIZE];

		if (node->count == 0)
			continue;
		snprintf(id, sizeof(id), "%.200s_%s", in, node->name);
		iec61850_scl_line(scl, 2, "<DAType id=\"%s\">", id);
		for (unsigned j = 0; j < children.count; j++)
			put_attribute(scl, "BDA", "", &children.nodes[j], class, id);
		iec61850_scl_line(scl, 2, "</DAType>");
		put_structures(scl, children, class, id);
	}
}

/* The triggers of an attribute, as the tables of IEC 61850-7-3 have them: of all its values, numbers and structures are updated, too. */
static const char *triggers_of(enum iec61850_fc fc, enum iec61850_leaf leaf)
{
	if (fc == IEC61850_CF)
		return " dchg=\"true\"";
	if ((fc != IEC61850_ST && fc != IEC61850_MX) || leaf == IEC61850_TIME)
		return "";
	if (leaf == IEC61850_QUALITY)
		return " qchg=\"true\"";
	return leaf == IEC61850_ENUM || leaf == IEC61850_INTEGER || leaf == IEC61850_STRUCTURE
		   ? " dchg=\"true\" dupd=\"true\""
		   : " dchg=\"true\"";
}

static void put_type(const struct iec61850_scl *scl, const struct iec61850_object *object)
{
	const struct iec61850_class class = iec61850_class_of(scl->model, object);
	char id[ID_SIZE], more[64];

	type_id(&class, id);
	iec61850_scl_line(scl, 2, "<DOType id=\"%s\" cdc=\"%s\">", id, class.name);
	for (unsigned fc = 0; fc < IEC61850_FCS; fc++) {
		const struct iec61850_nodes inside = iec61850_scl_inside(scl, object, fc);

		for (unsigned i = 0; i < inside.count; i++) {
			snprintf(more, sizeof(more), " fc=\"%s\"%s", iec61850_fc_name(fc),
				 triggers_of((enum iec61850_fc)fc, inside.nodes[i].leaf));
			put_attribute(scl, "DA", more, &inside.nodes[i], &class, id);
		}
	}
	iec61850_scl_line(scl, 2, "</DOType>");
}

static void put_type_structures(const struct iec61850_scl *scl, const struct iec61850_object *object)
{
	const struct iec61850_class class = iec61850_class_of(scl->model, object);
	char id[ID_SIZE];

	type_id(&class, id);
	for (unsigned fc = 0; fc < IEC61850_FCS; fc++)
		put_structures(scl, iec61850_scl_inside(scl, object, fc), &class, id);
}

/* An object of each type that the model has. */
#define TYPES_MAX 128
struct types {
	struct iec61850_object objects[TYPES_MAX];
	unsigned count;
};

static void note_type(const struct iec61850_scl *scl, struct types *types,
		      const struct iec61850_object *object)
{
	const struct iec61850_class class = iec61850_class_of(scl->model, object);
	char id[ID_SIZE], other[ID_SIZE];

	type_id(&class, id);
	for (unsigned i = 0; i < types->count; i++) {
		const struct iec61850_class of = iec61850_class_of(scl->model, &types->objects[i]);

		type_id(&of, other);
		if (strcmp(id, other) == 0)
			return;
	}
	if (types->count == TYPES_MAX)
		abort(); /* the classes, with all that is another one in them, outgrew TYPES_MAX */
	types->objects[types->count++] = *object;
}

static void put_ln_type(const struct iec61850_scl *scl, struct iec61850_object object, struct types *types)
{
	const struct iec61850_ln_name ln = iec61850_scl_ln_name(&object);
	char id[ID_SIZE], name[IEC61850_NAME_SIZE];

	fputs("  <LNodeType id=\"", scl->out);
	iec61850_scl_put_ln_type(scl, &object);
	fprintf(scl->out, "\" lnClass=\"%s\">\n", ln.class);
	for (; iec61850_scl_is_object(&object); object.number++) {
		const struct iec61850_class class = iec61850_class_of(scl->model, &object);

		type_id(&class, id);
		iec61850_scl_do_name(scl, &object, name);
		iec61850_scl_line(scl, 3, "<DO name=\"%s\" type=\"%s\"/>", name, id);
		note_type(scl, types, &object);
	}
	iec61850_scl_line(scl, 2, "</LNodeType>");
}

static void put_enumerations(const struct iec61850_scl *scl)
{
	for (unsigned i = IEC61850_NO_ENUMERATION + 1; i < IEC61850_ENUMERATIONS; i++) {
		iec61850_scl_line(scl, 2, "<EnumType id=\"%s\">", enumerations[i].name);
		for (int number = IEC61850_EXPONENT_MIN; number <= IEC61850_SI_UNIT_MAX; number++)
			if (literal(i, number) != NULL)
				iec61850_scl_line(scl, 3, "<EnumVal ord=\"%d\">%s</EnumVal>", number,
						  literal(i, number));
		iec61850_scl_line(scl, 2, "</EnumType>");
	}
}

void iec61850_scl_put_types(const struct iec61850_scl *scl)
{
	struct types types = {.count = 0};

	iec61850_scl_line(scl, 1, "<DataTypeTemplates>");
	for (uint32_t i = 0; i < scl->model->device_count; i++)
		for (unsigned ln = 0; ln < scl->model->devices[i].ln_count; ln++)
			put_ln_type(scl, iec61850_scl_first(&scl->model->devices[i], ln), &types);
	for (unsigned i = 0; i < types.count; i++)
		put_type(scl, &types.objects[i]);
	for (unsigned i = 0; i < types.count; i++)
		put_type_structures(scl, &types.objects[i]);
	put_enumerations(scl);
	iec61850_scl_line(scl, 1, "</DataTypeTemplates>");
}
