/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/information.h"

#include "map/time_ns.h"

#define TIME24_SIZE   3
#define QUALITY_MASK  0xf0 /* IV, NT, SB, BL beside a value in the low bits */
#define PROTECTION_EI 0x08
#define STEP_SIGN     0x40
#define STEP_MASK     0x7f
#define TRANSIENT_BIT 0x80
#define TOTAL_DETAIL  0x7f /* sequence number, CY, CA */
#define IV_BIT        0x80
#define MINUTE_MASK   0x3f
#define MS_PER_MINUTE 60000
#define MS_OF_AN_HOUR (60 * MS_PER_MINUTE)
#define LAST_MS       59999
#define LAST_MINUTE   59

/* A type without a time tag, with one of three octets, with one of seven. */
struct form {
	uint8_t type, type24, type56;
	uint8_t size; /* of the element, without time tag */
	enum iec104_content content;
};

static const struct form forms[] = {
    {1, 2, 30, 1, IEC104_SINGLE},
    {3, 4, 31, 1, IEC104_DOUBLE},
    {5, 6, 32, 2, IEC104_STEP},
    {7, 8, 33, 5, IEC104_BITS},
    {9, 10, 34, 3, IEC104_NORMALIZED},
    {11, 12, 35, 3, IEC104_SCALED},
    {13, 14, 36, 5, IEC104_FLOAT},
    {15, 16, 37, 5, IEC104_TOTAL},
    {0, 17, 38, 3, IEC104_PROTECTION_EVENT},
    {0, 18, 39, 4, IEC104_PROTECTION_START},
    {0, 19, 40, 4, IEC104_PROTECTION_OUTPUT},
    {20, 0, 0, 5, IEC104_PACKED_SINGLES},
    {21, 0, 0, 2, IEC104_NORMALIZED},
    {70, 0, 0, 1, IEC104_INITIALISATION},
};

static const struct form *form_of(uint8_t type)
{
	for (size_t i = 0; type != 0 && i < sizeof(forms) / sizeof(forms[0]); i++)
		if (type == forms[i].type || type == forms[i].type24 || type == forms[i].type56)
			return &forms[i];
	return NULL;
}

static size_t time_size(const struct form *form, uint8_t type)
{
	if (type == form->type24)
		return TIME24_SIZE;
	return type == form->type56 ? IEC104_TIME56_SIZE : 0;
}

size_t iec104_information_size(uint8_t type)
{
	const struct form *form = form_of(type);

	return form == NULL ? 0 : form->size + time_size(form, type);
}

static uint16_t get_u16(const uint8_t *octets)
{
	return (uint16_t)(octets[0] | octets[1] << 8);
}

static uint32_t get_u32(const uint8_t *octets)
{
	return get_u16(octets) | (uint32_t)get_u16(octets + 2) << 16;
}

static int32_t step_of(uint8_t octet)
{
	int32_t position = octet & STEP_MASK;

	return position & STEP_SIGN ? position - 2 * STEP_SIGN : position;
}

static void decode_value(const struct form *form, const uint8_t *element, struct iec104_information *out)
{
	uint8_t last = element[form->size - 1];

	switch (form->content) {
	case IEC104_SINGLE:
		out->value.u = element[0] & 0x01;
		out->quality = element[0] & QUALITY_MASK;
		break;
	case IEC104_DOUBLE:
		out->value.u = element[0] & 0x03;
		out->quality = element[0] & QUALITY_MASK;
		break;
	case IEC104_STEP:
		out->value.i = step_of(element[0]);
		out->detail = (element[0] & TRANSIENT_BIT) != 0;
		out->quality = last;
		break;
	case IEC104_NORMALIZED:
	case IEC104_SCALED:
		out->value.i = (int16_t)get_u16(element);
		out->quality = form->size > 2 ? last : 0; /* type 21 has none */
		break;
	case IEC104_BITS:
	case IEC104_FLOAT:
	case IEC104_PACKED_SINGLES:
		out->value.u = get_u32(element);
		out->quality = last;
		break;
	case IEC104_TOTAL:
		out->value.u = get_u32(element);
		out->detail = last & TOTAL_DETAIL;
		out->quality = last & MAP_INVALID;
		break;
	case IEC104_PROTECTION_EVENT:
		out->value.u = element[0] & 0x03;
		out->quality = element[0] & (QUALITY_MASK | PROTECTION_EI);
		out->elapsed_ms = get_u16(element + 1);
		break;
	case IEC104_PROTECTION_START:
	case IEC104_PROTECTION_OUTPUT:
		out->value.u = element[0];
		out->quality = element[1] & (QUALITY_MASK | PROTECTION_EI);
		out->elapsed_ms = get_u16(element + 2);
		break;
	case IEC104_INITIALISATION:
		out->value.u = element[0];
		break;
	}
}

/* Minutes and milliseconds of an hour: the nearest such moment, up to half an hour before or after. */
static bool time24_decode(const uint8_t *octets, const struct map_zone *zone, int64_t wall_now_ns,
			  int64_t *wall_ns)
{
	int ms = get_u16(octets), minute = octets[2] & MINUTE_MASK, apart;
	uint8_t now[IEC104_TIME56_SIZE];

	if ((octets[2] & IV_BIT) != 0 || ms > LAST_MS || minute > LAST_MINUTE)
		return false;
	iec104_time56_encode(now, wall_now_ns, false, zone);
	apart = minute * MS_PER_MINUTE + ms - ((now[2] & MINUTE_MASK) * MS_PER_MINUTE + get_u16(now));
	if (apart > MS_OF_AN_HOUR / 2)
		apart -= MS_OF_AN_HOUR;
	if (apart < -MS_OF_AN_HOUR / 2)
		apart += MS_OF_AN_HOUR;
	*wall_ns = (wall_now_ns / NS_PER_MS + apart) * NS_PER_MS;
	return true;
}

bool iec104_information_decode(const struct iec104_asdu *asdu, unsigned place, const struct map_zone *zone,
			       int64_t wall_now_ns, struct iec104_information *out)
{
	const struct form *form = form_of(asdu->type);
	const uint8_t *element;
	uint32_t ioa;

	if (form == NULL)
		return false;
	element = iec104_object(asdu, iec104_information_size(asdu->type), place, &ioa);
	if (element == NULL)
		return false;
	*out = (struct iec104_information){
	    .ioa = ioa, .content = form->content, .tagged = time_size(form, asdu->type) > 0};
	decode_value(form, element, out);
	if (asdu->type == form->type24)
		out->time_invalid = !time24_decode(element + form->size, zone, wall_now_ns, &out->wall_ns);
	else if (asdu->type == form->type56)
		out->time_invalid = !iec104_time56_decode(element + form->size, zone, &out->wall_ns);
	return true;
}
