/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/filter.h"

#include <asm/ioctls.h>
#include <asm/termbits.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/seccomp.h>
#include <seccomp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#define BY_TREE 2 /* of SCMP_FLTATR_CTL_OPTIMIZE: few comparisons, which this core interprets */

/* One that is allowed, with these arguments only. What an architecture has not, libseccomp leaves out of its filter. */
struct rule {
	int call;
	unsigned count;
	struct scmp_arg_cmp arguments[2];
};

#define CALL(name)                                                                                           \
	{                                                                                                    \
		.call = SCMP_SYS(name)                                                                       \
	}
/* ... with an argument, counted from 0, of whose bits under the mask these alone are set. */
#define MASKED(index, mask, bits)                                                                            \
	{                                                                                                    \
		.arg = index, .op = SCMP_CMP_MASKED_EQ, .datum_a = mask, .datum_b = bits                     \
	}
#define EQUAL(index, value)                                                                                  \
	{                                                                                                    \
		.arg = index, .op = SCMP_CMP_EQ, .datum_a = value                                            \
	}
#define CALL_WITH(name, argument)                                                                            \
	{                                                                                                    \
		.call = SCMP_SYS(name), .count = 1, .arguments = { argument }                                \
	}

/* ---- the table --------------------------------------------------------------------------- */

/*
 * Where several do the same, glibc takes one or another: by architecture, or the first that the kernel has. Those
 * that end in time64 are of 32-bit machines; there, neither clock is read without a system call.
 */
static const struct rule common[] = {
    CALL(read),
    CALL(write),
    CALL(close),
    CALL(clock_gettime64),
    CALL(clock_gettime),
    CALL(gettimeofday),
    CALL(time),
    CALL(restart_syscall), /* of one that was stopped and goes on */
    CALL(rt_sigreturn),
    CALL(sigreturn),
    CALL(exit_group),
    /* Memory, none of it to be executed. */
    CALL(brk),
    CALL_WITH(mmap, MASKED(2, PROT_EXEC, 0)),
    CALL_WITH(mmap2, MASKED(2, PROT_EXEC, 0)),
    CALL(mremap),
    CALL(munmap),
    /* abort(), with its message: a canary that was overwritten says so. The tgkill to itself is added below. */
    CALL(writev),
    CALL(rt_sigprocmask),
    CALL(getpid),
    CALL(gettid),
};

#define IOCTL(request) CALL_WITH(ioctl, MASKED(1, UINT32_MAX, request))
#define TCP_SOCKET(family)                                                                                   \
	{                                                                                                    \
		.call = SCMP_SYS(socket), .count = 2, .arguments = {                                         \
			EQUAL(0, family),                                                                    \
			EQUAL(1, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC)                                 \
		}                                                                                            \
	}

static const struct rule modbus[] = {
    CALL(pread64), /* what the scheduler counts of this process (heartbeat.c) */
    CALL(epoll_wait),
    CALL(epoll_pwait),
    CALL(epoll_ctl),
    CALL(timerfd_settime64),
    CALL(timerfd_settime),
    /* A serial port (serial.c): no file is made. */
    CALL_WITH(openat, MASKED(2, O_CREAT | O_TRUNC | O_TMPFILE, 0)),
    CALL(newfstatat),
    CALL(statx),
    CALL(fstatat64),
    CALL(fstat),
    CALL(fstat64),
    CALL(flock),
    IOCTL(TCGETS2),
    IOCTL(TCSETS2),
    IOCTL(TCFLSH),
    IOCTL(TIOCEXCL),
    IOCTL(TIOCGRS485),
    IOCTL(TIOCSRS485),
    /* A Modbus TCP connection (tcp.c). */
    TCP_SOCKET(AF_INET),
    TCP_SOCKET(AF_INET6),
    CALL(connect),
    CALL(setsockopt),
    CALL(getsockopt),
    CALL(poll),
    CALL(ppoll_time64),
    CALL(ppoll),
};

static const struct rule iec104[] = {
    CALL(epoll_wait), CALL(epoll_pwait), CALL(epoll_ctl), CALL(accept4),
    CALL(setsockopt), CALL(send),        CALL(sendto),
};

