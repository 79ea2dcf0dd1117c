/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Whatever waits: here a process gives the baton away. What can be ready at once is asked for with a time-out of zero. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <unistd.h>

#include "client.h"

#define EPOLL_MAX    512
#define YIELD_ONE_OF 4 /* so often others come first although this one could go on */
#define NS_PER_MS    1000000
#define HASTY_POLLS  100
#define HASTY_NS     1000
#define POLL_MAX     512

static struct watched {
	int epoll; /* 0: free, as no epoll has that number */
	int fd;
	bool told_once;       /* EPOLLONESHOT: silent until it is watched anew */
	uint32_t told_arming; /* of a timer that is told by its edge, as nobody reads it */
	struct epoll_event event;
} watched[EPOLL_MAX];
static size_t watched_count;

/* ---- the wait of all --------------------------------------------------------------------- */

/* One that the process does not hold back itself. Its handler runs when the mask is given back. */
static bool has_signal(const sigset_t *own_mask)
{
	sigset_t pending;

	sigpending(&pending);
	if (sigisemptyset(&pending))
		return false;
	for (int signal = 1; signal < NSIG; signal++)
		if (sigismember(&pending, signal) == 1 && sigismember(own_mask, signal) == 0)
			return true;
	return false;
}

/*
 * Signals are held back meanwhile: a handler that runs while another process has the baton would be a second one that runs.
 */
int wait_until(bool (*ready)(void *), void *what, int64_t deadline_ns)
{
	struct plant_process *self = &plant->processes[client_self];
	bool yields = plant_random(plant) % YIELD_ONE_OF == 0;
	sigset_t all, own;
	int result = 1;

	if (!yields && ready(what)) {
		self->wants_room = false;
		return 1;
	}
	sigfillset(&all);
	sigprocmask(SIG_BLOCK, &all, &own);
	while (yields || !ready(what)) {
		if (!yields && has_signal(&own)) {
			result = -1;
			break;
		}
		if (!yields && deadline_ns <= plant->now_ns) {
			result = 0;
			break;
		}
		self->deadline_ns = yields ? plant->now_ns : deadline_ns;
		self->asked = plant->changes;
		yields = false;
		plant_pass(plant, client_self);
	}
	self->wants_room = false;
	sigprocmask(SIG_SETMASK, &own, NULL);
	if (result < 0)
		errno = EINTR;
	return result;
}

static int64_t after_ns(int64_t wait_ns)
{
	return wait_ns < 0 || wait_ns > PLANT_NEVER - plant->now_ns ? PLANT_NEVER : plant->now_ns + wait_ns;
}

/* ---- poll -------------------------------------------------------------------------------- */

struct asked {
	struct pollfd *fds;
	nfds_t count;
	int found;
};

static short found_at(const struct pollfd *fd);

static short events_of(const struct watched *one)
{
	const bool told =
	    one->event.events & EPOLLET && timer_is(one->fd) && one->told_arming == timer_armings(one->fd);

	return (short)(told ? 0 : one->event.events & 0xffff);
}

/* An epoll may be watched itself. The kernel's knows nothing of timers and cuts. */
static bool is_epoll(int fd)
{
	for (size_t i = 0; i < watched_count; i++)
		if (watched[i].epoll == fd)
			return true;
	return false;
}

static bool epoll_is_ready(int epoll)
{
	for (size_t i = 0; i < watched_count; i++) {
		struct pollfd member = {.fd = watched[i].fd, .events = events_of(&watched[i])};

		if (watched[i].epoll != epoll || watched[i].told_once)
			continue;
		real.poll(&member, 1, 0);
		if (found_at(&member))
			return true;
	}
	return false;
}

static short found_at(const struct pollfd *fd)
{
	if (timer_is(fd->fd))
		return (short)(timer_is_due(fd->fd) ? fd->events & POLLIN : 0);
	if (is_epoll(fd->fd))
		return (short)(epoll_is_ready(fd->fd) ? fd->events & POLLIN : 0);
	return network_events(fd->fd, fd->events, fd->revents);
}

