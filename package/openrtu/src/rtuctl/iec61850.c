/* SPDX-License-Identifier: GPL-3.0-or-later */
/* IEC 61850: associations, report control blocks and their queues, what GOOSE publishes and takes. */
#include "rtuctl/tables.h"

#include <stdio.h>
#include <string.h>

#include <jansson.h>

#include "goose/stats.h"
#include "iec61850/kept.h"
#include "map/time_ns.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define TRIES        3

static const struct listing_column association_columns[] = {
    {"peer", "PEER", LISTING_TEXT},
    {"since_s", "SINCE", LISTING_AGE},
    {"associated", "ASSOCIATED", LISTING_TEXT},
    {"pdu", "PDU", LISTING_RIGHT},
    {"certificate", "CERTIFICATE", LISTING_TEXT},
};

static const struct listing_column block_columns[] = {
    {"block", "BLOCK", LISTING_TEXT},
    {"peer", "PEER", LISTING_TEXT},
    {"enabled", "ENABLED", LISTING_TEXT},
    {"sqnum", "SQNUM", LISTING_RIGHT},
};

static const struct listing_column queue_columns[] = {
    {"block", "QUEUE", LISTING_TEXT},     {"peer", "PEER", LISTING_TEXT},
    {"enabled", "ENABLED", LISTING_TEXT}, {"waiting", "WAITING", LISTING_RIGHT},
    {"oldest_s", "OLDEST", LISTING_AGE},  {"overflow", "BUFOVFL", LISTING_TEXT},
    {"kept", "KEPT", LISTING_RIGHT},      {"limit", "LIMIT", LISTING_RIGHT},
};

static const struct listing_column published_columns[] = {
    {"name", "PUBLISHED", LISTING_TEXT},      {"control_block", "CONTROL BLOCK", LISTING_TEXT},
    {"stnum", "STNUM", LISTING_RIGHT},        {"messages", "MESSAGES", LISTING_RIGHT},
    {"to_live_ms", "TO LIVE", LISTING_RIGHT}, {"failures", "FAILURES", LISTING_RIGHT},
};

static const struct listing_column subscribed_columns[] = {
    {"name", "SUBSCRIBED", LISTING_TEXT},
    {"control_block", "CONTROL BLOCK", LISTING_TEXT},
    {"holds", "HOLDS", LISTING_TEXT},
    {"stnum", "STNUM", LISTING_RIGHT},
    {"repeated", "REPEATED", LISTING_RIGHT},
    {"missed", "MISSED", LISTING_RIGHT},
    {"mismatched", "MISMATCHED", LISTING_RIGHT},
    {"expired", "EXPIRED", LISTING_RIGHT},
};

/* The copy that is not being written. False: there is no server, or it writes faster than this reads. */
static bool take_shown(const struct map *map, struct iec61850_shown *out)
{
	const uint32_t module = map_module_of_kind(map, IEC61850_KIND);
	struct iec61850_stats *stats =
	    module == MAP_NONE ? NULL : map_section(map, module, iec61850_section_size(map_config(map)));

	for (int i = 0; stats != NULL && i < TRIES; i++) {
		const uint32_t which = atomic_load(&stats->which);

		*out = stats->shown[which & 1u];
		if (atomic_load(&stats->which) == which)
			return true;
	}
	return false;
}

/* A common name that was cut may end within a character. */
static json_t *certificate_of(const struct iec61850_shown_association *of)
{
	json_t *name = json_stringn(of->certificate, strnlen(of->certificate, sizeof(of->certificate)));

	return name != NULL ? name : json_string("?");
}

static json_t *association_rows(const struct map *map)
{
	struct iec61850_shown shown;
	json_t *rows = json_array();

	if (!map_kind_alive(map, IEC61850_KIND) || !take_shown(map, &shown))
		return rows;
	for (uint32_t i = 0; i < shown.association_count && i < COUNT(shown.associations); i++) {
		const struct iec61850_shown_association *of = &shown.associations[i];

		json_array_append_new(rows,
				      json_pack("{s:s#, s:f, s:b, s:I, s:o}", "peer", of->peer,
						(int)strnlen(of->peer, sizeof(of->peer)), "since_s",
						(double)(map_now_ns() - of->since_ns) / NS_PER_S,
						"associated", (int)of->associated, "pdu", (json_int_t)of->pdu,
						"certificate", certificate_of(of)));
	}
	return rows;
}

