/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec104m/values.h"

#include <stdlib.h>

#include "map/time_ns.h"

#define QUALITY_MASK (MAP_OVERFLOW | MAP_BLOCKED | MAP_SUBSTITUTED | MAP_NOT_TOPICAL | MAP_INVALID)
#define AHEAD_NS     (5 * NS_PER_S)                         /* clocks that are set differ by less */
#define BEHIND_NS    (MAP_PAST_DAYS * S_PER_DAY * NS_PER_S) /* of what an outstation has kept for us */

/* ---- which point ------------------------------------------------------------------------- */

static int compare(const void *a, const void *b)
{
	const struct values_entry *one = a, *other = b;

	if (one->ca != other->ca)
		return one->ca < other->ca ? -1 : 1;
	return (one->ioa > other->ioa) - (one->ioa < other->ioa);
}

static void add_set(struct values *values, const struct map_set *set, const struct iec104_outstation_set *of)
{
	const struct iec104_outstation_point *points =
	    iec104_outstation_points(map_config(values->map)) + of->first_point;

	for (uint32_t i = 0; i < set->point_count; i++)
		values->entries[values->count++] = (struct values_entry){.ca = of->ca,
									 .ioa = points[i].ioa,
									 .point = set->first_point + i,
									 .command_ioa = points[i].command_ioa,
									 .select = points[i].select};
}

bool values_init(struct values *values, struct map *map, const struct iec104_outstation *outstation,
		 struct iec104_outstation_stats *stats)
{
	const struct map_config *config = map_config(map);
	const struct iec104_outstation_set *sets = iec104_outstation_sets(config) + outstation->first_set;
	uint32_t count = 0;

	*values = (struct values){.map = map, .stats = stats};
	for (uint32_t i = 0; i < outstation->set_count; i++)
		count += config->sets[sets[i].set].point_count;
	values->entries = calloc(count + 1U, sizeof(*values->entries));
	if (values->entries == NULL)
		return false;
	for (uint32_t i = 0; i < outstation->set_count; i++)
		add_set(values, &config->sets[sets[i].set], &sets[i]);
	qsort(values->entries, values->count, sizeof(*values->entries), compare);
	return true;
}

void values_free(struct values *values)
{
	free(values->entries);
}

const struct values_entry *values_find(const struct values *values, uint16_t ca, uint32_t ioa)
{
	const struct values_entry wanted = {.ca = ca, .ioa = ioa};

	return bsearch(&wanted, values->entries, values->count, sizeof(wanted), compare);
}

/* A command is rare: no second table for it. */
const struct values_entry *values_of_point(const struct values *values, uint32_t point)
{
	for (uint32_t i = 0; i < values->count; i++)
		if (values->entries[i].point == point)
			return &values->entries[i];
	return NULL;
}

/* ---- what it says ------------------------------------------------------------------------ */

/* The type of the points that take it. Protection says more than a point holds: its states alone are kept. */
static int type_of(enum iec104_content content)
{
	switch (content) {
	case IEC104_SINGLE:
		return MAP_SINGLE;
	case IEC104_DOUBLE:
	case IEC104_PROTECTION_EVENT:
		return MAP_DOUBLE;
	case IEC104_STEP:
		return MAP_STEP;
	case IEC104_BITS:
	case IEC104_PROTECTION_START:
	case IEC104_PROTECTION_OUTPUT:
	case IEC104_PACKED_SINGLES:
		return MAP_BITSTRING;
	case IEC104_NORMALIZED:
		return MAP_NORMALIZED;
	case IEC104_SCALED:
		return MAP_SCALED;
	case IEC104_FLOAT:
		return MAP_FLOAT;
	case IEC104_TOTAL:
		return MAP_COUNTER;
	case IEC104_INITIALISATION:
		break;
	}
	return -1;
}

/* Its own time tag, if that can be; else when it came. */
static int64_t moment_of(struct values *values, const struct iec104_information *information, int64_t now_ns,
			 struct map_clock clock)
{
	int64_t moment_ns = information->wall_ns - clock.offset_ns;

	if (!information->tagged || information->time_invalid)
		return now_ns;
	if (moment_ns > now_ns + AHEAD_NS || moment_ns <= now_ns - BEHIND_NS) {
		map_count(&values->stats->untimely, 1);
		return now_ns;
	}
	return earlier(moment_ns, now_ns);
}

/* Who says that something has happened means an event; what was asked for is one only if it is news. */
static enum map_event_rule rule_of(const struct iec104_asdu *asdu)
{
	switch (asdu->cause) {
	case IEC104_SPONTANEOUS:
	case IEC104_RETURN_REMOTE:
	case IEC104_RETURN_LOCAL:
		return MAP_EVENT_ALWAYS;
	default:
		return MAP_EVENT_BY_CHANGE;
	}
}

/* A point is once in what is published together, and all of that is of one set. */
static void make_room(struct values *values, const struct values_entry *entry)
{
	const struct map_point *points = map_config(values->map)->points;

	if (values->update_count > 0 &&
	    (values->update_count == VALUES_AT_ONCE || entry->batch == values->batch ||
	     points[values->updates[0].point].set != points[entry->point].set))
		values_publish(values);
	if (values->update_count == 0)
		values->batch++;
}

void values_take(struct values *values, const struct iec104_asdu *asdu,
		 const struct iec104_information *information, enum map_cause cause, int64_t now_ns,
		 struct map_clock clock)
{
	struct values_entry *entry = (struct values_entry *)values_find(values, asdu->ca, information->ioa);

	if (entry == NULL) {
		map_count(&values->stats->unmapped, 1);
		return;
	}
	if (type_of(information->content) != map_config(values->map)->points[entry->point].type) {
		map_count(&values->stats->mistyped, 1);
		return;
	}
	make_room(values, entry);
	entry->batch = values->batch;
	values->updates[values->update_count++] =
	    (struct map_update){.point = entry->point,
				.cause = (uint8_t)cause,
				.event_rule = (uint8_t)rule_of(asdu),
				.sample = {.value = information->value,
					   .quality = information->quality & QUALITY_MASK,
					   .detail = information->detail,
					   .time_ns = moment_of(values, information, now_ns, clock)}};
	map_count(&values->stats->objects, 1);
}

void values_publish(struct values *values)
{
	map_publish(values->map, values->updates, values->update_count);
	values->update_count = 0;
}

void values_invalidate(struct values *values, int64_t now_ns)
{
	values_publish(values);
	for (uint32_t i = 0; i < values->count; i++) {
		struct values_entry *entry = &values->entries[i];
		const struct map_sample last = map_own_sample(values->map, entry->point);

		make_room(values, entry);
		entry->batch = values->batch;
		values->updates[values->update_count++] =
		    (struct map_update){.point = entry->point,
					.flags = MAP_UPDATE_KEEPS_VALUE,
					.event_rule = MAP_EVENT_BY_QUALITY,
					.sample = {.quality = last.quality | MAP_INVALID, .time_ns = now_ns}};
	}
	values_publish(values);
}