static bool poll_ready(void *what)
{
	struct asked *asked = what;

	real.poll(asked->fds, asked->count, 0);
	asked->found = 0;
	for (nfds_t i = 0; i < asked->count; i++) {
		struct pollfd *fd = &asked->fds[i];

		if (fd->fd < 0)
			continue;
		fd->revents = found_at(fd);
		asked->found += fd->revents != 0;
	}
	return asked->found > 0;
}

static int64_t due_ns(int fd, short events);

static int64_t epoll_due_ns(int epoll)
{
	int64_t first_ns = PLANT_NEVER;

	for (size_t i = 0; i < watched_count; i++) {
		const int64_t member_ns = watched[i].epoll == epoll && !watched[i].told_once
					      ? due_ns(watched[i].fd, events_of(&watched[i]))
					      : PLANT_NEVER;

		if (member_ns < first_ns)
			first_ns = member_ns;
	}
	return first_ns;
}

/* When a timer makes it readable. */
static int64_t due_ns(int fd, short events)
{
	if (fd < 0 || !(events & POLLIN))
		return PLANT_NEVER;
	return is_epoll(fd) ? epoll_due_ns(fd) : timer_next_ns(fd);
}

int wait_poll(struct pollfd *fds, nfds_t count, int64_t deadline_ns)
{
	struct asked asked = {.fds = fds, .count = count};
	int64_t first_ns = deadline_ns;
	int result;

	for (nfds_t i = 0; i < count; i++) {
		const int64_t timer_ns = due_ns(fds[i].fd, fds[i].events);

		if (timer_ns < first_ns)
			first_ns = timer_ns;
		if (fds[i].events & POLLOUT)
			plant->processes[client_self].wants_room = true;
	}
	result = wait_until(poll_ready, &asked, first_ns);
	return result > 0 ? asked.found : result;
}

static void tell_poll(const char *name, const struct pollfd *fds, nfds_t count, int result)
{
	char text[PLANT_LINE];
	size_t size = 0;

	text[0] = '\0';
	for (nfds_t i = 0; result > 0 && i < count && size < sizeof(text) / 2; i++)
		if (fds[i].fd >= 0 && fds[i].revents)
			size += (size_t)snprintf(text + size, sizeof(text) - size, " %d:%x", fds[i].fd,
						 (unsigned)fds[i].revents);
	client_tell("%s %d%s", name, result, text);
}

/* Who asks again and again for no time waits for the clock, as one does whose deadline must be over by some time. */
static int64_t patient_ns(int64_t wait_ns)
{
	static int64_t asked_ns;
	static unsigned times;

	if (wait_ns != 0 || asked_ns != plant->now_ns)
		times = 0;
	asked_ns = plant->now_ns;
	return wait_ns == 0 && ++times > HASTY_POLLS ? HASTY_NS : wait_ns;
}

static int poll_for(const char *name, struct pollfd *fds, nfds_t count, int64_t wait_ns)
{
	int result, error;

	client_call();
	result = wait_poll(fds, count, after_ns(patient_ns(wait_ns)));
	error = errno;
	tell_poll(name, fds, count, result);
	errno = error;
	return result;
}

int poll(struct pollfd *fds, nfds_t count, int timeout)
{
	client_begin();
	if (!plant)
		return real.poll(fds, count, timeout);
	return poll_for("poll", fds, count, timeout < 0 ? -1 : (int64_t)timeout * NS_PER_MS);
}

/* Below 0: for ever. */
static int64_t wait_ns_of(const struct timespec *time)
{
	return time ? client_ns(time) : -1;
}

/* The mask is for who wants to wait for signals, too: nobody here does. */
int ppoll(struct pollfd *fds, nfds_t count, const struct timespec *timeout, const sigset_t *mask)
{
	(void)mask;
	client_begin();
	if (!plant)
		return real.poll(fds, count, timeout ? (int)(wait_ns_of(timeout) / NS_PER_MS) : -1);
	return poll_for("ppoll", fds, count, wait_ns_of(timeout));
}

