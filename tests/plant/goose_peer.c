/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A relay by libiec61850: it subscribes to what the gateway publishes, and publishes a count that goes up. It prints a line of JSON for
 * each state that comes and each that it sends; `at` is plant time.
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

#define NS_PER_MS 1000000LL
#define REPEAT_NS (NS_PER_S / 2)
#define LIVES_MS  2000 /* a message, after it was sent */
#define FDS_MAX   64
#define INTERFACE "plant0"

struct communication {
	uint8_t priority;
	uint16_t vlan, app_id;
	uint8_t destination[6];
};

typedef void (*listener)(void *subscriber, void *context);

void *GooseReceiver_create(void);
void GooseReceiver_setInterfaceId(void *receiver, const char *name);
void GooseReceiver_addSubscriber(void *receiver, void *subscriber);
void *GooseReceiver_startThreadless(void *receiver);
bool GooseReceiver_tick(void *receiver);
void *GooseSubscriber_create(char *block, void *values);
void GooseSubscriber_setDstMac(void *subscriber, uint8_t destination[6]);
void GooseSubscriber_setAppId(void *subscriber, uint16_t app_id);
void GooseSubscriber_setListener(void *subscriber, listener listener, void *context);
uint32_t GooseSubscriber_getStNum(void *subscriber);
uint32_t GooseSubscriber_getSqNum(void *subscriber);
bool GooseSubscriber_isValid(void *subscriber);
void *GooseSubscriber_getDataSetValues(void *subscriber);
void *GoosePublisher_create(struct communication *parameters, const char *interface);
void GoosePublisher_setGoCbRef(void *publisher, char *block);
void GoosePublisher_setDataSetRef(void *publisher, char *set);
void GoosePublisher_setConfRev(void *publisher, uint32_t revision);
void GoosePublisher_setTimeAllowedToLive(void *publisher, uint32_t ms);
uint64_t GoosePublisher_increaseStNum(void *publisher);
int GoosePublisher_publish(void *publisher, void *values);
void *LinkedList_create(void);
void LinkedList_add(void *list, void *value);
void *MmsValue_newIntegerFromInt32(int32_t value);
void MmsValue_setInt32(void *value, int32_t number);

static uint32_t last_state, last_number;

static long long number_of(void *value)
{
	switch (MmsValue_getType(value)) {
	case BOOLEAN:
		return MmsValue_getBoolean(value);
	case BITS:
		return MmsValue_getBitStringAsInteger(value);
	default:
		return MmsValue_toInt64(value);
	}
}

/* Repetitions are counted. */
static void take(void *subscriber, void *context)
{
	const uint32_t state = GooseSubscriber_getStNum(subscriber),
		       number = GooseSubscriber_getSqNum(subscriber);
	void *values = GooseSubscriber_getDataSetValues(subscriber);

	(void)context;
	if (!GooseSubscriber_isValid(subscriber) || (state == last_state && number > last_number)) {
		last_number = number;
		return;
	}
	last_state = state;
	last_number = number;
	printf("{\"at\": %lld, \"state\": %u, \"values\": [", now_ns(), state);
	for (int i = 0; i < MmsValue_getArraySize(values); i++)
		printf("%s%lld", i ? ", " : "", number_of(MmsValue_getElement(values, i)));
	printf("]}\n");
	fflush(stdout);
}

static void *subscribe(char *block)
{
	uint8_t destination[] = {0x01, 0x0c, 0xcd, 0x01, 0x00, 0x01};
	void *receiver = GooseReceiver_create(), *subscriber = GooseSubscriber_create(block, NULL);

	GooseSubscriber_setDstMac(subscriber, destination);
	GooseSubscriber_setAppId(subscriber, 1);
	GooseSubscriber_setListener(subscriber, take, NULL);
	GooseReceiver_setInterfaceId(receiver, INTERFACE);
	GooseReceiver_addSubscriber(receiver, subscriber);
	return GooseReceiver_startThreadless(receiver) ? receiver : NULL;
}

static void *publisher_of(char *block, char *set)
{
	struct communication parameters = {
	    .priority = 4, .app_id = 2, .destination = {0x01, 0x0c, 0xcd, 0x01, 0x00, 0x02}};
	void *publisher = GoosePublisher_create(&parameters, INTERFACE);

	GoosePublisher_setGoCbRef(publisher, block);
	GoosePublisher_setDataSetRef(publisher, set);
	GoosePublisher_setConfRev(publisher, 1);
	GoosePublisher_setTimeAllowedToLive(publisher, LIVES_MS);
	return publisher;
}

/* The receiver's, which was the first. */
static int socket_of_receiver(void)
{
	int type;
	socklen_t size = sizeof(type);

	for (int fd = STDERR_FILENO + 1; fd < FDS_MAX; fd++)
		if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0)
			return fd;
	return -1;
}

static void wait_until(int fd, void *receiver, long long until_ns)
{
	struct pollfd waits = {.fd = fd, .events = POLLIN};

	while (now_ns() < until_ns)
		if (poll(&waits, 1, (int)((until_ns - now_ns() + NS_PER_MS - 1) / NS_PER_MS)) > 0)
			while (GooseReceiver_tick(receiver))
				continue;
}

int main(int count, char **words)
{
	void *receiver, *publisher, *list, *value;
	long long due_ns = now_ns();
	int fd, change_every = 0;

	if (count != 5) {
		fputs("usage: goose_peer BLOCK OWN_BLOCK OWN_DATA_SET CHANGE_EVERY\n", stderr);
		return 2;
	}
	receiver = subscribe(words[1]);
	if (!receiver) {
		fputs("goose_peer: no socket on " INTERFACE "\n", stderr);
		return 1;
	}
	fd = socket_of_receiver();
	publisher = publisher_of(words[2], words[3]);
	list = LinkedList_create();
	value = MmsValue_newIntegerFromInt32(0);
	LinkedList_add(list, value);
	change_every = atoi(words[4]);
	for (int round = 0;; round++, due_ns += REPEAT_NS) {
		if (round % change_every == 0) {
			MmsValue_setInt32(value, round / change_every + 1);
			GoosePublisher_increaseStNum(publisher);
			printf("{\"at\": %lld, \"sent\": %d}\n", now_ns(), round / change_every + 1);
			fflush(stdout);
		}
		GoosePublisher_publish(publisher, list);
		wait_until(fd, receiver, due_ns + REPEAT_NS);
	}
}
