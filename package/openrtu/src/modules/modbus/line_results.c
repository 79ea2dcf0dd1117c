/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/line_results.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "map/text.h"
#include "map/time_ns.h"
#include "modbus/convert.h"
#include "modbus/text.h"
#include "modules/modbus/passing.h"
#include "modules/modbus/scaling.h"

#define REFUSALS_AT_ONCE   40 /* what a device with a wrong template lacks */
#define REFUSALS_PERIOD_NS (60 * NS_PER_S)
#define MORE_SIZE          40
#define WHAT_SIZE          16

static const struct map_set *device_config(const struct line_results *results, uint32_t device)
{
	return &map_config(results->map)->sets[results->config->first_device + device];
}

static const struct modbus_slave *slave_config(const struct line_results *results, uint32_t device)
{
	return &modbus_slaves(map_config(results->map))[results->config->first_device + device];
}

/* results->updates, so many of them */
static void publish(struct line_results *results, const struct map_set *device, size_t count, int64_t now_ns)
{
	count = quality_complete(results->quality, device, results->updates, count, now_ns);
	map_publish(results->map, results->updates, count);
}

static uint16_t raw_word(const struct modbus_read *read, const uint8_t *data, uint32_t index)
{
	if (index >= read->count)
		return 0;
	return modbus_is_bit_function(read->function) ? modbus_bit(data, (uint16_t)index)
						      : modbus_register(data, (uint16_t)index);
}

static void take_raw(const struct modbus_read *read, const uint8_t *data, const struct modbus_point *point,
		     uint16_t raw[CONVERT_WIDTH_MAX])
{
	for (uint32_t i = 0; i < point->width; i++)
		raw[i] = raw_word(read, data, modbus_point_address(point, i) - read->address);
}

/* Keeps the power of ten for a command that comes before the next read. */
static int8_t take_exponent(struct line_results *results, const struct modbus_read *read, const uint8_t *data,
			    uint32_t number)
{
	const struct modbus_point *point = &results->points[number];

	if (modbus_has_scale_register(point))
		results->exponents[number] = convert_exponent(
		    point, raw_word(read, data, (uint32_t)point->second_address - read->address));
	return results->exponents[number];
}

/* The device may be another one when it is read again. */
static void forget_exponent(struct line_results *results, uint32_t number)
{
	results->exponents[number] = convert_first_exponent(&results->points[number]);
}

static void say_well(struct line_results *results, uint32_t device, const char *again)
{
	map_log(results->map, MAP_LOG_INFO, "%s: unit %u on port %u answers%s",
		device_config(results, device)->name, slave_config(results, device)->unit,
		results->config->port, again);
}

/* It answers what it is asked, and in time. */
static void note_answer(struct line_results *results, uint32_t device, int64_t now_ns)
{
	struct line_news *news = &results->news[device];
	char text[MAP_TROUBLE_SIZE];

	news->is_late = false;
	news->stranger = LINE_NEWS_NOBODY;
	news->is_misfit = false;
	if (map_trouble_well(&news->death, now_ns))
		say_well(results, device, map_trouble_ended(&news->death, now_ns, text));
}

/* Whole, as each read of the plan has its objects. */
static void take_text(struct line_results *results, const struct modbus_read *read, const uint8_t *data,
		      struct map_update *update)
{
	const struct modbus_point *config = &results->points[update->point];
	char text[MAP_TEXT_SIZE];

	modbus_text(config, data + 2 * (size_t)(config->address - read->address), text);
	update->sample.value = map_text_put(results->map, update->point, text);
}

static void take_object(struct line_results *results, const struct modbus_read *read, const uint8_t *data,
			uint32_t point, struct map_update *update)
{
	const struct modbus_point *config = &results->points[point];
	const int8_t exponent = take_exponent(results, read, data, point);
	uint16_t raw[CONVERT_WIDTH_MAX] = {0};

	update->point = point;
	if (modbus_is_text(config)) {
		take_text(results, read, data, update);
		return;
	}
	update->cause = (uint8_t)commands_cause(results->commands, point);
	update->flags = modbus_counts_16_bits(config) ? MAP_UPDATE_NARROW : 0;
	take_raw(read, data, config, raw);
	convert_to_sample(config, modbus_knots(map_config(results->map)), exponent, raw, &update->sample);
}

