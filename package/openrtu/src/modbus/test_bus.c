/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/test_bus.h"

#include <stdio.h>
#include <string.h>

#define TAG_OF_OBJECT 1000

struct bus bus;

/* ---- what the line tells ------------------------------------------------------------------------ */

/* Every value must be that of its own device and address: no answer may be taken for another's. */
static void on_read(void *context, uint32_t device, const struct modbus_read *read, const uint8_t *data,
		    int64_t now_ns)
{
	const struct slave *slave = &bus.slaves[device];

	assert_ptr_equal(context, &bus);
	assert_int_equal(now_ns, bus.now_ns);
	for (uint32_t i = 0; i < read->objects; i++) {
		const struct modbus_object *object = &bus.objects[device][read->first + i];
		uint16_t index = (uint16_t)(object->address - read->address);

		assert_int_equal(object->function, read->function);
		if (modbus_is_bit_function(read->function))
			assert_int_equal(modbus_bit(data, index), slave->registers[object->address] % 3 == 0);
		else
			assert_int_equal(modbus_register(data, index), slave->registers[object->address]);
	}
	if (bus.reads_done[device]++ > 0 && now_ns - bus.last_read_ns[device] > bus.longest_ns[device])
		bus.longest_ns[device] = now_ns - bus.last_read_ns[device];
	bus.last_read_ns[device] = now_ns;
	bus.objects_read[device] += read->objects;
}

static void on_refused(void *context, uint32_t device, const struct modbus_read *read, uint8_t exception,
		       int64_t now_ns)
{
	(void)context;
	(void)now_ns;
	bus.last_exception = exception;
	for (uint32_t i = 0; i < read->objects; i++)
		bus.refused_addresses[device] |= 1ULL << bus.objects[device][read->first + i].address % 64;
}

static void on_alive(void *context, uint32_t device, bool alive, int64_t now_ns)
{
	(void)context;
	if (alive) {
		bus.births[device]++;
	} else {
		bus.deaths[device]++;
		bus.died_ns[device] = now_ns;
		bus.lost_by_death_ns[device] = bus.lost_ns[device] + bus.waited_ns;
	}
}

static void on_command(void *context, const struct modbus_command *command, enum modbus_result result,
		       uint8_t exception)
{
	const struct modbus_request *write = &command->request;

	(void)context;
	if (result == MODBUS_DONE && write->unit != MODBUS_BROADCAST &&
	    write->function == MODBUS_WRITE_REGISTER)
		assert_int_equal(bus.slaves[command->device].registers[write->address], write->values[0]);
	bus.tags[bus.commands_done++ % 16] = command->tag;
	bus.last_tag = command->tag;
	bus.last_result = result;
	bus.last_exception = exception;
}

static void on_late(void *context, uint32_t device, int64_t latency_ns, int64_t now_ns)
{
	assert_ptr_equal(context, &bus);
	assert_int_equal(now_ns, bus.now_ns);
	bus.lates[device]++;
	bus.late_ns[device] = latency_ns;
}

static void on_stranger(void *context, uint32_t device, uint8_t unit, int64_t now_ns)
{
	assert_ptr_equal(context, &bus);
	assert_int_equal(now_ns, bus.now_ns);
	bus.strangers[device]++;
	bus.stranger = unit;
}

static void on_identified(void *context, uint32_t device)
{
	assert_ptr_equal(context, &bus);
	bus.identified[device]++;
}

static void on_misfit(void *context, uint32_t device, size_t length, size_t expected, int64_t now_ns)
{
	assert_ptr_equal(context, &bus);
	assert_int_equal(now_ns, bus.now_ns);
	bus.misfits[device]++;
	bus.misfit = length;
	bus.fit = expected;
}

static void on_turned(void *context, uint32_t device, uint8_t unknown, uint8_t function, int64_t now_ns)
{
	assert_ptr_equal(context, &bus);
	assert_int_equal(now_ns, bus.now_ns);
	assert_true(bus.slaves[device].unknown & 1u << unknown);
	assert_int_not_equal(unknown, function);
	bus.turns++;
}

static void on_pause(void *context, uint32_t device, int64_t pause_ns, int64_t now_ns)
{
	assert_ptr_equal(context, &bus);
	assert_int_equal(now_ns, bus.now_ns);
	bus.pauses[device]++;
	bus.pause_ns[device] = pause_ns;
}

