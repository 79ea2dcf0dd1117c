/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/sections.h"

#include <stdlib.h>

bool config_make_room(struct config_report *report, struct map_config *config, uint32_t id,
		      size_t record_size, size_t more)
{
	const uint32_t count = map_record_count(config, id);
	void *before = map_records(config, id, record_size);
	void *records = reallocarray(before, count + more, record_size);

	if (records == NULL) {
		config_out_of_memory(report);
		return false;
	}
	if (before == NULL)
		map_add_section(config, id, record_size, 0, records);
	else
		map_move_section(config, id, records);
	return true;
}
