/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The socket on the interface. */
#ifndef OPENRTU_MODULES_GOOSE_WIRE_H
#define OPENRTU_MODULES_GOOSE_WIRE_H

#include "goose/stats.h"
#include "map/map.h"

struct wire {
	struct map *map;
	struct goose_stats *stats;
	int fd;
	uint8_t address[6]; /* of the interface */
	bool is_down;
	bool gone; /* the interface is no more: another process gets another socket */
};

/* False with errno: fd is no socket of an interface. */
bool wire_init(struct wire *wire, struct map *map, int fd, struct goose_stats *stats);
/* The size of a frame that has come; 0: there is none. */
size_t wire_receive(struct wire *wire, uint8_t frame[GOOSE_FRAME_MAX]);
void wire_count_overrun(struct wire *wire);
/* False: the frame was not sent, and will not be. */
bool wire_send(struct wire *wire, const uint8_t *frame, size_t size);

#endif
