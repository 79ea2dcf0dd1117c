/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/change.h"

#include <stdlib.h>
#include <string.h>

#include "map/supervise.h"
#include "map/users.h"
#include "rtud/compare.h"
#include "rtud/kinds.h"

#define LINES_MAX 50 /* of points, in a report */

struct change {
	const struct map *map;
	const struct map_config *before;
	struct map_config *now;
	map_modules kept, exchanged, added, gone;
	map_modules taking,
	    again; /* of the kept ones, those that take new settings, or start again with them */
	bool set;  /* settings of all modules have changed */
	FILE *report;
};

/* ---- modules ----------------------------------------------------------------------------- */

/* Each keeps its number. */
static void keep_numbers(const struct change *change)
{
	struct map_config *now = change->now;

	now->module_count = map_module_count(change->map);
	for (uint32_t i = 0; i < now->module_count; i++) {
		const struct map_module_plan *was = map_plan_of(change->map, i);

		now->modules[i] =
		    (struct map_module_plan){.flags = was->flags & MAP_IS_GONE, .gone = was->gone};
		memcpy(now->modules[i].name, was->name, MAP_NAME_SIZE);
	}
}

static bool runs(const struct change *change, uint32_t module)
{
	return module < map_module_count(change->map) && !map_is_gone(change->map, module);
}

/* A process keeps its user: the files that are another's by its number are its own. So does one that ends with this change. */
static void give_users(const struct change *change)
{
	struct map_config *now = change->now;

	for (uint32_t i = 0; i < now->module_count; i++)
		if (runs(change, i))
			now->modules[i].user = map_plan_of(change->map, i)->user;
	for (uint32_t i = 0; i < now->module_count; i++) {
		const uint32_t wanted = now->modules[i].user;

		if (runs(change, i) || wanted == 0)
			continue;
		now->modules[i].user = 0;
		now->modules[i].user = user_is_taken(now, wanted) ? free_user(now) : wanted;
	}
}

static bool has_moved(const struct change *change)
{
	return (change->added | change->exchanged | change->gone) != 0;
}

static map_modules live_and_kept(const struct change *change)
{
	map_modules live = 0;

	for (uint32_t i = 0; i < change->now->module_count; i++)
		live |= change->now->modules[i].flags & MAP_IS_GONE ? 0 : map_module_bit(i);
	return live & change->kept;
}

/* Those that the former process named find their place, whether the new one names them or not. */
static void make_room_for_counters(const struct change *change)
{
	for (uint32_t i = 0; i < map_module_count(change->map); i++) {
		struct map_module_plan *plan = &change->now->modules[i];

		if ((change->exchanged & map_module_bit(i)) &&
		    plan->counters < map_plan_of(change->map, i)->counters)
			plan->counters = map_plan_of(change->map, i)->counters;
	}
}

static bool stands_in_net(const struct change *change, uint32_t module)
{
	const uint32_t was =
	    module < map_module_count(change->map) ? map_plan_of(change->map, module)->flags : MAP_IS_GONE;
	const uint32_t is = change->now->modules[module].flags;

	return (((was & MAP_IS_GONE ? 0 : was) | (is & MAP_IS_GONE ? 0 : is)) &
		(MAP_TAKES_PART | MAP_COORDINATES)) != 0;
}

/* Tokens that a module holds have no place in a net without it: if anything in the net has changed, all of it begins anew. */
static map_modules begin_net_anew(const struct change *change)
{
	map_modules net = 0;

	for (uint32_t i = 0; i < change->now->module_count; i++)
		net |= stands_in_net(change, i) ? map_module_bit(i) : 0;
	return net & (change->exchanged | change->added | change->gone) ? net & live_and_kept(change) : 0;
}

/* Those that have not changed themselves, but what they read, command, or wait for. */
static void exchange_others(struct change *change)
{
	map_modules others;

	do {
		others = compare_others(change->map, change->now, change->kept) | begin_net_anew(change);
		change->exchanged |= others;
		change->kept &= ~others;
	} while (others != 0);
}

