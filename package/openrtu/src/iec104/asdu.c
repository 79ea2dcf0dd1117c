/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/asdu.h"

#include <string.h>

#include "iec104/carrier.h"

/* Octets of the data unit identifier. */
enum { TYPE, VARIABLE_STRUCTURE, CAUSE, ORIGINATOR, CA_LOW, CA_HIGH };

#define SQ_BIT       0x80
#define COUNT_MASK   0x7f
#define TEST_BIT     0x80
#define NEGATIVE_BIT 0x40
#define CAUSE_MASK   0x3f

#define SELECT_BIT        0x80 /* S/E of SCO, DCO and QOS */
#define QU_SHIFT          2
#define QU_MASK           0x1f
#define QL_MASK           0x7f
#define TRANSIENT_BIT     0x80
#define STEP_MASK         0x7f
#define RCS_LOWER         1
#define RCS_HIGHER        2
#define BCR_DETAIL        (MAP_COUNTER_SEQUENCE | MAP_COUNTER_CARRY | MAP_COUNTER_ADJUSTED)
#define QUALITY_ONLY_MASK 0xf0 /* IV, NT, SB, BL; a bit or double bit has no OV */

static uint32_t get_u16(const uint8_t *bytes)
{
	return bytes[0] | (uint32_t)bytes[1] << 8;
}

static uint32_t get_u32(const uint8_t *bytes)
{
	return get_u16(bytes) | get_u16(bytes + 2) << 16;
}

static void put_u16(uint8_t *bytes, uint32_t value)
{
	bytes[0] = (uint8_t)value;
	bytes[1] = (uint8_t)(value >> 8);
}

static void put_u32(uint8_t *bytes, uint32_t value)
{
	put_u16(bytes, value);
	put_u16(bytes + 2, value >> 16);
}

static void put_ioa(uint8_t *bytes, uint32_t ioa)
{
	put_u16(bytes, ioa);
	bytes[2] = (uint8_t)(ioa >> 16);
}

/* ---- decoding ---------------------------------------------------------------------------- */

bool iec104_asdu_decode(const uint8_t *bytes, size_t size, struct iec104_asdu *out)
{
	if (size < IEC104_ASDU_HEADER)
		return false;
	*out = (struct iec104_asdu){
	    .type = bytes[TYPE],
	    .sequence = (bytes[VARIABLE_STRUCTURE] & SQ_BIT) != 0,
	    .count = bytes[VARIABLE_STRUCTURE] & COUNT_MASK,
	    .cause = bytes[CAUSE] & CAUSE_MASK,
	    .negative = (bytes[CAUSE] & NEGATIVE_BIT) != 0,
	    .test = (bytes[CAUSE] & TEST_BIT) != 0,
	    .originator = bytes[ORIGINATOR],
	    .ca = (uint16_t)get_u16(bytes + CA_LOW),
	    .objects = bytes + IEC104_ASDU_HEADER,
	    .objects_size = size - IEC104_ASDU_HEADER,
	};
	return true;
}

uint32_t iec104_ioa_decode(const uint8_t *object)
{
	return get_u16(object) | (uint32_t)object[2] << 16;
}

const uint8_t *iec104_object(const struct iec104_asdu *asdu, size_t element_size, unsigned place,
			     uint32_t *ioa)
{
	size_t object_size = element_size + (asdu->sequence ? 0 : IEC104_IOA_SIZE);
	size_t size = asdu->count * object_size + (asdu->sequence ? IEC104_IOA_SIZE : 0);
	const uint8_t *object = asdu->objects + place * object_size;

	if (place >= asdu->count || asdu->objects_size != size)
		return NULL;
	*ioa = iec104_ioa_decode(asdu->sequence ? asdu->objects : object) + (asdu->sequence ? place : 0);
	return object + IEC104_IOA_SIZE;
}

struct command_form {
	uint8_t type;         /* without time tag */
	uint8_t type_tagged;  /* with CP56Time2a */
	uint8_t element_size; /* without time tag */
	enum map_type point;
};

