/* SPDX-License-Identifier: GPL-3.0-or-later */
/* GetNameList (ISO 9506-2): what there is, as many names at a time as a PDU holds. */
#include <stdio.h>
#include <string.h>

#include "iec61850/mms.h"

enum { OBJECT_CLASS = 0xa0, BASIC_CLASS = 0x80, SCOPE = 0xa1, CONTINUE_AFTER = 0x82 };
enum { OF_VMD = 0x80, OF_DOMAIN = 0x81, OF_ASSOCIATION = 0x82 };
enum { NAMED_VARIABLE = 0, NAMED_VARIABLE_LIST = 2, OBJECT_CLASS_MAX = 13, DOMAIN = 9 };

#define FRAME 32 /* octets of the PDU around the names */

/* A list that is being filled. */
struct list {
	uint8_t *octets;
	size_t size, limit;
	const uint8_t *after; /* names up to this one were told before; NULL: none */
	size_t after_size;
	bool more; /* than the list has room for */
};

static void add(struct list *list, const char *name)
{
	const size_t size = strlen(name);

	if (list->after != NULL) {
		if (size == list->after_size && memcmp(name, list->after, size) == 0)
			list->after = NULL;
		return;
	}
	if (list->more || list->limit - list->size < size + 2) {
		list->more = true;
		return;
	}
	list->octets[list->size++] = BER_VISIBLE_STRING;
	list->octets[list->size++] = (uint8_t)size;
	memcpy(list->octets + list->size, name, size);
	list->size += size;
}

/* The nodes of a data object, each after what it is in. name: of the latter, and has room for what is to come. */
static void add_nodes(struct list *list, struct iec61850_nodes inside, char name[IEC61850_NAME_SIZE])
{
	const size_t length = strlen(name);

	for (unsigned i = 0; i < inside.count && !list->more; i++) {
		const struct iec61850_node *node = &inside.nodes[i];

		snprintf(name + length, IEC61850_NAME_SIZE - length, "$%s", node->name);
		add(list, name);
		add_nodes(list, (struct iec61850_nodes){node->children, node->count}, name);
	}
	name[length] = '\0';
}

static void add_object(struct list *list, const struct iec61850_model *model,
		       const struct iec61850_object *object)
{
	const struct iec61850_nodes inside = iec61850_nodes_of(model, object->device, object->ln,
							       object->number, (enum iec61850_fc)object->fc);
	char name[IEC61850_NAME_SIZE];

	if (inside.count == 0)
		return;
	iec61850_object_name(model, object, name);
	add(list, name);
	add_nodes(list, inside, name);
}

static void add_fc(struct list *list, const struct iec61850_model *model, struct iec61850_object object,
		   uint32_t first)
{
	const uint32_t count = iec61850_object_count(object.device, object.ln);
	char name[IEC61850_NAME_SIZE];

	if (first == IEC61850_WHOLE) {
		iec61850_object_name(model, &object, name);
		add(list, name);
		first = 0;
	}
	for (object.number = first; object.number < count && !list->more; object.number++)
		add_object(list, model, &object);
}

static void add_ln(struct list *list, const struct iec61850_model *model, struct iec61850_object object,
		   const struct iec61850_object *first)
{
	uint32_t number = first->number;

	object.fc = first->fc;
	if (object.fc == IEC61850_WHOLE) {
		add(list, object.device->lns[object.ln].name);
		object.fc = 0;
	}
	for (; object.fc < IEC61850_FCS && !list->more; object.fc++, number = IEC61850_WHOLE)
		if (iec61850_has(model, object.device, object.ln, (enum iec61850_fc)object.fc))
			add_fc(list, model, object, number);
}

/* All variables of a logical device, from the data object on that the last name told before belongs to. */
static bool add_variables(struct list *list, const struct iec61850_model *model,
			  const struct iec61850_device *device)
{
	const struct iec61850_object whole = {
	    .device = device, .fc = IEC61850_WHOLE, .number = IEC61850_WHOLE};
	struct iec61850_object first = whole, object = whole;

	if (list->after != NULL && !iec61850_find(model, device, list->after, list->after_size, &first))
		return false;
	for (object.ln = first.ln; object.ln < device->ln_count && !list->more; object.ln++)
		add_ln(list, model, object, object.ln == first.ln ? &first : &whole);
	return true;
}