static void on_kept(void *context, uint32_t device, const struct modbus_kept *kept, int64_t now_ns)
{
	assert_ptr_equal(context, &bus);
	assert_int_equal(now_ns, bus.now_ns);
	bus.last_result = kept->result;
	bus.last_exception = kept->exception;
	bus.kept_news[device]++;
}

static void on_passed(void *context, const struct modbus_passed *passed, enum modbus_result result,
		      const uint8_t *body, size_t length, int64_t now_ns)
{
	assert_ptr_equal(context, &bus);
	assert_int_equal(now_ns, bus.now_ns);
	assert_int_equal(body != NULL, result == MODBUS_DONE);
	bus.passes++;
	bus.pass_result = result;
	bus.pass_tag = passed->tag;
	bus.pass_length = length;
	if (length > 0)
		memcpy(bus.pass_answer, body, length);
}

static const struct modbus_events events = {.read = on_read,
					    .refused = on_refused,
					    .alive = on_alive,
					    .command = on_command,
					    .late = on_late,
					    .pause = on_pause,
					    .turned = on_turned,
					    .kept = on_kept,
					    .passed = on_passed,
					    .stranger = on_stranger,
					    .identified = on_identified,
					    .misfit = on_misfit};

/* ---- the devices -------------------------------------------------------------------------------- */

static bool is_text(void)
{
	return bus.line.wire.framing == MODBUS_FRAMING_ASCII;
}

void put_on_wire(int64_t time_ns, const uint8_t *bytes, size_t length)
{
	assert_true(bus.wire_count + length <= WIRE_MAX);
	for (size_t i = 0; i < length; i++) {
		size_t at = bus.wire_count++;

		time_ns += bus.line.wire.char_ns / (is_text() ? 2 : 1) + bus.spread_ns;
		for (; at > 0 && bus.wire[at - 1].time_ns > time_ns; at--)
			bus.wire[at] = bus.wire[at - 1];
		bus.wire[at] = (struct wire_byte){time_ns, bytes[i]};
	}
}

size_t seal(uint8_t *frame, size_t length)
{
	uint16_t crc = modbus_crc(frame, length);

	frame[length] = (uint8_t)(crc & 0xFF);
	frame[length + 1] = (uint8_t)(crc >> 8);
	return length + 2;
}

static bool covers(const struct modbus_request *request, int address)
{
	return address >= request->address && address < request->address + request->count;
}

static bool is_unknown(const struct slave *slave, const struct modbus_request *request)
{
	if (request->function == MODBUS_ENCAPSULATED)
		return slave->identity[0] == NULL;
	return (slave->unknown & 1u << request->function) != 0;
}

static uint8_t exception_for(const struct slave *slave, const struct modbus_request *request)
{
	if (slave->exception)
		return slave->exception;
	if (slave->write_exception && !modbus_is_read(request->function))
		return slave->write_exception;
	if (is_unknown(slave, request))
		return MODBUS_ILLEGAL_FUNCTION;
	if (request->function == MODBUS_ENCAPSULATED)
		return slave->basic_only && request->address >> 8 > 1 ? MODBUS_ILLEGAL_VALUE : 0;
	if (slave->most > 0 && modbus_is_read(request->function) && request->count > slave->most)
		return MODBUS_ILLEGAL_VALUE;
	for (int i = 0; i < slave->blanks; i++)
		if (covers(request, slave->blank + i))
			return MODBUS_ILLEGAL_ADDRESS;
	return covers(request, slave->missing) || request->address + request->count > ADDRESSES ? 2 : 0;
}

static size_t read_answer(const struct slave *slave, const struct modbus_request *request, uint8_t *frame)
{
	uint16_t bytes = modbus_read_bytes(request->function, request->count);

	frame[2] = (uint8_t)bytes;
	memset(frame + 3, 0, bytes);
	for (uint16_t i = 0; i < request->count; i++) {
		uint16_t value = slave->registers[request->address + i];

		if (modbus_is_bit_function(request->function)) {
			frame[3 + i / 8] |= (uint8_t)((value % 3 == 0) << (i % 8));
		} else {
			frame[3 + 2 * i] = (uint8_t)(value >> 8);
			frame[4 + 2 * i] = (uint8_t)(value & 0xFF);
		}
	}
	return seal(frame, 3u + bytes);
}

