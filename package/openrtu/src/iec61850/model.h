/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The map as a server of IEC 61850 shows it. A common address, which is a device, is a logical device: IED + "CA" + number. In it
 * LLN0, LPHD1, and GGIO1 with a data object for each point, whose name ends with the point's IOA. Nothing of it is stored
 * but the order of the points: names are made and found as they are asked for.
 */
#ifndef OPENRTU_IEC61850_MODEL_H
#define OPENRTU_IEC61850_MODEL_H

#include "iec61850/config.h"
#include "map/map.h"

#define IEC61850_NAME_SIZE      65 /* an MMS identifier has 64 characters at most (IEC 61850-8-1, 7.3.1) */
#define IEC61850_REFERENCE_SIZE (2 * IEC61850_NAME_SIZE)

/* Functional constraints (IEC 61850-7-2, table 18), in the order of their names. */
enum iec61850_fc {
	IEC61850_CF,
	IEC61850_DC,
	IEC61850_EX,
	IEC61850_MX,
	IEC61850_ST,
	IEC61850_FCS,
};

enum iec61850_ln { IEC61850_LLN0, IEC61850_LPHD1, IEC61850_GGIO1, IEC61850_LNS };

/* What a data attribute is: its type on the wire, and which part of a data object's state it shows. */
enum iec61850_leaf {
	IEC61850_STRUCTURE,
	IEC61850_BOOLEAN,   /* number */
	IEC61850_DOUBLE,    /* number: a bit string of two */
	IEC61850_ENUM,      /* number, 8 bits */
	IEC61850_INTEGER,   /* number, 32 bits */
	IEC61850_TOTAL,     /* number, 64 bits */
	IEC61850_FLOAT,     /* real */
	IEC61850_UNIT,      /* of a counter's pulse: 1 */
	IEC61850_CTL_MODEL, /* how it is controlled */
	IEC61850_QUALITY,
	IEC61850_TIME,
	IEC61850_DESCRIPTION,
	IEC61850_VENDOR,
	IEC61850_REVISION,
	IEC61850_CONFIGURATION,
	IEC61850_NAME_SPACE,
};

struct iec61850_node {
	const char *name;
	enum iec61850_leaf leaf;
	const struct iec61850_node *children;
	unsigned count;
};

/* The nodes of a data object under a functional constraint. */
struct iec61850_nodes {
	const struct iec61850_node *nodes;
	unsigned count;
};

struct iec61850_device {
	uint16_t ca;
	uint32_t first, count; /* of the model's points */
};

struct iec61850_model {
	const struct map *map;
	const struct map_config *config;
	const struct iec61850_settings *settings;
	uint32_t *points; /* sorted by common address and IOA */
	struct iec61850_device *devices;
	uint32_t device_count;
	uint32_t revision; /* of the configuration, as configRev shows it */
	int64_t started_ns;
};

#define IEC61850_WHOLE UINT32_MAX

/* A named variable: a logical node, a functional constraint in it, a data object, or an attribute. */
struct iec61850_object {
	const struct iec61850_device *device;
	enum iec61850_ln ln;
	uint32_t fc;                      /* enum iec61850_fc; IEC61850_WHOLE: all */
	uint32_t number;                  /* of the data object in its logical node; IEC61850_WHOLE: all */
	const struct iec61850_node *node; /* NULL: all of the data object under fc */
};

/* False: no memory. The configuration and the map stay. */
bool iec61850_model_begin(struct iec61850_model *model, const struct map *map);
void iec61850_model_end(struct iec61850_model *model);

/* ---- names ------------------------------------------------------------------------------- */

void iec61850_device_name(const struct iec61850_model *model, const struct iec61850_device *device,
			  char out[IEC61850_NAME_SIZE]);
/* NULL: there is none of this name. */
const struct iec61850_device *iec61850_find_device(const struct iec61850_model *model, const uint8_t *name,
						   size_t size);
/* Finds a variable as MMS names it, like GGIO1$MX$AnIn30001$mag$f. */
bool iec61850_find(const struct iec61850_model *model, const struct iec61850_device *device,
		   const uint8_t *name, size_t size, struct iec61850_object *out);
const char *iec61850_ln_name(enum iec61850_ln ln);
const char *iec61850_fc_name(uint32_t fc);
void iec61850_object_name(const struct iec61850_model *model, const struct iec61850_object *object,
			  char out[IEC61850_NAME_SIZE]);

/* ---- structure --------------------------------------------------------------------------- */

/* How many data objects a logical node has. */
uint32_t iec61850_object_count(const struct iec61850_device *device, enum iec61850_ln ln);
/* What a data object has under a functional constraint; nothing: count 0. */
struct iec61850_nodes iec61850_nodes_of(const struct iec61850_model *model,
					const struct iec61850_device *device, enum iec61850_ln ln,
					uint32_t number, enum iec61850_fc fc);
/* Whether a logical node has anything under it. */
bool iec61850_has(const struct iec61850_model *model, const struct iec61850_device *device,
		  enum iec61850_ln ln, enum iec61850_fc fc);
/* The point that a data object shows; MAP_NONE: it is the logical device's own. */
uint32_t iec61850_point_of(const struct iec61850_model *model, const struct iec61850_object *object);

#endif
