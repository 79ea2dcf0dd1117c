/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/scl.h"

#include <arpa/inet.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "iec61850/leaf.h"
#include "iec61850/value.h"
#include "map/address.h"
#include "map/type.h"

#define TEXT_SIZE    (6 * MAP_NAME_SIZE) /* of a name, each character an entity */
#define ID_SIZE      256                 /* tAnyName */
#define LN_NAME_MAX  4                   /* letters of a class */
#define TEMPLATE_IED "TEMPLATE"          /* IEC 61850-6, 9.3.1 */
#define NS_104       "http://www.iec.ch/61850-80-1/2007/IEC_60870-5-104"
#define COUNT(array) ((unsigned)(sizeof(array) / sizeof((array)[0])))

/* ---- text -------------------------------------------------------------------------------- */

/*
 * A line, with a space for each level that it is deep in the tree: clients get the file, so it is kept small. What it is made of
 * needs no escaping, or has it.
 */
__attribute__((format(printf, 3, 4))) static void line(const struct iec61850_scl *scl, int depth,
						       const char *format, ...)
{
	va_list arguments;

	fprintf(scl->out, "%*s", depth, "");
	va_start(arguments, format);
	vfprintf(scl->out, format, arguments);
	va_end(arguments);
	fputc('\n', scl->out);
}

static const char *escaped(const char *text, char out[TEXT_SIZE])
{
	size_t size = 0;

	for (; *text != '\0' && size < TEXT_SIZE - sizeof("&quot;"); text++) {
		const char *entity = *text == '&'   ? "&amp;"
				     : *text == '<' ? "&lt;"
				     : *text == '"' ? "&quot;"
						    : NULL;

		size += (size_t)snprintf(out + size, TEXT_SIZE - size, entity != NULL ? "%s" : "%.1s",
					 entity != NULL ? entity : text);
	}
	out[size] = '\0';
	return out;
}

static const char *yes(bool it_is)
{
	return it_is ? "true" : "false";
}

static const char *ied_of(const struct iec61850_scl *scl)
{
	return scl->configured ? scl->model->settings->ied : TEMPLATE_IED;
}

/* The parts of a logical node's name: Q1XCBR2 is the prefix Q1, the class XCBR and the instance 2. */
struct ln_name {
	char prefix[IEC61850_NAME_SIZE], class[LN_NAME_MAX + 1];
	const char *instance;
};

static struct ln_name parts_of(const struct iec61850_object *object)
{
	const char *name = object->device->lns[object->ln].name;
	struct ln_name parts = {.instance = ""};
	size_t size = strlen(name);

	if (object->ln != IEC61850_LLN0) {
		while (size > LN_NAME_MAX && name[size - 1] >= '0' && name[size - 1] <= '9')
			size--;
		parts.instance = name + size;
	}
	if (object->ln == IEC61850_LLN0)
		size = LN_NAME_MAX;
	snprintf(parts.prefix, sizeof(parts.prefix), "%.*s", (int)(size - LN_NAME_MAX), name);
	snprintf(parts.class, sizeof(parts.class), "%.4s", name + size - LN_NAME_MAX);
	return parts;
}

/* The name of a data object, without what it is in. */
static void do_name(const struct iec61850_scl *scl, const struct iec61850_object *object,
		    char out[IEC61850_NAME_SIZE])
{
	char name[IEC61850_NAME_SIZE];

	iec61850_object_name(scl->model, object, name);
	snprintf(out, IEC61850_NAME_SIZE, "%s", strrchr(name, '$') + 1);
}

/* ---- walks ------------------------------------------------------------------------------- */

static struct iec61850_object first_object(const struct iec61850_device *device, unsigned ln)
{
	return (struct iec61850_object){.device = device, .ln = ln};
}

/* Whether the number is of a data object, not of a control block, nor behind the last. */
static bool is_object(const struct iec61850_object *object)
{
	return object->number < iec61850_object_count(object->device, object->ln) &&
	       iec61850_block_of(object->device, object->ln, object->number) == NULL;
}

