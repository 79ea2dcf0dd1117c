/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One process of the plant: its place among the others, and what its descriptors are. */
#ifndef PLANT_CLIENT_H
#define PLANT_CLIENT_H

#include <stdbool.h>
#include <stdint.h>

#include "real.h"
#include "shared.h"

#define CLIENT_FDS 1024

struct sockaddr_un;

extern struct plant *plant; /* NULL: this process is in none */
extern uint32_t client_self;

/* The constructor's work, for who is called before it. */
void client_begin(void);

/* At the begin of each call that others may notice: here the process dies or stops, if a fault says so. */
void client_call(void);

/* It dies, or stops, as the fault says. */
void client_suffer(const struct plant_fault *fault);

/* A call that takes no time. Who waits for time by asking for it again and again shall see it pass all the same. */
void client_spin(void);

static inline int64_t client_ns(const struct timespec *time)
{
	return (int64_t)time->tv_sec * PLANT_NS + time->tv_nsec;
}

static inline struct timespec client_timespec(int64_t time_ns)
{
	return (struct timespec){.tv_sec = time_ns / PLANT_NS, .tv_nsec = time_ns % PLANT_NS};
}

#define client_tell(...) plant_tell(plant, client_self, __VA_ARGS__)

/* Something that may make another process ready. */
void client_changes(void);

/* Leaves the plant: from here on this process only ends. */
void client_leave(const char *how);

/* ---- waiting: waits.c */

/*
 * Until ready() says so (1), deadline_ns is there (0), or a signal was handled (-1 with EINTR). Not ready at once: then others
 * run.
 */
int wait_until(bool (*ready)(void *), void *what, int64_t deadline_ns);

/* As poll(), by plant time. */
int wait_poll(struct pollfd *fds, nfds_t count, int64_t deadline_ns);

/* Until a descriptor that blocks is ready for one of these. 0, or -1 with EINTR. */
int wait_blocking(int fd, short events);

/* ---- timers: timers.c. Each takes what is no timer, too. */

bool timer_is(int fd);
bool timer_is_due(int fd);
int64_t timer_next_ns(int fd);
uint32_t timer_armings(int fd); /* how often it was set: each time makes one edge */
ssize_t timer_read(int fd, void *out, size_t size);
void timer_forget(int fd);

/* ---- epoll: waits.c */
void epoll_forget(int fd);

/* ---- TCP over the plant's own sockets: network.c */

/* A connection that waits for the end of a cut is tried again; no octet passes while it is cut. */
short network_events(int fd, short wanted, short found);
bool network_is_cut(int fd);
bool network_is_lost(int fd); /* for ever: what is written goes nowhere */
/* Of a connection with delay: how many octets of size may be taken now. */
size_t network_arrived(int fd, size_t size);
void network_took(int fd, ssize_t size);
void network_sent(int fd, ssize_t size);
/* Its other end learns it as late as what was sent. */
void network_close(int fd);

void network_forget(int fd);

uint16_t network_port(int fd); /* 0: it has none */
bool network_take_port(int fd);
socklen_t network_name(const struct sockaddr *address, struct sockaddr_un *out);
bool network_is_cut_off(int fd, const struct sockaddr *to);
void network_put_sender(const struct sockaddr_un *name, socklen_t name_size, struct sockaddr *out,
			socklen_t *size);

/* ---- UDP: datagrams.c */

void datagrams_made(int fd);
void datagrams_forget(int fd);
bool datagrams_is(int fd);
ssize_t datagrams_send(int fd, const struct msghdr *message, int flags);
ssize_t datagrams_receive(int fd, struct msghdr *message, int flags);

/* ---- Ethernet: packets.c */

int packets_socket(int type, int protocol);
uint32_t packets_tap(int fd); /* 0: it is no packet socket */
void packets_forget(int fd);
int packets_bind(int fd);
int packets_name(int fd, struct sockaddr *out, socklen_t *size);
ssize_t packets_send(int fd, const void *frame, size_t size);
bool packets_control(unsigned long request, void *argument);

/* ---- descriptors: files.c */

/* FD_FILE: nobody waits for it. FD_OTHER: a pipe, or what the kernel made for this process alone, as a timer. */
enum fd_kind { FD_FILE, FD_SOCKET, FD_TERMINAL, FD_OTHER };

enum fd_kind files_kind(int fd);
void files_forget(unsigned first, unsigned last);

/* ---- memory that others see: stores.c */
void stores_map(void *memory, size_t size);
void stores_unmap(const void *memory);
/* It suffers the fault before its store number fault->stores from now on. */
void stores_await(const struct plant_fault *fault);
/* No fault waits any more: in a child, or when its time is over. */
void stores_forget(void);
void stores_look(void);

/* ---- what it holds: account.c */
void account_begin(void);
void account_look(void);

/* ---- the flash: disk.c */

/* False: it is none of its files. */
bool disk_writes(int fd, const void *octets, size_t size, ssize_t *written);
bool disk_gives_nothing(int fd); /* to who reads; with errno */
void disk_loses_power(void);
void disk_forget(int fd);

#endif
