/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The point map seen by several processes at once, one of which may die anywhere. */
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <sched.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include "map/layout.h"
#include "map/supervise.h"

#define POINTS 8
#define FIRST  "rtu-modbus-1"
#define SECOND "rtu-modbus-2"

struct stage {
	char dir[64];
	struct map_line lines[2];
	struct map_device devices[2];
	struct map_point points[POINTS];
	struct map_config config;
	struct map *rtud;
};

/* ---- the clock, which a test may shift, and look at in the middle of a call ----------------- */

static int64_t clock_shift_ns;
static void (*after_clock)(void); /* what happens between the reading of the clock and what is made of it */

#ifdef SYS_clock_gettime64 /* a 32-bit processor with 64-bit time_t */
#define READ_CLOCK SYS_clock_gettime64
#else
#define READ_CLOCK SYS_clock_gettime
#endif

/* In place of the C library's. */
int clock_gettime(clockid_t clock, struct timespec *out)
{
	long result = syscall(READ_CLOCK, clock, out);
	int64_t now_ns = out->tv_sec * 1000000000LL + out->tv_nsec + clock_shift_ns;

	out->tv_sec = now_ns / 1000000000;
	out->tv_nsec = (long)(now_ns % 1000000000);
	if (after_clock)
		after_clock();
	return (int)result;
}

/* The millisecond counter, which has 32 bits, wraps in so many ms. */
static void wrap_in_ms(int64_t ms)
{
	clock_shift_ns = 0;
	clock_shift_ns = ((INT64_C(1) << 32) - ms) * 1000000 - map_now_ns();
}

/* Two lines in two processes, a device each, four points a device. */
static int set_up(void **state)
{
	struct stage *stage = calloc(1, sizeof(*stage));
	char error[MAP_ERROR_SIZE];

	for (uint16_t i = 0; i < 2; i++) {
		stage->lines[i] = (struct map_line){
		    .port = i + 1, .process = i + 1, .first_device = i, .device_count = 1, .baud = 9600};
		stage->devices[i] = (struct map_device){.line = i,
							.unit = 1,
							.ca = (uint16_t)(1000 * (i + 1) + 1),
							.first_point = i * 4u,
							.point_count = 4};
	}
	for (uint16_t i = 0; i < POINTS; i++)
		stage->points[i] = (struct map_point){.device = i / 4,
						      .address = i % 4,
						      .table = MAP_HOLDING_REGISTERS,
						      .type = MAP_SCALED,
						      .width = 1,
						      .flags = i % 4 ? MAP_POINT_COMMAND : 0,
						      .ioa = 40001u + i % 4,
						      .scale = 1};
	stage->points[3].flags |= MAP_POINT_SELECT;
	stage->config = (struct map_config){
	    .settings = {.event_ring = 64, .select_timeout_s = 30, .command_timeout_s = 10},
	    .line_count = 2,
	    .device_count = 2,
	    .point_count = POINTS,
	    .lines = stage->lines,
	    .devices = stage->devices,
	    .points = stage->points};
	strcpy(stage->dir, "/tmp/test_map.XXXXXX");
	assert_non_null(mkdtemp(stage->dir));
	if (map_create(&stage->rtud, stage->dir, &stage->config, 0, error) < 0)
		fail_msg("%s", error);
	*state = stage;
	return 0;
}

static int tear_down(void **state)
{
	struct stage *stage = *state;

	clock_shift_ns = 0;
	after_clock = NULL;
	map_remove(stage->rtud);
	map_detach(stage->rtud);
	assert_int_equal(rmdir(stage->dir), 0); /* nothing of the map is left behind */
	free(stage);
	return 0;
}

static uint32_t index_of(const struct stage *stage, const char *name)
{
	for (uint32_t i = 0; i < map_module_count(stage->rtud); i++) {
		struct map_module module;

		map_module(stage->rtud, i, &module);
		if (strcmp(module.name, name) == 0)
			return i;
	}
	fail_msg("no module %s", name);
	return MAP_NONE;
}

/* A new generation of a module, in this process. */
static struct map *start(struct stage *stage, const char *name)
{
	char error[MAP_ERROR_SIZE];
	struct map *map;

	map_module_starting(stage->rtud, index_of(stage, name));
	if (map_attach(&map, stage->dir, name, error) < 0)
		fail_msg("%s", error);
	return map;
}

static struct map_update scaled(uint32_t point, int32_t value, uint8_t quality, int64_t time_ns)
{
	return (struct map_update){point, {.value.i = value, .quality = quality, .time_ns = time_ns}};
}

static void assert_sample(const struct map *map, uint32_t point, int32_t value, uint8_t quality)
{
	struct map_sample sample;

	assert_true(map_read(map, point, &sample));
	assert_int_equal(sample.value.i, value);
	assert_int_equal(sample.quality, quality);
}

