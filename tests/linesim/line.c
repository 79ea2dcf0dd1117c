/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "line.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include "trace.h"

#define MS              1000000
#define FAST_BAUD       19200
#define FAST_SILENCE_NS 1750000 /* clause 2.5.1.1: fixed above 19200 bit/s */
#define FRAME_MIN       4
#define UNFINISHED      50 /* line_set_silence */

#define ILLEGAL_DATA_VALUE 3 /* MODBUS Application Protocol V1.1b3, 7 */
/* Bytes that last less are written a few at a time, at the last one's end. */
#define SHORTEST_WAIT_NS      500000
#define PTY_PATH_SIZE         64
#define ANYONE_MAY_READ_WRITE 0666 /* the gateway's modules are not privileged */

/* Clause 6.2.2: polynomial 0xA001, low octet first on the wire. */
static uint16_t crc16(const uint8_t *bytes, size_t size)
{
	uint16_t crc = 0xffff;

	for (size_t i = 0; i < size; i++) {
		crc ^= bytes[i];
		for (int bit = 0; bit < 8; bit++)
			crc = (uint16_t)(crc & 1 ? crc >> 1 ^ 0xa001 : crc >> 1);
	}
	return crc;
}

static uint8_t random_byte(struct line *line)
{
	line->random ^= line->random << 13;
	line->random ^= line->random >> 17;
	line->random ^= line->random << 5;
	return (uint8_t)line->random;
}

void line_set_pace(struct line *line, unsigned baud, unsigned bits, int64_t latency_ns)
{
	line->char_ns = (int64_t)bits * 1000000000 / baud;
	line->silence_ns = baud > FAST_BAUD ? FAST_SILENCE_NS : line->char_ns * 7 / 2;
	line->unfinished_ns = line->silence_ns;
	line->latency_ns = latency_ns;
}

void line_set_silence(struct line *line, int64_t least_ns)
{
	if (line->silence_ns < least_ns) {
		line->silence_ns = least_ns;
		line->unfinished_ns = UNFINISHED * least_ns;
	}
}

/* ---- answers ----------------------------------------------------------------------------- */

static struct line_answer *free_place(struct line *line)
{
	for (int i = 0; i < LINE_WAITING_MAX; i++)
		if (!line->waiting[i].size)
			return &line->waiting[i];
	return NULL;
}

static struct line_answer *next_waiting(struct line *line)
{
	struct line_answer *next = NULL;

	for (int i = 0; i < LINE_WAITING_MAX; i++)
		if (line->waiting[i].size && (!next || line->waiting[i].start_ns < next->start_ns))
			next = &line->waiting[i];
	return next;
}

static size_t put_frame(uint8_t *frame, uint8_t unit, const uint8_t *pdu, size_t size)
{
	frame[0] = unit;
	memcpy(frame + 1, pdu, size);

	const uint16_t crc = crc16(frame, 1 + size);

	frame[1 + size] = (uint8_t)crc;
	frame[2 + size] = (uint8_t)(crc >> 8);
	return 3 + size;
}

static void put_noise(struct line *line, struct line_answer *answer, size_t count)
{
	for (size_t i = 0; i < count; i++)
		answer->bytes[i] = random_byte(line);
	answer->size = answer->pause_at = count;
}

static void put_echo(const struct line *line, struct line_answer *answer)
{
	memcpy(answer->bytes, line->request.bytes, line->request.size);
	answer->size = answer->pause_at = line->request.size;
}

/* Frames the PDU, and does to it on the wire what the fault says. */
static void compose(struct line *line, struct line_answer *answer, const struct slave_fault *fault,
		    const uint8_t *pdu, size_t pdu_size)
{
	const uint8_t unit = answer->slave->unit;

	answer->size = answer->pause_at = 0;
	if (fault->kind == SLAVE_ECHO)
		put_echo(line, answer);
	if (fault->kind == SLAVE_NOISE)
		put_noise(line, answer, fault->argument);

	const uint8_t sender = fault->kind == SLAVE_WRONG_UNIT ? (uint8_t)(unit % SLAVE_UNIT_MAX + 1) : unit;

	answer->size += put_frame(answer->bytes + answer->size, sender, pdu, pdu_size);
	if (fault->kind == SLAVE_CORRUPT)
		answer->bytes[answer->size - 1] ^= 0xff;
	if (fault->kind == SLAVE_TRUNCATE)
		answer->size /= 2;
}

