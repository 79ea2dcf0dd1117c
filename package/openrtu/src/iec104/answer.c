/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The owners' and rtud's answers, each to who asked. */
#include "iec104/station_parts.h"

static void take_answer(struct iec104_station *station, const struct map_answer *answer)
{
	if (answer->action == MAP_FREEZE)
		iec104_take_freeze_answer(station, answer);
	else
		iec104_take_request_answer(station, answer);
}

bool iec104_take_answers(struct iec104_station *station)
{
	struct map_answer answer;
	bool any = false;

	for (; map_answer_next(station->map, &answer); any = true)
		take_answer(station, &answer);
	return any;
}
