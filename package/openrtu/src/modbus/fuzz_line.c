/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on a line in virtual time: the input says what octets arrive, when, and what commands come; its last octet,
 * whether the line is serial or TCP. The line's own requests can be answered with a right frame, so that the input gets
 * behind the CRC or the transaction. What must hold:
 * - frames that go out are whole, with a right CRC or MBAP header, and no write goes out twice;
 * - the deadline is ahead;
 * - what is passed on goes out once at most, and ends once, with an answer of its own or none;
 * - a read's data lie within the answer, and each command ends once.
 */
#include <string.h>

#include "fuzz/input.h"
#include "modbus/line.h"

#define MS           1000000LL
#define DEVICES      3
#define OBJECTS      12
#define COMMANDS_MAX 4
#define TAGS         65536

static struct modbus_line line;
static struct modbus_device devices[DEVICES];
static struct modbus_object objects[DEVICES][OBJECTS];
static struct modbus_read reads[DEVICES][OBJECTS];
static struct modbus_command commands[COMMANDS_MAX];
static struct modbus_kept kept[DEVICES][2];
static struct modbus_request constants[DEVICES];
static int64_t now;
static struct modbus_identity identities[DEVICES];
static uint32_t ordered, ended, written,
    turnable; /* commands; frames of writes; refused ones, which may go out once more */
static uint32_t passes_begun, passes_ended, passes_sent;
static bool done[TAGS];
static uint8_t request[MODBUS_FRAME_MAX]; /* the latest, from its unit on */
static uint8_t transaction[2];            /* and, on TCP, what stands before */
static size_t request_length;
static uint32_t refused; /* functions of writes that an exception may have refused, a bit each */
static bool counted;     /* that to the latest request */
static unsigned sum;     /* of what was read: a sanitizer sees data that is not there */

/* ---- what the line tells ----------------------------------------------------------------------- */

static void check_objects(uint32_t device, const struct modbus_read *read)
{
	CHECK(device < DEVICES && read->first + read->objects <= devices[device].object_count);
	for (uint32_t i = 0; i < read->objects; i++)
		CHECK(objects[device][read->first + i].function == read->function);
}

static void on_read(void *context, uint32_t device, const struct modbus_read *read, const uint8_t *data,
		    int64_t now_ns)
{
	(void)context;
	CHECK(now_ns == now);
	check_objects(device, read);
	for (uint32_t i = 0; i < modbus_read_bytes(read->function, read->count); i++)
		sum += data[i];
}

static void on_refused(void *context, uint32_t device, const struct modbus_read *read, uint8_t exception,
		       int64_t now_ns)
{
	(void)context;
	(void)exception;
	(void)now_ns;
	check_objects(device, read);
}

static void on_alive(void *context, uint32_t device, bool alive, int64_t now_ns)
{
	(void)context;
	(void)now_ns;
	CHECK(device < DEVICES && devices[device].alive == alive);
}

static void on_command(void *context, const struct modbus_command *command, enum modbus_result result,
		       uint8_t exception)
{
	(void)context;
	(void)exception;
	CHECK(result <= MODBUS_NOT_SENT && command->tag < ordered && !done[command->tag]);
	done[command->tag] = true;
	ended++;
}

static void on_late(void *context, uint32_t device, int64_t latency_ns, int64_t now_ns)
{
	(void)context, (void)now_ns;
	CHECK(device < DEVICES && latency_ns > 0);
}

static void on_stranger(void *context, uint32_t device, uint8_t unit, int64_t now_ns)
{
	(void)context, (void)now_ns;
	CHECK(device < DEVICES && unit != devices[device].unit);
}

/* Only a device that said that it does not know the function is written to once more. */
static void on_turned(void *context, uint32_t device, uint8_t unknown, uint8_t function, int64_t now_ns)
{
	(void)context, (void)now_ns;
	CHECK(device < DEVICES && request[1] == function && function != unknown);
	CHECK(refused & 1u << unknown);
}

static void on_kept(void *context, uint32_t device, const struct modbus_kept *news, int64_t now_ns)
{
	(void)context, (void)now_ns;
	CHECK(device < DEVICES && news >= kept[device] && news < kept[device] + 2);
}

static void on_pause(void *context, uint32_t device, int64_t pause_ns, int64_t now_ns)
{
	(void)context, (void)now_ns;
	CHECK(device < DEVICES && pause_ns > 0 && pause_ns <= MODBUS_PAUSE_MAX_NS);
}

