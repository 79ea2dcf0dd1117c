/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec104m/values.h"

#include <stdlib.h>

#include "map/time_ns.h"

#define IOA_MASK      0xffffffu
#define ALTITUDE_NONE (-8388608) /* with OV: it is not known */
#define NIBBLE        0x0fu
#define DM_PER_M      10.0f
#define AHEAD_NS      (5 * NS_PER_S)                         /* clocks that are set differ by less */
#define BEHIND_NS     (MAP_PAST_DAYS * S_PER_DAY * NS_PER_S) /* of what an outstation has kept for us */

/* ---- which point ------------------------------------------------------------------------- */

/* The points of a position stay together, in their order. */
static int compare(const void *a, const void *b)
{
	const struct values_entry *one = a, *other = b;
	const uint32_t of_one = one->ioa & IOA_MASK, of_other = other->ioa & IOA_MASK;

	if (one->ca != other->ca)
		return one->ca < other->ca ? -1 : 1;
	if (of_one != of_other)
		return of_one < of_other ? -1 : 1;
	return (one->ioa > other->ioa) - (one->ioa < other->ioa);
}

static void add_set(struct values *values, const struct map_set *set, const struct iec104_outstation_set *of)
{
	const struct iec104_outstation_point *points =
	    iec104_outstation_points(map_config(values->map)) + of->first_point;

	for (uint32_t i = 0; i < set->point_count; i++)
		values->entries[values->count++] = (struct values_entry){
		    .ca = of->ca,
		    .ioa = points[i].ioa,
		    .point = set->first_point + i,
		    .command_ioa = points[i].command_ioa,
		    .select = points[i].select,
		    .known_ns = map_own_sample(values->map, set->first_point + i).time_ns};
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

bool values_hold(const struct values *values)
{
	for (uint32_t i = 0; i < values->count; i++)
		if ((map_own_sample(values->map, values->entries[i].point).quality & MAP_INVALID) == 0)
			return true;
	return false;
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

/* Of its own time tag, which is true if that can be; else of when it came. */
struct tag {
	int64_t at_ns;
	bool true_time;
};

static struct tag tag_of(struct values *values, bool tagged, int64_t wall_ns,
			 const struct values_moment *moment)
{
	const int64_t at_ns = wall_ns - moment->clock.offset_ns, now_ns = moment->now_ns;

	if (!tagged)
		return (struct tag){now_ns, false};
	if (at_ns > now_ns + AHEAD_NS || at_ns <= now_ns - BEHIND_NS) {
		map_count(&values->stats->untimely, 1);
		return (struct tag){now_ns, false};
	}
	return (struct tag){earlier(at_ns, now_ns), true};
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

/*
 * True: it is an event of before what the map has of the point, as one that its station had kept. Tags are of whole milliseconds.
 * Otherwise it is what is known from now on: since its tag, or since it was asked for.
 */
static bool is_of_before(struct values_entry *entry, enum map_event_rule rule, const struct tag *tag,
			 const struct values_moment *moment)
{
	if (rule != MAP_EVENT_ALWAYS)
		entry->known_ns = later(entry->known_ns, moment->asked_ns);
	else if (tag->true_time && tag->at_ns + NS_PER_MS <= entry->known_ns)
		return true;
	else
		entry->known_ns = later(entry->known_ns, tag->at_ns);
	return false;
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

static bool differs(const struct values *values, uint32_t point, const struct map_sample *sample)
{
	const struct map_sample is = map_own_sample(values->map, point);

	return is.quality != sample->quality || is.value.u != sample->value.u;
}

bool values_take(struct values *values, const struct iec104_asdu *asdu,
		 const struct iec104_information *information, enum map_cause cause,
		 const struct values_moment *moment)
{
	struct values_entry *entry = (struct values_entry *)values_find(values, asdu->ca, information->ioa);
	const enum map_event_rule rule = rule_of(asdu);
	struct map_update *update;
	struct tag tag;

	if (entry == NULL) {
		map_count(&values->stats->unmapped, 1);
		return true;
	}
	if (type_of(information->content) != map_config(values->map)->points[entry->point].type ||
	    (map_config(values->map)->points[entry->point].flags & MAP_POINT_POSITION) != 0) {
		map_count(&values->stats->mistyped, 1);
		return true;
	}
	make_room(values, entry);
	entry->batch = values->batch;
	tag = tag_of(values, information->tagged && !information->time_invalid, information->wall_ns, moment);
	update = &values->updates[values->update_count++];
	*update = (struct map_update){.point = entry->point,
				      .cause = (uint8_t)cause,
				      .event_rule = (uint8_t)rule,
				      .sample = {.value = information->value,
						 .quality = information->quality & MAP_QUALITY_BITS,
						 .detail = information->detail,
						 .time_ns = tag.at_ns}};
	map_count(&values->stats->objects, 1);
	if (!is_of_before(entry, rule, &tag, moment))
		return true;
	update->flags = MAP_UPDATE_PAST;
	map_count(&values->stats->past, 1);
	return !differs(values, entry->point, &update->sample);
}

/* The samples of the points of a position. The altitude that is not known is invalid, and so is all but the altitude in range. */
static void samples_of(const struct iec104_geoposition *position, int64_t time_ns,
		       struct map_sample out[IEC104_OUTSTATION_POSITION_POINTS])
{
	const uint8_t quality = position->quality & MAP_QUALITY_BITS,
		      exact = quality & (uint8_t)~MAP_OVERFLOW;
	const bool unknown = position->altitude_dm == ALTITUDE_NONE && (quality & MAP_OVERFLOW) != 0;
	const uint32_t fix = (position->fix & NIBBLE) | (position->satellites & NIBBLE) << 4;

	out[0] = (struct map_sample){.value.u = fix, .quality = exact, .time_ns = time_ns};
	out[1] = (struct map_sample){.value.i = position->latitude, .quality = exact, .time_ns = time_ns};
	out[2] = (struct map_sample){.value.i = position->longitude, .quality = exact, .time_ns = time_ns};
	out[3] = (struct map_sample){.value.f = unknown ? 0 : (float)position->altitude_dm / DM_PER_M,
				     .quality = unknown ? exact | MAP_INVALID : quality,
				     .time_ns = time_ns};
}

/* 0 degrees both, which its own station calls invalid, say that there is no fix: where it was before stays. */
static bool is_nowhere(const struct iec104_geoposition *position)
{
	return (position->quality & MAP_INVALID) != 0 && position->latitude == 0 && position->longitude == 0;
}

static void keep_place(const struct values *values, uint32_t point,
		       struct map_sample samples[IEC104_OUTSTATION_POSITION_POINTS])
{
	for (uint32_t i = 1; i < IEC104_OUTSTATION_POSITION_POINTS; i++)
		samples[i].value = map_own_sample(values->map, point + i).value;
}

/* A position is an event as a whole. */
static bool is_news(const struct values *values, uint32_t point,
		    const struct map_sample samples[IEC104_OUTSTATION_POSITION_POINTS])
{
	for (uint32_t i = 0; i < IEC104_OUTSTATION_POSITION_POINTS; i++)
		if (differs(values, point + i, &samples[i]))
			return true;
	return false;
}

bool values_take_position(struct values *values, const struct iec104_asdu *asdu, uint32_t ioa,
			  const struct iec104_geoposition *position, const struct values_moment *moment)
{
	struct values_entry *entry = (struct values_entry *)values_find(values, asdu->ca, ioa);
	struct map_sample samples[IEC104_OUTSTATION_POSITION_POINTS];
	const enum map_event_rule rule = rule_of(asdu);
	bool event, past, news;
	struct tag tag;

	if (entry == NULL ||
	    (map_config(values->map)->points[entry->point].flags & MAP_POINT_POSITION) == 0) {
		map_count(entry == NULL ? &values->stats->unmapped : &values->stats->mistyped, 1);
		return true;
	}
	tag = tag_of(values, !position->time_invalid, position->wall_ns, moment);
	samples_of(position, tag.at_ns, samples);
	values_publish(values); /* what came before it; it is compared with what is there */
	past = is_of_before(entry, rule, &tag, moment);
	if (!past && is_nowhere(position))
		keep_place(values, entry->point, samples);
	news = is_news(values, entry->point, samples);
	event = rule == MAP_EVENT_ALWAYS || news;
	for (uint32_t i = 0; i < IEC104_OUTSTATION_POSITION_POINTS; i++)
		values->updates[values->update_count++] = (struct map_update){
		    .point = entry->point + i,
		    .flags = past ? MAP_UPDATE_PAST : 0,
		    .event_rule = (uint8_t)(event ? MAP_EVENT_ALWAYS : MAP_EVENT_BY_QUALITY),
		    .sample = samples[i]};
	values_publish(values);
	map_count(&values->stats->objects, 1);
	map_count(&values->stats->past, past);
	return !past || !news;
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

		if (values->update_count + IEC104_OUTSTATION_POSITION_POINTS > VALUES_AT_ONCE &&
		    entry->ioa <= IOA_MASK)
			values_publish(values); /* a position is not cut */
		make_room(values, entry);
		entry->batch = values->batch;
		entry->known_ns = now_ns;
		values->updates[values->update_count++] =
		    (struct map_update){.point = entry->point,
					.flags = MAP_UPDATE_KEEPS_VALUE,
					.event_rule = MAP_EVENT_BY_QUALITY,
					.sample = {.quality = last.quality | MAP_INVALID, .time_ns = now_ns}};
	}
	values_publish(values);
}