static void test_published_samples_are_read_by_others(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *reader = start(stage, "rtu-iec104");
	struct map_update updates[] = {scaled(1, 1500, MAP_GOOD, 10), scaled(2, -1, MAP_OVERFLOW, 10)};

	map_publish(owner, updates, 2);
	assert_sample(reader, 1, 1500, MAP_GOOD);
	assert_sample(reader, 2, -1, MAP_OVERFLOW);
	map_detach(owner);
	map_detach(reader);
}

static void test_a_segment_is_read_only_for_others(void **state)
{
	struct stage *stage = *state;
	struct map *reader = start(stage, "rtu-iec104");
	pid_t child = fork();
	int status;

	if (child == 0) {
		signal(SIGSEGV, SIG_DFL);
		reader->segments[index_of(stage, FIRST)].header->magic = 0;
		_exit(0);
	}
	waitpid(child, &status, 0);
	assert_true(WIFSIGNALED(status) || WEXITSTATUS(status) != 0); /* a sanitizer exits instead */
	map_detach(reader);
}

static void test_points_are_invalid_before_the_first_sample_and_after_the_end(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(0, 7, MAP_GOOD, 10);
	uint32_t index = index_of(stage, FIRST);

	assert_sample(stage->rtud, 0, 0, MAP_INVALID);
	map_publish(owner, &update, 1);
	assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	map_module_ended(stage->rtud, index, true);
	assert_sample(stage->rtud, 0, 7, MAP_INVALID);
	assert_false(map_wanted(owner));
	map_detach(owner);

	owner = start(stage, FIRST); /* the next generation has not read the device yet */
	assert_sample(stage->rtud, 0, 7, MAP_INVALID);
	map_detach(owner);
}

static void test_points_are_invalid_when_the_heartbeat_stops(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(0, 7, MAP_GOOD, 10);
	int64_t beaten;

	map_publish(owner, &update, 1);
	map_heartbeat(owner);
	beaten = map_now_ns();
	for (;;) {
		struct map_sample sample;
		int64_t before = map_now_ns();

		assert_true(map_read(stage->rtud, 0, &sample));
		if (sample.quality == MAP_INVALID)
			break;
		assert_true(before - beaten <= (MAP_HEARTBEAT_LIMIT_MS + 1) * 1000000LL);
	}
	assert_true(map_now_ns() - beaten >= (MAP_HEARTBEAT_LIMIT_MS - 1) * 1000000LL);
	map_heartbeat(owner);
	assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	map_detach(owner);
}

static void test_a_heartbeat_lives_on_when_the_millisecond_counter_wraps(void **state)
{
	struct stage *stage = *state;
	struct map *owner;
	struct map_update update = scaled(0, 7, MAP_GOOD, 10);
	struct map_module module;
	uint32_t before;

	wrap_in_ms(20);
	owner = start(stage, FIRST);
	map_publish(owner, &update, 1);
	before = now_ms();
	map_heartbeat(owner);
	while (now_ms() >= before)
		assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	assert_sample(stage->rtud, 0, 7, MAP_GOOD); /* beaten before the wrap, read after it */
	clock_shift_ns += (MAP_HEARTBEAT_LIMIT_MS + 1) * 1000000;
	assert_sample(stage->rtud, 0, 7, MAP_INVALID);
	map_detach(owner);

	owner = start(stage, FIRST);
	map_module(stage->rtud, index_of(stage, FIRST), &module);
	assert_true(map_now_ns() - module.started_ns < 2000000000); /* since 50 days, not since 0 */
	map_detach(owner);
}

static struct segment_header *beating;

static void beat_a_millisecond_later(void)
{
	after_clock = NULL;
	beating->heartbeat_ms = now_ms() + 1;
}

static void test_a_heartbeat_while_its_age_is_taken_is_not_an_old_one(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(0, 7, MAP_GOOD, 10);

	map_publish(owner, &update, 1);
	beating = owner->segments[owner->self].header;
	after_clock = beat_a_millisecond_later;
	assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	assert_null(after_clock); /* it did happen */
	map_detach(owner);
}

static void test_events_are_changes_beyond_the_deadband(void **state)
{
	struct stage *stage = *state;
	struct map *owner, *reader;
	struct map_cursor *cursor;
	struct map_event event;
	const struct map_update updates[] = {scaled(0, 100, MAP_GOOD, 1), scaled(0, 105, MAP_GOOD, 2),
					     scaled(0, 94, MAP_GOOD, 3), scaled(0, 94, MAP_INVALID, 4),
					     scaled(0, 94, MAP_INVALID, 5)};
	const int64_t expected[] = {1, 3, 4};

	stage->rtud->config.points[0].deadband = 5;
	owner = start(stage, FIRST);
	reader = start(stage, "rtu-iec104");
	cursor = map_cursor(reader, 0);
	map_cursor_to_end(reader, cursor);
	for (size_t i = 0; i < 5; i++)
		map_publish(owner, &updates[i], 1);
	for (size_t i = 0; i < 3; i++) {
		assert_true(map_event_next(reader, cursor, &event));
		assert_int_equal(event.kind, MAP_EVENT_CHANGE);
		assert_int_equal(event.point, 0);
		assert_int_equal(event.sample.time_ns, expected[i]);
	}
	assert_false(map_event_next(reader, cursor, &event));
	map_detach(owner);
	map_detach(reader);
}