/* It has ended once, with an answer of its own or none. */
static void on_passed(void *context, const struct modbus_passed *passed, enum modbus_result result,
		      const uint8_t *body, size_t length, int64_t now_ns)
{
	(void)context, (void)now_ns;
	CHECK(passed->tag == passes_begun && passes_ended < passes_begun);
	passes_ended++;
	CHECK((body != NULL) == (result == MODBUS_DONE));
	if (body == NULL)
		return;
	CHECK(length >= 2 && length <= MODBUS_BODY_MAX && body[0] == passed->body[0]);
	CHECK((body[1] & (uint8_t)~MODBUS_EXCEPTION_BIT) == passed->body[1]);
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
					    .stranger = on_stranger};

/* ---- what happens ------------------------------------------------------------------------------ */

static bool is_framed(void)
{
	return line.wire.framing == MODBUS_FRAMING_TCP;
}

static size_t prefix_length(void)
{
	return is_framed() ? MODBUS_MBAP_PREFIX : 0;
}

static bool is_text(void)
{
	return line.wire.framing == MODBUS_FRAMING_ASCII;
}

static enum modbus_ascii_state read_text(const struct modbus_output *output, struct modbus_ascii *ascii)
{
	enum modbus_ascii_state state = MODBUS_ASCII_NOISE;

	for (size_t i = 0; i < output->length; i++)
		state = modbus_ascii_take(ascii, output->frame[i]);
	return state;
}

static bool is_whole(const struct modbus_output *output)
{
	struct modbus_ascii ascii = {.begun = false};

	if (is_text())
		return read_text(output, &ascii) == MODBUS_ASCII_SOUND;
	if (is_framed())
		return modbus_mbap_length(output->frame, output->length) == output->length;
	return modbus_crc_valid(output->frame, output->length);
}

/* That in request: nothing is written to who is dead but by a command. */
static void count_write(void)
{
	counted = false;
	if (line.purpose == MODBUS_PASS) {
		CHECK(++passes_sent <= passes_begun);
		return;
	}
	if (modbus_is_read(request[1]) || request[1] == MODBUS_ENCAPSULATED)
		return;
	if (line.purpose == MODBUS_KEEP)
		CHECK(devices[line.device].alive);
	else
		CHECK(++written <= ordered + turnable);
}

static void take_output(const struct modbus_output *output)
{
	if (output->length == 0)
		return;
	CHECK(output->length <= MODBUS_FRAME_MAX && is_whole(output));
	if (is_text()) {
		struct modbus_ascii ascii = {.begun = false};

		read_text(output, &ascii);
		memcpy(request, ascii.body, ascii.length);
		request_length = ascii.length + MODBUS_CRC_LENGTH;
		count_write();
		return;
	}
	request_length = output->length - prefix_length();
	memcpy(request, output->frame + prefix_length(), request_length);
	memcpy(transaction, output->frame, sizeof(transaction));
	count_write();
}

/* A connection that is given up is there again at once. */
static void poll_line(void)
{
	struct modbus_output output = modbus_line_poll(&line, now);

	CHECK(output.deadline_ns > now);
	if (output.reconnect) {
		CHECK(line.wire.connection && output.length == 0);
		modbus_line_connected(&line, now);
		output = modbus_line_poll(&line, now);
		CHECK(!output.reconnect && output.deadline_ns > now);
	}
	take_output(&output);
}

static void lose_port(void)
{
	modbus_line_close(&line, now);
	CHECK(ended == ordered);
	request_length = 0;
	now += MS;
	modbus_line_open(&line, now);
	poll_line();
}

/* The peer hangs up; the next connection is there at once. */
static void hang_up(void)
{
	if (!modbus_line_interrupted(&line, now)) {
		lose_port();
		return;
	}
	CHECK(line.wire.connection && line.state == MODBUS_IDLE);
	request_length = 0;
	modbus_line_connected(&line, now);
	poll_line();
}

static void note_refusal(void)
{
	if (modbus_is_read(request[1]) || request[1] == MODBUS_ENCAPSULATED || line.purpose == MODBUS_PASS)
		return;
	refused |= 1u << (request[1] & 31);
	turnable += !counted;
	counted = true;
}

/* Anywhere in it, for it may come in pieces. */
static void note_refusals(const uint8_t *octets, size_t length)
{
	for (size_t i = 0; i < length; i++)
		if (octets[i] == (request[1] | MODBUS_EXCEPTION_BIT))
			note_refusal();
	/* As text it is two digits, of which the second may come with the next piece. */
	if (is_text())
		note_refusal();
}

static void receive(const uint8_t *octets, size_t length)
{
	note_refusals(octets, length);
	if (!modbus_line_receive(&line, octets, length, now)) {
		CHECK(is_framed() && !line.wire.datagrams);
		lose_port();
	}
	poll_line();
}

