/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A line and its devices in virtual time: the bus delivers bytes one by one, at the speed of the wire. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "modbus/line.h"

#define MS            1000000LL
#define SECOND        1000000000LL
#define DEVICES_MAX   3
#define OBJECTS_MAX   64
#define ADDRESSES     1024
#define COMMANDS_MAX  8
#define WIRE_MAX      8192
#define TRACE_MAX     4096
#define TIMEOUT_NS    (100 * MS)
#define REACTION_NS   (5 * MS)
#define TAG_OF_OBJECT 1000

enum fault {
	SOUND,
	MUTE,
	CORRUPT,    /* a bit of the data */
	TRUNCATED,  /* its last two bytes are missing */
	WRONG_UNIT, /* the rest, CRC included, is sound */
	WRONG_FUNCTION,
	WRONG_LENGTH,   /* a byte more than asked for */
	NOISE_BEFORE,   /* three bytes, then the answer */
	STRANGER_FIRST, /* another unit's sound answer, then the right one */
};

/* A device: it answers one request after the other. Register a holds 256 * unit + a, coil a is a % 3 == 0. */
struct slave {
	uint8_t unit;
	bool present;
	enum fault fault;
	unsigned faults;     /* how many answers it spoils */
	int64_t reaction_ns; /* request to answer */
	unsigned late;       /* how many answers take late_ns */
	int64_t late_ns;
	int64_t free_ns;   /* when it has dealt with all so far */
	uint8_t exception; /* its answer to everything, when not 0 */
	int missing;       /* address it answers with exception 2; -1: none */
	int deaf;          /* address it does not answer to when read together with others */
	uint16_t registers[ADDRESSES];
};

struct wire_byte {
	int64_t time_ns;
	uint8_t byte;
};

struct sent {
	int64_t time_ns;
	struct modbus_request request;
};

struct bus {
	struct modbus_line line;
	struct modbus_device devices[DEVICES_MAX];
	struct modbus_object objects[DEVICES_MAX][OBJECTS_MAX];
	struct modbus_read reads[DEVICES_MAX][OBJECTS_MAX];
	struct modbus_command commands[COMMANDS_MAX];
	struct slave slaves[DEVICES_MAX];
	struct wire_byte wire[WIRE_MAX];
	size_t wire_count;
	int64_t now_ns;
	int64_t busy_ns; /* end of the last character on the wire */
	bool echoing;    /* the transceiver hears what it sends */
	uint32_t chance; /* not 0: the process runs late, at random */
	unsigned still;  /* polls in a row that neither sent nor let time pass */
	struct sent sent[TRACE_MAX];
	size_t sent_count;
	unsigned reads_done[DEVICES_MAX], objects_read[DEVICES_MAX];
	uint64_t refused_addresses[DEVICES_MAX];                    /* a bit each */
	int64_t last_read_ns[DEVICES_MAX], longest_ns[DEVICES_MAX]; /* between two reads */
	unsigned deaths[DEVICES_MAX], births[DEVICES_MAX];
	int64_t died_ns[DEVICES_MAX];
	unsigned commands_done;
	uint32_t last_tag;
	enum modbus_result last_result;
	uint8_t last_exception;
	uint32_t tags[16];
};

static struct bus bus;

/* ---- what the line tells ---------------------------------------------------------------------- */

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
		bus.refused_addresses[device] |= 1ULL << bus.objects[device][read->first + i].address;
}

