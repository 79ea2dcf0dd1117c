/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How a kind of module writes down which system calls its program makes once it has started: rtud/filter.c. */
#ifndef OPENRTU_PROCESS_CALLS_H
#define OPENRTU_PROCESS_CALLS_H

#include <asm/ioctls.h>
#include <asm/termbits.h>
#include <fcntl.h>
#include <seccomp.h>
#include <sys/socket.h>

/* One that is allowed, with these arguments only. What an architecture has not, libseccomp leaves out of its filter. */
struct call_rule {
	int call;
	unsigned count;
	struct scmp_arg_cmp arguments[2];
};

/* Not SCMP_SYS(name): its argument would be expanded first, and musl has macros for names, as fstat for fstat64. */
#define CALL(name)                                                                                           \
	{                                                                                                    \
		.call = (int)__SNR_##name                                                                    \
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
		.call = (int)__SNR_##name, .count = 1, .arguments = { argument }                             \
	}

/* What a file is. glibc and musl ask in different ways. */
#define STATUS_CALLS                                                                                         \
	CALL(newfstatat), CALL(statx), CALL(fstatat64), CALL(fstat), CALL(fstat64), CALL(stat),              \
	    CALL(stat64), CALL(lstat), CALL(lstat64)

/* Files are opened, and none is made. musl uses open where a machine has it, and sets close-on-exec a second time. */
#define NO_FILE (O_CREAT | O_TRUNC | O_TMPFILE)
#define OPENING_CALLS                                                                                        \
	CALL_WITH(openat, MASKED(2, NO_FILE, 0)), CALL_WITH(open, MASKED(1, NO_FILE, 0)),                    \
	    CALL_WITH(fcntl, EQUAL(1, F_SETFD)), CALL_WITH(fcntl64, EQUAL(1, F_SETFD)), STATUS_CALLS

/* map_renew, and map_heartbeat of an owner: the map's files. */
#define RENEWAL_CALLS OPENING_CALLS

/* The files of TLS, read anew when they change, and what libcrypto asks for: random numbers, locks for threads that are not there. */
#define TLS_CALLS RENEWAL_CALLS, CALL(lseek), CALL(_llseek), CALL(getrandom), CALL(futex_time64), CALL(futex)

#define IOCTL(request) CALL_WITH(ioctl, MASKED(1, UINT32_MAX, request))
#define SOCKET(family, type)                                                                                 \
	{                                                                                                    \
		.call = SCMP_SYS(socket), .count = 2, .arguments = {                                         \
			EQUAL(0, family),                                                                    \
			EQUAL(1, (type) | SOCK_NONBLOCK | SOCK_CLOEXEC)                                      \
		}                                                                                            \
	}
#define TCP_SOCKET(family) SOCKET(family, SOCK_STREAM)
#define UDP_SOCKET(family) SOCKET(family, SOCK_DGRAM)

/* channel/serial.c */
#define SERIAL_PORT_CALLS                                                                                    \
	OPENING_CALLS, CALL(flock), IOCTL(TCGETS2), IOCTL(TCSETS2), IOCTL(TCFLSH), IOCTL(TIOCEXCL),          \
	    IOCTL(TIOCGRS485), IOCTL(TIOCSRS485)

/* channel/tcp.c, beside poll. */
#define TCP_CONNECTION_CALLS                                                                                 \
	TCP_SOCKET(AF_INET), TCP_SOCKET(AF_INET6), CALL(connect), CALL(setsockopt), CALL(getsockopt)

#endif
