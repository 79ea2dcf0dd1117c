/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the map has, as the textual conventions of OPENRTU-MIB have it. */
#include "snmp/agent.h"

#include <string.h>

#define FLOAT_DECIMALS 3
#define ANGLE_DECIMALS 7

void snmp_put_number(struct snmp_value *out, enum snmp_syntax syntax, int64_t number)
{
	out->syntax = (uint8_t)syntax;
	out->number = number;
	out->size = 0;
}

void snmp_put_text(struct snmp_value *out, const char *text)
{
	out->syntax = SNMP_OCTETS;
	out->size = (uint16_t)strlen(text);
	memcpy(out->octets, text, out->size);
}

static void put_octets(struct snmp_value *out, uint64_t number, uint16_t size)
{
	out->syntax = SNMP_OCTETS;
	out->size = size;
	for (unsigned i = 0; i < size; i++)
		out->octets[i] = (uint8_t)(number >> 8 * (size - 1u - i));
}

void snmp_put_time(struct snmp_value *out, int64_t time_ms)
{
	put_octets(out, time_ms == SNMP_NEVER ? UINT64_MAX : (uint64_t)time_ms, 8);
}

void snmp_put_moment(const struct snmp_agent *agent, struct snmp_value *out, int64_t time_ns)
{
	snmp_put_time(out, time_ns == 0 ? SNMP_NEVER : map_wall_ns(agent->clock, time_ns) / NS_PER_MS);
}

/* Bit 0 of BITS is the highest of the first octet, as IV is of the QDS. */
#define BIT_CARRY    0x04
#define BIT_ADJUSTED 0x02

void snmp_put_quality(struct snmp_value *out, uint8_t quality, uint8_t counter_detail)
{
	if (counter_detail & MAP_COUNTER_CARRY)
		quality |= BIT_CARRY;
	if (counter_detail & MAP_COUNTER_ADJUSTED)
		quality |= BIT_ADJUSTED;
	put_octets(out, quality, 1);
}

void snmp_put_float(struct snmp_value *out, float number)
{
	uint32_t bits;

	memcpy(&bits, &number, sizeof(bits));
	put_octets(out, bits, sizeof(bits));
}

int64_t snmp_type_number(enum map_type type)
{
	return (int64_t)type + 1;
}

unsigned snmp_decimals(const struct map_point *point)
{
	if (point->type != MAP_FLOAT)
		return point->type == MAP_ANGLE ? ANGLE_DECIMALS : 0;
	return point->decimals == 0 ? FLOAT_DECIMALS : point->decimals - 1u;
}

double snmp_scale(unsigned decimals)
{
	double scale = 1;

	while (decimals-- > 0)
		scale *= 10;
	return scale;
}

static int64_t scaled_float(float value, unsigned decimals)
{
	const double number = (double)value * snmp_scale(decimals);

	if (number != number)
		return 0;
	return number >= INT32_MAX ? INT32_MAX : number <= INT32_MIN ? INT32_MIN : map_round(number);
}

int64_t snmp_shown_value(enum map_type type, unsigned decimals, union map_value value)
{
	switch (map_types[type].form) {
	case MAP_FORM_SINGLE:
	case MAP_FORM_DOUBLE:
		return (int64_t)value.u + 1;
	case MAP_FORM_UNSIGNED:
		return value.u;
	case MAP_FORM_FLOAT:
		return scaled_float(value.f, decimals);
	case MAP_FORM_SIGNED:
	case MAP_FORM_FRACTION:
	case MAP_FORM_DEGREES:
		break;
	}
	return value.i;
}

float snmp_float_of(enum map_type type, union map_value value)
{
	return (float)map_number(type, value);
}
