/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/scl.h"

#include <arpa/inet.h>
#include <stdlib.h>
#include <string.h>

#include "iec61850/leaf.h"
#include "iec61850/scl_parts.h"
#include "iec61850/value.h"
#include "map/address.h"
#include "map/type.h"

#define NS_104 "http://www.iec.ch/61850-80-1/2007/IEC_60870-5-104"

/* ---- text -------------------------------------------------------------------------------- */

static const char *escaped(const char *text, char out[IEC61850_SCL_TEXT_SIZE])
{
	size_t size = 0;

	for (; *text != '\0' && size < IEC61850_SCL_TEXT_SIZE - sizeof("&quot;"); text++) {
		const char *entity = *text == '&'   ? "&amp;"
				     : *text == '<' ? "&lt;"
				     : *text == '"' ? "&quot;"
						    : NULL;

		size += (size_t)snprintf(out + size, IEC61850_SCL_TEXT_SIZE - size,
					 entity != NULL ? "%s" : "%.1s", entity != NULL ? entity : text);
	}
	out[size] = '\0';
	return out;
}

static const char *yes(bool it_is)
{
	return it_is ? "true" : "false";
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
		iec61850_scl_line(scl, 5, "<P type=\"IP\">%u.%u.%u.%u</P>", o[12], o[13], o[14], o[15]);
	else
		iec61850_scl_line(scl, 5, "<P type=\"IPv6\">%x:%x:%x:%x:%x:%x:%x:%x</P>", o[0] << 8 | o[1],
				  o[2] << 8 | o[3], o[4] << 8 | o[5], o[6] << 8 | o[7], o[8] << 8 | o[9],
				  o[10] << 8 | o[11], o[12] << 8 | o[13], o[14] << 8 | o[15]);
}

static void put_goose_address(const struct iec61850_scl *scl, const struct iec61850_scl_goose *goose)
{
	const uint8_t *mac = goose->destination;

	iec61850_scl_line(scl, 4, "<GSE ldInst=\"CA%u\" cbName=\"%s\">", (unsigned)goose->device->ca,
			  goose->name);
	iec61850_scl_line(scl, 5, "<Address>");
	iec61850_scl_line(scl, 6, "<P type=\"MAC-Address\">%02X-%02X-%02X-%02X-%02X-%02X</P>", mac[0], mac[1],
			  mac[2], mac[3], mac[4], mac[5]);
	iec61850_scl_line(scl, 6, "<P type=\"APPID\">%04X</P>", (unsigned)goose->app_id);
	if (goose->tagged) {
		iec61850_scl_line(scl, 6, "<P type=\"VLAN-ID\">%03X</P>", (unsigned)goose->vlan);
		iec61850_scl_line(scl, 6, "<P type=\"VLAN-PRIORITY\">%u</P>", goose->vlan_priority);
	}
	iec61850_scl_line(scl, 5, "</Address>");
	iec61850_scl_line(scl, 5, "<MinTime unit=\"s\" multiplier=\"m\">%u</MinTime>", goose->least_ms);
	iec61850_scl_line(scl, 5, "<MaxTime unit=\"s\" multiplier=\"m\">%u</MaxTime>", goose->most_ms);
	iec61850_scl_line(scl, 4, "</GSE>");
}

static void put_communication(const struct iec61850_scl *scl)
{
	iec61850_scl_line(scl, 1, "<Communication>");
	iec61850_scl_line(scl, 2, "<SubNetwork name=\"station\" type=\"8-MMS\">");
	iec61850_scl_line(scl, 3, "<ConnectedAP iedName=\"%s\" apName=\"AP1\">", iec61850_scl_ied(scl));
	iec61850_scl_line(scl, 4, "<Address>");
	put_host(scl);
	iec61850_scl_line(scl, 5, "<P type=\"OSI-TSEL\">0001</P>");
	iec61850_scl_line(scl, 5, "<P type=\"OSI-SSEL\">0001</P>");
	iec61850_scl_line(scl, 5, "<P type=\"OSI-PSEL\">00000001</P>");
	iec61850_scl_line(scl, 5, "<P type=\"MMS-Port\">%u</P>", (unsigned)scl->model->settings->port);
	iec61850_scl_line(scl, 4, "</Address>");
	for (uint32_t i = 0; i < scl->goose_count; i++)
		put_goose_address(scl, &scl->goose[i]);
	iec61850_scl_line(scl, 3, "</ConnectedAP>");
	iec61850_scl_line(scl, 2, "</SubNetwork>");
	iec61850_scl_line(scl, 1, "</Communication>");
}

/* ---- data sets, control blocks ----------------------------------------------------------- */