static void test_events_of_several_modules_come_in_order_of_time(void **state)
{
	struct stage *stage = *state;
	struct map *first = start(stage, FIRST), *second = start(stage, SECOND);
	struct map_cursor cursor = {0};
	struct map_event event;
	const int64_t times[] = {10, 20, 30, 40};

	for (int i = 0; i < 4; i++) {
		struct map_update update = scaled(i % 2 ? 4 : 0, i + 1, MAP_GOOD, times[i]);

		map_publish(i % 2 ? second : first, &update, 1);
	}
	for (int i = 0; i < 4; i++) {
		assert_true(map_event_next(stage->rtud, &cursor, &event));
		assert_int_equal(event.sample.time_ns, times[i]);
	}
	map_detach(first);
	map_detach(second);
}

static void test_lost_events_are_counted(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_cursor cursor = {0};
	struct map_event event;
	uint32_t read = 0;

	for (int i = 1; i <= 100; i++) {
		struct map_update update = scaled(0, i, MAP_GOOD, i);

		map_publish(owner, &update, 1);
	}
	while (map_event_next(stage->rtud, &cursor, &event)) {
		read++;
		assert_int_equal(event.sample.value.i, 100 - 63 + read); /* the newest 63 of a ring of 64 */
	}
	assert_int_equal(read, 63);
	assert_int_equal(cursor.lost, 37);
	map_detach(owner);
}

static void test_a_forged_event_is_not_believed(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_cursor cursor = {0};
	struct map_event event;
	const struct map_event forged[] = {
	    {.point = 4, .kind = MAP_EVENT_CHANGE}, /* another module's point */
	    {.point = 4000000, .kind = MAP_EVENT_CHANGE},
	    {.point = 0, .kind = MAP_EVENT_MODULE_DOWN}, /* rtud's to say */
	    {.point = 0, .kind = 99},
	    /* after its writer's end, and good */
	    {.point = 0, .kind = MAP_EVENT_CHANGE, .sample.time_ns = map_now_ns() + 1000000000},
	    {.point = 0, .kind = MAP_EVENT_CHANGE, .sample.time_ns = INT64_MIN},
	};

	for (size_t i = 0; i < sizeof(forged) / sizeof(forged[0]); i++)
		ring_put(&owner->segments[owner->self].events, &forged[i]);
	assert_false(map_event_next(stage->rtud, &cursor, &event));
	map_detach(owner);
}

/* ---- commands ---------------------------------------------------------------------------- */

struct command_stage {
	struct map *owner, *requester;
};

static struct command_stage start_commands(struct stage *stage)
{
	return (struct command_stage){start(stage, FIRST), start(stage, "rtu-iec104")};
}

static void end_commands(struct command_stage *commands)
{
	map_detach(commands->owner);
	map_detach(commands->requester);
}

static struct map_request request(uint32_t point, enum map_action action, uint32_t session, int32_t value)
{
	return (struct map_request){.point = point,
				    .action = (uint8_t)action,
				    .session = session,
				    .value.i = value,
				    .time_ns = map_now_ns(),
				    .deadline_ns = map_now_ns() + 1000000000};
}

/* Posts it and lets the owner take it. Returns whether the owner shall execute. */
static bool post(struct command_stage *commands, struct map_request wish)
{
	struct map_request taken;

	assert_int_not_equal(map_request_post(commands->requester, wish), 0);
	assert_true(map_request_next(commands->owner, &taken));
	return map_command_request(commands->owner, &taken);
}

static void assert_answer(struct command_stage *commands, enum map_command_state state,
			  enum map_command_result result)
{
	struct map_answer answer;

	assert_true(map_answer_next(commands->requester, &answer));
	assert_int_equal(answer.state, state);
	assert_int_equal(answer.result, result);
}

static void assert_command(const struct stage *stage, uint32_t point, enum map_command_state state)
{
	struct map_command command;

	assert_true(map_command_read(stage->rtud, point, &command));
	assert_int_equal(command.state, state);
}

static void test_a_direct_command_is_executed_and_released(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_answer answer;

	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 255)));
	assert_answer(&commands, MAP_EXECUTING, MAP_RESULT_NONE);
	assert_command(stage, 1, MAP_EXECUTING);
	map_command_finish(commands.owner, 1, MAP_RESULT_EXCEPTION, 2);
	assert_true(map_answer_next(commands.requester, &answer));
	assert_int_equal(answer.state, MAP_REFUSED_COMMAND);
	assert_int_equal(answer.result, MAP_RESULT_EXCEPTION);
	assert_int_equal(answer.detail, 2);
	assert_false(post(&commands, request(1, MAP_RELEASE, 1, 0)));
	assert_false(map_answer_next(commands.requester, &answer));
	assert_command(stage, 1, MAP_INACTIVE);
	end_commands(&commands);
}

