/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "control.h"

#include <errno.h>
#include <jansson.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "trace.h"

#define CLIENTS_MAX    8
#define COMMAND_SIZE   2048
#define WORDS_MAX      386 /* of what is said at once: a burst of a GPS receiver */
#define SET_VALUES_MAX 32
#define OUTPUT_SIZE    (8 * 1024 * 1024) /* what a client may leave unread before it is put out */
#define DELAY_MAX_MS   60000
#define LIMIT_MAX      2000 /* bits that a read may have */
#define COUNT_MAX      1000000

struct client {
	struct loop_source source; /* fd -1: free */
	enum trace_wish traced;
	size_t input_size;
	size_t output_size;
	char input[COMMAND_SIZE];
	char output[OUTPUT_SIZE];
};

static struct plant *plant;
static struct loop_source listener;
static struct client clients[CLIENTS_MAX];

/* ---- clients ----------------------------------------------------------------------------- */

static void trace_to_clients(const char *line, size_t size, bool writes);

static void listen_if_wanted(void)
{
	enum trace_wish most = TRACE_NOTHING;

	for (int i = 0; i < CLIENTS_MAX; i++)
		if (clients[i].source.fd >= 0 && clients[i].traced > most)
			most = clients[i].traced;
	trace_listen(trace_to_clients, most);
}

static void put_out(struct client *client)
{
	close(client->source.fd);
	client->source.fd = -1;
	listen_if_wanted();
}

static void flush(struct client *client)
{
	const ssize_t sent =
	    send(client->source.fd, client->output, client->output_size, MSG_DONTWAIT | MSG_NOSIGNAL);

	if (sent < 0 && errno != EAGAIN && errno != EINTR) {
		put_out(client);
		return;
	}
	if (sent > 0) {
		client->output_size -= (size_t)sent;
		memmove(client->output, client->output + sent, client->output_size);
	}
	loop_change(&client->source, client->output_size ? EPOLLIN | EPOLLOUT : EPOLLIN);
}

static void put(struct client *client, const char *text, size_t size)
{
	if (client->source.fd < 0)
		return;
	if (size > OUTPUT_SIZE - client->output_size) {
		put_out(client);
		return;
	}
	memcpy(client->output + client->output_size, text, size);
	client->output_size += size;
	flush(client);
}

static void trace_to_clients(const char *line, size_t size, bool writes)
{
	const enum trace_wish least = writes ? TRACE_WRITES : TRACE_ALL;

	for (int i = 0; i < CLIENTS_MAX; i++)
		if (clients[i].source.fd >= 0 && clients[i].traced >= least)
			put(&clients[i], line, size);
}