static size_t identification(const struct slave *slave, const struct modbus_request *request, uint8_t *frame)
{
	const uint8_t access = (uint8_t)(request->address >> 8), last = access > 1 ? 7 : 3;
	uint8_t object = (uint8_t)request->address, count = 0;
	size_t at = 8;

	for (; object < last && slave->identity[object] != NULL &&
	       (slave->identified == 0 || count < slave->identified);
	     object++, count++) {
		const size_t length = strlen(slave->identity[object]);

		frame[at] = object;
		frame[at + 1] = (uint8_t)length;
		memcpy(frame + at + 2, slave->identity[object], length);
		at += 2 + length;
	}
	const bool more = object < last && slave->identity[object] != NULL;

	memcpy(frame + 2, (const uint8_t[]){14, access, 0x82, more ? 0xFF : 0, more ? object : 0, count}, 6);
	return seal(frame, at);
}

/* bytes: the request's frame, whose first six bytes are the answer to a write. */
static size_t answer_of(struct slave *slave, const struct modbus_request *request, const uint8_t *bytes,
			uint8_t *frame)
{
	frame[0] = request->unit;
	frame[1] = request->function;
	frame[2] = exception_for(slave, request);
	if (frame[2]) {
		frame[1] |= MODBUS_EXCEPTION_BIT;
		return seal(frame, 3);
	}
	if (modbus_is_read(request->function))
		return read_answer(slave, request, frame);
	if (request->function == MODBUS_ENCAPSULATED)
		return identification(slave, request, frame);
	for (uint16_t i = 0; i < request->count; i++)
		slave->registers[request->address + i] = request->values[i];
	memcpy(frame, bytes, 6);
	return seal(frame, 6);
}

/* By Modbus TCP, where no frame has a CRC, and no unit is a broadcast. */
static bool is_framed(void)
{
	return bus.line.wire.framing == MODBUS_FRAMING_TCP;
}

static size_t spoil(struct slave *slave, uint8_t *frame, size_t length)
{
	if (slave->faults == 0)
		return length;
	slave->faults--;
	switch (slave->fault) {
	case MUTE:
		return 0;
	case CORRUPT:
		frame[3] ^= is_framed() ? 0 : 0x10;
		return length;
	case TRUNCATED:
		return length - 2;
	case WRONG_UNIT:
		frame[0] += 100;
		return seal(frame, length - 2);
	case WRONG_FUNCTION:
		frame[1] = 0x2B;
		return seal(frame, length - 2);
	case WRONG_LENGTH:
		frame[2] += EXCESS;
		return seal(frame, length - 2 + EXCESS);
	case WRONG_ECHO:
		if (!modbus_is_read(frame[1]) && !(frame[1] & MODBUS_EXCEPTION_BIT))
			frame[5]++;
		return seal(frame, length - 2);
	case NOISE_BEFORE:
		memmove(frame + 3, frame, length);
		frame[0] = frame[1] = frame[2] = 0xFF;
		return length + 3;
	case NOISE_BEHIND:
		memset(frame + length, 0, 2);
		return length + 2;
	case BABBLE_BEHIND:
		memset(frame + length, 0, 4);
		return length + 4;
	case STRANGER_FIRST:
		memmove(frame + 7, frame, length);
		memcpy(frame, (const uint8_t[]){99, 3, 2, 0, 1}, 5);
		seal(frame, 5);
		return length + 7;
	case SOUND:
		break;
	}
	return length;
}

/* Makes a Modbus TCP frame of an RTU frame. */
static size_t framed(uint8_t *frame, size_t length)
{
	size_t body = length - MODBUS_CRC_LENGTH;

	memmove(frame + MODBUS_MBAP_PREFIX, frame, body);
	memcpy(frame,
	       (const uint8_t[]){(uint8_t)(bus.transaction >> 8), (uint8_t)bus.transaction, 0, 0,
				 (uint8_t)(body >> 8), (uint8_t)body},
	       MODBUS_MBAP_PREFIX);
	return MODBUS_MBAP_PREFIX + body;
}

/* The opposite. */
static size_t unframed(const struct modbus_output *output, uint8_t frame[MODBUS_FRAME_MAX])
{
	size_t body = output->length - MODBUS_MBAP_PREFIX;

	assert_int_equal(modbus_mbap_length(output->frame, output->length), output->length);
	bus.transaction = modbus_register(output->frame, 0);
	memcpy(frame, output->frame + MODBUS_MBAP_PREFIX, body);
	return seal(frame, body);
}

