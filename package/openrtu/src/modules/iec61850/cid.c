/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec61850/cid.h"

#include <ctype.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "goose/config.h"
#include "iec104/asdu.h"
#include "iec104/carrier.h"
#include "iec61850/scl.h"

#define CONTROL_PART   "/LLN0$GO$"
#define DATA_SET_PART  "/LLN0$"
#define NAME_MAX_61850 32 /* letters of a control block's name, or a data set's */

/* Events have a time tag; what is asked for has none (IEC 60870-5-101, 7.3.1 and 7.3.2). By enum map_type. */
static const struct iec61850_scl_address types[MAP_TYPES] = {
    [MAP_SINGLE] = {IEC104_M_SP_TB_1, IEC104_C_SC_NA_1},
    [MAP_DOUBLE] = {IEC104_M_DP_TB_1, IEC104_C_DC_NA_1},
    [MAP_STEP] = {IEC104_M_ST_TB_1, 0},
    [MAP_BITSTRING] = {IEC104_M_BO_TB_1, IEC104_C_BO_NA_1},
    [MAP_NORMALIZED] = {IEC104_M_ME_TD_1, IEC104_C_SE_NA_1},
    [MAP_SCALED] = {IEC104_M_ME_TE_1, IEC104_C_SE_NB_1},
    [MAP_FLOAT] = {IEC104_M_ME_TF_1, IEC104_C_SE_NC_1},
    [MAP_COUNTER] = {IEC104_M_IT_TB_1, 0},
};

static struct iec61850_scl_address address_of(const struct map_point *point)
{
	struct iec61850_scl_address address = types[iec104_carrier_of(point)];

	if (point->flags & MAP_POINT_POSITION)
		return (struct iec61850_scl_address){0};
	if (point->flags & MAP_POINT_NO_QUALITY)
		address.type = IEC104_M_ME_ND_1;
	return address;
}

/* What stands behind the device's name and part in a reference. NULL: it is no name there. */
static const char *name_in(const char *reference, const char *device, const char *part)
{
	const size_t size = strlen(device);
	const char *name = reference + size + strlen(part);

	if (strncmp(reference, device, size) != 0 || strncmp(reference + size, part, strlen(part)) != 0 ||
	    !isalpha((unsigned char)*name) || strlen(name) > NAME_MAX_61850)
		return NULL;
	for (const char *c = name; *c != '\0'; c++)
		if (!isalnum((unsigned char)*c) && *c != '_')
			return NULL;
	return name;
}

static bool take_publication(const struct iec61850_model *model, const struct goose_publication *from,
			     struct iec61850_scl_goose *out)
{
	const struct goose_stream *stream = &from->stream;

	*out = (struct iec61850_scl_goose){.id = from->id,
					   .destination = stream->destination,
					   .members = goose_members(model->config) + from->first_member,
					   .member_count = from->member_count,
					   .conf_rev = stream->conf_rev,
					   .least_ms = from->least_ms,
					   .most_ms = from->most_ms,
					   .app_id = stream->app_id,
					   .vlan = from->vlan,
					   .vlan_priority = from->vlan_priority,
					   .tagged = from->tagged,
					   .with_quality = from->with_quality,
					   .with_time = from->with_time};
	for (uint32_t i = 0; i < model->device_count; i++) {
		char device[IEC61850_NAME_SIZE];

		iec61850_device_name(model, &model->devices[i], device);
		out->device = &model->devices[i];
		out->name = name_in(stream->control, device, CONTROL_PART);
		out->set = name_in(stream->data_set, device, DATA_SET_PART);
		if (out->name != NULL && out->set != NULL)
			return true;
	}
	return false;
}

static uint32_t take_publications(const struct iec61850_model *model,
				  struct iec61850_scl_goose out[GOOSE_PUBLISHED_MAX], FILE *messages)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < map_record_count(model->config, GOOSE_PUBLICATIONS); i++) {
		const struct goose_publication *publication = &goose_publications(model->config)[i];

		if (take_publication(model, publication, &out[count]))
			count++;
		else if (messages != NULL)
			fprintf(
			    messages,
			    "rtud: goose.publish[%u] is left out: \"%s\" and \"%s\" are not one of the IED's "
			    "logical devices, expected as %sCA%u" CONTROL_PART "%s and ..." DATA_SET_PART
			    "%s\n",
			    (unsigned)i, publication->stream.control, publication->stream.data_set,
			    model->settings->ied, (unsigned)model->devices[0].ca, publication->stream.name,
			    publication->stream.name);
	}
	return count;
}

void cid_write(FILE *out, const struct iec61850_model *model, struct cid_form form, FILE *messages)
{
	struct iec61850_scl_goose goose[GOOSE_PUBLISHED_MAX];
	const struct iec61850_scl scl = {.out = out,
					 .model = model,
					 .configured = form.configured,
					 .edition_2 = form.edition_2,
					 .address = address_of,
					 .goose = goose,
					 .goose_count = take_publications(model, goose, messages)};

	iec61850_scl_write(&scl);
}

static bool write_all(int fd, const struct iec61850_model *model)
{
	FILE *out = fdopen(dup(fd), "w");
	bool good;

	if (out == NULL)
		return false;
	cid_write(out, model, (struct cid_form){.configured = true}, NULL);
	good = ferror(out) == 0;
	return fclose(out) == 0 && good;
}

int cid_file(const struct map_config *config)
{
	const int fd = memfd_create("scl", MFD_ALLOW_SEALING);
	struct iec61850_model model;

	/* The process executes a module next: what the model takes ends with it. */
	if (fd >= 0 && iec61850_model_of(&model, config) && write_all(fd, &model) &&
	    fcntl(fd, F_ADD_SEALS, F_SEAL_WRITE | F_SEAL_GROW | F_SEAL_SHRINK | F_SEAL_SEAL) == 0)
		return fd;
	if (fd >= 0)
		close(fd);
	return -1;
}
