/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "goose/message.h"

#include <string.h>

#include "ber/ber.h"
#include "map/time_ns.h"

#define VLAN_TYPE     0x8100
#define TAG_SIZE      4
#define HEADER_SIZE   14
#define OWN_SIZE      8      /* APPID, length, two reserved fields */
#define SIMULATED     0x8000 /* of the first reserved field (IEC 61850-8-1, C.2) */
#define DEPTH_MAX     4      /* of structures in structures */
#define PER_SECOND    (1 << 24)
#define TIME_SIZE     8
#define FLOAT_SIZE    5
#define EXPONENT      8 /* bits, before a float of 32 bits */
#define BITS_MAX      32
#define NUMBER_OCTETS 8

/* IECGoosePdu (IEC 61850-8-1, annex A). */
enum pdu_tag {
	TAG_PDU = 0x61,
	TAG_CONTROL = 0x80,
	TAG_ALIVE = 0x81,
	TAG_DATA_SET = 0x82,
	TAG_ID = 0x83,
	TAG_TIME = 0x84,
	TAG_STATE = 0x85,
	TAG_SEQUENCE = 0x86,
	TAG_SIMULATION = 0x87,
	TAG_CONF_REV = 0x88,
	TAG_COMMISSIONING = 0x89,
	TAG_ENTRIES = 0x8a,
	TAG_DATA = 0xab,
};

/* Data of MMS (ISO 9506-2, 14.4). */
enum data_tag {
	DATA_ARRAY = 0xa1,
	DATA_STRUCTURE = 0xa2,
	DATA_BOOLEAN = 0x83,
	DATA_BITS = 0x84,
	DATA_INTEGER = 0x85,
	DATA_UNSIGNED = 0x86,
	DATA_FLOAT = 0x87,
	DATA_TIME = 0x91,
};

/* ---- out --------------------------------------------------------------------------------- */

static void put_time(struct ber_writer *writer, uint8_t tag, struct goose_time time)
{
	const uint32_t seconds = (uint32_t)(time.utc_ns / NS_PER_S);
	const uint32_t fraction = (uint32_t)(time.utc_ns % NS_PER_S * PER_SECOND / NS_PER_S);
	const uint8_t octets[TIME_SIZE] = {
	    (uint8_t)(seconds >> 24),  (uint8_t)(seconds >> 16), (uint8_t)(seconds >> 8), (uint8_t)seconds,
	    (uint8_t)(fraction >> 16), (uint8_t)(fraction >> 8), (uint8_t)fraction,       time.quality,
	};

	ber_put(writer, tag, octets, sizeof(octets));
}

static void put_bits(struct ber_writer *writer, uint32_t bits, uint8_t size)
{
	const size_t end = writer->at;
	const uint8_t octet_count = (uint8_t)((size + 7) / 8), unused = (uint8_t)(octet_count * 8 - size);
	const uint64_t padded = (uint64_t)bits << unused;

	for (uint8_t i = 0; i < octet_count; i++) {
		const uint8_t octet = (uint8_t)(padded >> 8 * i);

		ber_put_octets(writer, &octet, 1);
	}
	ber_put_octets(writer, &unused, 1);
	ber_close(writer, DATA_BITS, end);
}

static void put_float(struct ber_writer *writer, float real)
{
	uint32_t bits;

	memcpy(&bits, &real, sizeof(bits));
	ber_put(writer, DATA_FLOAT,
		(const uint8_t[FLOAT_SIZE]){EXPONENT, (uint8_t)(bits >> 24), (uint8_t)(bits >> 16),
					    (uint8_t)(bits >> 8), (uint8_t)bits},
		FLOAT_SIZE);
}

static void put_boolean(struct ber_writer *writer, uint8_t tag, bool value)
{
	ber_put(writer, tag, (const uint8_t[]){value ? 0xff : 0}, 1);
}