/* What a program that was compiled with _FORTIFY_SOURCE calls. */
int __poll_chk(struct pollfd *fds, nfds_t count, int timeout, size_t room);
int __poll_chk(struct pollfd *fds, nfds_t count, int timeout, size_t room)
{
	if (room / sizeof(*fds) < count)
		abort();
	return poll(fds, count, timeout);
}

int __ppoll_chk(struct pollfd *fds, nfds_t count, const struct timespec *timeout, const sigset_t *mask,
		size_t room);
int __ppoll_chk(struct pollfd *fds, nfds_t count, const struct timespec *timeout, const sigset_t *mask,
		size_t room)
{
	if (room / sizeof(*fds) < count)
		abort();
	return ppoll(fds, count, timeout, mask);
}

int wait_blocking(int fd, short events)
{
	struct pollfd asked = {.fd = fd, .events = events};

	if (fcntl(fd, F_GETFL) & O_NONBLOCK)
		return 0;
	return wait_poll(&asked, 1, PLANT_NEVER) < 0 ? -1 : 0;
}

/* ---- select ------------------------------------------------------------------------------ */

static short wanted_of(int fd, const fd_set *readable, const fd_set *writable, const fd_set *other)
{
	return (short)((readable && FD_ISSET(fd, readable) ? POLLIN : 0) |
		       (writable && FD_ISSET(fd, writable) ? POLLOUT : 0) |
		       (other && FD_ISSET(fd, other) ? POLLPRI : 0));
}

static int put_set(fd_set *set, const struct pollfd *fd, short events)
{
	if (!set || !FD_ISSET(fd->fd, set))
		return 0;
	if (fd->revents & events)
		return 1;
	FD_CLR(fd->fd, set);
	return 0;
}

int select(int end, fd_set *restrict readable, fd_set *restrict writable, fd_set *restrict other,
	   struct timeval *restrict timeout)
{
	const int64_t wait_ns =
	    timeout ? (int64_t)timeout->tv_sec * PLANT_NS + (int64_t)timeout->tv_usec * 1000 : -1;
	struct pollfd fds[POLL_MAX];
	nfds_t count = 0;
	int result = 0;

	client_begin();
	if (!plant) {
		errno = ENOSYS;
		return -1;
	}
	for (int fd = 0; fd < end && count < POLL_MAX; fd++) {
		const short wanted = wanted_of(fd, readable, writable, other);

		if (wanted)
			fds[count++] = (struct pollfd){.fd = fd, .events = wanted};
	}
	if (poll_for("select", fds, count, wait_ns) < 0)
		return -1;
	for (nfds_t i = 0; i < count; i++) {
		result += put_set(readable, &fds[i], POLLIN | POLLHUP | POLLERR);
		result += put_set(writable, &fds[i], POLLOUT | POLLERR);
		result += put_set(other, &fds[i], POLLPRI);
	}
	return result;
}

/* ---- epoll: its order would be that of arrival; here it is that of what was added ---------- */

static struct watched *find_watched(int epoll, int fd)
{
	for (size_t i = 0; i < watched_count; i++)
		if (watched[i].epoll == epoll && watched[i].fd == fd)
			return &watched[i];
	return NULL;
}

static void drop_watched(struct watched *dropped)
{
	memmove(dropped, dropped + 1, (size_t)(watched + watched_count - dropped - 1) * sizeof(*dropped));
	watched_count--;
}

void epoll_forget(int fd)
{
	for (size_t i = watched_count; i-- > 0;)
		if (watched[i].epoll == fd || watched[i].fd == fd)
			drop_watched(&watched[i]);
}

