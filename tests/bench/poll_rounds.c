/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * For tests/bench/polls.py: rounds of polls (C_RD_NA_1) of the stations of centre-rtus, each answered by a position of type 201.
 *
 *	poll_rounds floor turn|together COUNT ROUNDS WAIT_MS PORT     the least that anybody does: send and receive, nothing decoded
 *	poll_rounds centre turn|together COUNT ROUNDS WAIT_MS SOCKET  rtu-centre's consumer: each poll is a request, each answer a record
 *	poll_rounds count COUNT SECONDS SOCKET                        what rtu-centre polls by itself
 *
 * It says "ready" when all stations are there, goes on when it reads a line, and then says the nanoseconds of each round, or of
 * the seconds how many positions came.
 */
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define NET_SIZE 250 /* as centre-rtus has it */
#define READY    512
#define MODULO   0x8000u
#define REQUEST  15 /* octets of the poll */

/* docs/centre.md */
#define BATCH_HEAD    16
#define RECORD        48
#define BATCH_MAX     65536
#define ASKED         32
#define ASKED_AT_MOST 64
enum { ACKNOWLEDGE = 1, READ = 7, LINK = 2, POSITION = 4, UP = 3 };

struct station {
	int fd;
	uint32_t ns, nr;
	size_t have;
	uint8_t octets[256];
};

static struct station *stations;
static uint32_t count, rounds, wait_ms;
static int consumer, epoll_fd;

static void fail(const char *what)
{
	perror(what);
	exit(1);
}

