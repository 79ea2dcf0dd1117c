/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the configuration file: the input is the file, which may include itself. It is refused with a message, or every index and
 * size in what was read is within its bounds, so that the map and the modules need not ask again.
 */
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "fuzz/target.h"
#include "iec104/config.h"
#include "map/meaning.h"
#include "modbus/config.h"
#include "rtud/config.h"

static void check_settings(const struct map_config *config)
{
	const struct iec104_settings *settings = iec104_settings(config);
	const uint32_t ring = config->settings.event_ring;

	CHECK(settings->k >= 1 && settings->w >= 1 && settings->w <= settings->k);
	CHECK(settings->t2_s < settings->t1_s && settings->t2_s >= 1 && settings->t3_s >= 1);
	CHECK(settings->max_connections >= 1 && settings->max_connections <= 16);
	CHECK(settings->clock_master_count <= IEC104_CLOCK_MASTERS_MAX);
	CHECK(ring >= 64 && (ring & (ring - 1)) == 0);
	CHECK(memchr(settings->address, '\0', sizeof(settings->address)) != NULL);
}

/* What rtu-modbus converts without asking. */
static void check_wire(const struct map_config *config, const struct modbus_point *point)
{
	CHECK(point->width >= 1 && point->width <= 4);
	CHECK(point->format < MODBUS_FORMATS);
	CHECK(point->bit + point->field <= 16);
	CHECK(modbus_point_address(point, point->width - 1u) <= UINT16_MAX);
	CHECK(modbus_extent_of(point).last <= UINT16_MAX);
	CHECK(point->knot_count != 1 &&
	      point->first_knot + (uint32_t)point->knot_count <= map_record_count(config, MODBUS_KNOTS));
	for (uint32_t i = 1; i < point->knot_count; i++)
		CHECK(modbus_knots(config)[point->first_knot + i].raw >
		      modbus_knots(config)[point->first_knot + i - 1].raw);
}

static void check_extra(const struct map_config *config, const struct modbus_point *point, uint32_t points)
{
	const struct modbus_extra *extra = modbus_extra_of(config, point);

	for (unsigned i = 0; extra != NULL && i < MODBUS_LINKS; i++)
		CHECK(extra->links[i] <= points);
}

/* By point, which is how they are found, each of a point that takes commands. */
static void check_keeps(const struct map_config *config)
{
	const struct modbus_keep *keeps = modbus_keeps(config);

	for (uint32_t i = 0; i < map_record_count(config, MODBUS_KEEPS); i++) {
		CHECK(keeps[i].point < map_record_count(config, MODBUS_POINTS));
		CHECK(i == 0 || keeps[i].point >= keeps[i - 1].point);
		CHECK(config->points[keeps[i].point].flags & MAP_POINT_COMMAND);
	}
}

static void check_expected(const struct map_config *config)
{
	const struct modbus_expected *expected = map_records(config, MODBUS_EXPECTED, sizeof(*expected));

	for (uint32_t i = 0; i < map_record_count(config, MODBUS_EXPECTED); i++) {
		CHECK(expected[i].slave < modbus_slave_count(config));
		CHECK(i == 0 || expected[i].slave >= expected[i - 1].slave);
		CHECK(expected[i].object < MODBUS_IDENTITY_OBJECTS);
		CHECK(memchr(expected[i].text, '\0', sizeof(expected[i].text)) != NULL);
	}
}

static void check_meanings(const struct map_config *config)
{
	const struct map_meaning *meanings = map_records(config, MAP_MEANINGS, sizeof(*meanings));

	for (uint32_t i = 0; i < map_record_count(config, MAP_MEANINGS); i++) {
		CHECK(meanings[i].point < config->point_count);
		CHECK(memchr(meanings[i].text, '\0', sizeof(meanings[i].text)) != NULL);
		CHECK(i == 0 || meanings[i].point > meanings[i - 1].point ||
		      (meanings[i].point == meanings[i - 1].point &&
		       meanings[i].number > meanings[i - 1].number));
	}
}

/* Points by set, slaves by port, without holes: what the map's sweeps rely on. */
static void check_order(const struct map_config *config)
{
	uint32_t next_device = 0, next_point = 0;

	for (uint32_t i = 0; i < modbus_port_count(config); i++) {
		CHECK(modbus_ports(config)[i].first_device == next_device);
		CHECK(modbus_ports(config)[i].device_count <= modbus_slave_count(config) - next_device);
		for (uint32_t end = next_device + modbus_ports(config)[i].device_count; next_device < end;
		     next_device++)
			CHECK(modbus_slaves(config)[next_device].port == i);
	}
	CHECK(next_device == modbus_slave_count(config));
	for (uint32_t i = 0; i < config->set_count; i++) {
		CHECK(config->sets[i].first_point == next_point);
		CHECK(config->sets[i].point_count <= config->point_count - next_point);
		for (uint32_t end = next_point + config->sets[i].point_count; next_point < end;
		     next_point++) {
			CHECK(config->points[next_point].set == i);
			CHECK(config->points[next_point].ioa >= 1 &&
			      config->points[next_point].ioa <= 0xFFFFFF);
			if (next_point >= map_record_count(config, MODBUS_POINTS))
				continue;
			check_wire(config, &modbus_points(config)[next_point]);
			check_extra(config, &modbus_points(config)[next_point], config->sets[i].point_count);
		}
	}
	CHECK(next_point == config->point_count);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static const struct config_modules all = {
	    .iec104 = true, .iec61850 = true, .modbus = true, .snmp = true, .web = true};
	static FILE *messages;
	int fd = memfd_create("config", MFD_CLOEXEC);
	struct map_config config;
	char path[32];
	enum config_result result;
	long before;

	if (messages == NULL)
		messages = fopen("/dev/null", "we");
	CHECK(fd >= 0 && messages != NULL && write(fd, data, size) == (ssize_t)size);
	snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	rewind(messages);
	before = ftell(messages);
	result = config_load(path, NULL, all, &config, messages);
	if (result == CONFIG_GOOD) {
		check_settings(&config);
		check_order(&config);
		check_keeps(&config);
		check_meanings(&config);
		check_expected(&config);
	} else {
		CHECK(ftell(messages) > before); /* nothing is refused without a reason */
		CHECK(config.points == NULL && config.point_count == 0);
	}
	config_free(&config);
	close(fd);
	return 0;
}
