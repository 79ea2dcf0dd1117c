/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Who gets a connection when many want one, and who gives way. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "iec104/fake_map.h"
#include "iec104/station.h"

#define PLACES 4
#define K      12
#define T1     (15 * S)

#define NONE MAP_NONE

static struct iec104_station station;
static int64_t sent_ns[PLACES * K];
static struct map_queue_place places[PLACES * K];

static int set_up(void **state)
{
	(void)state;
	fake_begin();
	for (unsigned i = 0; i < MAP_NAMED_QUEUES_MAX; i++)
		fake.config.settings.queues[i].slot = i;
	fake.settings.max_connections = PLACES;
	fake.settings.connections_per_address = PLACES;
	iec104_station_init(&station, &fake, sent_ns, places);
	return 0;
}

static struct iec104_peer peer_of(const char *address, uint32_t party)
{
	struct iec104_peer peer = {.name = "peer", .party = party};

	snprintf(peer.address, sizeof(peer.address), "%s", address);
	return peer;
}

/* As rtu-iec104 does it. NULL: refused. */
static struct iec104_connection *come(const char *address, uint32_t party)
{
	struct iec104_peer peer = peer_of(address, party);
	struct iec104_connection *leaving = iec104_station_make_room(&station, &peer, now);

	if (leaving != NULL) {
		assert_int_equal(leaving->session.closing, IEC104_GAVE_WAY);
		iec104_station_disconnect(&station, leaving);
	}
	now += 1 * MS; /* one is older than the next */
	return iec104_station_connect(&station, &peer, now);
}

static void put(struct iec104_connection *connection, uint8_t function)
{
	const uint8_t frame[] = {0x68, 4, function, 0, 0, 0};
	struct iec104_session *session = &connection->session;
	size_t size;

	memcpy(iec104_session_space(session, &size), frame, sizeof(frame));
	iec104_session_received(session, sizeof(frame));
	iec104_station_run(&station, now);
	iec104_session_output(session, &size);
	assert_int_equal(size, sizeof(frame)); /* confirmed */
	iec104_session_written(session, size);
}

static void start(struct iec104_connection *connection)
{
	put(connection, IEC104_STARTDT_ACT);
}

/* Keeps a connection from being closed for its silence. */
static void test_link(struct iec104_connection *connection)
{
	put(connection, IEC104_TESTFR_ACT);
}

/* ---- who gives way ------------------------------------------------------------------------------ */

static void test_who_never_starts_gives_way(void **state)
{
	struct iec104_connection *idle[PLACES];

	(void)state;
	for (unsigned i = 0; i < PLACES; i++)
		idle[i] = come("10.0.0.1", NONE);
	now = idle[0]->since_ns + T1 - 1;
	for (unsigned i = 0; i < PLACES; i++)
		test_link(idle[i]);
	assert_null(come("10.0.0.2", NONE)); /* it may yet start */
	assert_int_equal(fake.stats.counters[IEC104_COUNT_TOO_MANY], 1);
	now = idle[0]->since_ns + T1;
	assert_ptr_equal(come("10.0.0.2", NONE), idle[0]);
	assert_string_equal(idle[0]->address, "10.0.0.2");
	assert_int_equal(fake.stats.counters[IEC104_COUNT_GAVE_WAY], 1);
	for (unsigned i = 1; i < PLACES; i++)
		assert_true(idle[i]->open);
}

static void test_nobody_gives_way_while_there_is_a_place(void **state)
{
	(void)state;
	for (unsigned i = 1; i < PLACES; i++)
		assert_non_null(come("10.0.0.1", NONE));
	now += 100 * T1;
	assert_non_null(come("10.0.0.2", NONE));
	assert_int_equal(fake.stats.counters[IEC104_COUNT_GAVE_WAY], 0);
}

/* Also one that was stopped since: it may be the second connection of a controlling station. */
static void test_who_was_started_once_stays(void **state)
{
	struct iec104_connection *connections[PLACES];

	(void)state;
	for (unsigned i = 0; i < PLACES; i++) {
		connections[i] = come("10.0.0.1", NONE);
		start(connections[i]);
	}
	put(connections[0], IEC104_STOPDT_ACT);
	now += T1;
	for (unsigned i = 0; i < 100; i++)
		assert_null(come("10.0.0.2", NONE));
	for (unsigned i = 0; i < PLACES; i++)
		assert_int_equal(connections[i]->session.closing, IEC104_OPEN);
}

static void test_the_address_with_most_gives_way(void **state)
{
	struct iec104_connection *waiting = come("10.0.0.1", NONE), *first = come("10.0.0.2", NONE);

	(void)state;
	come("10.0.0.2", NONE);
	come("10.0.0.3", NONE);
	now += T1;
	assert_ptr_equal(come("10.0.0.4", NONE), first);
	assert_string_equal(waiting->address, "10.0.0.1");
}