static void test_a_selection_binds_requester_and_value(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 9)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);

	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_false(post(&commands, request(3, MAP_SELECT, 2, 9)));
	assert_answer(&commands, MAP_REFUSED_SELECTION, MAP_RESULT_INTERLOCK);
	assert_false(post(&commands, request(3, MAP_EXECUTE, 2, 9)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
	assert_command(stage, 3, MAP_ACCEPTED_SELECTION); /* a stranger does not end it */

	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 8)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 9))); /* the wrong value ended it */
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);

	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_true(post(&commands, request(3, MAP_EXECUTE, 1, 9)));
	assert_answer(&commands, MAP_EXECUTING, MAP_RESULT_NONE);
	map_command_finish(commands.owner, 3, MAP_RESULT_DONE, 0);
	assert_answer(&commands, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	end_commands(&commands);
}

static void test_a_selection_is_cancelled_by_its_holder(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_false(post(&commands, request(3, MAP_CANCEL, 2, 9)));
	assert_answer(&commands, MAP_REFUSED_SELECTION, MAP_RESULT_NOT_SELECTED);
	assert_false(post(&commands, request(3, MAP_CANCEL, 1, 9)));
	assert_answer(&commands, MAP_INTERRUPTED_SELECTION, MAP_RESULT_DONE);
	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 9)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	end_commands(&commands);
}

static void test_a_selection_ends_by_itself(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	stage->rtud->directory->settings.select_timeout_s = 0;
	commands.owner->config.settings.select_timeout_s = 0;
	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 9)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	end_commands(&commands);
}

static void test_a_selection_ends_with_its_requesters_process(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	map_detach(commands.requester);

	commands.requester = start(stage, "rtu-iec104");
	assert_false(
	    post(&commands, request(3, MAP_EXECUTE, 1, 9))); /* the same session number is another's */
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	assert_false(post(&commands, request(3, MAP_SELECT, 2, 8)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	end_commands(&commands);
}

static void test_one_command_a_point_at_a_time(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 1)));
	assert_answer(&commands, MAP_EXECUTING, MAP_RESULT_NONE);
	assert_false(post(&commands, request(1, MAP_EXECUTE, 2, 2)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
	assert_true(post(&commands, request(2, MAP_EXECUTE, 2, 2))); /* another point */
	end_commands(&commands);
}

static void test_old_and_impossible_commands_are_refused(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_request old = request(1, MAP_EXECUTE, 1, 1);

	old.deadline_ns = map_now_ns() - 1;
	assert_false(post(&commands, old));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_TOO_OLD);
	assert_false(post(&commands, request(0, MAP_EXECUTE, 1, 1)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_COMMANDABLE);
	end_commands(&commands);
}

static void test_nothing_is_repeated_after_a_crash(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_request taken;
	struct map_command command;

	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 1)));
	assert_int_not_equal(map_request_post(commands.requester, request(2, MAP_EXECUTE, 1, 1)), 0);
	map_module_ended(stage->rtud, index_of(stage, FIRST), true);
	assert_int_equal(map_request_post(commands.requester, request(2, MAP_EXECUTE, 1, 1)), 0);
	map_detach(commands.owner);

	commands.owner = start(stage, FIRST);
	assert_false(map_request_next(commands.owner, &taken));
	assert_true(map_command_read(stage->rtud, 1, &command));
	assert_int_equal(command.state, MAP_REFUSED_COMMAND);
	assert_int_equal(command.result, MAP_RESULT_UNKNOWN_FATE);
	end_commands(&commands);
}

/* ---- counters that wrap ------------------------------------------------------------------ */

static void test_a_latch_wraps(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);

	atomic_store(&owner->segments[owner->self].latches[0], UINT32_MAX - 3);
	owner = (map_detach(owner), start(stage, FIRST)); /* both copies are whole again */
	for (int32_t i = 1; i <= 6; i++) {
		struct map_update update = scaled(0, i, MAP_GOOD, i);

		map_publish(owner, &update, 1);
		assert_sample(stage->rtud, 0, i, MAP_GOOD);
	}
	map_detach(owner);
}

static void test_an_event_ring_wraps(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_cursor cursor;
	struct map_event event;

	atomic_store(owner->segments[owner->self].events.head, UINT32_MAX - 1);
	map_cursor_to_end(stage->rtud, &cursor);
	for (int32_t i = 1; i <= 100; i++) {
		struct map_update update = scaled(0, i, MAP_GOOD, i);

		map_publish(owner, &update, 1);
		if (i > 4) /* the others stay until they are overwritten */
			continue;
		assert_true(map_event_next(stage->rtud, &cursor, &event));
		assert_int_equal(event.sample.value.i, i);
	}
	for (int32_t i = 100 - 62; i <= 100; i++) {
		assert_true(map_event_next(stage->rtud, &cursor, &event));
		assert_int_equal(event.sample.value.i, i);
	}
	assert_int_equal(cursor.lost, 100 - 4 - 63);
	assert_false(map_event_next(stage->rtud, &cursor, &event));
	map_detach(owner);
}

