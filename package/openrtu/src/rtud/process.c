/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/process.h"

#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <limits.h>
#include <linux/securebits.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "map/supervise.h"
#include "rtud/filter.h"

#define EXIT_NOT_STARTED 127 /* the shell's word for "could not be executed" */
#define FILTER_FD        (MAP_SEGMENT_FD + 1)
#define FILTER_WORD      "4"
#define SOCKET_FD        (FILTER_FD + 1)
#define SOCKET_WORD      "5"
/* Of SCHED_FIFO without ever sleeping: a module whose heart beats while it spins is ended too. A line sleeps within ms. */
#define SPIN_US 5000000

/* Of root's magic nothing is left, nor can be had back: user 0, a setuid or a file's capabilities give none. */
#define SECURE_BITS                                                                                          \
	(SECBIT_NOROOT | SECBIT_NOROOT_LOCKED | SECBIT_KEEP_CAPS_LOCKED | SECBIT_NO_CAP_AMBIENT_RAISE |      \
	 SECBIT_NO_CAP_AMBIENT_RAISE_LOCKED)

_Static_assert(FILTER_FD == 4 && SOCKET_FD == 5, "FILTER_WORD and SOCKET_WORD say it");

int process_set_priority(pid_t pid, int priority)
{
	struct sched_param parameter = {.sched_priority = priority};

	/* musl's sched_setscheduler refuses: POSIX means a process by it, Linux a thread. Our modules have one. */
	return (int)syscall(SYS_sched_setscheduler, pid, priority ? SCHED_FIFO : SCHED_OTHER, &parameter);
}

/* No group but the one that its work needs: who faces the network shall not reach a line. */
static int set_groups(const struct process_plan *plan)
{
	const struct group *group = plan->group ? getgrnam(plan->group) : NULL;

	return setgroups(group ? 1 : 0, group ? &group->gr_gid : NULL);
}

/* The last that the kernel knows has no next one to read. */
static int drop_bounding_set(void)
{
	for (unsigned long capability = 0; prctl(PR_CAPBSET_READ, capability) >= 0; capability++)
		if (prctl(PR_CAPBSET_READ, capability) == 1 && prctl(PR_CAPBSET_DROP, capability) < 0)
			return -1;
	return prctl(PR_SET_SECUREBITS, SECURE_BITS);
}

static int drop_privileges(const struct process_plan *plan)
{
	if (plan->uid && (drop_bounding_set() < 0 || set_groups(plan) < 0 || setgid(plan->gid) < 0 ||
			  setuid(plan->uid) < 0))
		return -1;
	return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
}

static void reset_signals(void)
{
	sigset_t none;

	signal(SIGPIPE, SIG_DFL);
	signal(SIGHUP, SIG_IGN); /* a terminal that closes sends it to all in the foreground */
	sigemptyset(&none);
	sigprocmask(SIG_SETMASK, &none, NULL);
}

/* The call itself: musl has no function of it. */
static void close_all(unsigned first, unsigned last)
{
	syscall(SYS_close_range, first, last, 0);
}

/*
 * rtud may have inherited more than it opened. What it waits with came first: no descriptor here has the number of the
 * segment's or the filter's.
 */
static void keep_only(int segment, int filter, int opened, int program)
{
	dup2(segment, MAP_SEGMENT_FD);
	if (filter >= 0)
		dup2(filter, FILTER_FD);
	else
		close(FILTER_FD);
	if (opened >= 0)
		dup2(opened, SOCKET_FD);
	else
		close(SOCKET_FD);
	close_all(SOCKET_FD + 1, (unsigned)program - 1);
	close_all((unsigned)program + 1, UINT_MAX);
}

/* A limit that rtud itself has, and may not raise, stays. */
static void limit(int resource, rlim_t most)
{
	const struct rlimit limits = {most, most};

	setrlimit(resource, &limits);
}

