/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Who may attach to the map, and what a process may do to the files of others. */
#include "map/test_stage.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

static void test_attaching_fails_with_a_reason(void **state)
{
	struct stage *stage = *state;
	struct segment_header *header = stage->rtud->segments[MAP_RTUD].header;
	char error[MAP_ERROR_SIZE];
	struct map *map;

	assert_int_equal(map_attach(&map, "/dev/null/map", NULL, error), -1);
	assert_non_null(strstr(error, "does rtud run?"));
	assert_int_equal(map_attach(&map, "/", NULL, error), -1);
	assert_string_equal(error, "cannot open rtud.seg: No such file or directory (does rtud run?)");
	assert_int_equal(map_attach(&map, stage->dir, "rtu-gps", error), -1);
	assert_string_equal(error, "the map has no module rtu-gps");
	assert_int_equal(map_create(&map, stage->dir, &stage->config, 0, error), -1);
	assert_non_null(strstr(error, "another rtud runs"));
	header->layout++;
	assert_int_equal(map_attach(&map, stage->dir, NULL, error), -1);
	assert_non_null(strstr(error, "restart rtud and all modules with the same version"));
	header->layout--;
	header->fingerprint++;
	assert_int_equal(map_attach(&map, stage->dir, NULL, error), -1);
	assert_non_null(strstr(error, "built differently"));
	header->fingerprint--;
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
	assert_int_equal(chmod(stage->dir, 0711), 0);
	/* the modules' group, and for a tester who is not root: his file, and yet not his to write */
	for (uint32_t i = 0; i < map_module_count(stage->rtud); i++) {
		struct map_module module;

		map_module(stage->rtud, i, &module);
		snprintf(path, sizeof(path), "%s/%s.seg", stage->dir, module.name);
		assert_int_equal(chmod(path, 0444), 0);
	}
	snprintf(path, sizeof(path), "%s/rtud+0.config", stage->dir);
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
	assert_folder_refused(dir, &stage->config, "another user owns the map");
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

static void test_points_belong_to_who_may_own_them(void **state)
{
	struct stage *stage = *state;
	char dir[80], error[MAP_ERROR_SIZE] = "";
	struct map *map;

	snprintf(dir, sizeof(dir), "%s.other", stage->dir);
	stage->sets[1].module = (uint16_t)index_of(stage, "rtuctl");
	snprintf(stage->sets[1].name, sizeof(stage->sets[1].name), "Pump");
	assert_int_equal(map_create(&map, dir, &stage->config, 0, error), -1);
	assert_string_equal(error, "the set of points Pump belongs to no module that may own it");
	stage->sets[1].module = MAP_MODULES_MAX;
	assert_int_equal(map_create(&map, dir, &stage->config, 0, error), -1);
	assert_int_equal(rmdir(dir), 0);
}

static void test_no_two_modules_have_one_user(void **state)
{
	struct stage *stage = *state;
	uint32_t second = index_of(stage, SECOND);
	char dir[80], error[MAP_ERROR_SIZE] = "";
	struct map *map;

	snprintf(dir, sizeof(dir), "%s.other", stage->dir);
	stage->modules[second].user = stage->modules[index_of(stage, FIRST)].user;
	assert_int_equal(map_create(&map, dir, &stage->config, 0, error), -1);
	assert_non_null(strstr(error, FIRST " and " SECOND " would run as one user"));
	assert_int_equal(rmdir(dir), 0);
	stage->modules[second].user = 0; /* rtud starts no process: as many as there are */
	stage->modules[index_of(stage, FIRST)].user = 0;
	assert_int_equal(map_create(&map, dir, &stage->config, 0, error), 0);
	map_remove(map);
	map_detach(map);
	assert_int_equal(rmdir(dir), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_attaching_fails_with_a_reason),
	    TEST(test_a_segment_is_read_only_for_others),
	    TEST(test_a_module_cannot_truncate_its_segment),
	    TEST(test_a_folder_that_others_may_write_to_is_refused),
	    TEST(test_points_belong_to_who_may_own_them),
	    TEST(test_no_two_modules_have_one_user),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
