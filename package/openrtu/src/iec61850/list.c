/* SPDX-License-Identifier: GPL-3.0-or-later */
/* DefineNamedVariableList, DeleteNamedVariableList (ISO 9506-2, 14.10 and 14.12). */
#include "iec61850/list.h"

#include <ctype.h>
#include <string.h>

enum { DEFINED = 0x8b, DELETED = 0xad, VARIABLES = 0xa0, VARIABLE_NAME = 0xa0, ALTERNATE_ACCESS = 0xa5 };
enum { SCOPE = 0x80, NAMES = 0xa1, SPECIFIC = 0 };

/* ---- names ------------------------------------------------------------------------------- */

/* A letter, then letters, digits and _, as SCL names data sets. */
static bool take_name(const uint8_t *text, size_t size, char *out, size_t room)
{
	if (size == 0 || size >= room || !isalpha(text[0]))
		return false;
	for (size_t i = 0; i < size; i++)
		if (!isalnum(text[i]) && text[i] != '_')
			return false;
	memcpy(out, text, size);
	out[size] = '\0';
	return true;
}

/* LLN0$name: in a logical node that is there. */
static bool take_reference(struct iec61850_list *list, const struct ber_element *item)
{
	const uint8_t *dollar = memchr(item->value, '$', item->size);
	const size_t size = dollar == NULL ? 0 : (size_t)(dollar - item->value);

	if (size == 0 || !take_name(item->value, size, list->ln, sizeof(list->ln)) ||
	    !take_name(dollar + 1, item->size - size - 1, list->name, sizeof(list->name)))
		return false;
	for (uint32_t i = 0; i < list->device->ln_count; i++)
		if (strcmp(list->device->lns[i].name, list->ln) == 0)
			return true;
	return false;
}

/* ---- definition -------------------------------------------------------------------------- */

static uint32_t set_of(const struct iec61850_server *server, const struct iec61850_list *list)
{
	return server->model.set_count + (uint32_t)(list - server->model.lists);
}

/* Of one logical device, a point's under ST or MX, or an attribute of it. */
static bool is_member(const struct iec61850_server *server, const struct iec61850_list *list,
		      const struct iec61850_object *object)
{
	uint32_t point;

	if (object->device != list->device || object->number == IEC61850_WHOLE ||
	    iec61850_block_of(object->device, object->ln, object->number) != NULL)
		return false;
	point = iec61850_point_of(&server->model, object);
	return point != MAP_NONE && object->fc == server->model.places[point].fc;
}

static enum iec61850_error add_members(struct iec61850_server *server, struct iec61850_list *list,
				       const struct ber_element *variables)
{
	const uint32_t set = set_of(server, list);
	struct iec61850_set *of = &server->model.sets[set];
	struct ber_reader reader = ber_inside(variables);
	struct ber_element variable, name, part;

	while (reader.at < reader.end) {
		struct iec61850_object object;

		if (!ber_expect(&reader, BER_SEQUENCE, &variable))
			return IEC61850_INVALID_REQUEST;
		if (!ber_find(&variable, VARIABLE_NAME, &name) ||
		    ber_find(&variable, ALTERNATE_ACCESS, &part))
			return IEC61850_NO_SUCH_ACCESS;
		if (!iec61850_variable(server, &name, &object))
			return IEC61850_UNDEFINED;
		if (list->device == NULL)
			list->device = object.device;
		if (!is_member(server, list, &object))
			return IEC61850_INCONSISTENT;
		if (of->count == IEC61850_LIST_MEMBERS)
			return IEC61850_TOO_LONG;
		iec61850_add_member(&server->model, set, of->first + of->count,
				    iec61850_point_of(&server->model, &object), object.node);
	}
	return of->count > 0 ? IEC61850_NO_ERROR : IEC61850_INCONSISTENT;
}

static struct iec61850_list *free_list(struct iec61850_server *server)
{
	for (unsigned i = 0; i < IEC61850_LISTS; i++)
		if (!server->model.lists[i].used)
			return &server->model.lists[i];
	return NULL;
}

