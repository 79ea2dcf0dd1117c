/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Modules that somebody else's code runs in: what it tries is the end of the process, and rtud learns what it was. */
#include "map/test_stage.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/sockios.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "process/confine.h"
#include "rtud/filter.h"
#include "rtud/kinds.h"

#define FILE_SIZE    4096
#define IN_STREAM    (SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC)
#define ANONYMOUS    (MAP_PRIVATE | MAP_ANONYMOUS)
#define OTHER_ERROR  2
#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#ifdef SYS_mmap2
#define SYS_MEMORY SYS_mmap2
#else
#define SYS_MEMORY SYS_mmap
#endif

static const char *const programs[] = {"rtu-modbus", "rtu-iec104",   "rtu-iec104-tls",   "rtu-journal",
				       "rtu-logic",  "rtu-iec61850", "rtu-iec61850-tls", "rtu-snmp"};

struct call {
	long number;
	long arguments[6];
};

static long make(const struct call *call)
{
	const long *with = call->arguments;

	return syscall(call->number, with[0], with[1], with[2], with[3], with[4], with[5]);
}

static const struct kind_program *program_named(const char *name)
{
	static const char *const kinds[] = {"modbus", "iec104", "journal", "logic", "iec61850", "snmp"};

	for (size_t i = 0; i < COUNT(kinds); i++) {
		const struct kind *kind = kinds_find(kinds[i]);

		for (size_t j = 0; j < kind->program_count; j++)
			if (strcmp(kind->programs[j].name, name) == 0)
				return &kind->programs[j];
	}
	return NULL;
}

/* ---- a process that is confined as a program, and does something ------------------------------------- */

struct confined {
	struct map *map;
	const char *program; /* NULL: it gets no filter */
	void (*act)(const struct call *call);
	const struct call *call;
};

__attribute__((noreturn)) static void run(const struct confined *confined)
{
	int filter = confined->program ? filter_open(program_named(confined->program)) : -1;

	prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
	if ((confined->program && filter < 0) || confine(confined->map, filter, FILE_SIZE) < 0)
		_exit(OTHER_ERROR);
	confined->act(confined->call);
	_exit(EXIT_SUCCESS);
}

static int status_of(const struct confined *confined)
{
	pid_t child = fork();
	int status;

	if (child == 0)
		run(confined);
	assert_int_equal(waitpid(child, &status, 0), child);
	return status;
}

static void assert_named_and_ended(const struct stage *stage, const struct confined *confined)
{
	int status = status_of(confined);

	if (!WIFSIGNALED(status) || WTERMSIG(status) != SIGSYS)
		fail_msg("%s may make the system call %ld: status %#x", confined->program,
			 confined->call->number, status);
	assert_int_equal(map_module_forbidden(stage->rtud, confined->map->self), confined->call->number);
}

static void assert_goes_on(const struct confined *confined)
{
	int status = status_of(confined);

	if (!WIFEXITED(status) || WEXITSTATUS(status) != EXIT_SUCCESS)
		fail_msg("%s may not make the system call %ld: status %#x", confined->program,
			 confined->call->number, status);
}

static void make_it(const struct call *call)
{
	make(call);
}

/* ---- calls ------------------------------------------------------------------------------------------- */

/* Of none of the programs. */
static const struct call forbidden[] = {
    {.number = SYS_execve, {0}},
    {.number = SYS_execveat, {-1}},
    {.number = SYS_clone, {SIGCHLD}},
    {.number = SYS_ptrace, {0}},
    {.number = SYS_process_vm_writev, {0}},
    {.number = SYS_MEMORY, {0, 4096, PROT_READ | PROT_EXEC, ANONYMOUS, -1}},
    {.number = SYS_mprotect, {0, 4096, PROT_READ | PROT_EXEC}},
    {.number = SYS_memfd_create, {0}},
    {.number = SYS_kill, {1, 0}},
    {.number = SYS_tgkill, {1, 1, 0}},
    {.number = SYS_tkill, {1, 0}},
    {.number = SYS_prctl, {PR_SET_DUMPABLE, 1}},
    {.number = SYS_rt_sigaction, {SIGSYS}},
    {.number = SYS_setuid, {0}},
    {.number = SYS_prlimit64, {0}},
    {.number = SYS_sched_setscheduler, {0}},
    {.number = SYS_clock_adjtime, {0}},
    {.number = SYS_socket, {AF_UNIX, IN_STREAM}},
    {.number = SYS_socket, {AF_NETLINK, SOCK_RAW}},
    {.number = SYS_socket, {AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC}},
    {.number = SYS_bind, {-1}},
    {.number = SYS_listen, {-1}},
    {.number = SYS_ioctl, {-1, TIOCSTI}},
    {.number = SYS_fchmodat, {-1}},
    {.number = SYS_mkdirat, {-1}},
    {.number = SYS_getdents64, {-1}},
    {.number = SYS_unshare, {0}},
    {.number = SYS_mount, {0}},
    {.number = SYS_bpf, {-1}},
    {.number = SYS_io_uring_setup, {0}},
    {.number = SYS_userfaultfd, {0}},
    {.number = 4000000, {0}}, /* of no kernel yet */
};

