/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The types of data attributes, as MMS (IEC 61850-8-1, clause 8) and SCL (IEC 61850-6, table 46) have them. */
#ifndef OPENRTU_IEC61850_LEAF_H
#define OPENRTU_IEC61850_LEAF_H

#include "iec61850/cdc.h"

struct iec61850_leaf_type {
	const char *basic; /* bType of SCL; NULL: of a control block, which has an element of its own there */
	uint8_t tag;       /* enum iec61850_data_tag */
	int16_t
	    size; /* in bits, of strings in characters or octets; below 0: at most so many; 0: its tag says all */
};

extern const struct iec61850_leaf_type iec61850_leaf_types[]; /* by enum iec61850_leaf */

#endif