static void on_alive(void *context, uint32_t device, bool alive, int64_t now_ns)
{
	(void)context;
	if (alive) {
		bus.births[device]++;
	} else {
		bus.deaths[device]++;
		bus.died_ns[device] = now_ns;
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

static const struct modbus_events events = {on_read, on_refused, on_alive, on_command};

/* ---- the devices ------------------------------------------------------------------------------- */

static void put_on_wire(int64_t time_ns, const uint8_t *bytes, size_t length)
{
	assert_true(bus.wire_count + length <= WIRE_MAX);
	for (size_t i = 0; i < length; i++) {
		size_t at = bus.wire_count++;

		time_ns += bus.line.wire.char_ns;
		for (; at > 0 && bus.wire[at - 1].time_ns > time_ns; at--)
			bus.wire[at] = bus.wire[at - 1];
		bus.wire[at] = (struct wire_byte){time_ns, bytes[i]};
	}
}

static size_t seal(uint8_t *frame, size_t length)
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

static uint8_t exception_for(const struct slave *slave, const struct modbus_request *request)
{
	if (slave->exception)
		return slave->exception;
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
	for (uint16_t i = 0; i < request->count; i++)
		slave->registers[request->address + i] = request->values[i];
	memcpy(frame, bytes, 6);
	return seal(frame, 6);
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
		frame[3] ^= 0x10;
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
		frame[2]++;
		return seal(frame, length - 1);
	case NOISE_BEFORE:
		memmove(frame + 3, frame, length);
		frame[0] = frame[1] = frame[2] = 0xFF;
		return length + 3;
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

static void slave_takes(struct slave *slave, const struct modbus_request *request, const uint8_t *bytes)
{
	uint8_t frame[2 * MODBUS_FRAME_MAX];
	int64_t start = bus.busy_ns > slave->free_ns ? bus.busy_ns : slave->free_ns;

	if (!slave->present || (request->unit != slave->unit && request->unit != MODBUS_BROADCAST))
		return;
	if (covers(request, slave->deaf) && request->count > 1)
		return;
	size_t length = answer_of(slave, request, bytes, frame);
	if (request->unit == MODBUS_BROADCAST)
		return;
	length = spoil(slave, frame, length);
	if (length == 0)
		return;
	start += slave->reaction_ns;
	if (slave->late > 0) {
		slave->late--;
		start += slave->late_ns;
	}
	put_on_wire(start, frame, length);
	slave->free_ns = start + (int64_t)length * bus.line.wire.char_ns;
}

/* ---- the bus ------------------------------------------------------------------------------------- */

static struct modbus_request parse(const uint8_t *bytes, size_t length)
{
	struct modbus_request request = {bytes[0], bytes[1], modbus_register(bytes, 1), 1, {0}};

	assert_true(modbus_crc_valid(bytes, length));
	switch (request.function) {
	case MODBUS_WRITE_COIL:
		request.values[0] = bytes[4] ? 1 : 0;
		break;
	case MODBUS_WRITE_REGISTER:
		request.values[0] = modbus_register(bytes, 2);
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
	bus.busy_ns = bus.now_ns + (int64_t)output->length * bus.line.wire.char_ns;
	struct modbus_request request = parse(output->frame, output->length);
	if (bus.sent_count < TRACE_MAX)
		bus.sent[bus.sent_count++] = (struct sent){bus.now_ns, request};
	for (uint32_t i = 0; i < bus.line.device_count; i++)
		slave_takes(&bus.slaves[i], &request, output->frame);
}

/* What has arrived by now comes in one piece. */
static void deliver(void)
{
	uint8_t bytes[WIRE_MAX];
	size_t count = 0;

	for (; count < bus.wire_count && bus.wire[count].time_ns <= bus.now_ns; count++) {
		bytes[count] = bus.wire[count].byte;
		if (bus.wire[count].time_ns > bus.busy_ns)
			bus.busy_ns = bus.wire[count].time_ns;
	}
	bus.wire_count -= count;
	memmove(&bus.wire[0], &bus.wire[count], bus.wire_count * sizeof(bus.wire[0]));
	modbus_line_receive(&bus.line, bytes, count, bus.now_ns);
}

static uint32_t random_next(uint32_t *seed)
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

static void run_until(int64_t until_ns)
{
	for (;;) {
		struct modbus_output output = modbus_line_poll(&bus.line, bus.now_ns);

		take_output(&output);
		int64_t next_ns = output.deadline_ns;
		if (bus.wire_count > 0 && bus.wire[0].time_ns <= next_ns)
			next_ns = bus.wire[0].time_ns;
		if (next_ns > until_ns)
			break;
		bus.still = output.length == 0 && next_ns <= bus.now_ns ? bus.still + 1 : 0;
		assert_true(bus.still < 3);
		if (next_ns > bus.now_ns)
			bus.now_ns = next_ns;
		bus.now_ns += delay();
		deliver();
	}
	if (until_ns > bus.now_ns)
		bus.now_ns = until_ns;
}

static void run_for(int64_t ns)
{
	run_until(bus.now_ns + ns);
}

static void forget_trace(void)
{
	bus.sent_count = 0;
	memset(bus.reads_done, 0, sizeof(bus.reads_done));
	memset(bus.objects_read, 0, sizeof(bus.objects_read));
	memset(bus.longest_ns, 0, sizeof(bus.longest_ns));
	memset(&bus.line.counters, 0, sizeof(bus.line.counters));
}

static void set_up(void)
{
	memset(&bus, 0, sizeof(bus));
	bus.now_ns = 5 * SECOND;
	bus.line = (struct modbus_line){.events = &events,
					.context = &bus,
					.devices = bus.devices,
					.commands = bus.commands,
					.command_capacity = COMMANDS_MAX,
					.wire = modbus_wire(19200, 11)};
}

static void add_device(uint8_t unit, uint8_t retries)
{
	uint32_t index = bus.line.device_count++;

	bus.devices[index] = (struct modbus_device){.unit = unit,
						    .retries = retries,
						    .response_timeout_ns = TIMEOUT_NS,
						    .objects = bus.objects[index],
						    .reads = bus.reads[index]};
	bus.slaves[index] = (struct slave){.unit = unit,
					   .present = unit != MODBUS_BROADCAST,
					   .missing = -1,
					   .deaf = -1,
					   .reaction_ns = REACTION_NS};
	for (uint16_t i = 0; i < ADDRESSES; i++)
		bus.slaves[index].registers[i] = (uint16_t)(256 * unit + i);
}

static void add_objects(uint8_t function, uint16_t address, uint16_t count)
{
	uint32_t index = bus.line.device_count - 1;
	struct modbus_device *device = &bus.devices[index];

	for (uint16_t i = 0; i < count; i++)
		bus.objects[index][device->object_count++] =
		    (struct modbus_object){TAG_OF_OBJECT, (uint16_t)(address + i), function, 1};
}

static void start(void)
{
	modbus_line_init(&bus.line);
	modbus_line_open(&bus.line, bus.now_ns);
}

/* One device with eight holding registers, scanned at least once. */
static void start_simple(uint8_t retries)
{
	set_up();
	add_device(17, retries);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	assert_true(bus.devices[0].alive);
	forget_trace();
}

static void command(uint32_t device, uint8_t function, uint16_t address, uint16_t value, uint32_t tag)
{
	struct modbus_command order = {.device = device,
				       .tag = tag,
				       .deadline_ns = bus.now_ns + 10 * SECOND,
				       .request = {bus.devices[device].unit, function, address, 1, {value}}};

	assert_true(modbus_line_command(&bus.line, &order));
}

static unsigned sent_with(uint8_t unit, uint8_t function)
{
	unsigned count = 0;

	for (size_t i = 0; i < bus.sent_count; i++)
		count += bus.sent[i].request.unit == unit && bus.sent[i].request.function == function;
	return count;
}

/* ---- polling ----------------------------------------------------------------------------------------- */

static void devices_are_scanned_in_turn(void **state)
{
	(void)state;
	set_up();
	add_device(1, 1);
	add_objects(MODBUS_READ_COILS, 0, 10);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 3);
	add_device(2, 1);
	add_objects(MODBUS_READ_INPUT_REGISTERS, 4, 2);
	start();
	run_for(10 * SECOND);
	assert_true(bus.reads_done[0] > 200);
	assert_in_range(bus.reads_done[0], 2 * bus.reads_done[1] - 2, 2 * bus.reads_done[1] + 2);
	assert_int_equal(bus.births[0], 1);
	assert_int_equal(bus.deaths[0] + bus.deaths[1], 0);
	assert_int_equal(bus.devices[0].read_count, 2);
	assert_int_equal(bus.line.counters.timeouts + bus.line.counters.crc_errors, 0);
	/* 19200 8E1: 24 + 7 + 11 + 9 characters of 573 us, 3 reactions of 5 ms, 2 silences of 2 ms between */
	assert_in_range(bus.line.counters.scan_us, 48200, 48300);
	assert_in_range(bus.devices[0].counters.latency_us, 5000, 6000);
}

/* take_output asserts the silence before every request; here: that it is not longer than needed either. */
static void silence_is_three_and_a_half_characters(void **state)
{
	(void)state;
	start_simple(0);
	run_for(SECOND);
	int64_t period = bus.sent[1].time_ns - bus.sent[0].time_ns;
	int64_t characters = 8 + 5 + 2 * 8;
	assert_int_equal(period, characters * bus.line.wire.char_ns + REACTION_NS + bus.line.wire.silence_ns);
}

static void a_broadcast_device_is_never_read(void **state)
{
	(void)state;
	set_up();
	add_device(MODBUS_BROADCAST, 0);
	add_objects(MODBUS_READ_COILS, 0, 4);
	start();
	run_for(10 * SECOND);
	assert_int_equal(bus.sent_count, 0);
}

static void nothing_is_sent_before_open_or_after_close(void **state)
{
	(void)state;
	start_simple(0);
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.deaths[0], 1);
	run_for(10 * SECOND);
	assert_int_equal(bus.sent_count, 0);
	assert_false(modbus_line_command(&bus.line, &(struct modbus_command){0}));
	modbus_line_open(&bus.line, bus.now_ns);
	run_for(SECOND);
	assert_int_equal(bus.births[0], 2);
	assert_true(bus.reads_done[0] > 10);
}

/*
 * ---- every error class
 * -----------------------------------------------------------------------------------
 */

static void spoil_one(enum fault fault)
{
	start_simple(1);
	bus.slaves[0].fault = fault;
	bus.slaves[0].faults = 1;
	run_for(3 * SECOND);
	assert_int_equal(bus.slaves[0].faults, 0);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.devices[0].alive);
	assert_true(bus.reads_done[0] > 10);
}

static void a_lost_answer_is_read_again(void **state)
{
	(void)state;
	spoil_one(MUTE);
	assert_int_equal(bus.line.counters.timeouts, 1);
	/* after the time-out something short that no late answer looks like, then the read again */
	assert_int_equal(bus.sent[1].request.count, 1);
	assert_int_equal(bus.sent[2].request.count, 8);
	assert_true(bus.sent[1].time_ns - bus.sent[0].time_ns < TIMEOUT_NS + 10 * MS);
}

static void a_corrupt_answer_is_read_again(void **state)
{
	(void)state;
	spoil_one(CORRUPT);
	assert_int_equal(bus.line.counters.crc_errors, 1);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_int_equal(bus.devices[0].counters.errors, 1);
}

static void a_truncated_answer_is_read_again(void **state)
{
	(void)state;
	spoil_one(TRUNCATED);
	assert_int_equal(bus.line.counters.crc_errors, 1);
	assert_int_equal(bus.line.counters.noise_bytes, 0);
}

static void another_units_answer_is_not_taken(void **state)
{
	(void)state;
	spoil_one(WRONG_UNIT);
	assert_int_equal(bus.line.counters.wrong_answers, 1);
	assert_int_equal(bus.line.counters.timeouts, 1);
}

static void another_functions_answer_is_not_taken(void **state)
{
	(void)state;
	spoil_one(WRONG_FUNCTION);
	assert_int_equal(bus.line.counters.wrong_answers, 1);
}

static void another_lengths_answer_is_not_taken(void **state)
{
	(void)state;
	spoil_one(WRONG_LENGTH);
	assert_int_equal(bus.line.counters.wrong_answers, 1);
}

static void noise_before_an_answer_does_not_hide_it(void **state)
{
	(void)state;
	spoil_one(NOISE_BEFORE);
	assert_int_equal(bus.line.counters.noise_bytes, 3);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_in_range(bus.line.counters.answers, bus.sent_count - 1, bus.sent_count + 1);
}

static void a_strangers_frame_does_not_hide_the_answer(void **state)
{
	(void)state;
	spoil_one(STRANGER_FIRST);
	assert_int_equal(bus.line.counters.wrong_answers, 1);
	assert_int_equal(bus.line.counters.timeouts, 0);
}

static void noise_between_frames_delays_the_next_request(void **state)
{
	(void)state;
	start_simple(0);
	modbus_line_close(&bus.line, bus.now_ns);
	bus.wire_count = 0;
	modbus_line_open(&bus.line, bus.now_ns);
	put_on_wire(bus.now_ns + 30 * MS, (const uint8_t[]){1, 2, 3}, 3);
	run_for(200 * MS);
	assert_int_equal(bus.line.counters.noise_bytes, 3);
	assert_true(bus.sent[0].time_ns >= bus.now_ns - 200 * MS + 30 * MS + MODBUS_GAP_NS);
}

/* A line that babbles is not sent on, and its devices are not good. */
static void a_babbling_line_is_given_up(void **state)
{
	(void)state;
	start_simple(3);
	int64_t began = bus.now_ns;
	for (int i = 0; i < 200; i++)
		put_on_wire(began + i * 20 * MS, (const uint8_t[]){0xAA}, 1);
	run_for(3500 * MS);
	assert_int_equal(bus.deaths[0], 1);
	assert_true(bus.died_ns[0] - began < 2 * SECOND);
	assert_true(bus.sent_count <= 2);
	run_for(10 * SECOND);
	assert_true(bus.devices[0].alive);
}

/*
 * ---- a line that hears itself
 * ----------------------------------------------------------------------------
 */

static void an_echo_is_not_a_confirmation(void **state)
{
	(void)state;
	start_simple(3);
	bus.echoing = true;
	run_for(SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.reads_done[0] > 10);
	assert_int_equal(bus.devices[0].counters.errors, 0);
	command(0, MODBUS_WRITE_REGISTER, 3, 900, 1);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 900);
	bus.slaves[0].missing = 60;
	command(0, MODBUS_WRITE_REGISTER, 60, 1, 2);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_REFUSED);
	bus.slaves[0].present = false;
	command(0, MODBUS_WRITE_COIL, 3, 1, 3);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	assert_int_equal(bus.commands_done, 3);
	bus.slaves[0].present = true;
	bus.echoing = false;
	run_for(3 * SECOND);
	command(0, MODBUS_WRITE_REGISTER, 3, 901, 4);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_DONE);
}

