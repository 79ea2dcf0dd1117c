/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The same station with lib60870 in C, as a program that links it would have it: arguments PORT CA PLACES, an ADDRESS or
 * "-", then its points as single:FIRST:COUNT and scaled:FIRST:COUNT. PLACES is the room for events, in ASDUs of full size, of
 * each connection; with an ADDRESS there are two redundancy groups, this address and all others. A line "RATE" from
 * standard input makes so many events in a second, EVENTS_MAX at most: they count the first scaled values upwards, one after
 * the other. As many as are due go into one ASDU, as ours do.
 */
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "cs104_slave.h"
#include "hal_time.h"

#define EVENTS_MAX  100000
#define PERIOD_NS   1000000L /* between two looks at the clock */
#define ANSWERS_MAX 128      /* ASDUs that wait for room in k: an interrogation has 51 */
#define RANGES_MAX  8
#define SINGLES     "single:"
#define SCALED      "scaled:"

struct range {
	bool scaled;
	int first, count;
	_Atomic int16_t *values;
};

static CS104_Slave slave;
static CS101_AppLayerParameters layer;
static struct range ranges[RANGES_MAX];
static int range_count, ca;
static unsigned runs; /* each begins at another register, as ours */

/* ---- answers ----------------------------------------------------------------------------- */

static InformationObject object_of(const struct range *range, int index, InformationObject place)
{
	int value = atomic_load_explicit(&range->values[index], memory_order_relaxed);
	int ioa = range->first + index;

	if (range->scaled)
		return (InformationObject)MeasuredValueScaled_create((MeasuredValueScaled)place, ioa, value,
								     IEC60870_QUALITY_GOOD);
	return (InformationObject)SinglePointInformation_create((SinglePointInformation)place, ioa,
								value != 0, IEC60870_QUALITY_GOOD);
}

static void send_range(IMasterConnection connection, const struct range *range, int originator)
{
	sCS101_StaticASDU memory;
	InformationObject object = NULL;
	CS101_ASDU asdu = CS101_ASDU_initializeStatic(&memory, layer, true, CS101_COT_INTERROGATED_BY_STATION,
						      originator, ca, false, false);

	for (int i = 0; i < range->count; i++) {
		object = object_of(range, i, object);
		if (CS101_ASDU_addInformationObject(asdu, object))
			continue;
		IMasterConnection_sendASDU(connection, asdu);
		CS101_ASDU_removeAllElements(asdu);
		CS101_ASDU_addInformationObject(asdu, object);
	}
	IMasterConnection_sendASDU(connection, asdu);
	InformationObject_destroy(object);
}

static bool interrogate(void *context, IMasterConnection connection, CS101_ASDU asdu, uint8_t qualifier)
{
	(void)context;
	if (CS101_ASDU_getCA(asdu) != ca || qualifier != IEC60870_QOI_STATION) {
		IMasterConnection_sendACT_CON(connection, asdu, true);
		return true;
	}
	IMasterConnection_sendACT_CON(connection, asdu, false);
	for (int i = 0; i < range_count; i++)
		send_range(connection, &ranges[i], CS101_ASDU_getOA(asdu));
	IMasterConnection_sendACT_TERM(connection, asdu);
	return true;
}

static bool answer_read(void *context, IMasterConnection connection, CS101_ASDU asdu, int ioa)
{
	sCS101_StaticASDU memory;
	CS101_ASDU answer = CS101_ASDU_initializeStatic(&memory, layer, false, CS101_COT_REQUEST,
							CS101_ASDU_getOA(asdu), ca, false, false);

	(void)context;
	for (int i = 0; i < range_count; i++) {
		InformationObject object;

		if (ioa < ranges[i].first || ioa >= ranges[i].first + ranges[i].count)
			continue;
		object = object_of(&ranges[i], ioa - ranges[i].first, NULL);
		CS101_ASDU_addInformationObject(answer, object);
		InformationObject_destroy(object);
		IMasterConnection_sendASDU(connection, answer);
		return true;
	}
	return false;
}

/* ---- events ------------------------------------------------------------------------------ */

static int64_t now_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return now.tv_sec * 1000000000LL + now.tv_nsec;
}

