/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A client of IEC 61850 by libiec61850, without its threads: mms_client PORT BLOCK... takes the reports of these control blocks, and
 * prints a line of JSON for each member of each. `at` is plant time. A buffered block goes on behind the last entry that came.
 */
#include <poll.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "libiec61850.h"

#define BLOCKS_MAX 128
#define RETRY_MS   1000
#define IDLE_MS    1000
#define ANSWER_NS  (10 * NS_PER_S)
#define FDS_MAX    64

enum { CLOSED, CONNECTING, CONNECTED }; /* IedConnectionState */
enum { ENABLED = 1 << 1, OPTIONS = 1 << 5, TRIGGERS = 1 << 8, GENERAL = 1 << 10, ENTRY = 1 << 12 };
enum { WANTED_OPTIONS = 1 | 4 | 16 | 32 | 64 }; /* number, reason, reference, overflow, entry */
enum { WANTED_TRIGGERS = 1 | 2 | 16 };          /* data, quality, general interrogation */

typedef void (*got_block)(uint32_t request, void *context, int error, void *block);
typedef void (*done)(uint32_t request, void *context, int error);
typedef void (*reported)(void *context, void *report);

void *IedConnection_createEx(void *tls, bool threads);
void IedConnection_destroy(void *connection);
void IedConnection_connectAsync(void *connection, int *error, const char *host, int port);
bool IedConnection_tick(void *connection);
int IedConnection_getState(void *connection);
void IedConnection_installReportHandler(void *connection, const char *block, const char *id, reported handler,
					void *context);
uint32_t IedConnection_getRCBValuesAsync(void *connection, int *error, const char *name, void *block,
					 got_block handler, void *context);
uint32_t IedConnection_setRCBValuesAsync(void *connection, int *error, void *block, uint32_t mask,
					 bool single, done handler, void *context);
void ClientReportControlBlock_setTrgOps(void *block, int triggers);
void ClientReportControlBlock_setOptFlds(void *block, int options);
void ClientReportControlBlock_setRptEna(void *block, bool on);
void ClientReportControlBlock_setGI(void *block, bool on);
void ClientReportControlBlock_setEntryId(void *block, void *entry);
const char *ClientReportControlBlock_getRptId(void *block);
void *ClientReport_getDataSetValues(void *report);
int ClientReport_getReasonForInclusion(void *report, int member);
const char *ClientReport_getDataReference(void *report, int member);
void *ClientReport_getEntryId(void *report);
bool ClientReport_getBufOvfl(void *report);
uint16_t ClientReport_getSeqNum(void *report);
float MmsValue_toFloat(void *value);
uint64_t MmsValue_getUtcTimeInMs(void *value);
void *MmsValue_clone(void *value);
void MmsValue_delete(void *value);

static struct block {
	const char *name;
	void *values, *entry;
	bool buffered;
} blocks[BLOCKS_MAX];
static size_t block_count;
static void *connection;
static bool answered;
static int answer_error;

/* ---- what is told ------------------------------------------------------------------------ */

static void tell_value(void *value);

static void tell_elements(void *value)
{
	printf("[");
	for (int i = 0; i < MmsValue_getArraySize(value); i++) {
		printf("%s", i ? ", " : "");
		tell_value(MmsValue_getElement(value, i));
	}
	printf("]");
}

static void tell_value(void *value)
{
	switch (value ? MmsValue_getType(value) : -1) {
	case ARRAY:
	case STRUCTURE:
		tell_elements(value);
		break;
	case BOOLEAN:
		printf("%s", MmsValue_getBoolean(value) ? "true" : "false");
		break;
	case BITS:
		printf("%u", MmsValue_getBitStringAsInteger(value));
		break;
	case INTEGER:
	case UNSIGNED:
		printf("%lld", (long long)MmsValue_toInt64(value));
		break;
	case FLOATING:
		printf("%.9g", (double)MmsValue_toFloat(value));
		break;
	case UTC_TIME:
		printf("%llu", (unsigned long long)MmsValue_getUtcTimeInMs(value));
		break;
	default:
		printf("null");
	}
}

static void take_entry(struct block *block, void *report)
{
	void *entry = block->buffered ? ClientReport_getEntryId(report) : NULL;

	if (!entry)
		return;
	if (block->entry)
		MmsValue_delete(block->entry);
	block->entry = MmsValue_clone(entry);
}

static void take_report(void *context, void *report)
{
	struct block *block = context;
	void *values = ClientReport_getDataSetValues(report);

	for (int i = 0; values && i < MmsValue_getArraySize(values); i++) {
		const int reason = ClientReport_getReasonForInclusion(report, i);

		if (reason == 0)
			continue;
		printf("{\"at\": %lld, \"block\": \"%s\", \"number\": %u, \"lost\": %s, \"member\": \"%s\", "
		       "\"reason\": %d, \"value\": ",
		       now_ns(), block->name, ClientReport_getSeqNum(report),
		       ClientReport_getBufOvfl(report) ? "true" : "false",
		       ClientReport_getDataReference(report, i), reason);
		tell_value(MmsValue_getElement(values, i));
		printf("}\n");
	}
	fflush(stdout);
	take_entry(block, report);
}