/* Noise may hide an echo, and the line hears itself all the same. */
static void one_lost_echo_does_not_make_the_next_a_confirmation(void **state)
{
	(void)state;
	start_simple(3);
	bus.echoing = true;
	run_for(SECOND);
	bus.echoing = false;
	for (unsigned reads = bus.reads_done[0]; bus.reads_done[0] < reads + 2;)
		run_for(MS);
	bus.echoing = true;
	bus.slaves[0].present = false;
	command(0, MODBUS_WRITE_REGISTER, 3, 900, 1);
	run_for(SECOND);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
}

/* The request 17 1 3 0 0 24 looks like the answer with the three data bytes 0, 0, 24. */
static void an_echo_is_not_a_value(void **state)
{
	(void)state;
	set_up();
	add_device(17, 1);
	add_objects(MODBUS_READ_COILS, 0x0300, 24);
	bus.echoing = true;
	start();
	run_for(SECOND);
	assert_int_equal(bus.sent[bus.sent_count - 1].request.count, 24);
	assert_true(bus.reads_done[0] > 10);
}

/* Without an echo it is the answer. */
static void a_value_is_not_an_echo(void **state)
{
	(void)state;
	set_up();
	add_device(17, 1);
	add_objects(MODBUS_READ_COILS, 0x0300, 24);
	for (uint16_t bit = 0; bit < 24; bit++)
		bus.slaves[0].registers[0x0300 + bit] = !(bit == 19 || bit == 20);
	start();
	run_for(SECOND);
	assert_int_equal(bus.sent[bus.sent_count - 1].request.count, 24);
	assert_true(bus.reads_done[0] > 10);
	assert_int_equal(bus.line.counters.timeouts, 0);
}

