/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "ber/quality.h"

#include "map/map.h"

uint16_t ber_quality_of(uint8_t quality)
{
	uint16_t q = 0;

	if (quality & MAP_INVALID)
		q = BER_Q_INVALID | BER_Q_FAILURE;
	else if (quality & (MAP_NOT_TOPICAL | MAP_OVERFLOW))
		q = BER_Q_QUESTIONABLE;
	q |= quality & MAP_NOT_TOPICAL ? BER_Q_OLD_DATA : 0;
	q |= quality & MAP_OVERFLOW ? BER_Q_OVERFLOW : 0;
	q |= quality & MAP_SUBSTITUTED ? BER_Q_SUBSTITUTED : 0;
	q |= quality & MAP_BLOCKED ? BER_Q_OPERATOR_BLOCKED : 0;
	return q;
}