static void sort_modules(struct change *change)
{
	struct map_config *now = change->now;

	for (uint32_t i = 0; i < now->module_count; i++) {
		const map_modules bit = map_module_bit(i);
		const bool known = i < map_module_count(change->map);
		const bool was_gone = known && map_is_gone(change->map, i);

		if (now->modules[i].kind[0] == '\0') {
			now->modules[i] = *map_plan_of(change->map, i);
			now->modules[i].flags |= MAP_IS_GONE;
			if (!was_gone)
				now->modules[i].gone = map_epoch(change->map) + 1;
			change->gone |= was_gone ? 0 : bit;
			change->kept |= bit; /* its segment, for the events in it */
		} else if (!known || was_gone) {
			change->added |= bit;
		} else {
			const enum kind_change what = compare_modules(change->map, now, i);

			*(what == KIND_EXCHANGED ? &change->exchanged : &change->kept) |= bit;
			change->taking |= what == KIND_TAKES ? bit : 0;
		}
	}
	exchange_others(change);
	change->again = compare_again(change->map, now, live_and_kept(change), has_moved(change));
}

/* ---- redundancy groups ----------------------------------------------------------------------- */

static const struct map_queue_plan *find_group(const struct map_settings *settings, const char *name)
{
	for (uint32_t i = 0; i < settings->queue_count; i++)
		if (strcmp(settings->queues[i].name, name) == 0)
			return &settings->queues[i];
	return NULL;
}

/* A queue that another group had until now is told from this one's by its slot. MAP_NONE: there is none left. */
static uint32_t free_slot(const struct map_settings *before, uint32_t taken)
{

	for (uint32_t i = 0; i < before->queue_count; i++)
		taken |= 1u << before->queues[i].slot;
	for (uint32_t i = 0; i < MAP_NAMED_QUEUES_MAX; i++)
		if (!(taken & 1u << i))
			return i;
	return MAP_NONE;
}

static bool keep_slots(const struct change *change)
{
	const struct map_settings *before = &change->before->settings;
	struct map_settings *now = &change->now->settings;
	uint32_t given = 0;

	for (uint32_t i = 0; i < now->queue_count; i++) {
		struct map_queue_plan *group = &now->queues[i];
		const struct map_queue_plan *former = find_group(before, group->name);

		group->slot = former != NULL ? former->slot : free_slot(before, given);
		if (group->slot == MAP_NONE) {
			fprintf(change->report,
				"redundancy_groups: there is no room for %s beside the groups that go, %d at "
				"once: take these out first, and then reload with the new ones\n",
				group->name, MAP_NAMED_QUEUES_MAX);
			return false;
		}
		given |= 1u << group->slot;
	}
	return true;
}

/* ---- what needs a restart of rtud -------------------------------------------------------- */

static bool refuse(const struct change *change, const char *what, const char *because)
{
	fprintf(change->report, "%s has changed: this needs a restart of rtud, because %s\n", what, because);
	return false;
}

/* The settings of all modules. */
static bool take_settings(struct change *change)
{
	const struct compare_setting *setting;
	bool possible = true;
	uint32_t next = 0;

	while ((setting = compare_settings(&change->before->settings, &change->now->settings, &next)) !=
	       NULL) {
		change->set = true;
		if (setting->because != NULL)
			possible = refuse(change, setting->key, setting->because);
	}
	return possible;
}

static bool may_be_exchanged(const struct change *change, uint32_t module)
{
	const struct kind *kind = kinds_find(change->now->modules[module].kind);

	return kind->fixed == NULL || refuse(change, kind->fixed, kind->fixed_because);
}

static bool is_possible(struct change *change)
{
	const map_modules changed = change->exchanged | change->added | change->gone;
	bool possible = take_settings(change);

	for (uint32_t i = 0; i < change->now->module_count; i++)
		if (changed & map_module_bit(i))
			possible &= may_be_exchanged(change, i);
	return possible;
}

/* ---- what is gone -------------------------------------------------------------------------- */

static bool make_room(struct map_config *config, uint32_t sets, uint32_t points)
{
	const size_t all_sets = (size_t)config->set_count + config->gone_set_count + sets;
	const size_t all_points = (size_t)config->point_count + config->gone_point_count + points;
	void *grown = realloc(config->sets, (all_sets + 1) * sizeof(*config->sets));

	if (grown == NULL)
		return false;
	config->sets = grown;
	grown = realloc(config->points, (all_points + 1) * sizeof(*config->points));
	if (grown == NULL)
		return false;
	config->points = grown;
	grown = realloc(config->names, config->names_size + (size_t)points * MAP_NAME_SIZE);
	if (grown == NULL)
		return false;
	config->names = grown;
	return true;
}

