/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A small map for the fuzzers: two devices with a point of each type, which the input cannot change. */
#ifndef OPENRTU_IEC61850_FUZZ_MAP_H
#define OPENRTU_IEC61850_FUZZ_MAP_H

#include <string.h>

#include "fuzz/target.h"
#include "iec61850/block_kept.h"
#include "map/limits.h"

#define FUZZ_POINTS  (2 * MAP_TYPES)
#define FUZZ_MAX_PDU IEC61850_PDU_MIN

static struct map_set fuzz_sets[] = {{.ca = 1, .point_count = MAP_TYPES, .prefix = "p1.1", .name = "one"},
				     {.ca = 2, .point_count = MAP_TYPES, .prefix = "p1.2", .name = "two"}};
static struct map_point fuzz_points[FUZZ_POINTS];
static struct iec61850_settings fuzz_settings = {.ied = "RTU",
						 .max_pdu = FUZZ_MAX_PDU,
						 .associations = 1,
						 .controller_count = 1,
						 .report_buffer = IEC61850_BUFFER_MIN};
/* The second device's double, step and float points; fuzz_server knows the classes. */
static struct iec61850_assignment fuzz_assignments[] = {{.point = MAP_TYPES + MAP_DOUBLE, .ln = "Q1XCBR1"},
							{.point = MAP_TYPES + MAP_STEP, .ln = "YLTC1"},
							{.point = MAP_TYPES + MAP_FLOAT, .ln = "MMXU1"}};
static struct map_limits fuzz_limits[] = {
    {.point = MAP_TYPES + MAP_FLOAT, .high = 1, .low = -1, .low_low = -5}};
/* The first device's data set and control blocks are chosen, the second's are as they are without. */
static struct iec61850_data_set fuzz_data_sets[] = {
    {.ln = "GGIO1", .name = "Some", .first_member = 3, .member_count = 1},
    {.ln = "LLN0", .name = "Bay", .member_count = 3}};
static struct iec61850_chosen fuzz_members[] = {{.point = MAP_FLOAT},
						{.point = MAP_SINGLE, .attribute = "stVal"},
						{.point = MAP_SINGLE, .attribute = "q"},
						{.point = MAP_DOUBLE}};
static struct iec61850_report fuzz_reports[] = {
    {.name = "brcbBay", .set = 1, .buffered = true, .instances = 2, .triggers = IEC61850_DATA_UPDATE},
    {.name = "urcbBay", .set = 1, .instances = 1},
    {.name = "urcbSome", .instances = 1}};
static struct map_config fuzz_config = {.sets = fuzz_sets,
					.points = fuzz_points,
					.set_count = 2,
					.point_count = FUZZ_POINTS,
					.sections = {{.id = IEC61850_SETTINGS,
						      .record_size = sizeof(fuzz_settings),
						      .count = 1,
						      .records = &fuzz_settings},
						     {.id = IEC61850_ASSIGNMENTS,
						      .record_size = sizeof(fuzz_assignments[0]),
						      .count = 3,
						      .records = fuzz_assignments},
						     {.id = IEC61850_DATA_SETS,
						      .record_size = sizeof(fuzz_data_sets[0]),
						      .count = 2,
						      .records = fuzz_data_sets},
						     {.id = IEC61850_MEMBERS,
						      .record_size = sizeof(fuzz_members[0]),
						      .count = 4,
						      .records = fuzz_members},
						     {.id = IEC61850_REPORTS,
						      .record_size = sizeof(fuzz_reports[0]),
						      .count = 3,
						      .records = fuzz_reports},
						     {.id = MAP_LIMITS,
						      .record_size = sizeof(fuzz_limits[0]),
						      .count = 1,
						      .records = fuzz_limits}},
					.section_count = 6};

const struct map_config *map_config(const struct map *map)
{
	(void)map;
	return &fuzz_config;
}

int64_t map_now_ns(void)
{
	return NS_PER_S;
}