static void test_requests_and_answers_wrap(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map *owner = commands.owner, *requester = commands.requester;
	struct map_request taken;
	const uint32_t ids[] = {UINT32_MAX, 1, 2}; /* 0 is no id */

	requester->segments[requester->self].header->next_request = UINT32_MAX;
	atomic_store(requester->segments[requester->self].requests.head, UINT32_MAX);
	atomic_store(owner->segments[owner->self].answers.head, UINT32_MAX);
	owner->segments[owner->self].header->request_next[requester->self] = UINT32_MAX;
	requester->segments[requester->self].header->answer_next[owner->self] = UINT32_MAX;
	for (int i = 0; i < 3; i++) {
		assert_int_equal(map_request_post(requester, request(1, MAP_SELECT, 1, 5)), ids[i]);
		assert_true(map_request_next(owner, &taken));
		assert_int_equal(taken.id, ids[i]);
		assert_false(map_command_request(owner, &taken));
		assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	}
	end_commands(&commands);
}

/* ---- a module gone wild -------------------------------------------------------------------- */

static bool bell_is_ringing(const struct map *map)
{
	struct pollfd bell = {.fd = map_bell_fd(map), .events = POLLIN};

	return poll(&bell, 1, 0) == 1;
}

static void test_a_flood_of_requests_holds_nobody_up(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_request taken;
	unsigned count = 0;

	for (int turn = 1; turn <= 3; turn++) {
		map_bell_clear(commands.owner);
		do
			map_request_post(commands.requester, request(1, MAP_SELECT, 1, 1));
		while (map_request_next(commands.owner, &taken) && ++count < 10000);
		assert_int_equal(count, turn * 256);
		assert_true(bell_is_ringing(commands.owner)); /* the rest is not forgotten */
	}
	end_commands(&commands);
}

static void test_a_flooded_bell_is_cleared_in_one_go(void **state)
{
	struct stage *stage = *state;
	struct map *map = start(stage, FIRST);

	for (int i = 0; i < 100000; i++)
		bell_ring(stage->rtud, map->self);
	map_bell_clear(map);
	assert_true(bell_is_ringing(map)); /* it did not stay to empty the pipe */
	for (int i = 0; i < 100; i++)
		map_bell_clear(map);
	assert_false(bell_is_ringing(map));
	map_detach(map);
}

static void test_a_line_process_commands_nobody(void **state)
{
	struct stage *stage = *state;
	struct map *wild = start(stage, FIRST), *owner = start(stage, SECOND);
	struct map_request taken, clock = {.action = MAP_SET_CLOCK};

	map_heartbeat(stage->rtud);
	assert_int_not_equal(map_request_post(wild, request(5, MAP_EXECUTE, 1, 1)), 0);
	assert_int_not_equal(map_request_post(wild, clock), 0);
	assert_false(map_request_next(owner, &taken));
	assert_false(map_request_next(stage->rtud, &taken));
	map_detach(wild);
	map_detach(owner);
}

/* Everything that others read of a module. Each loop ends, and nothing is read beyond the segment. */
static void read_all(struct map *map)
{
	struct map_cursor cursor = {0};
	struct map_event event;
	struct map_answer answer;
	struct map_request taken;
	struct map_sample sample;
	struct map_command command;

	map_bell_clear(map);
	while (map_event_next(map, &cursor, &event))
		assert_true(is_past(event.sample.time_ns));
	while (map_request_next(map, &taken))
		map_command_request(map, &taken);
	while (map_answer_next(map, &answer))
		;
	for (uint32_t i = 0; i < POINTS; i++) {
		assert_true(map_read(map, i, &sample) && is_past(sample.time_ns));
		assert_true(map_command_read(map, i, &command) && is_past(command.time_ns));
	}
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		struct map_module module;
		struct map_log_line line;
		uint32_t position = 0;

		map_module(map, i, &module);
		while (map_log_next(map, i, &position, &line))
			assert_true(memchr(line.text, 0, sizeof(line.text)) && is_past(line.time_ns));
	}
}

static void fill_with_noise(struct map *map, unsigned seed)
{
	struct segment *own = &map->segments[map->self];
	uint8_t *bytes = (uint8_t *)own->header;

	srandom(seed);
	for (size_t i = 0; i < own->size; i++)
		bytes[i] = (uint8_t)random();
}