/* Of an RTU frame, whose CRC may be wrong, a text whose LRC is then. */
static size_t as_text(const uint8_t *frame, size_t length, uint8_t *text)
{
	const bool sound = modbus_crc_valid(frame, length);
	uint8_t sum = sound ? 0 : 1;
	size_t at = 0;

	text[at++] = ':';
	for (size_t i = 0; i + MODBUS_CRC_LENGTH < length; i++) {
		at += (size_t)sprintf((char *)text + at, "%02X", frame[i]);
		sum = (uint8_t)(sum + frame[i]);
	}
	return at + (size_t)sprintf((char *)text + at, "%02X\r\n", (uint8_t)-sum);
}

/* The opposite. */
static size_t of_text(const struct modbus_output *output, uint8_t frame[MODBUS_FRAME_MAX])
{
	struct modbus_ascii ascii = {.begun = false};
	enum modbus_ascii_state state = MODBUS_ASCII_NOISE;

	for (size_t i = 0; i < output->length; i++)
		state = modbus_ascii_take(&ascii, output->frame[i]);
	assert_int_equal(state, MODBUS_ASCII_SOUND);
	memcpy(frame, ascii.body, ascii.length);
	return seal(frame, ascii.length);
}

static int64_t extra_ns(const struct slave *slave, const struct modbus_request *request)
{
	if (!modbus_is_read(request->function))
		return slave->write_ns;
	return request->count > 1 ? slave->long_ns : 0;
}

/* ---- the other end of a connection --------------------------------------------------------------- */

static void hang_up_at(int64_t time_ns)
{
	bus.hang_up_ns = time_ns;
}

/* True: the peer leaves the request unanswered. */
static bool is_ignored(const struct modbus_request *request)
{
	bool early = bus.now_ns < bus.connected_ns + bus.peer.settle_ns;

	if (!bus.line.wire.connection)
		return false;
	if (bus.peer.hangs_up_at_identification && request->function == MODBUS_ENCAPSULATED)
		hang_up_at(bus.now_ns + MS);
	else if (bus.peer.hangs_up_at && request->count > 1 && request->address >= bus.peer.hated)
		hang_up_at(bus.now_ns + MS);
	else if (early && bus.peer.hangs_up_early)
		hang_up_at(bus.now_ns + MS);
	else
		return early || (bus.peer.hangs_after > 0 && bus.answered >= bus.peer.hangs_after);
	return true;
}

static void note_answer(int64_t ended_ns)
{
	bus.answered++;
	if (bus.peer.idle_ns > 0)
		hang_up_at(ended_ns + bus.peer.idle_ns);
}

static void lose_connection(void)
{
	bus.apart = true;
	bus.wire_count = 0;
	bus.hang_up_ns = 0;
}

static void let_peer_hang_up(void)
{
	if (bus.apart || bus.hang_up_ns == 0 || bus.now_ns < bus.hang_up_ns)
		return;
	lose_connection();
	if (!modbus_line_interrupted(&bus.line, bus.now_ns))
		modbus_line_close(&bus.line, bus.now_ns);
}

/* As a port does; one that is lost is there again after a second. */
static void connect_when_due(void)
{
	if (!bus.apart || bus.refusing)
		return;
	if (bus.line.state != MODBUS_CLOSED) {
		if (!modbus_line_is_due(&bus.line, bus.now_ns))
			return;
		modbus_line_connected(&bus.line, bus.now_ns);
	} else if (bus.now_ns >= bus.connected_ns + 1000 * MS) {
		modbus_line_open(&bus.line, bus.now_ns);
	} else {
		return;
	}
	bus.apart = false;
	bus.connections++;
	bus.connected_ns = bus.now_ns;
	bus.answered = 0;
}