enum iec61850_error iec61850_list_define(struct iec61850_server *server, const struct ber_element *request,
					 struct ber_writer *writer)
{
	struct ber_reader reader = ber_inside(request);
	struct iec61850_list *list = free_list(server);
	struct ber_element name, item, variables, whole;
	const struct iec61850_device *device;
	enum iec61850_error error;
	bool named;

	if (!ber_next(&reader, &name))
		return IEC61850_INVALID_REQUEST;
	whole = (struct ber_element){.value = request->value, .size = (size_t)(reader.at - request->value)};
	if (!ber_expect(&reader, VARIABLES, &variables))
		return IEC61850_INVALID_REQUEST;
	if (!iec61850_list_name(server, &whole, &device, &item))
		return IEC61850_NON_EXISTENT;
	if (iec61850_variable_list(server, &whole) != NULL)
		return IEC61850_EXISTS;
	if (list == NULL)
		return IEC61850_TOO_LONG;
	*list = (struct iec61850_list){.device = device, .client = device == NULL ? server->client : NULL};
	named = device != NULL ? take_reference(list, &item)
			       : take_name(item.value, item.size, list->name, sizeof(list->name));
	if (!named)
		return IEC61850_INCONSISTENT;
	server->model.sets[set_of(server, list)].ln = device == NULL ? NULL : list->ln;
	server->model.sets[set_of(server, list)].name = list->name;
	error = add_members(server, list, &variables);
	if (error != IEC61850_NO_ERROR) {
		iec61850_clear_set(&server->model, set_of(server, list));
		return error;
	}
	list->used = true;
	ber_put(writer, DEFINED, NULL, 0);
	return IEC61850_NO_ERROR;
}

/* ---- deletion ---------------------------------------------------------------------------- */

static void remove_list(struct iec61850_server *server, struct iec61850_list *list)
{
	iec61850_clear_set(&server->model, set_of(server, list));
	list->used = false;
}

static bool is_in_use(const struct iec61850_server *server, uint32_t set)
{
	for (uint32_t i = 0; i < server->model.block_count; i++)
		if (server->model.blocks[i].set == set)
			return true;
	return false;
}

enum iec61850_error iec61850_list_delete(struct iec61850_server *server, const struct ber_element *request,
					 struct ber_writer *writer)
{
	const size_t end = writer->at;
	int64_t scope = SPECIFIC, matched = 0, deleted = 0;
	struct ber_element names, name, whole;
	struct ber_reader reader;

	if (ber_find(request, SCOPE, &name) && !ber_integer(&name, &scope))
		return IEC61850_INVALID_REQUEST;
	if (scope != SPECIFIC)
		return IEC61850_NO_SUCH_ACCESS;
	if (!ber_find(request, NAMES, &names))
		return IEC61850_INVALID_REQUEST;
	reader = ber_inside(&names);
	while (reader.at < reader.end) {
		const uint8_t *begin = reader.at;
		const struct iec61850_set *set;
		uint32_t number;

		if (!ber_next(&reader, &name))
			return IEC61850_INVALID_REQUEST;
		whole = (struct ber_element){.value = begin, .size = (size_t)(reader.at - begin)};
		set = iec61850_variable_list(server, &whole);
		if (set == NULL)
			continue;
		matched++;
		number = (uint32_t)(set - server->model.sets);
		if (number < server->model.set_count || is_in_use(server, number))
			continue;
		remove_list(server, &server->model.lists[number - server->model.set_count]);
		deleted++;
	}
	ber_put_integer(writer, 0x81, deleted);
	ber_put_integer(writer, 0x80, matched);
	ber_close(writer, DELETED, end);
	return IEC61850_NO_ERROR;
}

/* From a control block that its client has given back with it, too. */
static void withdraw(struct iec61850_server *server, struct iec61850_list *list)
{
	for (uint32_t i = 0; i < server->model.block_count; i++)
		if (server->model.blocks[i].set == set_of(server, list))
			server->model.blocks[i].set = server->model.blocks[i].own_set;
	remove_list(server, list);
}

void iec61850_lists_release(struct iec61850_server *server, const void *client)
{
	for (unsigned i = 0; i < IEC61850_LISTS; i++)
		if (server->model.lists[i].used && server->model.lists[i].client == client)
			withdraw(server, &server->model.lists[i]);
}