static void put_item(struct ber_writer *writer, const struct goose_item *item)
{
	switch ((enum goose_kind)item->kind) {
	case GOOSE_BOOLEAN:
		put_boolean(writer, DATA_BOOLEAN, item->bits != 0);
		break;
	case GOOSE_BITS:
		put_bits(writer, item->bits, item->size);
		break;
	case GOOSE_INTEGER:
		ber_put_integer(writer, DATA_INTEGER, item->integer);
		break;
	case GOOSE_UNSIGNED:
		ber_put_integer(writer, DATA_UNSIGNED, item->bits);
		break;
	case GOOSE_FLOAT:
		put_float(writer, item->real);
		break;
	case GOOSE_TIME:
		put_time(writer, DATA_TIME, item->time);
		break;
	case GOOSE_OTHER:
		break;
	}
}

static void put_pdu(struct ber_writer *writer, const struct goose_message *message)
{
	const size_t end = writer->at;

	for (uint32_t i = message->item_count; i > 0; i--)
		put_item(writer, &message->items[i - 1]);
	ber_close(writer, TAG_DATA, end);
	ber_put_integer(writer, TAG_ENTRIES, message->entries);
	put_boolean(writer, TAG_COMMISSIONING, message->needs_commissioning);
	ber_put_integer(writer, TAG_CONF_REV, message->conf_rev);
	put_boolean(writer, TAG_SIMULATION, message->simulation);
	ber_put_integer(writer, TAG_SEQUENCE, message->sequence);
	ber_put_integer(writer, TAG_STATE, message->state);
	put_time(writer, TAG_TIME, message->time);
	ber_put(writer, TAG_ID, message->id.at, message->id.size);
	ber_put(writer, TAG_DATA_SET, message->data_set.at, message->data_set.size);
	ber_put_integer(writer, TAG_ALIVE, message->alive_ms);
	ber_put(writer, TAG_CONTROL, message->control.at, message->control.size);
	ber_close(writer, TAG_PDU, end);
}

static void put_16(struct ber_writer *writer, uint16_t number)
{
	ber_put_octets(writer, (const uint8_t[]){(uint8_t)(number >> 8), (uint8_t)number}, 2);
}

static void put_header(struct ber_writer *writer, const struct goose_message *message)
{
	const struct goose_address *address = &message->address;

	put_16(writer, GOOSE_ETHERTYPE);
	if (address->tagged) {
		put_16(writer, (uint16_t)(address->vlan_priority << 13 | address->vlan));
		put_16(writer, VLAN_TYPE);
	}
	ber_put_octets(writer, address->source, sizeof(address->source));
	ber_put_octets(writer, address->destination, sizeof(address->destination));
}

size_t goose_encode(const struct goose_message *message, uint8_t frame[GOOSE_FRAME_MAX])
{
	const size_t most = GOOSE_FRAME_MAX - (message->address.tagged ? 0 : TAG_SIZE);
	struct ber_writer writer = {.octets = frame, .at = most};
	size_t size;

	put_pdu(&writer, message);
	size = most - writer.at + OWN_SIZE;
	put_16(&writer, 0);
	put_16(&writer, message->simulation ? SIMULATED : 0);
	put_16(&writer, (uint16_t)size);
	put_16(&writer, message->address.app_id);
	put_header(&writer, message);
	if (writer.full)
		return 0;
	size = most - writer.at;
	memmove(frame, frame + writer.at, size);
	return size;
}

/* ---- in ---------------------------------------------------------------------------------- */

static uint16_t read_16(const uint8_t *octets)
{
	return (uint16_t)(octets[0] << 8 | octets[1]);
}

static uint32_t read_32(const uint8_t *octets)
{
	return (uint32_t)read_16(octets) << 16 | read_16(octets + 2);
}

static bool read_time(const struct ber_element *element, struct goose_time *out)
{
	const uint8_t *octets = element->value;

	if (element->size != TIME_SIZE)
		return false;
	out->utc_ns = read_32(octets) * NS_PER_S +
		      ((int64_t)octets[4] << 16 | read_16(octets + 5)) * NS_PER_S / PER_SECOND;
	out->quality = octets[7];
	return true;
}

