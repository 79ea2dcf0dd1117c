/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-104m shows of its outstations: the section of its own in its segment, a record each, whose counters have names. */
#ifndef OPENRTU_IEC104_OUTSTATION_STATS_H
#define OPENRTU_IEC104_OUTSTATION_STATS_H

#include <stdatomic.h>
#include <stdint.h>

#define IEC104_OUTSTATIONS_KIND "104m"

/* 32-bit counters that wrap, since the module started. */
struct iec104_outstation_stats {
	_Atomic uint32_t started;  /* 0: no data transfer, else the number of its link, from 1 */
	_Atomic uint32_t starts;   /* of data transfer */
	_Atomic uint32_t failures; /* connections that ended or could not be made */
	_Atomic uint32_t objects;  /* that were points */
	_Atomic uint32_t unmapped; /* that are no point of ours */
	_Atomic uint32_t mistyped; /* of another type than their point */
	_Atomic uint32_t untimely; /* with a time tag that cannot be: of later, or of long ago */
	_Atomic uint32_t past;     /* events of before what the map had of their point */
	_Atomic uint32_t unknown;  /* ASDUs of types that are not decoded */
	_Atomic uint32_t refused;  /* commands that it refused, or did not confirm or terminate */
};

#define IEC104_OUTSTATION_COUNTERS (sizeof(struct iec104_outstation_stats) / sizeof(_Atomic uint32_t))

#endif
