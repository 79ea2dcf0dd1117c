/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Classes of logical nodes and of their data (IEC 61850-7-4, edition 2.1, and 7-3): what of them a point of the map can be. */
#ifndef OPENRTU_IEC61850_LN_CLASS_H
#define OPENRTU_IEC61850_LN_CLASS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "map/config.h"

/* Common data classes. */
enum iec61850_cdc {
	IEC61850_SPS,
	IEC61850_DPS,
	IEC61850_INS,
	IEC61850_ENS,
	IEC61850_ENC,
	IEC61850_ACT,
	IEC61850_ACD,
	IEC61850_BCR,
	IEC61850_MV,
	IEC61850_SPC,
	IEC61850_DPC,
	IEC61850_INC,
	IEC61850_BSC,
	IEC61850_ISC,
	IEC61850_APC,
	IEC61850_LPL,
	IEC61850_DPL,
	IEC61850_MV_RANGE, /* MV of a point with limits */
	IEC61850_CDCS,
};
extern const char *const iec61850_cdc_names[IEC61850_CDCS];

/* What the numbers of an enumeration mean, by its name in 7-3 and 7-4. */
enum iec61850_enumeration {
	IEC61850_NO_ENUMERATION,
	IEC61850_BEHAVIOUR_KIND,
	IEC61850_HEALTH_KIND,
	IEC61850_SWITCH_KIND,
	IEC61850_RECLOSING_KIND,
	IEC61850_CAPABILITY_KIND, /* to operate, of a switch */
	IEC61850_ON_WAVE_KIND,    /* ... at a point of the wave */
	IEC61850_CTL_MODEL_KIND,
	IEC61850_ORIGINATOR_KIND,
	IEC61850_DIRECTION_KIND,
	IEC61850_SI_UNIT_KIND,
	IEC61850_MULTIPLIER_KIND,
	IEC61850_RANGE_KIND,
	IEC61850_ENUMERATIONS,
};

enum iec61850_presence {
	IEC61850_MANDATORY = 1, /* there in each instance, with a point or without */
	IEC61850_ONE_OF = 2,    /* one of these at least */
	IEC61850_MULTI = 4,     /* as many as there are numbers behind the name */
};

/* Data of a class. Those that are mandatory are among the first 32. */
struct iec61850_data {
	const char *name;
	uint8_t cdc;         /* enum iec61850_cdc */
	uint8_t presence;    /* enum iec61850_presence */
	uint8_t enumeration; /* enum iec61850_enumeration */
};

struct iec61850_ln_class {
	const char *name;
	const struct iec61850_data *data;
	uint8_t count;
};

enum { IEC61850_CLASS_LLN0, IEC61850_CLASS_LPHD, IEC61850_CLASS_GGIO };
extern const struct iec61850_ln_class iec61850_ln_classes[];
extern const size_t iec61850_ln_class_count;

/* What GGIO has for a point. Without a command an xxC shows its status only. */
struct iec61850_data iec61850_default_data(const struct map_point *point);
/* The class of the data that a point is: with a range if it has limits. */
static inline enum iec61850_cdc iec61850_cdc_of(const struct iec61850_data *data,
						const struct map_point *point)
{
	return data->cdc == IEC61850_MV && (point->flags & MAP_POINT_LIMITS) ? IEC61850_MV_RANGE
									     : (enum iec61850_cdc)data->cdc;
}
/* Whether a point of this type can be data of this class. */
bool iec61850_cdc_takes(enum iec61850_cdc cdc, enum map_type type);
/* It is told as an integer: it counts, or a FLOAT32 would not hold all its bits. */
bool iec61850_is_whole(enum map_type type);

#endif
