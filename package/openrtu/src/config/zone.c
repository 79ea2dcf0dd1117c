/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A time zone as POSIX writes it in TZ (IEEE 1003.1, 8.3): std offset [dst [offset] ,start[/time] ,end[/time]]. */
#include "config/zone.h"

#include <ctype.h>
#include <string.h>

#include "map/time_ns.h"

#define HOURS_OF_OFFSET   24
#define HOURS_OF_RULE     167 /* a week less an hour either way */
#define DEFAULT_RULE_S    (2 * S_PER_HOUR)
#define NAME_LENGTH_LEAST 3

/* Each of these reads something at *text and moves *text behind it. False: it is not there. */

static bool read_number(const char **text, int digits, int low, int high, int *out)
{
	int count = 0;

	for (*out = 0; count < digits && isdigit((unsigned char)**text); count++)
		*out = *out * 10 + *(*text)++ - '0';
	return count > 0 && *out >= low && *out <= high;
}

static bool read_character(const char **text, char character)
{
	if (**text != character)
		return false;
	++*text;
	return true;
}

static bool is_quoted(char character)
{
	return isalnum((unsigned char)character) || character == '+' || character == '-';
}

static bool read_name(const char **text)
{
	bool quoted = read_character(text, '<');
	const char *begin = *text;

	while (quoted ? is_quoted(**text) : isalpha((unsigned char)**text))
		++*text;
	return *text - begin >= NAME_LENGTH_LEAST && (!quoted || read_character(text, '>'));
}

/* [+-]hh[:mm[:ss]] */
static bool read_time(const char **text, int hours_most, int32_t *seconds)
{
	bool negative = read_character(text, '-');
	int hours, minutes = 0, rest = 0;

	if (!negative)
		read_character(text, '+');
	if (!read_number(text, hours_most > 99 ? 3 : 2, 0, hours_most, &hours))
		return false;
	if (read_character(text, ':') && (!read_number(text, 2, 0, 59, &minutes) ||
					  (read_character(text, ':') && !read_number(text, 2, 0, 59, &rest))))
		return false;
	*seconds = (hours * 60 + minutes) * 60 + rest;
	if (negative)
		*seconds = -*seconds;
	return true;
}

/* POSIX counts westwards. */
static bool read_offset(const char **text, int32_t *ahead_s)
{
	if (!read_time(text, HOURS_OF_OFFSET, ahead_s))
		return false;
	*ahead_s = -*ahead_s;
	return true;
}

/* ,Mm.w.d[/time] */
static bool read_rule(const char **text, struct map_zone_rule *rule)
{
	int month, week, weekday;
	int32_t time_s = DEFAULT_RULE_S;

	if (!read_character(text, ',') || !read_character(text, 'M') ||
	    !read_number(text, 2, 1, 12, &month) || !read_character(text, '.') ||
	    !read_number(text, 1, 1, 5, &week) || !read_character(text, '.') ||
	    !read_number(text, 1, 0, 6, &weekday))
		return false;
	if (read_character(text, '/') && !read_time(text, HOURS_OF_RULE, &time_s))
		return false;
	*rule = (struct map_zone_rule){
	    .month = (uint8_t)month, .week = (uint8_t)week, .weekday = (uint8_t)weekday, .time_s = time_s};
	return true;
}

bool config_read_zone(const char *text, struct map_zone *zone)
{
	struct map_zone read = {0};

	if (!read_name(&text) || !read_offset(&text, &read.offset_s))
		return false;
	read.summer_s = read.offset_s;
	if (*text != '\0') {
		if (!read_name(&text))
			return false;
		read.summer_s += S_PER_HOUR;
		if (*text != ',' && !read_offset(&text, &read.summer_s))
			return false;
		if (!read_rule(&text, &read.begin) || !read_rule(&text, &read.end) || *text != '\0')
			return false;
	}
	*zone = read;
	return true;
}