static void slave_takes(struct slave *slave, const struct modbus_request *request, const uint8_t *bytes)
{
	uint8_t frame[2 * MODBUS_FRAME_MAX], text[4 * MODBUS_FRAME_MAX];
	int64_t start = bus.busy_ns > slave->free_ns ? bus.busy_ns : slave->free_ns;

	bool broadcast = request->unit == MODBUS_BROADCAST && !is_framed();

	if (!slave->present || (request->unit != slave->unit && !broadcast))
		return;
	if (covers(request, slave->deaf) && request->count > 1)
		return;
	if (is_ignored(request) || (slave->dumb && is_unknown(slave, request)))
		return;
	if (slave->one_ear && bus.busy_ns < slave->free_ns)
		return;
	if (slave->pause_ns > 0 && bus.now_ns < slave->free_ns + slave->pause_ns) {
		slave->free_ns = bus.busy_ns;
		return;
	}
	size_t length = answer_of(slave, request, bytes, frame);
	if (broadcast)
		return;
	length = spoil(slave, frame, length);
	if (length == 0)
		return;
	if (is_framed())
		length = framed(frame, length);
	start += slave->reaction_ns + extra_ns(slave, request);
	if (slave->late > 0) {
		slave->late--;
		start += slave->late_ns;
	}
	slave->free_ns = start + (int64_t)length * bus.line.wire.char_ns;
	if (is_text()) {
		length = as_text(frame, length, text);
		put_on_wire(start, text, length - (slave->endless ? 2 : 0));
	} else {
		put_on_wire(start, frame, length);
	}
	note_answer(slave->free_ns);
}

/* ---- the bus ------------------------------------------------------------------------------------ */

static struct modbus_request parse(const uint8_t *bytes, size_t length)
{
	struct modbus_request request = {bytes[0], bytes[1], modbus_register(bytes, 1), 1, {0}};

	assert_true(modbus_crc_valid(bytes, length));
	switch (request.function) {
	case MODBUS_ENCAPSULATED:
		request.address = modbus_register(bytes + 3, 0);
		break;
	case MODBUS_WRITE_COIL:
		request.values[0] = bytes[4] ? 1 : 0;
		break;
	case MODBUS_WRITE_REGISTER:
		request.values[0] = modbus_register(bytes, 2);
		break;
	case MODBUS_WRITE_COILS:
		request.count = modbus_register(bytes, 2);
		request.values[0] = bytes[7] & 1;
		break;
	case MODBUS_WRITE_REGISTERS:
		request.count = modbus_register(bytes, 2);
		request.values[0] = modbus_register(bytes + 7, 0);
		request.values[1] = modbus_register(bytes + 7, 1);
		break;
	default:
		request.count = modbus_register(bytes, 2);
	}
	return request;
}

static void take_output(const struct modbus_output *output)
{
	if (output->length == 0)
		return;
	assert_true(bus.now_ns >= bus.busy_ns + bus.line.wire.silence_ns);
	if (bus.echoing)
		put_on_wire(bus.now_ns, output->frame, output->length);
	bus.busy_ns = bus.now_ns + (int64_t)output->length * bus.line.wire.char_ns / (is_text() ? 2 : 1);
	uint8_t frame[MODBUS_FRAME_MAX];
	size_t length = output->length;
	if (is_framed())
		length = unframed(output, frame);
	else if (is_text())
		length = of_text(output, frame);
	else
		memcpy(frame, output->frame, length);
	struct modbus_request request = parse(frame, length);
	if (bus.sent_count < TRACE_MAX)
		bus.sent[bus.sent_count++] = (struct sent){bus.now_ns, request};
	for (uint32_t i = 0; i < bus.line.device_count; i++)
		slave_takes(&bus.slaves[i], &request, frame);
}

/* Datagrams one by one, as far as they are frames. */
static void give(const uint8_t *bytes, size_t count)
{
	size_t length = bus.line.wire.datagrams ? modbus_mbap_length(bytes, count) : count;

	for (; length > 0 && length < count; length = modbus_mbap_length(bytes, count)) {
		assert_true(modbus_line_receive(&bus.line, bytes, length, bus.now_ns));
		bytes += length;
		count -= length;
	}
	assert_true(modbus_line_receive(&bus.line, bytes, count, bus.now_ns));
}

void deliver(void)
{
	static uint8_t bytes[WIRE_MAX];
	size_t count = 0;

	for (; count < bus.wire_count && bus.wire[count].time_ns <= bus.now_ns; count++) {
		bytes[count] = bus.wire[count].byte;
		if (bus.wire[count].time_ns > bus.busy_ns)
			bus.busy_ns = bus.wire[count].time_ns;
	}
	bus.wire_count -= count;
	memmove(&bus.wire[0], &bus.wire[count], bus.wire_count * sizeof(bus.wire[0]));
	give(bytes, count);
	bus.deliveries += count > 0;
}

