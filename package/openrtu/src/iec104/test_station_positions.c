/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A position as one object, beside its mirror in the types of the standard: whatever is sent of it is of one fix. */
#include "iec104/test_masters.h"

#define CA_7001         0x59, 0x1b
#define OCTET(n, place) ((uint8_t)((uint32_t)(n) >> 8 * (place)))
#define I32(n)          OCTET(n, 0), OCTET(n, 1), OCTET(n, 2), OCTET(n, 3)
#define PLACE_OF        201

/* Fix number n: 45 degrees and n north, 20 degrees and n east, n m high. */
#define NORTH(n)  (450000000 + (n))
#define EAST(n)   (200000000 + (n))
#define OBJECT(n) I32(NORTH(n)), I32(EAST(n)), OCTET((n)*10, 0), OCTET((n)*10, 1), 0, 0x71, 0

static struct map_sample sample_of(unsigned place, int32_t n)
{
	struct map_sample sample = {.time_ns = now + n * MS};

	if (place == 0)
		sample.value.u = 0x71; /* an autonomous fix, 7 satellites */
	else if (place == 3)
		sample.value.f = (float)n;
	else
		sample.value.i = place == 1 ? NORTH(n) : EAST(n);
	return sample;
}

static void put_fix(int32_t n, unsigned events)
{
	for (unsigned i = 0; i < PLACE; i++)
		fake.samples[POSITION + i] = sample_of(i, n);
	for (unsigned i = 0; i < events; i++)
		put_event(MAP_EVENT_CHANGE, POSITION + i, sample_of(i, n));
}

static int with_receiver(void **state)
{
	int failed = set_up(state);

	fake_receiver();
	put_fix(0, 0);
	return failed;
}

#define RECEIVER(name) cmocka_unit_test_setup(name, with_receiver)

/* The next frame is a position, the n-th. */
static void expect_position(uint8_t cause, int32_t n)
{
	const uint8_t asdu[] = {PLACE_OF, 1, cause, 0, CA_7001, IOA(200), OBJECT(n)};
	const uint8_t *frame = next_frame(&masters[0]);

	assert_non_null(frame);
	assert_int_equal(frame[1] + 2, 35);
	assert_memory_equal(frame + 6, asdu, sizeof(asdu));
}

/* What the standard has of it follows. */
static void expect_mirror(int32_t n)
{
	const float altitude_m = (float)n;
	const uint8_t *frame = next_frame(&masters[0]);

	assert_non_null(frame);
	assert_int_equal(frame[6], M_ME_TF);
	assert_int_equal(frame[7], 3);
	assert_int_equal(frame[12], 1); /* the latitude */
	assert_memory_equal(frame + 12 + 2 * 15 + 3, &altitude_m, sizeof(altitude_m));
}

static void test_read(void **state)
{
	(void)state;
	put_fix(7, 0);
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_7001, IOA(200));
	expect_position(REQUEST, 7);
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_7001, IOA(3)); /* its mirror */
	EXPECT(0, M_ME_NC, 1, REQUEST, 0, CA_7001, IOA(3), 0, 0, 0xe0, 0x40, 0);
	expect_nothing(0);
}

static void test_interrogation_of_all_and_of_a_group(void **state)
{
	(void)state;
	put_fix(8, 0);
	ASK(0, C_IC_NA, 1, ACT, 0, CA_7001, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_7001, IOA(0), 20);
	expect_position(INTERROGATED, 8);
	assert_int_equal(next_frame(&masters[0])[6], M_ME_NC);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 0, CA_7001, IOA(0), 20);
	ASK(0, C_IC_NA, 1, ACT, 0, CA_7001, IOA(0), 23);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_7001, IOA(0), 23);
	expect_position(23, 8);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 0, CA_7001, IOA(0), 23);
	expect_nothing(0);
}

static void test_event_and_its_mirror(void **state)
{
	(void)state;
	put_fix(1, PLACE);
	put_fix(2, PLACE); /* both wait: each is its own */
	run();
	for (int32_t n = 1; n <= 2; n++) {
		expect_position(SPONTANEOUS, n);
		expect_mirror(n);
	}
	expect_nothing(0);
}

static void test_the_type_is_configurable(void **state)
{
	(void)state;
	fake.settings.position_type = 140;
	put_fix(1, PLACE);
	run();
	assert_int_equal(next_frame(&masters[0])[6], 140);
}

/* The owner was stopped after so many events: the map has the fix whole. */
static void test_owner_stopped_between_events(void **state)
{
	(void)state;
	for (unsigned events = 1; events < PLACE; events++) {
		put_fix((int32_t)events, events);
		run();
		expect_position(SPONTANEOUS, (int32_t)events);
		while (next_frame(&masters[0]) != NULL)
			acknowledge(&masters[0]);
	}
}