static void override(struct slave *slave, const struct slave_access *access, uint16_t value)
{
	for (unsigned i = 0; i < access->count; i++)
		slave->table[access->table].value[access->first + i] =
		    slave_table_has_bits(access->table) ? value != 0 : value;
}

/* What a fault makes of a sound PDU. Returns the new size. */
static size_t spoil_pdu(enum slave_fault_kind fault, uint8_t pdu[SLAVE_PDU_MAX], size_t size)
{
	const bool read = pdu[0] <= 4;

	if (fault == SLAVE_WRONG_FUNCTION)
		pdu[0]++;
	if (fault == SLAVE_WRONG_ECHO && size == 5 && !read)
		pdu[4] ^= 1;
	if (fault != SLAVE_WRONG_LENGTH || size == SLAVE_PDU_MAX)
		return size;
	if (read)
		pdu[1]++;
	pdu[size] = 0;
	return size + 1;
}

size_t line_execute(const struct line *line, struct slave *slave, const struct slave_fault *fault,
		    const uint8_t *request, size_t size, uint8_t pdu[SLAVE_PDU_MAX])
{
	const bool too_long = slave_is_too_long(fault, request, size);
	struct slave_access access;
	size_t answer_size;

	if (fault->kind == SLAVE_EXCEPTION || too_long) {
		pdu[0] = request[0] | 0x80;
		pdu[1] = too_long ? ILLEGAL_DATA_VALUE : (uint8_t)fault->argument;
		return 2;
	}
	answer_size = slave_execute(slave, request, size, pdu, &access);
	trace_access(line->port, slave, &access);
	if (fault->kind == SLAVE_OVERRIDE && access.write)
		override(slave, &access, (uint16_t)fault->argument);
	return spoil_pdu(fault->kind, pdu, answer_size);
}

/* A device answers one request after the other, so nothing it says overtakes its late answers. */
static int64_t free_ns(const struct line *line, const struct slave *slave)
{
	int64_t free_ns = 0;

	for (int i = 0; i < LINE_WAITING_MAX; i++) {
		const struct line_answer *answer = &line->waiting[i];
		const int64_t end_ns =
		    answer->start_ns + (int64_t)answer->size * line->char_ns + line->silence_ns;

		if (answer->size && answer->slave == slave && answer->fault == SLAVE_LATE && end_ns > free_ns)
			free_ns = end_ns;
	}
	return free_ns;
}

static void serve(struct line *line, struct slave *slave, int64_t complete_ns)
{
	const struct slave_fault fault = slave_take_fault(slave, line->request.bytes[1]);
	const bool slow = fault.kind == SLAVE_DELAY || fault.kind == SLAVE_LATE;
	struct line_answer *answer = free_place(line);
	uint8_t pdu[SLAVE_PDU_MAX];

	slave->stats.requests++;
	if (!slave_hears(slave, &fault, complete_ns))
		return;

	const size_t pdu_size =
	    line_execute(line, slave, &fault, line->request.bytes + 1, line->request.size - 3, pdu);
	const int64_t ready_ns = complete_ns + (slow ? (int64_t)fault.argument * MS : 0);
	const int64_t earliest_ns = free_ns(line, slave);

	if (!answer) {
		line->stats.dropped++;
		return;
	}
	answer->slave = slave;
	answer->fault = fault.kind;
	answer->start_ns = line->latency_ns + (ready_ns > earliest_ns ? ready_ns : earliest_ns);
	compose(line, answer, &fault, pdu, pdu_size);
	slave_answered(slave, &fault, answer->start_ns + (int64_t)answer->size * line->char_ns);
	if (pdu[0] & 0x80)
		slave->stats.exceptions++;
}

static void serve_broadcast(struct line *line)
{
	for (unsigned unit = 0; unit <= SLAVE_UNIT_MAX; unit++) {
		struct slave *slave = line->slaves[unit];
		struct slave_access access;
		uint8_t unsent[SLAVE_PDU_MAX];

		if (!slave || slave->fault.kind == SLAVE_MUTE)
			continue;
		slave_execute(slave, line->request.bytes + 1, line->request.size - 3, unsent, &access);
		if (access.write)
			trace_access(line->port, slave, &access);
	}
}