uint32_t random_next(uint32_t *seed)
{
	*seed = *seed * 1664525u + 1013904223u;
	return *seed >> 8;
}

/* Now and then others have the processor for up to 200 ms. */
static int64_t delay(void)
{
	if (bus.chance == 0 || random_next(&bus.chance) % 8 != 0)
		return 0;
	return (int64_t)(random_next(&bus.chance) % 200) * MS;
}

/* Somebody has to do something: at a deadline, or when there is something on the wire and it is listened to. */
static int64_t earliest(int64_t deadline_ns, int64_t listen_ns)
{
	int64_t heard_ns = bus.wire[0].time_ns > listen_ns ? bus.wire[0].time_ns : listen_ns;

	return heard_ns < deadline_ns ? heard_ns : deadline_ns;
}

static void let_time_pass(int64_t until_ns)
{
	if (until_ns <= bus.now_ns)
		return;
	bus.waited_ns += until_ns - bus.now_ns;
	bus.now_ns = until_ns;
}

static struct modbus_output poll_line(void)
{
	bool waiting = bus.line.state == MODBUS_WAITING;
	uint32_t device = bus.line.device, timeouts = bus.line.counters.timeouts;
	struct modbus_output output = modbus_line_poll(&bus.line, bus.now_ns);

	if (waiting && bus.line.counters.timeouts > timeouts)
		bus.lost_ns[device] += bus.waited_ns;
	if (output.length > 0)
		bus.waited_ns = 0;
	return output;
}

static void run_until(int64_t until_ns)
{
	for (;;) {
		let_peer_hang_up();
		connect_when_due();
		struct modbus_output output = poll_line();

		assert_false(bus.apart && output.length > 0);
		if (output.reconnect) {
			lose_connection();
			continue;
		}
		take_output(&output);
		int64_t next_ns = output.deadline_ns;
		if (bus.apart && bus.line.state == MODBUS_CLOSED && bus.connected_ns + 1000 * MS < next_ns &&
		    !bus.refusing)
			next_ns = bus.connected_ns + 1000 * MS;
		if (bus.hang_up_ns > bus.now_ns && bus.hang_up_ns < next_ns)
			next_ns = bus.hang_up_ns;
		if (bus.wire_count > 0)
			next_ns = earliest(next_ns, output.listen_ns);
		if (next_ns > until_ns)
			break;
		bus.still = output.length == 0 && next_ns <= bus.now_ns ? bus.still + 1 : 0;
		assert_true(bus.still < 3);
		let_time_pass(next_ns);
		let_time_pass(bus.now_ns + delay());
		if (bus.now_ns >= output.listen_ns)
			deliver();
	}
	let_time_pass(until_ns);
}

void run_for(int64_t ns)
{
	run_until(bus.now_ns + ns);
}

void run_until_dead(uint32_t device, int64_t within_ns)
{
	int64_t until_ns = bus.now_ns + within_ns;

	while (bus.devices[device].alive && bus.now_ns < until_ns)
		run_for(MS);
	assert_false(bus.devices[device].alive);
}

/* ---- what a test does --------------------------------------------------------------------------- */

void forget_trace(void)
{
	bus.sent_count = 0;
	memset(bus.reads_done, 0, sizeof(bus.reads_done));
	memset(bus.objects_read, 0, sizeof(bus.objects_read));
	memset(bus.longest_ns, 0, sizeof(bus.longest_ns));
	memset(&bus.line.counters, 0, sizeof(bus.line.counters));
}

void set_up(void)
{
	memset(&bus, 0, sizeof(bus));
	bus.now_ns = 5 * SECOND;
	bus.line = (struct modbus_line){.events = &events,
					.context = &bus,
					.devices = bus.devices,
					.commands = bus.commands,
					.command_capacity = COMMANDS_MAX,
					.pass_share = 10,
					.wire = modbus_wire(19200, 11)};
}

void use_connection(enum modbus_framing framing)
{
	bus.line.wire = modbus_wire_tcp(framing);
}

void use_udp(void)
{
	bus.line.wire = modbus_wire_udp();
}

void use_ascii(uint32_t baud)
{
	bus.line.wire = modbus_wire_ascii(baud, 10);
}