/*
 * ---- late answers
 * ----------------------------------------------------------------------------------------
 */

/* Two reads of one length: the answer to the first comes while the second would be under way. */
static void a_late_answer_is_never_anothers(void **state)
{
	(void)state;
	set_up();
	add_device(17, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 4);
	start();
	run_for(SECOND);
	assert_int_equal(bus.devices[0].read_count, 2);
	for (int64_t late = 80; late < 400; late += 3) {
		forget_trace();
		bus.slaves[0].late = 1;
		bus.slaves[0].late_ns = late * MS;
		run_for(3 * SECOND);
		assert_true(bus.devices[0].alive);
		assert_true(bus.reads_done[0] > 20);
	}
}

static void a_late_answer_is_counted(void **state)
{
	(void)state;
	start_simple(2);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 105 * MS;
	run_for(2 * SECOND);
	assert_int_equal(bus.line.counters.late_answers, 1);
	assert_int_equal(bus.line.counters.timeouts, 1);
	assert_int_equal(bus.line.counters.wrong_answers, 0);
}

/* The process was killed with a request under way; the next one has the port before the answer comes. */
static void a_killed_processs_answer_is_nobodys(void **state)
{
	(void)state;
	set_up();
	add_device(17, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 1);
	start();
	run_for(3 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 2);
	for (int64_t late = 0; late < 300; late++) {
		bus.slaves[0].late = 1;
		bus.slaves[0].late_ns = late * MS;
		run_for(25 * MS);
		modbus_line_close(&bus.line, bus.now_ns);
		bus.devices[0].unanswered_count = 0; /* a new process knows nothing */
		bus.devices[0].trust_ns = 0;
		forget_trace();
		modbus_line_open(&bus.line, bus.now_ns);
		run_for(3 * SECOND);
		assert_true(bus.devices[0].alive);
		assert_true(bus.reads_done[0] > 20);
	}
}