static bool read_boolean(const struct ber_element *element, bool *out)
{
	if (element->size != 1)
		return false;
	*out = element->value[0] != 0;
	return true;
}

/* Publishers are known that leave out the 0 before a highest bit that is no sign. */
static bool read_unsigned(const struct ber_element *element, uint32_t *out)
{
	uint64_t number = 0;

	if (element->size == 0 || element->size > 5)
		return false;
	for (size_t i = 0; i < element->size; i++)
		number = number << 8 | element->value[i];
	*out = (uint32_t)number;
	return number <= UINT32_MAX;
}

static bool read_integer(const struct ber_element *element, int32_t *out)
{
	int64_t number;

	if (!ber_integer(element, &number))
		return false;
	*out = (int32_t)number;
	return number >= INT32_MIN && number <= INT32_MAX;
}

/* Longer strings of bits are nothing that a point holds. */
static bool read_bits(const struct ber_element *element, struct goose_item *out)
{
	const uint8_t unused = element->size == 0 ? UINT8_MAX : element->value[0];
	uint64_t bits = 0;
	size_t size;

	if (unused > 7 || (element->size == 1 && unused != 0))
		return false;
	size = (element->size - 1) * 8 - unused;
	if (size > BITS_MAX)
		return true;
	for (size_t i = 1; i < element->size; i++)
		bits = bits << 8 | element->value[i];
	*out = (struct goose_item){
	    .kind = GOOSE_BITS, .size = (uint8_t)size, .bits = (uint32_t)(bits >> unused)};
	return true;
}

/* A double is nothing that a point holds. */
static bool read_float(const struct ber_element *element, struct goose_item *out)
{
	uint32_t bits;

	if (element->size != FLOAT_SIZE || element->value[0] != EXPONENT)
		return element->size > 1;
	bits = read_32(element->value + 1);
	memcpy(&out->real, &bits, sizeof(bits));
	out->kind = GOOSE_FLOAT;
	return true;
}

/* One of 64 bits may be sound and too great. */
static bool read_number(const struct ber_element *element, struct goose_item *out)
{
	if (element->size == 0 || element->size > NUMBER_OCTETS + 1)
		return false;
	if (element->tag == DATA_INTEGER && read_integer(element, &out->integer))
		out->kind = GOOSE_INTEGER;
	else if (element->tag == DATA_UNSIGNED && read_unsigned(element, &out->bits))
		out->kind = GOOSE_UNSIGNED;
	return true;
}

static bool read_leaf(const struct ber_element *element, struct goose_item *out)
{
	bool value = false;

	*out = (struct goose_item){.kind = GOOSE_OTHER};
	switch (element->tag) {
	case DATA_BOOLEAN:
		if (!read_boolean(element, &value))
			return false;
		*out = (struct goose_item){.kind = GOOSE_BOOLEAN, .bits = value};
		return true;
	case DATA_BITS:
		return read_bits(element, out);
	case DATA_INTEGER:
	case DATA_UNSIGNED:
		return read_number(element, out);
	case DATA_FLOAT:
		return read_float(element, out);
	case DATA_TIME:
		out->kind = GOOSE_TIME;
		return read_time(element, &out->time);
	default:
		return true;
	}
}

/* A structure is its leaves. Each level is one of the stack's places, so that no message makes it grow. */
static bool read_data(const struct ber_element *data, struct goose_message *out, struct goose_item *items)
{
	struct ber_reader levels[DEPTH_MAX] = {ber_inside(data)};
	struct ber_element element;
	size_t depth = 0;

	for (;;) {
		if (levels[depth].at == levels[depth].end) {
			if (depth-- == 0)
				return true;
			continue;
		}
		if (!ber_next(&levels[depth], &element))
			return false;
		out->entries += depth == 0;
		if (element.tag == DATA_STRUCTURE || element.tag == DATA_ARRAY) {
			if (++depth == DEPTH_MAX)
				return false;
			levels[depth] = ber_inside(&element);
		} else if (out->item_count == GOOSE_ITEMS_MAX ||
			   !read_leaf(&element, &items[out->item_count++])) {
			return false;
		}
	}
}