static void tell_state(const char *state)
{
	printf("{\"at\": %lld, \"state\": \"%s\"}\n", now_ns(), state);
	fflush(stdout);
}

/* ---- waiting ----------------------------------------------------------------------------- */

/* The library's own, as it says nothing of it. */
static int socket_of_connection(void)
{
	int type;
	socklen_t size = sizeof(type);

	for (int fd = FDS_MAX; fd > STDERR_FILENO; fd--)
		if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0)
			return fd;
	return -1;
}

/* Until something has come, or most_ms are over: a tick by itself waits for ten milliseconds. False: the connection is lost. */
static bool turn(int most_ms)
{
	struct pollfd waits = {.fd = socket_of_connection(), .events = POLLIN};

	if (IedConnection_getState(connection) == CONNECTED)
		poll(&waits, 1, most_ms);
	IedConnection_tick(connection);
	return IedConnection_getState(connection) != CLOSED;
}

static bool await(int error)
{
	const long long until_ns = now_ns() + ANSWER_NS;

	while (error == 0 && !answered && now_ns() < until_ns)
		if (!turn(IDLE_MS))
			return false;
	return error == 0 && answered && answer_error == 0;
}

static void note_done(uint32_t request, void *context, int error)
{
	(void)request, (void)context;
	answered = true;
	answer_error = error;
}

static void note_values(uint32_t request, void *context, int error, void *values)
{
	struct block *block = context;

	block->values = values;
	note_done(request, NULL, error);
}

/* ---- control blocks ---------------------------------------------------------------------- */

static bool set_block(struct block *block, uint32_t mask)
{
	int error = 0;

	answered = false;
	IedConnection_setRCBValuesAsync(connection, &error, block->values, mask, false, note_done, NULL);
	return await(error);
}

/* Behind the last entry that came. One that is not there any more is refused: then from the oldest on. */
static bool go_on(struct block *block)
{
	if (!block->buffered || !block->entry)
		return true;
	ClientReportControlBlock_setEntryId(block->values, block->entry);
	if (set_block(block, ENTRY))
		return true;
	MmsValue_delete(block->entry);
	block->entry = NULL;
	tell_state("refused");
	return IedConnection_getState(connection) == CONNECTED;
}

static bool enable(struct block *block)
{
	int error = 0;

	answered = false;
	block->values = NULL;
	IedConnection_getRCBValuesAsync(connection, &error, block->name, NULL, note_values, block);
	if (!await(error) || !block->values)
		return false;
	IedConnection_installReportHandler(
	    connection, block->name, ClientReportControlBlock_getRptId(block->values), take_report, block);
	ClientReportControlBlock_setTrgOps(block->values, WANTED_TRIGGERS);
	ClientReportControlBlock_setOptFlds(block->values, WANTED_OPTIONS);
	if (!set_block(block, TRIGGERS | OPTIONS) || !go_on(block))
		return false;
	ClientReportControlBlock_setRptEna(block->values, true);
	if (!set_block(block, ENABLED))
		return false;
	ClientReportControlBlock_setGI(block->values, true);
	return set_block(block, GENERAL);
}

static bool begin(int port)
{
	const long long until_ns = now_ns() + ANSWER_NS;
	int error = 0;

	connection = IedConnection_createEx(NULL, false);
	IedConnection_connectAsync(connection, &error, "127.0.0.1", port);
	while (error == 0 && IedConnection_getState(connection) == CONNECTING && now_ns() < until_ns)
		IedConnection_tick(connection);
	if (error != 0 || IedConnection_getState(connection) != CONNECTED)
		return false;
	for (size_t i = 0; i < block_count; i++)
		if (!enable(&blocks[i]))
			return false;
	return true;
}

int main(int count, char **words)
{
	for (int i = 2; i < count && block_count < BLOCKS_MAX; i++)
		blocks[block_count++] =
		    (struct block){.name = words[i], .buffered = strstr(words[i], ".BR.")};
	if (block_count == 0) {
		fputs("usage: mms_client PORT BLOCK...\n", stderr);
		return 2;
	}
	while (true) {
		if (begin(atoi(words[1]))) {
			tell_state("up");
			while (turn(IDLE_MS))
				continue;
			tell_state("down");
		}
		IedConnection_destroy(connection);
		nanosleep(&(struct timespec){.tv_nsec = RETRY_MS * 1000000L - 1}, NULL);
	}
}