/* ---- the wire ---------------------------------------------------------------------------- */

static void trace_request(const struct line *line, enum trace_kind kind)
{
	const size_t size = line->request.size < LINE_FRAME_MAX ? line->request.size : LINE_FRAME_MAX;

	trace_frame(line->port, line->request.bytes[0], kind, line->request.bytes, size, SLAVE_HEALTHY);
}

static bool is_sound(const uint8_t *bytes, size_t size)
{
	return size >= FRAME_MIN && size <= LINE_FRAME_MAX &&
	       crc16(bytes, size - 2) == (bytes[size - 2] | bytes[size - 1] << 8);
}

static bool request_is_sound(const struct line *line)
{
	return is_sound(line->request.bytes, line->request.size);
}

/* The bytes behind the last silence are a request: those before it never became one. */
static bool renewed_is_sound(const struct line *line)
{
	const size_t first = line->request.renewed_at;

	return first && line->request.size <= LINE_FRAME_MAX &&
	       is_sound(line->request.bytes + first, line->request.size - first);
}

static void take_request(struct line *line, int64_t complete_ns)
{
	const uint8_t unit = line->request.bytes[0];
	struct slave *slave = unit <= SLAVE_UNIT_MAX ? line->slaves[unit] : NULL;

	trace_request(line, TRACE_RECEIVED);
	if (unit != SLAVE_BROADCAST && !slave) {
		line->stats.foreign++;
		return;
	}
	line->stats.requests++;
	if (unit == SLAVE_BROADCAST)
		serve_broadcast(line);
	else
		serve(line, slave, complete_ns);
}

static void refuse_request(struct line *line)
{
	line->stats.crc_errors++;
	trace_request(line, TRACE_CRC_ERROR);
}

static void refuse_unfinished(struct line *line)
{
	const size_t size = line->request.size, first = line->request.renewed_at;

	line->request.size = first;
	refuse_request(line);
	line->request.size = size - first;
	memmove(line->request.bytes, line->request.bytes + first, line->request.size);
}

static void end_request(struct line *line, int64_t complete_ns)
{
	if (line->request.spoiled) {
		trace_request(line, TRACE_COLLISION);
	} else if (request_is_sound(line)) {
		take_request(line, complete_ns);
	} else if (renewed_is_sound(line)) {
		refuse_unfinished(line);
		take_request(line, complete_ns);
	} else {
		refuse_request(line);
	}
	line->request.size = line->request.renewed_at = 0;
	line->request.spoiled = false;
}

static int64_t byte_end_ns(const struct line *line, size_t index)
{
	const struct line_answer *answer = &line->sending.answer;
	const bool paused = answer->pause_at && index >= answer->pause_at;

	return answer->start_ns + (int64_t)(index + 1) * line->char_ns + (paused ? line->silence_ns : 0);
}

static void begin_answer(struct line *line, struct line_answer *waiting)
{
	const bool master_speaks = line->request.size > 0;

	if (line->sending.answer.size) { /* two slaves speak: the second is lost in the first */
		line->stats.collisions++;
		line->stats.dropped++;
		line->sending.spoiled = true;
	} else {
		line->sending.answer = *waiting;
		line->sending.sent = 0;
		line->sending.spoiled = line->request.spoiled = master_speaks;
		line->stats.collisions += master_speaks;
	}
	waiting->size = 0;
}

static void trace_answer(const struct line *line)
{
	const struct line_answer *answer = &line->sending.answer;

	trace_frame(line->port, answer->slave ? answer->slave->unit : answer->bytes[0],
		    line->sending.spoiled ? TRACE_COLLISION : TRACE_SENT, answer->bytes, answer->size,
		    answer->fault);
}

static void end_answer(struct line *line)
{
	struct line_answer *answer = &line->sending.answer;

	if (answer->slave) {
		answer->slave->stats.answers++;
		line->stats.answers++;
	}
	answer->size = 0;
}

/* Bytes that nobody reads fill the pty and are then lost, as on a wire. */
static void write_pty(const struct line *line, const uint8_t *bytes, size_t size)
{
	(void)!write(line->pty.fd, bytes, size);
}

