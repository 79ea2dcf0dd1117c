/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * For the tests and the bench: many controlled stations, on 127.1.0.1, 127.1.0.2, ... 127.1.1.1 (250 in each), in one process
 * or each in its own. KINDS says by letters, again and again, what the stations are:
 *
 *	h  answers at once: reads (by a position of type 201), interrogations, clock synchronisation, commands
 *	v  the same, and each drives on a road of its own
 *	f  as h, reads by a short float, for who does not know type 201
 *	s  as h, each answer after DELAY_MS
 *	d  dead: nobody listens
 *	m  mute: takes the connection and says nothing
 *	x  sends events (M_IT_NA_1 of IOA 1) as fast as they are acknowledged, numbered from 0; what is not acknowledged when the
 *	   connection ends is sent again
 *
 *	centre-rtus COUNT PORT KINDS DELAY_MS one|each
 *
 * It says "ready" on stdout and ends with stdin.
 */
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "iec104/geoposition.h"
#include "iec104/session.h"
#include "map/time_ns.h"

#define K            12
#define READY_MAX    256
#define STDIN_EVENT  UINT32_MAX
#define LISTENER_BIT 0x80000000u
#define ALL_EVENT    (UINT32_MAX - 1) /* the listener of all */
#define NET_SIZE     250
#define FIRST_HOST   0x7f010000u /* 127.1.0.0 */
#define OUTPUT_SIZE  1024
#define LATITUDE     522190650
#define LONGITUDE    210108517
#define ROADS        100
#define ROAD_APART   500000 /* 0.05 degree */
#define ROAD_S       600
#define ROAD_STEP    1000 /* of 1e-7 degree, in a second */
#define BACKLOG      1024
#define FILES_BESIDE 16 /* open files beside listeners and connections */

struct rtu {
	char kind;
	int listener, fd;
	uint32_t number;                  /* of the next event */
	uint8_t waiting[IEC104_ASDU_MAX]; /* a slow one's request */
	size_t waiting_size;
	int64_t answer_ns;
	struct iec104_session session;
	int64_t sent_ns[K];
	uint8_t input[IEC104_INPUT_LEAST], output[OUTPUT_SIZE];
};

static const struct iec104_times times = {
    .k = K, .w = 8, .t1_ns = 15 * NS_PER_S, .t2_ns = 10 * NS_PER_S, .t3_ns = 20 * NS_PER_S};
static const struct map_zone zone;
static _Atomic uint32_t counters[IEC104_COUNT_OF_COUNTERS];
static struct rtu *rtus;
static uint32_t first, count;
static int listener_of_all = -1;
static int64_t delay_ns;
static int epoll_fd;

static int64_t now_ns(void)
{
	struct timespec time;

	clock_gettime(CLOCK_MONOTONIC, &time);
	return time.tv_sec * NS_PER_S + time.tv_nsec;
}

static int64_t wall_ns(void)
{
	struct timespec time;

	clock_gettime(CLOCK_REALTIME, &time);
	return time.tv_sec * NS_PER_S + time.tv_nsec;
}

/* ---- answers ----------------------------------------------------------------------------- */

static void send_asdu(struct rtu *rtu, const uint8_t *bytes, size_t size)
{
	if (iec104_session_may_send(&rtu->session))
		iec104_session_send(&rtu->session, bytes, size, now_ns());
}

static void mirror(struct rtu *rtu, const uint8_t *bytes, size_t size, enum iec104_cause cause)
{
	uint8_t copy[IEC104_ASDU_MAX];

	memcpy(copy, bytes, size);
	iec104_asdu_mirror(copy, cause, false);
	send_asdu(rtu, copy, size);
}

static void send_object(struct rtu *rtu, const struct iec104_asdu *header, uint32_t ioa,
			const uint8_t *element, size_t size)
{
	struct iec104_builder builder;

	iec104_asdu_begin(&builder, header);
	iec104_asdu_add(&builder, ioa, element, size);
	send_asdu(rtu, builder.bytes, builder.size);
}