/* Once all that was read with it is there. */
static void scale_by_others(const struct line_results *results, const struct modbus_read *read,
			    const uint8_t *data, struct map_update *update)
{
	struct modbus_point wire = results->points[update->point];
	const int8_t exponent = scaling_apply(results->map, update->point, results->exponents[update->point],
					      &wire, (struct scaling_read){results->updates, read->objects});
	uint16_t raw[CONVERT_WIDTH_MAX] = {0};

	take_raw(read, data, &wire, raw);
	convert_to_sample(&wire, modbus_knots(map_config(results->map)), exponent, raw, &update->sample);
}

static void take_objects(struct line_results *results, uint32_t device, const struct modbus_read *read,
			 const uint8_t *data, int64_t now_ns)
{
	const struct modbus_object *objects = &results->line->devices[device].objects[read->first];

	for (uint32_t i = 0; i < read->objects; i++) {
		results->updates[i] = (struct map_update){.sample = {.time_ns = now_ns}};
		take_object(results, read, data, objects[i].tag, &results->updates[i]);
	}
	for (uint32_t i = 0; i < read->objects; i++)
		if (scaling_is_by_others(map_config(results->map), &results->points[objects[i].tag]))
			scale_by_others(results, read, data, &results->updates[i]);
}

static void publish_read(void *context, uint32_t device, const struct modbus_read *read, const uint8_t *data,
			 int64_t now_ns)
{
	struct line_results *results = context;

	note_answer(results, device, now_ns);
	take_objects(results, device, read, data, now_ns);
	publish(results, device_config(results, device), read->objects, now_ns);
	for (uint32_t i = 0; i < read->objects; i++)
		commands_published(results->commands, results->updates[i].point);
}

/* A device that gives things and refuses them in turn says so without end. False: the log takes no line now. */
static bool take_line(struct line_results *results, uint32_t device, int64_t now_ns, char more[MORE_SIZE])
{
	static const struct map_pace pace = {REFUSALS_PERIOD_NS, REFUSALS_AT_ONCE};
	struct map_lines *lines = &results->news[device].refusals;

	more[0] = '\0';
	if (!map_lines_take(lines, pace, now_ns))
		return false;
	if (lines->withheld > 0)
		snprintf(more, MORE_SIZE, "; %" PRIu32 " more since the last line", lines->withheld);
	lines->withheld = 0;
	return true;
}

/* exception 0: it is silent. Returns what. */
static const char *refusal(uint8_t exception, char what[WHAT_SIZE])
{
	if (exception == 0)
		return "no answer";
	snprintf(what, WHAT_SIZE, "exception %u", exception);
	return what;
}

static void say_refused(struct line_results *results, uint32_t device, const struct modbus_read *read,
			uint8_t exception, int64_t now_ns)
{
	char more[MORE_SIZE], what[WHAT_SIZE];

	if (take_line(results, device, now_ns, more))
		map_log(results->map, MAP_LOG_WARNING, "%s: %s to function %u, address %u%s",
			device_config(results, device)->name, refusal(exception, what), read->function,
			read->address, more);
}

static void lose_read(void *context, uint32_t device, const struct modbus_read *read, uint8_t exception,
		      int64_t now_ns)
{
	struct line_results *results = context;
	/* What was read before may be old, and not wrong. */
	enum map_quality quality = modbus_is_of_the_moment(exception) ? MAP_NOT_TOPICAL : MAP_INVALID;

	for (uint32_t i = 0; i < read->objects; i++)
		results->updates[i] = quality_lost(
		    results->quality, results->line->devices[device].objects[read->first + i].tag, quality,
		    now_ns);
	publish(results, device_config(results, device), read->objects, now_ns);
	say_refused(results, device, read, exception, now_ns);
}

static void invalidate_device(struct line_results *results, const struct map_set *device, int64_t now_ns)
{
	size_t count = 0;

	for (uint32_t i = 0; i < device->point_count; i++) {
		const uint32_t point = device->first_point + i;

		forget_exponent(results, point);
		if (!(map_config(results->map)->points[point].flags & MAP_POINT_NEVER_READ))
			results->updates[count++] =
			    quality_lost(results->quality, point, MAP_INVALID, now_ns);
	}
	publish(results, device, count, now_ns);
}

bool line_results_vouch(const struct line_results *results, uint32_t device)
{
	const struct map_set *config = device_config(results, device);

	for (uint32_t i = config->first_point; i < config->first_point + config->point_count; i++)
		if (!(map_config(results->map)->points[i].flags & MAP_POINT_NEVER_READ) &&
		    !(map_own_sample(results->map, i).quality & MAP_INVALID))
			return true;
	return false;
}

/* ---- after a silence ------------------------------------------------------------------- */

