/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * One line's port, a serial port or a TCP connection: it is opened, looked after and, when it is lost, tried again, and
 * carries bytes between its device and its line. What becomes of it is said in the log. Nothing here blocks.
 */
#ifndef OPENRTU_MODULES_MODBUS_PORT_H
#define OPENRTU_MODULES_MODBUS_PORT_H

#include <stdbool.h>
#include <stdint.h>

#include "channel/attempts.h"
#include "map/map.h"
#include "map/repeats.h"
#include "modbus/config.h"
#include "modbus/frames.h"
#include "modbus/line.h"

#define PORT_PATH_SIZE 512
#define PORT_GATHER_NS 250000 /* a seventh of the shortest silence between two frames */

struct port_backend;

struct port {
	/* The caller's. */
	struct modbus_line line;

	/* For the caller to look at. All times are CLOCK_MONOTONIC. */
	const struct modbus_port *config;
	uint32_t number;     /* of the line in the configuration */
	int64_t deadline_ns; /* of the line, or of the next try to open the port; 0: it is to be served now */
	struct modbus_histogram wakeups; /* how late it was served */

	/* The port's own. */
	struct map *map;
	struct modbus_frames *frames;
	const struct port_backend *backend; /* a serial port or a TCP connection */
	int epoll_fd;
	char path[PORT_PATH_SIZE];
	int fd; /* -1: not open */
	struct attempts attempts;
	bool pty_logged;
	struct map_repeats hangs; /* lines about connections that brought nothing */
	int64_t connect_ns;       /* no connection is made before */
	int64_t connected_by_ns;  /* until then a connection may take; 0: none is being made */
	uint32_t answers;         /* of the line, before the port was opened */
	int64_t check_ns;         /* the next look whether the port is as it was set */
	bool listening;           /* bytes that arrive wake this process */
	bool waiting;             /* for deadline_ns, which lay ahead */
	uint32_t answered;        /* line.counters.answers when the last request was written */
};

/*
 * The port of line number of the configuration, not yet open; its line is the caller's to make. A device's name without
 * a leading slash is a file in directory. epoll_fd tells of the port with a pointer to it: it must not move.
 */
void port_init(struct port *port, struct map *map, uint32_t number, const char *directory, int epoll_fd);

/* To be called when epoll tells of the port: it is to be served at once. */
void port_wake(struct port *port);

/*
 * Does what is due: opens the port, gives its line what came, and sends what the line wants sent. To be called from
 * deadline_ns on, which is set anew. Until due_ns, of ports_due_ns, that is not late.
 */
void port_serve(struct port *port, int64_t due_ns);

/*
 * When to serve the ports that are due first: at the first one's deadline, or up to PORT_GATHER_NS behind it if others are
 * due until then. To wake costs more than to serve a line. INT64_MAX: none is due.
 */
int64_t ports_due_ns(const struct port *ports, uint32_t count);

/* Its line is in use. A connection that is being made for the first time is not open; between two, it is. */
bool port_is_open(const struct port *port);

#endif