static struct iec61850_nodes inside_of(const struct iec61850_scl *scl, const struct iec61850_object *object,
				       unsigned fc)
{
	return iec61850_nodes_of(scl->model, object->device, object->ln, object->number,
				 (enum iec61850_fc)fc);
}

/* ---- communication ----------------------------------------------------------------------- */

static void put_host(const struct iec61850_scl *scl)
{
	const char *text = scl->model->settings->address;
	struct in6_addr address;
	const uint8_t *o = address.s6_addr;

	if (!map_address_parse(text, &address))
		return;
	if (IN6_IS_ADDR_V4MAPPED(&address))
		line(scl, 5, "<P type=\"IP\">%u.%u.%u.%u</P>", o[12], o[13], o[14], o[15]);
	else
		line(scl, 5, "<P type=\"IPv6\">%x:%x:%x:%x:%x:%x:%x:%x</P>", o[0] << 8 | o[1],
		     o[2] << 8 | o[3], o[4] << 8 | o[5], o[6] << 8 | o[7], o[8] << 8 | o[9],
		     o[10] << 8 | o[11], o[12] << 8 | o[13], o[14] << 8 | o[15]);
}

static void put_goose_address(const struct iec61850_scl *scl, const struct iec61850_scl_goose *goose)
{
	const uint8_t *mac = goose->destination;

	line(scl, 4, "<GSE ldInst=\"CA%u\" cbName=\"%s\">", (unsigned)goose->device->ca, goose->name);
	line(scl, 5, "<Address>");
	line(scl, 6, "<P type=\"MAC-Address\">%02X-%02X-%02X-%02X-%02X-%02X</P>", mac[0], mac[1], mac[2],
	     mac[3], mac[4], mac[5]);
	line(scl, 6, "<P type=\"APPID\">%04X</P>", (unsigned)goose->app_id);
	if (goose->tagged) {
		line(scl, 6, "<P type=\"VLAN-ID\">%03X</P>", (unsigned)goose->vlan);
		line(scl, 6, "<P type=\"VLAN-PRIORITY\">%u</P>", goose->vlan_priority);
	}
	line(scl, 5, "</Address>");
	line(scl, 5, "<MinTime unit=\"s\" multiplier=\"m\">%u</MinTime>", goose->least_ms);
	line(scl, 5, "<MaxTime unit=\"s\" multiplier=\"m\">%u</MaxTime>", goose->most_ms);
	line(scl, 4, "</GSE>");
}

static void put_communication(const struct iec61850_scl *scl)
{
	line(scl, 1, "<Communication>");
	line(scl, 2, "<SubNetwork name=\"station\" type=\"8-MMS\">");
	line(scl, 3, "<ConnectedAP iedName=\"%s\" apName=\"AP1\">", ied_of(scl));
	line(scl, 4, "<Address>");
	put_host(scl);
	line(scl, 5, "<P type=\"OSI-TSEL\">0001</P>");
	line(scl, 5, "<P type=\"OSI-SSEL\">0001</P>");
	line(scl, 5, "<P type=\"OSI-PSEL\">00000001</P>");
	line(scl, 5, "<P type=\"MMS-Port\">%u</P>", (unsigned)scl->model->settings->port);
	line(scl, 4, "</Address>");
	for (uint32_t i = 0; i < scl->goose_count; i++)
		put_goose_address(scl, &scl->goose[i]);
	line(scl, 3, "</ConnectedAP>");
	line(scl, 2, "</SubNetwork>");
	line(scl, 1, "</Communication>");
}

/* ---- data sets, control blocks ----------------------------------------------------------- */

