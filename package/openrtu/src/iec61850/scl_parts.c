/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/scl_parts.h"

#include <stdarg.h>
#include <string.h>

#define LN_CLASS_LETTERS 4
#define TEMPLATE_IED     "TEMPLATE" /* IEC 61850-6, 9.3.1 */

void iec61850_scl_line(const struct iec61850_scl *scl, int depth, const char *format, ...)
{
	va_list arguments;

	fprintf(scl->out, "%*s", depth, "");
	va_start(arguments, format);
	vfprintf(scl->out, format, arguments);
	va_end(arguments);
	fputc('\n', scl->out);
}

const char *iec61850_scl_ied(const struct iec61850_scl *scl)
{
	return scl->configured ? scl->model->settings->ied : TEMPLATE_IED;
}

struct iec61850_ln_name iec61850_scl_ln_name(const struct iec61850_object *object)
{
	const char *name = object->device->lns[object->ln].name;
	struct iec61850_ln_name parts = {.instance = ""};
	size_t size = strlen(name);

	if (object->ln != IEC61850_LLN0) {
		while (size > LN_CLASS_LETTERS && name[size - 1] >= '0' && name[size - 1] <= '9')
			size--;
		parts.instance = name + size;
	}
	if (object->ln == IEC61850_LLN0)
		size = LN_CLASS_LETTERS;
	snprintf(parts.prefix, sizeof(parts.prefix), "%.*s", (int)(size - LN_CLASS_LETTERS), name);
	snprintf(parts.class, sizeof(parts.class), "%.4s", name + size - LN_CLASS_LETTERS);
	return parts;
}

void iec61850_scl_do_name(const struct iec61850_scl *scl, const struct iec61850_object *object,
			  char out[IEC61850_NAME_SIZE])
{
	char name[IEC61850_NAME_SIZE];

	iec61850_object_name(scl->model, object, name);
	snprintf(out, IEC61850_NAME_SIZE, "%s", strrchr(name, '$') + 1);
}

struct iec61850_object iec61850_scl_first(const struct iec61850_device *device, unsigned ln)
{
	return (struct iec61850_object){.device = device, .ln = ln};
}

bool iec61850_scl_is_object(const struct iec61850_object *object)
{
	return object->number < iec61850_object_count(object->device, object->ln) &&
	       iec61850_block_of(object->device, object->ln, object->number) == NULL;
}

struct iec61850_nodes iec61850_scl_inside(const struct iec61850_scl *scl,
					  const struct iec61850_object *object, unsigned fc)
{
	return iec61850_nodes_of(scl->model, object->device, object->ln, object->number,
				 (enum iec61850_fc)fc);
}

void iec61850_scl_put_ln_type(const struct iec61850_scl *scl, const struct iec61850_object *object)
{
	fprintf(scl->out, "CA%u_%s", (unsigned)object->device->ca, object->device->lns[object->ln].name);
}
