/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What outlives the module's process: retained variables, and points that masters have set. The former outlive a power cut,
 * too, by the journal (map/retained.h). A process that is killed anywhere leaves the copy that is whole.
 */
#include "modules/logic/host.h"

static bool is_set_point(const struct host *host, uint16_t number)
{
	return host->points[number].own && !host->logic.points[number].written;
}

void kept_store(struct host *host)
{
	const struct logic *logic = &host->logic;
	struct map_retained *retained = logic_kept_of(host->stats);
	struct map_retained_value *value = map_retained_other(retained, logic_kept_count(host->instance));

	for (uint16_t i = 0; i < logic->head->retained; i++)
		for (uint32_t slot = logic->retained[i].first, end = slot + logic->retained[i].slots;
		     slot < end; slot++)
			*value++ = (struct map_retained_value){(uint32_t)logic->cells[slot].bits,
							       (uint32_t)(logic->cells[slot].bits >> 32),
							       logic->quality[slot] | MAP_RETAINED_KNOWN};
	for (uint16_t i = 0; i < logic->head->points; i++)
		if (is_set_point(host, i))
			*value++ = (struct map_retained_value){.low = host->points[i].sample.value.u,
							       .quality = host->points[i].sample.quality |
									  MAP_RETAINED_KNOWN};
	latch_flip(&retained->latch);
}

static union logic_cell cell_of(const struct map_retained_value *value)
{
	return (union logic_cell){.bits = (uint64_t)value->high << 32 | value->low};
}

/* All that the variable is made of, as it can be: a journal's file may say anything. */
static bool is_whole(const struct logic_retained *variable, const struct map_retained_value *values)
{
	for (uint16_t i = 0; i < variable->slots; i++)
		if (!(values[i].quality & MAP_RETAINED_KNOWN) ||
		    !logic_holds((enum logic_type)variable->type, cell_of(&values[i])))
			return false;
	return true;
}

static void restore_variable(struct logic *logic, const struct logic_retained *variable,
			     const struct map_retained_value *values)
{
	for (uint16_t i = 0; i < variable->slots; i++) {
		logic->cells[variable->first + i] = cell_of(&values[i]);
		logic->quality[variable->first + i] = (uint8_t)values[i].quality;
	}
}

static void restore_set_point(struct host_point *point, const struct map_retained_value *value)
{
	point->kept = (value->quality & MAP_RETAINED_KNOWN) != 0;
	if (!point->kept)
		return;
	point->sample.value.u = value->low;
	point->sample.quality = (uint8_t)value->quality;
}

void kept_restore(struct host *host)
{
	struct logic *logic = &host->logic;
	const struct map_retained_value *value =
	    map_retained_whole(logic_kept_of(host->stats), logic_kept_count(host->instance));

	for (uint16_t i = 0; i < logic->head->retained; i++) {
		if (is_whole(&logic->retained[i], value))
			restore_variable(logic, &logic->retained[i], value);
		value += logic->retained[i].slots;
	}
	for (uint16_t i = 0; i < logic->head->points; i++)
		if (is_set_point(host, i))
			restore_set_point(&host->points[i], value++);
}