/* attribute: of the data object; NULL: all of it under its functional constraint. */
static void put_member(const struct iec61850_scl *scl, const struct iec61850_object *object,
		       const char *attribute)
{
	const struct ln_name ln = parts_of(object);
	char name[IEC61850_NAME_SIZE];

	do_name(scl, object, name);
	fprintf(scl->out, "%*s<FCDA ldInst=\"CA%u\"", 7, "", (unsigned)object->device->ca);
	if (ln.prefix[0] != '\0')
		fprintf(scl->out, " prefix=\"%s\"", ln.prefix);
	fprintf(scl->out, " lnClass=\"%s\" lnInst=\"%s\" doName=\"%s\"", ln.class, ln.instance, name);
	if (attribute != NULL)
		fprintf(scl->out, " daName=\"%s\"", attribute);
	fprintf(scl->out, " fc=\"%s\"/>\n", iec61850_fc_name(object->fc));
}

/* As daName has it: mag.f. NULL: it is all of the data object. */
static const char *attribute_of(const struct iec61850_scl *scl, const struct iec61850_object *object,
				char name[IEC61850_NAME_SIZE])
{
	char whole[IEC61850_NAME_SIZE];

	if (object->node == NULL)
		return NULL;
	iec61850_object_name(scl->model, object, whole);
	iec61850_variable_name(scl->model, object, name);
	for (char *c = name; *c != '\0'; c++)
		if (*c == '$')
			*c = '.';
	return name + strlen(whole) + 1;
}

static void put_set(const struct iec61850_scl *scl, const struct iec61850_set *set)
{
	char name[IEC61850_NAME_SIZE];

	line(scl, 6, "<DataSet name=\"%s\">", set->name);
	for (uint32_t i = 0; i < set->count; i++) {
		const struct iec61850_object object = iec61850_member(scl->model, set, i);

		put_member(scl, &object, attribute_of(scl, &object, name));
	}
	line(scl, 6, "</DataSet>");
}

/* What is read first under the object's functional constraint: stVal, mag.f, ... */
static void put_value_member(const struct iec61850_scl *scl, const struct iec61850_object *object)
{
	const struct iec61850_node *node = inside_of(scl, object, object->fc).nodes;
	char name[IEC61850_NAME_SIZE];

	snprintf(name, sizeof(name), "%s%s%s", node->name, node->count > 0 ? "." : "",
		 node->count > 0 ? node->children->name : "");
	put_member(scl, object, name);
}

static void put_goose_set(const struct iec61850_scl *scl, const struct iec61850_scl_goose *goose)
{
	line(scl, 6, "<DataSet name=\"%s\">", goose->set);
	for (uint32_t i = 0; i < goose->member_count; i++) {
		const struct iec61850_object object = iec61850_object_of(scl->model, goose->members[i]);

		put_value_member(scl, &object);
		if (goose->with_quality)
			put_member(scl, &object, "q");
		if (goose->with_time)
			put_member(scl, &object, "t");
	}
	line(scl, 6, "</DataSet>");
}

static void put_goose_block(const struct iec61850_scl *scl, const struct iec61850_scl_goose *goose)
{
	char id[TEXT_SIZE];

	line(scl, 6, "<GSEControl name=\"%s\" type=\"GOOSE\" datSet=\"%s\" confRev=\"%u\" appID=\"%s\"/>",
	     goose->name, goose->set, goose->conf_rev, escaped(goose->id, id));
}

/* How many control blocks are this one with another index. */
static unsigned instances(const struct iec61850_device *device, const struct iec61850_block *first)
{
	unsigned count = 1;

	while (first + count < device->blocks + device->block_count && first[count].index == count + 1)
		count++;
	return count;
}

static const char *has(const struct iec61850_block *block, enum iec61850_option option)
{
	return yes((block->options & option) != 0);
}

static const char *triggers_on(const struct iec61850_block *block, enum iec61850_trigger trigger)
{
	return yes((block->triggers & trigger) != 0);
}