void use_tcp(void)
{
	use_connection(MODBUS_FRAMING_TCP);
}

void add_device(uint8_t unit, uint8_t retries)
{
	uint32_t index = bus.line.device_count++;

	bus.devices[index] = (struct modbus_device){.unit = unit,
						    .retries = retries,
						    .broadcast = unit == MODBUS_BROADCAST && !is_framed(),
						    .response_timeout_ns = TIMEOUT_NS,
						    .response_timeout_min_ns = TIMEOUT_NS,
						    .objects = bus.objects[index],
						    .reads = bus.reads[index]};
	bus.slaves[index] = (struct slave){.unit = unit,
					   .present = unit != MODBUS_BROADCAST || is_framed(),
					   .missing = -1,
					   .deaf = -1,
					   .reaction_ns = REACTION_NS};
	for (uint16_t i = 0; i < ADDRESSES; i++)
		bus.slaves[index].registers[i] = (uint16_t)(256 * unit + i);
}

void add_objects(uint8_t function, uint16_t address, uint16_t count)
{
	uint32_t index = bus.line.device_count - 1;
	struct modbus_device *device = &bus.devices[index];

	for (uint16_t i = 0; i < count; i++)
		bus.objects[index][device->object_count++] =
		    (struct modbus_object){TAG_OF_OBJECT, (uint16_t)(address + i), function & 15u, 1, 0, 0};
}

void add_kept(uint8_t function, uint16_t address, uint16_t value, int64_t period_ns, uint32_t tag)
{
	uint32_t index = bus.line.device_count - 1;
	struct modbus_device *device = &bus.devices[index];

	device->kept = bus.kept[index];
	bus.constants[index][device->kept_count] =
	    (struct modbus_request){device->unit, function, address, 1, {value}};
	device->kept[device->kept_count] = (struct modbus_kept){
	    .tag = tag,
	    .period_ns = period_ns,
	    .constants = function != 0 ? &bus.constants[index][device->kept_count] : NULL,
	    .constant_count = function != 0,
	};
	device->kept_count++;
}

void add_identity(void)
{
	uint32_t index = bus.line.device_count - 1;

	bus.devices[index].identity = &bus.identities[index];
}

void start(void)
{
	modbus_line_init(&bus.line);
	modbus_line_open(&bus.line, bus.now_ns);
	bus.connections = 1;
	bus.connected_ns = bus.now_ns;
}

void start_simple(uint8_t retries)
{
	set_up();
	add_device(17, retries);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	assert_true(bus.devices[0].alive);
	forget_trace();
}

void expect_late_answers_apart(void)
{
	add_device(17, 3);
	for (uint16_t far = 0; far < 3; far++)
		add_objects(MODBUS_READ_HOLDING_REGISTERS, (uint16_t)(300 * far), 1);
	start();
	run_for(SECOND);
	for (unsigned i = 0; i < 20; i++) {
		bus.slaves[0].late = 1;
		bus.slaves[0].late_ns = TIMEOUT_NS + 7 * MS + i * 11 * MS;
		run_for(3 * SECOND);
	}
	assert_true(bus.devices[0].alive);
	assert_true(bus.line.counters.late_answers >= 20);
}

void command(uint32_t device, uint8_t function, uint16_t address, uint16_t value, uint32_t tag)
{
	struct modbus_command order = {.device = device,
				       .tag = tag,
				       .deadline_ns = bus.now_ns + 10 * SECOND,
				       .read_function = modbus_is_bit_function(function)
							    ? MODBUS_READ_COILS
							    : MODBUS_READ_HOLDING_REGISTERS,
				       .read_address = address,
				       .request = {bus.devices[device].unit, function, address, 1, {value}}};

	assert_true(modbus_line_command(&bus.line, &order));
}

bool pass(uint32_t device, const uint8_t *body, size_t length, uint32_t tag)
{
	struct modbus_passed passed = {
	    .device = device, .tag = tag, .deadline_ns = bus.now_ns + 5 * SECOND, .length = length};

	memcpy(passed.body, body, length);
	return modbus_line_pass(&bus.line, &passed);
}

unsigned sent_with(uint8_t unit, uint8_t function)
{
	unsigned count = 0;

	for (size_t i = 0; i < bus.sent_count; i++)
		count += bus.sent[i].request.unit == unit && bus.sent[i].request.function == function;
	return count;
}
