/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "goose/message.h"

#include <string.h>

#include "goose/ber.h"
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

static void put_time(struct ber_out *out, uint8_t tag, struct goose_time time)
{
	const uint8_t *mark = out->at;
	const uint32_t seconds = (uint32_t)(time.utc_ns / NS_PER_S);
	const uint32_t fraction = (uint32_t)(time.utc_ns % NS_PER_S * PER_SECOND / NS_PER_S);
	const uint8_t octets[TIME_SIZE] = {
	    (uint8_t)(seconds >> 24),  (uint8_t)(seconds >> 16), (uint8_t)(seconds >> 8), (uint8_t)seconds,
	    (uint8_t)(fraction >> 16), (uint8_t)(fraction >> 8), (uint8_t)fraction,       time.quality,
	};

	ber_put(out, octets, sizeof(octets));
	ber_wrap(out, tag, mark);
}

static void put_bits(struct ber_out *out, uint32_t bits, uint8_t size)
{
	const uint8_t *mark = out->at;
	const uint8_t octet_count = (uint8_t)((size + 7) / 8), unused = (uint8_t)(octet_count * 8 - size);
	const uint64_t padded = (uint64_t)bits << unused;

	for (uint8_t i = 0; i < octet_count; i++) {
		const uint8_t octet = (uint8_t)(padded >> 8 * i);

		ber_put(out, &octet, 1);
	}
	ber_put(out, &unused, 1);
	ber_wrap(out, DATA_BITS, mark);
}

static void put_float(struct ber_out *out, float real)
{
	const uint8_t *mark = out->at;
	uint32_t bits;

	memcpy(&bits, &real, sizeof(bits));
	ber_put(out,
		(const uint8_t[FLOAT_SIZE]){EXPONENT, (uint8_t)(bits >> 24), (uint8_t)(bits >> 16),
					    (uint8_t)(bits >> 8), (uint8_t)bits},
		FLOAT_SIZE);
	ber_wrap(out, DATA_FLOAT, mark);
}

static void put_item(struct ber_out *out, const struct goose_item *item)
{
	switch ((enum goose_kind)item->kind) {
	case GOOSE_BOOLEAN:
		ber_put_boolean(out, DATA_BOOLEAN, item->bits != 0);
		break;
	case GOOSE_BITS:
		put_bits(out, item->bits, item->size);
		break;
	case GOOSE_INTEGER:
		ber_put_integer(out, DATA_INTEGER, item->integer);
		break;
	case GOOSE_UNSIGNED:
		ber_put_unsigned(out, DATA_UNSIGNED, item->bits);
		break;
	case GOOSE_FLOAT:
		put_float(out, item->real);
		break;
	case GOOSE_TIME:
		put_time(out, DATA_TIME, item->time);
		break;
	case GOOSE_OTHER:
		break;
	}
}

static void put_text(struct ber_out *out, uint8_t tag, struct goose_text text)
{
	const uint8_t *mark = out->at;

	ber_put(out, text.at, text.size);
	ber_wrap(out, tag, mark);
}

static void put_pdu(struct ber_out *out, const struct goose_message *message)
{
	const uint8_t *mark = out->at;

	for (uint32_t i = message->item_count; i > 0; i--)
		put_item(out, &message->items[i - 1]);
	ber_wrap(out, TAG_DATA, mark);
	ber_put_unsigned(out, TAG_ENTRIES, message->entries);
	ber_put_boolean(out, TAG_COMMISSIONING, message->needs_commissioning);
	ber_put_unsigned(out, TAG_CONF_REV, message->conf_rev);
	ber_put_boolean(out, TAG_SIMULATION, message->simulation);
	ber_put_unsigned(out, TAG_SEQUENCE, message->sequence);
	ber_put_unsigned(out, TAG_STATE, message->state);
	put_time(out, TAG_TIME, message->time);
	put_text(out, TAG_ID, message->id);
	put_text(out, TAG_DATA_SET, message->data_set);
	ber_put_unsigned(out, TAG_ALIVE, message->alive_ms);
	put_text(out, TAG_CONTROL, message->control);
	ber_wrap(out, TAG_PDU, mark);
}