static void add_gone_point(const struct change *change, uint32_t point, uint32_t set)
{
	struct map_config *now = change->now;
	struct map_point *gone = &now->points[now->point_count + now->gone_point_count++];
	const char *name;

	*gone = change->before->points[point];
	gone->set = (uint16_t)set;
	gone->unit = 0; /* its configuration's */
	if (gone->name & MAP_LABEL)
		return;
	name = &change->before->names[gone->name];
	gone->name = now->names_size;
	memcpy(&now->names[now->names_size], name, strlen(name) + 1);
	now->names_size += (uint32_t)strlen(name) + 1;
}

/* A position is told with the three points behind it: without them it is not. */
static bool is_lacking(const struct change *change, uint32_t point)
{
	const uint32_t last = change->before->points[point].flags & MAP_POINT_POSITION ? point + 3 : point;

	for (; point <= last; point++)
		if (compare_has_point(change->before, change->now, point))
			return false;
	return true;
}

/* Of a module that is kept, all that it had is there, in the order that its segment has. */
static bool is_told_once_more(const struct change *change, const struct map_set *set, uint32_t point)
{
	const bool live = point < change->before->point_count;

	if (change->exchanged & map_module_bit(set->module))
		return live && is_lacking(change, point);
	if (change->now->modules[set->module].flags & MAP_IS_GONE)
		return true;
	return (change->kept & map_module_bit(set->module)) && !live;
}

static bool add_gone_set(const struct change *change, uint32_t index)
{
	struct map_config *now = change->now;
	const struct map_set *set = &change->before->sets[index];
	const uint32_t place = now->set_count + now->gone_set_count;
	const uint32_t first = now->point_count + now->gone_point_count;

	if (!make_room(now, 1, set->point_count))
		return false;
	for (uint32_t i = set->first_point; i < set->first_point + set->point_count; i++)
		if (is_told_once_more(change, set, i))
			add_gone_point(change, i, place);
	if (now->point_count + now->gone_point_count == first)
		return true;
	now->sets[place] = *set;
	now->sets[place].first_point = first;
	now->sets[place].point_count = now->point_count + now->gone_point_count - first;
	now->gone_set_count++;
	return true;
}

/* The live ones of before first, as its segments have them. */
static bool add_gone_sets(const struct change *change)
{
	for (uint32_t i = 0; i < change->before->set_count + change->before->gone_set_count; i++)
		if (!add_gone_set(change, i))
			return false;
	return true;
}

/* ---- the report ---------------------------------------------------------------------------- */

static const char *fate_of(const struct change *change, uint32_t module)
{
	const map_modules bit = map_module_bit(module);

	if (change->added & bit)
		return "is added";
	if (change->gone & bit)
		return "is removed";
	if (change->exchanged & bit)
		return "gets a new process";
	if (change->again & bit)
		return "is started again";
	return change->taking & bit ? "takes the change as it runs" : "is not touched";
}

static void print_point(const struct change *change, char sign, const struct map_config *config,
			uint32_t point)
{
	char name[MAP_NAME_SIZE];

	map_point_name(config, &config->points[point], name);
	fprintf(change->report, "  %c %s, CA %u, IOA %u\n", sign, name,
		config->sets[config->points[point].set].ca, config->points[point].ioa);
}

/* Points of one configuration that the other has not. */
static void print_points(const struct change *change, char sign, const struct map_config *config,
			 const struct map_config *other)
{
	uint32_t found = 0;

	for (uint32_t i = 0; i < config->point_count; i++)
		if (!compare_has_point(config, other, i) && found++ < LINES_MAX)
			print_point(change, sign, config, i);
	if (found > LINES_MAX)
		fprintf(change->report, "  %c and %u more\n", sign, found - LINES_MAX);
}

