/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "quality/quality.h"

#include "map/map.h"

uint16_t quality_of_map(uint8_t quality)
{
	uint16_t q = 0;

	if (quality & MAP_INVALID)
		q = QUALITY_INVALID | QUALITY_FAILURE;
	else if (quality & (MAP_NOT_TOPICAL | MAP_OVERFLOW))
		q = QUALITY_QUESTIONABLE;
	q |= quality & MAP_NOT_TOPICAL ? QUALITY_OLD_DATA : 0;
	q |= quality & MAP_OVERFLOW ? QUALITY_OVERFLOW : 0;
	q |= quality & MAP_SUBSTITUTED ? QUALITY_SUBSTITUTED : 0;
	q |= quality & MAP_BLOCKED ? QUALITY_OPERATOR_BLOCKED : 0;
	return q;
}