static const struct command_form command_forms[] = {
    {IEC104_C_SC_NA_1, IEC104_C_SC_TA_1, 1, MAP_SINGLE},
    {IEC104_C_DC_NA_1, IEC104_C_DC_TA_1, 1, MAP_DOUBLE},
    {IEC104_C_RC_NA_1, IEC104_C_RC_TA_1, 1, MAP_STEP},
    {IEC104_C_SE_NA_1, IEC104_C_SE_TA_1, 3, MAP_NORMALIZED},
    {IEC104_C_SE_NB_1, IEC104_C_SE_TB_1, 3, MAP_SCALED},
    {IEC104_C_SE_NC_1, IEC104_C_SE_TC_1, 5, MAP_FLOAT},
    {IEC104_C_BO_NA_1, IEC104_C_BO_TA_1, 4, MAP_BITSTRING},
};

static const struct command_form *command_form(uint8_t type)
{
	for (size_t i = 0; i < sizeof(command_forms) / sizeof(command_forms[0]); i++)
		if (type == command_forms[i].type || type == command_forms[i].type_tagged)
			return &command_forms[i];
	return NULL;
}

size_t iec104_control_object_size(uint8_t type)
{
	const struct command_form *form = command_form(type);

	if (form != NULL)
		return IEC104_IOA_SIZE + form->element_size +
		       (size_t)(type == form->type_tagged ? IEC104_TIME56_SIZE : 0);
	switch (type) {
	case IEC104_C_IC_NA_1: /* QOI */
	case IEC104_C_CI_NA_1: /* QCC */
	case IEC104_C_RP_NA_1: /* QRP */
		return IEC104_IOA_SIZE + 1;
	case IEC104_C_RD_NA_1:
		return IEC104_IOA_SIZE;
	case IEC104_C_CS_NA_1:
		return IEC104_IOA_SIZE + IEC104_TIME56_SIZE;
	case IEC104_C_TS_TA_1: /* TSC */
		return IEC104_IOA_SIZE + 2 + IEC104_TIME56_SIZE;
	case IEC104_P_ME_NA_1: /* value, QPM */
	case IEC104_P_ME_NB_1:
		return IEC104_IOA_SIZE + 3;
	case IEC104_P_ME_NC_1:
		return IEC104_IOA_SIZE + 5;
	case IEC104_P_AC_NA_1: /* QPA */
		return IEC104_IOA_SIZE + 1;
	default:
		return 0;
	}
}

/* SCO, DCO and RCO: the state in the low bits, QU, S/E. */
static void decode_switching(uint8_t octet, uint8_t state_mask, struct iec104_command *out)
{
	out->value.u = octet & state_mask;
	out->qualifier = octet >> QU_SHIFT & QU_MASK;
	out->select = (octet & SELECT_BIT) != 0;
}

/* IEC 60870-5-101, 7.2.6.17: RCS 1 next step lower, 2 next step higher. */
static void decode_step(uint8_t octet, struct iec104_command *out)
{
	static const int8_t steps[] = {0, -1, 1, 0};

	decode_switching(octet, 0x03, out);
	out->step = steps[out->value.u];
	out->value.u = 0;
}

static void decode_qos(uint8_t octet, struct iec104_command *out)
{
	out->qualifier = octet & QL_MASK;
	out->select = (octet & SELECT_BIT) != 0;
}

static float float_of(uint32_t bits)
{
	union map_value value = {.u = bits};

	return value.f;
}

static uint32_t bits_of(float number)
{
	union map_value value = {.f = number};

	return value.u;
}

