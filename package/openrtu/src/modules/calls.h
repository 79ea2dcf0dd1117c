/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How a kind of module writes down which system calls its program makes once it has started: rtud/filter.c. */
#ifndef OPENRTU_MODULES_CALLS_H
#define OPENRTU_MODULES_CALLS_H

#include <fcntl.h>
#include <seccomp.h>

/* One that is allowed, with these arguments only. What an architecture has not, libseccomp leaves out of its filter. */
struct call_rule {
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

#endif
