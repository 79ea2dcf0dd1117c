/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The list of what lines have learned of their devices. */
#include "rtuctl/learned_list.h"
#include "modbus/config.h"
#include "modbus/stats.h"
#include "rows/learned.h"
#include "rows/rows.h"
#include "rtuctl/listing.h"
#include "rtuctl/rtuctl.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const struct listing_column columns[] = {
    {"port", "PORT", LISTING_RIGHT},
    {"id", "ID", LISTING_RIGHT},
    {"latency_least_ms", "LEAST MS", LISTING_RIGHT},
    {"latency_typical_ms", "TYPICAL MS", LISTING_RIGHT},
    {"latency_most_ms", "MOST MS", LISTING_RIGHT},
    {"pause_ms", "PAUSE MS", LISTING_RIGHT},
    {"given_bits", "BITS", LISTING_RIGHT},
    {"given_registers", "REGISTERS", LISTING_RIGHT},
    {"refused", "REFUSED", LISTING_TEXT},
};

static void add_refused(json_t *list, const struct modbus_learned_stats *learned)
{
	char words[LEARNED_WORDS_SIZE];

	if (learned->refused_bits > 0)
		json_array_append_new(list, json_sprintf("%u bits", learned->refused_bits));
	if (learned->refused_registers > 0)
		json_array_append_new(list, json_sprintf("%u registers", learned->refused_registers));
	if (learned->hole_count > 0) {
		learned_objects(learned->hole_function, learned->hole_address, learned->hole_count, words);
		json_array_append_new(list, json_sprintf("hole at %s", words));
	}
	if (learned->lacking_count > 0) {
		learned_objects(learned->lacking_function, learned->lacking_address, 1, words);
		json_array_append_new(list, json_string(words));
	}
	if (learned->lacking_count > 1)
		json_array_append_new(list, json_sprintf("%u other objects", learned->lacking_count - 1));
	if (learned->unclear > 0)
		json_array_append_new(list, json_sprintf("%u reads, unclear why", learned->unclear));
	if (learned->open > 0)
		json_array_append_new(list, json_sprintf("%u reads not answered yet", learned->open));
}

static json_t *refused_text(const struct modbus_learned_stats *learned)
{
	json_t *list = json_array(), *text;

	add_refused(list, learned);
	text = listing_words(list, "; ", "-");
	json_decref(list);
	return text;
}

static json_t *row_of(const struct map *map, uint32_t index)
{
	const struct modbus_learned_stats *learned = &modbus_device_stats(map, index)->learned;
	json_t *row = rows_device(map, index);

	json_object_set_new(row, "given_bits", json_integer(learned->given_bits));
	json_object_set_new(row, "given_registers", json_integer(learned->given_registers));
	json_object_set_new(row, "refused", refused_text(learned));
	return row;
}

void learned_list(const struct map *map)
{
	struct listing listing;

	listing_begin(&listing, columns, COUNT(columns), false);
	for (uint32_t i = 0; i < modbus_slave_count(map_config(map)); i++)
		listing_add(&listing, row_of(map, i));
	listing_end(&listing);
}
