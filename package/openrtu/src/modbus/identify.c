/* SPDX-License-Identifier: GPL-3.0-or-later */
/* When a line asks its devices what they are (line.h, "What a device is"). */
#include "line_parts.h"
#include "map/time_ns.h"

int64_t modbus_identify_timeout(const struct modbus_device *device)
{
	return earlier(2 * modbus_timeout(device), device->response_timeout_ns);
}

static bool is_read_once(const struct modbus_device *device)
{
	for (uint32_t i = 0; i < device->read_count; i++)
		if (!device->reads[i].given && device->reads[i].pause_ns == 0)
			return false;
	return true;
}

/* Until the longest answer has come whose beginning is waited for until the last. */
static int64_t longest_ns(const struct modbus_line *line, const struct modbus_device *device)
{
	return modbus_vain_probe_ns(&line->wire, modbus_identify_timeout(device)) +
	       MODBUS_FRAME_MAX * line->wire.char_ns + line->wire.gap_ns;
}

static bool becomes_due(const struct modbus_device *device, int64_t until_ns)
{
	for (uint32_t i = 0; device->alive && i < device->read_count; i++)
		if (device->reads[i].period_ns > 0 && device->reads[i].due_ns < until_ns &&
		    device->reads[i].not_before_ns < until_ns)
			return true;
	return false;
}

bool modbus_is_room(const struct modbus_line *line, int64_t until_ns)
{
	for (uint32_t i = 0; i < line->device_count; i++)
		if (becomes_due(&line->devices[i], until_ns))
			return false;
	return true;
}

static bool is_to_be_asked(const struct modbus_device *device)
{
	return device->identity != NULL && device->alive && modbus_identity_is_wanted(device->identity);
}

bool modbus_may_identify(const struct modbus_line *line, const struct modbus_device *device, int64_t now_ns)
{
	return is_to_be_asked(device) && now_ns >= line->identify_free_ns &&
	       now_ns >= modbus_surely_ready_ns(device) && device->unanswered_count == 0 &&
	       !device->inherited && is_read_once(device) &&
	       modbus_is_room(line, now_ns + longest_ns(line, device));
}

int64_t modbus_next_identify_ns(const struct modbus_line *line, const struct modbus_device *device,
				int64_t now_ns)
{
	const int64_t may_ns = later(line->identify_free_ns, modbus_surely_ready_ns(device));

	return is_to_be_asked(device) && may_ns > now_ns ? may_ns : MODBUS_NEVER;
}

void modbus_identify_answered(struct modbus_line *line, const uint8_t *body, bool is_exception,
			      int64_t now_ns)
{
	struct modbus_identity *identity = line->devices[line->device].identity;

	line->identify_free_ns = now_ns + (MODBUS_DEAD_SHARE - 1) * (now_ns - begun_ns(line));
	if (body == NULL)
		modbus_identity_unanswered(identity);
	else if (is_exception)
		modbus_identity_refused(identity, body[2]);
	else
		modbus_identity_answered(identity, body);
	if (identity->state == MODBUS_IDENTITY_KNOWN && line->events->identified != NULL)
		line->events->identified(line->context, line->device);
}
