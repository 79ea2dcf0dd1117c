/* SPDX-License-Identifier: GPL-3.0-or-later */
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

const struct iec61850_set *iec61850_variable_list(const struct iec61850_server *server,
						  const struct ber_element *name)
{
	const struct iec61850_device *device;
	struct ber_element item;

	return split(server, name, &device, &item)
		   ? iec61850_find_set(&server->model, device, item.value, item.size)
		   : NULL;
}
