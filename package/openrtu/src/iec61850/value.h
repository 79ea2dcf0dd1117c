/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Values and types of variables, as MMS Data and TypeSpecification (IEC 61850-8-1, clause 8; ISO 9506-2, 14.4). */
#ifndef OPENRTU_IEC61850_VALUE_H
#define OPENRTU_IEC61850_VALUE_H

#include "ber/ber.h"
#include "iec61850/model.h"

/* A UtcTime: seconds, a fraction of 24 bits, the quality of the clock (IEC 61850-8-1, 8.1.3.7). wall_ns 0: there is no time yet. */
void iec61850_time_of(int64_t wall_ns, const struct map_clock *clock, uint8_t out[8]);

/* db: all of dbRef, in thousandths of a percent. */
enum { IEC61850_DEADBAND_WHOLE = 100000 };
/* dbRef, and what a set-point may be, in what its value is shown in. */
float iec61850_limit_of(const struct iec61850_model *model, const struct iec61850_object *object,
			enum iec61850_leaf leaf);

/* A point as it is now, with the time of its last change. False: it cannot be read now. */
bool iec61850_read_point(const struct iec61850_model *model, uint32_t number, struct map_sample *out);

/* Puts a variable's value. False: it cannot be read now; what was put is of no use then. */
bool iec61850_put_value(struct ber_writer *writer, const struct iec61850_model *model,
			const struct iec61850_object *object);
/* Whether a point is selected now, by whomever, with any protocol. */
bool iec61850_is_selected(const struct iec61850_model *model, uint32_t point);
/* The same of a point's data object with this sample, whose time is that (enum map_event_time), selected or not. */
void iec61850_put_sample(struct ber_writer *writer, const struct iec61850_model *model,
			 const struct iec61850_object *object, const struct map_sample *sample, uint8_t time,
			 bool selected);
/* The reference of a data set, as DatSet has it: LD/LLN0$status, or @name of an association's own. */
void iec61850_set_reference(const struct iec61850_model *model, const struct iec61850_device *device,
			    const struct iec61850_set *set, char out[IEC61850_REFERENCE_SIZE]);
void iec61850_put_bits(struct ber_writer *writer, uint16_t bits, unsigned count);
/* Puts the reference of a variable's logical device, /, and a name in it. */
void iec61850_put_reference(struct ber_writer *writer, const struct iec61850_model *model,
			    const struct iec61850_device *device, const char *name);
/* Milliseconds of the day, and days since 1984 (IEC 61850-8-1, 8.1.3.6). */
void iec61850_put_binary_time(struct ber_writer *writer, int64_t wall_ns);
/* number: of an entry; 0: of none. */
void iec61850_put_entry_id(struct ber_writer *writer, const struct iec61850_model *model, uint32_t number);
/* Puts a control block's RptID. */
void iec61850_put_block_id(struct ber_writer *writer, const struct iec61850_model *model,
			   const struct iec61850_object *object, const struct iec61850_block *block);
/* Puts its type. */
void iec61850_put_type(struct ber_writer *writer, const struct iec61850_model *model,
		       const struct iec61850_object *object);

#endif