static int64_t now_ns(void)
{
	struct timespec time;

	clock_gettime(CLOCK_MONOTONIC, &time);
	return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static void put(uint8_t *octets, uint64_t value, unsigned size)
{
	for (unsigned i = 0; i < size; i++)
		octets[i] = (uint8_t)(value >> 8 * i);
}

/* ---- the floor --------------------------------------------------------------------------------- */

static void connect_to(uint32_t number, uint16_t port)
{
	static const uint8_t startdt[6] = {0x68, 4, 0x07, 0, 0, 0};
	const struct sockaddr_in address = {
	    .sin_family = AF_INET,
	    .sin_port = htons(port),
	    .sin_addr.s_addr = htonl(0x7f010000u + (number / NET_SIZE << 8) + 1 + number % NET_SIZE)};
	struct station *station = &stations[number];
	struct epoll_event wanted = {.events = EPOLLIN, .data.u32 = number};
	uint8_t answer[6];
	int on = 1;

	station->fd = socket(AF_INET, SOCK_STREAM, 0);
	if (connect(station->fd, (const struct sockaddr *)&address, sizeof(address)) < 0)
		fail("connect");
	setsockopt(station->fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
	if (send(station->fd, startdt, sizeof(startdt), 0) < 0 ||
	    recv(station->fd, answer, sizeof(answer), MSG_WAITALL) != sizeof(answer) || answer[2] != 0x0b)
		fail("STARTDT");
	epoll_ctl(epoll_fd, EPOLL_CTL_ADD, station->fd, &wanted);
}

static void floor_ask(uint32_t number)
{
	struct station *station = &stations[number];
	uint8_t apdu[REQUEST] = {0x68, REQUEST - 2, 0, 0, 0, 0, 102, 1, 5, 0, 1, 0, 1, 0, 0};

	put(apdu + 2, station->ns << 1, 2);
	put(apdu + 4, station->nr << 1, 2);
	station->ns = (station->ns + 1) % MODULO;
	if (send(station->fd, apdu, sizeof(apdu), MSG_NOSIGNAL) != sizeof(apdu))
		fail("send");
}

/* True: the answer is there. Other frames, as that of the end of initialisation, are passed over. */
static bool floor_take(uint32_t number)
{
	struct station *station = &stations[number];
	ssize_t size =
	    recv(station->fd, station->octets + station->have, sizeof(station->octets) - station->have, 0);
	size_t frame;
	bool answered = false;

	if (size <= 0)
		fail("receive");
	station->have += (size_t)size;
	while (station->have >= 2 && station->have >= (frame = 2u + station->octets[1])) {
		station->nr = (station->nr + !(station->octets[2] & 1)) % MODULO;
		answered |= station->octets[6] == 201 && station->octets[8] == 5;
		station->have -= frame;
		memmove(station->octets, station->octets + frame, station->have);
	}
	return answered;
}

static void floor_turn(void)
{
	for (uint32_t i = 0; i < count; i++) {
		floor_ask(i);
		while (!floor_take(i))
			;
	}
}

static void floor_together(void)
{
	struct epoll_event events[READY];
	uint32_t answered = 0;

	for (uint32_t i = 0; i < count; i++)
		floor_ask(i);
	while (answered < count) {
		int ready = epoll_wait(epoll_fd, events, READY, -1);

		for (int i = 0; i < ready; i++)
			answered += floor_take(events[i].data.u32);
	}
}

static void begin_floor(const char *port)
{
	epoll_fd = epoll_create1(0);
	stations = calloc(count, sizeof(*stations));
	if (stations == NULL)
		fail("memory");
	for (uint32_t i = 0; i < count; i++)
		connect_to(i, (uint16_t)strtoul(port, NULL, 10));
}

/* ---- rtu-centre -------------------------------------------------------------------------------- */

/* The next packet, acknowledged: how many records it has of stations that are up, or of positions. */
static uint32_t take_batch(uint8_t wanted)
{
	static uint8_t batch[BATCH_MAX];
	uint8_t acknowledgement[ASKED] = {ACKNOWLEDGE};
	ssize_t size = recv(consumer, batch, sizeof(batch), 0);
	uint32_t found = 0;

	if (size < BATCH_HEAD)
		fail("rtu-centre has gone");
	memcpy(acknowledgement + 8, batch + 8, 8);
	if (send(consumer, acknowledgement, sizeof(acknowledgement), MSG_NOSIGNAL) < 0)
		fail("acknowledge");
	for (const uint8_t *record = batch + BATCH_HEAD; record < batch + size; record += RECORD)
		found += record[0] == wanted && (wanted != LINK || record[36] == UP);
	return found;
}

static void centre_ask(uint32_t first, uint32_t size)
{
	static uint64_t id;
	uint8_t packet[ASKED_AT_MOST][ASKED] = {{0}};

	for (uint32_t i = 0; i < size; i++) {
		packet[i][0] = READ;
		put(&packet[i][2], 1, 2);
		put(&packet[i][4], first + i, 4);
		put(&packet[i][8], ++id, 8);
		put(&packet[i][16], 1, 4);
	}
	if (send(consumer, packet, (size_t)size * ASKED, MSG_NOSIGNAL) < 0)
		fail("ask");
}

static void centre_turn(void)
{
	for (uint32_t i = 0; i < count; i++) {
		centre_ask(i, 1);
		for (uint32_t answered = 0; answered == 0;)
			answered = take_batch(POSITION);
	}
}

static void centre_together(void)
{
	uint32_t asked = 0, answered = 0;

	while (answered < count) {
		for (; asked < count && asked - answered < 4 * ASKED_AT_MOST;) {
			uint32_t size = count - asked < ASKED_AT_MOST ? count - asked : ASKED_AT_MOST;

			centre_ask(asked, size);
			asked += size;
		}
		answered += take_batch(POSITION);
	}
}

static void begin_centre(const char *path)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	uint32_t up = 0;

	snprintf(address.sun_path, sizeof(address.sun_path), "%s", path);
	consumer = socket(AF_UNIX, SOCK_SEQPACKET, 0);
	if (connect(consumer, (const struct sockaddr *)&address, sizeof(address)) < 0)
		fail("rtu-centre's socket");
	while (up < count)
		up += take_batch(LINK);
}

/* ---- rounds ------------------------------------------------------------------------------------ */

static void wait_for_word(void)
{
	puts("ready");
	fflush(stdout);
	if (getchar() == EOF)
		exit(1);
}

static void run(void (*round)(void))
{
	const struct timespec pause = {wait_ms / 1000, wait_ms % 1000 * 1000000L};
	struct rusage usage;

	wait_for_word();
	for (uint32_t i = 0; i < rounds; i++) {
		int64_t begun = now_ns();

		round();
		printf("%lld\n", (long long)(now_ns() - begun));
		nanosleep(&pause, NULL);
	}
	getrusage(RUSAGE_SELF, &usage);
	fprintf(stderr, "%lld\n",
		(long long)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) * 1000000 +
		    usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

static int count_positions(const char *seconds, const char *path)
{
	int64_t end;
	uint64_t found = 0;

	begin_centre(path);
	wait_for_word();
	for (end = now_ns() + strtoll(seconds, NULL, 10) * 1000000000; now_ns() < end;)
		found += take_batch(POSITION);
	printf("%llu\n", (unsigned long long)found);
	return 0;
}

int main(int argc, char **argv)
{
	struct rlimit files;
	bool floor, turn;

	if (argc < 5)
		return 2;
	getrlimit(RLIMIT_NOFILE, &files);
	files.rlim_cur = files.rlim_max;
	setrlimit(RLIMIT_NOFILE, &files);
	if (strcmp(argv[1], "count") == 0) {
		count = (uint32_t)strtoul(argv[2], NULL, 10);
		return count_positions(argv[3], argv[4]);
	}
	if (argc != 7)
		return 2;
	floor = strcmp(argv[1], "floor") == 0;
	turn = strcmp(argv[2], "turn") == 0;
	count = (uint32_t)strtoul(argv[3], NULL, 10);
	rounds = (uint32_t)strtoul(argv[4], NULL, 10);
	wait_ms = (uint32_t)strtoul(argv[5], NULL, 10);
	if (floor) {
		begin_floor(argv[6]);
		run(turn ? floor_turn : floor_together);
	} else {
		begin_centre(argv[6]);
		run(turn ? centre_turn : centre_together);
	}
	return 0;
}
