/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A server as a user of libiec61850 would write it, with the logical devices, data objects, data sets and buffered report control blocks of
 * ours: libiec61850_server PORT DEVICES STATES VALUES. The package pyiec61850-ng has the library without its headers. A line of standard
 * input is a rate: at that many events a second, for a second, measured values count upwards, one after the other.
 */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define EVENTS_MAX 100000
#define PERIOD_NS  1000000
#define NS_PER_S   1000000000LL
#define NS_PER_MS  1000000
#define VALUES_MAX 8192
#define CHANGES    3    /* TRG_OPT_DATA_CHANGED, TRG_OPT_QUALITY_CHANGED */
#define OPTIONS    0x67 /* sequence number, time stamp, reason, overflow, EntryID: what ours have at first */

void *IedModel_create(const char *name);
void *LogicalDevice_create(const char *name, void *model);
void *LogicalNode_create(const char *name, void *device);
void *CDC_ENS_create(const char *name, void *parent, uint32_t options);
void *CDC_LPL_create(const char *name, void *parent, uint32_t options);
void *CDC_DPL_create(const char *name, void *parent, uint32_t options);
void *CDC_SPS_create(const char *name, void *parent, uint32_t options);
void *CDC_MV_create(const char *name, void *parent, uint32_t options, bool integer);
void *DataSet_create(const char *name, void *node);
void *DataSetEntry_create(void *set, const char *variable, int index, const char *component);
void *ReportControlBlock_create(const char *name, void *node, const char *id, bool buffered, const char *set,
				uint32_t revision, uint8_t triggers, uint8_t options, uint32_t buffer_ms,
				uint32_t integrity_ms);
void *ModelNode_getChild(void *node, const char *name);
void *IedServer_create(void *model);
void IedServer_start(void *server, int port);
bool IedServer_isRunning(void *server);
void IedServer_lockDataModel(void *server);
void IedServer_unlockDataModel(void *server);
void IedServer_updateFloatAttributeValue(void *server, void *attribute, float value);
void IedServer_updateUTCTimeAttributeValue(void *server, void *attribute, uint64_t ms);

static struct {
	void *magnitude, *time;
} values[VALUES_MAX];
static unsigned value_count;

static void add_state(void *node, void *set, unsigned number)
{
	char name[16], variable[32];

	snprintf(name, sizeof(name), "Ind%u", number);
	snprintf(variable, sizeof(variable), "GGIO1$ST$%s", name);
	CDC_SPS_create(name, node, 0);
	DataSetEntry_create(set, variable, -1, NULL);
}

static void add_value(void *node, void *set, unsigned number)
{
	char name[16], variable[32];
	void *object;

	snprintf(name, sizeof(name), "AnIn%u", number);
	snprintf(variable, sizeof(variable), "GGIO1$MX$%s", name);
	object = CDC_MV_create(name, node, 0, false);
	DataSetEntry_create(set, variable, -1, NULL);
	values[value_count].magnitude = ModelNode_getChild(object, "mag.f");
	values[value_count].time = ModelNode_getChild(object, "t");
	value_count++;
}

static void add_device(void *model, unsigned number, unsigned states, unsigned measured)
{
	char name[16];
	void *device, *zero, *physical, *node, *status_set, *measured_set;

	snprintf(name, sizeof(name), "CA%u", number);
	device = LogicalDevice_create(name, model);
	zero = LogicalNode_create("LLN0", device);
	CDC_ENS_create("Mod", zero, 0);
	CDC_ENS_create("Beh", zero, 0);
	CDC_ENS_create("Health", zero, 0);
	CDC_LPL_create("NamPlt", zero, 0);
	physical = LogicalNode_create("LPHD1", device);
	CDC_DPL_create("PhyNam", physical, 0);
	CDC_ENS_create("PhyHealth", physical, 0);
	CDC_SPS_create("Proxy", physical, 0);
	node = LogicalNode_create("GGIO1", device);
	CDC_ENS_create("Beh", node, 0);
	status_set = DataSet_create("status", zero);
	measured_set = DataSet_create("measured", zero);
	for (unsigned i = 1; i <= states; i++)
		add_state(node, status_set, i);
	for (unsigned i = 1; i <= measured && value_count < VALUES_MAX; i++)
		add_value(node, measured_set, i);
	ReportControlBlock_create("brcbStatus01", zero, NULL, true, "status", 1, CHANGES, OPTIONS, 0, 0);
	ReportControlBlock_create("brcbMeasured01", zero, NULL, true, "measured", 1, CHANGES, OPTIONS, 0, 0);
}

static int64_t now_ns(clockid_t clock)
{
	struct timespec now;

	clock_gettime(clock, &now);
	return now.tv_sec * NS_PER_S + now.tv_nsec;
}

static void make_events(void *server, uint32_t rate)
{
	static unsigned next;
	const uint32_t wanted = rate < EVENTS_MAX ? rate : EVENTS_MAX;
	const int64_t begun_ns = now_ns(CLOCK_MONOTONIC);
	uint32_t made = 0;

	while (made < wanted) {
		const int64_t due = (now_ns(CLOCK_MONOTONIC) - begun_ns) * rate / NS_PER_S;
		const uint64_t ms = (uint64_t)now_ns(CLOCK_REALTIME) / NS_PER_MS;

		IedServer_lockDataModel(server);
		for (; made < wanted && made < due; made++, next++) {
			IedServer_updateUTCTimeAttributeValue(server, values[next % value_count].time, ms);
			IedServer_updateFloatAttributeValue(server, values[next % value_count].magnitude,
							    (float)(next + 1));
		}
		IedServer_unlockDataModel(server);
		nanosleep(&(struct timespec){.tv_nsec = PERIOD_NS}, NULL);
	}
}

int main(int argc, char **argv)
{
	void *model = IedModel_create("OpenRTU"), *server;
	char line[32];

	if (argc != 5)
		return EXIT_FAILURE;
	for (unsigned i = 1; i <= strtoul(argv[2], NULL, 10); i++)
		add_device(model, 1000 + i, (unsigned)strtoul(argv[3], NULL, 10),
			   (unsigned)strtoul(argv[4], NULL, 10));
	server = IedServer_create(model);
	IedServer_start(server, (int)strtol(argv[1], NULL, 10));
	if (!IedServer_isRunning(server))
		return EXIT_FAILURE;
	puts("ready");
	fflush(stdout);
	while (fgets(line, sizeof(line), stdin) != NULL)
		make_events(server, (uint32_t)strtoul(line, NULL, 10));
	return EXIT_SUCCESS;
}
