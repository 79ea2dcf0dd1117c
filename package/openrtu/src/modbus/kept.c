/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a line writes by itself (line.h, "What the line writes by itself"). */
#include "map/time_ns.h"
#include "modbus/line_parts.h"

static int64_t next_time_ns(const struct modbus_kept *kept, int64_t now_ns)
{
	return kept->period_ns > 0 ? (now_ns / kept->period_ns + 1) * kept->period_ns : MODBUS_NEVER;
}

const struct modbus_request *modbus_kept_request(const struct modbus_kept *kept)
{
	if (kept->constants != NULL)
		return &kept->constants[kept->next];
	return kept->request.function != 0 ? &kept->request : NULL;
}

void modbus_keep_command(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->command.device];

	for (uint32_t i = 0; i < device->kept_count; i++) {
		struct modbus_kept *kept = &device->kept[i];

		if (kept->constants != NULL || kept->tag != line->command.tag)
			continue;
		kept->request = line->command.request;
		kept->news = true;
		kept->due_ns = next_time_ns(kept, now_ns);
	}
}

/* Those of a device that are not answered share what one may cost the line. */
static int64_t kept_due_ns(const struct modbus_device *device, const struct modbus_kept *kept)
{
	return kept->failures > device->retries ? later(kept->due_ns, device->kept_free_ns) : kept->due_ns;
}

/* It waits for its device as a command does. */
static bool may_be_written(const struct modbus_device *device, const struct modbus_kept *kept, int64_t now_ns)
{
	const struct modbus_request *next = modbus_kept_request(kept);
	struct modbus_request request;

	if (!device->alive || next == NULL || now_ns < kept_due_ns(device, kept))
		return false;
	request = *next;
	modbus_choose_function(device, &request);
	return now_ns >= modbus_surely_ready_ns(device) && !modbus_owes(device, request.function) &&
	       !modbus_may_be_busy(device, now_ns);
}

bool modbus_find_kept(const struct modbus_device *device, int64_t now_ns, uint32_t *found)
{
	int64_t first_ns = MODBUS_NEVER;

	for (uint32_t i = 0; i < device->kept_count; i++) {
		if (device->kept[i].due_ns >= first_ns || !may_be_written(device, &device->kept[i], now_ns))
			continue;
		first_ns = device->kept[i].due_ns;
		*found = i;
	}
	return first_ns != MODBUS_NEVER;
}

int64_t modbus_next_kept_ns(const struct modbus_device *device, int64_t now_ns)
{
	int64_t due_ns = MODBUS_NEVER;

	for (uint32_t i = 0; device->alive && i < device->kept_count; i++) {
		const int64_t one_ns = kept_due_ns(device, &device->kept[i]);

		if (modbus_kept_request(&device->kept[i]) != NULL && one_ns > now_ns)
			due_ns = earlier(due_ns, one_ns);
	}
	return due_ns;
}

/* What was refused for good is refused until the device is back as another one; a period goes on. */
static int64_t refused_until_ns(struct modbus_kept *kept, uint8_t exception, int64_t now_ns)
{
	if (kept->period_ns > 0 || !modbus_is_of_the_moment(exception))
		return next_time_ns(kept, now_ns);
	kept->backoff_ns = modbus_next_backoff(kept->backoff_ns);
	return now_ns + kept->backoff_ns;
}

/* Again and again in vain, it costs the line no more than a dead device would. */
static int64_t silent_until_ns(const struct modbus_line *line, struct modbus_device *device,
			       struct modbus_kept *kept, int64_t now_ns)
{
	int64_t due_ns = next_time_ns(kept, now_ns);

	kept->failures++;
	if (kept->period_ns == 0) {
		kept->backoff_ns = modbus_next_backoff(kept->backoff_ns);
		due_ns = now_ns + kept->backoff_ns;
	}
	if (kept->failures > device->retries)
		device->kept_free_ns = now_ns + (MODBUS_DEAD_SHARE - 1) * (now_ns - begun_ns(line));
	return due_ns;
}

static void tell(struct modbus_line *line, struct modbus_kept *kept, enum modbus_result result,
		 uint8_t exception, int64_t now_ns)
{
	if (kept->result == result && kept->exception == exception)
		return;
	kept->result = result;
	kept->exception = exception;
	if (line->events->kept != NULL)
		line->events->kept(line->context, line->device, kept, now_ns);
}

void modbus_kept_ended(struct modbus_line *line, enum modbus_result result, uint8_t exception, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->device];
	struct modbus_kept *kept = &device->kept[line->kept];

	if (result == MODBUS_REFUSED && exception == MODBUS_ILLEGAL_FUNCTION &&
	    modbus_turn(line, &kept->turned))
		return;
	if (result == MODBUS_DONE) {
		kept->failures = 0;
		kept->backoff_ns = 0;
		kept->due_ns = next_time_ns(kept, begun_ns(line));
		kept->next = kept->next + 1 < kept->constant_count ? kept->next + 1 : 0;
		device->counters.kept++;
	} else {
		kept->due_ns = result == MODBUS_REFUSED ? refused_until_ns(kept, exception, now_ns)
							: silent_until_ns(line, device, kept, now_ns);
		device->counters.kept_failed++;
	}
	tell(line, kept, result, exception, now_ns);
}