static const struct rule iec104_tls[] = {
    CALL(epoll_wait),
    CALL(epoll_pwait),
    CALL(epoll_ctl),
    CALL(accept4),
    CALL(setsockopt),
    /* The files of TLS, read anew when they change. */
    CALL_WITH(openat, MASKED(2, O_ACCMODE | O_CREAT | O_TRUNC, O_RDONLY)),
    CALL(newfstatat),
    CALL(statx),
    CALL(fstatat64),
    CALL(fstat),
    CALL(fstat64),
    CALL(lseek),
    CALL(_llseek),
    /* libcrypto: random numbers, and locks for threads that are not there. */
    CALL(getrandom),
    CALL(futex_time64),
    CALL(futex),
};

static const struct rule journal[] = {
    CALL(poll),  CALL(ppoll_time64), CALL(ppoll),       CALL(openat),   CALL(pwrite64),  CALL(fdatasync),
    CALL(fsync), CALL(ftruncate),    CALL(ftruncate64), CALL(renameat), CALL(renameat2), CALL(unlinkat),
};

#define PROGRAM(name, rules)                                                                                 \
	{                                                                                                    \
		name, rules, sizeof(rules) / sizeof((rules)[0])                                              \
	}

static const struct program {
	const char *name;
	const struct rule *rules;
	size_t count;
} programs[] = {
    PROGRAM("rtu-modbus", modbus),
    PROGRAM("rtu-iec104", iec104),
    PROGRAM("rtu-iec104-tls", iec104_tls),
    PROGRAM("rtu-journal", journal),
};

/* ---- the filter -------------------------------------------------------------------------- */

/* These and the next return 0, or a negative errno, as libseccomp does. */
static int allow(scmp_filter_ctx filter, const struct rule *rules, size_t count)
{
	int result = 0;

	for (size_t i = 0; result == 0 && i < count; i++)
		result = seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, rules[i].call, rules[i].count,
						rules[i].arguments);
	return result;
}

static int allow_to_signal_itself(scmp_filter_ctx filter)
{
	const struct rule rule = CALL_WITH(tgkill, EQUAL(0, (scmp_datum_t)getpid()));

	return allow(filter, &rule, 1);
}

static int allow_program(scmp_filter_ctx filter, const char *name)
{
	for (size_t i = 0; i < sizeof(programs) / sizeof(programs[0]); i++)
		if (strcmp(programs[i].name, name) == 0)
			return allow(filter, programs[i].rules, programs[i].count);
	return -EINVAL;
}

static int make(scmp_filter_ctx filter, const char *program)
{
	int result = seccomp_attr_set(filter, SCMP_FLTATR_CTL_OPTIMIZE, BY_TREE);

	if (result == 0)
		result = allow(filter, common, sizeof(common) / sizeof(common[0]));
	if (result == 0)
		result = allow_program(filter, program);
	if (result == 0)
		result = allow_to_signal_itself(filter);
	return result;
}

/* A filter is far smaller than what a pipe takes. */
static int export(scmp_filter_ctx filter)
{
	int ends[2], result;

	if (pipe2(ends, O_CLOEXEC) < 0)
		return -1;
	result = seccomp_export_bpf(filter, ends[1]);
	close(ends[1]);
	if (result == 0)
		return ends[0];
	close(ends[0]);
	errno = -result;
	return -1;
}

int filter_open(const char *program)
{
	scmp_filter_ctx filter = seccomp_init(SCMP_ACT_TRAP);
	int result, fd = -1;

	if (filter == NULL) {
		errno = ENOMEM;
		return -1;
	}
	result = make(filter, program);
	if (result == 0)
		fd = export(filter);
	else
		errno = -result;
	seccomp_release(filter);
	return fd;
}

/* With it, a filter of no address is a bad address; without, the mode is an invalid argument (seccomp(2)). */
static bool kernel_has_filters(void)
{
	return prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, NULL) == 0 || errno == EFAULT;
}

const char *filter_missing(void)
{
	if (OPENRTU_SANITIZED)
		return "built with a sanitizer, whose own calls are others";
	return kernel_has_filters() ? NULL : "this kernel has none (CONFIG_SECCOMP_FILTER)";
}

void filter_name(int call, char name[FILTER_NAME_SIZE])
{
	char *known = seccomp_syscall_resolve_num_arch(SCMP_ARCH_NATIVE, call);

	snprintf(name, FILTER_NAME_SIZE, "%s", known != NULL ? known : "?");
	free(known);
}
