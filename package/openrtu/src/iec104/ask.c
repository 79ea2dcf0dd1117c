/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * For the tests: a controlling station on a TCP connection to 127.0.0.1. What it is told is a line on stdin, what it sees a line
 * of JSON on stdout. It ends with the connection, or with stdin.
 *
 *	iec104-ask PORT CONFIRMATION_MS TERMINATION_MS
 *
 *	interrogate CA QOI | counters CA QCC | read CA IOA | clock CA
 *	single|double|normalized|scaled|bits|float|step CA IOA VALUE SELECT TAGGED
 *	execute ID | cancel ID
 */
#include <arpa/inet.h>
#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "iec104/controlling.h"
#include "map/time_ns.h"

#define K         12
#define LINE_SIZE 128

static struct iec104_controlling_settings settings = {
    .times = {.k = K, .w = 8, .t1_ns = 15 * NS_PER_S, .t2_ns = 10 * NS_PER_S, .t3_ns = 20 * NS_PER_S},
    .position_type = IEC104_GEOPOSITION,
    .requests_max = 8,
    .selection_ns = 60 * NS_PER_S,
    .interrogation_ns = 60 * NS_PER_S};
static struct iec104_controlling controlling;
static int64_t sent_ns[K];
static uint8_t input[IEC104_INPUT_SIZE], output[IEC104_OUTPUT_SIZE];
static const struct iec104_memory memory = {.sent_ns = sent_ns,
					    .input = input,
					    .output = output,
					    .input_size = sizeof(input),
					    .output_size = sizeof(output)};
static char line[LINE_SIZE];
static size_t line_size;
static bool told_started;

static int64_t clock_ns(clockid_t id)
{
	struct timespec time;

	clock_gettime(id, &time);
	return time.tv_sec * NS_PER_S + time.tv_nsec;
}

static struct iec104_moment moment(void)
{
	return (struct iec104_moment){clock_ns(CLOCK_MONOTONIC), clock_ns(CLOCK_REALTIME)};
}

/* ---- what it sees ------------------------------------------------------------------------ */

static void on_information(void *context, const struct iec104_asdu *asdu,
			   const struct iec104_information *object)
{
	(void)context;
	printf("{\"type\": %u, \"cause\": %u, \"ca\": %u, \"ioa\": %" PRIu32 ", \"u\": %" PRIu32
	       ", \"i\": %" PRId32 ", \"quality\": %u, \"wall_ns\": %" PRId64 "}\n",
	       asdu->type, asdu->cause, asdu->ca, object->ioa, object->value.u, object->value.i,
	       object->quality, object->wall_ns);
}

static void on_position(void *context, const struct iec104_asdu *asdu, uint32_t ioa,
			const struct iec104_geoposition *position)
{
	(void)context;
	printf("{\"type\": %u, \"cause\": %u, \"ca\": %u, \"ioa\": %" PRIu32 ", \"latitude\": %" PRId32
	       ", \"longitude\": %" PRId32 "}\n",
	       asdu->type, asdu->cause, asdu->ca, ioa, position->latitude, position->longitude);
}

static void on_progress(void *context, const struct iec104_controlling_request *request)
{
	(void)context;
	printf("{\"request\": %" PRIu32 ", \"state\": \"%s\", \"result\": \"%s\", \"cause\": %u}\n",
	       request->id, map_command_state_name(request->state), map_command_result_name(request->result),
	       request->cause);
}

static const struct iec104_controlling_listener listener = {
    .information = on_information, .position = on_position, .progress = on_progress};

/* ---- what it is told --------------------------------------------------------------------- */

static uint32_t command(const char *word, const char *arguments)
{
	static const struct {
		const char *word;
		enum map_type type;
	} types[] = {{"single", MAP_SINGLE}, {"double", MAP_DOUBLE},  {"normalized", MAP_NORMALIZED},
		     {"scaled", MAP_SCALED}, {"bits", MAP_BITSTRING}, {"float", MAP_FLOAT},
		     {"step", MAP_STEP}};
	struct iec104_command wanted = {0};
	unsigned ca, select, tagged;
	double value;

	if (sscanf(arguments, "%u %" SCNu32 " %lf %u %u", &ca, &wanted.ioa, &value, &select, &tagged) != 5)
		return 0;
	for (size_t i = 0; i < sizeof(types) / sizeof(types[0]); i++)
		if (strcmp(word, types[i].word) == 0)
			wanted.type = types[i].type;
	wanted.select = select != 0;
	wanted.tagged = tagged != 0;
	if (wanted.type == MAP_FLOAT)
		wanted.value.f = (float)value;
	else if (wanted.type == MAP_STEP)
		wanted.step = (int8_t)value;
	else if (wanted.type == MAP_BITSTRING)
		wanted.value.u = (uint32_t)value;
	else
		wanted.value.i = (int32_t)value;
	return iec104_controlling_command(&controlling, (uint16_t)ca, &wanted, moment());
}

