/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The ring of what went over a line: order, overwriting, a reader that is slower than the writer. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "modbus/frames.h"

#define HEAD 12

static struct modbus_frames frames;
static struct modbus_frames_reader reader;

static int begin(void **state)
{
	(void)state;
	memset(&frames, 0, sizeof(frames));
	memset(&reader, 0, sizeof(reader));
	return 0;
}

/* Its octets are its number. */
static void add(unsigned number, size_t length)
{
	uint8_t octets[2 * MODBUS_PIECE_MAX];

	memset(octets, (int)(number % 256), sizeof(octets));
	modbus_frames_add(&frames, number % 2 ? MODBUS_RECEIVED : MODBUS_SENT, octets, length, number);
}

static void expect(unsigned number, size_t length)
{
	struct modbus_piece piece;

	assert_true(modbus_frames_next(&reader, &piece));
	assert_int_equal(piece.time_ns, number);
	assert_int_equal(piece.direction, number % 2 ? MODBUS_RECEIVED : MODBUS_SENT);
	assert_int_equal(piece.length, length);
	for (size_t i = 0; i < length; i++)
		assert_int_equal(piece.octets[i], number % 256);
}

static void expect_no_more(void)
{
	struct modbus_piece piece;

	assert_false(modbus_frames_next(&reader, &piece));
}

static void test_pieces_come_in_order_and_once(void **state)
{
	(void)state;
	modbus_frames_look(&frames, &reader);
	expect_no_more();
	add(1, 8);
	add(2, 0);
	modbus_frames_look(&frames, &reader);
	expect(1, 8);
	expect(2, 0);
	expect_no_more();
	add(3, 256);
	modbus_frames_look(&frames, &reader);
	expect(3, 256);
	expect_no_more();
	assert_false(reader.has_lost);
}

static void test_the_oldest_are_overwritten_as_whole_pieces(void **state)
{
	const unsigned kept = MODBUS_FRAMES_SIZE / (HEAD + 100);

	(void)state;
	for (unsigned number = 0; number < 1000; number++)
		add(number, 100);
	modbus_frames_look(&frames, &reader);
	for (unsigned number = 1000 - kept; number < 1000; number++)
		expect(number, 100);
	expect_no_more();
	assert_false(reader.has_lost);
}

static void test_a_reader_that_is_slow_knows_that_it_has_lost_some(void **state)
{
	(void)state;
	add(0, 100);
	modbus_frames_look(&frames, &reader);
	expect(0, 100);
	for (unsigned number = 1; number < 200; number++)
		add(number, 100);
	modbus_frames_look(&frames, &reader);
	assert_true(reader.has_lost);
	expect(200 - MODBUS_FRAMES_SIZE / (HEAD + 100), 100);
}

static void test_of_a_flood_the_beginning_is_kept(void **state)
{
	(void)state;
	add(7, 2 * MODBUS_PIECE_MAX);
	modbus_frames_look(&frames, &reader);
	expect(7, MODBUS_PIECE_MAX);
}

static void test_positions_wrap(void **state)
{
	(void)state;
	frames.oldest = frames.ended = reader.at = reader.end = UINT32_MAX - 50;
	reader.has_begun = true;
	for (unsigned number = 0; number < 70; number++)
		add(number, 100);
	modbus_frames_look(&frames, &reader);
	for (unsigned number = 0; number < 70; number++)
		expect(number, 100);
	expect_no_more();
	assert_false(reader.has_lost);
}

/* The ring is another process': whatever it says, nothing beyond is read. */
static void test_what_is_no_ring_ends_the_reading(void **state)
{
	struct modbus_piece piece;
	unsigned taken = 0;

	(void)state;
	memset(frames.octets, 0xff, sizeof(frames.octets));
	frames.ended = 5000;
	modbus_frames_look(&frames, &reader);
	expect_no_more();
	frames.oldest = 70000;
	modbus_frames_look(&frames, &reader);
	expect_no_more();
	begin(NULL);
	frames.ended = UINT32_MAX;
	modbus_frames_look(&frames, &reader);
	while (modbus_frames_next(&reader, &piece))
		taken++;
	assert_in_range(taken, 0, MODBUS_FRAMES_SIZE / HEAD);
}

#define MANY 300000u

static void write_many(struct modbus_frames *shared)
{
	uint8_t octets[256];

	for (unsigned number = 1; number <= MANY; number++) {
		memset(octets, (int)(number % 256), sizeof(octets));
		modbus_frames_add(shared, MODBUS_SENT, octets, number % 200, number);
	}
	_exit(0);
}

/* True: it is the last of all. */
static bool is_last(const struct modbus_piece *piece, int64_t *before)
{
	assert_true(piece->time_ns > *before);
	*before = piece->time_ns;
	assert_int_equal(piece->length, piece->time_ns % 200);
	for (size_t i = 0; i < piece->length; i++)
		assert_int_equal(piece->octets[i], piece->time_ns % 256);
	return piece->time_ns == MANY;
}

/* Another process writes meanwhile, faster than this one reads. */
static void test_no_piece_is_torn(void **state)
{
	struct modbus_frames *shared =
	    mmap(NULL, sizeof(*shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	struct modbus_piece piece;
	int64_t before = 0;
	bool ended = false;
	pid_t writer;
	int status;

	(void)state;
	assert_true(shared != MAP_FAILED);
	writer = fork();
	if (writer == 0)
		write_many(shared);
	while (!ended) {
		modbus_frames_look(shared, &reader);
		while (!ended && modbus_frames_next(&reader, &piece))
			ended = is_last(&piece, &before);
	}
	assert_int_equal(waitpid(writer, &status, 0), writer);
	assert_int_equal(status, 0);
	munmap(shared, sizeof(*shared));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_pieces_come_in_order_and_once, begin),
	    cmocka_unit_test_setup(test_the_oldest_are_overwritten_as_whole_pieces, begin),
	    cmocka_unit_test_setup(test_a_reader_that_is_slow_knows_that_it_has_lost_some, begin),
	    cmocka_unit_test_setup(test_of_a_flood_the_beginning_is_kept, begin),
	    cmocka_unit_test_setup(test_positions_wrap, begin),
	    cmocka_unit_test_setup(test_what_is_no_ring_ends_the_reading, begin),
	    cmocka_unit_test_setup(test_no_piece_is_torn, begin),
	};
	return cmocka_run_group_tests_name("frames", tests, NULL, NULL);
}
