/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The ASDU of IEC 60870-5-101, clause 7, with the field sizes of -104: cause of transmission two octets (the
 * second is the originator), common address two, information object address three.
 */
#ifndef OPENRTU_IEC104_ASDU_H
#define OPENRTU_IEC104_ASDU_H

#include "iec104/apdu.h"
#include "iec104/time56.h"
#include "map/map.h"

#define IEC104_ASDU_HEADER  6 /* data unit identifier */
#define IEC104_IOA_SIZE     3
#define IEC104_OBJECTS_MAX  127
#define IEC104_ELEMENT_MAX  (5 + IEC104_TIME56_SIZE)
#define IEC104_COMMAND_MAX  (IEC104_ASDU_HEADER + IEC104_IOA_SIZE + 5 + IEC104_TIME56_SIZE)
#define IEC104_CA_BROADCAST 65535

enum iec104_type {
	IEC104_M_SP_NA_1 = 1,
	IEC104_M_DP_NA_1 = 3,
	IEC104_M_ST_NA_1 = 5,
	IEC104_M_BO_NA_1 = 7,
	IEC104_M_ME_NA_1 = 9,
	IEC104_M_ME_NB_1 = 11,
	IEC104_M_ME_NC_1 = 13,
	IEC104_M_IT_NA_1 = 15,
	IEC104_M_ME_ND_1 = 21,
	IEC104_M_SP_TB_1 = 30,
	IEC104_M_DP_TB_1 = 31,
	IEC104_M_ST_TB_1 = 32,
	IEC104_M_BO_TB_1 = 33,
	IEC104_M_ME_TD_1 = 34,
	IEC104_M_ME_TE_1 = 35,
	IEC104_M_ME_TF_1 = 36,
	IEC104_M_IT_TB_1 = 37,
	IEC104_M_EI_NA_1 = 70,
	IEC104_C_SC_NA_1 = 45,
	IEC104_C_DC_NA_1 = 46,
	IEC104_C_RC_NA_1 = 47,
	IEC104_C_SE_NA_1 = 48,
	IEC104_C_SE_NB_1 = 49,
	IEC104_C_SE_NC_1 = 50,
	IEC104_C_BO_NA_1 = 51,
	IEC104_C_SC_TA_1 = 58,
	IEC104_C_DC_TA_1 = 59,
	IEC104_C_RC_TA_1 = 60,
	IEC104_C_SE_TA_1 = 61,
	IEC104_C_SE_TB_1 = 62,
	IEC104_C_SE_TC_1 = 63,
	IEC104_C_BO_TA_1 = 64,
	IEC104_C_IC_NA_1 = 100,
	IEC104_C_CI_NA_1 = 101,
	IEC104_C_RD_NA_1 = 102,
	IEC104_C_CS_NA_1 = 103,
	IEC104_C_RP_NA_1 = 105,
	IEC104_C_TS_TA_1 = 107,
	IEC104_P_ME_NA_1 = 110,
	IEC104_P_ME_NB_1 = 111,
	IEC104_P_ME_NC_1 = 112,
	IEC104_P_AC_NA_1 = 113,
};

enum iec104_cause {
	IEC104_CYCLIC = 1,
	IEC104_BACKGROUND = 2,
	IEC104_SPONTANEOUS = 3,
	IEC104_INITIALISED = 4,
	IEC104_REQUEST = 5,
	IEC104_ACTIVATION = 6,
	IEC104_ACTIVATION_CON = 7,
	IEC104_DEACTIVATION = 8,
	IEC104_DEACTIVATION_CON = 9,
	IEC104_ACTIVATION_TERM = 10,
	IEC104_RETURN_REMOTE = 11,
	IEC104_RETURN_LOCAL = 12,
	IEC104_INTERROGATED = 20,       /* by group n: 20 + n */
	IEC104_COUNTERS_REQUESTED = 37, /* of group n: 37 + n */
	IEC104_UNKNOWN_TYPE = 44,
	IEC104_UNKNOWN_CAUSE = 45,
	IEC104_UNKNOWN_CA = 46,
	IEC104_UNKNOWN_IOA = 47,
};

