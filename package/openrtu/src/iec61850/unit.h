/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Units as people write them, and as IEC 61850-7-3 numbers them: SIUnit and multiplier. */
#ifndef OPENRTU_IEC61850_UNIT_H
#define OPENRTU_IEC61850_UNIT_H

#include <stdbool.h>
#include <stdint.h>

enum { IEC61850_EXPONENT_MIN = -24, IEC61850_EXPONENT_MAX = 24, IEC61850_SI_UNIT_MAX = 87 };

struct iec61850_unit {
	uint8_t si;      /* SIUnit; 0: none that 7-3 knows */
	int8_t exponent; /* multiplier: of ten */
};

/* What kWh, m³, % and so on are. */
struct iec61850_unit iec61850_unit_parse(const char *text);
/* As SCL has them. NULL: there is no such number. */
const char *iec61850_si_unit_name(int si);
const char *iec61850_multiplier_name(int exponent);

#endif