static void answer(struct client *client, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void answer(struct client *client, const char *format, ...)
{
	char text[COMMAND_SIZE + 256];
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(text, sizeof text - 1, format, arguments);
	va_end(arguments);
	strcat(text, "\n");
	put(client, text, strlen(text));
}

/* ---- commands ---------------------------------------------------------------------------- */

struct command {
	const char *name;
	int words_min, words_max; /* name included */
	void (*run)(struct client *client, const struct command *command, int count, char **words);
	const char *usage;
};

static void refuse_usage(struct client *client, const struct command *command)
{
	answer(client, "error usage: %s", command->usage);
}

static struct slave *named_slave(struct client *client, const char *name)
{
	struct slave *slave = plant_slave(plant, name);

	if (!slave)
		answer(client, "error no slave \"%s\" on an active port, expected port.unit as 3.67", name);
	return slave;
}

static bool named_cell(struct client *client, char **words, struct slave **slave, enum slave_table *table,
		       long *address)
{
	*slave = named_slave(client, words[1]);
	if (!*slave)
		return false;
	*table = slave_table_named(words[2]);
	if (*table == SLAVE_TABLES) {
		answer(client,
		       "error unknown table \"%s\", expected coils, discrete_inputs, input_registers or "
		       "holding_registers",
		       words[2]);
		return false;
	}
	if (!plant_number(words[3], 0, SLAVE_TABLE_CELLS - 1, address) ||
	    !slave_exists(*slave, *table, *address)) {
		answer(client, "error slave %s has no address \"%s\" in %s", words[1], words[3], words[2]);
		return false;
	}
	return true;
}

static void get(struct client *client, const struct command *command, int count, char **words)
{
	struct slave *slave;
	enum slave_table table;
	long address;

	(void)command;
	(void)count;
	if (named_cell(client, words, &slave, &table, &address))
		answer(client, "ok %u", slave->table[table].value[address]);
}

/* Checks all values before it writes the first: two registers of one value change together or not at all. */
static void set(struct client *client, const struct command *command, int count, char **words)
{
	struct slave *slave;
	enum slave_table table;
	long address, values[SET_VALUES_MAX];

	(void)command;
	if (!named_cell(client, words, &slave, &table, &address))
		return;

	const bool bits = slave_table_has_bits(table);

	for (int i = 0; i < count - 4; i++) {
		if (!slave_exists(slave, table, address + i)) {
			answer(client, "error slave %s has no address %ld in %s", words[1], address + i,
			       words[2]);
			return;
		}
		if (!plant_number(words[4 + i], bits ? 0 : INT16_MIN, bits ? 1 : UINT16_MAX, &values[i])) {
			answer(client, "error \"%s\" is no value of %s, expected %s", words[4 + i], words[2],
			       bits ? "0 or 1" : "-32768 to 65535");
			return;
		}
	}
	for (int i = 0; i < count - 4; i++)
		slave_set(slave, table, address + i, values[i]);
	answer(client, "ok");
}

static const struct {
	const char *name; /* in the command; slave_fault_name else */
	enum slave_fault_kind kind;
	long min, max; /* of its argument; max 0: it has none */
} faults[] = {
    {"clear", SLAVE_HEALTHY, 0, 0},
    {"mute", SLAVE_MUTE, 0, 0},
    {"delay", SLAVE_DELAY, 0, DELAY_MAX_MS},
    {"late", SLAVE_LATE, 0, DELAY_MAX_MS},
    {"deaf", SLAVE_DEAF, 0, DELAY_MAX_MS},
    {"corrupt", SLAVE_CORRUPT, 0, 0},
    {"exception", SLAVE_EXCEPTION, 1, 255},
    {"echo", SLAVE_ECHO, 0, 0},
    {"noise", SLAVE_NOISE, 1, LINE_NOISE_MAX},
    {"wrong-unit", SLAVE_WRONG_UNIT, 0, 0},
    {"truncate", SLAVE_TRUNCATE, 0, 0},
    {"limit", SLAVE_LIMIT, 1, LIMIT_MAX},
    {"wrong-function", SLAVE_WRONG_FUNCTION, 0, 0},
    {"wrong-length", SLAVE_WRONG_LENGTH, 0, 0},
    {"wrong-echo", SLAVE_WRONG_ECHO, 0, 0},
    {"override", SLAVE_OVERRIDE, 0, UINT16_MAX},
};

/* "count N" at the end. Returns how many words stand before it, or -1 when N is no count. */
static int take_count(int count, char **words, uint32_t *requests)
{
	long number = 0;

	if (count >= 5 && strcmp(words[count - 2], "count") == 0) {
		if (!plant_number(words[count - 1], 1, COUNT_MAX, &number))
			return -1;
		count -= 2;
	}
	*requests = (uint32_t)number;
	return count;
}

/* words: fault, slave, kind, argument, function code. */
static bool parse_fault(int count, char **words, struct slave_fault *fault)
{
	const size_t kinds = sizeof faults / sizeof *faults;
	size_t i = 0;
	long argument = 0, function = 0;

	while (i < kinds && strcmp(faults[i].name, words[2]) != 0)
		i++;
	if (i == kinds)
		return false;

	const int words_min = faults[i].max ? 4 : 3;
	const int words_max = words_min + (faults[i].kind == SLAVE_EXCEPTION);

	if (count < words_min || count > words_max ||
	    (words_min == 4 && !plant_number(words[3], faults[i].min, faults[i].max, &argument)) ||
	    (count == 5 && !plant_number(words[4], 1, 127, &function)))
		return false;
	fault->kind = faults[i].kind;
	fault->argument = (uint32_t)argument;
	fault->function = (uint8_t)function;
	return true;
}

static void set_fault(struct client *client, const struct command *command, int count, char **words)
{
	struct slave *slave = named_slave(client, words[1]);
	struct slave_fault fault;

	if (!slave)
		return;
	count = take_count(count, words, &fault.remaining);
	if (count < 0 || !parse_fault(count, words, &fault)) {
		refuse_usage(client, command);
		return;
	}
	slave->fault = fault;
	answer(client, "ok");
}

static struct line *named_line(struct client *client, const char *name)
{
	struct line *line = plant_line(plant, name);

	if (!line)
		answer(client, "error no active port \"%s\"", name);
	return line;
}

static struct line *named_serial_line(struct client *client, const char *name)
{
	struct line *line = named_line(client, name);

	if (!line || !line->tcp.is_one)
		return line;
	answer(client, "error port %s is no serial line", name);
	return NULL;
}

static void set_plugged(struct client *client, const struct command *command, int count, char **words)
{
	struct line *line = named_line(client, words[1]);

	(void)count;
	if (!line)
		return;
	line_set_plugged(line, strcmp(command->name, "plug") == 0);
	answer(client, "ok");
}

static void set_jammed(struct client *client, const struct command *command, int count, char **words)
{
	struct line *line = named_serial_line(client, words[1]);

	(void)count;
	if (!line)
		return;
	line_set_jammed(line, strcmp(command->name, "jam") == 0, loop_now_ns());
	answer(client, "ok");
}

static void say(struct client *client, const struct command *command, int count, char **words)
{
	struct line *line = named_serial_line(client, words[1]);
	uint8_t bytes[WORDS_MAX] = {0};
	long octet;

	if (!line)
		return;
	for (int i = 2; i < count; i++) {
		if (!plant_number(words[i], 0, UINT8_MAX, &octet)) {
			refuse_usage(client, command);
			return;
		}
		bytes[i - 2] = (uint8_t)octet;
	}
	line_say(line, bytes, (size_t)count - 2, loop_now_ns());
	answer(client, "ok");
}

static void trace(struct client *client, const struct command *command, int count, char **words)
{
	static const char *const wishes[] = {
	    [TRACE_NOTHING] = "off", [TRACE_WRITES] = "writes", [TRACE_ALL] = "on"};
	enum trace_wish wish = TRACE_NOTHING;

	(void)count;
	while (wish <= TRACE_ALL && strcmp(words[1], wishes[wish]) != 0)
		wish++;
	if (wish > TRACE_ALL) {
		refuse_usage(client, command);
		return;
	}
	client->traced = wish;
	listen_if_wanted();
	answer(client, "ok");
}

/* Of a mood that has one: 0 is none. */
static long mood_argument(int count, char **words, const char *mood, long max)
{
	long argument = 0;

	if (count != 4 || strcmp(words[2], mood) != 0 || !plant_number(words[3], 1, max, &argument))
		return 0;
	return argument;
}

/* words: session, port, mood, argument. */
static bool set_mood(struct line *line, int count, char **words)
{
	const long idle_ms = mood_argument(count, words, "idle", DELAY_MAX_MS);
	const long tears = mood_argument(count, words, "tear", COUNT_MAX);
	const bool closes = count == 3 && strcmp(words[2], "close") == 0;
	const bool clear = count == 3 && strcmp(words[2], "clear") == 0;

	if (count == 3 && strcmp(words[2], "hang") == 0) {
		tcp_hang(line);
		return true;
	}
	if (!idle_ms && !tears && !closes && !clear)
		return false;
	line->tcp.closes = closes;
	line->tcp.tears = (uint32_t)tears;
	line->tcp.idle_ns = idle_ms * INT64_C(1000000);
	return true;
}

static void session(struct client *client, const struct command *command, int count, char **words)
{
	struct line *line = named_line(client, words[1]);

	if (!line)
		return;
	if (!line->tcp.is_one)
		answer(client, "error port %s has no sessions: it is a serial line", words[1]);
	else if (!set_mood(line, count, words))
		refuse_usage(client, command);
	else
		answer(client, "ok");
}

static json_t *slave_report(const struct slave *slave)
{
	return json_pack("{s:I, s:I, s:I, s:I}", "requests", (json_int_t)slave->stats.requests, "answers",
			 (json_int_t)slave->stats.answers, "exceptions", (json_int_t)slave->stats.exceptions,
			 "writes", (json_int_t)slave->stats.writes);
}

static json_t *line_report(const struct line *line)
{
	json_t *slaves = json_object();
	json_int_t writes = 0;

	for (unsigned unit = 0; unit <= SLAVE_UNIT_MAX; unit++) {
		char name[8];

		if (!line->slaves[unit])
			continue;
		snprintf(name, sizeof name, "%u", unit);
		json_object_set_new(slaves, name, slave_report(line->slaves[unit]));
		writes += line->slaves[unit]->stats.writes;
	}
	return json_pack("{s:b, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:o}", "plugged", !line->unplugged,
			 "requests", (json_int_t)line->stats.requests, "foreign",
			 (json_int_t)line->stats.foreign, "answers", (json_int_t)line->stats.answers,
			 "writes", writes, "crc_errors", (json_int_t)line->stats.crc_errors, "collisions",
			 (json_int_t)line->stats.collisions, "dropped", (json_int_t)line->stats.dropped,
			 "busy_ns", (json_int_t)line->stats.busy_ns, "slaves", slaves);
}

static void report(struct client *client, const struct command *command, int count, char **words)
{
	json_t *lines = json_object();

	(void)command;
	(void)count;
	(void)words;
	for (size_t i = 0; i < plant->line_count; i++) {
		char name[8];

		snprintf(name, sizeof name, "%u", plant->lines[i].port);
		json_object_set_new(lines, name, line_report(&plant->lines[i]));
	}

	char *text = json_dumps(lines, JSON_COMPACT | JSON_PRESERVE_ORDER);

	json_decref(lines);
	if (!text) {
		answer(client, "error out of memory");
		return;
	}
	put(client, "ok ", 3);
	put(client, text, strlen(text));
	put(client, "\n", 1);
	free(text);
}

static void quit(struct client *client, const struct command *command, int count, char **words)
{
	(void)command;
	(void)count;
	(void)words;
	answer(client, "ok");
	loop_stop();
}

#define COMMANDS "set, get, fault, unplug, plug, jam, unjam, say, session, stats, trace or quit"

static const struct command commands[] = {
    {"set", 5, 4 + SET_VALUES_MAX, set, "set PORT.UNIT TABLE ADDRESS VALUE..."},
    {"get", 4, 4, get, "get PORT.UNIT TABLE ADDRESS"},
    {"fault", 3, 7, set_fault,
     "fault PORT.UNIT clear | mute | corrupt | echo | wrong-unit | wrong-function | wrong-length | "
     "wrong-echo | truncate | delay MS | late MS | deaf MS (0 to 60000) | override VALUE (0 to 65535) | "
     "noise "
     "BYTES (1 to 256) | limit N (1 to 2000) | exception CODE [FUNCTION] (1 to 255, 1 to 127), each: [count "
     "N] (1 to 1000000)"},
    {"unplug", 2, 2, set_plugged, "unplug PORT"},
    {"plug", 2, 2, set_plugged, "plug PORT"},
    {"jam", 2, 2, set_jammed, "jam PORT"},
    {"unjam", 2, 2, set_jammed, "unjam PORT"},
    {"say", 3, WORDS_MAX, say, "say PORT OCTET... (0 to 255)"},
    {"session", 3, 4, session,
     "session PORT hang | close | idle MS (1 to 60000) | tear N (1 to 1000000) | clear"},
    {"stats", 1, 1, report, "stats"},
    {"trace", 2, 2, trace, "trace on|writes|off"},
    {"quit", 1, 1, quit, "quit"},
};

static void run_command(struct client *client, char *text)
{
	char *words[WORDS_MAX], *rest = NULL;
	int count = 0;

	for (char *word = strtok_r(text, " \t\r", &rest); word && count < WORDS_MAX;
	     word = strtok_r(NULL, " \t\r", &rest))
		words[count++] = word;
	if (count == 0) {
		answer(client, "error empty command, expected " COMMANDS);
		return;
	}
	for (size_t i = 0; i < sizeof commands / sizeof *commands; i++) {
		if (strcmp(commands[i].name, words[0]) != 0)
			continue;
		if (count < commands[i].words_min || count > commands[i].words_max)
			refuse_usage(client, &commands[i]);
		else
			commands[i].run(client, &commands[i], count, words);
		return;
	}
	answer(client, "error unknown command \"%s\", expected " COMMANDS, words[0]);
}

/* ---- the socket -------------------------------------------------------------------------- */

static void run_complete_lines(struct client *client)
{
	char *end;

	while (client->source.fd >= 0 && (end = memchr(client->input, '\n', client->input_size))) {
		const size_t size = (size_t)(end - client->input) + 1;

		*end = '\0';
		run_command(client, client->input);
		client->input_size -= size;
		memmove(client->input, client->input + size, client->input_size);
	}
}

static void client_ready(void *owner, uint32_t events)
{
	struct client *client = owner;

	if (client->source.fd < 0) /* put out earlier in this round of events */
		return;
	if (events & EPOLLOUT)
		flush(client);
	if (!(events & (EPOLLIN | EPOLLHUP | EPOLLERR)) || client->source.fd < 0)
		return;

	const ssize_t size =
	    recv(client->source.fd, client->input + client->input_size, COMMAND_SIZE - client->input_size, 0);

	if (size == 0 || (size < 0 && errno != EAGAIN && errno != EINTR)) {
		put_out(client);
		return;
	}
	if (size < 0)
		return;
	client->input_size += (size_t)size;
	run_complete_lines(client);
	if (client->input_size == COMMAND_SIZE) {
		answer(client, "error a command has at most %d characters", COMMAND_SIZE - 1);
		put_out(client);
	}
}

static void listener_ready(void *owner, uint32_t events)
{
	static const char full[] = "error too many clients\n";
	const int fd = accept4(listener.fd, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);

	(void)owner;
	(void)events;
	if (fd < 0)
		return;
	for (int i = 0; i < CLIENTS_MAX; i++) {
		struct client *client = &clients[i];

		if (client->source.fd >= 0)
			continue;
		client->source.fd = fd;
		client->traced = TRACE_NOTHING;
		client->input_size = client->output_size = 0;
		if (loop_add(&client->source, EPOLLIN))
			put_out(client);
		return;
	}
	(void)!send(fd, full, sizeof full - 1, MSG_DONTWAIT | MSG_NOSIGNAL);
	close(fd);
}

int control_open(struct plant *simulated, const char *path)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};

	plant = simulated;
	for (int i = 0; i < CLIENTS_MAX; i++)
		clients[i].source =
		    (struct loop_source){.fd = -1, .ready = client_ready, .owner = &clients[i]};
	if (strlen(path) >= sizeof address.sun_path) {
		errno = ENAMETOOLONG;
		return -1;
	}
	snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
	listener = (struct loop_source){
	    .fd = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0),
	    .ready = listener_ready,
	};
	if (listener.fd < 0 || bind(listener.fd, (const struct sockaddr *)&address, sizeof address) ||
	    listen(listener.fd, CLIENTS_MAX))
		return -1;
	return loop_add(&listener, EPOLLIN);
}
