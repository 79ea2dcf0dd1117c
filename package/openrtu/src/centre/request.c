/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/request.h"

#include <math.h>
#include <string.h>

#include "map/type.h"

#define QU_MAX 31  /* 5 bits */
#define QL_MAX 127 /* 7 bits */

static bool is_zero(const struct centre_request *request)
{
	static const uint8_t zeros[sizeof(request->reserved)];

	return memcmp(request->reserved, zeros, sizeof(zeros)) == 0;
}

bool centre_request_read(const uint8_t *octets, size_t size, struct centre_request *out)
{
	if (size < sizeof(*out))
		return false;
	memcpy(out, octets, sizeof(*out));
	return out->kind >= CENTRE_ACKNOWLEDGE && out->kind <= CENTRE_TRACE && out->id != 0 &&
	       (out->flags & ~(CENTRE_SELECT | CENTRE_WITH_TIME)) == 0 && is_zero(out) &&
	       (out->kind == CENTRE_COMMAND || out->flags == 0);
}

static bool has_value(const struct centre_request *request)
{
	const struct map_type_row *row = &map_types[request->type];

	switch ((enum map_type)request->type) {
	case MAP_FLOAT:
		return isfinite(request->value.f);
	case MAP_STEP:
		return request->step == -1 || request->step == 1;
	case MAP_DOUBLE:
		return request->value.u == 1 || request->value.u == 2; /* the others are not permitted */
	case MAP_SINGLE:
	case MAP_BITSTRING:
		return request->value.u >= row->low && request->value.u <= row->high;
	case MAP_NORMALIZED:
	case MAP_SCALED:
		return request->value.i >= row->low && request->value.i <= row->high;
	case MAP_COUNTER:
		MAP_OWN_TYPES(MAP_CASE) /* there is no such command */
		break;
	}
	return false;
}

static bool has_qualifier(const struct centre_request *request)
{
	if (request->type == MAP_BITSTRING)
		return request->qualifier == 0;
	return request->qualifier <= (map_types[request->type].class == MAP_CLASS_MEASURED ? QL_MAX : QU_MAX);
}

bool centre_request_command(const struct centre_request *request, struct iec104_command *out)
{
	if (request->type >= MAP_TYPES || !has_value(request) || !has_qualifier(request))
		return false;
	*out = (struct iec104_command){.ioa = request->ioa,
				       .type = request->type,
				       .select = (request->flags & CENTRE_SELECT) != 0,
				       .qualifier = request->qualifier,
				       .tagged = (request->flags & CENTRE_WITH_TIME) != 0,
				       .step = request->type == MAP_STEP ? request->step : 0};
	if (request->type != MAP_STEP)
		out->value = request->value;
	return true;
}