/* Of some programs; of the others forbidden. Arguments that let it fail, where it shall leave nothing. */
static const struct {
	const char *programs;
	struct call call;
} special[] = {
    {"rtu-modbus", {SYS_socket, {AF_INET, IN_STREAM}}},
    {"rtu-modbus", {SYS_socket, {AF_INET6, IN_STREAM}}},
    {"rtu-modbus", {SYS_connect, {-1}}},
    {"rtu-modbus", {SYS_flock, {-1}}},
    {"rtu-modbus", {SYS_ioctl, {-1, TIOCEXCL}}},
    {"rtu-modbus rtu-iec104 rtu-iec104-tls", {SYS_epoll_ctl, {-1}}},
    {"rtu-modbus rtu-iec104 rtu-iec104-tls rtu-iec61850 rtu-iec61850-tls", {SYS_setsockopt, {-1}}},
    {"rtu-iec104 rtu-iec104-tls rtu-iec61850 rtu-iec61850-tls", {SYS_accept4, {-1}}},
    {"rtu-modbus rtu-iec104 rtu-iec104-tls rtu-journal rtu-logic rtu-iec61850-tls",
     {SYS_openat, {-1, 0, O_RDWR}}},
    {"rtu-modbus rtu-iec104 rtu-iec104-tls rtu-journal rtu-logic rtu-iec61850-tls",
     {SYS_openat, {-1, 0, O_RDONLY}}},
#ifdef SYS_open /* musl's, where the machine has it */
    {"rtu-modbus rtu-iec104 rtu-iec104-tls rtu-journal rtu-logic rtu-iec61850-tls", {SYS_open, {0, O_RDWR}}},
    {"rtu-journal", {SYS_open, {0, O_RDWR | O_CREAT}}},
#endif
    {"rtu-snmp", {SYS_statfs, {0}}},
    {"rtu-snmp", {SYS_ioctl, {-1, SIOCETHTOOL}}},
    {"rtu-journal", {SYS_openat, {-1, 0, O_RDWR | O_CREAT}}},
    {"rtu-journal", {SYS_renameat, {-1}}},
    {"rtu-journal", {SYS_unlinkat, {-1}}},
    {"rtu-journal", {SYS_fdatasync, {-1}}},
};

/* Of all. */
static const struct call common[] = {
    {SYS_MEMORY, {0, 4096, PROT_READ | PROT_WRITE, ANONYMOUS, -1}},
    {SYS_read, {-1}},
    {SYS_write, {-1}},
    {SYS_close, {-1}},
};

/* The word in a list of words; one may begin with another. */
static bool is_among(const char *list, const char *word)
{
	size_t length = strlen(word);

	for (const char *at = list; (at = strstr(at, word)) != NULL; at += length)
		if (at[length] == '\0' || at[length] == ' ')
			return true;
	return false;
}

static void test_planted_call_ends_the_module_and_is_named(void **state)
{
	struct stage *stage = *state;
	struct map *map = start(stage, FIRST);

	for (size_t i = 0; i < COUNT(programs); i++)
		for (size_t j = 0; j < COUNT(forbidden); j++)
			assert_named_and_ended(stage,
					       &(struct confined){map, programs[i], make_it, &forbidden[j]});
	map_detach(map);
}