/* Control blocks that differ by their index are one here. What clients may set is as it is at first. */
static void put_report(const struct iec61850_scl *scl, const struct iec61850_device *device, uint32_t number)
{
	const struct iec61850_block *block = &device->blocks[number];
	const struct iec61850_set *set = iec61850_set_of(scl->model, block);
	char id[TEXT_SIZE];

	fprintf(scl->out, "%*s<ReportControl name=\"%s\"", 6, "", block->name);
	if (block->id[0] != '\0')
		fprintf(scl->out, " rptID=\"%s\"", escaped(block->id, id));
	fprintf(scl->out,
		" datSet=\"%s\" confRev=\"%u\" buffered=\"%s\" bufTime=\"%u\" intgPd=\"%u\" "
		"indexed=\"true\">\n",
		set->name, set->revision, yes(block->buffered), block->buffer_ms, block->integrity_ms);
	line(scl, 7, "<TrgOps dchg=\"%s\" qchg=\"%s\" dupd=\"%s\" period=\"%s\" gi=\"%s\"/>",
	     triggers_on(block, IEC61850_DATA_CHANGE), triggers_on(block, IEC61850_QUALITY_CHANGE),
	     triggers_on(block, IEC61850_DATA_UPDATE), triggers_on(block, IEC61850_INTEGRITY),
	     triggers_on(block, IEC61850_GENERAL));
	line(scl, 7,
	     "<OptFields seqNum=\"%s\" timeStamp=\"%s\" dataSet=\"%s\" reasonCode=\"%s\" dataRef=\"%s\" "
	     "entryID=\"%s\" configRef=\"%s\" bufOvfl=\"%s\"/>",
	     has(block, IEC61850_SEQUENCE), has(block, IEC61850_TIME_STAMP), has(block, IEC61850_SET_NAME),
	     has(block, IEC61850_REASON), has(block, IEC61850_REFERENCE), has(block, IEC61850_ENTRY),
	     has(block, IEC61850_CONF_REVISION), has(block, IEC61850_OVERFLOW));
	line(scl, 7, "<RptEnabled max=\"%u\"/>", instances(device, block));
	line(scl, 6, "</ReportControl>");
}

/* ---- instances --------------------------------------------------------------------------- */

static void put_value(const struct iec61850_scl *scl, const char *attribute, const char *text)
{
	char safe[TEXT_SIZE];

	line(scl, 7, "<DAI name=\"%s\"><Val>%s</Val></DAI>", attribute, escaped(text, safe));
}

/* The address of a node, or of the first one in it. */
static void put_addressed(const struct iec61850_scl *scl, const struct iec61850_object *object,
			  const struct iec61850_node *node, unsigned type)
{
	const struct map_point *point = &scl->model->config->points[iec61850_point_of(scl->model, object)];

	if (node->count > 0) {
		line(scl, 7, "<SDI name=\"%s\">", node->name);
		put_addressed(scl, object, node->children, type);
		line(scl, 7, "</SDI>");
		return;
	}
	line(scl, 8,
	     "<DAI name=\"%s\"><Private type=\"IEC_60870_5_104\"><IEC_60870_5_104:Address casdu=\"%u\" "
	     "ioa=\"%u\" ti=\"%u\"/></Private></DAI>",
	     node->name, (unsigned)object->device->ca, point->ioa, type);
}

static void put_addresses(const struct iec61850_scl *scl, struct iec61850_object object)
{
	const uint32_t point = iec61850_point_of(scl->model, &object);
	const struct iec61850_scl_address address = scl->address(&scl->model->config->points[point]);
	const struct iec61850_nodes services = inside_of(scl, &object, IEC61850_CO);

	object = iec61850_object_of(scl->model, point);
	if (address.type != 0)
		put_addressed(scl, &object, inside_of(scl, &object, object.fc).nodes, address.type);
	for (unsigned i = 0; i < services.count && address.command_type != 0; i++)
		if (services.nodes[i].leaf == IEC61850_OPER)
			put_addressed(scl, &object, &services.nodes[i], address.command_type);
}

/* The value of an attribute that is another one for each point. False: it is none. */
static bool setting_of(const struct iec61850_scl *scl, const struct iec61850_object *object,
		       enum iec61850_leaf leaf, char out[TEXT_SIZE])
{
	const struct map_point *point = &scl->model->config->points[iec61850_point_of(scl->model, object)];
	const struct iec61850_unit unit = iec61850_unit_of(scl->model, point);