/* It may still come when nothing but another device's silence was waited for since. */
static void a_killed_processs_confirmation_is_nobodys(void **state)
{
	(void)state;
	start_simple(0);
	add_device(18, 0);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	bus.slaves[1].present = false;
	bus.devices[0].response_timeout_ns = bus.devices[1].response_timeout_ns = 2 * SECOND;
	start();
	run_for(3 * SECOND);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 2500 * MS;
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	while (sent_with(17, MODBUS_WRITE_REGISTER) == 0)
		run_for(MS);
	modbus_line_close(&bus.line, bus.now_ns);
	for (int i = 0; i < 2; i++) {
		bus.devices[i].unanswered_count = 0; /* a new process knows nothing */
		bus.devices[i].trust_ns = 0;
	}
	bus.slaves[0].exception = 4;
	modbus_line_open(&bus.line, bus.now_ns);
	bus.devices[0].next_probe_ns += 5 * SECOND; /* the other one is probed first */
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 2);
	run_for(6 * SECOND);
	assert_int_equal(bus.last_tag, 2);
	assert_int_equal(bus.last_result, MODBUS_REFUSED);
}

/* A process that was stopped finds an answer, and cannot know how old its values are. */
static void an_old_answer_is_no_news(void **state)
{
	(void)state;
	start_simple(3);
	while (bus.sent_count == 0)
		run_for(MS);
	bus.slaves[0].registers[4] = 1; /* on_read knows the new value only */
	bus.now_ns += 2 * SECOND;
	deliver();
	run_for(SECOND);
	assert_int_equal(bus.line.counters.timeouts, 1);
	assert_int_equal(bus.line.counters.late_answers, 1);
	assert_true(bus.reads_done[0] > 10);
}

/*
 * Nothing that could be asked has an unmistakable answer, and an object that was refused comes due: time
 * must pass all the same (run_until).
 */
static void a_device_that_rests_is_at_rest(void **state)
{
	(void)state;
	set_up();
	add_device(17, 9);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 1);
	bus.slaves[0].missing = 40;
	start();
	run_for(700 * MS);
	assert_int_equal(bus.refused_addresses[0], 1ULL << 40);
	bus.slaves[0].fault = MUTE;
	bus.slaves[0].faults = 1;
	while (bus.slaves[0].faults > 0)
		run_for(MS);
	bus.slaves[0].exception = 2;
	run_for(500 * MS);
	bus.slaves[0].exception = 0;
	bus.slaves[0].missing = -1;
	run_for(5 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 2);
	assert_true(bus.devices[0].alive);
}

/*
 * Where all objects are one register, something longer is read; a device that refuses that rests until
 * nothing can come.
 */
static void a_device_with_one_object_rests(void **state)
{
	(void)state;
	set_up();
	add_device(17, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	bus.slaves[0].missing = 1;
	start();
	run_for(SECOND);
	forget_trace();
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 130 * MS;
	run_for(3 * SECOND);
	assert_int_equal(bus.sent[1].request.count, 2);
	assert_in_range(bus.sent[2].time_ns - bus.sent[1].time_ns, MODBUS_LATE_NS,
			MODBUS_LATE_NS + TIMEOUT_NS);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.reads_done[0] > 10);
}

static void a_late_confirmation_is_not_another_commands(void **state)
{
	(void)state;
	start_simple(2);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 150 * MS;
	bus.slaves[0].exception = 4;
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 2);
	run_for(60 * MS);
	bus.slaves[0].exception = 0;
	run_for(SECOND);
	assert_int_equal(bus.commands_done, 2);
	assert_int_equal(bus.tags[0], 1);
	assert_int_equal(bus.last_tag, 2);
	assert_int_equal(bus.last_result, MODBUS_DONE);
}

/*
 * ---- dead devices
 * --------------------------------------------------------------------------------------------
 */

static void a_dead_device_is_probed_ever_more_rarely(void **state)
{
	(void)state;
	start_simple(1);
	bus.slaves[0].present = false;
	int64_t unplugged = bus.now_ns;
	run_for(400 * SECOND);
	assert_int_equal(bus.deaths[0], 1);
	/* at most an answer under way, then a read and one repetition */
	assert_true(bus.died_ns[0] - unplugged < 2 * TIMEOUT_NS + 60 * MS);
	const int64_t seconds[] = {1, 2, 4, 8, 16, 32, 60, 60, 60, 60};
	size_t probe = 0;
	while (bus.sent[probe].time_ns <= bus.died_ns[0])
		probe++;
	int64_t before = bus.died_ns[0];
	for (size_t i = 0; i < sizeof(seconds) / sizeof(seconds[0]); i++, probe++) {
		int64_t pause = bus.sent[probe].time_ns - before;

		assert_in_range(pause, seconds[i] * SECOND, seconds[i] * SECOND + 130 * MS);
		assert_int_equal(bus.sent[probe].request.count, 1);
		before = bus.sent[probe].time_ns;
	}
	assert_int_equal(bus.devices[0].backoff_ns, 60 * SECOND);
}

static void a_device_that_returns_is_scanned_at_once(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].present = false;
	run_for(10 * SECOND);
	bus.slaves[0].present = true;
	forget_trace();
	run_for(10 * SECOND);
	assert_int_equal(bus.births[0], 2);
	assert_int_equal(bus.devices[0].backoff_ns, 0);
	assert_int_equal(bus.sent[0].request.count, 1);
	assert_int_equal(bus.sent[1].request.count, 8);
	assert_true(bus.sent[1].time_ns - bus.sent[0].time_ns < 30 * MS);
}

static void a_dead_device_delays_its_line_by_its_probes_only(void **state)
{
	(void)state;
	set_up();
	add_device(1, 3);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	add_device(2, 3);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	bus.slaves[0].present = false;
	run_for(60 * SECOND);
	forget_trace();
	run_for(60 * SECOND);
	assert_in_range(sent_with(1, MODBUS_READ_HOLDING_REGISTERS), 1, 2);
	/* two seconds' worth less than a line of its own would give */
	assert_true(bus.reads_done[1] > 58 * 1000 / 25);
	assert_int_equal(bus.deaths[1], 0);
}

