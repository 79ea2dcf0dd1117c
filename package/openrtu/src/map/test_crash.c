/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A writer that is killed or stopped anywhere. */
#include "map/test_stage.h"

#include <math.h>
#include <sched.h>
#include <signal.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

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
		map_publish(map, &(struct map_update){.point = point, .sample = {.value.i = 1, .time_ns = 1}},
			    1);
	own = &map->segments[map->self];
	for (int copy = 0; copy < 2; copy++) {
		unsigned filled = latch_flip(&own->latches[0]);

		stop_here(stop, copy, false);
		for (uint32_t point = 0; point < 4; point++) {
			own->samples[filled][point] = (struct map_sample){.value.i = 2, .time_ns = 2};
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
	syscall(SYS_sched_setscheduler, 0, SCHED_FIFO, &priority);
}

static void become_ordinary(const cpu_set_t *cpus)
{
	const struct sched_param priority = {0};

	syscall(SYS_sched_setscheduler, 0, SCHED_OTHER, &priority);
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

static void test_a_retained_point_outlives_its_owner(void **state)
{
	struct stage *stage = *state;
	struct map_update written[] = {scaled(0, 5, MAP_GOOD, 1), scaled(1, 6, MAP_BLOCKED, 1)};
	struct map *map;

	for (int point = 0; point < 3; point++)
		stage->points[point].flags |= MAP_POINT_RETAIN;
	stage->points[0].flags &= (uint8_t)~MAP_POINT_RETAIN;
	make_again(stage);
	map = start(stage, FIRST);
	map_publish(map, written, 2);
	map_module_ended(stage->rtud, map->self, true);
	assert_sample(stage->rtud, 1, 6, MAP_BLOCKED | MAP_INVALID); /* while nobody vouches for it */
	map_detach(map);
	map = start(stage, FIRST);
	assert_sample(stage->rtud, 0, 5, MAP_INVALID);
	assert_sample(stage->rtud, 1, 6, MAP_BLOCKED);
	assert_sample(stage->rtud, 2, 0, MAP_INVALID); /* it was never written */
	map_detach(map);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_a_writer_killed_anywhere_leaves_whole_values),
	    TEST(test_a_stopped_writer_does_not_hold_up_a_real_time_reader),
	    TEST(test_a_retained_point_outlives_its_owner),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