/* attribute: of the data object; NULL: all of it under its functional constraint. */
static void put_member(const struct iec61850_scl *scl, const struct iec61850_object *object,
		       const char *attribute)
{
	const struct iec61850_ln_name ln = iec61850_scl_ln_name(object);
	char name[IEC61850_NAME_SIZE];

	iec61850_scl_do_name(scl, object, name);
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

	iec61850_scl_line(scl, 6, "<DataSet name=\"%s\">", set->name);
	for (uint32_t i = 0; i < set->count; i++) {
		const struct iec61850_object object = iec61850_member(scl->model, set, i);

		put_member(scl, &object, attribute_of(scl, &object, name));
	}
	iec61850_scl_line(scl, 6, "</DataSet>");
}

/* What is read first under the object's functional constraint: stVal, mag.f, ... */
static void put_value_member(const struct iec61850_scl *scl, const struct iec61850_object *object)
{
	const struct iec61850_node *node = iec61850_scl_inside(scl, object, object->fc).nodes;
	char name[IEC61850_NAME_SIZE];

	snprintf(name, sizeof(name), "%s%s%s", node->name, node->count > 0 ? "." : "",
		 node->count > 0 ? node->children->name : "");
	put_member(scl, object, name);
}

static void put_goose_set(const struct iec61850_scl *scl, const struct iec61850_scl_goose *goose)
{
	iec61850_scl_line(scl, 6, "<DataSet name=\"%s\">", goose->set);
	for (uint32_t i = 0; i < goose->member_count; i++) {
		const struct iec61850_object object = iec61850_object_of(scl->model, goose->members[i]);

		put_value_member(scl, &object);
		if (goose->with_quality)
			put_member(scl, &object, "q");
		if (goose->with_time)
			put_member(scl, &object, "t");
	}
	iec61850_scl_line(scl, 6, "</DataSet>");
}

