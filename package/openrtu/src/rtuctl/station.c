/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The controlled station: its connections, its event queues, what it has counted. */
#include "rtuctl/tables.h"

#include <stdio.h>
#include <string.h>

#include <jansson.h>

#include "iec104/config.h"
#include "iec104/counters.h"
#include "map/station.h"
#include "map/time_ns.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const struct listing_column connection_columns[] = {
    {"peer", "PEER", LISTING_TEXT},
    {"queue", "QUEUE", LISTING_TEXT},
    {"since_s", "SINCE", LISTING_AGE},
    {"started", "STARTED", LISTING_TEXT},
    {"ns", "N(S)", LISTING_RIGHT},
    {"nr", "N(R)", LISTING_RIGHT},
    {"unacknowledged", "UNACKED", LISTING_RIGHT},
    {"k", "K", LISTING_RIGHT},
    {"owed", "OWED", LISTING_RIGHT},
    {"w", "W", LISTING_RIGHT},
};

static const struct listing_column queue_columns[] = {
    {"name", "QUEUE", LISTING_TEXT},       {"group", "GROUP", LISTING_TEXT},
    {"waiting", "WAITING", LISTING_RIGHT}, {"unacknowledged", "UNACKED", LISTING_RIGHT},
    {"lost", "LOST", LISTING_RIGHT},       {"limit", "LIMIT", LISTING_RIGHT},
};

static const struct listing_column counter_columns[] = {
    {"counter", "COUNTER", LISTING_TEXT},
    {"value", "VALUE", LISTING_RIGHT},
};

/* ---- rows, and where they go ------------------------------------------------------------- */

static json_t *queue_name(const struct map *map, uint32_t slot)
{
	struct map_queue queue;

	if (slot >= MAP_QUEUES)
		return json_null();
	map_queue(map, slot, &queue);
	return json_string(queue.name);
}

static json_t *connection_rows(const struct map *map)
{
	const struct iec104_settings *settings = iec104_settings(map_config(map));
	const bool alive = map_kind_alive(map, IEC104_KIND);
	json_t *rows = json_array();

	for (unsigned i = 0; alive && i < IEC104_CONNECTIONS_MAX; i++) {
		struct iec104_shown_connection connection;
		json_t *row;

		if (!iec104_shown_connection(map, i, &connection))
			continue;
		row = json_object();
		json_object_set_new(row, "peer", json_string(connection.peer));
		json_object_set_new(row, "queue", queue_name(map, connection.queue));
		json_object_set_new(row, "since_s",
				    json_real((double)(map_now_ns() - connection.since_ns) / NS_PER_S));
		json_object_set_new(row, "started", json_boolean(connection.started));
		json_object_set_new(row, "ns", json_integer(connection.next_ns));
		json_object_set_new(row, "nr", json_integer(connection.next_nr));
		json_object_set_new(row, "unacknowledged", json_integer(connection.unacknowledged));
		json_object_set_new(row, "k", json_integer(settings->k));
		json_object_set_new(row, "owed", json_integer(connection.owed));
		json_object_set_new(row, "w", json_integer(settings->w));
		json_array_append_new(rows, row);
	}
	return rows;
}

static json_t *queue_rows(const struct map *map)
{
	json_t *rows = json_array();

	for (unsigned slot = 0; slot < MAP_QUEUES; slot++) {
		struct map_queue queue;
		json_t *row;

		map_queue(map, slot, &queue);
		if (queue.name[0] == '\0')
			continue;
		row = json_object();
		json_object_set_new(row, "name", json_string(queue.name));
		json_object_set_new(row, "group", json_boolean(slot < MAP_NAMED_QUEUES_MAX));
		json_object_set_new(row, "waiting", json_integer(queue.waiting));
		json_object_set_new(row, "unacknowledged", json_integer(queue.unacknowledged));
		json_object_set_new(row, "lost", json_integer(queue.lost));
		json_object_set_new(row, "limit", json_integer(queue.limit));
		json_array_append_new(rows, row);
	}
	return rows;
}

static json_t *counter_rows(const struct map *map)
{
	const struct iec104_stats *stats = iec104_stats_of(map);
	json_t *rows = json_array();

	for (unsigned i = 0; i < IEC104_COUNT_OF_COUNTERS; i++)
		json_array_append_new(rows, json_pack("{s:s, s:I}", "counter",
						      iec104_counter_name((enum iec104_counter)i), "value",
						      (json_int_t)stats->counters[i]));
	return rows;
}

static const struct table tables[] = {
    {"connections", connection_columns, COUNT(connection_columns), connection_rows},
    {"queues", queue_columns, COUNT(queue_columns), queue_rows},
    {"counters", counter_columns, COUNT(counter_columns), counter_rows},
};

int rtuctl_iec104(struct map *map, const struct rtuctl_request *request)
{
	return tables_print(map, request, tables, COUNT(tables), "connections, queues or counters");
}
