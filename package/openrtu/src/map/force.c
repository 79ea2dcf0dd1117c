/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Forced points: whom rtud's table names shows what the table says, and what its owner publishes goes on below.
 *
 * The owner puts it into its own segment, at its next heartbeat: a reader takes no other way than before, and sees the one
 * event that a change of quality makes. What lies below is in that segment too, so that nothing that is killed anywhere makes
 * a forced value a true one.
 */
#include <string.h>

#include "map/layout.h"
#include "map/supervise.h"

/* ---- rtud -------------------------------------------------------------------------------- */

static bool is_of_a_position(const struct map_config *config, uint32_t point)
{
	const uint32_t first = config->sets[config->points[point].set].first_point;

	for (uint32_t back = 0; back < MAP_POSITION_POINTS && first + back <= point; back++)
		if (config->points[point - back].flags & MAP_POINT_POSITION)
			return true;
	return false;
}

const char *map_unforceable(const struct map_config *config, uint32_t point)
{
	const struct map_point *object = &config->points[point];

	if (object->type == MAP_COUNTER)
		return "is a counter, of which no protocol could tell that it is forced";
	if (object->flags & MAP_POINT_NO_QUALITY)
		return "is sent without quality, so nobody could tell that it is forced";
	if (object->flags & MAP_POINT_NEVER_READ)
		return "takes commands and has no value";
	if (object->flags & MAP_POINT_TEXT)
		return "is a text, for which nobody can enter another";
	if (is_of_a_position(config, point))
		return "is a part of a position, which is sent as a whole";
	return NULL;
}

/* The table as rtud, who alone writes it, wrote it last. */
static void table_copy(const struct map *map, struct force_entry out[MAP_FORCES_MAX])
{
	memcpy(out, map->directory->forces[0], MAP_FORCES_MAX * sizeof(*out));
}

static void table_store(const struct map *map, const struct force_entry entries[MAP_FORCES_MAX])
{
	struct directory *directory = map->directory;

	latch_store(&directory->forces_latch, directory->forces, entries, sizeof(directory->forces[0]));
}

static bool is_used(const struct force_entry *entry)
{
	return entry->until_ns != 0;
}

/* Its place in the table, or a free one; NULL: there is neither. */
static struct force_entry *place_for(struct force_entry entries[MAP_FORCES_MAX], uint32_t module,
				     uint32_t slot)
{
	struct force_entry *unused = NULL;

	for (unsigned i = 0; i < MAP_FORCES_MAX; i++) {
		if (is_used(&entries[i]) && entries[i].module == module && entries[i].slot == slot)
			return &entries[i];
		if (!is_used(&entries[i]) && unused == NULL)
			unused = &entries[i];
	}
	return unused;
}

bool map_force(struct map *map, const struct map_force *force)
{
	const uint32_t module = map_owner(map, force->point), slot = slot_of(map, force->point);
	struct force_entry entries[MAP_FORCES_MAX], *entry;

	table_copy(map, entries);
	entry = place_for(entries, module, slot);
	if (entry == NULL)
		return false;
	*entry = (struct force_entry){.module = module,
				      .slot = slot,
				      .value = force->value,
				      .since_ns = force->since_ns,
				      .until_ns = force->until_ns};
	table_store(map, entries);
	return true;
}

bool map_unforce(struct map *map, uint32_t point)
{
	struct force_entry entries[MAP_FORCES_MAX], *entry;

	table_copy(map, entries);
	entry = place_for(entries, map_owner(map, point), slot_of(map, point));
	if (entry == NULL || !is_used(entry))
		return false;
	*entry = (struct force_entry){0};
	table_store(map, entries);
	return true;
}

void forces_renumber(const struct map *map,
		     uint32_t (*renumber)(const void *context, uint32_t module, uint32_t slot),
		     const void *context)
{
	struct force_entry entries[MAP_FORCES_MAX];
	bool changed = false;

	table_copy(map, entries);
	for (unsigned i = 0; i < MAP_FORCES_MAX; i++) {
		uint32_t slot = entries[i].slot;

		if (!is_used(&entries[i]))
			continue;
		entries[i].slot = renumber(context, entries[i].module, slot);
		if (entries[i].slot == MAP_NONE)
			entries[i] = (struct force_entry){0};
		changed = changed || entries[i].slot != slot || !is_used(&entries[i]);
	}
	if (changed)
		table_store(map, entries);
}

/* ---- anyone ------------------------------------------------------------------------------ */

static bool table_load(const struct map *map, struct force_entry out[MAP_FORCES_MAX])
{
	struct directory *directory = map->directory;

	return latch_load(&directory->forces_latch, directory->forces, out, sizeof(directory->forces[0]));
}

unsigned map_forces(const struct map *map, struct map_force out[MAP_FORCES_MAX])
{
	struct force_entry entries[MAP_FORCES_MAX];
	unsigned count = 0;

	if (!table_load(map, entries))
		return 0;
	for (unsigned i = 0; i < MAP_FORCES_MAX; i++) {
		uint32_t point;

		if (!is_used(&entries[i]) || entries[i].module >= map_module_count(map))
			continue;
		point = point_in(map, entries[i].module, entries[i].slot);
		if (point < map->config.point_count)
			out[count++] = (struct map_force){.point = point,
							  .value = entries[i].value,
							  .since_ns = entries[i].since_ns,
							  .until_ns = entries[i].until_ns};
	}
	return count;
}