static json_t *block_rows(const struct map *map)
{
	struct iec61850_shown shown;
	json_t *rows = json_array();

	if (!map_kind_alive(map, IEC61850_KIND) || !take_shown(map, &shown))
		return rows;
	for (uint32_t i = 0; i < shown.block_count && i < COUNT(shown.blocks); i++) {
		const struct iec61850_shown_block *of = &shown.blocks[i];

		json_array_append_new(rows, json_pack("{s:s#, s:s#, s:b, s:i}", "block", of->name,
						      (int)strnlen(of->name, sizeof(of->name)), "peer",
						      of->peer, (int)strnlen(of->peer, sizeof(of->peer)),
						      "enabled", (int)of->enabled, "sqnum", of->reports));
	}
	return rows;
}

static json_t *age_of_oldest(const struct iec61850_shown_queue *of)
{
	return of->dated ? json_real((double)(map_now_ns() - of->oldest_ns) / NS_PER_S) : json_null();
}

static json_t *queue_rows(const struct map *map)
{
	struct iec61850_shown shown;
	json_t *rows = json_array();

	if (!take_shown(map, &shown))
		return rows;
	for (uint32_t i = 0; i < shown.queue_count && i < COUNT(shown.queues); i++) {
		const struct iec61850_shown_queue *of = &shown.queues[i];

		json_array_append_new(
		    rows, json_pack("{s:s#, s:s#, s:b, s:I, s:o, s:b, s:I, s:I}", "block", of->name,
				    (int)strnlen(of->name, sizeof(of->name)), "peer", of->peer,
				    (int)strnlen(of->peer, sizeof(of->peer)), "enabled", (int)of->enabled,
				    "waiting", (json_int_t)of->waiting, "oldest_s", age_of_oldest(of),
				    "overflow", (int)of->overflow, "kept", (json_int_t)shown.kept, "limit",
				    (json_int_t)iec61850_settings(map_config(map))->report_buffer));
	}
	return rows;
}

static const struct goose_stats *goose_stats_of(const struct map *map)
{
	const uint32_t module = map_module_of_kind(map, GOOSE_KIND);

	return module == MAP_NONE ? NULL : map_section(map, module, sizeof(struct goose_stats));
}

static json_t *published_rows(const struct map *map)
{
	const struct map_config *config = map_config(map);
	const struct goose_stats *stats = goose_stats_of(map);
	const uint32_t count = stats == NULL ? 0 : map_record_count(config, GOOSE_PUBLICATIONS);
	json_t *rows = json_array();

	for (uint32_t i = 0; i < count; i++) {
		const struct goose_publication *of = &goose_publications(config)[i];
		const struct goose_published *counted = &stats->published[i];

		json_array_append_new(rows, json_pack("{s:s, s:s, s:I, s:I, s:I, s:I}", "name",
						      of->stream.name, "control_block", of->stream.control,
						      "stnum", (json_int_t)counted->states, "messages",
						      (json_int_t)counted->messages, "to_live_ms",
						      (json_int_t)(2 * of->most_ms), "failures",
						      (json_int_t)counted->failures));
	}
	return rows;
}

static json_t *subscribed_rows(const struct map *map)
{
	const struct map_config *config = map_config(map);
	const struct goose_stats *stats = goose_stats_of(map);
	const uint32_t count = stats == NULL ? 0 : map_record_count(config, GOOSE_SUBSCRIPTIONS);
	const bool alive = map_kind_alive(map, GOOSE_KIND);
	json_t *rows = json_array();

	for (uint32_t i = 0; i < count; i++) {
		const struct goose_stream *of = &goose_subscriptions(config)[i].stream;
		const struct goose_subscribed *counted = &stats->subscribed[i];

		json_array_append_new(
		    rows,
		    json_pack("{s:s, s:s, s:b, s:I, s:I, s:I, s:I, s:I}", "name", of->name, "control_block",
			      of->control, "holds", alive && counted->holds != 0, "stnum",
			      (json_int_t)counted->states, "repeated", (json_int_t)counted->repeated,
			      "missed", (json_int_t)counted->missed, "mismatched",
			      (json_int_t)counted->mismatched, "expired", (json_int_t)counted->expired));
	}
	return rows;
}

static const struct table tables[] = {
    {"associations", association_columns, COUNT(association_columns), association_rows},
    {"blocks", block_columns, COUNT(block_columns), block_rows},
    {"queues", queue_columns, COUNT(queue_columns), queue_rows},
    {"published", published_columns, COUNT(published_columns), published_rows},
    {"subscribed", subscribed_columns, COUNT(subscribed_columns), subscribed_rows},
};

int rtuctl_iec61850(struct map *map, const struct rtuctl_request *request)
{
	return tables_print(map, request, tables, COUNT(tables),
			    "associations, blocks, queues, published or subscribed");
}
