/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * `journal-events FILE`: the events of a journal on the desk, a line for each in the order of the file: nanoseconds since
 * 1970, CA, IOA, type, number, quality in hexadecimal digits. openrtu logic starts it. A record that is torn ends it, as at rtud.
 */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "journal/record.h"
#include "map/type.h"

static double number_of(const struct journal_event *event)
{
	enum map_class class = map_types[event->type].class;
	union map_value value = {.u = event->value};

	return class == MAP_CLASS_STATE || class == MAP_CLASS_PATTERN ? value.u
								      : map_number(event->type, value);
}

static void print_record(const struct journal_record *record)
{
	for (uint32_t i = 0; i < record->event_count; i++) {
		struct journal_event event = journal_event(record, i);

		if (event.type < MAP_TYPES && event.cause <= JOURNAL_RETAINED)
			printf("%" PRId64 " %u %" PRIu32 " %s %.17g %x\n", event.wall_ns, event.ca, event.ioa,
			       map_type_names[event.type], number_of(&event), event.quality);
	}
}

int main(int argc, char **argv)
{
	FILE *file = argc == 2 ? fopen(argv[1], "rb") : NULL;
	uint8_t *bytes = malloc(JOURNAL_FILE_MAX);
	struct journal_record record;
	size_t size, at = 0;
	uint32_t records = 0;

	if (argc != 2)
		fputs("usage: journal-events FILE\nopenrtu logic run starts it; see docs/logic.md\n", stderr);
	else if (!file || !bytes)
		fprintf(stderr, "journal-events: %s: %s\n", argv[1], strerror(errno));
	if (!file || !bytes) {
		free(bytes);
		return 2;
	}
	size = fread(bytes, 1, JOURNAL_FILE_MAX, file);
	fclose(file);
	for (; journal_parse(bytes + at, size - at, records, &record); records++) {
		print_record(&record);
		at += record.size;
	}
	if (at < size)
		fprintf(stderr, "journal-events: %s: octet %zu begins no record: what follows is left out\n",
			argv[1], at);
	free(bytes);
	return records > 0 ? 0 : 1;
}
