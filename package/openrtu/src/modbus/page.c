/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Reads that a write prepares (line.h, "Pages"). */
#include "modbus/line_parts.h"

struct modbus_request modbus_page_request(const struct modbus_device *device, uint32_t read)
{
	const struct modbus_pages *pages = device->pages;
	struct modbus_request request = {.unit = device->unit,
					 .function = MODBUS_WRITE_REGISTER,
					 .address = pages->address,
					 .count = 1,
					 .values = {pages->values[device->reads[read].page - 1]}};

	modbus_choose_function(device, &request);
	return request;
}

/* What the device says of the register is no word about the addresses that are read behind it. */
void modbus_page_answered(struct modbus_line *line, bool is_exception, uint8_t exception, int64_t now_ns)
{
	struct modbus_pages *pages = line->devices[line->device].pages;

	if (!is_exception) {
		pages->turned = false;
		pages->chosen = line->read + 1;
	} else if (exception != MODBUS_ILLEGAL_FUNCTION || !modbus_turn(line, &pages->turned)) {
		modbus_set_read_aside(line, line->device, line->read, exception, now_ns);
	}
}

bool modbus_find_chosen(const struct modbus_line *line, int64_t now_ns, uint32_t *index)
{
	for (uint32_t i = 0; i < line->device_count; i++) {
		const struct modbus_device *device = &line->devices[i];

		if (device->pages == NULL || device->pages->chosen == 0 || now_ns < modbus_ready_ns(device))
			continue;
		*index = i;
		return true;
	}
	return false;
}
