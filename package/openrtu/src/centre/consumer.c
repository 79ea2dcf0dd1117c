/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/consumer.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "centre/order.h"
#include "centre/request.h"
#include "centre/stations.h"

#define PACKETS_A_TURN 16 /* of a consumer that only talks */
#define SEND_BUFFER    (512 * 1024)
#define MODE           0660

/* ---- listening --------------------------------------------------------------------------- */

static int fail(int fd, const char *path, const char *what)
{
	fprintf(stderr, "rtu-centre: %s: %s: %s\n", path, what, strerror(errno));
	if (fd >= 0)
		close(fd);
	return -1;
}

/* A socket whose process was killed. What is no socket stays. */
static void remove_left_over(const struct sockaddr_un *address)
{
	struct stat status;
	int fd;

	if (lstat(address->sun_path, &status) < 0 || !S_ISSOCK(status.st_mode))
		return;
	fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	if (fd >= 0 && connect(fd, (const struct sockaddr *)address, sizeof(*address)) < 0 &&
	    errno == ECONNREFUSED)
		unlink(address->sun_path);
	if (fd >= 0)
		close(fd);
}

int centre_consumer_listen(const char *path)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

	snprintf(address.sun_path, sizeof(address.sun_path), "%s", path);
	remove_left_over(&address);
	if (fd < 0 || bind(fd, (const struct sockaddr *)&address, sizeof(address)) < 0)
		return fail(fd, path, "cannot be bound");
	if (chmod(path, MODE) < 0 || listen(fd, 1) < 0)
		return fail(fd, path, "cannot be listened on");
	return fd;
}

bool centre_consumer_accept(struct centre *centre, int listener)
{
	int fd = accept4(listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
	int size = SEND_BUFFER;

	if (fd < 0)
		return false;
	if (centre->consumer >= 0) {
		fprintf(stderr, "rtu-centre: a second consumer was turned away\n");
		close(fd);
		return false;
	}
	setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &size, sizeof(size));
	fprintf(stderr, "rtu-centre: consumer connected, %" PRIu32 " stations\n",
		centre->config->station_count);
	centre->consumer = fd;
	centre_stations_begin(centre);
	return true;
}

void centre_consumer_drop(struct centre *centre, const char *why)
{
	if (centre->consumer < 0)
		return;
	close(centre->consumer);
	centre->consumer = -1;
	centre_stations_end(centre);
	fprintf(stderr,
		"rtu-centre: consumer gone, %s; %" PRIu64
		" records it has not acknowledged, which their stations keep; all connections end\n",
		why, centre_batches_open(&centre->batches));
}

/* ---- both ways --------------------------------------------------------------------------- */

static void released(void *context, const struct centre_record *record)
{
	centre_station_release(context, record);
}

/* False: the consumer speaks another protocol, or does not take what it asks for. */
static bool take_request(struct centre *centre, const uint8_t *octets, size_t size)
{
	struct centre_request request;

	if (!centre_request_read(octets, size, &request))
		return false;
	if (request.kind == CENTRE_ACKNOWLEDGE)
		return centre_batches_acknowledge(&centre->batches, request.id, released, centre);
	if (centre_batches_room(&centre->batches) == 0)
		return false; /* asks on and on, and acknowledges nothing */
	centre_station_order(centre, &request);
	return true;
}

static bool take_packet(struct centre *centre, const uint8_t *octets, size_t size)
{
	for (size_t at = 0; at < size; at += sizeof(struct centre_request))
		if (!take_request(centre, octets + at, size - at))
			return false;
	return true;
}

void centre_consumer_receive(struct centre *centre)
{
	uint8_t octets[CENTRE_REQUESTS_SIZE];

	for (unsigned i = 0; i < PACKETS_A_TURN; i++) {
		ssize_t size = recv(centre->consumer, octets, sizeof(octets), MSG_TRUNC);

		if (size < 0 && (errno == EAGAIN || errno == EINTR))
			return;
		if (size <= 0) {
			centre_consumer_drop(centre, "it closed the connection");
			return;
		}
		if ((size_t)size > sizeof(octets) || !take_packet(centre, octets, (size_t)size)) {
			centre_consumer_drop(centre,
					     "it sent what is no request, or acknowledged what is not open");
			return;
		}
	}
}

bool centre_consumer_flush(struct centre *centre)
{
	const struct centre_batch *batch;
	size_t size;

	while (centre->consumer >= 0 && (batch = centre_batches_next(&centre->batches, &size)) != NULL) {
		if (send(centre->consumer, batch, size, MSG_NOSIGNAL) >= 0)
			centre_batches_sent(&centre->batches);
		else if (errno == EAGAIN || errno == EINTR)
			return true;
		else
			centre_consumer_drop(centre, strerror(errno));
	}
	return false;
}
