/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/address.h"

#include <string.h>

#include "map/address.h"

bool config_is_same_address(const char *a, const char *b)
{
	struct in6_addr left, right;

	return map_address_parse(a, &left) && map_address_parse(b, &right) &&
	       memcmp(&left, &right, sizeof(left)) == 0;
}

void config_read_address(struct config_report *report, const struct config_place *place, const char *text,
			 char out[MAP_ADDRESS_SIZE])
{
	struct in6_addr parsed;

	if (map_address_parse(text, &parsed))
		snprintf(out, MAP_ADDRESS_SIZE, "%s", text);
	else
		config_error(report, place,
			     "is not an IP address, expected one like 192.0.2.1 or 2001:db8::1");
}

uint32_t config_read_addresses(struct config_report *report, const struct config_place *array,
			       const json_t *addresses, char (*out)[MAP_ADDRESS_SIZE])
{
	const json_t *json;
	size_t i;

	json_array_foreach(addresses, i, json)
	{
		const struct config_place place = config_element_of(array, i);

		if (json_is_string(json))
			config_read_address(report, &place, json_string_value(json), out[i]);
		else
			config_error(report, &place, "is not a string, expected an IP address");
	}
	return (uint32_t)json_array_size(addresses);
}