/* Unit, function, a count of one octet, and as much: what a tool asks for need not fit into a frame. */
#define ANSWER_MAX (3 + UINT8_MAX)

static void receive_text(const uint8_t *body, size_t length)
{
	static const char digits[] = "0123456789ABCDEF";
	uint8_t text[2 * (ANSWER_MAX + 1) + 3], lrc = 0;
	size_t at = 0;

	CHECK(length <= ANSWER_MAX);
	text[at++] = ':';
	for (size_t i = 0; i <= length; i++) {
		const uint8_t octet = i < length ? body[i] : (uint8_t)(0u - lrc);

		lrc = (uint8_t)(lrc + octet);
		text[at++] = (uint8_t)digits[octet >> 4];
		text[at++] = (uint8_t)digits[octet & 15];
	}
	text[at++] = '\r';
	text[at++] = '\n';
	receive(text, at);
}

/* Lets the octets of a body arrive as a sound frame. */
static void seal_and_receive(uint8_t *frame, size_t length)
{
	uint16_t crc = modbus_crc(frame, length);
	const uint8_t head[] = {transaction[0],         transaction[1],          0, 0,
				(uint8_t)(length >> 8), (uint8_t)(length & 0xFF)};

	if (is_framed()) {
		memmove(frame + sizeof(head), frame, length);
		memcpy(frame, head, sizeof(head));
		receive(frame, sizeof(head) + length);
		return;
	}
	if (is_text()) {
		receive_text(frame, length);
		return;
	}
	frame[length] = (uint8_t)crc;
	frame[length + 1] = (uint8_t)(crc >> 8);
	receive(frame, length + 2);
}

static void receive_anything(bool sealed)
{
	uint8_t octets[256 + MODBUS_MBAP_PREFIX];
	size_t length = 1u + next_octet();

	for (size_t i = 0; i < length; i++)
		octets[i] = next_octet();
	if (sealed)
		seal_and_receive(octets, length);
	else
		receive(octets, length);
}

/* The answer that the latest request asks for, but for what the input does to it. */
static void receive_answer(uint8_t slip)
{
	uint8_t frame[2 * MODBUS_FRAME_MAX] = {request[0], request[1]};
	size_t length;

	if (request_length == 0)
		return;
	if (slip & 1) {
		frame[1] |= MODBUS_EXCEPTION_BIT;
		frame[2] = next_octet();
		length = 3;
	} else if (modbus_is_read(request[1])) {
		frame[2] = (uint8_t)modbus_read_bytes(request[1], modbus_register(request + 4, 0));
		for (length = 3; length < 3u + frame[2]; length++)
			frame[length] = next_octet();
	} else if (request[1] == MODBUS_ENCAPSULATED) {
		memcpy(frame + 2, request + 2, 2);
		for (length = 4; length < 40; length++)
			frame[length] = next_octet();
		frame[7] &= 3;
		length = modbus_begun_length(&line.request, frame, length) - MODBUS_CRC_LENGTH;
		if (length > 200)
			return;
	} else {
		memcpy(frame + 2, request + 2, 4);
		length = 6;
	}
	if (slip & 2)
		frame[next_octet() % length] ^= next_octet();
	seal_and_receive(frame, length);
}

static void let_time_pass(uint8_t argument)
{
	int64_t until = now + (1 + argument) * (next_octet() & 1 ? 50 * MS : MS);

	while (now < until) {
		struct modbus_output output;

		poll_line();
		output = modbus_line_poll(&line, now);
		CHECK(output.length == 0 && !output.reconnect && output.deadline_ns > now);
		now = output.deadline_ns < until ? output.deadline_ns : until;
	}
	poll_line();
}

static void command(uint8_t argument)
{
	static const uint8_t functions[] = {MODBUS_WRITE_COIL, MODBUS_WRITE_REGISTER, MODBUS_WRITE_REGISTERS};
	uint32_t device = argument % DEVICES;
	struct modbus_command order = {
	    .device = device,
	    .tag = ordered,
	    .deadline_ns = now + next_octet() * 10 * MS,
	    .request = {
		devices[device].unit, functions[next_octet() % 3], next_octet(), 1, {next_octet() & 1}}};

	order.read_function = argument & 1 ? MODBUS_READ_HOLDING_REGISTERS : MODBUS_READ_COILS;
	order.read_address = order.request.address;
	if (order.request.function == MODBUS_WRITE_REGISTERS)
		order.request.count = 2;
	if (ordered < TAGS && modbus_line_command(&line, &order))
		ordered++;
	poll_line();
}

