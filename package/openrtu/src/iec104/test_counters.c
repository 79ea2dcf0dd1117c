/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What others see of the station's connections and counters. */
#include "iec104/counters.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "iec104/fake_map.h"

static void test_a_forged_peer_does_not_speak_to_the_terminal(void **state)
{
	struct iec104_connection_stats *stats = &fake.stats.connections[15];
	struct iec104_shown_connection connection;

	(void)state;
	fake_begin();
	assert_false(iec104_shown_connection(&fake, 15, &connection));
	memset(stats->peer, '\x9b', sizeof(stats->peer));
	stats->open = 1;
	assert_true(iec104_shown_connection(&fake, 15, &connection));
	assert_int_equal(strspn(connection.peer, "?"), IEC104_PEER_SIZE - 1);
	assert_int_equal(strlen(connection.peer), IEC104_PEER_SIZE - 1);
}

static void test_every_counter_has_a_name(void **state)
{
	(void)state;
	for (unsigned i = 0; i < IEC104_COUNT_OF_COUNTERS; i++)
		assert_non_null(iec104_counter_name((enum iec104_counter)i));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_forged_peer_does_not_speak_to_the_terminal),
	    cmocka_unit_test(test_every_counter_has_a_name),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