static void test_noise_in_a_segment_harms_nobody_else(void **state)
{
	struct stage *stage = *state;
	const char *const wild[] = {FIRST, "rtu-iec104"};

	for (unsigned seed = 0; seed < 20; seed++) {
		struct map *noisy = start(stage, wild[seed % 2]), *other = start(stage, SECOND), *observer;
		struct map_update update = scaled(4, (int32_t)seed, MAP_GOOD, 1);
		struct map_sample sample;
		char error[MAP_ERROR_SIZE];

		fill_with_noise(noisy, seed);
		map_publish(other, &update, 1);
		read_all(other);
		assert_sample(stage->rtud, 4, (int32_t)seed, MAP_GOOD);
		assert_int_equal(map_attach(&observer, stage->dir, NULL, error), 0);
		map_detach(observer);
		map_module_ended(stage->rtud, noisy->self, true);
		map_detach(noisy);

		noisy = start(stage, wild[seed % 2]); /* and its next generation is well */
		read_all(noisy);
		if (seed % 2 == 0) {
			update = scaled(0, 9, MAP_GOOD, 1);
			map_publish(noisy, &update, 1);
			assert_sample(stage->rtud, 0, 9, MAP_GOOD);
			assert_true(map_read(stage->rtud, 1, &sample));
			assert_true(sample.quality & MAP_INVALID);
		}
		map_detach(noisy);
		map_detach(other);
	}
}

/* ---- attaching --------------------------------------------------------------------------- */

static void test_attaching_fails_with_a_reason(void **state)
{
	struct stage *stage = *state;
	struct segment_header *header = stage->rtud->segments[MAP_RTUD].header;
	char error[MAP_ERROR_SIZE];
	struct map *map;

	assert_int_equal(map_attach(&map, "/nonexistent/map", NULL, error), -1);
	assert_non_null(strstr(error, "does rtud run?"));
	assert_int_equal(map_attach(&map, stage->dir, "rtu-gps", error), -1);
	assert_string_equal(error, "the map has no module rtu-gps");
	assert_int_equal(map_create(&map, stage->dir, &stage->config, 0, error), -1);
	assert_non_null(strstr(error, "another rtud runs"));
	header->layout++;
	assert_int_equal(map_attach(&map, stage->dir, NULL, error), -1);
	assert_non_null(strstr(error, "restart rtud and all modules of one version"));
	header->layout--;
	header->fingerprint++;
	assert_int_equal(map_attach(&map, stage->dir, NULL, error), -1);
	assert_non_null(strstr(error, "built differently"));
	header->fingerprint--;
}

/* As a module's user, who may not write to the file. 0: attached by the descriptor, and let go of it. */
static int attach_handed(const struct stage *stage, int segment)
{
	char error[MAP_ERROR_SIZE], path[128];
	struct stat status;
	struct map *map;

	if (geteuid() == 0 && setuid(65534) < 0)
		return 1;
	snprintf(path, sizeof(path), "%s/" FIRST ".seg", stage->dir);
	if (open(path, O_RDWR) >= 0 || map_attach(&map, stage->dir, FIRST, error) == 0)
		return 2;
	if (dup2(segment, MAP_SEGMENT_FD) < 0 || map_attach(&map, stage->dir, FIRST, error) < 0)
		return 3;
	map_heartbeat(map);
	/* the number may be a bell's by now */
	return fstat(MAP_SEGMENT_FD, &status) == 0 && S_ISREG(status.st_mode) ? 4 : 0;
}

static void test_a_module_cannot_truncate_its_segment(void **state)
{
	struct stage *stage = *state;
	int segment = map_segment_open(stage->rtud, index_of(stage, FIRST)), status;
	char path[128];
	pid_t child;

	assert_true(segment >= 0);
	segment = fcntl(segment, F_DUPFD, MAP_SEGMENT_FD + 1);
	snprintf(path, sizeof(path), "%s/" FIRST ".seg", stage->dir);
	assert_int_equal(chmod(stage->dir, 0711), 0);
	/* for a tester who is not root: his file, and yet not his to write */
	assert_int_equal(chmod(path, 0444), 0);
	child = fork();
	if (child == 0)
		_exit(attach_handed(stage, segment));
	waitpid(child, &status, 0);
	assert_true(WIFEXITED(status));
	assert_int_equal(WEXITSTATUS(status), 0);
	close(segment);
}

static void assert_folder_refused(const char *dir, const struct map_config *config, const char *why)
{
	char error[MAP_ERROR_SIZE] = "";
	struct map *map;

	assert_int_equal(map_create(&map, dir, config, 0, error), -1);
	assert_non_null(strstr(error, why));
}

static void test_a_folder_that_others_may_write_to_is_refused(void **state)
{
	struct stage *stage = *state;
	char dir[80], link[80], error[MAP_ERROR_SIZE];
	struct stat status;
	struct map *map;

	snprintf(dir, sizeof(dir), "%s.other", stage->dir);
	snprintf(link, sizeof(link), "%s.link", stage->dir);
	assert_int_equal(mkdir(dir, 0700), 0);
	assert_int_equal(symlink(dir, link), 0);
	assert_folder_refused(link, &stage->config, "cannot open the map's folder");
	assert_int_equal(chmod(dir, 0777), 0);
	assert_folder_refused(dir, &stage->config, "writable by another user");
	assert_int_equal(unlink(link), 0);
	assert_int_equal(rmdir(dir), 0); /* nothing was put there */

	umask(0077); /* whatever it is, modules may pass, and nobody may open the folder for its lock */
	assert_int_equal(map_create(&map, dir, &stage->config, 0, error), 0);
	umask(0022);
	assert_int_equal(stat(dir, &status), 0);
	assert_int_equal(status.st_mode & 0777, 0711);
	map_remove(map);
	map_detach(map);
	assert_int_equal(rmdir(dir), 0);
}