void line_results_note_scan(struct line_results *results, int64_t from_ns, int64_t to_ns)
{
	const int64_t took_ns = results->line->counters.scan_us * NS_PER_US;
	const int64_t began_ns = results->line->whole_scan_began_ns;

	if (began_ns >= from_ns && began_ns + took_ns <= to_ns)
		results->scan_ns = took_ns;
}

static bool is_old(const struct line_results *results, const struct modbus_object *object, int64_t now_ns)
{
	const struct map_sample sample = map_own_sample(results->map, object->tag);
	const int64_t turn_ns = object->period_ms > 0 ? object->period_ms * NS_PER_MS : results->scan_ns;
	const int64_t silence_ns = map_heartbeat_limit_ms(results->map, map_self(results->map)) * NS_PER_MS;

	return !(sample.quality & (MAP_INVALID | MAP_NOT_TOPICAL)) &&
	       now_ns - sample.time_ns > 2 * turn_ns + silence_ns;
}

/* results->updates: what is told of the old ones. How many they are. */
static size_t find_old(const struct line_results *results, const struct modbus_device *device, int64_t now_ns)
{
	size_t count = 0;

	for (uint32_t i = 0; i < device->object_count; i++)
		if (is_old(results, &device->objects[i], now_ns))
			results->updates[count++] =
			    quality_lost(results->quality, device->objects[i].tag, MAP_NOT_TOPICAL, now_ns);
	return count;
}

bool line_results_are_old(const struct line_results *results, int64_t now_ns)
{
	for (uint32_t i = 0; i < results->line->device_count; i++)
		if (find_old(results, &results->line->devices[i], now_ns) > 0)
			return true;
	return false;
}

void line_results_give_up_old(struct line_results *results, int64_t now_ns)
{
	for (uint32_t i = 0; i < results->line->device_count; i++) {
		const size_t count = find_old(results, &results->line->devices[i], now_ns);

		if (count > 0)
			publish(results, device_config(results, i), count, now_ns);
	}
}

/* ---- devices --------------------------------------------------------------------------- */

static void device_changed(void *context, uint32_t device, bool alive, int64_t now_ns)
{
	struct line_results *results = context;
	const struct map_set *config = device_config(results, device);
	struct line_news *news = &results->news[device];
	char text[MAP_TROUBLE_SIZE];

	if (!alive)
		invalidate_device(results, config, now_ns);
	commands_device_changed(results->commands, results->config->first_device + device, alive, now_ns);
	if (!alive && map_trouble_failed(&news->death, "", now_ns))
		map_log(results->map, MAP_LOG_WARNING, "%s: unit %u on port %u is dead%s", config->name,
			slave_config(results, device)->unit, results->config->port,
			map_trouble_times(&news->death, now_ns, text));
	if (alive && !news->death.is)
		say_well(results, device, "");
}

/* What an engineer asks who has just connected it. */
static void say_mute(void *context, uint32_t device)
{
	struct line_results *results = context;
	const struct modbus_slave *slave = slave_config(results, device);

	map_log(results->map, MAP_LOG_WARNING, "%s: unit %u on port %u has never answered within %u ms",
		device_config(results, device)->name, slave->unit, results->config->port,
		slave->response_timeout_ms);
}

/* Said once until it answers in time, and less and less often of one that does so now and then. */
static void say_late(void *context, uint32_t device, int64_t latency_ns, int64_t now_ns)
{
	struct line_results *results = context;
	struct line_news *news = &results->news[device];
	const struct modbus_slave *slave = slave_config(results, device);

	if (latency_ns <= slave->response_timeout_ms * NS_PER_MS || news->is_late)
		return;
	news->is_late = true;
	if (map_repeats_happened(&news->late, 1, now_ns) > 0)
		map_log(results->map, MAP_LOG_WARNING,
			"%s: unit %u answers after %u ms, response_timeout_ms is %u",
			device_config(results, device)->name, slave->unit,
			(unsigned)((latency_ns + NS_PER_MS - 1) / NS_PER_MS), slave->response_timeout_ms);
}

static void say_pause(void *context, uint32_t device, int64_t pause_ns, int64_t now_ns)
{
	struct line_results *results = context;

	if (map_repeats_happened(&results->news[device].pauses, 1, now_ns) > 0)
		map_log(results->map, MAP_LOG_WARNING,
			"%s: unit %u on port %u needs a pause of %u ms behind its answers, pause_ms is %u",
			device_config(results, device)->name, slave_config(results, device)->unit,
			results->config->port, (unsigned)((pause_ns + NS_PER_MS - 1) / NS_PER_MS),
			slave_config(results, device)->pause_ms);
}

