/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Normalized values without quality descriptor, M_ME_ND_1: what is not good is not told. */
#include "iec104/test_masters.h"

#define PLAIN MAP_POINT_NO_QUALITY

static int set_up_plain(void **state)
{
	set_up(state);
	points[NORMALIZED].flags |= PLAIN;
	fake.samples[NORMALIZED].value.i = -32768;
	return 0;
}

static int tear_down_plain(void **state)
{
	(void)state;
	for (uint32_t i = 0; i < POINTS; i++)
		points[i].flags &= (uint8_t)~PLAIN;
	return 0;
}

static void publish_with(uint32_t point, int32_t value, uint8_t quality)
{
	fake.samples[point] = (struct map_sample){.value.i = value, .quality = quality, .time_ns = now};
	put_event(MAP_EVENT_CHANGE, point, fake.samples[point]);
}

static void interrogate_group(void)
{
	ASK(0, C_IC_NA, 1, ACT, 0, CA_4001, IOA(0), 22);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_4001, IOA(0), 22);
	EXPECT(0, M_DP_NA, 1, INTERROGATED + 2, 0, CA_4001, IOA(1), 1);
}

static void test_interrogation_leaves_out_what_is_not_good(void **state)
{
	static const uint8_t bad[] = {MAP_INVALID, MAP_NOT_TOPICAL, MAP_OVERFLOW, MAP_BLOCKED,
				      MAP_SUBSTITUTED};

	(void)state;
	interrogate_group();
	EXPECT(0, M_ME_ND, 1, INTERROGATED + 2, 0, CA_4001, IOA(9), 0x00, 0x80);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 0, CA_4001, IOA(0), 22);
	for (size_t i = 0; i < sizeof(bad); i++) {
		acknowledge(&masters[0]);
		fake.samples[NORMALIZED].quality = bad[i];
		interrogate_group();
		EXPECT(0, C_IC_NA, 1, ACT_TERM, 0, CA_4001, IOA(0), 22);
	}
	expect_nothing(0);
}

/* Both kinds of normalized value, and two ranges of addresses around one that is not good. */
static void test_interrogation_packs_neighbours(void **state)
{
	struct map_point *first = &points[7];

	(void)state;
	for (unsigned i = 0; i < 6; i++) {
		first[i].type = MAP_NORMALIZED;
		first[i].flags |= i == 0 ? 0 : PLAIN;
		first[i].ioa = 30001 + i;
		fake.samples[7 + i] = (struct map_sample){.value.i = (int32_t)i};
	}
	fake.samples[7 + 3].quality = MAP_INVALID;
	ASK(0, C_IC_NA, 1, ACT, 0, CA_3067, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_3067, IOA(0), 20);
	EXPECT(0, M_SP_NA, 0x84, INTERROGATED, 0, CA_3067, IOA(1), 0, 1, 0, 1);
	EXPECT(0, M_SP_NA, 0x83, INTERROGATED, 0, CA_3067, IOA(10001), 0, 1, 0);
	EXPECT(0, M_ME_NA, 1, INTERROGATED, 0, CA_3067, IOA(30001), 0, 0, 0);
	EXPECT(0, M_ME_ND, 0x82, INTERROGATED, 0, CA_3067, IOA(30002), 1, 0, 2, 0);
	EXPECT(0, M_ME_ND, 0x82, INTERROGATED, 0, CA_3067, IOA(30005), 4, 0, 5, 0);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 0, CA_3067, IOA(0), 20);
	expect_nothing(0);
	for (unsigned i = 0; i < 6; i++) {
		first[i].type = MAP_SCALED;
		first[i].ioa = i < 3 ? 30001 + i : 40001 + i - 3;
	}
}

static void test_events(void **state)
{
	(void)state;
	publish(NORMALIZED, 1);
	publish_with(NORMALIZED, 2, MAP_OVERFLOW);
	publish_with(NORMALIZED, 2, MAP_INVALID);
	publish(NORMALIZED, 3);
	publish(NORMALIZED, 4);
	publish(COUNTER, 7);
	run();
	EXPECT(0, M_ME_ND, 1, SPONTANEOUS, 0, CA_4001, IOA(9), 1, 0);
	EXPECT(0, M_ME_ND, 2, SPONTANEOUS, 0, CA_4001, IOA(9), 3, 0, 9, 0, 0, 4, 0);
	EXPECT(0, M_IT_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(15), 7, 0, 0, 0, 0, TIME);
	return_information(NORMALIZED, 5);
	publish_with(NORMALIZED, 5, MAP_INVALID);
	run();
	EXPECT(0, M_ME_ND, 1, RETURN_REMOTE, 0, CA_4001, IOA(9), 5, 0);
	expect_nothing(0);
}

static void test_read(void **state)
{
	(void)state;
	ASK(0, C_RD_NA, 1, REQUEST, 7, CA_4001, IOA(9));
	EXPECT(0, M_ME_ND, 1, REQUEST, 7, CA_4001, IOA(9), 0x00, 0x80);
	fake.samples[NORMALIZED].quality = MAP_NOT_TOPICAL;
	ASK(0, C_RD_NA, 1, TEST_BIT | REQUEST, 7, CA_4001, IOA(9));
	EXPECT(0, C_RD_NA, 1, NEGATIVE | TEST_BIT | REQUEST, 7, CA_4001, IOA(9));
	expect_nothing(0);
	assert_int_equal(fake.stats.counters[IEC104_COUNT_NEGATIVE], 1);
}

static void test_cyclic(void **state)
{
	(void)state;
	now = 501 * S;
	run();
	EXPECT(0, M_ME_ND, 1, CYCLIC, 0, CA_4001, IOA(9), 0x00, 0x80);
	fake.samples[NORMALIZED].quality = MAP_INVALID;
	now = 502 * S;
	run();
	expect_nothing(0);
}

/* While its process is away nothing is told; when it is back, what is good. */
static void test_module_down_and_up(void **state)
{
	(void)state;
	fake.dead[2] = true;
	put_event(MAP_EVENT_MODULE_DOWN, 2, (struct map_sample){.time_ns = now});
	run();
	for (const uint8_t *frame; (frame = next_frame(&masters[0])) != NULL;)
		assert_int_not_equal(frame[6], 21);
	acknowledge(&masters[0]);
	fake.dead[2] = false;
	for (uint32_t i = DOUBLE1; i < POINTS; i++)
		fake.samples[i].quality = MAP_INVALID;
	fake.samples[NORMALIZED].quality = MAP_GOOD;
	put_event(MAP_EVENT_MODULE_UP, 2, (struct map_sample){.time_ns = now});
	run();
	EXPECT(0, M_ME_ND, 1, SPONTANEOUS, 0, CA_4001, IOA(9), 0x00, 0x80);
	expect_nothing(0);
}

#define PLAIN_TEST(name) cmocka_unit_test_setup_teardown(name, set_up_plain, tear_down_plain)

int main(void)
{
	const struct CMUnitTest tests[] = {
	    PLAIN_TEST(test_interrogation_leaves_out_what_is_not_good),
	    PLAIN_TEST(test_interrogation_packs_neighbours),
	    PLAIN_TEST(test_events),
	    PLAIN_TEST(test_read),
	    PLAIN_TEST(test_cyclic),
	    PLAIN_TEST(test_module_down_and_up),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