bool iec104_command_decode(uint8_t type, const uint8_t *object, struct iec104_command *out)
{
	const struct command_form *form = command_form(type);
	const uint8_t *element = object + IEC104_IOA_SIZE;

	if (form == NULL)
		return false;
	*out = (struct iec104_command){
	    .ioa = iec104_ioa_decode(object),
	    .type = form->point,
	    .tagged = type == form->type_tagged,
	    .time = element + form->element_size,
	};
	switch (form->point) {
	case MAP_SINGLE:
		decode_switching(element[0], 0x01, out);
		break;
	case MAP_DOUBLE:
		decode_switching(element[0], 0x03, out);
		break;
	case MAP_NORMALIZED:
	case MAP_SCALED:
		out->value.i = (int16_t)get_u16(element);
		decode_qos(element[2], out);
		break;
	case MAP_FLOAT:
		out->value.f = float_of(get_u32(element));
		decode_qos(element[4], out);
		break;
	case MAP_BITSTRING: /* has no qualifier: it cannot be selected */
		out->value.u = get_u32(element);
		break;
	case MAP_STEP:
		decode_step(element[0], out);
		break;
	case MAP_COUNTER:
		MAP_OWN_TYPES(MAP_CASE)
		return false;
	}
	return true;
}

void iec104_parameter_decode(uint8_t type, const uint8_t *object, union map_value *value, uint8_t *qualifier)
{
	const uint8_t *element = object + IEC104_IOA_SIZE;

	if (type == IEC104_P_ME_NC_1) {
		value->f = float_of(get_u32(element));
		*qualifier = element[4];
	} else {
		value->i = (int16_t)get_u16(element);
		*qualifier = element[2];
	}
}

/* ---- encoding ---------------------------------------------------------------------------- */

void iec104_asdu_begin(struct iec104_builder *builder, const struct iec104_asdu *header)
{
	builder->bytes[TYPE] = header->type;
	builder->bytes[VARIABLE_STRUCTURE] = header->sequence ? SQ_BIT : 0;
	builder->bytes[CAUSE] =
	    (uint8_t)(header->cause | (header->negative ? NEGATIVE_BIT : 0) | (header->test ? TEST_BIT : 0));
	builder->bytes[ORIGINATOR] = header->originator;
	put_u16(builder->bytes + CA_LOW, header->ca);
	builder->size = IEC104_ASDU_HEADER;
}

unsigned iec104_asdu_count(const struct iec104_builder *builder)
{
	return builder->bytes[VARIABLE_STRUCTURE] & COUNT_MASK;
}

bool iec104_asdu_add(struct iec104_builder *builder, uint32_t ioa, const uint8_t *element, size_t size)
{
	bool sequence = (builder->bytes[VARIABLE_STRUCTURE] & SQ_BIT) != 0;
	unsigned count = iec104_asdu_count(builder);
	bool addressed = !sequence || count == 0;

	if (count == IEC104_OBJECTS_MAX || (!addressed && ioa != builder->next_ioa))
		return false;
	if (builder->size + (addressed ? IEC104_IOA_SIZE : 0) + size > IEC104_ASDU_MAX)
		return false;
	if (addressed) {
		put_ioa(builder->bytes + builder->size, ioa);
		builder->size += IEC104_IOA_SIZE;
	}
	memcpy(builder->bytes + builder->size, element, size);
	builder->size += size;
	builder->next_ioa = ioa + 1;
	builder->bytes[VARIABLE_STRUCTURE]++;
	return true;
}

uint8_t iec104_monitor_type(const struct map_point *point, bool tagged)
{
	static const uint8_t types[][2] = {
	    [MAP_SINGLE] = {IEC104_M_SP_NA_1, IEC104_M_SP_TB_1},
	    [MAP_DOUBLE] = {IEC104_M_DP_NA_1, IEC104_M_DP_TB_1},
	    [MAP_STEP] = {IEC104_M_ST_NA_1, IEC104_M_ST_TB_1},
	    [MAP_BITSTRING] = {IEC104_M_BO_NA_1, IEC104_M_BO_TB_1},
	    [MAP_NORMALIZED] = {IEC104_M_ME_NA_1, IEC104_M_ME_TD_1},
	    [MAP_SCALED] = {IEC104_M_ME_NB_1, IEC104_M_ME_TE_1},
	    [MAP_FLOAT] = {IEC104_M_ME_NC_1, IEC104_M_ME_TF_1},
	    [MAP_COUNTER] = {IEC104_M_IT_NA_1, IEC104_M_IT_TB_1},
	};

	return point->flags & MAP_POINT_NO_QUALITY ? IEC104_M_ME_ND_1
						   : types[iec104_carrier_of(point)][tagged];
}