/* What a module needs no process and no file for, it takes away itself, when it has started: process/confine.h. */
static void set_limits(const struct process_plan *plan)
{
	const rlim_t memory = plan->memory ? plan->memory : RLIM_INFINITY;

	limit(RLIMIT_AS, memory);
	limit(RLIMIT_MEMLOCK, memory); /* the module says when it cannot lock its memory */
	limit(RLIMIT_NOFILE, plan->files);
	if (plan->processes)
		limit(RLIMIT_NPROC, plan->processes);
	limit(RLIMIT_CORE, 0); /* with the keys of TLS in it */
	limit(RLIMIT_RTTIME, SPIN_US);
}

__attribute__((noreturn)) static void give_up(const char *what, const char *of)
{
	fprintf(stderr, "rtud: cannot %s %s: %s\n", what, of, strerror(errno));
	_exit(EXIT_NOT_STARTED);
}

static const char *name_of(const struct process_plan *plan)
{
	return plan->path ? plan->path : plan->program->name;
}

#define ARGUMENTS_MAX 13
#define NUMBER_SIZE   12

static void put_arguments(const struct process_plan *plan, const char file[NUMBER_SIZE],
			  const char *out[ARGUMENTS_MAX + 1])
{
	const char *const first[] = {name_of(plan), "--map", plan->map, "--module",
				     plan->module,  "--dev", plan->dev};
	size_t count = sizeof(first) / sizeof(first[0]);

	memcpy(out, first, sizeof(first));
	if (plan->filtered) {
		out[count++] = "--filter";
		out[count++] = FILTER_WORD;
	}
	if (plan->open) {
		out[count++] = "--socket";
		out[count++] = SOCKET_WORD;
	}
	if (file[0] != '\0') {
		out[count++] = "--file";
		out[count++] = file;
	}
	out[count] = NULL;
}

/* The number of the file's descriptor; empty: there is none. Without it the module says so. */
static void put_file(const struct process_plan *plan, char out[NUMBER_SIZE])
{
	const int file = plan->describe ? plan->describe(plan->config) : -1;

	out[0] = '\0';
	if (file >= 0)
		snprintf(out, NUMBER_SIZE, "%d", file);
}

__attribute__((noreturn)) static void run(const struct process_plan *plan, int program, pid_t parent)
{
	const char *arguments[ARGUMENTS_MAX + 1];
	const char *const environment[] = {"PATH=/usr/bin:/bin", NULL};
	char file[NUMBER_SIZE];
	int filter = plan->filtered ? filter_open(plan->program) : -1;
	int opened = plan->open ? plan->open(plan->config, plan->module) : -1;

	if (plan->filtered && filter < 0)
		give_up("make the filter of", name_of(plan));
	if (plan->open && opened < 0)
		give_up("open the socket of", plan->module);
	reset_signals();
	keep_only(plan->segment, filter, opened, program);
	process_set_priority(0, 0);
	set_limits(plan);
	if (drop_privileges(plan) < 0)
		give_up("give up privileges for", plan->module);
	/*
	 * After setuid, which clears it; and the parent may have gone before. SIGKILL: a module that hangs must not stay on its
	 * line beside the next rtud's.
	 */
	prctl(PR_SET_PDEATHSIG, SIGKILL);
	if (getppid() != parent)
		_exit(EXIT_NOT_STARTED);
	put_file(plan, file);
	put_arguments(plan, file, arguments);
	if (plan->path)
		execve(plan->path, (char *const *)arguments, (char *const *)environment);
	else
		fexecve(program, (char *const *)arguments,
			(char *const *)environment); /* which does not write */
	give_up("execute", name_of(plan));
}

pid_t process_start(const struct process_plan *plan)
{
	/* Opened here: the module's user need not be able to walk to the program's folder. */
	int folder = open(plan->folder, O_PATH | O_DIRECTORY | O_CLOEXEC);
	int program = openat(folder, name_of(plan), O_PATH | O_CLOEXEC); /* a path is absolute */
	pid_t parent = getpid(), pid;

	close(folder);
	if (program < 0)
		return -1;
	pid = fork();
	if (pid == 0)
		run(plan, program, parent);
	close(program);
	return pid;
}