static void say_turned(void *context, uint32_t device, uint8_t unknown, uint8_t function, int64_t now_ns)
{
	struct line_results *results = context;

	if (map_repeats_happened(&results->news[device].turns, 1, now_ns) > 0)
		map_log(
		    results->map, MAP_LOG_WARNING,
		    "%s: unit %u on port %u does not know function %u (exception 1), it is written with %u",
		    device_config(results, device)->name, slave_config(results, device)->unit,
		    results->config->port, unknown, function);
}

static void say_kept(void *context, uint32_t device, const struct modbus_kept *kept, int64_t now_ns)
{
	struct line_results *results = context;
	const struct map_config *config = map_config(results->map);
	char name[MAP_NAME_SIZE], more[MORE_SIZE], what[WHAT_SIZE];

	if (!take_line(results, device, now_ns, more))
		return;
	map_point_name(config, &config->points[kept->tag], name);
	if (kept->result == MODBUS_DONE)
		map_log(results->map, MAP_LOG_INFO, "%s: takes what the gateway itself writes to %s again%s",
			device_config(results, device)->name, name, more);
	else
		map_log(results->map, MAP_LOG_WARNING, "%s: %s to what the gateway itself writes to %s%s",
			device_config(results, device)->name, refusal(kept->exception, what), name, more);
}

static void say_stranger(void *context, uint32_t device, uint8_t unit, int64_t now_ns)
{
	struct line_results *results = context;
	struct line_news *news = &results->news[device];

	if (news->stranger == unit)
		return;
	news->stranger = unit;
	if (map_repeats_happened(&news->strangers, 1, now_ns) > 0)
		map_log(results->map, MAP_LOG_WARNING,
			"%s: unit %u was asked on port %u, and unit %u answers",
			device_config(results, device)->name, slave_config(results, device)->unit,
			results->config->port, unit);
}

/* Said once, and again when it differs in others: which texts it has, rtuctl lines says. */
static void say_other_identity(void *context, uint32_t device)
{
	struct line_results *results = context;
	const struct modbus_identity *identity = results->line->devices[device].identity;
	uint32_t count;
	const struct modbus_expected *expected =
	    modbus_expected_of(map_config(results->map), results->config->first_device + device, &count);
	char names[MODBUS_IDENTITY_OBJECTS * MAP_NAME_SIZE] = "";
	uint8_t differs = 0;

	for (uint32_t i = 0; i < count; i++) {
		if (modbus_identity_is(identity->texts, identity->size, expected[i].object, expected[i].text))
			continue;
		snprintf(names + strlen(names), sizeof(names) - strlen(names), "%s%s",
			 differs == 0 ? "" : ", ", modbus_identity_names[expected[i].object]);
		differs |= (uint8_t)(1u << expected[i].object);
	}
	if (differs != 0 && differs != results->news[device].differs)
		map_log(results->map, MAP_LOG_WARNING,
			"%s: unit %u on port %u is not what its identification says: %s differ",
			device_config(results, device)->name, slave_config(results, device)->unit,
			results->config->port, names);
	results->news[device].differs = differs;
}

static void say_misfit(void *context, uint32_t device, size_t length, size_t expected, int64_t now_ns)
{
	struct line_results *results = context;
	struct line_news *news = &results->news[device];

	if (news->is_misfit)
		return;
	news->is_misfit = true;
	if (map_repeats_happened(&news->misfits, 1, now_ns) > 0)
		map_log(results->map, MAP_LOG_WARNING,
			"%s: unit %u on port %u answers with %zu octets of data, and %zu were asked for",
			device_config(results, device)->name, slave_config(results, device)->unit,
			results->config->port, length, expected);
}

static void take_command_answer(void *context, const struct modbus_command *command,
				enum modbus_result result, uint8_t exception)
{
	struct line_results *results = context;

	commands_answered(results->commands, command->tag, result, exception, map_now_ns());
}

static void end_passing(void *context, const struct modbus_passed *passed, enum modbus_result result,
			const uint8_t *body, size_t length, int64_t now_ns)
{
	const struct line_results *results = context;

	passing_ended(results->passing, passed, result, body, length, now_ns);
}

const struct modbus_events line_results_events = {.read = publish_read,
						  .refused = lose_read,
						  .alive = device_changed,
						  .command = take_command_answer,
						  .mute = say_mute,
						  .late = say_late,
						  .pause = say_pause,
						  .turned = say_turned,
						  .kept = say_kept,
						  .passed = end_passing,
						  .stranger = say_stranger,
						  .identified = say_other_identity,
						  .misfit = say_misfit};