static void send_due_bytes(struct line *line, int64_t now_ns)
{
	struct line_answer *answer = &line->sending.answer;
	const size_t first = line->sending.sent;
	size_t end = first;

	while (end < answer->size && byte_end_ns(line, end) <= now_ns) {
		if (line->sending.spoiled)
			answer->bytes[end] ^= random_byte(line) | 1;
		end++;
	}
	if (end == answer->size)
		trace_answer(line); /* before its last byte: who reads that may be quicker */
	write_pty(line, answer->bytes + first, end - first);
	line->sending.sent = end;
	line->stats.busy_ns += (int64_t)(end - first) * line->char_ns;
	if (end == answer->size)
		end_answer(line);
}

/* ---- time -------------------------------------------------------------------------------- */

static int64_t earlier(int64_t one, int64_t other)
{
	return one < other ? one : other;
}

static int64_t request_complete_ns(const struct line *line)
{
	if (!line->request.size)
		return LOOP_NEVER;

	const bool whole = request_is_sound(line) || renewed_is_sound(line);

	return line->request.end_ns + (whole ? line->silence_ns : line->unfinished_ns);
}

static int64_t next_bytes_ns(const struct line *line)
{
	const size_t size = line->sending.answer.size;
	const size_t few = line->whole ? size : 1 + (size_t)(SHORTEST_WAIT_NS / line->char_ns);
	const size_t end = line->sending.sent + few;

	if (!size)
		return LOOP_NEVER;
	return byte_end_ns(line, (end < size ? end : size) - 1);
}

/* Never silent: some bytes at a time, as many as have ended by now. */
static int64_t jam(struct line *line, int64_t now_ns)
{
	const int64_t few_ns = line->char_ns * (1 + SHORTEST_WAIT_NS / line->char_ns);

	while (line->jammed_ns + line->char_ns <= now_ns) {
		const uint8_t byte = random_byte(line);

		write_pty(line, &byte, 1);
		line->jammed_ns += line->char_ns;
		line->stats.busy_ns += line->char_ns;
	}
	return line->jammed_ns + few_ns;
}

int64_t line_advance(struct line *line, int64_t now_ns)
{
	if (line->tcp.is_one)
		return tcp_advance(line, now_ns);
	if (line->jammed_ns)
		return jam(line, now_ns);
	for (;;) {
		struct line_answer *waiting = next_waiting(line);
		const int64_t begin = waiting ? waiting->start_ns : LOOP_NEVER;
		const int64_t bytes = next_bytes_ns(line);
		const int64_t complete = request_complete_ns(line);

		if (complete <= now_ns && complete <= begin && complete <= bytes)
			end_request(line, complete);
		else if (bytes <= now_ns && bytes <= begin)
			send_due_bytes(line, now_ns);
		else if (begin <= now_ns)
			begin_answer(line, waiting);
		else
			return earlier(complete, earlier(bytes, begin));
	}
}

/* A device that has not begun to answer when the master speaks again knows that it gave up. */
static void give_up_answers(struct line *line)
{
	for (int i = 0; i < LINE_WAITING_MAX; i++) {
		struct line_answer *answer = &line->waiting[i];

		if (answer->size && answer->fault != SLAVE_LATE) {
			answer->size = 0;
			line->stats.dropped++;
		}
	}
}

static void receive(struct line *line, const uint8_t *bytes, size_t size, int64_t now_ns)
{
	const int64_t begin =
	    line->request.size && line->request.end_ns > now_ns ? line->request.end_ns : now_ns;

	give_up_answers(line);
	if (line->sending.answer.size) {
		line->stats.collisions += !line->request.spoiled;
		line->sending.spoiled = line->request.spoiled = true;
	}
	if (now_ns > line->request.end_ns + line->silence_ns && line->request.size <= LINE_FRAME_MAX)
		line->request.renewed_at = line->request.size;
	for (size_t i = 0; i < size; i++, line->request.size++)
		if (line->request.size < LINE_FRAME_MAX)
			line->request.bytes[line->request.size] = bytes[i];
	line->request.end_ns = begin + (int64_t)size * line->char_ns;
	line->stats.busy_ns += (int64_t)size * line->char_ns;
}

static void pty_ready(void *owner, uint32_t events)
{
	struct line *line = owner;
	uint8_t bytes[2 * LINE_FRAME_MAX];
	const ssize_t size = read(line->pty.fd, bytes, sizeof bytes);
	const int64_t now_ns = loop_now_ns();

	(void)events;
	if (size <= 0 || line->unplugged)
		return;
	if (line->jammed_ns) {
		line->stats.collisions++;
		return;
	}
	line_advance(line, now_ns);
	receive(line, bytes, (size_t)size, now_ns);
}