/* Of many dead devices one at a time is probed: between two probes without an answer, the others are read. */
static void dead_devices_are_probed_one_a_scan(void **state)
{
	(void)state;
	set_up();
	for (uint8_t unit = 1; unit <= DEVICES_MAX; unit++) {
		add_device(unit, 0);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
		bus.slaves[unit - 1].present = unit == 3;
	}
	start();
	run_for(30 * SECOND);
	assert_int_equal(bus.line.counters.timeouts, 2 * 5); /* 0, 1, 3, 7, 15 seconds after the start */
	assert_in_range(bus.longest_ns[2], TIMEOUT_NS, TIMEOUT_NS + 50 * MS);
	bus.slaves[0].present = bus.slaves[1].present = true;
	run_for(33 * SECOND);
	assert_true(bus.devices[0].alive && bus.devices[1].alive);
}

static void writes_are_never_repeated(void **state)
{
	(void)state;
	start_simple(3);
	bus.slaves[0].present = false;
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	run_for(30 * SECOND);
	assert_int_equal(sent_with(17, MODBUS_WRITE_REGISTER), 1);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	/* a dead device is tried, once */
	assert_false(bus.devices[0].alive);
	bus.slaves[0].present = true;
	command(0, MODBUS_WRITE_REGISTER, 3, 8, 2);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.slaves[0].registers[3], 8);
}

/*
 * ---- exceptions
 * --------------------------------------------------------------------------------------------------
 */

static void a_refused_read_is_halved_down_to_the_object(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].missing = 5;
	run_for(2 * SECOND);
	assert_int_equal(bus.refused_addresses[0], 1u << 5);
	assert_int_equal(bus.last_exception, 2);
	assert_int_equal(bus.devices[0].read_count, 4); /* 0-3, 4, 5, 6-7 */
	assert_int_equal(bus.deaths[0], 0);
	run_for(200 * SECOND);
	forget_trace();
	bus.refused_addresses[0] = 0;
	run_for(120 * SECOND);
	assert_int_equal(bus.line.counters.exceptions, 2); /* asked again, rarely */
	assert_int_equal(bus.refused_addresses[0], 0);     /* which is not news */
	assert_true(bus.objects_read[0] > 7 * 1000);
	bus.slaves[0].missing = -1;
	run_for(61 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 1); /* given at last: whole again */
}

static void all_objects_refused_leaves_a_living_device(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].exception = 1;
	run_for(200 * SECOND);
	assert_int_equal(bus.refused_addresses[0], 0xFF);
	assert_true(bus.devices[0].alive);
	forget_trace();
	run_for(60 * SECOND);
	assert_int_equal(bus.sent_count, 8);
	bus.slaves[0].exception = 0;
	run_for(61 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 1);
	assert_true(bus.reads_done[0] > 100);
}

static void a_busy_device_is_not_split(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].exception = 6;
	run_for(4 * SECOND);
	assert_int_equal(bus.devices[0].read_count, 1);
	assert_int_equal(bus.refused_addresses[0], 0xFF);
	assert_int_equal(bus.last_exception, 6);
	assert_in_range(bus.line.counters.exceptions, 3, 4);
	bus.slaves[0].exception = 0;
	run_for(5 * SECOND);
	assert_true(bus.reads_done[0] > 10);
}

static void a_device_that_was_gone_is_planned_anew(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].missing = 5;
	run_for(130 * SECOND); /* it is asked for what it refused each minute only */
	assert_int_equal(bus.devices[0].read_count, 4);
	bus.slaves[0].present = false;
	run_for(2 * SECOND);
	bus.slaves[0].present = true;
	bus.slaves[0].missing = -1;
	run_for(3 * SECOND);
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.devices[0].read_count, 1);
}

static void one_lost_answer_does_not_split_a_read(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].fault = MUTE;
	bus.slaves[0].faults = 1;
	run_for(3 * SECOND);
	assert_int_equal(bus.deaths[0], 1);
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.devices[0].read_count, 1);
}

/* Some devices do not answer a read over an address they do not have. They are not dead. */
static void a_silent_read_is_halved_too(void **state)
{
	(void)state;
	for (uint8_t retries = 0; retries < 5; retries++) {
		start_simple(retries);
		bus.slaves[0].deaf = 5;
		run_for(20 * SECOND);
		assert_true(bus.devices[0].alive);
		assert_int_equal(bus.devices[0].read_count, 4);
		forget_trace();
		run_for(SECOND);
		assert_int_equal(bus.line.counters.timeouts, 0);
		assert_true(bus.objects_read[0] > 8 * 5);
	}
}

/*
 * ---- commands ---------------------------------------------------------------------------------------
 * ---------------
 */

static void commands_go_ahead_of_polling_in_order(void **state)
{
	(void)state;
	start_simple(0);
	for (uint16_t i = 0; i < 4; i++)
		command(0, MODBUS_WRITE_REGISTER, i, (uint16_t)(900 + i), 10u + i);
	run_for(300 * MS);
	assert_int_equal(bus.commands_done, 4);
	/* the read under way ends first */
	for (size_t i = 0; i < 4; i++) {
		assert_int_equal(bus.tags[i], 10 + i);
		assert_int_equal(bus.sent[i].request.function, MODBUS_WRITE_REGISTER);
	}
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 903);
}

static void a_flood_of_commands_stops_no_polling(void **state)
{
	(void)state;
	set_up();
	for (uint8_t unit = 1; unit <= 2; unit++) {
		add_device(unit, 0);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	}
	start();
	run_for(SECOND);
	forget_trace();
	for (int i = 0; i < 300; i++) {
		while (bus.line.command_count < 3)
			command(0, MODBUS_WRITE_REGISTER, 3, (uint16_t)i, 1);
		run_for(10 * MS);
	}
	assert_true(bus.commands_done > 90);
	assert_true(bus.reads_done[1] > 4);
	assert_true(bus.longest_ns[1] < SECOND);
}