static void put_goose_block(const struct iec61850_scl *scl, const struct iec61850_scl_goose *goose)
{
	char id[IEC61850_SCL_TEXT_SIZE];

	iec61850_scl_line(
	    scl, 6, "<GSEControl name=\"%s\" type=\"GOOSE\" datSet=\"%s\" confRev=\"%u\" appID=\"%s\"/>",
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
	char id[IEC61850_SCL_TEXT_SIZE];

	fprintf(scl->out, "%*s<ReportControl name=\"%s\"", 6, "", block->name);
	if (block->id[0] != '\0')
		fprintf(scl->out, " rptID=\"%s\"", escaped(block->id, id));
	fprintf(scl->out,
		" datSet=\"%s\" confRev=\"%u\" buffered=\"%s\" bufTime=\"%u\" intgPd=\"%u\" "
		"indexed=\"true\">\n",
		set->name, set->revision, yes(block->buffered), block->buffer_ms, block->integrity_ms);
	iec61850_scl_line(scl, 7, "<TrgOps dchg=\"%s\" qchg=\"%s\" dupd=\"%s\" period=\"%s\" gi=\"%s\"/>",
			  triggers_on(block, IEC61850_DATA_CHANGE),
			  triggers_on(block, IEC61850_QUALITY_CHANGE),
			  triggers_on(block, IEC61850_DATA_UPDATE), triggers_on(block, IEC61850_INTEGRITY),
			  triggers_on(block, IEC61850_GENERAL));
	iec61850_scl_line(
	    scl, 7,
	    "<OptFields seqNum=\"%s\" timeStamp=\"%s\" dataSet=\"%s\" reasonCode=\"%s\" dataRef=\"%s\" "
	    "entryID=\"%s\" configRef=\"%s\" bufOvfl=\"%s\"/>",
	    has(block, IEC61850_SEQUENCE), has(block, IEC61850_TIME_STAMP), has(block, IEC61850_SET_NAME),
	    has(block, IEC61850_REASON), has(block, IEC61850_REFERENCE), has(block, IEC61850_ENTRY),
	    has(block, IEC61850_CONF_REVISION), has(block, IEC61850_OVERFLOW));
	iec61850_scl_line(scl, 7, "<RptEnabled max=\"%u\"/>", instances(device, block));
	iec61850_scl_line(scl, 6, "</ReportControl>");
}

/* ---- instances --------------------------------------------------------------------------- */

static void put_value(const struct iec61850_scl *scl, const char *attribute, const char *text)
{
	char safe[IEC61850_SCL_TEXT_SIZE];

	iec61850_scl_line(scl, 7, "<DAI name=\"%s\"><Val>%s</Val></DAI>", attribute, escaped(text, safe));
}

/* The address of a node, or of the first one in it. */
static void put_addressed(const struct iec61850_scl *scl, const struct iec61850_object *object,
			  const struct iec61850_node *node, unsigned type)
{
	const struct map_point *point = &scl->model->config->points[iec61850_point_of(scl->model, object)];

	if (node->count > 0) {
		iec61850_scl_line(scl, 7, "<SDI name=\"%s\">", node->name);
		put_addressed(scl, object, node->children, type);
		iec61850_scl_line(scl, 7, "</SDI>");
		return;
	}
	iec61850_scl_line(
	    scl, 8,
	    "<DAI name=\"%s\"><Private type=\"IEC_60870_5_104\"><IEC_60870_5_104:Address casdu=\"%u\" "
	    "ioa=\"%u\" ti=\"%u\"/></Private></DAI>",
	    node->name, (unsigned)object->device->ca, point->ioa, type);
}

static void put_addresses(const struct iec61850_scl *scl, struct iec61850_object object)
{
	const uint32_t point = iec61850_point_of(scl->model, &object);
	const struct iec61850_scl_address address = scl->address(&scl->model->config->points[point]);
	const struct iec61850_nodes services = iec61850_scl_inside(scl, &object, IEC61850_CO);

	object = iec61850_object_of(scl->model, point);
	if (address.type != 0)
		put_addressed(scl, &object, iec61850_scl_inside(scl, &object, object.fc).nodes, address.type);
	for (unsigned i = 0; i < services.count && address.command_type != 0; i++)
		if (services.nodes[i].leaf == IEC61850_OPER)
			put_addressed(scl, &object, &services.nodes[i], address.command_type);
}

/* The value of an attribute that is another one for each point. False: it is none. */
static bool setting_of(const struct iec61850_scl *scl, const struct iec61850_object *object,
		       enum iec61850_leaf leaf, char out[IEC61850_SCL_TEXT_SIZE])
{
	const struct map_point *point = &scl->model->config->points[iec61850_point_of(scl->model, object)];
	const struct iec61850_unit unit = iec61850_unit_of(scl->model, point);

	switch (leaf) {
	case IEC61850_SI_UNIT:
		snprintf(out, IEC61850_SCL_TEXT_SIZE, "%s", iec61850_si_unit_name(unit.si));
		return true;
	case IEC61850_MULTIPLIER:
		snprintf(out, IEC61850_SCL_TEXT_SIZE, "%s", iec61850_multiplier_name(unit.exponent));
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
		snprintf(out, IEC61850_SCL_TEXT_SIZE, "%.9g",
			 map_shortest(iec61850_limit_of(scl->model, object, leaf)));
		return true;
	default:
		return false;
	}
}

static void put_settings(const struct iec61850_scl *scl, const struct iec61850_object *object,
			 struct iec61850_nodes inside)
{
	char text[IEC61850_SCL_TEXT_SIZE];

	for (unsigned i = 0; i < inside.count; i++) {
		const struct iec61850_node *node = &inside.nodes[i];

		if (setting_of(scl, object, node->leaf, text))
			put_value(scl, node->name, text);
		if (node->count == 0)
			continue;
		iec61850_scl_line(scl, 7, "<SDI name=\"%s\">", node->name);
		put_settings(scl, object, (struct iec61850_nodes){node->children, node->count});
		iec61850_scl_line(scl, 7, "</SDI>");
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
	const struct iec61850_nodes described = iec61850_scl_inside(scl, object, IEC61850_DC);
	const bool has_text = has_node(described, IEC61850_DESCRIPTION);
	const bool is_point = iec61850_point_of(scl->model, object) != MAP_NONE;
	char name[IEC61850_NAME_SIZE], text[MAP_NAME_SIZE];

	if (!has_text && !is_point)
		return;
	iec61850_scl_do_name(scl, object, name);
	iec61850_scl_line(scl, 6, "<DOI name=\"%s\">", name);
	if (is_point) {
		put_addresses(scl, *object);
		put_settings(scl, object, iec61850_scl_inside(scl, object, IEC61850_CF));
	}
	iec61850_description(scl->model, object, text);
	if (has_text)
		put_value(scl, "d", text);
	if (has_node(described, IEC61850_CONFIGURATION)) {
		snprintf(text, sizeof(text), "%08x", (unsigned)scl->model->revision);
		put_value(scl, "configRev", text);
	}
	iec61850_scl_line(scl, 6, "</DOI>");
}

static void put_ln(const struct iec61850_scl *scl, const struct iec61850_device *device, unsigned number)
{
	struct iec61850_object object = iec61850_scl_first(device, number);
	const struct iec61850_ln_name ln = iec61850_scl_ln_name(&object);
	const char *const element = number == IEC61850_LLN0 ? "LN0" : "LN";

	fprintf(scl->out, "%*s<%s", 5, "", element);
	if (ln.prefix[0] != '\0')
		fprintf(scl->out, " prefix=\"%s\"", ln.prefix);
	fprintf(scl->out, " lnClass=\"%s\" inst=\"%s\" lnType=\"", ln.class, ln.instance);
	iec61850_scl_put_ln_type(scl, &object);
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
	for (; iec61850_scl_is_object(&object); object.number++)
		put_instance(scl, &object);
	for (uint32_t i = 0; number == IEC61850_LLN0 && i < scl->goose_count; i++)
		if (scl->goose[i].device == device)
			put_goose_block(scl, &scl->goose[i]);
	iec61850_scl_line(scl, 5, "</%s>", element);
}

static void put_device(const struct iec61850_scl *scl, const struct iec61850_device *device)
{
	const struct iec61850_object object = iec61850_scl_first(device, IEC61850_LLN0);
	char name[MAP_NAME_SIZE], safe[IEC61850_SCL_TEXT_SIZE];

	iec61850_description(scl->model, &object, name);
	iec61850_scl_line(scl, 4, "<LDevice inst=\"CA%u\" desc=\"%s\">", (unsigned)device->ca,
			  escaped(name, safe));
	for (unsigned ln = 0; ln < device->ln_count; ln++)
		put_ln(scl, device, ln);
	iec61850_scl_line(scl, 4, "</LDevice>");
}

static void put_ied(const struct iec61850_scl *scl)
{
	iec61850_scl_line(scl, 1,
			  "<IED name=\"%s\" type=\"gateway\" manufacturer=\"OpenRTU\" configVersion=\"%08x\" "
			  "originalSclVersion=\"2007\" originalSclRevision=\"B\"%s>",
			  iec61850_scl_ied(scl), (unsigned)scl->model->revision,
			  scl->edition_2 ? "" : " originalSclRelease=\"4\"");
	iec61850_scl_line(scl, 2, "<Services nameLength=\"64\">");
	iec61850_scl_line(scl, 3, "<GetDirectory/>");
	iec61850_scl_line(scl, 3, "<GetDataObjectDefinition/>");
	iec61850_scl_line(scl, 3, "<DataObjectDirectory/>");
	iec61850_scl_line(scl, 3, "<GetDataSetValue/>");
	iec61850_scl_line(scl, 3, "<DataSetDirectory/>");
	iec61850_scl_line(scl, 3, "<DynDataSet max=\"%d\" maxAttributes=\"%d\"/>", IEC61850_LISTS,
			  IEC61850_LIST_MEMBERS);
	iec61850_scl_line(scl, 3, "<ReadWrite/>");
	iec61850_scl_line(scl, 3, "<ConfReportControl max=\"%u\"/>", scl->model->block_count);
	iec61850_scl_line(scl, 3, "<GetCBValues/>");
	iec61850_scl_line(scl, 3, "<FileHandling mms=\"true\"/>");
	iec61850_scl_line(
	    scl, 3,
	    "<ReportSettings cbName=\"Fix\" datSet=\"Dyn\" rptID=\"Dyn\" optFields=\"Dyn\" bufTime=\"Dyn\" "
	    "trgOps=\"Dyn\" intgPd=\"Dyn\" resvTms=\"true\" owner=\"true\"/>");
	if (scl->goose_count > 0)
		iec61850_scl_line(scl, 3, "<GOOSE max=\"%u\"/>", scl->goose_count);
	iec61850_scl_line(scl, 2, "</Services>");
	iec61850_scl_line(scl, 2, "<AccessPoint name=\"AP1\">");
	iec61850_scl_line(scl, 3, "<Server>");
	iec61850_scl_line(scl, 4, "<Authentication none=\"true\"/>");
	for (uint32_t i = 0; i < scl->model->device_count; i++)
		put_device(scl, &scl->model->devices[i]);
	iec61850_scl_line(scl, 3, "</Server>");
	iec61850_scl_line(scl, 2, "</AccessPoint>");
	iec61850_scl_line(scl, 1, "</IED>");
}

void iec61850_scl_write(const struct iec61850_scl *scl)
{
	iec61850_scl_line(scl, 0, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
	iec61850_scl_line(scl, 0,
			  "<SCL xmlns=\"http://www.iec.ch/61850/2003/SCL\" xmlns:IEC_60870_5_104=\"" NS_104
			  "\" version=\"2007\" revision=\"B\"%s>",
			  scl->edition_2 ? "" : " release=\"4\"");
	iec61850_scl_line(scl, 1, "<Header id=\"%s\" version=\"%s\" revision=\"%08x\" toolID=\"rtud\"/>",
			  iec61850_scl_ied(scl), OPENRTU_VERSION, (unsigned)scl->model->revision);
	if (scl->configured)
		put_communication(scl);
	put_ied(scl);
	iec61850_scl_put_types(scl);
	iec61850_scl_line(scl, 0, "</SCL>");
}