/* Anything that somebody has passed on to a device. */
static void pass(void)
{
	const uint32_t device = 1u + next_octet() % (DEVICES - 1);
	struct modbus_passed passed = {.device = device,
				       .tag = passes_begun + 1,
				       .deadline_ns = now + next_octet() * 10 * MS,
				       .length = 2u + next_octet() % 16};

	passed.body[0] = devices[device].unit;
	for (size_t i = 1; i < passed.length; i++)
		passed.body[i] = next_octet();
	passed.body[1] &= (uint8_t)~MODBUS_EXCEPTION_BIT;
	if (modbus_line_pass(&line, &passed))
		passes_begun++;
	poll_line();
}

static void step(void)
{
	uint8_t octet = next_octet(), argument = octet >> 3;

	switch (octet & 7) {
	case 0:
		receive_anything(false);
		break;
	case 1:
		receive_anything(true);
		break;
	case 2:
	case 3:
		receive_answer(argument);
		break;
	case 4:
	case 5:
		let_time_pass(argument);
		break;
	case 6:
		command(argument);
		break;
	default:
		if (argument == 0)
			lose_port();
		else if (argument < 4)
			hang_up();
		else
			pass();
		break;
	}
}

/* Whatever the devices said: what follows from it keeps within the protocol, and counts no read twice. */
static void check_learned(void)
{
	for (uint32_t d = 0; d < DEVICES; d++) {
		struct modbus_learned learned = modbus_learn(devices[d].reads, devices[d].read_count);

		CHECK(learned.given_bits <= MODBUS_BITS_MAX && learned.refused_bits <= MODBUS_BITS_MAX);
		CHECK(learned.given_registers <= MODBUS_REGISTERS_MAX &&
		      learned.refused_registers <= MODBUS_REGISTERS_MAX);
		CHECK(learned.hole.count < learned.hole.read || learned.hole.read == 0);
		CHECK(learned.open + learned.lacking.count + learned.holes_given <= devices[d].read_count);
	}
}

static void begin(struct modbus_wire wire)
{
	static const uint8_t functions[] = {1, 2, 3, 4};

	memset(done, 0, sizeof(done));
	memset(devices, 0, sizeof(devices));
	memset(identities, 0, sizeof(identities));
	ordered = ended = written = turnable = refused = 0;
	passes_begun = passes_ended = passes_sent = 0;
	request_length = 0;
	now = 5000 * MS;
	for (uint32_t d = 0; d < DEVICES; d++) {
		devices[d] = (struct modbus_device){.unit = (uint8_t)d, /* 0: broadcast */
						    .retries = 1,
						    .response_timeout_ns = 100 * MS,
						    .response_timeout_min_ns = 5 * MS,
						    .objects = objects[d],
						    .reads = reads[d]};
		if (d > 0) {
			constants[d] = (struct modbus_request){(uint8_t)d, MODBUS_WRITE_REGISTER, 77, 1, {1}};
			devices[d].kept = kept[d];
			devices[d].kept_count = 2;
			devices[d].identity = &identities[d];
			kept[d][0] = (struct modbus_kept){
			    .constants = &constants[d], .constant_count = 1, .period_ns = 300 * MS};
			kept[d][1] = (struct modbus_kept){.tag = d, .period_ns = d % 2 * 500 * MS};
		}
		for (uint16_t i = 0; d > 0 && i < OBJECTS; i++)
			objects[d][devices[d].object_count++] = (struct modbus_object){
			    i, (uint16_t)(i * i), functions[i % 4] & 15u, (1 + i % 2) & 15u, i % 3 * 50u, 0};
	}
	line = (struct modbus_line){.events = &events,
				    .devices = devices,
				    .device_count = DEVICES,
				    .commands = commands,
				    .command_capacity = COMMANDS_MAX,
				    .pass_share = 50,
				    .wire = wire};
	modbus_line_init(&line);
	modbus_line_open(&line, now);
}

static struct modbus_wire wire_of(uint8_t octet)
{
	if (octet & 1)
		return octet & 2 ? modbus_wire_udp() : modbus_wire_tcp(MODBUS_FRAMING_TCP);
	if (octet & 4)
		return octet & 2 ? modbus_wire_tcp(MODBUS_FRAMING_ASCII) : modbus_wire_ascii(9600, 10);
	return octet & 2 ? modbus_wire_tcp(MODBUS_FRAMING_RTU) : modbus_wire(19200, 11);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	input = (struct input){.at = data, .end = data + size};
	begin(wire_of(size > 0 ? data[size - 1] : 0));
	poll_line();
	while (input.at < input.end)
		step();
	check_learned();
	modbus_line_close(&line, now);
	CHECK(ended == ordered && passes_ended == passes_begun);
	return 0;
}