static void what_was_written_is_read_back_next(void **state)
{
	(void)state;
	set_up();
	add_device(1, 0);
	add_objects(MODBUS_READ_COILS, 0, 4);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 30, 2);
	add_device(2, 0);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	for (int round = 0; round < 5; round++) {
		run_for(7 * MS);
		forget_trace();
		command(0, MODBUS_WRITE_REGISTER, 31, 7, 1);
		run_for(200 * MS);
		size_t i = 0;
		while (bus.sent[i].request.function != MODBUS_WRITE_REGISTER)
			i++;
		assert_int_equal(bus.sent[i + 1].request.unit, 1);
		assert_int_equal(bus.sent[i + 1].request.address, 30);
	}
}

static void a_refused_command_tells_why(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].missing = 60;
	command(0, MODBUS_WRITE_REGISTER, 60, 1, 1);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_REFUSED);
	assert_int_equal(bus.last_exception, 2);
}

static void a_command_past_its_deadline_is_not_sent(void **state)
{
	(void)state;
	start_simple(0);
	struct modbus_command old = {.deadline_ns = bus.now_ns - 1,
				     .request = {17, MODBUS_WRITE_REGISTER, 0, 1, {1}}};
	assert_true(modbus_line_command(&bus.line, &old));
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_TOO_OLD);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(sent_with(17, MODBUS_WRITE_REGISTER), 0);
}

static void the_queue_has_an_end(void **state)
{
	(void)state;
	start_simple(0);
	struct modbus_command order = {.deadline_ns = bus.now_ns + SECOND,
				       .request = {17, MODBUS_WRITE_REGISTER, 0, 1, {1}}};
	for (int i = 0; i < COMMANDS_MAX; i++)
		assert_true(modbus_line_command(&bus.line, &order));
	assert_false(modbus_line_command(&bus.line, &order));
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.commands_done, COMMANDS_MAX);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
}

static void a_broadcast_is_done_after_its_turnaround(void **state)
{
	(void)state;
	start_simple(0);
	add_device(MODBUS_BROADCAST, 0);
	command(1, MODBUS_WRITE_REGISTER, 6, 4321, 9);
	run_for(100 * MS);
	assert_int_equal(bus.commands_done, 0);
	run_for(130 * MS);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[6], 4321);
	size_t i = 0;
	while (bus.sent[i].request.unit != MODBUS_BROADCAST)
		i++;
	assert_int_equal(bus.sent[i + 1].time_ns - bus.sent[i].time_ns,
			 8 * bus.line.wire.char_ns + MODBUS_BROADCAST_NS);
	assert_int_equal(bus.line.counters.timeouts, 0);
}

/* Nobody answers a broadcast: it need not wait for anybody's missing answer. */
static void a_broadcast_goes_out_at_once(void **state)
{
	(void)state;
	set_up();
	add_device(MODBUS_BROADCAST, 0);
	add_objects(MODBUS_READ_COILS, 0, 4);
	start();
	command(0, MODBUS_WRITE_COIL, 0, 1, 1);
	run_for(200 * MS);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
}

/* Whoever commands a device that never answered gets an answer all the same. */
static void a_device_that_never_answered_is_commanded(void **state)
{
	(void)state;
	set_up();
	add_device(17, 0);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	bus.slaves[0].present = false;
	start();
	command(0, MODBUS_WRITE_REGISTER, 0, 1, 1);
	run_for(3 * SECOND);
	assert_int_equal(sent_with(17, MODBUS_WRITE_REGISTER), 1);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	assert_int_equal(bus.commands_done, 1);
}

static void two_registers_are_written_in_one_request(void **state)
{
	(void)state;
	start_simple(0);
	struct modbus_command order = {.deadline_ns = bus.now_ns + SECOND,
				       .request = {17, MODBUS_WRITE_REGISTERS, 4, 2, {0x4148, 0x1234}}};
	assert_true(modbus_line_command(&bus.line, &order));
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[4], 0x4148);
	assert_int_equal(bus.slaves[0].registers[5], 0x1234);
}

/*
 * ---- random -----------------------------------------------------------------------------------------
 * -------------------
 */

/*
 * Faults of every kind at random: no value is ever another's (on_read), no command is confirmed that was
 * not executed (on_command), each ends once, all devices come back.
 */
static void a_bad_line(bool echoing, bool late_process)
{
	for (uint32_t seed = 1; seed <= 20; seed++) {
		uint32_t chance = seed;
		unsigned commands = 0;

		set_up();
		bus.echoing = echoing;
		bus.chance = late_process ? seed : 0;
		for (uint8_t unit = 1; unit <= DEVICES_MAX; unit++) {
			add_device(unit, unit);
			add_objects(MODBUS_READ_COILS, 0, 5);
			add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
			add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 4);
		}
		start();
		for (int step = 0; step < 150; step++) {
			struct slave *slave = &bus.slaves[random_next(&chance) % DEVICES_MAX];

			slave->fault = random_next(&chance) % (STRANGER_FIRST + 1);
			slave->faults = random_next(&chance) % 3;
			slave->late = random_next(&chance) % 2;
			slave->late_ns = (int64_t)(random_next(&chance) % 700) * MS;
			if (random_next(&chance) % 8 == 0) {
				uint32_t device = random_next(&chance) % DEVICES_MAX;

				command(device, MODBUS_WRITE_REGISTER, 50, (uint16_t)step, commands++);
				run_for(2 * SECOND);
			}
			bus.sent_count = 0;
			run_for((int64_t)(random_next(&chance) % 500) * MS);
		}
		for (int i = 0; i < DEVICES_MAX; i++)
			bus.slaves[i].faults = bus.slaves[i].late = 0;
		bus.sent_count = 0;
		run_for(65 * SECOND);
		assert_int_equal(bus.commands_done, commands);
		for (int i = 0; i < DEVICES_MAX; i++)
			assert_true(bus.devices[i].alive);
	}
}