static bool read_text(const struct ber_element *element, struct goose_text *out)
{
	*out = (struct goose_text){(const char *)element->value, element->size};
	return out->size < GOOSE_REFERENCE_SIZE;
}

#define BIT(tag) (1u << ((tag)&0x1f))

/* 0: of a tag that is none of ours. */
static uint32_t bit_of(uint32_t tag)
{
	return (tag >= TAG_CONTROL && tag <= TAG_ENTRIES) || tag == TAG_DATA ? BIT(tag) : 0;
}

static bool read_field(const struct ber_element *element, struct goose_message *out, uint32_t *entries,
		       struct ber_element *data)
{
	switch (element->tag) {
	case TAG_CONTROL:
		return read_text(element, &out->control);
	case TAG_ALIVE:
		return read_unsigned(element, &out->alive_ms);
	case TAG_DATA_SET:
		return read_text(element, &out->data_set);
	case TAG_ID:
		return read_text(element, &out->id);
	case TAG_TIME:
		return read_time(element, &out->time);
	case TAG_STATE:
		return read_unsigned(element, &out->state);
	case TAG_SEQUENCE:
		return read_unsigned(element, &out->sequence);
	case TAG_SIMULATION:
		return read_boolean(element, &out->simulation);
	case TAG_CONF_REV:
		return read_unsigned(element, &out->conf_rev);
	case TAG_COMMISSIONING:
		return read_boolean(element, &out->needs_commissioning);
	case TAG_ENTRIES:
		return read_unsigned(element, entries);
	case TAG_DATA:
		*data = *element;
		return true;
	default:
		return true; /* of a later edition */
	}
}

static bool read_pdu(const struct ber_element *pdu, struct goose_message *out, struct goose_item *items)
{
	const uint32_t needed = BIT(TAG_CONTROL) | BIT(TAG_ALIVE) | BIT(TAG_DATA_SET) | BIT(TAG_TIME) |
				BIT(TAG_STATE) | BIT(TAG_SEQUENCE) | BIT(TAG_CONF_REV) | BIT(TAG_ENTRIES) |
				BIT(TAG_DATA);
	struct ber_reader fields = ber_inside(pdu);
	struct ber_element field, data = {.size = 0};
	uint32_t found = 0, entries = 0;

	while (fields.at < fields.end) {
		if (!ber_next(&fields, &field) || (found & bit_of(field.tag)) != 0 ||
		    !read_field(&field, out, &entries, &data))
			return false;
		found |= bit_of(field.tag);
	}
	return (found & needed) == needed && read_data(&data, out, items) && out->entries == entries;
}

bool goose_decode(const uint8_t *frame, size_t size, struct goose_message *out,
		  struct goose_item items[GOOSE_ITEMS_MAX])
{
	size_t header = HEADER_SIZE;
	struct ber_element pdu;
	struct ber_reader in;
	uint16_t length;

	*out = (struct goose_message){.items = items};
	if (size < HEADER_SIZE + OWN_SIZE)
		return false;
	memcpy(out->address.destination, frame, sizeof(out->address.destination));
	memcpy(out->address.source, frame + 6, sizeof(out->address.source));
	out->address.tagged = read_16(frame + 12) == VLAN_TYPE;
	if (out->address.tagged) {
		out->address.vlan = read_16(frame + 14) & 0xfff;
		out->address.vlan_priority = frame[14] >> 5;
		header += TAG_SIZE;
	}
	if (size < header + OWN_SIZE || read_16(frame + header - 2) != GOOSE_ETHERTYPE)
		return false;
	out->address.app_id = read_16(frame + header);
	length = read_16(frame + header + 2);
	if (length < OWN_SIZE || length > size - header)
		return false;
	in = (struct ber_reader){frame + header + OWN_SIZE, frame + header + length};
	if (!ber_next(&in, &pdu) || pdu.tag != TAG_PDU || !read_pdu(&pdu, out, items))
		return false;
	out->simulation |= (read_16(frame + header + 4) & SIMULATED) != 0;
	return true;
}