	switch (leaf) {
	case IEC61850_SI_UNIT:
		snprintf(out, TEXT_SIZE, "%s", iec61850_si_unit_name(unit.si));
		return true;
	case IEC61850_MULTIPLIER:
		snprintf(out, TEXT_SIZE, "%s", iec61850_multiplier_name(unit.exponent));
		return true;
	case IEC61850_DEADBAND_REF:
	case IEC61850_LEAST:
	case IEC61850_MOST:
	case IEC61850_STEP_SIZE:
	case IEC61850_HIGH_HIGH:
	case IEC61850_HIGH:
	case IEC61850_LOW:
	case IEC61850_LOW_LOW:
	case IEC61850_MEASURED_LEAST:
	case IEC61850_MEASURED_MOST:
		snprintf(out, TEXT_SIZE, "%.9g", map_shortest(iec61850_limit_of(scl->model, object, leaf)));
		return true;
	default:
		return false;
	}
}

static void put_settings(const struct iec61850_scl *scl, const struct iec61850_object *object,
			 struct iec61850_nodes inside)
{
	char text[TEXT_SIZE];

	for (unsigned i = 0; i < inside.count; i++) {
		const struct iec61850_node *node = &inside.nodes[i];

		if (setting_of(scl, object, node->leaf, text))
			put_value(scl, node->name, text);
		if (node->count == 0)
			continue;
		line(scl, 7, "<SDI name=\"%s\">", node->name);
		put_settings(scl, object, (struct iec61850_nodes){node->children, node->count});
		line(scl, 7, "</SDI>");
	}
}

static bool has_node(const struct iec61850_nodes inside, enum iec61850_leaf leaf)
{
	for (unsigned i = 0; i < inside.count; i++)
		if (inside.nodes[i].leaf == leaf)
			return true;
	return false;
}

static void put_instance(const struct iec61850_scl *scl, const struct iec61850_object *object)
{
	const struct iec61850_nodes described = inside_of(scl, object, IEC61850_DC);
	const bool has_text = has_node(described, IEC61850_DESCRIPTION);
	const bool is_point = iec61850_point_of(scl->model, object) != MAP_NONE;
	char name[IEC61850_NAME_SIZE], text[MAP_NAME_SIZE];

	if (!has_text && !is_point)
		return;
	do_name(scl, object, name);
	line(scl, 6, "<DOI name=\"%s\">", name);
	if (is_point) {
		put_addresses(scl, *object);
		put_settings(scl, object, inside_of(scl, object, IEC61850_CF));
	}
	iec61850_description(scl->model, object, text);
	if (has_text)
		put_value(scl, "d", text);
	if (has_node(described, IEC61850_CONFIGURATION)) {
		snprintf(text, sizeof(text), "%08x", (unsigned)scl->model->revision);
		put_value(scl, "configRev", text);
	}
	line(scl, 6, "</DOI>");
}

static void put_ln_type_name(const struct iec61850_scl *scl, const struct iec61850_object *object)
{
	fprintf(scl->out, "CA%u_%s", (unsigned)object->device->ca, object->device->lns[object->ln].name);
}

static void put_ln(const struct iec61850_scl *scl, const struct iec61850_device *device, unsigned number)
{
	struct iec61850_object object = first_object(device, number);
	const struct ln_name ln = parts_of(&object);
	const char *const element = number == IEC61850_LLN0 ? "LN0" : "LN";

	fprintf(scl->out, "%*s<%s", 5, "", element);
	if (ln.prefix[0] != '\0')
		fprintf(scl->out, " prefix=\"%s\"", ln.prefix);
	fprintf(scl->out, " lnClass=\"%s\" inst=\"%s\" lnType=\"", ln.class, ln.instance);
	put_ln_type_name(scl, &object);
	fputs("\">\n", scl->out);
	for (uint32_t i = 0; i < device->set_count; i++)
		if (strcmp(scl->model->sets[device->first_set + i].ln, device->lns[number].name) == 0)
			put_set(scl, &scl->model->sets[device->first_set + i]);
	for (uint32_t i = 0; number == IEC61850_LLN0 && i < scl->goose_count; i++)
		if (scl->goose[i].device == device)
			put_goose_set(scl, &scl->goose[i]);
	for (uint32_t i = 0; i < device->block_count; i++)
		if (device->blocks[i].ln == number && device->blocks[i].index == 1)
			put_report(scl, device, i);
	for (; is_object(&object); object.number++)
		put_instance(scl, &object);
	for (uint32_t i = 0; number == IEC61850_LLN0 && i < scl->goose_count; i++)
		if (scl->goose[i].device == device)
			put_goose_block(scl, &scl->goose[i]);
	line(scl, 5, "</%s>", element);
}

