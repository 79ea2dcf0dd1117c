/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Commands to points: what of them can be asked for, and what they ask of the point's owner. */
#include "iec104/carrier.h"
#include "iec104/station_parts.h"
#include "map/time_ns.h"

#include <math.h>

#define QU_NONE        0
#define QU_SHORT_PULSE 1
#define QU_LONG_PULSE  2
#define QU_PERSISTENT  3
#define DOUBLE_OFF     1
#define DOUBLE_ON      2

/* A regulating step command has no point type of its own: objects that are configured for it take it. */
static bool takes(const struct map_point *point, const struct iec104_command *command)
{
	if (!(point->flags & MAP_POINT_COMMAND))
		return false;
	return command->type == MAP_STEP ? point->step > 0 : iec104_carrier_of(point) == command->type;
}

/* QU (IEC 60870-5-101, 7.2.6.26) as a duration, 0: persistent. False: reserved, or the point has no such pulse. */
static bool pulse_of(const struct map_point *point, uint8_t qualifier, uint16_t *pulse_ms)
{
	switch (qualifier) {
	case QU_NONE:
	case QU_PERSISTENT:
		*pulse_ms = 0;
		return true;
	case QU_SHORT_PULSE:
		*pulse_ms = point->short_pulse_ms;
		return *pulse_ms != 0;
	case QU_LONG_PULSE:
		*pulse_ms = point->long_pulse_ms;
		return *pulse_ms != 0;
	default:
		return false;
	}
}

static bool value_can_be_sent(const struct map_point *point, const struct iec104_command *command)
{
	union map_value value;
	uint16_t pulse_ms;

	switch (command->type) {
	case MAP_SINGLE: /* a pulse to OFF would end with OFF */
		return pulse_of(point, command->qualifier, &pulse_ms) &&
		       (pulse_ms == 0 || command->value.u == 1);
	case MAP_DOUBLE:
		return pulse_of(point, command->qualifier, &pulse_ms) &&
		       (command->value.u == DOUBLE_OFF || command->value.u == DOUBLE_ON);
	case MAP_STEP: /* a register holds no pulse */
		return (command->qualifier == QU_NONE || command->qualifier == QU_PERSISTENT) &&
		       command->step != 0;
	case MAP_FLOAT:
		return command->qualifier == 0 && isfinite(command->value.f) &&
		       iec104_take_carried(point, command->value, &value);
	case MAP_NORMALIZED:
	case MAP_SCALED:
	case MAP_BITSTRING:
	case MAP_COUNTER:
		MAP_OWN_TYPES(MAP_CASE)
		break;
	}
	return command->qualifier == 0;
}

/* A tag is there so that a command that was delayed is not carried out: one whose age nobody knows may have been. */
static bool takes_unknown_age(struct iec104_station *station, const struct iec104_received *received)
{
	if (station->settings->command_without_clock)
		return true;
	iec104_log(station, MAP_LOG_WARNING, received->connection->peer,
		   "refuses a command with a time tag: the clock was never set");
	return false;
}

/* Of two times it takes the nearer one; while the clock was never set, the one of standard time. */
static bool take_without_season(const struct iec104_station *station, const struct iec104_received *received,
				const uint8_t *time, int64_t *wall_ns)
{
	struct map_clock clock = map_clock_read(station->map);

	return iec104_time56_decode_nearest(time, &station->config->settings.zone,
					    clock.set ? received->now_ns + clock.offset_ns : INT64_MAX / 2,
					    wall_ns);
}

/* All summer long nothing else would tell a control centre that leaves the bit 0 from one that is refused for its age. */
bool iec104_take_time(struct iec104_station *station, const struct iec104_received *received,
		      const uint8_t *time, int64_t *wall_ns)
{
	const struct map_zone *zone = &station->config->settings.zone;

	if (station->settings->ignore_summer_bit)
		return take_without_season(station, received, time, wall_ns);
	if (iec104_time56_lacks_season(time, zone))
		iec104_log(station, MAP_LOG_WARNING, received->connection->peer,
			   "refuses a time: its bit SU is not that of timezone; see ignore_summer_bit");
	return iec104_time56_decode(time, zone, wall_ns);
}

static bool time_tag_is_recent(struct iec104_station *station, const struct iec104_received *received,
			       const struct iec104_command *command)
{
	struct map_clock clock = map_clock_read(station->map);
	int64_t limit_ns = station->config->settings.command_timeout_s * NS_PER_S;
	int64_t wall_ns, age_ns;

	if (!iec104_take_time(station, received, command->time, &wall_ns))
		return false;
	if (!clock.set)
		return takes_unknown_age(station, received);
	age_ns = received->now_ns + clock.offset_ns - wall_ns;
	return age_ns <= limit_ns && age_ns >= -limit_ns;
}

static enum map_action action_of(const struct iec104_received *received, const struct iec104_command *command)
{
	if (received->asdu.cause == IEC104_DEACTIVATION)
		return MAP_CANCEL;
	return command->select ? MAP_SELECT : MAP_EXECUTE;
}

static struct map_request request_of(const struct iec104_station *station, uint32_t point,
				     const struct iec104_received *received,
				     const struct iec104_command *command)
{
	struct map_request request = {.point = point,
				      .action = (uint8_t)action_of(received, command),
				      .value = command->value,
				      .step = command->step};

	if (command->type == MAP_FLOAT)
		iec104_take_carried(iec104_point(station, point), command->value, &request.value);
	if (command->type == MAP_SINGLE || command->type == MAP_DOUBLE)
		pulse_of(iec104_point(station, point), command->qualifier, &request.pulse_ms);
	return request;
}

void iec104_take_command(struct iec104_station *station, const struct iec104_received *received)
{
	struct iec104_command command;
	uint32_t point;

	iec104_command_decode(received->asdu.type, received->asdu.objects, &command);
	point = map_find(station->map, received->asdu.ca, command.ioa);
	if (point == MAP_NONE || !takes(iec104_point(station, point), &command)) {
		iec104_refuse(received, IEC104_UNKNOWN_IOA);
		return;
	}
	if (!value_can_be_sent(iec104_point(station, point), &command) ||
	    (command.tagged && !time_tag_is_recent(station, received, &command))) {
		iec104_confirm(received, true);
		return;
	}
	if (received->asdu.test) {
		iec104_confirm(received, false);
		return;
	}
	if (!iec104_post(station, received, request_of(station, point, received, &command)))
		iec104_confirm(received, true);
}