struct iec104_asdu {
	uint8_t type;
	bool sequence; /* SQ: one address, then elements at consecutive addresses */
	uint8_t count; /* of objects, 0..127 */
	uint8_t cause;
	bool negative; /* P/N */
	bool test;     /* T */
	uint8_t originator;
	uint16_t ca;
	const uint8_t *objects; /* decoded: inside the ASDU */
	size_t objects_size;
};

/* ---- decoding ---------------------------------------------------------------------------- */

/* Splits an ASDU. False: it is too short for its data unit identifier. */
bool iec104_asdu_decode(const uint8_t *bytes, size_t size, struct iec104_asdu *out);

/*
 * The octets of the one information object that an ASDU of this type in control direction has, with its
 * address; 0 for a type that is not decoded here.
 */
size_t iec104_control_object_size(uint8_t type);

/* The address at the beginning of an information object. */
uint32_t iec104_ioa_decode(const uint8_t *object);

/*
 * The element of an information object in monitoring direction, whose type has elements of this size, and its address: of
 * each object, or of a sequence counted on from the first. NULL: there is no such object, or the ASDU is not as long as its
 * number of objects says.
 */
const uint8_t *iec104_object(const struct iec104_asdu *asdu, size_t element_size, unsigned place,
			     uint32_t *ioa);

/* A command of types 45..51, 58..64. */
struct iec104_command {
	uint32_t ioa;
	enum map_type
	    type; /* of the points that take it, or their carrier; MAP_STEP: of any that takes regulating steps */
	union map_value value; /* as a point of that type has it; 0 of a regulating step */
	bool select;           /* S/E */
	uint8_t qualifier;     /* QU of a single, double or regulating step command, QL of a set-point */
	bool tagged;
	const uint8_t *time; /* tagged: CP56Time2a */
	int8_t step;         /* of a regulating step: -1 lower, 1 higher, 0 not permitted (RCS 0 and 3) */
};

/* Decodes a command's object of iec104_control_object_size octets. False: the type is none of a command. */
bool iec104_command_decode(uint8_t type, const uint8_t *object, struct iec104_command *out);

/* Encodes a command's element, time tag left out, and says its type. Returns the element's size, 0: no command has it. */
size_t iec104_command_encode(uint8_t out[IEC104_ELEMENT_MAX], const struct iec104_command *command,
			     uint8_t *type);

/* Decodes an object of types 110..112: a value as a point of its type has it, or the carrier's, and the QPM. */
void iec104_parameter_decode(uint8_t type, const uint8_t *object, union map_value *value, uint8_t *qualifier);

/* ---- encoding ---------------------------------------------------------------------------- */

/* An ASDU in the making. */
struct iec104_builder {
	uint8_t bytes[IEC104_ASDU_MAX];
	size_t size;
	uint32_t next_ioa; /* of a sequence */
};

/* Begins an ASDU with the header's fields (count and objects are not read). */
void iec104_asdu_begin(struct iec104_builder *builder, const struct iec104_asdu *header);
/*
 * Adds an object. False, and nothing added: the ASDU is full (249 octets, 127 objects), or this is a sequence
 * and the address is not the next one.
 */
bool iec104_asdu_add(struct iec104_builder *builder, uint32_t ioa, const uint8_t *element, size_t size);
/* How many objects were added. */
unsigned iec104_asdu_count(const struct iec104_builder *builder);

/*
 * The type that carries a point in monitoring direction: 1..15, or with a time tag 30..37; 21, which has no partner
 * with a time tag, of one without quality.
 */
uint8_t iec104_monitor_type(const struct map_point *point, bool tagged);
/* Encodes value and quality as the information element of a type, without time tag. Returns its size. */
size_t iec104_element_encode(uint8_t out[IEC104_ELEMENT_MAX], enum map_type type,
			     const struct map_sample *sample);

/*
 * Writes cause, P/N, and T as it was, into a copy of a received ASDU: a confirmation or refusal mirrors the
 * request (IEC 60870-5-101, 7.2.3), originator included.
 */
void iec104_asdu_mirror(uint8_t *bytes, enum iec104_cause cause, bool negative);

#endif