static void put_device(const struct iec61850_scl *scl, const struct iec61850_device *device)
{
	const struct iec61850_object object = first_object(device, IEC61850_LLN0);
	char name[MAP_NAME_SIZE], safe[TEXT_SIZE];

	iec61850_description(scl->model, &object, name);
	line(scl, 4, "<LDevice inst=\"CA%u\" desc=\"%s\">", (unsigned)device->ca, escaped(name, safe));
	for (unsigned ln = 0; ln < device->ln_count; ln++)
		put_ln(scl, device, ln);
	line(scl, 4, "</LDevice>");
}

static void put_ied(const struct iec61850_scl *scl)
{
	line(scl, 1,
	     "<IED name=\"%s\" type=\"gateway\" manufacturer=\"OpenRTU\" configVersion=\"%08x\" "
	     "originalSclVersion=\"2007\" originalSclRevision=\"B\"%s>",
	     ied_of(scl), (unsigned)scl->model->revision, scl->edition_2 ? "" : " originalSclRelease=\"4\"");
	line(scl, 2, "<Services nameLength=\"64\">");
	line(scl, 3, "<GetDirectory/>");
	line(scl, 3, "<GetDataObjectDefinition/>");
	line(scl, 3, "<DataObjectDirectory/>");
	line(scl, 3, "<GetDataSetValue/>");
	line(scl, 3, "<DataSetDirectory/>");
	line(scl, 3, "<DynDataSet max=\"%d\" maxAttributes=\"%d\"/>", IEC61850_LISTS, IEC61850_LIST_MEMBERS);
	line(scl, 3, "<ReadWrite/>");
	line(scl, 3, "<ConfReportControl max=\"%u\"/>", scl->model->block_count);
	line(scl, 3, "<GetCBValues/>");
	line(scl, 3, "<FileHandling mms=\"true\"/>");
	line(scl, 3,
	     "<ReportSettings cbName=\"Fix\" datSet=\"Dyn\" rptID=\"Dyn\" optFields=\"Dyn\" bufTime=\"Dyn\" "
	     "trgOps=\"Dyn\" intgPd=\"Dyn\" resvTms=\"true\" owner=\"true\"/>");
	if (scl->goose_count > 0)
		line(scl, 3, "<GOOSE max=\"%u\"/>", scl->goose_count);
	line(scl, 2, "</Services>");
	line(scl, 2, "<AccessPoint name=\"AP1\">");
	line(scl, 3, "<Server>");
	line(scl, 4, "<Authentication none=\"true\"/>");
	for (uint32_t i = 0; i < scl->model->device_count; i++)
		put_device(scl, &scl->model->devices[i]);
	line(scl, 3, "</Server>");
	line(scl, 2, "</AccessPoint>");
	line(scl, 1, "</IED>");
}