static void faults_at_random(void **state)
{
	(void)state;
	a_bad_line(false, false);
}

static void faults_on_a_line_that_hears_itself(void **state)
{
	(void)state;
	a_bad_line(true, false);
}

static void faults_under_a_late_process(void **state)
{
	(void)state;
	a_bad_line(false, true);
}

/* Bytes of any kind in pieces of any size at any time: nothing breaks, and the deadline is always ahead. */
static void hostile_bytes(void **state)
{
	(void)state;
	uint32_t chance = 42;

	start_simple(1);
	for (int round = 0; round < 30000; round++) {
		uint8_t bytes[600];
		size_t length = random_next(&chance) % (round % 100 == 0 ? sizeof(bytes) : 20);

		for (size_t i = 0; i < length; i++)
			bytes[i] = (uint8_t)(random_next(&chance) % 4 ? random_next(&chance) : 17);
		if (length > 5 && random_next(&chance) % 2)
			seal(bytes, length - 2);
		bus.now_ns += (int64_t)(random_next(&chance) % 40) * MS;
		modbus_line_receive(&bus.line, bytes, length, bus.now_ns);
		struct modbus_output output = modbus_line_poll(&bus.line, bus.now_ns);
		assert_true(output.deadline_ns > bus.now_ns);
		assert_true(output.length <= MODBUS_FRAME_MAX);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(devices_are_scanned_in_turn),
	    cmocka_unit_test(silence_is_three_and_a_half_characters),
	    cmocka_unit_test(a_broadcast_device_is_never_read),
	    cmocka_unit_test(nothing_is_sent_before_open_or_after_close),
	    cmocka_unit_test(a_lost_answer_is_read_again),
	    cmocka_unit_test(a_corrupt_answer_is_read_again),
	    cmocka_unit_test(a_truncated_answer_is_read_again),
	    cmocka_unit_test(another_units_answer_is_not_taken),
	    cmocka_unit_test(another_functions_answer_is_not_taken),
	    cmocka_unit_test(another_lengths_answer_is_not_taken),
	    cmocka_unit_test(noise_before_an_answer_does_not_hide_it),
	    cmocka_unit_test(a_strangers_frame_does_not_hide_the_answer),
	    cmocka_unit_test(noise_between_frames_delays_the_next_request),
	    cmocka_unit_test(a_babbling_line_is_given_up),
	    cmocka_unit_test(an_echo_is_not_a_confirmation),
	    cmocka_unit_test(one_lost_echo_does_not_make_the_next_a_confirmation),
	    cmocka_unit_test(an_echo_is_not_a_value),
	    cmocka_unit_test(a_value_is_not_an_echo),
	    cmocka_unit_test(a_late_answer_is_never_anothers),
	    cmocka_unit_test(a_late_answer_is_counted),
	    cmocka_unit_test(a_killed_processs_answer_is_nobodys),
	    cmocka_unit_test(a_killed_processs_confirmation_is_nobodys),
	    cmocka_unit_test(an_old_answer_is_no_news),
	    cmocka_unit_test(a_device_that_rests_is_at_rest),
	    cmocka_unit_test(a_device_with_one_object_rests),
	    cmocka_unit_test(a_late_confirmation_is_not_another_commands),
	    cmocka_unit_test(a_dead_device_is_probed_ever_more_rarely),
	    cmocka_unit_test(a_device_that_returns_is_scanned_at_once),
	    cmocka_unit_test(a_dead_device_delays_its_line_by_its_probes_only),
	    cmocka_unit_test(dead_devices_are_probed_one_a_scan),
	    cmocka_unit_test(writes_are_never_repeated),
	    cmocka_unit_test(a_refused_read_is_halved_down_to_the_object),
	    cmocka_unit_test(all_objects_refused_leaves_a_living_device),
	    cmocka_unit_test(a_busy_device_is_not_split),
	    cmocka_unit_test(a_device_that_was_gone_is_planned_anew),
	    cmocka_unit_test(one_lost_answer_does_not_split_a_read),
	    cmocka_unit_test(a_silent_read_is_halved_too),
	    cmocka_unit_test(commands_go_ahead_of_polling_in_order),
	    cmocka_unit_test(a_flood_of_commands_stops_no_polling),
	    cmocka_unit_test(what_was_written_is_read_back_next),
	    cmocka_unit_test(a_refused_command_tells_why),
	    cmocka_unit_test(a_command_past_its_deadline_is_not_sent),
	    cmocka_unit_test(the_queue_has_an_end),
	    cmocka_unit_test(a_broadcast_is_done_after_its_turnaround),
	    cmocka_unit_test(a_broadcast_goes_out_at_once),
	    cmocka_unit_test(a_device_that_never_answered_is_commanded),
	    cmocka_unit_test(two_registers_are_written_in_one_request),
	    cmocka_unit_test(faults_at_random),
	    cmocka_unit_test(faults_on_a_line_that_hears_itself),
	    cmocka_unit_test(faults_under_a_late_process),
	    cmocka_unit_test(hostile_bytes),
	};
	return cmocka_run_group_tests_name("modbus line", tests, NULL, NULL);
}