static uint32_t obey(const char *word, const char *arguments)
{
	uint32_t first = 0, second = 0;

	sscanf(arguments, "%" SCNu32 " %" SCNu32, &first, &second);
	if (strcmp(word, "interrogate") == 0)
		return iec104_controlling_interrogate(&controlling, (uint16_t)first, (uint8_t)second,
						      moment());
	if (strcmp(word, "counters") == 0)
		return iec104_controlling_interrogate_counters(&controlling, (uint16_t)first, (uint8_t)second,
							       moment());
	if (strcmp(word, "read") == 0)
		return iec104_controlling_read(&controlling, (uint16_t)first, second, moment());
	if (strcmp(word, "clock") == 0)
		return iec104_controlling_set_clock(&controlling, (uint16_t)first, moment());
	if (strcmp(word, "execute") == 0)
		return iec104_controlling_execute(&controlling, first, moment()) ? first : 0;
	if (strcmp(word, "cancel") == 0)
		return iec104_controlling_cancel(&controlling, first, moment()) ? first : 0;
	return command(word, arguments);
}

/* False: stdin ended, or a line is too long. */
static bool take_line(void)
{
	char word[LINE_SIZE], *end;
	ssize_t count = read(STDIN_FILENO, line + line_size, sizeof(line) - 1 - line_size);
	int used = 0;

	if (count <= 0)
		return false;
	line_size += (size_t)count;
	line[line_size] = '\0';
	while ((end = strchr(line, '\n')) != NULL) {
		*end = '\0';
		if (sscanf(line, "%127s%n", word, &used) == 1)
			printf("{\"asked\": %" PRIu32 "}\n", obey(word, line + used));
		line_size -= (size_t)(end + 1 - line);
		memmove(line, end + 1, line_size + 1);
	}
	return line_size < sizeof(line) - 1;
}

/* ---- the connection ---------------------------------------------------------------------- */

static void receive(int connection)
{
	size_t room;
	uint8_t *place = iec104_session_space(&controlling.session, &room);
	ssize_t count = room > 0 ? read(connection, place, room) : 0;

	if (count > 0)
		iec104_session_received(&controlling.session, (size_t)count);
	else if (room > 0)
		iec104_session_close(&controlling.session, IEC104_CLOSED_BY_PEER);
}

static void transmit(int connection)
{
	size_t size;
	const uint8_t *octets = iec104_session_output(&controlling.session, &size);
	ssize_t count = size > 0 ? send(connection, octets, size, MSG_NOSIGNAL) : 0;

	if (count < 0)
		iec104_session_close(&controlling.session, IEC104_CLOSED_BY_PEER);
	else
		iec104_session_written(&controlling.session, (size_t)count);
}

static int wait_ms(void)
{
	int64_t left_ns = iec104_controlling_deadline(&controlling) - clock_ns(CLOCK_MONOTONIC);

	return left_ns <= 0 ? 0 : (int)(left_ns / NS_PER_MS + 1);
}

static void run(int connection)
{
	iec104_controlling_run(&controlling, moment());
	transmit(connection);
	if (controlling.session.started && !told_started)
		printf("{\"started\": true}\n");
	told_started = controlling.session.started;
	fflush(stdout);
}

static void serve(int connection)
{
	struct pollfd waits[] = {{.fd = connection, .events = POLLIN},
				 {.fd = STDIN_FILENO, .events = POLLIN}};

	iec104_session_start(&controlling.session, moment().monotonic_ns);
	for (run(connection); controlling.session.closing == IEC104_OPEN; run(connection)) {
		if (poll(waits, 2, wait_ms()) < 0 && errno != EINTR)
			return;
		if (waits[0].revents != 0)
			receive(connection);
		if (waits[1].revents != 0 && !take_line())
			return;
	}
	iec104_controlling_run(&controlling, moment());
	printf("{\"closed\": \"%s\", \"unexpected\": %" PRIu32 ", \"unknown_types\": %" PRIu32 "}\n",
	       iec104_closing_text(controlling.session.closing), controlling.unexpected,
	       controlling.unknown_types);
}

int main(int argc, char **argv)
{
	struct sockaddr_in server = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
	int connection = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);

	if (argc != 4)
		return 2;
	server.sin_port = htons((uint16_t)strtoul(argv[1], NULL, 10));
	settings.confirmation_ns = strtoll(argv[2], NULL, 10) * NS_PER_MS;
	settings.termination_ns = strtoll(argv[3], NULL, 10) * NS_PER_MS;
	if (connection < 0 || connect(connection, (const struct sockaddr *)&server, sizeof(server)) < 0) {
		perror("127.0.0.1");
		return 1;
	}
	iec104_controlling_open(&controlling, &settings, &listener, &memory, moment());
	serve(connection);
	close(connection);
	return 0;
}
