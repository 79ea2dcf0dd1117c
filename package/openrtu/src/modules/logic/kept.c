/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What outlives the module's process: retained variables, and points that masters have set. Two copies, of which a word
 * says which is whole: a process that is killed anywhere leaves the other one.
 */
#include "modules/logic/host.h"

static struct logic_kept *copy_of(const struct host *host, uint32_t which)
{
	struct logic_kept *first = (struct logic_kept *)(void *)(host->stats + 1);

	return first + (which - 1) * logic_kept_count(host->instance);
}

static bool is_set_point(const struct host *host, uint16_t number)
{
	return host->points[number].own && !host->logic.points[number].written;
}

void kept_store(struct host *host)
{
	const struct logic *logic = &host->logic;
	uint32_t which = atomic_load(&host->stats->kept) == 1 ? 2 : 1;
	struct logic_kept *kept = copy_of(host, which);

	for (uint16_t i = 0; i < logic->head->retained; i++)
		for (uint32_t slot = logic->retained[i].first, end = slot + logic->retained[i].slots;
		     slot < end; slot++)
			*kept++ = (struct logic_kept){(uint32_t)logic->cells[slot].bits,
						      (uint32_t)(logic->cells[slot].bits >> 32),
						      logic->quality[slot]};
	for (uint16_t i = 0; i < logic->head->points; i++)
		if (is_set_point(host, i))
			*kept++ = (struct logic_kept){.low = host->points[i].sample.value.u,
						      .quality = host->points[i].sample.quality};
	atomic_store_explicit(&host->stats->kept, which, memory_order_release);
}

void kept_restore(struct host *host)
{
	struct logic *logic = &host->logic;
	uint32_t which = atomic_load_explicit(&host->stats->kept, memory_order_acquire);
	const struct logic_kept *kept;

	if (which == 0)
		return;
	kept = copy_of(host, which == 1 ? 1 : 2);
	for (uint16_t i = 0; i < logic->head->retained; i++)
		for (uint32_t slot = logic->retained[i].first, end = slot + logic->retained[i].slots;
		     slot < end; slot++, kept++) {
			logic->cells[slot].bits = (uint64_t)kept->high << 32 | kept->low;
			logic->quality[slot] = (uint8_t)kept->quality;
		}
	for (uint16_t i = 0; i < logic->head->points; i++)
		if (is_set_point(host, i)) {
			host->points[i].sample.value.u = kept->low;
			host->points[i].sample.quality = (uint8_t)kept->quality;
			kept++;
		}
}
