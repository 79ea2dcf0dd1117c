/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rows/identity.h"

#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "modbus/config.h"
#include "modbus/stats.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define TEXT_SIZE    (3 * MODBUS_IDENTITY_WORDS)

/* What the device has said, as far as it is whole. */
struct said {
	uint8_t texts[MODBUS_IDENTITY_SIZE];
	size_t size;
	uint32_t state;
};

static struct said look(const struct map *map, uint32_t device)
{
	const struct modbus_identity_stats *stats = modbus_identity_stats(map, device);
	struct said said = {.size = atomic_load_explicit(&stats->size, memory_order_acquire),
			    .state = atomic_load_explicit(&stats->state, memory_order_relaxed)};

	for (size_t i = 0; i < COUNT(stats->texts); i++) {
		const uint32_t word = atomic_load_explicit(&stats->texts[i], memory_order_relaxed);

		memcpy(said.texts + i * sizeof(word), &word, sizeof(word));
	}
	atomic_thread_fence(memory_order_acquire);
	if (said.size > sizeof(said.texts) ||
	    said.size != atomic_load_explicit(&stats->size, memory_order_relaxed))
		said.size = 0;
	return said;
}

static const char *state_name(uint32_t state)
{
	static const char *const names[] = {
	    [MODBUS_IDENTITY_UNASKED] = "not asked yet",
	    [MODBUS_IDENTITY_KNOWN] = "known",
	    [MODBUS_IDENTITY_REFUSED] = "refused",
	    [MODBUS_IDENTITY_SILENT] = "no answer",
	};

	return names[state < COUNT(names) ? state : MODBUS_IDENTITY_UNASKED];
}

static json_t *objects_json(const struct said *said)
{
	json_t *objects = json_object();

	for (uint8_t i = 0; i < MODBUS_IDENTITY_OBJECTS; i++) {
		char text[MODBUS_IDENTITY_WORDS];

		modbus_identity_text(said->texts, said->size, i, text);
		if (text[0] != '\0')
			json_object_set_new(objects, modbus_identity_names[i], json_string(text));
	}
	return objects;
}

/* Maker, product and version, as far as it says them. */
static json_t *words(const struct said *said)
{
	char text[TEXT_SIZE] = "", one[MODBUS_IDENTITY_WORDS];
	size_t used = 0;

	for (uint8_t i = 0; i <= 2; i++) {
		modbus_identity_text(said->texts, said->size, i, one);
		if (one[0] != '\0' && used < sizeof(text))
			used += (size_t)snprintf(text + used, sizeof(text) - used, "%s%s",
						 used > 0 ? " " : "", one);
	}
	return json_string(text);
}

/* Only of one that says something: a device that does not know the function is none that differs. */
static json_t *differences(const struct map_config *config, uint32_t device, const struct said *said)
{
	uint32_t count;
	const struct modbus_expected *expected = modbus_expected_of(config, device, &count);
	json_t *names = json_array();

	for (uint32_t i = 0; said->state == MODBUS_IDENTITY_KNOWN && i < count; i++)
		if (!modbus_identity_is(said->texts, said->size, expected[i].object, expected[i].text))
			json_array_append_new(names, json_string(modbus_identity_names[expected[i].object]));
	return names;
}

void rows_add_identity(json_t *row, const struct map *map, uint32_t device)
{
	const struct map_config *config = map_config(map);
	struct said said = {.size = 0};

	if (modbus_is_asked(config, device))
		said = look(map, device);
	json_object_set_new(row, "identified", words(&said));
	json_object_set_new(row, "identification", objects_json(&said));
	json_object_set_new(row, "identification_state",
			    json_string(modbus_is_asked(config, device) ? state_name(said.state) : "off"));
	json_object_set_new(row, "identification_differs", differences(config, device, &said));
}
