/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/track.h"

#include "gps/sphere.h"
#include "map/map.h"
#include "map/time_ns.h"

#define FULL_CIRCLE    36000      /* 0.01 degree */
#define ELAPSED_MAX_MS 86400000LL /* by then it can be anywhere */

static bool is_reachable(const struct gps_limits *limits, const struct gps_fix *fix, int32_t latitude,
			 int32_t longitude, int64_t arrival_ns)
{
	int64_t elapsed_ms = earlier((fix->arrival_ns - arrival_ns) / NS_PER_MS, ELAPSED_MAX_MS);
	int64_t reach_mm = limits->slack_mm + elapsed_ms * limits->speed_mm_s / MS_PER_S;

	return gps_distance_mm(latitude, longitude, fix->latitude, fix->longitude) <= reach_mm;
}

static void believe(struct gps_track *track, const struct gps_fix *fix)
{
	track->known = true;
	track->agreeing = 0;
	track->latitude = fix->latitude;
	track->longitude = fix->longitude;
	track->arrival_ns = fix->arrival_ns;
}

static void judge_place(struct gps_track *track, const struct gps_limits *limits, struct gps_fix *fix)
{
	if (!track->known ||
	    is_reachable(limits, fix, track->latitude, track->longitude, track->arrival_ns)) {
		believe(track, fix);
		return;
	}
	if (track->agreeing > 0 &&
	    is_reachable(limits, fix, track->last_latitude, track->last_longitude, track->last_arrival_ns))
		track->agreeing++;
	else
		track->agreeing = 1;
	if (track->agreeing > limits->believed) {
		believe(track, fix);
		return;
	}
	fix->marks |= GPS_JUMP;
	track->jumps++;
}

static void judge_clock(struct gps_track *track, const struct gps_limits *limits, struct gps_fix *fix)
{
	int64_t difference;

	if ((fix->known & GPS_TIME) == 0)
		return;
	if (track->timed) {
		difference =
		    (fix->time_ns - track->clock_time_ns) - (fix->arrival_ns - track->clock_arrival_ns);
		if (difference > limits->clock_ns || difference < -limits->clock_ns) {
			fix->marks |= GPS_CLOCK_STEP;
			track->clock_steps++;
		}
	}
	track->timed = true;
	track->clock_time_ns = fix->time_ns;
	track->clock_arrival_ns = fix->arrival_ns;
}

void gps_track_judge(struct gps_track *track, const struct gps_limits *limits, struct gps_fix *fix)
{
	if ((fix->known & GPS_POSITION) == 0)
		return;
	if ((fix->known & GPS_SPEED) && fix->speed_mm_s > limits->speed_mm_s) {
		fix->marks |= GPS_TOO_FAST;
		track->too_fast++;
	}
	judge_place(track, limits, fix);
	judge_clock(track, limits, fix);
	track->last_latitude = fix->latitude;
	track->last_longitude = fix->longitude;
	track->last_arrival_ns = fix->arrival_ns;
}

static int turn_between(uint16_t a, uint16_t b)
{
	int turn = a > b ? a - b : b - a;

	return turn > FULL_CIRCLE / 2 ? FULL_CIRCLE - turn : turn;
}

static bool has_turned(const struct gps_rule *rule, const struct gps_fix *sent, const struct gps_fix *fix)
{
	const uint32_t needed = GPS_COURSE | GPS_SPEED;

	return rule->turn > 0 && (sent->known & GPS_COURSE) != 0 && (fix->known & needed) == needed &&
	       fix->speed_mm_s >= rule->turn_speed_mm_s &&
	       turn_between(sent->course, fix->course) >= rule->turn;
}

enum gps_reason gps_due(const struct gps_rule *rule, const struct gps_fix *sent, const struct gps_fix *fix)
{
	if (sent == NULL)
		return GPS_FIRST;
	if (((sent->known ^ fix->known) & GPS_POSITION) != 0 || sent->method != fix->method ||
	    sent->marks != fix->marks)
		return GPS_STATE;
	if (rule->distance_mm > 0 && (fix->known & GPS_POSITION) != 0 &&
	    gps_distance_mm(sent->latitude, sent->longitude, fix->latitude, fix->longitude) >=
		rule->distance_mm)
		return GPS_BY_DISTANCE;
	if (has_turned(rule, sent, fix))
		return GPS_BY_TURN;
	if (rule->time_ns > 0 && fix->arrival_ns - sent->arrival_ns >= rule->time_ns)
		return GPS_BY_TIME;
	return GPS_NOT_DUE;
}

uint8_t gps_quality(const struct gps_fix *fix, int64_t now_ns, int64_t topical_ns)
{
	uint8_t quality = 0;

	if ((fix->known & GPS_POSITION) == 0 || fix->marks != 0)
		quality |= MAP_INVALID;
	if (fix->method >= GPS_ESTIMATED)
		quality |= MAP_SUBSTITUTED;
	if (now_ns - fix->arrival_ns > topical_ns)
		quality |= MAP_NOT_TOPICAL;
	return quality;
}