static void test_each_program_has_its_own_calls(void **state)
{
	struct stage *stage = *state;
	struct map *map = start(stage, FIRST);

	for (size_t i = 0; i < COUNT(programs); i++) {
		for (size_t j = 0; j < COUNT(common); j++)
			assert_goes_on(&(struct confined){map, programs[i], make_it, &common[j]});
		for (size_t j = 0; j < COUNT(special); j++) {
			const struct confined confined = {map, programs[i], make_it, &special[j].call};

			if (is_among(special[j].programs, programs[i]))
				assert_goes_on(&confined);
			else
				assert_named_and_ended(stage, &confined);
		}
	}
	map_detach(map);
}

static void die(const struct call *call)
{
	(void)call;
	abort();
}

/* What ends a program by its own fault, such as a canary that was overwritten, is not taken for a forbidden call. */
static void test_abort_is_an_abort(void **state)
{
	struct map *map = start(*state, FIRST);

	for (size_t i = 0; i < COUNT(programs); i++) {
		int status = status_of(&(struct confined){map, programs[i], die, NULL});

		assert_true(WIFSIGNALED(status));
		assert_int_equal(WTERMSIG(status), SIGABRT);
	}
	map_detach(map);
}

static void test_a_call_of_before_is_forgotten(void **state)
{
	struct stage *stage = *state;
	struct map *map = start(stage, FIRST);

	assert_named_and_ended(stage, &(struct confined){map, "rtu-modbus", make_it, &forbidden[0]});
	assert_goes_on(&(struct confined){map, "rtu-modbus", make_it, &common[0]});
	assert_int_equal(map_module_forbidden(stage->rtud, map->self), -1);
	map_detach(map);
}

static void block_the_signal(const struct call *call)
{
	sigset_t all;

	sigfillset(&all);
	sigprocmask(SIG_BLOCK, &all, NULL);
	make(call);
}

static void test_blocking_the_signal_helps_nobody(void **state)
{
	struct map *map = start(*state, FIRST);
	int status = status_of(&(struct confined){map, "rtu-modbus", block_the_signal, &forbidden[0]});

	assert_true(WIFSIGNALED(status));
	assert_int_equal(WTERMSIG(status), SIGSYS);
	map_detach(map);
}

/* ---- means, which a kernel without filters limits too --------------------------------------------------- */

static void multiply(const struct call *call)
{
	(void)call;
	if (fork() >= 0 || errno != EAGAIN)
		_exit(OTHER_ERROR);
}

static void fill_a_file(const struct call *call)
{
	static const char octets[FILE_SIZE];
	FILE *file = tmpfile();

	(void)call;
	if (write(fileno(file), octets, sizeof(octets)) != sizeof(octets))
		_exit(OTHER_ERROR);
	if (write(fileno(file), octets, 1) >= 0 || errno != EFBIG)
		_exit(OTHER_ERROR);
}

/* As a module's user: root may have as many as it likes. */
static void become_somebody(const struct call *call)
{
	if (geteuid() != 0 || setuid(65534) == 0)
		multiply(call);
	else
		_exit(OTHER_ERROR);
}

static void test_means_are_limited_without_a_filter(void **state)
{
	void (*const acts[])(const struct call *) = {become_somebody, fill_a_file};
	struct map *map = start(*state, FIRST);

	for (size_t i = 0; i < COUNT(acts); i++) {
		int status = status_of(&(struct confined){map, NULL, acts[i], NULL});

		assert_true(WIFEXITED(status));
		assert_int_equal(WEXITSTATUS(status), EXIT_SUCCESS);
	}
	map_detach(map);
}

/* ---- names ------------------------------------------------------------------------------------------- */

static void test_calls_have_names(void **state)
{
	char name[FILTER_NAME_SIZE];

	(void)state;
	filter_name(SYS_execve, name);
	assert_string_equal(name, "execve");
	filter_name(4000000, name);
	assert_string_equal(name, "?");
	filter_name(-1, name);
	assert_string_equal(name, "?");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_planted_call_ends_the_module_and_is_named),
	    TEST(test_each_program_has_its_own_calls),
	    TEST(test_abort_is_an_abort),
	    TEST(test_a_call_of_before_is_forgotten),
	    TEST(test_blocking_the_signal_helps_nobody),
	    TEST(test_means_are_limited_without_a_filter),
	    cmocka_unit_test(test_calls_have_names),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