/* Roads lie beside one another; a vehicle goes north for ROAD_S at 11 m/s, and begins again. */
static void drive(struct iec104_geoposition *position, uint32_t number)
{
	position->latitude += ((int32_t)(number % ROADS) - ROADS / 2) * ROAD_APART +
			      (int32_t)((position->wall_ns / NS_PER_S + number) % ROAD_S) * ROAD_STEP;
	position->longitude += ((int32_t)(number / ROADS % ROADS) - ROADS / 2) * ROAD_APART;
}

static void send_position(struct rtu *rtu, const struct iec104_asdu *request, uint32_t ioa)
{
	struct iec104_geoposition position = {
	    .latitude = LATITUDE, .longitude = LONGITUDE, .fix = 1, .satellites = 8, .wall_ns = wall_ns()};
	const struct iec104_asdu header = {.type = IEC104_GEOPOSITION,
					   .cause = IEC104_REQUEST,
					   .originator = request->originator,
					   .ca = request->ca};
	uint8_t element[IEC104_GEOPOSITION_SIZE];

	if (rtu->kind == 'v')
		drive(&position, first + (uint32_t)(rtu - rtus));
	iec104_geoposition_encode(element, &position, &zone);
	send_object(rtu, &header, ioa, element, sizeof(element));
}

static void send_state(struct rtu *rtu, const struct iec104_asdu *request)
{
	const struct iec104_asdu header = {.type = IEC104_M_SP_NA_1,
					   .cause = IEC104_INTERROGATED,
					   .originator = request->originator,
					   .ca = request->ca};

	send_object(rtu, &header, 1, (const uint8_t[]){1}, 1);
}

static void send_events(struct rtu *rtu)
{
	static const struct iec104_asdu header = {
	    .type = IEC104_M_IT_NA_1, .cause = IEC104_SPONTANEOUS, .ca = 1};

	while (rtu->kind == 'x' && iec104_session_may_send(&rtu->session)) {
		const uint8_t element[] = {(uint8_t)rtu->number, (uint8_t)(rtu->number >> 8),
					   (uint8_t)(rtu->number >> 16), (uint8_t)(rtu->number >> 24), 0};

		send_object(rtu, &header, 1, element, sizeof(element));
		rtu->number++;
	}
}

static void answer(struct rtu *rtu, const uint8_t *bytes, size_t size)
{
	struct iec104_asdu asdu;

	if (!iec104_asdu_decode(bytes, size, &asdu))
		return;
	if (asdu.type == IEC104_C_RD_NA_1 && rtu->kind == 'f') {
		const struct iec104_asdu header = {.type = IEC104_M_ME_NC_1,
						   .cause = IEC104_REQUEST,
						   .originator = asdu.originator,
						   .ca = asdu.ca};

		send_object(rtu, &header, iec104_ioa_decode(asdu.objects),
			    (const uint8_t[]){0, 0, 0x50, 0x42, 0}, 5);
		return;
	}
	if (asdu.type == IEC104_C_RD_NA_1) {
		send_position(rtu, &asdu, iec104_ioa_decode(asdu.objects));
		return;
	}
	mirror(rtu, bytes, size,
	       asdu.cause == IEC104_DEACTIVATION ? IEC104_DEACTIVATION_CON : IEC104_ACTIVATION_CON);
	if (asdu.type == IEC104_C_IC_NA_1)
		send_state(rtu, &asdu);
	if (asdu.type != IEC104_C_CS_NA_1)
		mirror(rtu, bytes, size, IEC104_ACTIVATION_TERM);
}

static void take(struct rtu *rtu, const uint8_t *bytes, size_t size)
{
	if (rtu->kind != 's') {
		answer(rtu, bytes, size);
		return;
	}
	memcpy(rtu->waiting, bytes, size);
	rtu->waiting_size = size;
	rtu->answer_ns = now_ns() + delay_ns;
}

/* ---- connections ------------------------------------------------------------------------- */