/* A value as its carrier has it (IEEE 754 of a short float). */
static uint32_t carried(enum map_type type, union map_value value)
{
	if (type != MAP_FLOAT && map_types[type].carrier == MAP_FLOAT)
		return bits_of((float)map_number(type, value));
	return value.u;
}

size_t iec104_element_encode(uint8_t out[IEC104_ELEMENT_MAX], enum map_type type,
			     const struct map_sample *sample)
{
	switch (map_types[type].carrier) {
	case MAP_SINGLE: /* SIQ */
		out[0] = (uint8_t)((sample->value.u & 0x01) | (sample->quality & QUALITY_ONLY_MASK));
		return 1;
	case MAP_DOUBLE: /* DIQ */
		out[0] = (uint8_t)((sample->value.u & 0x03) | (sample->quality & QUALITY_ONLY_MASK));
		return 1;
	case MAP_STEP: /* VTI */
		out[0] = (uint8_t)((sample->value.u & STEP_MASK) | (sample->detail & 1 ? TRANSIENT_BIT : 0));
		out[1] = sample->quality;
		return 2;
	case MAP_NORMALIZED:
	case MAP_SCALED:
		put_u16(out, sample->value.u);
		out[2] = sample->quality;
		return 3;
	case MAP_BITSTRING:
	case MAP_FLOAT:
		put_u32(out, carried(type, sample->value));
		out[4] = sample->quality;
		return 5;
	case MAP_COUNTER: /* BCR: sequence number, CY and CA of a freeze, only IV of the quality */
		put_u32(out, sample->value.u);
		out[4] = (uint8_t)((sample->quality & MAP_INVALID) | (sample->detail & BCR_DETAIL));
		return 5;
		MAP_OWN_TYPES(MAP_CASE)
		break; /* they carry nothing */
	}
	return 0;
}

/* SCO, DCO, RCO. */
static uint8_t switching(const struct iec104_command *command, uint8_t state)
{
	return (uint8_t)(state | (command->qualifier & QU_MASK) << QU_SHIFT |
			 (command->select ? SELECT_BIT : 0));
}

static uint8_t regulating_step(int8_t step)
{
	return step < 0 ? RCS_LOWER : RCS_HIGHER;
}

size_t iec104_command_encode(uint8_t out[IEC104_ELEMENT_MAX], const struct iec104_command *command,
			     uint8_t *type)
{
	uint8_t qos = (uint8_t)((command->qualifier & QL_MASK) | (command->select ? SELECT_BIT : 0));

	for (size_t i = 0; i < sizeof(command_forms) / sizeof(command_forms[0]); i++)
		if (command_forms[i].point == command->type)
			*type = command->tagged ? command_forms[i].type_tagged : command_forms[i].type;
	switch (command->type) {
	case MAP_SINGLE:
		out[0] = switching(command, command->value.u & 0x01);
		return 1;
	case MAP_DOUBLE:
		out[0] = switching(command, command->value.u & 0x03);
		return 1;
	case MAP_STEP:
		out[0] = switching(command, regulating_step(command->step));
		return 1;
	case MAP_NORMALIZED:
	case MAP_SCALED:
		put_u16(out, command->value.u);
		out[2] = qos;
		return 3;
	case MAP_FLOAT:
		put_u32(out, command->value.u);
		out[4] = qos;
		return 5;
	case MAP_BITSTRING:
		put_u32(out, command->value.u);
		return 4;
	case MAP_COUNTER:
		MAP_OWN_TYPES(MAP_CASE)
		return 0;
	}
	return 0;
}

void iec104_asdu_mirror(uint8_t *bytes, enum iec104_cause cause, bool negative)
{
	bytes[CAUSE] = (uint8_t)((bytes[CAUSE] & TEST_BIT) | (negative ? NEGATIVE_BIT : 0) | (uint8_t)cause);
}