int epoll_ctl(int epoll, int operation, int fd, struct epoll_event *event)
{
	struct watched *found;

	client_begin();
	if (real.epoll_ctl(epoll, operation, fd, event) < 0)
		return -1;
	if (!plant)
		return 0;
	found = find_watched(epoll, fd);
	if (operation == EPOLL_CTL_ADD && watched_count < EPOLL_MAX)
		watched[watched_count++] = (struct watched){.epoll = epoll, .fd = fd, .event = *event};
	else if (operation == EPOLL_CTL_MOD && found)
		*found = (struct watched){.epoll = epoll, .fd = fd, .event = *event};
	else if (operation == EPOLL_CTL_DEL && found)
		drop_watched(found);
	return 0;
}

int epoll_pwait(int epoll, struct epoll_event *events, int most, int timeout, const sigset_t *mask)
{
	struct pollfd fds[EPOLL_MAX];
	struct watched *of[EPOLL_MAX];
	nfds_t count = 0;
	int result, put = 0;

	(void)mask;
	client_begin();
	if (!plant) {
		errno = ENOSYS;
		return -1;
	}
	for (size_t i = 0; i < watched_count; i++) {
		if (watched[i].epoll != epoll || watched[i].told_once)
			continue;
		of[count] = &watched[i];
		fds[count++] = (struct pollfd){.fd = watched[i].fd, .events = events_of(&watched[i])};
	}
	result = poll_for("epoll_wait", fds, count, timeout < 0 ? -1 : (int64_t)timeout * NS_PER_MS);
	for (nfds_t i = 0; result > 0 && i < count && put < most; i++) {
		if (!fds[i].revents)
			continue;
		of[i]->told_arming = timer_armings(fds[i].fd);
		of[i]->told_once = of[i]->event.events & EPOLLONESHOT;
		events[put++] =
		    (struct epoll_event){.events = (uint32_t)fds[i].revents, .data = of[i]->event.data};
	}
	return result > 0 ? put : result;
}

int epoll_wait(int epoll, struct epoll_event *events, int most, int timeout)
{
	return epoll_pwait(epoll, events, most, timeout, NULL);
}

/* ---- sleep, signals ---------------------------------------------------------------------- */

static bool never(void *what)
{
	(void)what;
	return false;
}

static int sleep_until(int64_t deadline_ns, struct timespec *left)
{
	int result;

	client_call();
	result = wait_until(never, NULL, deadline_ns);
	if (left)
		*left = (struct timespec){0};
	client_tell("sleep %d", result);
	return result < 0 ? EINTR : 0;
}

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *time, struct timespec *left)
{
	const bool until = flags & TIMER_ABSTIME;

	client_begin();
	if (!plant)
		return ENOSYS;
	return sleep_until(until ? wait_ns_of(time) - (clock == CLOCK_REALTIME ? plant_ahead_ns(plant) : 0)
				 : after_ns(wait_ns_of(time)),
			   left);
}

int nanosleep(const struct timespec *time, struct timespec *left)
{
	const int error = clock_nanosleep(CLOCK_MONOTONIC, 0, time, left);

	errno = error;
	return error ? -1 : 0;
}

int usleep(useconds_t us)
{
	return nanosleep(&(struct timespec){us / 1000000, (long)(us % 1000000) * 1000}, NULL);
}

unsigned sleep(unsigned seconds)
{
	nanosleep(&(struct timespec){seconds, 0}, NULL);
	return 0;
}

struct signals {
	const sigset_t *set;
	siginfo_t *info;
	int found;
};

static bool signal_came(void *what)
{
	struct signals *signals = what;
	const struct timespec now = {0};

	signals->found = real.sigtimedwait(signals->set, signals->info, &now);
	return signals->found > 0;
}

int sigtimedwait(const sigset_t *restrict set, siginfo_t *restrict info,
		 const struct timespec *restrict timeout)
{
	struct signals signals = {.set = set, .info = info};
	int result;

	client_begin();
	if (!plant)
		return real.sigtimedwait(set, info, timeout);
	client_call();
	result = wait_until(signal_came, &signals, after_ns(wait_ns_of(timeout)));
	client_tell("sigtimedwait %d", result > 0 ? signals.found : 0);
	if (result > 0)
		return signals.found;
	if (result == 0)
		errno = EAGAIN;
	return -1;
}
