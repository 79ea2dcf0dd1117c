/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The functions of the C library themselves, behind those that the plant puts before them. */
#ifndef PLANT_REAL_H
#define PLANT_REAL_H

#include <poll.h>
#include <signal.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <time.h>

struct sockaddr;
struct rlimit;
struct timespec;

/* One line for each: what it returns, its name, its parameters. */
#define PLANT_REAL(X)                                                                                        \
	X(ssize_t, read, (int, void *, size_t))                                                              \
	X(ssize_t, write, (int, const void *, size_t))                                                       \
	X(ssize_t, recvfrom, (int, void *, size_t, int, struct sockaddr *, socklen_t *))                     \
	X(ssize_t, sendto, (int, const void *, size_t, int, const struct sockaddr *, socklen_t))             \
	X(ssize_t, recvmsg, (int, struct msghdr *, int))                                                     \
	X(ssize_t, sendmsg, (int, const struct msghdr *, int))                                               \
	X(int, poll, (struct pollfd *, nfds_t, int))                                                         \
	X(int, epoll_ctl, (int, int, int, struct epoll_event *))                                             \
	X(int, openat, (int, const char *, int, ...))                                                        \
	X(ssize_t, pread, (int, void *, size_t, off_t))                                                      \
	X(ssize_t, pwrite, (int, const void *, size_t, off_t))                                               \
	X(int, ftruncate, (int, off_t))                                                                      \
	X(int, fsync, (int))                                                                                 \
	X(int, fdatasync, (int))                                                                             \
	X(int, renameat, (int, const char *, int, const char *))                                             \
	X(int, linkat, (int, const char *, int, const char *, int))                                          \
	X(int, unlinkat, (int, const char *, int))                                                           \
	X(int, mkdir, (const char *, mode_t))                                                                \
	X(int, close, (int))                                                                                 \
	X(int, dup2, (int, int))                                                                             \
	X(int, socket, (int, int, int))                                                                      \
	X(int, bind, (int, const struct sockaddr *, socklen_t))                                              \
	X(int, connect, (int, const struct sockaddr *, socklen_t))                                           \
	X(int, accept4, (int, struct sockaddr *, socklen_t *, int))                                          \
	X(int, getsockname, (int, struct sockaddr *, socklen_t *))                                           \
	X(int, getpeername, (int, struct sockaddr *, socklen_t *))                                           \
	X(int, setsockopt, (int, int, int, const void *, socklen_t))                                         \
	X(int, getsockopt, (int, int, int, void *, socklen_t *))                                             \
	X(int, shutdown, (int, int))                                                                         \
	X(int, ioctl, (int, unsigned long, ...))                                                             \
	X(int, tcflush, (int, int))                                                                          \
	X(pid_t, fork, (void))                                                                               \
	X(int, execve, (const char *, char *const[], char *const[]))                                         \
	X(int, fexecve, (int, char *const[], char *const[]))                                                 \
	X(int, kill, (pid_t, int))                                                                           \
	X(pid_t, waitpid, (pid_t, int *, int))                                                               \
	X(int, sigtimedwait, (const sigset_t *, siginfo_t *, const struct timespec *))                       \
	X(int, prctl, (int, ...))                                                                            \
	X(int, timerfd_create, (int, int))                                                                   \
	X(long, syscall, (long, ...))                                                                        \
	X(void, _exit, (int))

#define PLANT_REAL_MEMBER(type, name, parameters) type(*name) parameters;
struct real {
	PLANT_REAL(PLANT_REAL_MEMBER)
};

extern struct real real;

void real_find(void);

#define real_syscall(...) real.syscall(__VA_ARGS__)

#endif