/* ---- a limit for each address ------------------------------------------------------------------- */

static void test_an_address_has_its_limit(void **state)
{
	struct iec104_connection *first;

	(void)state;
	fake.settings.connections_per_address = 2;
	start(come("10.0.0.1", NONE));
	first = come("10.0.0.1", NONE);
	assert_null(come("10.0.0.1", NONE));
	assert_non_null(come("10.0.0.2", NONE));
	now += T1; /* from now on it takes its own place, and no other one */
	assert_ptr_equal(come("10.0.0.1", NONE), first);
	start(first);
	now += T1;
	assert_null(come("10.0.0.1", NONE));
	assert_non_null(come("10.0.0.2", NONE));
	assert_int_equal(fake.stats.counters[IEC104_COUNT_GAVE_WAY], 1);
}

/* ---- places that are kept ----------------------------------------------------------------------- */

static void test_a_place_is_kept_for_each_group(void **state)
{
	struct iec104_connection *group;

	(void)state;
	fake.config.settings.queue_count = 2;
	start(come("10.0.0.8", NONE));
	start(come("10.0.0.9", NONE));
	now += T1;
	assert_null(come("10.0.0.9", NONE));
	group = come("10.0.0.1", 0);
	assert_non_null(group);
	assert_int_equal(group->group, 0);
	assert_null(come("10.0.0.2", 0)); /* the last place is the other group's */
	assert_non_null(come("10.0.0.3", 1));
	iec104_station_disconnect(&station, group); /* and its place is kept again */
	assert_null(come("10.0.0.9", NONE));
	assert_null(come("10.0.0.4", 1));
	assert_non_null(come("10.0.0.2", 0));
}

static void test_a_place_is_kept_for_each_master(void **state)
{
	struct iec104_connection *first;

	(void)state;
	fake.config.settings.queue_count = 1;
	fake.settings.master_count = 4; /* 0 and 1 are in the group */
	fake.settings.lone_masters = 2;
	first = come("10.0.0.3", 1 + 2);
	start(first);
	assert_int_equal(first->group, NONE);
	start(come("10.0.0.3", 1 + 2)); /* the one place that is for anybody */
	assert_null(come("10.0.0.3", 1 + 2));
	assert_non_null(come("10.0.0.4", 1 + 3));
	assert_null(come("10.0.0.4", 1 + 3));
	assert_non_null(come("10.0.0.1", 0));
}

static void test_more_parties_than_places(void **state)
{
	(void)state;
	fake.config.settings.queue_count = PLACES + 1;
	for (unsigned i = 0; i < PLACES; i++)
		assert_non_null(come("10.0.0.1", i));
	assert_null(come("10.0.0.1", PLACES));
}

/* A group's second connection waits without STARTDT for the first one's end. */
static void test_a_party_gives_way_to_no_stranger(void **state)
{
	struct iec104_connection *second, *stranger;

	(void)state;
	fake.config.settings.queue_count = 1;
	start(come("10.0.0.1", 0));
	second = come("10.0.0.2", 0);
	stranger = come("10.0.0.8", NONE);
	start(come("10.0.0.9", NONE));
	now += T1;
	assert_ptr_equal(come("10.0.0.7", NONE), stranger);
	start(stranger);
	assert_null(come("10.0.0.8", NONE));
	assert_ptr_equal(come("10.0.0.2", 0), second); /* its former connection has failed in silence */
}

static void test_a_stranger_gives_way_to_a_party_first(void **state)
{
	struct iec104_connection *second, *stranger;

	(void)state;
	fake.config.settings.queue_count = 2;
	start(come("10.0.0.1", 0));
	second = come("10.0.0.2", 0);
	come("10.0.0.5", 1);
	stranger = come("10.0.0.8", NONE);
	now += T1;
	assert_ptr_equal(come("10.0.0.6", 1), stranger);
	assert_true(second->open);
}

#define TEST(name) cmocka_unit_test_setup(name, set_up)

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_who_never_starts_gives_way),       TEST(test_nobody_gives_way_while_there_is_a_place),
	    TEST(test_who_was_started_once_stays),       TEST(test_the_address_with_most_gives_way),
	    TEST(test_an_address_has_its_limit),         TEST(test_a_place_is_kept_for_each_group),
	    TEST(test_a_place_is_kept_for_each_master),  TEST(test_more_parties_than_places),
	    TEST(test_a_party_gives_way_to_no_stranger), TEST(test_a_stranger_gives_way_to_a_party_first),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