bool map_read_below(const struct map *map, uint32_t point, struct map_sample *out)
{
	const struct segment *segment = &map->segments[map_owner(map, point)];
	map_latch *latch = latch_of(map, point);

	for (int tries = 0; tries < LATCH_TRIES; tries++) {
		uint32_t sequence = latch_read_begin(latch);
		const struct cover *cover = cover_in(segment, slot_of(map, point));

		if (cover == NULL)
			return false;
		*out = cover->below[sequence & 1];
		if (latch_read_done(latch, sequence))
			return is_past(map, out->time_ns);
	}
	return false;
}

bool map_read_own(const struct map *map, uint32_t point, struct map_sample *out)
{
	const struct segment *segment = &map->segments[map_owner(map, point)];
	map_latch *latch = latch_of(map, point);

	if (map_read_below(map, point, out))
		return true;
	for (int tries = 0; tries < LATCH_TRIES; tries++) {
		uint32_t sequence = latch_read_begin(latch);

		*out = segment->samples[sequence & 1][slot_of(map, point)];
		if (latch_read_done(latch, sequence))
			return is_past(map, out->time_ns);
	}
	return false;
}

/* ---- owner ------------------------------------------------------------------------------- */

static struct cover *unused_cover(const struct segment *own)
{
	for (unsigned i = 0; i < MAP_FORCES_MAX; i++)
		if (atomic_load(&own->covers[i].slot) == 0)
			return &own->covers[i];
	return NULL;
}

static void count_covers(struct map *map)
{
	map->covers = 0;
	for (unsigned i = 0; i < MAP_FORCES_MAX; i++)
		map->covers += atomic_load(&map->segments[map->self].covers[i].slot) != 0;
}

/* What the owner has published last, once more: now with what covers it. */
static void publish_again(struct map *map, uint32_t point)
{
	const struct map_update update = {
	    .point = point, .flags = UPDATE_AS_IS, .sample = map_own_sample(map, point)};

	map_publish(map, &update, 1);
}

static void cover_point(struct map *map, const struct force_entry *entry)
{
	const struct segment *own = &map->segments[map->self];
	const uint32_t point = point_in(map, map->self, entry->slot);
	struct cover *cover = cover_in(own, entry->slot);

	if (point >= map->config.point_count || (cover != NULL && cover->since_ns == entry->since_ns))
		return;
	if (cover == NULL) {
		cover = unused_cover(own);
		if (cover == NULL)
			return;
		cover->below[0] = cover->below[1] = map_own_sample(map, point);
	}
	cover->shown =
	    (struct map_sample){.value = entry->value, .quality = MAP_SUBSTITUTED, .time_ns = map_now_ns()};
	cover->since_ns = entry->since_ns;
	atomic_store(&cover->slot, entry->slot + 1); /* last: what is killed above has covered nothing */
	count_covers(map);
	publish_again(map, point);
}

/* Uncovered before it is forgotten: what is killed between does it again. It is true again from now on. */
static void uncover_point(struct map *map, struct cover *cover)
{
	const uint32_t point = point_in(map, map->self, atomic_load(&cover->slot) - 1);

	if (point != MAP_NONE) {
		struct map_update update = {
		    .point = point, .flags = UPDATE_AS_IS, .sample = map_own_sample(map, point)};

		if (update.sample.time_ns != 0)
			update.sample.time_ns = map_now_ns();
		cover->shown = update.sample;
		map_publish(map, &update, 1);
	}
	atomic_store(&cover->slot, 0);
	count_covers(map);
}

static bool is_named(const struct map *map, const struct force_entry entries[MAP_FORCES_MAX], uint32_t slot)
{
	for (unsigned i = 0; i < MAP_FORCES_MAX; i++)
		if (is_used(&entries[i]) && entries[i].module == map->self && entries[i].slot == slot)
			return true;
	return false;
}

void forces_recover(struct map *map)
{
	const struct segment *own = &map->segments[map->self];

	map->forces_seen = 0;
	if (own->covers == NULL)
		return;
	for (unsigned i = 0; i < MAP_FORCES_MAX; i++)
		own->covers[i].since_ns = 0; /* to be shown anew, as of now */
	count_covers(map);
}

void forces_follow(struct map *map)
{
	const struct segment *own = &map->segments[map->self];
	const uint32_t sequence = atomic_load_explicit(&map->directory->forces_latch, memory_order_acquire);
	struct force_entry entries[MAP_FORCES_MAX];

	if (sequence == map->forces_seen || own->covers == NULL || !table_load(map, entries))
		return;
	map->forces_seen = sequence;
	for (unsigned i = 0; i < MAP_FORCES_MAX; i++) {
		const uint32_t slot = atomic_load(&own->covers[i].slot);

		if (slot != 0 && !is_named(map, entries, slot - 1))
			uncover_point(map, &own->covers[i]);
	}
	for (unsigned i = 0; i < MAP_FORCES_MAX; i++)
		if (is_used(&entries[i]) && entries[i].module == map->self)
			cover_point(map, &entries[i]);
}
