/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/receiver.h"

#include <string.h>

void gps_receiver_init(struct gps_receiver *receiver, int64_t silence_ns, int32_t built_days)
{
	memset(&receiver->line, 0, sizeof(receiver->line));
	gps_burst_init(&receiver->burst, built_days);
	receiver->silence_ns = silence_ns;
	receiver->heard_ns = INT64_MIN;
}

static bool take_sentence(struct gps_receiver *receiver, const struct nmea_sentence *sentence, int64_t now_ns,
			  struct gps_fix *fix)
{
	static const enum nmea_counter counters[] = {
	    [NMEA_READ] = NMEA_TAKEN, [NMEA_NOT_READ] = NMEA_UNKNOWN, [NMEA_IMPOSSIBLE] = NMEA_DAMAGED};
	struct nmea_report report;
	enum nmea_verdict verdict = nmea_read(sentence, &report);

	receiver->line.counters[counters[verdict]]++;
	return verdict == NMEA_READ && gps_burst_take(&receiver->burst, &report, now_ns, fix);
}

bool gps_receiver_take(struct gps_receiver *receiver, const uint8_t **bytes, size_t *size, int64_t now_ns,
		       struct gps_fix *fix)
{
	struct nmea_sentence sentence;

	while (*size > 0) {
		uint8_t octet = *(*bytes)++;

		(*size)--;
		receiver->heard_ns = now_ns;
		if (nmea_line_take(&receiver->line, octet, &sentence) &&
		    take_sentence(receiver, &sentence, now_ns, fix))
			return true;
	}
	return false;
}

int64_t gps_receiver_deadline(const struct gps_receiver *receiver)
{
	return receiver->burst.open ? receiver->heard_ns + receiver->silence_ns : INT64_MAX;
}

bool gps_receiver_run(struct gps_receiver *receiver, int64_t now_ns, struct gps_fix *fix)
{
	return now_ns >= gps_receiver_deadline(receiver) && gps_burst_end(&receiver->burst, fix);
}