static void add_sets(struct list *list, const struct iec61850_model *model,
		     const struct iec61850_device *device)
{
	for (uint32_t i = 0; i < device->set_count; i++) {
		char name[IEC61850_NAME_SIZE];

		iec61850_set_name(&model->sets[device->first_set + i], name);
		add(list, name);
	}
}

/* What clients have made: of a logical device, or, if device is NULL, this one for itself. */
static void add_lists(struct list *list, const struct iec61850_server *server,
		      const struct iec61850_device *device)
{
	const void *client = device == NULL ? server->client : NULL;

	for (uint32_t i = 0; i < IEC61850_LISTS; i++) {
		const struct iec61850_list *each = &server->model.lists[i];
		char name[IEC61850_NAME_SIZE];

		if (!each->used || each->client != client || (device != NULL && each->device != device))
			continue;
		iec61850_set_name(&server->model.sets[server->model.set_count + i], name);
		add(list, name);
	}
}

static void add_devices(struct list *list, const struct iec61850_model *model)
{
	for (uint32_t i = 0; i < model->device_count; i++) {
		char name[IEC61850_NAME_SIZE];

		iec61850_device_name(model, &model->devices[i], name);
		add(list, name);
	}
}

static enum iec61850_error fill(struct list *list, const struct iec61850_server *server, int64_t class,
				const struct ber_element *scope)
{
	const struct iec61850_model *model = &server->model;
	const struct iec61850_device *device;
	struct ber_element of;

	if (class < 0 || class > OBJECT_CLASS_MAX)
		return IEC61850_INVALID_REQUEST;
	if (ber_find(scope, OF_DOMAIN, &of)) {
		device = iec61850_find_device(model, of.value, of.size);
		if (device == NULL)
			return IEC61850_NON_EXISTENT;
		if (class == NAMED_VARIABLE && !add_variables(list, model, device))
			return IEC61850_UNDEFINED;
		if (class == NAMED_VARIABLE_LIST) {
			add_sets(list, model, device);
			add_lists(list, server, device);
		}
	} else if (!ber_find(scope, OF_VMD, &of) && !ber_find(scope, OF_ASSOCIATION, &of)) {
		return IEC61850_INVALID_REQUEST;
	} else if (class == DOMAIN && of.tag == OF_VMD) {
		add_devices(list, model);
	} else if (class == NAMED_VARIABLE_LIST && of.tag == OF_ASSOCIATION) {
		add_lists(list, server, NULL);
	}
	return list->after != NULL ? IEC61850_UNDEFINED : IEC61850_NO_ERROR;
}

enum iec61850_error iec61850_name_list(struct iec61850_server *server, const struct ber_element *request,
				       struct ber_writer *writer)
{
	const size_t end = writer->at, room = end - writer->floor;
	struct list list = {.octets = iec61850_room(writer), .limit = room > FRAME ? room - FRAME : 0};
	struct ber_element class, number, scope, after;
	enum iec61850_error error;
	int64_t value;
	size_t names;

	if (!ber_find(request, OBJECT_CLASS, &class) || !ber_find(&class, BASIC_CLASS, &number) ||
	    !ber_integer(&number, &value) || !ber_find(request, SCOPE, &scope))
		return IEC61850_INVALID_REQUEST;
	if (ber_find(request, CONTINUE_AFTER, &after)) {
		list.after = after.value;
		list.after_size = after.size;
	}
	error = fill(&list, server, value, &scope);
	if (error != IEC61850_NO_ERROR)
		return error;
	ber_put(writer, 0x81, (const uint8_t[]){list.more ? 0xff : 0}, 1);
	names = writer->at;
	ber_put_octets(writer, list.octets, list.size);
	ber_close(writer, 0xa0, names);
	ber_close(writer, 0xa1, end);
	return IEC61850_NO_ERROR;
}
