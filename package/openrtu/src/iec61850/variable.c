/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <string.h>

#include "iec61850/mms.h"

/* A name that is a domain's: the logical device, and the item in it. */
static bool split(const struct iec61850_server *server, const struct ber_element *name,
		  const struct iec61850_device **device, struct ber_element *item)
{
	enum { DOMAIN_SPECIFIC = 0xa1 };
	struct ber_element specific, domain;
	struct ber_reader reader;

	if (!ber_find(name, DOMAIN_SPECIFIC, &specific))
		return false;
	reader = ber_inside(&specific);
	if (!ber_expect(&reader, BER_VISIBLE_STRING, &domain) ||
	    !ber_expect(&reader, BER_VISIBLE_STRING, item))
		return false;
	*device = iec61850_find_device(&server->model, domain.value, domain.size);
	return *device != NULL;
}

bool iec61850_variable(const struct iec61850_server *server, const struct ber_element *name,
		       struct iec61850_object *out)
{
	const struct iec61850_device *device;
	struct ber_element item;

	return split(server, name, &device, &item) &&
	       iec61850_find(&server->model, device, item.value, item.size, out);
}

bool iec61850_list_name(const struct iec61850_server *server, const struct ber_element *name,
			const struct iec61850_device **device, struct ber_element *item)
{
	enum { ASSOCIATION_SPECIFIC = 0x82 };

	*device = NULL;
	return ber_find(name, ASSOCIATION_SPECIFIC, item) || split(server, name, device, item);
}

/* Of the configuration, or made by a client: for an association's own, device is NULL. */
const struct iec61850_set *iec61850_variable_list(const struct iec61850_server *server,
						  const struct ber_element *name)
{
	const struct iec61850_model *model = &server->model;
	const struct iec61850_set *set = NULL;
	const struct iec61850_device *device;
	struct ber_element item;

	if (!iec61850_list_name(server, name, &device, &item))
		return NULL;
	if (device != NULL)
		set = iec61850_find_set(model, device, item.value, item.size);
	for (unsigned i = 0; set == NULL && i < IEC61850_LISTS; i++) {
		const struct iec61850_list *list = &model->lists[i];
		char own[IEC61850_NAME_SIZE];

		if (!list->used || (device == NULL ? list->client != server->client
						   : list->client != NULL || list->device != device))
			continue;
		iec61850_set_name(&model->sets[model->set_count + i], own);
		if (ber_is(&item, own, strlen(own)))
			set = &model->sets[model->set_count + i];
	}
	return set;
}
