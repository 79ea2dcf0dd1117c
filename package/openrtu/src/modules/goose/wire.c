/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/goose/wire.h"

#include <errno.h>
#include <linux/if_packet.h>
#include <string.h>
#include <sys/socket.h>

bool wire_init(struct wire *wire, struct map *map, int fd, struct goose_stats *stats)
{
	struct sockaddr_ll address;
	socklen_t size = sizeof(address);

	*wire = (struct wire){.map = map, .fd = fd, .stats = stats};
	if (getsockname(fd, (struct sockaddr *)&address, &size) < 0)
		return false;
	memcpy(wire->address, address.sll_addr, sizeof(wire->address));
	return true;
}

/* An interface that is down may come back; one that is no more comes back as another. Said once. */
static void note(struct wire *wire, int error)
{
	map_count(&wire->stats->failures, 1);
	wire->gone |= error == ENODEV || error == ENXIO || error == EBADF;
	if (!wire->is_down)
		map_log(wire->map, MAP_LOG_ERROR, "the interface %s: %s",
			goose_settings(map_config(wire->map))->interface, strerror(error));
	wire->is_down = true;
}

size_t wire_receive(struct wire *wire, uint8_t frame[GOOSE_FRAME_MAX])
{
	/* A longer frame is cut, and so is no message. */
	const ssize_t size = recv(wire->fd, frame, GOOSE_FRAME_MAX, 0);

	if (size > 0)
		return (size_t)size;
	if (size < 0 && errno != EAGAIN && errno != EINTR)
		note(wire, errno);
	return 0;
}

/* The kernel counts from the last time it was asked. */
void wire_count_overrun(struct wire *wire)
{
	struct tpacket_stats counted;
	socklen_t size = sizeof(counted);

	if (getsockopt(wire->fd, SOL_PACKET, PACKET_STATISTICS, &counted, &size) == 0)
		map_count(&wire->stats->overrun, counted.tp_drops);
}

bool wire_send(struct wire *wire, const uint8_t *frame, size_t size)
{
	if (send(wire->fd, frame, size, 0) != (ssize_t)size) {
		note(wire, errno);
		return false;
	}
	if (wire->is_down)
		map_log(wire->map, MAP_LOG_INFO, "the interface %s is up again",
			goose_settings(map_config(wire->map))->interface);
	wire->is_down = false;
	return true;
}
