/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What is on its way over a link with delay: of each connection and direction the octets come in the order in which they were
 * sent, as TCP has it. One that was lost, or overtaken, holds up those behind it: they come together.
 */
#include <string.h>

#include "shared.h"

#define LOST_ONE_OF 20
#define REPEATED_IN 2 /* most delays until a lost one is there, at the latest */

static const struct plant_delay *delay_of(const struct plant *plant, uint16_t one, uint16_t other)
{
	for (uint32_t i = 0; i < plant->delay_count; i++)
		if (plant->delays[i].port == one || plant->delays[i].port == other)
			return &plant->delays[i];
	return NULL;
}

bool plant_is_delayed(const struct plant *plant, uint16_t one, uint16_t other)
{
	return delay_of(plant, one, other) != NULL;
}

static int64_t delay_ns_of(struct plant *plant, uint16_t one, uint16_t other)
{
	const struct plant_delay *delay = delay_of(plant, one, other);
	const uint64_t range_ns = (uint64_t)(delay->most_ns - delay->least_ns) + 1;
	const int64_t delay_ns = delay->least_ns + (int64_t)(plant_random(plant) % range_ns);
	const bool lost = plant_random(plant) % LOST_ONE_OF == 0;

	return lost ? delay_ns + (int64_t)(plant_random(plant) % (uint64_t)(REPEATED_IN * delay->most_ns))
		    : delay_ns;
}

static bool is_of(const struct plant_flight *flight, uint16_t from, uint16_t to)
{
	return flight->from == from && flight->to == to;
}

static void drop(struct plant *plant, uint32_t place)
{
	struct plant_flight *dropped = &plant->flights[place];

	memmove(dropped, dropped + 1, (plant->flight_count - place - 1) * sizeof(*dropped));
	plant->flight_count--;
}

int64_t plant_send(struct plant *plant, uint16_t from, uint16_t to, size_t size, int64_t sent_ns)
{
	int64_t due_ns = sent_ns + delay_ns_of(plant, from, to);
	const struct plant_flight *last = NULL;

	for (uint32_t i = 0; i < plant->flight_count; i++)
		if (is_of(&plant->flights[i], from, to))
			last = &plant->flights[i];
	if (last && last->due_ns > due_ns)
		due_ns = last->due_ns;
	if (plant->flight_count == PLANT_FLIGHTS)
		drop(plant, 0); /* whoever it was for was killed */
	plant->flights[plant->flight_count++] = (struct plant_flight){from, to, (uint32_t)size, due_ns};
	return due_ns;
}

size_t plant_arrived(const struct plant *plant, uint16_t from, uint16_t to)
{
	size_t size = 0;

	for (uint32_t i = 0; i < plant->flight_count; i++)
		if (is_of(&plant->flights[i], from, to) && plant->flights[i].due_ns <= plant->now_ns)
			size += plant->flights[i].size;
	return size;
}

bool plant_is_on_its_way(const struct plant *plant, uint16_t from, uint16_t to)
{
	for (uint32_t i = 0; i < plant->flight_count; i++)
		if (is_of(&plant->flights[i], from, to) && plant->flights[i].due_ns > plant->now_ns)
			return true;
	return false;
}

/* Those that have no octet any more go, too. */
void plant_took(struct plant *plant, uint16_t from, uint16_t to, size_t size)
{
	uint32_t i = 0;

	while (i < plant->flight_count) {
		struct plant_flight *flight = &plant->flights[i];
		const uint32_t part = flight->size < size ? flight->size : (uint32_t)size;

		if (!is_of(flight, from, to) || flight->due_ns > plant->now_ns) {
			i++;
			continue;
		}
		flight->size -= part;
		size -= part;
		if (flight->size)
			return;
		drop(plant, i);
	}
}

void plant_forget_flights(struct plant *plant, uint16_t from, uint16_t to)
{
	for (uint32_t i = plant->flight_count; i-- > 0;)
		if (is_of(&plant->flights[i], from, to))
			drop(plant, i);
}

int64_t plant_next_arrival_ns(const struct plant *plant)
{
	int64_t next_ns = PLANT_NEVER;

	for (uint32_t i = 0; i < plant->flight_count; i++)
		if (plant->flights[i].due_ns > plant->now_ns && plant->flights[i].due_ns < next_ns)
			next_ns = plant->flights[i].due_ns;
	return next_ns;
}
