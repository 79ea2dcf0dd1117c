/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The model in the language of engineers' tools, SCL (IEC 61850-6, edition 2.1: schema 2007B4; or edition 2: 2007B). */
#ifndef OPENRTU_IEC61850_SCL_H
#define OPENRTU_IEC61850_SCL_H

#include <stdio.h>

#include "iec61850/model.h"

/* Where IEC 60870-5-104 has a point (IEC TS 61850-80-1). 0: it has no such type. */
struct iec61850_scl_address {
	unsigned type, command_type;
};

/* A GOOSE control block of a logical device, and its data set. */
struct iec61850_scl_goose {
	const struct iec61850_device *device;
	const char *name, *set, *id;
	const uint8_t *destination;
	const uint32_t *members; /* points */
	uint32_t member_count, conf_rev, least_ms, most_ms;
	uint16_t app_id, vlan;
	uint8_t vlan_priority;
	bool tagged, with_quality, with_time;
};

struct iec61850_scl {
	FILE *out;
	const struct iec61850_model *model;
	bool configured; /* a CID or an IID: this IED with its addresses; else an ICD, of any such IED */
	bool edition_2;  /* for tools that know no later one. The model is the same */
	struct iec61850_scl_address (*address)(const struct map_point *point);
	const struct iec61850_scl_goose *goose;
	uint32_t goose_count;
};

void iec61850_scl_write(const struct iec61850_scl *scl);

#endif