static bool has_process(const struct map_module_plan *plan)
{
	const struct kind *kind = kinds_find(plan->kind);

	return kind->programs != NULL || kind->run != NULL;
}

static void print_settings(const struct change *change)
{
	const struct compare_setting *setting;
	uint32_t next = 0;

	while ((setting = compare_settings(&change->before->settings, &change->now->settings, &next)) != NULL)
		fprintf(change->report, "%s changes for all\n", setting->key);
}

static void print_changes(const struct change *change)
{
	print_settings(change);
	for (uint32_t i = 0; i < change->now->module_count; i++)
		if (has_process(&change->now->modules[i]) &&
		    (!(change->now->modules[i].flags & MAP_IS_GONE) || (change->gone & map_module_bit(i))))
			fprintf(change->report, "%s %s\n", change->now->modules[i].name, fate_of(change, i));
	print_points(change, '-', change->before, change->now);
	print_points(change, '+', change->now, change->before);
}

/* ------------------------------------------------------------------------------------------ */

/* A kind writes the numbers of its modules into its records. */
static bool copy_sections(const struct map_config *from, struct map_config *to)
{
	for (uint32_t i = 0; i < from->section_count; i++) {
		const struct map_section *section = &from->sections[i];
		const size_t size = (size_t)section->count * section->record_size;

		to->sections[i].records = malloc(size + 1);
		if (to->sections[i].records == NULL)
			return false;
		memcpy(to->sections[i].records, section->records, size);
	}
	return true;
}

/* What goes back into force has been checked, and is in memory. */
static bool copy_config(const struct map *from, struct map_config *out)
{
	const struct map_config *config = map_config(from);

	*out = *config;
	out->gone_set_count = out->gone_point_count = 0;
	out->sets = calloc(config->set_count + 1, sizeof(*out->sets));
	out->points = calloc(config->point_count + 1, sizeof(*out->points));
	out->names = calloc(config->names_size + 1, 1);
	out->modules = calloc(MAP_MODULES_MAX, sizeof(*out->modules));
	if (out->sets == NULL || out->points == NULL || out->names == NULL || out->modules == NULL)
		return false;
	memcpy(out->sets, config->sets, config->set_count * sizeof(*out->sets));
	memcpy(out->points, config->points, config->point_count * sizeof(*out->points));
	memcpy(out->names, config->names, config->names_size);
	return copy_sections(config, out);
}

static bool load(const struct change_plan *plan, const struct map *before, struct map_config *out,
		 FILE *report)
{
	if (plan->path == NULL)
		return copy_config(before, out);
	if (config_load(plan->path, plan->instead, plan->modules, out, report) != CONFIG_GOOD)
		return false;
	*plan->text = out->text;
	return true;
}

static bool plan_now(const struct change *change)
{
	keep_numbers(change);
	if (!kinds_plan(change->now)) {
		fprintf(change->report,
			"too many processes: %d modules at most, those among them that this takes out\n",
			MAP_MODULES_MAX);
		return false;
	}
	give_users(change);
	return true;
}

enum change_result change_prepare(const struct map *map, const struct map *before,
				  const struct change_plan *plan, FILE *report)
{
	struct map_config now;
	struct change change = {.map = map, .before = map_config(map), .now = &now, .report = report};
	char error[MAP_ERROR_SIZE];

	if (!load(plan, before, &now, report) || !keep_slots(&change) || !plan_now(&change))
		return CHANGE_REFUSED;
	sort_modules(&change);
	if (!is_possible(&change))
		return CHANGE_REFUSED;
	make_room_for_counters(&change);
	if (!has_moved(&change) && !(change.taking | change.again) && !change.set) {
		fputs("nothing changes\n", report);
		return CHANGE_NONE;
	}
	if (!plan_is_possible(&now, plan->map, report))
		return CHANGE_REFUSED;
	print_changes(&change);
	if (plan->dry)
		return CHANGE_NONE;
	if (!add_gone_sets(&change)) {
		fputs("out of memory\n", report);
		return CHANGE_REFUSED;
	}
	if (map_prepare(map, &now, change.kept, plan->group, error) == 0)
		return CHANGE_READY;
	map_abandon(map);
	fprintf(report, "%s\n", error);
	return CHANGE_REFUSED;
}