/* Events number made up to due, all of this moment. */
static void put_events(struct range *range, int made, int due)
{
	sCS101_StaticASDU memory;
	struct sCP56Time2a time;
	InformationObject object = NULL;
	CS101_ASDU asdu =
	    CS101_ASDU_initializeStatic(&memory, layer, false, CS101_COT_SPONTANEOUS, 0, ca, false, false);

	CP56Time2a_createFromMsTimestamp(&time, Hal_getTimeInMs());
	for (; made < due; made++) {
		int index = (int)(((unsigned)made + runs) % (unsigned)range->count);
		int16_t value = (int16_t)(made + 1);

		atomic_store_explicit(&range->values[index], value, memory_order_relaxed);
		object = (InformationObject)MeasuredValueScaledWithCP56Time2a_create(
		    (MeasuredValueScaledWithCP56Time2a)object, range->first + index, value,
		    IEC60870_QUALITY_GOOD, &time);
		if (CS101_ASDU_addInformationObject(asdu, object))
			continue;
		CS104_Slave_enqueueASDU(slave, asdu);
		CS101_ASDU_removeAllElements(asdu);
		CS101_ASDU_addInformationObject(asdu, object);
	}
	CS104_Slave_enqueueASDU(slave, asdu);
	InformationObject_destroy(object);
}

static void make_events(struct range *range, int rate)
{
	int wanted = rate < EVENTS_MAX ? rate : EVENTS_MAX, made = 0;
	int64_t begun_ns = now_ns();

	for (runs++; made < wanted; nanosleep(&(struct timespec){.tv_nsec = PERIOD_NS}, NULL)) {
		int64_t due = (now_ns() - begun_ns) * rate / 1000000000LL;

		if (due > wanted)
			due = wanted;
		if (due > made)
			put_events(range, made, (int)due);
		made = (int)due;
	}
}

/* ---- start ------------------------------------------------------------------------------- */

/* False: what the text says is no range. */
static bool add_range(const char *text)
{
	struct range *range = &ranges[range_count];

	range->scaled = strncmp(text, SCALED, strlen(SCALED)) == 0;
	if (range_count == RANGES_MAX || (!range->scaled && strncmp(text, SINGLES, strlen(SINGLES)) != 0) ||
	    sscanf(strchr(text, ':'), ":%d:%d", &range->first, &range->count) != 2 || range->count < 1)
		return false;
	range->values = calloc((size_t)range->count, sizeof(*range->values));
	range_count++;
	return range->values != NULL;
}

static void set_groups(const char *address)
{
	CS104_RedundancyGroup group = CS104_RedundancyGroup_create("away");

	CS104_Slave_setServerMode(slave, CS104_MODE_MULTIPLE_REDUNDANCY_GROUPS);
	CS104_RedundancyGroup_addAllowedClient(group, address);
	CS104_Slave_addRedundancyGroup(slave, group);
	CS104_Slave_addRedundancyGroup(slave, CS104_RedundancyGroup_create("others"));
}

static struct range *range_of_events(void)
{
	for (int i = 0; i < range_count; i++)
		if (ranges[i].scaled)
			return &ranges[i];
	return NULL;
}

int main(int argc, char **argv)
{
	char line[32];

	if (argc < 6)
		return 2;
	for (int i = 5; i < argc; i++)
		if (!add_range(argv[i]))
			return 2;
	if (range_of_events() == NULL)
		return 2;
	ca = atoi(argv[2]);
	slave = CS104_Slave_create(atoi(argv[3]), ANSWERS_MAX);
	layer = CS104_Slave_getAppLayerParameters(slave);
	CS104_Slave_setLocalAddress(slave, "127.0.0.1");
	CS104_Slave_setLocalPort(slave, atoi(argv[1]));
	CS104_Slave_setMaxOpenConnections(slave, 16);
	if (strcmp(argv[4], "-") == 0)
		CS104_Slave_setServerMode(slave, CS104_MODE_CONNECTION_IS_REDUNDANCY_GROUP);
	else
		set_groups(argv[4]);
	CS104_Slave_setInterrogationHandler(slave, interrogate, NULL);
	CS104_Slave_setReadHandler(slave, answer_read, NULL);
	CS104_Slave_start(slave);
	if (!CS104_Slave_isRunning(slave))
		return 1;
	puts("ready");
	fflush(stdout);
	while (fgets(line, sizeof(line), stdin) != NULL)
		make_events(range_of_events(), atoi(line));
	CS104_Slave_destroy(slave);
	return 0;
}
