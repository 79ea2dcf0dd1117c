/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * For tests/bench/polls.py: rounds of polls (C_RD_NA_1) of the stations of centre-rtus, each answered by a position of type 201.
 *
 *	poll_rounds floor turn|together COUNT ROUNDS WAIT_MS PORT        the least that anybody does: send and receive, nothing decoded
 *	poll_rounds centre turn|together COUNT ROUNDS WAIT_MS SOCKET...  rtu-centre's consumer: each poll is a request, each answer a record
 *	poll_rounds plan COUNT ROUNDS SOCKET                             what rtu-centre polls by itself, as fast as it can
 *	poll_rounds count COUNT SECONDS SOCKET...                        the same, each in its period
 *
 * SOCKET: of each shard. It says "ready" when all stations are there, goes on when it reads a line, and then says the nanoseconds of
 * each round, or of the seconds how many positions came. It ends with stdin.
 */
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
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
#define PACKET_MAX    64               /* requests */
#define ASKED_AT_MOST (PACKET_MAX - 1) /* beside an acknowledgement */
#define OPEN_MAX      3 /* batches that wait for their acknowledgement: one less than rtu-centre sends without */
#define SHARDS_MAX    64
enum { ACKNOWLEDGE = 1, READ = 7, LINK = 2, POSITION = 4, UP = 3 };

struct station {
	int fd;
	uint32_t ns, nr;
	size_t have;
	uint8_t octets[256];
};

static struct station *stations;
static uint32_t count, rounds, wait_ms;
static int epoll_fd;

/* Of rtu-centre: station i is one of shard i % shard_count. */
static struct pollfd shards[SHARDS_MAX];
static uint32_t open_batches[SHARDS_MAX]; /* not acknowledged */
static uint8_t sequences[SHARDS_MAX][8];  /* of the last */
static uint32_t shard_count;

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