static void clear(struct line *line)
{
	line->request.size = line->request.renewed_at = 0;
	line->request.spoiled = false;
	line->sending.answer.size = 0;
	for (int i = 0; i < LINE_WAITING_MAX; i++)
		line->waiting[i].size = 0;
}

void line_set_plugged(struct line *line, bool plugged)
{
	line->unplugged = !plugged;
	clear(line);
}

void line_set_jammed(struct line *line, bool jammed, int64_t now_ns)
{
	line->jammed_ns = jammed ? now_ns : 0;
	clear(line);
}

void line_say(struct line *line, const uint8_t *bytes, size_t size, int64_t now_ns)
{
	struct line_answer *answer = free_place(line);

	if (!answer) {
		line->stats.dropped++;
		return;
	}
	answer->slave = NULL;
	answer->fault = SLAVE_LATE; /* as that, not to be given up */
	answer->start_ns = now_ns;
	answer->size = size;
	answer->pause_at = 0;
	memcpy(answer->bytes, bytes, size);
}

/* ---- the pty ----------------------------------------------------------------------------- */

static int make_raw(int fd)
{
	struct termios settings;

	if (tcgetattr(fd, &settings))
		return -1;
	cfmakeraw(&settings);
	return tcsetattr(fd, TCSANOW, &settings);
}

static void remove_link(int directory, const char *name)
{
	struct stat found;

	if (fstatat(directory, name, &found, AT_SYMLINK_NOFOLLOW) == 0 && S_ISLNK(found.st_mode))
		unlinkat(directory, name, 0);
}

/* Replaces the link that a killed linesim left, and nothing else. */
static int link_to(const char *path, int directory, const char *name)
{
	remove_link(directory, name);
	return symlinkat(path, directory, name);
}

/*
 * A serial port forgets its exclusive mode and what nobody read when it is closed, also by SIGKILL. A pty
 * keeps both while we have it open: an unprivileged gateway, restarted, would find the port busy.
 */
static void port_closed(void *owner, uint32_t events)
{
	const struct line *line = owner;
	_Alignas(struct inotify_event) char closings[512];

	(void)events;
	(void)!read(line->closings.fd, closings, sizeof closings);
	ioctl(line->far_end, TIOCNXCL);
	tcflush(line->far_end, TCIFLUSH);
}

static int watch_closings(struct line *line, const char *path)
{
	line->closings = (struct loop_source){
	    .fd = inotify_init1(IN_NONBLOCK | IN_CLOEXEC),
	    .ready = port_closed,
	    .owner = line,
	};
	return inotify_add_watch(line->closings.fd, path, IN_CLOSE) < 0 || loop_add(&line->closings, EPOLLIN)
		   ? -1
		   : 0;
}

static int open_far_end(struct line *line, const char *path)
{
	line->far_end = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
	return line->far_end < 0 || make_raw(line->far_end) || fchmod(line->far_end, ANYONE_MAY_READ_WRITE)
		   ? -1
		   : 0;
}

static int open_pty(struct line *line, int directory)
{
	char path[PTY_PATH_SIZE];
	const int fd = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);

	line->pty = (struct loop_source){.fd = fd, .ready = pty_ready, .owner = line};
	line->far_end = line->closings.fd = -1;
	line->random = 0x9e3779b9u ^ line->port;
	if (fd < 0 || grantpt(fd) || unlockpt(fd))
		return -1;
	if ((errno = ptsname_r(fd, path, sizeof path)) != 0)
		return -1;
	if (open_far_end(line, path) || watch_closings(line, path) || link_to(path, directory, line->name))
		return -1;
	return loop_add(&line->pty, EPOLLIN);
}

int line_open(struct line *line, int directory)
{
	return line->tcp.is_one ? tcp_open(line) : open_pty(line, directory);
}

void line_close(struct line *line, int directory)
{
	if (line->tcp.is_one) {
		tcp_close(line);
		return;
	}
	remove_link(directory, line->name);
	close(line->closings.fd);
	close(line->far_end);
	close(line->pty.fd);
}