static void test_points_are_found_by_address(void **state)
{
	struct stage *stage = *state;

	for (uint32_t i = 0; i < POINTS; i++)
		assert_int_equal(map_find(stage->rtud, i < 4 ? 1001 : 2001, 40001 + i % 4), i);
	assert_int_equal(map_find(stage->rtud, 1001, 40005), MAP_NONE);
	assert_int_equal(map_find(stage->rtud, 1002, 40001), MAP_NONE);
	assert_int_equal(map_find(stage->rtud, 0, 0), MAP_NONE);
}

static void test_the_log_is_read_line_by_line(void **state)
{
	struct stage *stage = *state;
	struct map *module = start(stage, FIRST);
	struct map_log_line line;
	uint32_t position = 0;

	map_log(module, MAP_LOG_WARNING, "device %d is dead", 67);
	assert_true(map_log_next(stage->rtud, index_of(stage, FIRST), &position, &line));
	assert_string_equal(line.text, "device 67 is dead");
	assert_int_equal(line.level, MAP_LOG_WARNING);
	assert_false(map_log_next(stage->rtud, index_of(stage, FIRST), &position, &line));
	map_log(module, MAP_LOG_ERROR, "x\n2026-01-01 rtud error: forged \x1b[2J\x7f \xc4\x8d");
	assert_true(map_log_next(stage->rtud, index_of(stage, FIRST), &position, &line));
	assert_string_equal(line.text, "x?2026-01-01 rtud error: forged ?[2J? \xc4\x8d");
	map_detach(module);
}

/* ---- a writer that is killed or stopped anywhere ------------------------------------------- */

/* All four points of a device always carry one number, so that a torn set shows. */
__attribute__((noreturn)) static void publish_for_ever(struct stage *stage)
{
	char error[MAP_ERROR_SIZE];
	struct map *map;

	if (map_attach(&map, stage->dir, FIRST, error) < 0)
		_exit(1);
	for (int32_t i = 1;; i++) {
		struct map_update updates[4];

		for (uint32_t point = 0; point < 4; point++)
			updates[point] = scaled(point, i, MAP_GOOD, i);
		map_publish(map, updates, 4);
		map_heartbeat(map);
	}
}

/* No events, so that the writer is nearly always inside an update. */
static pid_t start_publisher(struct stage *stage)
{
	struct map_sample sample = {.quality = MAP_INVALID};
	uint32_t index = index_of(stage, FIRST);
	pid_t child;

	for (uint32_t point = 0; point < 4; point++)
		stage->rtud->config.points[point].deadband = INFINITY;
	map_module_starting(stage->rtud, index);
	child = fork();
	if (child == 0)
		publish_for_ever(stage);
	while (!map_read(stage->rtud, 0, &sample) || (sample.quality & MAP_INVALID))
		assert_int_equal(waitpid(child, NULL, WNOHANG), 0);
	return child;
}

/* Both copies agree with the sequence: the readable one is whole over all points. */
static void assert_readable_copy_is_whole(const struct stage *stage)
{
	const struct segment *segment = &stage->rtud->segments[index_of(stage, FIRST)];
	unsigned whole = latch_whole_copy(&segment->latches[0]);

	for (int point = 1; point < 4; point++) {
		assert_int_equal(segment->samples[whole][point].value.i, segment->samples[whole][0].value.i);
		assert_int_equal(segment->samples[whole][point].time_ns, segment->samples[whole][0].value.i);
	}
}

static void test_a_writer_killed_anywhere_leaves_whole_values(void **state)
{
	struct stage *stage = *state;

	for (int round = 0; round < 50; round++) {
		pid_t writer = start_publisher(stage);
		int64_t until = map_now_ns() + (round * 37 % 100) * 10000;

		while (map_now_ns() < until)
			;
		kill(writer, SIGKILL);
		waitpid(writer, NULL, 0);
		map_module_ended(stage->rtud, index_of(stage, FIRST), true);
		assert_readable_copy_is_whole(stage);
	}
}

/* Where the writer below stops: before, inside and after the filling of each copy. */
enum stop { STOP_AFTER_FIRST_TURN, STOP_IN_FIRST_COPY, STOP_AFTER_SECOND_TURN, STOP_IN_SECOND_COPY, STOPS };

static void stop_here(enum stop wanted, int copy, bool inside)
{
	if (wanted == (enum stop)(copy * 2 + inside))
		raise(SIGSTOP);
}

