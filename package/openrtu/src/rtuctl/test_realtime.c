/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/realtime.h"

#include <errno.h>
#include <sched.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cmocka.h>

static void test_a_kernel_says_what_it_is(void **state)
{
	char path[] = "/tmp/test_realtime.XXXXXX";
	int file = mkstemp(path);

	(void)state;
	assert_false(realtime_kernel("/nowhere/realtime", "#1 SMP PREEMPT_DYNAMIC Debian 6.1.1"));
	assert_true(realtime_kernel("/nowhere/realtime", "#1 PREEMPT_RT Debian 6.1.176"));
	assert_false(realtime_kernel(path, "#1 PREEMPT"));
	assert_int_equal(write(file, "1\n", 2), 2);
	assert_true(realtime_kernel(path, "#1 PREEMPT"));
	assert_int_equal(pwrite(file, "0", 1, 0), 1);
	assert_false(realtime_kernel(path, "#1 PREEMPT"));
	close(file);
	unlink(path);
}

/* A folder as /proc, with one process. */
static void show_process(const char *proc, const char *stat, const char *status)
{
	const char *const files[][2] = {{"stat", stat}, {"status", status}};
	char path[128];

	snprintf(path, sizeof(path), "%s/77", proc);
	assert_true(mkdir(path, 0700) == 0 || errno == EEXIST);
	for (size_t i = 0; i < 2; i++) {
		FILE *file;

		snprintf(path, sizeof(path), "%s/77/%s", proc, files[i][0]);
		file = fopen(path, "w");
		assert_non_null(file);
		assert_true(fputs(files[i][1], file) >= 0);
		assert_int_equal(fclose(file), 0);
	}
}

static void remove_process(const char *proc)
{
	static const char *const names[] = {"/77/stat", "/77/status", "/77", ""};
	char path[128];

	for (size_t i = 0; i < 4; i++) {
		snprintf(path, sizeof(path), "%s%s", proc, names[i]);
		assert_int_equal(remove(path), 0);
	}
}

/* As Linux 6.1 has it; the name of a process may look like the fields behind it. */
#define STAT(priority, policy)                                                                               \
	"77 (rtu) 1 (x) S 1 77 77 0 -1 4194304 114 0 0 0 3 1 0 0 -46 0 1 0 1234 5210112 1180 4294967295 1 "  \
	"1 0 0 "                                                                                             \
	"0 0 0 4096 16386 0 0 0 17 0 " priority " " policy " 0 0 0 0 0 0 0 0 0 0 0\n"
#define STATUS(locked)                                                                                       \
	"Name:\trtu-modbus-1\nVmSize:\t    5088 kB\nVmLck:\t" locked " kB\nVmPin:\t       0 kB\n"

static void test_a_process_has_what_the_kernel_has_given(void **state)
{
	char proc[] = "/tmp/test_realtime.XXXXXX", words[REALTIME_WORDS_SIZE];
	struct realtime_grant grant;

	(void)state;
	assert_non_null(mkdtemp(proc));
	show_process(proc, STAT("45", "1"), STATUS("    5084"));
	grant = realtime_granted(proc, 77);
	assert_true(grant.running);
	assert_true(grant.fifo);
	assert_int_equal(grant.priority, 45);
	assert_int_equal(grant.locked_kib, 5084);
	realtime_words(&grant, words);
	assert_string_equal(words, "SCHED_FIFO 45, 5084 KiB locked");

	show_process(proc, STAT("0", "0"), STATUS("       0"));
	grant = realtime_granted(proc, 77);
	assert_true(grant.running);
	assert_false(grant.fifo);
	realtime_words(&grant, words);
	assert_string_equal(words, "ordinary scheduling, memory not locked");

	show_process(proc, STAT("9", "2"), STATUS("       0"));
	grant = realtime_granted(proc, 77);
	assert_false(grant.fifo);
	realtime_words(&grant, words);
	assert_string_equal(words, "SCHED_RR 9, memory not locked");

	show_process(proc, "77 (rtu) S 1", STATUS("       0"));
	assert_false(realtime_granted(proc, 77).running);
	show_process(proc, STAT("45", "1"), "Name:\tkthreadd\n");
	assert_false(realtime_granted(proc, 77).running);
	remove_process(proc);
	grant = realtime_granted("/proc", 0);
	assert_false(grant.running);
	realtime_words(&grant, words);
	assert_string_equal(words, "does not run");
}

static void test_this_process_has_what_it_asked_for(void **state)
{
	struct realtime_grant grant = realtime_granted("/proc", getpid());
	struct sched_param parameter;

	(void)state;
	assert_int_equal(syscall(SYS_sched_getparam, 0, &parameter), 0);
	assert_true(grant.running);
	assert_int_equal(grant.priority, parameter.sched_priority);
	assert_int_equal(grant.locked_kib, 0);
	/* Not by mlock, which does nothing under AddressSanitizer. */
	if (syscall(SYS_mlock, &grant, sizeof(grant)) < 0)
		skip();
	assert_true(realtime_granted("/proc", getpid()).locked_kib > 0);
	syscall(SYS_munlock, &grant, sizeof(grant));
}

#define PROMISES_NOTHING ", so the measurement guarantees nothing"

static void test_a_verdict_needs_a_real_time_kernel_priority_and_memory(void **state)
{
	const struct realtime_grant all = {.running = true, .fifo = true, .priority = 45, .locked_kib = 5084};
	const struct realtime_grant ordinary = {.running = true, .locked_kib = 5084};
	const struct realtime_grant robin = {.running = true, .priority = 45, .locked_kib = 5084};
	const struct realtime_grant unlocked = {.running = true, .fifo = true, .priority = 45};
	const struct realtime_grant gone = {.running = false};

	(void)state;
	assert_string_equal(realtime_verdict(false, &all, 45, 1),
			    "none: this kernel is not PREEMPT_RT" PROMISES_NOTHING);
	assert_string_equal(realtime_verdict(true, &gone, 45, 1), "none: the line's process does not run");
	assert_string_equal(realtime_verdict(true, &ordinary, 0, 1),
			    "none: the lines have no real-time priority" PROMISES_NOTHING);
	assert_string_equal(realtime_verdict(true, &ordinary, 45, 1),
			    "none: the line's process was not given its real-time priority" PROMISES_NOTHING);
	assert_string_equal(realtime_verdict(true, &robin, 45, 1),
			    "none: the line's process was not given its real-time priority" PROMISES_NOTHING);
	assert_string_equal(realtime_verdict(true, &unlocked, 45, 1),
			    "none: the memory of the line's process is not locked" PROMISES_NOTHING);
	assert_string_equal(realtime_verdict(true, &all, 45, 500),
			    "good: no wake-up was more than 500 us late");
	assert_string_equal(realtime_verdict(true, &all, 45, 501),
			    "bad: a wake-up was more than 500 us late");
	assert_true(realtime_is(true, &all));
	assert_false(realtime_is(false, &all));
	assert_false(realtime_is(true, &gone));
	assert_false(realtime_is(true, &ordinary));
	assert_false(realtime_is(true, &unlocked));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_kernel_says_what_it_is),
	    cmocka_unit_test(test_a_process_has_what_the_kernel_has_given),
	    cmocka_unit_test(test_this_process_has_what_it_asked_for),
	    cmocka_unit_test(test_a_verdict_needs_a_real_time_kernel_priority_and_memory),
	};
	return cmocka_run_group_tests_name("rtuctl realtime", tests, NULL, NULL);
}