static void hang_up(struct rtu *rtu)
{
	close(rtu->fd);
	rtu->fd = -1;
	rtu->number -= rtu->session.unacknowledged; /* they are sent again */
	rtu->waiting_size = 0;
}

static void run(struct rtu *rtu)
{
	const uint8_t *octets;
	size_t size;
	ssize_t written;

	while (iec104_session_next(&rtu->session, now_ns(), &octets, &size))
		if (octets != NULL)
			take(rtu, octets, size);
	iec104_session_run(&rtu->session, now_ns());
	send_events(rtu);
	octets = iec104_session_output(&rtu->session, &size);
	written = size > 0 ? send(rtu->fd, octets, size, MSG_NOSIGNAL | MSG_DONTWAIT) : 0;
	if (written > 0)
		iec104_session_written(&rtu->session, (size_t)written);
	if (rtu->session.closing != IEC104_OPEN)
		hang_up(rtu);
}

static void receive(struct rtu *rtu)
{
	size_t room;
	uint8_t *place = iec104_session_space(&rtu->session, &room);
	ssize_t received = recv(rtu->fd, place, room, MSG_DONTWAIT);

	if (received > 0)
		iec104_session_received(&rtu->session, (size_t)received);
	else if (received == 0 || errno != EAGAIN)
		iec104_session_close(&rtu->session, IEC104_CLOSED_BY_PEER);
	if (rtu->kind == 'm')
		rtu->session.input_begin = rtu->session.input_end = 0;
	run(rtu);
}

static void watch(int fd, uint32_t event)
{
	struct epoll_event wanted = {.events = EPOLLIN, .data.u32 = event};

	epoll_ctl(epoll_fd, EPOLL_CTL_ADD, fd, &wanted);
}

/* fd: its new connection. */
static void admit(struct rtu *rtu, uint32_t place, int fd)
{
	const struct iec104_memory memory = {.sent_ns = rtu->sent_ns,
					     .input = rtu->input,
					     .output = rtu->output,
					     .input_size = sizeof(rtu->input),
					     .output_size = sizeof(rtu->output)};
	int on = 1;

	if (rtu->fd >= 0)
		hang_up(rtu); /* the newer connection is the one that is meant */
	setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
	rtu->fd = fd;
	iec104_session_open(&rtu->session, &times, IEC104_CONTROLLED, counters, &memory, now_ns());
	watch(fd, place);
}

static void admit_at(uint32_t place)
{
	int fd = accept4(rtus[place].listener, NULL, NULL, SOCK_CLOEXEC);

	if (fd >= 0)
		admit(&rtus[place], place, fd);
}

/* By the address that it came to. */
static void admit_any(void)
{
	struct sockaddr_in address = {.sin_family = AF_INET};
	socklen_t size = sizeof(address);
	int fd = accept4(listener_of_all, NULL, NULL, SOCK_CLOEXEC);
	uint32_t host, place;

	if (fd < 0)
		return;
	getsockname(fd, (struct sockaddr *)&address, &size);
	host = ntohl(address.sin_addr.s_addr);
	place = (host - FIRST_HOST) / 256 * NET_SIZE + host % 256 - 1;
	if (place < count)
		admit(&rtus[place], place, fd);
	else
		close(fd);
}

static int listen_at(uint32_t host, uint16_t port)
{
	const struct sockaddr_in address = {
	    .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(host)};
	int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), on = 1;

	setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
	if (bind(fd, (const struct sockaddr *)&address, sizeof(address)) < 0 || listen(fd, BACKLOG) < 0) {
		perror("centre-rtus: listen");
		exit(1);
	}
	return fd;
}

/* ---- the loop ---------------------------------------------------------------------------- */

static int wait_ms(void)
{
	int64_t due = INT64_MAX;

	for (uint32_t i = 0; i < count; i++)
		if (rtus[i].kind == 's' && rtus[i].waiting_size > 0)
			due = earlier(due, rtus[i].answer_ns);
	return due == INT64_MAX ? (int)MS_PER_S : (int)later(0, (due - now_ns()) / NS_PER_MS + 1);
}

