/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/mms.h"

bool iec61850_variable(const struct iec61850_server *server, const struct ber_element *name,
		       struct iec61850_object *out)
{
	enum { DOMAIN_SPECIFIC = 0xa1 };
	const struct iec61850_device *device;
	struct ber_element specific, domain, item;
	struct ber_reader reader;

	if (!ber_find(name, DOMAIN_SPECIFIC, &specific))
		return false;
	reader = ber_inside(&specific);
	if (!ber_expect(&reader, BER_VISIBLE_STRING, &domain) ||
	    !ber_expect(&reader, BER_VISIBLE_STRING, &item))
		return false;
	device = iec61850_find_device(&server->model, domain.value, domain.size);
	return device != NULL && iec61850_find(&server->model, device, item.value, item.size, out);
}
