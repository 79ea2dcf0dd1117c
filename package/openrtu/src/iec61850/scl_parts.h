/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the parts of an SCL file share: lines, names, the walk along the objects of a logical node. */
#ifndef OPENRTU_IEC61850_SCL_PARTS_H
#define OPENRTU_IEC61850_SCL_PARTS_H

#include "iec61850/scl.h"

#define IEC61850_SCL_TEXT_SIZE (6 * MAP_NAME_SIZE) /* of a name, each character an entity */

/* The parts of a logical node's name: Q1XCBR2 is the prefix Q1, the class XCBR and the instance 2. */
struct iec61850_ln_name {
	char prefix[IEC61850_NAME_SIZE], class[5];
	const char *instance;
};

/*
 * A line, with a space for each level that it is deep in the tree: clients get the file, so it is kept small. What it is made of
 * needs no escaping, or has it.
 */
void iec61850_scl_line(const struct iec61850_scl *scl, int depth, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
const char *iec61850_scl_ied(const struct iec61850_scl *scl);
struct iec61850_ln_name iec61850_scl_ln_name(const struct iec61850_object *object);
/* The name of a data object, without what it is in. */
void iec61850_scl_do_name(const struct iec61850_scl *scl, const struct iec61850_object *object,
			  char out[IEC61850_NAME_SIZE]);
/* The name of the type of the object's logical node. */
void iec61850_scl_put_ln_type(const struct iec61850_scl *scl, const struct iec61850_object *object);

struct iec61850_object iec61850_scl_first(const struct iec61850_device *device, unsigned ln);
/* Whether the number is of a data object, not of a control block, nor behind the last. */
bool iec61850_scl_is_object(const struct iec61850_object *object);
struct iec61850_nodes iec61850_scl_inside(const struct iec61850_scl *scl,
					  const struct iec61850_object *object, unsigned fc);

/* ---- scl_types.c ------------------------------------------------------------------------- */

/* DataTypeTemplates: the types of all logical nodes, data objects, structures and enumerations. */
void iec61850_scl_put_types(const struct iec61850_scl *scl);

#endif