static void answer_late(void)
{
	for (uint32_t i = 0; i < count; i++) {
		struct rtu *rtu = &rtus[i];

		if (rtu->kind != 's' || rtu->waiting_size == 0 || now_ns() < rtu->answer_ns)
			continue;
		answer(rtu, rtu->waiting, rtu->waiting_size);
		rtu->waiting_size = 0;
		run(rtu);
	}
}

static void serve(void)
{
	struct epoll_event events[READY_MAX];

	for (;;) {
		int ready = epoll_wait(epoll_fd, events, READY_MAX, wait_ms());

		for (int i = 0; i < ready; i++) {
			uint32_t event = events[i].data.u32;
			char octet;

			if (event == STDIN_EVENT) {
				if (read(STDIN_FILENO, &octet, 1) <= 0)
					return;
			} else if (event == ALL_EVENT) {
				admit_any();
			} else if ((event & LISTENER_BIT) != 0) {
				admit_at(event & ~LISTENER_BIT);
			} else if (rtus[event].fd >= 0) {
				receive(&rtus[event]);
			}
		}
		answer_late();
	}
}

static void begin(uint16_t port, const char *kinds)
{
	uint32_t number;

	epoll_fd = epoll_create1(EPOLL_CLOEXEC);
	rtus = calloc(count, sizeof(*rtus));
	if (epoll_fd < 0 || rtus == NULL)
		exit(1);
	for (uint32_t i = 0; i < count; i++) {
		rtus[i].kind = kinds[(first + i) % strlen(kinds)];
		rtus[i].fd = -1;
		if (rtus[i].kind == 'd' || listener_of_all >= 0)
			continue;
		number = first + i;
		rtus[i].listener =
		    listen_at(FIRST_HOST + number / NET_SIZE * 256 + 1 + number % NET_SIZE, port);
		watch(rtus[i].listener, LISTENER_BIT | i);
	}
}

/* A process each; they end with this one. */
static void serve_each(uint16_t port, const char *kinds, uint32_t all)
{
	char octet;

	for (first = 0; first < all; first++) {
		count = 1;
		begin(port, kinds);
		if (fork() == 0) {
			prctl(PR_SET_PDEATHSIG, SIGKILL);
			serve();
			exit(0);
		}
		if (rtus[0].kind != 'd')
			close(rtus[0].listener);
		close(epoll_fd);
		free(rtus);
	}
	puts("ready");
	fflush(stdout);
	while (read(STDIN_FILENO, &octet, 1) > 0)
		;
}

int main(int argc, char **argv)
{
	struct rlimit files = {0};
	uint16_t port;

	if (argc != 6 || argv[3][0] == '\0')
		return 2;
	count = (uint32_t)strtoul(argv[1], NULL, 10);
	port = (uint16_t)strtoul(argv[2], NULL, 10);
	delay_ns = strtoll(argv[4], NULL, 10) * NS_PER_MS;
	if (getrlimit(RLIMIT_NOFILE, &files) == 0) {
		files.rlim_cur = files.rlim_max;
		setrlimit(RLIMIT_NOFILE, &files);
	}
	if (strcmp(argv[5], "each") == 0) {
		serve_each(port, argv[3], count);
		return 0;
	}
	if (strchr(argv[3], 'd') == NULL) /* one listener serves all, and a file an RTU is enough */
		listener_of_all = listen_at(INADDR_ANY, port);
	if (files.rlim_cur < (rlim_t)count * (listener_of_all < 0 ? 2 : 1) + FILES_BESIDE) {
		fprintf(stderr, "centre-rtus: %ju open files are too few: raise the limit (ulimit -Hn)\n",
			(uintmax_t)files.rlim_cur);
		return 1;
	}
	begin(port, argv[3]);
	if (listener_of_all >= 0)
		watch(listener_of_all, ALL_EVENT);
	watch(STDIN_FILENO, STDIN_EVENT);
	puts("ready");
	fflush(stdout);
	serve();
	return 0;
}
