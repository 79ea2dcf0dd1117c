/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/frames.h"

#include <string.h>

#include "map/time_ns.h"

/* Before the octets of each piece. */
struct head {
	int64_t time_ns;
	uint16_t length, direction;
};

#define HEAD_SIZE (offsetof(struct head, direction) + sizeof(uint16_t)) /* without what pads it */

static size_t least(size_t a, size_t b)
{
	return a < b ? a : b;
}

static void put(uint8_t ring[MODBUS_FRAMES_SIZE], uint32_t at, const void *octets, size_t length)
{
	const size_t place = at % MODBUS_FRAMES_SIZE, before = least(length, MODBUS_FRAMES_SIZE - place);

	memcpy(ring + place, octets, before);
	memcpy(ring, (const uint8_t *)octets + before, length - before);
}

static void get(const uint8_t ring[MODBUS_FRAMES_SIZE], uint32_t at, void *octets, size_t length)
{
	const size_t place = at % MODBUS_FRAMES_SIZE, before = least(length, MODBUS_FRAMES_SIZE - place);

	memcpy(octets, ring + place, before);
	memcpy((uint8_t *)octets + before, ring, length - before);
}

static struct head head_at(const uint8_t ring[MODBUS_FRAMES_SIZE], uint32_t at)
{
	struct head head;

	get(ring, at, &head, HEAD_SIZE);
	return head;
}

/* Where the oldest piece begins that may stay when the ring goes on to end. */
static uint32_t make_room(const struct modbus_frames *frames, uint32_t oldest, uint32_t ended, uint32_t end)
{
	while (end - oldest > MODBUS_FRAMES_SIZE && oldest != ended)
		oldest += (uint32_t)(HEAD_SIZE + head_at(frames->octets, oldest).length);
	return oldest;
}

void modbus_frames_add(struct modbus_frames *frames, enum modbus_direction direction, const uint8_t *octets,
		       size_t length, int64_t time_ns)
{
	const uint32_t ended = atomic_load_explicit(&frames->ended, memory_order_relaxed);
	const struct head head = {.time_ns = time_ns,
				  .length = (uint16_t)least(length, MODBUS_PIECE_MAX),
				  .direction = (uint16_t)direction};
	const uint32_t end = ended + (uint32_t)(HEAD_SIZE + head.length);
	const uint32_t oldest = atomic_load_explicit(&frames->oldest, memory_order_relaxed);

	atomic_store_explicit(&frames->oldest, make_room(frames, oldest, ended, end), memory_order_relaxed);
	atomic_thread_fence(memory_order_release); /* who sees what follows sees that */
	put(frames->octets, ended, &head, HEAD_SIZE);
	put(frames->octets, ended + (uint32_t)HEAD_SIZE, octets, head.length);
	atomic_store_explicit(&frames->ended, end, memory_order_release);
}

/* What is older was overwritten. */
static void skip_to(struct modbus_frames_reader *reader, uint32_t oldest)
{
	if (reader->has_begun && (int32_t)(oldest - reader->at) <= 0)
		return;
	reader->has_lost |= reader->has_begun;
	reader->at = oldest;
}

void modbus_frames_look(const struct modbus_frames *frames, struct modbus_frames_reader *reader)
{
	reader->end = atomic_load_explicit(&frames->ended, memory_order_acquire);
	skip_to(reader, atomic_load_explicit(&frames->oldest, memory_order_relaxed));
	reader->has_begun = true;
	memcpy(reader->octets, frames->octets, sizeof(reader->octets));
	atomic_thread_fence(memory_order_acquire);
	skip_to(reader, atomic_load_explicit(&frames->oldest, memory_order_relaxed));
}

bool modbus_frames_next(struct modbus_frames_reader *reader, struct modbus_piece *piece)
{
	const uint32_t left = reader->end - reader->at;
	const struct head head = head_at(reader->octets, reader->at);

	if (left == 0 || left > MODBUS_FRAMES_SIZE)
		return false;
	if (head.length > MODBUS_PIECE_MAX || HEAD_SIZE + head.length > left) { /* none of ours wrote that */
		reader->at = reader->end;
		return false;
	}
	piece->time_ns = head.time_ns;
	piece->direction = head.direction == MODBUS_SENT ? MODBUS_SENT : MODBUS_RECEIVED;
	piece->length = head.length;
	get(reader->octets, reader->at + (uint32_t)HEAD_SIZE, piece->octets, head.length);
	reader->at += (uint32_t)(HEAD_SIZE + head.length);
	return true;
}
