/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the octets of a receiver: the input arrives in pieces of any size, with time between them. A piece can be given
 * a right checksum, so that the input gets behind it. What must hold: a fix has a position on the Earth, a known field is in
 * its range, and time goes on.
 */
#include <string.h>

#include "fuzz/input.h"
#include "gps/fence.h"
#include "gps/receiver.h"
#include "gps/track.h"
#include "map/time_ns.h"

#define PIECE_MAX  100
#define BUILT_DAYS 20000

static struct gps_receiver receiver;
static struct gps_track track;
static struct gps_fix sent;
static int64_t now_ns;

static void check(struct gps_fix *fix)
{
	static const struct gps_limits limits = {50000, 100000, 3, NS_PER_S};
	static const struct gps_rule rule = {100000, 1000, 1000, NS_PER_S};
	static const struct gps_fence fence = {.centre = {0, 1800000000}, .radius_m = 10000000};
	bool has_position = (fix->known & GPS_POSITION) != 0;

	CHECK(fix->latitude >= -900000000 && fix->latitude <= 900000000);
	CHECK(fix->longitude >= -1800000000 && fix->longitude <= 1800000000);
	CHECK(has_position || (fix->latitude == 0 && fix->longitude == 0 && fix->time_ns == 0));
	CHECK(has_position == (fix->method != GPS_NO_FIX) && fix->method < GPS_METHODS);
	CHECK(fix->course < 36000 && fix->day_ms >= -1 && fix->day_ms < 86401000);
	CHECK(fix->sky.count <= GPS_SKY_MAX && fix->arrival_ns <= now_ns);
	CHECK(!(fix->known & GPS_TIME) || fix->time_ns >= BUILT_DAYS * S_PER_DAY * NS_PER_S);
	gps_track_judge(&track, &limits, fix);
	if (gps_due(&rule, &sent, fix) != GPS_NOT_DUE)
		sent = *fix;
	gps_fence_holds(&fence, (struct gps_place){fix->latitude, fix->longitude});
	CHECK(((gps_quality(fix, now_ns, NS_PER_S) & 0x80) != 0) == (!has_position || fix->marks != 0));
}

static void receive(const uint8_t *octets, size_t size)
{
	struct gps_fix fix;

	while (gps_receiver_take(&receiver, &octets, &size, now_ns, &fix))
		check(&fix);
}

static void receive_piece(size_t size, bool sealed)
{
	static const char digits[] = "0123456789ABCDEF";
	uint8_t piece[PIECE_MAX + 6], sum = 0;

	piece[0] = '$';
	for (size_t i = 1; i <= size; i++) {
		piece[i] = next_octet();
		sum ^= piece[i];
	}
	memcpy(piece + 1 + size,
	       (const uint8_t[]){'*', (uint8_t)digits[sum >> 4], (uint8_t)digits[sum & 15], '\n'}, 4);
	if (sealed)
		receive(piece, size + 5);
	else
		receive(piece + 1, size);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	input = (struct input){data, data + size};
	gps_receiver_init(&receiver, NS_PER_S / 5, BUILT_DAYS);
	track = (struct gps_track){0};
	sent = (struct gps_fix){0};
	now_ns = 1;
	while (input.at < input.end) {
		uint8_t octet = next_octet();
		struct gps_fix fix;

		now_ns += (octet & 1 ? 300 : 1) * NS_PER_MS;
		if (gps_receiver_run(&receiver, now_ns, &fix))
			check(&fix);
		CHECK(gps_receiver_deadline(&receiver) > now_ns);
		receive_piece(octet % (PIECE_MAX + 1), (octet & 2) == 0);
	}
	return 0;
}