/* ---- types ------------------------------------------------------------------------------- */

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
			       const struct iec61850_class *class, char number[TEXT_SIZE])
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
		snprintf(number, TEXT_SIZE, "%lld", settings->select_timeout_s * MS_PER_S);
		return number;
	case IEC61850_OPER_TIMEOUT:
		snprintf(number, TEXT_SIZE, "%lld", settings->command_timeout_s * MS_PER_S);
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
	char number[TEXT_SIZE];
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
		line(scl, 2, "<DAType id=\"%s\">", id);
		for (unsigned j = 0; j < children.count; j++)
			put_attribute(scl, "BDA", "", &children.nodes[j], class, id);
		line(scl, 2, "</DAType>");
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
	line(scl, 2, "<DOType id=\"%s\" cdc=\"%s\">", id, class.name);
	for (unsigned fc = 0; fc < IEC61850_FCS; fc++) {
		const struct iec61850_nodes inside = inside_of(scl, object, fc);

		for (unsigned i = 0; i < inside.count; i++) {
			snprintf(more, sizeof(more), " fc=\"%s\"%s", iec61850_fc_name(fc),
				 triggers_of((enum iec61850_fc)fc, inside.nodes[i].leaf));
			put_attribute(scl, "DA", more, &inside.nodes[i], &class, id);
		}
	}
	line(scl, 2, "</DOType>");
}

static void put_type_structures(const struct iec61850_scl *scl, const struct iec61850_object *object)
{
	const struct iec61850_class class = iec61850_class_of(scl->model, object);
	char id[ID_SIZE];

	type_id(&class, id);
	for (unsigned fc = 0; fc < IEC61850_FCS; fc++)
		put_structures(scl, inside_of(scl, object, fc), &class, id);
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
	const struct ln_name ln = parts_of(&object);
	char id[ID_SIZE], name[IEC61850_NAME_SIZE];

	fputs("  <LNodeType id=\"", scl->out);
	put_ln_type_name(scl, &object);
	fprintf(scl->out, "\" lnClass=\"%s\">\n", ln.class);
	for (; is_object(&object); object.number++) {
		const struct iec61850_class class = iec61850_class_of(scl->model, &object);

		type_id(&class, id);
		do_name(scl, &object, name);
		line(scl, 3, "<DO name=\"%s\" type=\"%s\"/>", name, id);
		note_type(scl, types, &object);
	}
	line(scl, 2, "</LNodeType>");
}

static void put_enumerations(const struct iec61850_scl *scl)
{
	for (unsigned i = IEC61850_NO_ENUMERATION + 1; i < IEC61850_ENUMERATIONS; i++) {
		line(scl, 2, "<EnumType id=\"%s\">", enumerations[i].name);
		for (int number = IEC61850_EXPONENT_MIN; number <= IEC61850_SI_UNIT_MAX; number++)
			if (literal(i, number) != NULL)
				line(scl, 3, "<EnumVal ord=\"%d\">%s</EnumVal>", number, literal(i, number));
		line(scl, 2, "</EnumType>");
	}
}

static void put_types(const struct iec61850_scl *scl)
{
	struct types types = {.count = 0};

	line(scl, 1, "<DataTypeTemplates>");
	for (uint32_t i = 0; i < scl->model->device_count; i++)
		for (unsigned ln = 0; ln < scl->model->devices[i].ln_count; ln++)
			put_ln_type(scl, first_object(&scl->model->devices[i], ln), &types);
	for (unsigned i = 0; i < types.count; i++)
		put_type(scl, &types.objects[i]);
	for (unsigned i = 0; i < types.count; i++)
		put_type_structures(scl, &types.objects[i]);
	put_enumerations(scl);
	line(scl, 1, "</DataTypeTemplates>");
}

void iec61850_scl_write(const struct iec61850_scl *scl)
{
	line(scl, 0, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
	line(scl, 0,
	     "<SCL xmlns=\"http://www.iec.ch/61850/2003/SCL\" xmlns:IEC_60870_5_104=\"" NS_104
	     "\" version=\"2007\" revision=\"B\"%s>",
	     scl->edition_2 ? "" : " release=\"4\"");
	line(scl, 1, "<Header id=\"%s\" version=\"%s\" revision=\"%08x\" toolID=\"rtud\"/>", ied_of(scl),
	     OPENRTU_VERSION, (unsigned)scl->model->revision);
	if (scl->configured)
		put_communication(scl);
	put_ied(scl);
	put_types(scl);
	line(scl, 0, "</SCL>");
}