static uint64_t get(const uint8_t *octets, unsigned size)
{
	uint64_t value = 0;

	for (unsigned i = 0; i < size; i++)
		value |= (uint64_t)octets[i] << 8 * i;
	return value;
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

static uint8_t batch[BATCH_MAX];

/* A shard that has said something. */
static uint32_t speaker(void)
{
	static uint32_t last;

	if (shard_count > 1 && poll(shards, shard_count, -1) < 0)
		fail("poll");
	do
		last = (last + 1) % shard_count;
	while (shard_count > 1 && shards[last].revents == 0);
	return last;
}

/* A request that acknowledges all batches; false: none waits for it. */
static bool acknowledgement(uint32_t shard, uint8_t *request)
{
	if (open_batches[shard] == 0)
		return false;
	request[0] = ACKNOWLEDGE;
	memcpy(request + 8, sequences[shard], 8);
	open_batches[shard] = 0;
	return true;
}

static void acknowledge(uint32_t shard)
{
	uint8_t request[ASKED] = {0};

	if (acknowledgement(shard, request) &&
	    send(shards[shard].fd, request, sizeof(request), MSG_NOSIGNAL) < 0)
		fail("acknowledge");
}

/* Its next packet; behind its last record. */
static const uint8_t *receive_batch(uint32_t shard)
{
	ssize_t size = recv(shards[shard].fd, batch, sizeof(batch), 0);

	if (size < BATCH_HEAD)
		fail("rtu-centre has gone");
	memcpy(sequences[shard], batch + 8, 8);
	if (++open_batches[shard] == OPEN_MAX)
		acknowledge(shard);
	return batch + size;
}

/* How many records its next packet has of stations that are up, or of positions. */
static uint32_t take_batch(uint32_t shard, uint8_t wanted)
{
	const uint8_t *end = receive_batch(shard);
	uint32_t found = 0;

	for (const uint8_t *record = batch + BATCH_HEAD; record < end; record += RECORD)
		found += record[0] == wanted && (wanted != LINK || record[36] == UP);
	return found;
}

/* size stations of a shard, the first of which is its first-th; with the acknowledgement of what it said. */
static void centre_ask(uint32_t shard, uint32_t first, uint32_t size)
{
	static uint64_t id;
	uint8_t packet[PACKET_MAX][ASKED] = {{0}};
	uint32_t used = acknowledgement(shard, packet[0]);

	for (uint32_t i = 0; i < size; i++, used++) {
		packet[used][0] = READ;
		put(&packet[used][2], 1, 2);
		put(&packet[used][4], shard + (first + i) * shard_count, 4);
		put(&packet[used][8], ++id, 8);
		put(&packet[used][16], 1, 4);
	}
	if (send(shards[shard].fd, packet, (size_t)used * ASKED, MSG_NOSIGNAL) < 0)
		fail("ask");
}

static void centre_turn(void)
{
	for (uint32_t i = 0; i < count; i++) {
		centre_ask(i % shard_count, i / shard_count, 1);
		for (uint32_t answered = 0; answered == 0;)
			answered = take_batch(i % shard_count, POSITION);
	}
}

/* Up to all stations of a shard, so many unanswered. */
static void ask_more(uint32_t shard, uint32_t *asked, uint32_t answered)
{
	const uint32_t all = (count + shard_count - 1 - shard) / shard_count;

	while (*asked < all && *asked - answered < 4 * ASKED_AT_MOST) {
		uint32_t size = all - *asked < ASKED_AT_MOST ? all - *asked : ASKED_AT_MOST;

		centre_ask(shard, *asked, size);
		*asked += size;
	}
}

static void centre_together(void)
{
	uint32_t asked[SHARDS_MAX] = {0}, answered[SHARDS_MAX] = {0};

	for (uint32_t shard = 0; shard < shard_count; shard++)
		ask_more(shard, &asked[shard], 0);
	for (uint32_t all = 0; all < count;) {
		uint32_t shard = speaker(), found = take_batch(shard, POSITION);

		answered[shard] += found;
		all += found;
		ask_more(shard, &asked[shard], answered[shard]);
		acknowledge(shard);
	}
}

static void begin_centre(char **paths)
{
	uint32_t up = 0;

	for (; shard_count < SHARDS_MAX && paths[shard_count] != NULL; shard_count++) {
		struct sockaddr_un address = {.sun_family = AF_UNIX};
		int fd = socket(AF_UNIX, SOCK_SEQPACKET, 0);

		snprintf(address.sun_path, sizeof(address.sun_path), "%s", paths[shard_count]);
		if (connect(fd, (const struct sockaddr *)&address, sizeof(address)) < 0)
			fail("rtu-centre's socket");
		shards[shard_count] = (struct pollfd){.fd = fd, .events = POLLIN};
	}
	while (up < count) {
		uint32_t shard = speaker();

		up += take_batch(shard, LINK);
		acknowledge(shard);
	}
}

/* ---- rounds ------------------------------------------------------------------------------------ */

static void wait_for_word(void)
{
	puts("ready");
	fflush(stdout);
	if (getchar() == EOF)
		exit(1);
}

/* What all that ends costs is no part of what is measured. */
static void wait_for_end(void)
{
	fflush(stdout);
	while (getchar() != EOF)
		;
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
	wait_for_end();
}

static void count_positions(const char *seconds)
{
	int64_t end;
	uint64_t found = 0;

	wait_for_word();
	for (end = now_ns() + strtoll(seconds, NULL, 10) * 1000000000; now_ns() < end;) {
		uint32_t shard = speaker();

		found += take_batch(shard, POSITION);
		acknowledge(shard);
	}
	printf("%llu\n", (unsigned long long)found);
	wait_for_end();
}

/* A position closes a round when it is the count-th behind the one that closed the last. */
static bool closes_round(const uint8_t *record, int64_t begun_ns, uint32_t *found)
{
	return record[0] == POSITION && (int64_t)get(record + 16, 8) > begun_ns && (*found)++ % count == 0;
}

/* By the times that the records have. What came before the word has waited for it. */
static void run_plan(void)
{
	struct timespec word;
	int64_t last_ns = 0;
	uint32_t found = 0;

	wait_for_word();
	clock_gettime(CLOCK_REALTIME, &word);
	for (uint32_t closed = 0; closed <= rounds;) {
		uint32_t shard = speaker();
		const uint8_t *end = receive_batch(shard);

		acknowledge(shard);
		for (const uint8_t *record = batch + BATCH_HEAD; record < end && closed <= rounds;
		     record += RECORD) {
			if (!closes_round(record, (int64_t)word.tv_sec * 1000000000 + word.tv_nsec, &found))
				continue;
			if (closed++ > 0)
				printf("%lld\n", (long long)((int64_t)get(record + 16, 8) - last_ns));
			last_ns = (int64_t)get(record + 16, 8);
		}
	}
	wait_for_end();
}

static uint32_t number(const char *argument)
{
	return (uint32_t)strtoul(argument, NULL, 10);
}

static void allow_files(void)
{
	struct rlimit files;

	getrlimit(RLIMIT_NOFILE, &files);
	files.rlim_cur = files.rlim_max;
	setrlimit(RLIMIT_NOFILE, &files);
}

int main(int argc, char **argv)
{
	bool turn;

	if (argc < 5)
		return 2;
	allow_files();
	if (strcmp(argv[1], "count") == 0 || strcmp(argv[1], "plan") == 0) {
		count = number(argv[2]);
		rounds = number(argv[3]);
		begin_centre(argv + 4);
		if (argv[1][0] == 'c')
			count_positions(argv[3]);
		else
			run_plan();
		return 0;
	}
	if (argc < 7)
		return 2;
	turn = strcmp(argv[2], "turn") == 0;
	count = number(argv[3]);
	rounds = number(argv[4]);
	wait_ms = number(argv[5]);
	if (strcmp(argv[1], "floor") == 0) {
		begin_floor(argv[6]);
		run(turn ? floor_turn : floor_together);
	} else {
		begin_centre(argv + 6);
		run(turn ? centre_turn : centre_together);
	}
	return 0;
}
