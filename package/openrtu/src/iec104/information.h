/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Information objects in monitoring direction, as a controlling station reads them: process information of
 * IEC 60870-5-101, 7.3.1 (types 1..21, 30..40) and the end of initialisation (70).
 */
#ifndef OPENRTU_IEC104_INFORMATION_H
#define OPENRTU_IEC104_INFORMATION_H

#include "iec104/asdu.h"

enum iec104_content {
	IEC104_SINGLE,            /* value.u: 0, 1 */
	IEC104_DOUBLE,            /* value.u: 0..3 */
	IEC104_STEP,              /* value.i: -64..63; detail 1: in transit */
	IEC104_BITS,              /* value.u */
	IEC104_NORMALIZED,        /* value.i: -32768..32767 */
	IEC104_SCALED,            /* value.i */
	IEC104_FLOAT,             /* value.f */
	IEC104_TOTAL,             /* value.i; detail: sequence number, CY, CA */
	IEC104_PROTECTION_EVENT,  /* value.u: 0..3; elapsed_ms */
	IEC104_PROTECTION_START,  /* value.u: SPE; elapsed_ms: how long it lasted */
	IEC104_PROTECTION_OUTPUT, /* value.u: OCI; elapsed_ms: until the relay operated */
	IEC104_PACKED_SINGLES,    /* value.u: states in bits 0..15, in 16..31 what changed */
	IEC104_INITIALISATION,    /* value.u: COI */
};

struct iec104_information {
	uint32_t ioa;
	enum iec104_content content;
	union map_value value;
	uint8_t quality; /* enum map_quality; of protection also EI (8), the elapsed time is invalid */
	uint8_t detail;
	uint16_t elapsed_ms;
	bool tagged;       /* with a time */
	bool time_invalid; /* IV is set, or there is no such time */
	int64_t wall_ns;   /* tagged: since 1970, UTC */
};

/* The octets of a type's element, time tag included; 0: a type that is not decoded here. */
size_t iec104_information_size(uint8_t type);

/*
 * Decodes an object of the ASDU. A time tag of three octets (CP24Time2a) has minutes only: it is the moment nearest to
 * wall_now_ns. False: the type is another, or there is no such object (iec104_object).
 */
bool iec104_information_decode(const struct iec104_asdu *asdu, unsigned place, const struct map_zone *zone,
			       int64_t wall_now_ns, struct iec104_information *out);

#endif
