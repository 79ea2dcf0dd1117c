/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Processes of the plant: each that one starts is in it, too. */
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "client.h"

#define OWN_VARIABLES 4
#define VARIABLES_MAX 256
#define VARIABLE_SIZE 512

static const char *const own_names[OWN_VARIABLES] = {"LD_PRELOAD", PLANT_TUNABLES_VARIABLE,
						     PLANT_SHARED_VARIABLE, PLANT_PROCESS_VARIABLE};

pid_t fork(void)
{
	uint32_t child;
	pid_t pid;

	client_begin();
	if (!plant)
		return real.fork();
	client_call();
	child = plant_add(plant, client_self);
	if (child == PLANT_RUNNER) {
		errno = EAGAIN;
		return -1;
	}
	memcpy(plant->processes[child].name, plant->processes[client_self].name, PLANT_NAME_SIZE);
	plant->processes[child].life = plant->processes[client_self].life;
	pid = real.fork();
	if (pid == 0) {
		client_self = child;
		stores_forget();
		plant->processes[child].pid = getpid();
		atomic_store(&plant->processes[child].attached, 1);
		plant_take(plant, client_self);
		return 0;
	}
	plant->processes[child].pid = pid;
	plant->processes[child].alive = pid > 0;
	plant->changes++;
	client_tell("fork %d", pid > 0);
	return pid;
}

/* The parent would not run until the child executes something, which takes the baton. */
pid_t vfork(void)
{
	return fork();
}

/* The preload library and the place in the plant, whatever else the new program's environment is. */
static void put_environment(char *const old[], char *out[VARIABLES_MAX],
			    char own[OWN_VARIABLES][VARIABLE_SIZE])
{
	size_t count = 0;

	for (size_t i = 0; i < OWN_VARIABLES; i++) {
		const char *value = getenv(own_names[i]);

		snprintf(own[i], VARIABLE_SIZE, "%s=%s", own_names[i], value ? value : "");
		if (i == OWN_VARIABLES - 1)
			snprintf(own[i], VARIABLE_SIZE, "%s=%u", own_names[i], client_self);
		out[count++] = own[i];
	}
	for (; *old && count < VARIABLES_MAX - 1; old++)
		if (strncmp(*old, "LD_PRELOAD=", 11) != 0 && strncmp(*old, "PLANT_", 6) != 0 &&
		    strncmp(*old, PLANT_TUNABLES_VARIABLE "=", sizeof(PLANT_TUNABLES_VARIABLE)) != 0)
			out[count++] = *old;
	out[count] = NULL;
}

int execve(const char *path, char *const arguments[], char *const environment[])
{
	char own[OWN_VARIABLES][VARIABLE_SIZE], *whole[VARIABLES_MAX];

	client_begin();
	if (!plant)
		return real.execve(path, arguments, environment);
	put_environment(environment, whole, own);
	return real.execve(path, arguments, whole);
}

int fexecve(int fd, char *const arguments[], char *const environment[])
{
	char own[OWN_VARIABLES][VARIABLE_SIZE], *whole[VARIABLES_MAX];

	client_begin();
	if (!plant)
		return real.fexecve(fd, arguments, environment);
	put_environment(environment, whole, own);
	return real.fexecve(fd, arguments, whole);
}

void _exit(int code)
{
	client_begin();
	if (plant)
		client_leave("exits");
	real._exit(code);
	abort();
}

void _Exit(int code)
{
	_exit(code);
}

static uint32_t process_of(pid_t pid)
{
	for (uint32_t i = 0; i < plant->process_count; i++)
		if (plant->processes[i].alive && plant->processes[i].pid == pid)
			return i;
	return PLANT_RUNNER;
}

int kill(pid_t pid, int signal)
{
	uint32_t target;
	int result, error;

	client_begin();
	if (!plant)
		return real.kill(pid, signal);
	client_call();
	target = process_of(pid);
	result = real.kill(pid, signal);
	error = errno;
	client_tell("kill %s %d %d", target == PLANT_RUNNER ? "?" : plant->processes[target].name, signal,
		    result);
	if (result == 0 && signal == SIGKILL && target != PLANT_RUNNER) {
		plant_tell(plant, target, "is killed");
		plant_bury(plant, target);
		plant_await_the_dying(plant);
	}
	client_changes();
	errno = error;
	return result;
}

struct child {
	pid_t pid;
	int *status;
	int options;
	pid_t found;
	int error;
};

static bool child_ended(void *what)
{
	struct child *child = what;

	child->found = real.waitpid(child->pid, child->status, child->options | WNOHANG);
	child->error = errno;
	return child->found != 0;
}

pid_t waitpid(pid_t pid, int *status, int options)
{
	struct child child = {.pid = pid, .status = status, .options = options};

	client_begin();
	if (!plant)
		return real.waitpid(pid, status, options);
	client_call();
	if (options & WNOHANG)
		child_ended(&child);
	else if (wait_until(child_ended, &child, PLANT_NEVER) < 0)
		return -1;
	client_tell("waitpid %d", (child.found > 0) - (child.found < 0));
	errno = child.error;
	return child.found;
}

pid_t wait4(pid_t pid, int *status, int options, struct rusage *usage)
{
	if (usage)
		memset(usage, 0, sizeof(*usage));
	return waitpid(pid, status, options);
}

pid_t wait3(int *status, int options, struct rusage *usage)
{
	return wait4(-1, status, options, usage);
}

pid_t wait(int *status)
{
	return waitpid(-1, status, 0);
}

/*
 * A module's filter of system calls stays off: the plant waits by calls that are none of the module's. Its limits stay on.
 */
int prctl(int option, ...)
{
	unsigned long values[4];
	va_list arguments;

	va_start(arguments, option);
	for (size_t i = 0; i < 4; i++)
		values[i] = va_arg(arguments, unsigned long);
	va_end(arguments);
	client_begin();
	if (plant && option == PR_SET_SECCOMP && values[1])
		return 0;
	if (plant && option == PR_SET_NAME)
		plant_name(plant, client_self, (const char *)values[0]);
	if (plant && option == PR_SET_PDEATHSIG)
		plant->processes[client_self].ends_with_parent = values[0] == SIGKILL;
	return real.prctl(option, values[0], values[1], values[2], values[3]);
}

/* A real-time priority would be above the host's other work, and changes nothing where one runs at a time. */
long syscall(long number, ...)
{
	long values[6];
	va_list arguments;

	va_start(arguments, number);
	for (size_t i = 0; i < 6; i++)
		values[i] = va_arg(arguments, long);
	va_end(arguments);
	client_begin();
	if (plant && number == SYS_sched_setscheduler)
		return 0;
	if (plant && number == SYS_close_range)
		files_forget((unsigned)values[0], (unsigned)values[1]);
	return real.syscall(number, values[0], values[1], values[2], values[3], values[4], values[5]);
}
