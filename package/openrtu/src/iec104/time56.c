/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/time56.h"

#include <string.h>

#include "map/time_ns.h"

#define MS_PER_DAY  86400000LL
#define MS_OF_2000  (10957 * MS_PER_DAY) /* 1970-01-01 to 2000-01-01 */
#define DAYS_100    36525                /* 2000..2099: every fourth year is a leap year, 2000 too */
#define DAYS_4      1461
#define IV_BIT      0x80
#define MINUTE_MASK 0x3f
#define HOUR_MASK   0x1f
#define SU_BIT      0x80
#define DAYS_WEEK   7
#define SATURDAY    6 /* 2000-01-01 */
#define DAY_MASK    0x1f
#define MONTH_MASK  0x0f
#define YEAR_MASK   0x7f

static int days_in_month(int year, int month)
{
	static const uint8_t days[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};

	return days[month - 1] + (month == 2 && year % 4 == 0);
}

/* Days from 2000-01-01 to the first of January of 2000 + year. */
static int days_before_year(int year)
{
	return year * 365 + (year + 3) / 4;
}

/* Days from 2000-01-01 to the day of a year that the rule names. */
static int day_of_rule(const struct map_zone_rule *rule, int year)
{
	int first = days_before_year(year), day;

	for (int month = 1; month < rule->month; month++)
		first += days_in_month(year, month);
	day = (rule->weekday - (SATURDAY + first) % DAYS_WEEK + DAYS_WEEK) % DAYS_WEEK;
	day += (rule->week - 1) * DAYS_WEEK;
	while (day >= days_in_month(year, rule->month))
		day -= DAYS_WEEK;
	return first + day;
}

/* time_s: since 2000-01-01, UTC */
static bool is_summer(const struct map_zone *zone, int64_t time_s)
{
	int64_t begin_s, end_s;
	int year;

	if (zone->begin.month == 0)
		return false;
	year = (int)((time_s + zone->offset_s) / S_PER_DAY * 4 / DAYS_4);
	begin_s = (int64_t)day_of_rule(&zone->begin, year) * S_PER_DAY + zone->begin.time_s - zone->offset_s;
	end_s = (int64_t)day_of_rule(&zone->end, year) * S_PER_DAY + zone->end.time_s - zone->summer_s;
	if (begin_s < end_s)
		return time_s >= begin_s && time_s < end_s;
	return time_s >= begin_s || time_s < end_s; /* in the south, over the turn of the year */
}

void iec104_time56_encode(uint8_t octets[IEC104_TIME56_SIZE], int64_t wall_ns, bool invalid,
			  const struct map_zone *zone)
{
	int64_t ms = wall_ns / NS_PER_MS - MS_OF_2000;
	bool summer = is_summer(zone, ms / MS_PER_S);
	int days, ms_of_day, year, month = 1;

	ms += (summer ? zone->summer_s : zone->offset_s) * MS_PER_S;

	if (ms < 0 || ms >= DAYS_100 * MS_PER_DAY) {
		ms = ms < 0 ? 0 : DAYS_100 * MS_PER_DAY - 1;
		invalid = true;
	}
	days = (int)(ms / MS_PER_DAY);
	ms_of_day = (int)(ms % MS_PER_DAY);
	year = days * 4 / DAYS_4;
	days -= days_before_year(year);
	while (days >= days_in_month(year, month))
		days -= days_in_month(year, month++);

	octets[0] = (uint8_t)(ms_of_day % 60000);
	octets[1] = (uint8_t)(ms_of_day % 60000 >> 8);
	octets[2] = (uint8_t)(ms_of_day / 60000 % 60 | (invalid ? IV_BIT : 0));
	octets[3] = (uint8_t)(ms_of_day / 3600000 | (summer ? SU_BIT : 0));
	octets[4] = (uint8_t)(days + 1);
	octets[5] = (uint8_t)month;
	octets[6] = (uint8_t)year;
}

bool iec104_time56_decode(const uint8_t octets[IEC104_TIME56_SIZE], const struct map_zone *zone,
			  int64_t *wall_ns)
{
	int ms = octets[0] | octets[1] << 8, minute = octets[2] & MINUTE_MASK, hour = octets[3] & HOUR_MASK,
	    day = octets[4] & DAY_MASK, month = octets[5] & MONTH_MASK, year = octets[6] & YEAR_MASK;
	bool summer = (octets[3] & SU_BIT) != 0;
	int64_t days, time_s;

	if (octets[2] & IV_BIT)
		return false;
	if (ms > 59999 || minute > 59 || hour > 23 || month < 1 || month > 12 || year > 99)
		return false;
	if (day < 1 || day > days_in_month(year, month))
		return false;
	days = days_before_year(year) + day - 1;
	for (int m = 1; m < month; m++)
		days += days_in_month(year, m);
	time_s = days * S_PER_DAY + (hour * 60 + minute) * 60 - (summer ? zone->summer_s : zone->offset_s);
	*wall_ns = (MS_OF_2000 + time_s * MS_PER_S + ms) * NS_PER_MS;
	return is_summer(zone, time_s + ms / MS_PER_S) == summer;
}

bool iec104_time56_decode_nearest(const uint8_t octets[IEC104_TIME56_SIZE], const struct map_zone *zone,
				  int64_t near_ns, int64_t *wall_ns)
{
	uint8_t winter[IEC104_TIME56_SIZE], summer[IEC104_TIME56_SIZE];
	int64_t winter_ns, summer_ns;
	bool in_winter, in_summer;

	memcpy(winter, octets, sizeof(winter));
	memcpy(summer, octets, sizeof(summer));
	winter[3] &= (uint8_t)~SU_BIT;
	summer[3] |= SU_BIT;
	in_winter = iec104_time56_decode(winter, zone, &winter_ns);
	in_summer = iec104_time56_decode(summer, zone, &summer_ns);
	if (in_winter && in_summer) /* summer's is the earlier one */
		in_summer = near_ns - summer_ns < winter_ns - near_ns;
	*wall_ns = in_summer ? summer_ns : winter_ns;
	return in_winter || in_summer;
}

bool iec104_time56_lacks_season(const uint8_t octets[IEC104_TIME56_SIZE], const struct map_zone *zone)
{
	uint8_t other[IEC104_TIME56_SIZE];
	int64_t ignored;

	memcpy(other, octets, sizeof(other));
	other[3] ^= SU_BIT;
	return !iec104_time56_decode(octets, zone, &ignored) && iec104_time56_decode(other, zone, &ignored);
}
