/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/filter.h"

#include <errno.h>
#include <linux/seccomp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <unistd.h>

#include "process/calls.h"

#define BY_TREE 2 /* of SCMP_FLTATR_CTL_OPTIMIZE: few comparisons, which this core interprets */

/* ---- what every program may -------------------------------------------------------------- */

/*
 * Where several do the same, glibc takes one or another: by architecture, or the first that the kernel has. Those
 * that end in time64 are of 32-bit machines; there, neither clock is read without a system call.
 */
static const struct call_rule common[] = {
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
    /* abort(), with its message: a canary that was overwritten says so. The signal to itself is added below. */
    CALL(writev),
    CALL(rt_sigprocmask),
    CALL(getpid),
    CALL(gettid),
};

/* ---- the filter -------------------------------------------------------------------------- */

/* These and the next return 0, or a negative errno, as libseccomp does. */
static int allow(scmp_filter_ctx filter, const struct call_rule *rules, size_t count)
{
	int result = 0;

	for (size_t i = 0; result == 0 && i < count; i++)
		result = seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, rules[i].call, rules[i].count,
						rules[i].arguments);
	return result;
}

static int allow_to_signal_itself(scmp_filter_ctx filter)
{
	const scmp_datum_t itself = (scmp_datum_t)getpid();
	/* The second is musl's. */
	const struct call_rule rules[] = {CALL_WITH(tgkill, EQUAL(0, itself)),
					  CALL_WITH(tkill, EQUAL(0, itself))};

	return allow(filter, rules, sizeof(rules) / sizeof(rules[0]));
}

static int make(scmp_filter_ctx filter, const struct kind_program *program)
{
	int result = seccomp_attr_set(filter, SCMP_FLTATR_CTL_OPTIMIZE, BY_TREE);

	if (result == 0)
		result = allow(filter, common, sizeof(common) / sizeof(common[0]));
	if (result == 0)
		result = allow(filter, program->calls, program->call_count);
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

int filter_open(const struct kind_program *program)
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
	if (OPENRTU_INSTRUMENTED)
		return "built with a sanitizer or for coverage, whose own calls are others";
	return kernel_has_filters() ? NULL : "this kernel has none (CONFIG_SECCOMP_FILTER)";
}

void filter_name(int call, char name[FILTER_NAME_SIZE])
{
	char *known = seccomp_syscall_resolve_num_arch(SCMP_ARCH_NATIVE, call);

	snprintf(name, FILTER_NAME_SIZE, "%s", known != NULL ? known : "?");
	free(known);
}