/* Neither its ring nor the map has the rest of the fix: it is not sent with that of another. */
static void test_what_is_not_whole_is_left_out(void **state)
{
	(void)state;
	put_fix(1, 2);
	put_fix(2, PLACE);
	run();
	assert_int_equal(next_frame(&masters[0])[6], M_ME_TF);
	expect_position(SPONTANEOUS, 2);
	expect_mirror(2);
	expect_nothing(0);
}

static void test_unacknowledged_events_are_sent_again(void **state)
{
	(void)state;
	masters[0].mute = true;
	put_fix(1, PLACE);
	run();
	expect_position(SPONTANEOUS, 1);
	acknowledge(&masters[0]); /* the position, not its mirror */
	expect_mirror(1);
	put_fix(2, PLACE);
	reconnect(0);
	start(0);
	expect_mirror(1);
	expect_position(SPONTANEOUS, 2);
}

/* After lost events all is sent as it is now, the position too. */
static void test_lost_events(void **state)
{
	(void)state;
	fake.event_capacity = 64;
	for (int32_t n = 1; n <= 40; n++)
		put_fix(n, PLACE);
	run();
	for (bool refreshed = false; !refreshed;) {
		const uint8_t *frame = next_frame(&masters[0]);

		if (frame == NULL) {
			acknowledge(&masters[0]);
			continue;
		}
		if (frame[6] != PLACE_OF)
			continue;
		assert_int_equal(frame[15] | frame[16] << 8 | frame[17] << 16 | frame[18] << 24,
				 (frame[19] | frame[20] << 8 | frame[21] << 16 | frame[22] << 24) + NORTH(0) -
				     EAST(0));
		refreshed = frame[15] == (NORTH(40) & 0xff);
	}
}

static void test_owner_is_down(void **state)
{
	const uint8_t *frame;

	(void)state;
	put_fix(5, 0);
	fake.dead[2] = true;
	put_event(MAP_EVENT_MODULE_DOWN, 2, (struct map_sample){.time_ns = now});
	run();
	while ((frame = next_frame(&masters[0])) != NULL && frame[6] != PLACE_OF)
		acknowledge(&masters[0]);
	assert_non_null(frame);
	assert_int_equal(frame[15], NORTH(5) & 0xff);
	assert_int_equal(frame[25], 0x80); /* an altitude is not said of an invalid place */
	assert_int_equal(frame[27], MAP_INVALID | MAP_OVERFLOW);
}

/* A receiver without a fix, and one that has said nothing yet. */
static void test_no_place(void **state)
{
	(void)state;
	for (unsigned i = 0; i < PLACE; i++)
		fake.samples[POSITION + i] = (struct map_sample){.quality = MAP_INVALID, .time_ns = now};
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_7001, IOA(200));
	EXPECT(0, PLACE_OF, 1, REQUEST, 0, CA_7001, IOA(200), I32(0), I32(0), 0, 0, 0x80, 0,
	       MAP_INVALID | MAP_OVERFLOW, TIME);
}

/* Without an altitude the position is as good: it says the least that there is, with overflow. */
static void test_altitude_is_not_known(void **state)
{
	(void)state;
	fake.samples[POSITION + 3].quality = MAP_INVALID;
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_7001, IOA(200));
	EXPECT(0, PLACE_OF, 1, REQUEST, 0, CA_7001, IOA(200), I32(NORTH(0)), I32(EAST(0)), 0, 0, 0x80, 0x71,
	       MAP_OVERFLOW, TIME);
	fake.samples[POSITION + 3] = (struct map_sample){.value.u = 0x7fc00000}; /* not a number */
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_7001, IOA(200));
	EXPECT(0, PLACE_OF, 1, REQUEST, 0, CA_7001, IOA(200), I32(NORTH(0)), I32(EAST(0)), 0, 0, 0x80, 0x71,
	       MAP_OVERFLOW, TIME);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    RECEIVER(test_read),
	    RECEIVER(test_interrogation_of_all_and_of_a_group),
	    RECEIVER(test_event_and_its_mirror),
	    RECEIVER(test_the_type_is_configurable),
	    RECEIVER(test_owner_stopped_between_events),
	    RECEIVER(test_what_is_not_whole_is_left_out),
	    RECEIVER(test_unacknowledged_events_are_sent_again),
	    RECEIVER(test_lost_events),
	    RECEIVER(test_owner_is_down),
	    RECEIVER(test_no_place),
	    RECEIVER(test_altitude_is_not_known),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
