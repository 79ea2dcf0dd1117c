/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Records for the consumer: what there is to say of a station. */
#ifndef OPENRTU_CENTRE_SAY_H
#define OPENRTU_CENTRE_SAY_H

#include "centre/station.h"

/* There is room for all that a station may say in one step. */
bool centre_has_room(const struct centre *centre);
uint32_t centre_place_of(const struct centre_station *station);
/* A record of a place in the file. */
struct centre_record *centre_record_add(struct centre *centre, uint32_t place, enum centre_kind kind);
struct centre_record *centre_say_asdu(struct centre_station *station, enum centre_kind kind,
				      const struct iec104_asdu *asdu);
void centre_say_link(struct centre_station *station, enum centre_link link, uint8_t reason, int error,
		     int64_t retry_ns);
/* id: of the consumer's request; 0: it was none of its. */
void centre_say_progress(struct centre_station *station, const struct iec104_controlling_request *request,
			 uint64_t id);
void centre_record_time(struct centre_record *record, bool tagged, bool invalid, int64_t wall_ns);

#endif
