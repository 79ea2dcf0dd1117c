/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The point map seen by several processes at once, one of which may die anywhere. */
#include <fcntl.h>
#include <math.h>
#include <sched.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
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
	};

	for (size_t i = 0; i < 4; i++)
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
	    TEST(test_events_are_changes_beyond_the_deadband),
	    TEST(test_events_of_several_modules_come_in_order_of_time),
	    TEST(test_lost_events_are_counted),
	    TEST(test_a_forged_event_is_not_believed),
	    TEST(test_a_direct_command_is_executed_and_released),
	    TEST(test_a_selection_binds_requester_and_value),
	    TEST(test_a_selection_is_cancelled_by_its_holder),
	    TEST(test_a_selection_ends_by_itself),
	    TEST(test_one_command_a_point_at_a_time),
	    TEST(test_old_and_impossible_commands_are_refused),
	    TEST(test_nothing_is_repeated_after_a_crash),
	    TEST(test_attaching_fails_with_a_reason),
	    TEST(test_points_are_found_by_address),
	    TEST(test_the_log_is_read_line_by_line),
	    TEST(test_a_writer_killed_anywhere_leaves_whole_values),
	    TEST(test_a_stopped_writer_does_not_hold_up_a_real_time_reader),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