static void put_16(struct ber_out *out, uint16_t number)
{
	ber_put(out, (const uint8_t[]){(uint8_t)(number >> 8), (uint8_t)number}, 2);
}

static void put_header(struct ber_out *out, const struct goose_message *message)
{
	const struct goose_address *address = &message->address;

	put_16(out, GOOSE_ETHERTYPE);
	if (address->tagged) {
		put_16(out, (uint16_t)(address->vlan_priority << 13 | address->vlan));
		put_16(out, VLAN_TYPE);
	}
	ber_put(out, address->source, sizeof(address->source));
	ber_put(out, address->destination, sizeof(address->destination));
}

size_t goose_encode(const struct goose_message *message, uint8_t frame[GOOSE_FRAME_MAX])
{
	const size_t most = GOOSE_FRAME_MAX - (message->address.tagged ? 0 : TAG_SIZE);
	uint8_t *const end = frame + most;
	struct ber_out out = {.start = frame, .at = end};
	size_t size;

	put_pdu(&out, message);
	size = (size_t)(end - out.at) + OWN_SIZE;
	put_16(&out, 0);
	put_16(&out, message->simulation ? SIMULATED : 0);
	put_16(&out, (uint16_t)size);
	put_16(&out, message->address.app_id);
	put_header(&out, message);
	if (out.full)
		return 0;
	size = (size_t)(end - out.at);
	memmove(frame, out.at, size);
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

static bool read_time(struct ber_in content, struct goose_time *out)
{
	uint32_t fraction;

	if (ber_size(content) != TIME_SIZE)
		return false;
	fraction = (uint32_t)content.at[4] << 16 | read_16(content.at + 5);
	out->utc_ns = read_32(content.at) * NS_PER_S + fraction * NS_PER_S / PER_SECOND;
	out->quality = content.at[7];
	return true;
}

static bool read_boolean(struct ber_in content, bool *out)
{
	if (ber_size(content) != 1)
		return false;
	*out = *content.at != 0;
	return true;
}

/* Longer strings of bits are nothing that a point holds. */
static bool read_bits(struct ber_in content, struct goose_item *out)
{
	size_t octets = ber_size(content), unused;
	uint64_t bits = 0;

	if (octets < 1)
		return false;
	unused = *content.at++;
	if (unused > 7 || (octets == 1 && unused != 0))
		return false;
	if ((octets - 1) * 8 - unused > BITS_MAX) {
		out->kind = GOOSE_OTHER;
		return true;
	}
	out->kind = GOOSE_BITS;
	out->size = (uint8_t)((octets - 1) * 8 - unused);
	while (content.at < content.end)
		bits = bits << 8 | *content.at++;
	out->bits = (uint32_t)(bits >> unused);
	return true;
}

/* A double is nothing that a point holds. */
static bool read_float(struct ber_in content, struct goose_item *out)
{
	uint32_t bits;

	if (ber_size(content) != FLOAT_SIZE || content.at[0] != EXPONENT)
		return ber_size(content) > 1;
	bits = read_32(content.at + 1);
	memcpy(&out->real, &bits, sizeof(bits));
	out->kind = GOOSE_FLOAT;
	return true;
}

/* One of 64 bits may be sound and too great. */
static bool read_number(const struct ber_element *element, struct goose_item *out)
{
	const size_t size = ber_size(element->content);

	if (size == 0 || size > NUMBER_OCTETS + 1)
		return false;
	if (element->tag == DATA_INTEGER && ber_integer(element->content, &out->integer))
		out->kind = GOOSE_INTEGER;
	else if (element->tag == DATA_UNSIGNED && ber_unsigned(element->content, &out->bits))
		out->kind = GOOSE_UNSIGNED;
	return true;
}

static bool read_leaf(const struct ber_element *element, struct goose_item *out)
{
	bool value = false;

	*out = (struct goose_item){.kind = GOOSE_OTHER};
	switch (element->tag) {
	case DATA_BOOLEAN:
		if (!read_boolean(element->content, &value))
			return false;
		*out = (struct goose_item){.kind = GOOSE_BOOLEAN, .bits = value};
		return true;
	case DATA_BITS:
		return read_bits(element->content, out);
	case DATA_INTEGER:
	case DATA_UNSIGNED:
		return read_number(element, out);
	case DATA_FLOAT:
		return read_float(element->content, out);
	case DATA_TIME:
		out->kind = GOOSE_TIME;
		return read_time(element->content, &out->time);
	default:
		return true;
	}
}

/* A structure is its leaves. Each level is one of the stack's places, so that no message makes it grow. */
static bool read_data(struct ber_in content, struct goose_message *out, struct goose_item *items)
{
	struct ber_in levels[DEPTH_MAX] = {content};
	struct ber_element element;
	size_t depth = 0;

	for (;;) {
		if (ber_size(levels[depth]) == 0) {
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
			levels[depth] = element.content;
		} else if (out->item_count == GOOSE_ITEMS_MAX ||
			   !read_leaf(&element, &items[out->item_count++])) {
			return false;
		}
	}
}

static bool read_text(struct ber_in content, struct goose_text *out)
{
	*out = (struct goose_text){(const char *)content.at, ber_size(content)};
	return out->size < GOOSE_REFERENCE_SIZE;
}

#define BIT(tag) (1u << ((tag)&0x1f))

/* 0: of a tag that is none of ours. */
static uint32_t bit_of(uint8_t tag)
{
	return (tag >= TAG_CONTROL && tag <= TAG_ENTRIES) || tag == TAG_DATA ? BIT(tag) : 0;
}

static bool read_field(const struct ber_element *element, struct goose_message *out, uint32_t *entries,
		       struct ber_in *data)
{
	switch (element->tag) {
	case TAG_CONTROL:
		return read_text(element->content, &out->control);
	case TAG_ALIVE:
		return ber_unsigned(element->content, &out->alive_ms);
	case TAG_DATA_SET:
		return read_text(element->content, &out->data_set);
	case TAG_ID:
		return read_text(element->content, &out->id);
	case TAG_TIME:
		return read_time(element->content, &out->time);
	case TAG_STATE:
		return ber_unsigned(element->content, &out->state);
	case TAG_SEQUENCE:
		return ber_unsigned(element->content, &out->sequence);
	case TAG_SIMULATION:
		return read_boolean(element->content, &out->simulation);
	case TAG_CONF_REV:
		return ber_unsigned(element->content, &out->conf_rev);
	case TAG_COMMISSIONING:
		return read_boolean(element->content, &out->needs_commissioning);
	case TAG_ENTRIES:
		return ber_unsigned(element->content, entries);
	case TAG_DATA:
		*data = element->content;
		return true;
	default:
		return true; /* of a later edition */
	}
}

static bool read_pdu(struct ber_in pdu, struct goose_message *out, struct goose_item *items)
{
	const uint32_t needed = BIT(TAG_CONTROL) | BIT(TAG_ALIVE) | BIT(TAG_DATA_SET) | BIT(TAG_TIME) |
				BIT(TAG_STATE) | BIT(TAG_SEQUENCE) | BIT(TAG_CONF_REV) | BIT(TAG_ENTRIES) |
				BIT(TAG_DATA);
	struct ber_in data = {NULL, NULL};
	struct ber_element field;
	uint32_t found = 0, entries = 0;

	while (ber_size(pdu) > 0) {
		if (!ber_next(&pdu, &field) || (found & bit_of(field.tag)) != 0 ||
		    !read_field(&field, out, &entries, &data))
			return false;
		found |= bit_of(field.tag);
	}
	return (found & needed) == needed && read_data(data, out, items) && out->entries == entries;
}

bool goose_decode(const uint8_t *frame, size_t size, struct goose_message *out,
		  struct goose_item items[GOOSE_ITEMS_MAX])
{
	size_t header = HEADER_SIZE;
	struct ber_element pdu;
	struct ber_in in;
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
	in = (struct ber_in){frame + header + OWN_SIZE, frame + header + length};
	if (!ber_next(&in, &pdu) || pdu.tag != TAG_PDU || !read_pdu(pdu.content, out, items))
		return false;
	out->simulation |= (read_16(frame + header + 4) & SIMULATED) != 0;
	return true;
}
