/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Nets for tests, written as the configuration writes them. */
#ifndef OPENRTU_SYNCH_TEST_NETS_H
#define OPENRTU_SYNCH_TEST_NETS_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "synch/config_builder.h"

static struct {
	struct synch_tables tables;
	struct config_loader loader;
	struct synch_builder builder;
	struct synch_net net;
} made;

static void begin_net(void)
{
	memset(&made, 0, sizeof(made));
	made.loader.report.messages = stderr;
	made.builder = (struct synch_builder){.loader = &made.loader, .tables = &made.tables};
}

static void end_net(void)
{
	assert_int_equal(made.loader.report.errors, 0);
	synch_order_arcs(&made.tables);
	made.net = synch_net_of(&made.tables);
}

static uint8_t add_place(const char *name, uint16_t tokens, uint16_t capacity)
{
	const struct config_place nowhere = {.in = NULL};

	return synch_add_place(&made.builder, &nowhere, name, tokens, capacity);
}

static uint8_t add_transition(const char *name)
{
	const struct config_place nowhere = {.in = NULL};

	return synch_add_transition(&made.builder, &nowhere, name);
}

static void add_arc(enum synch_arc_kind kind, uint8_t place, uint8_t transition, uint8_t weight)
{
	const struct config_place nowhere = {.in = NULL};

	synch_add_arc(&made.builder, &nowhere, kind, place, transition, weight);
}

/* SYNCH_NOTHING: no such transition. Returns its number. */
static uint32_t add_participant(const char *name, uint8_t begin, uint8_t end, enum synch_death on_death)
{
	struct synch_participant *added = &made.tables.participants[made.tables.participant_count];

	*added = (struct synch_participant){
	    .begin = begin, .end = end, .on_death = (uint8_t)on_death, .waits = true};
	snprintf(added->name, sizeof(added->name), "%s", name);
	return made.tables.participant_count++;
}

static inline void add_point(uint32_t participant, const char *name, uint8_t transition)
{
	struct synch_point *added = &made.tables.points[made.tables.point_count++];

	*added = (struct synch_point){.participant = (uint8_t)participant, .transition = transition};
	snprintf(added->name, sizeof(added->name), "%s", name);
}

#endif