struct map_clock map_clock_read(const struct map *map)
{
	(void)map;
	return (struct map_clock){.set = true, .source = MAP_CLOCK_SYNCHRONISED, .error_us = 1000};
}

bool map_read(const struct map *map, uint32_t point, struct map_sample *out)
{
	(void)map;
	CHECK(point < FUZZ_POINTS);
	*out = (struct map_sample){.value.i = -7, .time_ns = NS_PER_S};
	return point % 5 != 4;
}

/* An owner that answers nothing by itself: who fuzzes does. */
uint32_t map_request_post(struct map *map, struct map_request request)
{
	static uint32_t number;

	(void)map;
	CHECK(request.point < FUZZ_POINTS);
	return ++number % 7;
}

uint32_t map_command_timeout_s(const struct map *map)
{
	(void)map;
	return 10;
}

uint32_t map_select_timeout_s(const struct map *map)
{
	(void)map;
	return 10;
}

bool map_command_read(const struct map *map, uint32_t point, struct map_command *out)
{
	(void)map;
	CHECK(point < FUZZ_POINTS);
	*out = (struct map_command){.state = (uint8_t)(point % 10)};
	return true;
}

void map_module(const struct map *map, uint32_t index, struct map_module *out)
{
	(void)map, (void)index;
	*out = (struct map_module){.state = MAP_MODULE_RUNNING, .alive = true};
}

uint32_t map_self(const struct map *map)
{
	(void)map;
	return 0;
}

uint32_t map_owner(const struct map *map, uint32_t point)
{
	(void)map;
	return point % 2;
}

/* The buffered reports begin anew, with a change of each point. */
static void fuzz_changes(struct iec61850_server *server)
{
	struct map_cursor cursor = {0};

	if (server->model.buffer.history.head != NULL)
		server->model.buffer.history.head->start = server->model.buffer.history.head->former = 0;
	iec61850_blocks_begin(server, server->stats, &cursor, 1);
	for (uint32_t i = 0; i < FUZZ_POINTS; i++)
		iec61850_buffer_add(&server->model.buffer, i, IEC61850_DATA_CHANGE,
				    &(struct map_sample){.value.i = -7, .time_ns = NS_PER_S}, NS_PER_S);
}

static void fuzz_assign(struct iec61850_assignment *out, const char *class, const char *data)
{
	while (strcmp(iec61850_ln_classes[out->class].name, class) != 0)
		out->class ++;
	while (strcmp(iec61850_ln_classes[out->class].data[out->data].name, data) != 0)
		out->data++;
}

/* A server with these points, begun once. */
static struct iec61850_server *fuzz_server(void)
{
	static struct iec61850_server server;
	static _Alignas(8) uint8_t section[1 << 18];
	static uint32_t chosen[IEC61850_LIST_MEMBERS];

	if (server.stats != NULL)
		return &server;
	for (uint32_t i = 0; i < FUZZ_POINTS; i++)
		fuzz_points[i] = (struct map_point){
		    .name = map_label('c', (uint16_t)i, 0, 0),
		    .set = (uint16_t)(i / MAP_TYPES),
		    .type = (uint8_t)(i % MAP_TYPES),
		    .flags = i % 2 ? MAP_POINT_COMMAND | (i % 4 == 3 ? MAP_POINT_SELECT : 0u) : 0u,
		    .ioa = 1 + i * 1000};
	fuzz_points[MAP_TYPES + MAP_FLOAT].flags |= MAP_POINT_LIMITS;
	fuzz_assign(&fuzz_assignments[0], "XCBR", "Pos");
	fuzz_assign(&fuzz_assignments[1], "YLTC", "TapPos");
	fuzz_assign(&fuzz_assignments[2], "MMXU", "TotW");
	CHECK(iec61850_model_begin(&server.model, NULL));
	server.stats = (void *)section;
	server.chosen = chosen;
	server.file = (const uint8_t *)"<SCL/>";
	server.file_size = 6;
	CHECK(iec61850_section_size(&fuzz_config) <= sizeof(section));
	fuzz_changes(&server);
	return &server;
}

#endif