/* map_publish, with a stop in the middle. */
__attribute__((noreturn)) static void publish_and_stop(struct stage *stage, enum stop stop)
{
	char error[MAP_ERROR_SIZE];
	const struct segment *own;
	struct map *map;

	if (map_attach(&map, stage->dir, FIRST, error) < 0)
		_exit(1);
	for (uint32_t point = 0; point < 4; point++)
		map_publish(map, &(struct map_update){point, {.value.i = 1, .time_ns = 1}}, 1);
	own = &map->segments[map->self];
	for (int copy = 0; copy < 2; copy++) {
		unsigned turn = latch_turn(&own->latches[0]);

		stop_here(stop, copy, false);
		for (uint32_t point = 0; point < 4; point++) {
			own->samples[turn][point] = (struct map_sample){.value.i = 2, .time_ns = 2};
			if (point == 1)
				stop_here(stop, copy, true);
		}
	}
	_exit(0);
}

/* A real-time process on the writer's own core, where that is allowed: it would wait for ever for a lock. */
static void become_real_time_on_core_of(pid_t writer)
{
	const struct sched_param priority = {.sched_priority = 50};
	cpu_set_t one;

	CPU_ZERO(&one);
	CPU_SET(0, &one);
	sched_setaffinity(writer, sizeof(one), &one);
	sched_setaffinity(0, sizeof(one), &one);
	sched_setscheduler(0, SCHED_FIFO, &priority);
}

static void become_ordinary(const cpu_set_t *cpus)
{
	const struct sched_param priority = {0};

	sched_setscheduler(0, SCHED_OTHER, &priority);
	sched_setaffinity(0, sizeof(*cpus), cpus);
}

static void test_a_stopped_writer_does_not_hold_up_a_real_time_reader(void **state)
{
	struct stage *stage = *state;
	cpu_set_t cpus;

	sched_getaffinity(0, sizeof(cpus), &cpus);
	for (enum stop stop = 0; stop < STOPS; stop++) {
		struct map_sample sample;
		pid_t writer;
		int status;

		map_module_starting(stage->rtud, index_of(stage, FIRST));
		writer = fork();
		if (writer == 0)
			publish_and_stop(stage, stop);
		waitpid(writer, &status, WUNTRACED);
		assert_true(WIFSTOPPED(status));
		become_real_time_on_core_of(writer);
		for (uint32_t point = 0; point < 4; point++) {
			assert_true(map_read(stage->rtud, point, &sample));
			assert_int_equal(sample.value.i, stop < STOP_AFTER_SECOND_TURN ? 1 : 2);
		}
		become_ordinary(&cpus);
		kill(writer, SIGKILL);
		waitpid(writer, &status, 0);
		map_module_ended(stage->rtud, index_of(stage, FIRST), true);
		assert_readable_copy_is_whole(stage);
	}
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
	const struct CMUnitTest tests[] = {
	    TEST(test_published_samples_are_read_by_others),
	    TEST(test_a_segment_is_read_only_for_others),
	    TEST(test_points_are_invalid_before_the_first_sample_and_after_the_end),
	    TEST(test_points_are_invalid_when_the_heartbeat_stops),
	    TEST(test_a_heartbeat_lives_on_when_the_millisecond_counter_wraps),
	    TEST(test_a_heartbeat_while_its_age_is_taken_is_not_an_old_one),
	    TEST(test_events_are_changes_beyond_the_deadband),
	    TEST(test_events_of_several_modules_come_in_order_of_time),
	    TEST(test_lost_events_are_counted),
	    TEST(test_a_forged_event_is_not_believed),
	    TEST(test_a_direct_command_is_executed_and_released),
	    TEST(test_a_selection_binds_requester_and_value),
	    TEST(test_a_selection_is_cancelled_by_its_holder),
	    TEST(test_a_selection_ends_by_itself),
	    TEST(test_a_selection_ends_with_its_requesters_process),
	    TEST(test_one_command_a_point_at_a_time),
	    TEST(test_old_and_impossible_commands_are_refused),
	    TEST(test_nothing_is_repeated_after_a_crash),
	    TEST(test_a_latch_wraps),
	    TEST(test_an_event_ring_wraps),
	    TEST(test_requests_and_answers_wrap),
	    TEST(test_a_flood_of_requests_holds_nobody_up),
	    TEST(test_a_flooded_bell_is_cleared_in_one_go),
	    TEST(test_a_line_process_commands_nobody),
	    TEST(test_noise_in_a_segment_harms_nobody_else),
	    TEST(test_attaching_fails_with_a_reason),
	    TEST(test_a_module_cannot_truncate_its_segment),
	    TEST(test_a_folder_that_others_may_write_to_is_refused),
	    TEST(test_points_are_found_by_address),
	    TEST(test_the_log_is_read_line_by_line),
	    TEST(test_a_writer_killed_anywhere_leaves_whole_values),
	    TEST(test_a_stopped_writer_does_not_hold_up_a_real_time_reader),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
