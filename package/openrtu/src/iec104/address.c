/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Devices with one common address are one station. */
#include "iec104/station_parts.h"

bool iec104_find_device(const struct iec104_station *station, uint16_t ca, uint32_t *device)
{
	for (*device = 0; *device < station->config->set_count; ++*device)
		if (ca == IEC104_CA_BROADCAST || station->config->sets[*device].ca == ca)
			return true;
	return false;
}

uint32_t iec104_next_station(const struct iec104_station *station, uint32_t device)
{
	const struct map_set *devices = station->config->sets;
	uint32_t first;

	do {
		if (++device >= station->config->set_count)
			break;
		for (first = 0; devices[first].ca != devices[device].ca;)
			first++;
	} while (first != device);
	return device;
}

uint32_t iec104_station_end(const struct iec104_station *station, uint32_t device)
{
	const struct map_set *devices = station->config->sets;
	uint32_t last = station->config->set_count - 1;

	while (devices[last].ca != devices[device].ca)
		last--;
	return last + 1;
}
