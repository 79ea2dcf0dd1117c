/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/pcapng.h"

#include <string.h>

#define SECTION   0x0A0D0D0AU
#define INTERFACE 1U
#define PACKET    6U

#define BYTE_ORDER_MAGIC 0x1A2B3C4DU
#define UPPER_PDU        252U /* LINKTYPE_WIRESHARK_UPPER_PDU */
#define OPTION_END       0U
#define IF_NAME          2U
#define IF_TSRESOL       9U
#define NANOSECONDS      9U
#define EPB_FLAGS        2U
#define INBOUND          1U
#define OUTBOUND         2U

/* Wireshark's tags of an exported PDU, big endian. */
#define PDU_END       0U
#define PDU_DISSECTOR 12U
#define PDU_IPV4_SRC  20U
#define PDU_IPV4_DST  21U
#define PDU_PORT_TYPE 24U
#define PDU_SRC_PORT  25U
#define PDU_DST_PORT  26U
#define PDU_TCP       2U

/* By the ports it tells a request from an answer; by the addresses it keeps lines apart. */
#define MASTER_PORT 50000U
#define SLAVE_PORT  502U

#define BLOCK_MAX 2048U
#define NUMBER    4U

/* A block is put together before it is written: its length stands at both ends. */
struct block {
	uint8_t octets[BLOCK_MAX];
	size_t length;
};

static void put(struct block *block, const void *octets, size_t length)
{
	if (length > sizeof(block->octets) - block->length)
		length = sizeof(block->octets) - block->length;
	memcpy(block->octets + block->length, octets, length);
	block->length += length;
}

static void pad(struct block *block)
{
	put(block, "\0\0\0", (NUMBER - block->length % NUMBER) % NUMBER);
}

static void put_32(struct block *block, uint32_t number)
{
	put(block, &number, sizeof(number));
}

static void put_16(struct block *block, uint16_t number)
{
	put(block, &number, sizeof(number));
}

static void put_option(struct block *block, uint16_t code, const void *value, size_t length)
{
	put_16(block, code);
	put_16(block, (uint16_t)length);
	put(block, value, length);
	pad(block);
}

static void put_big_16(struct block *block, uint16_t number)
{
	const uint8_t octets[] = {(uint8_t)(number >> 8), (uint8_t)number};

	put(block, octets, sizeof(octets));
}

static void put_tag(struct block *block, uint16_t tag, const void *value, size_t length)
{
	put_big_16(block, tag);
	put_big_16(block, (uint16_t)((length + NUMBER - 1) / NUMBER * NUMBER));
	put(block, value, length);
	pad(block);
}

static void put_number_tag(struct block *block, uint16_t tag, uint32_t number)
{
	const uint8_t octets[] = {(uint8_t)(number >> 24), (uint8_t)(number >> 16), (uint8_t)(number >> 8),
				  (uint8_t)number};

	put_tag(block, tag, octets, sizeof(octets));
}

static struct block begin_block(uint32_t type)
{
	struct block block = {.length = 0};

	put_32(&block, type);
	put_32(&block, 0); /* its length: end_block */
	return block;
}

static void end_block(struct pcapng *pcapng, struct block *block)
{
	const uint32_t length = (uint32_t)(block->length + NUMBER);

	put_32(block, length);
	memcpy(block->octets + NUMBER, &length, sizeof(length));
	fwrite(block->octets, 1, block->length, pcapng->file);
}

bool pcapng_begin(struct pcapng *pcapng, const char *path)
{
	static const int64_t unknown_length = -1;
	struct block block = begin_block(SECTION);

	pcapng->file = strcmp(path, "-") == 0 ? stdout : fopen(path, "wb");
	if (pcapng->file == NULL)
		return false;
	put_32(&block, BYTE_ORDER_MAGIC);
	put_16(&block, 1); /* version 1.0 */
	put_16(&block, 0);
	put(&block, &unknown_length, sizeof(unknown_length));
	end_block(pcapng, &block);
	return true;
}

void pcapng_interface(struct pcapng *pcapng, const char *name)
{
	static const uint8_t resolution = NANOSECONDS;
	struct block block = begin_block(INTERFACE);

	put_16(&block, UPPER_PDU);
	put_16(&block, 0);
	put_32(&block, 0); /* no limit of a frame's length */
	put_option(&block, IF_NAME, name, strlen(name));
	put_option(&block, IF_TSRESOL, &resolution, sizeof(resolution));
	put_option(&block, OPTION_END, "", 0);
	end_block(pcapng, &block);
}

/* Each line is a master 127.0.0.n and a slave 127.0.1.n. */
static void put_ends(struct block *block, uint32_t interface, bool sent)
{
	const uint32_t master = 0x7f000001U + interface, slave = master + 0x100U;

	put_number_tag(block, PDU_IPV4_SRC, sent ? master : slave);
	put_number_tag(block, PDU_IPV4_DST, sent ? slave : master);
	put_number_tag(block, PDU_PORT_TYPE, PDU_TCP);
	put_number_tag(block, PDU_SRC_PORT, sent ? MASTER_PORT : SLAVE_PORT);
	put_number_tag(block, PDU_DST_PORT, sent ? SLAVE_PORT : MASTER_PORT);
}

void pcapng_frame(struct pcapng *pcapng, uint32_t interface, const char *dissector, bool sent,
		  const uint8_t *octets, size_t length, int64_t wall_ns)
{
	const uint32_t direction = sent ? OUTBOUND : INBOUND;
	struct block block = begin_block(PACKET), frame = {.length = 0};

	put_tag(&frame, PDU_DISSECTOR, dissector, strlen(dissector));
	put_ends(&frame, interface, sent);
	put_tag(&frame, PDU_END, "", 0);
	put(&frame, octets, length);
	put_32(&block, interface);
	put_32(&block, (uint32_t)((uint64_t)wall_ns >> 32));
	put_32(&block, (uint32_t)(uint64_t)wall_ns);
	put_32(&block, (uint32_t)frame.length);
	put_32(&block, (uint32_t)frame.length);
	put(&block, frame.octets, frame.length);
	pad(&block);
	put_option(&block, EPB_FLAGS, &direction, sizeof(direction));
	put_option(&block, OPTION_END, "", 0);
	end_block(pcapng, &block);
}

bool pcapng_flush(struct pcapng *pcapng)
{
	return fflush(pcapng->file) == 0;
}

bool pcapng_end(struct pcapng *pcapng)
{
	const bool whole = pcapng_flush(pcapng) && !ferror(pcapng->file);

	return (pcapng->file == stdout || fclose(pcapng->file) == 0) && whole;
}
