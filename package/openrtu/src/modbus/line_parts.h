/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the files of a line share with each other, and nobody else. Indices are of the line's devices, times CLOCK_MONOTONIC. */
#ifndef OPENRTU_MODBUS_LINE_PARTS_H
#define OPENRTU_MODBUS_LINE_PARTS_H

#include "line.h"

/* When the request under way was given to the port. */
static inline int64_t begun_ns(const struct modbus_line *line)
{
	return line->sent_ns - (int64_t)line->frame_length * line->wire.char_ns - line->wire.before_ns;
}

/* What RTU frames, those of Modbus TCP and of Modbus ASCII do each in their own way. */
struct modbus_framer {
	/* line->request as a frame, in line->frame. Returns its length. */
	size_t (*build)(struct modbus_line *line);
	/* What is sent instead of that frame, in text. Returns its length. NULL: the frame is sent. */
	size_t (*encode)(const struct modbus_line *line, uint8_t text[MODBUS_ASCII_REQUEST_MAX]);
	/* modbus_line_receive. */
	bool (*receive)(struct modbus_line *line, const uint8_t *bytes, size_t length, int64_t now_ns);
	/* The answer to the request under way may still come. */
	void (*remember_unanswered)(struct modbus_line *line);
	int64_t rest_ns;        /* before the first request: whatever was under way has ended then */
	bool answers_are_alike; /* none says which request it answers: it may be one of the process before */
	bool has_gateways;      /* some devices are reached through another one, which says if they are not */
};

/* ---- device.c ---------------------------------------------------------------------------- */

/* It has objects, and is no broadcast address. */
bool modbus_is_readable(const struct modbus_device *device);

/* When it may be read, as far as its pause goes; when it may be written. */
static inline int64_t modbus_ready_ns(const struct modbus_device *device)
{
	return device->spoken_ns + device->pause.tried_ns;
}

static inline int64_t modbus_surely_ready_ns(const struct modbus_device *device)
{
	return device->spoken_ns + device->pause.kept_ns;
}

/* A request whose time-out has passed: its answer may still come (line.h, "Late answers"). */
void modbus_add_unanswered(struct modbus_device *device, const struct modbus_request *request,
			   int64_t sent_ns);
/* The same of one that was passed on: nothing is learned from when its answer comes. */
void modbus_add_passed(struct modbus_device *device, const struct modbus_request *request, int64_t sent_ns);
void modbus_forget_unanswered(struct modbus_device *device, int64_t now_ns);
/* Such an answer would look like that to a request with this function. */
bool modbus_owes(const struct modbus_device *device, uint8_t function);
/* How long the late answer is that these bytes begin like; 0: like none. */
size_t modbus_owed_length(const struct modbus_device *device, const uint8_t *bytes, size_t count);
/* When that was sent to which this sound frame is the late answer; 0: nobody knows. Each is found once. */
int64_t modbus_sent_ns(struct modbus_device *device, const uint8_t *frame);
/* It lives, and may still be at work on what it did not answer: the response time of that has not passed. */
bool modbus_may_be_busy(const struct modbus_device *device, int64_t now_ns);
/* This request was answered, and with it what was unanswered before. */
void modbus_settle_unanswered(struct modbus_device *device, const struct modbus_request *request,
			      bool is_exception, int64_t sent_ns, int64_t now_ns);
/* A short read whose answer is like none that is owed. False: there is none now. */
bool modbus_find_probe(const struct modbus_device *device, struct modbus_request *request);

/* How long the answer to a read or a probe is waited for (line.h, "Time-outs"). */
int64_t modbus_timeout(const struct modbus_device *device);
/* A read's answer began so long after its request. */
void modbus_learn_latency(struct modbus_device *device, int64_t latency_ns);
/* An answer that was missing has come. True: within the response time, so the device is slow, not dead. */
bool modbus_was_in_time(struct modbus_device *device, int64_t began_ns, int64_t ended_ns);

/* Plans the device's reads as at the start. */
void modbus_replan(struct modbus_line *line, struct modbus_device *device);
/* The device lives but does not give this read; exception 0: it is silent. True when the read was divided. */
bool modbus_refuse_read(struct modbus_line *line, uint32_t index, uint32_t read_index, uint8_t exception,
			int64_t now_ns);

/* The device lives, does not give this read, and is asked for it less and less often. */
void modbus_set_read_aside(struct modbus_line *line, uint32_t index, uint32_t read_index, uint8_t exception,
			   int64_t now_ns);

/* It has answered, and lives; it did not answer, and may be dead; it cannot be reached any more. */
void modbus_device_answered(struct modbus_line *line, uint32_t index, int64_t now_ns);
void modbus_device_silent(struct modbus_line *line, uint32_t index, int64_t now_ns);
void modbus_device_died(struct modbus_line *line, uint32_t index, int64_t now_ns);
/* When a dead device is to be probed next. */
int64_t modbus_probe_due_ns(const struct modbus_line *line, const struct modbus_device *device);

/* ---- command.c --------------------------------------------------------------------------- */

/* Takes a command out of its place in the queue. */
struct modbus_command modbus_take_command(struct modbus_line *line, uint32_t place);
/* Answers those whose deadline has passed, or all: they are not sent. */
void modbus_drop_old_commands(struct modbus_line *line, int64_t now_ns);
void modbus_drop_commands(struct modbus_line *line);
/* Writes one coil or register with the function that the device knows, as far as is known. */
void modbus_choose_function(const struct modbus_device *device, struct modbus_request *request);
/*
 * The device does not know the function of line->command (exception 1), so it has certainly not carried it out. True: the
 * command goes out once more, with the other function that writes the same.
 */
bool modbus_turn_command(struct modbus_line *line);
/* Of line->request; turned: it has been done to it. True: the other function is to be tried. */
bool modbus_turn(struct modbus_line *line, bool *turned);
/* The request under way was answered, and not as a function that the device does not know. */
void modbus_function_is_known(struct modbus_line *line, int64_t now_ns);
/* Answers line->command. What was written is read back. */
void modbus_end_command(struct modbus_line *line, enum modbus_result result, uint8_t exception);

/* ---- kept.c ------------------------------------------------------------------------------ */

/* What it writes next; NULL: nothing yet. */
const struct modbus_request *modbus_kept_request(const struct modbus_kept *kept);
/* line->command was carried out. */
void modbus_keep_command(struct modbus_line *line, int64_t now_ns);
/* What may be written now, the first that was due. False: nothing. */
bool modbus_find_kept(const struct modbus_device *device, int64_t now_ns, uint32_t *found);
/* When the next one is due; MODBUS_NEVER: none. */
int64_t modbus_next_kept_ns(const struct modbus_device *device, int64_t now_ns);
/* That under way has ended. */
void modbus_kept_ended(struct modbus_line *line, enum modbus_result result, uint8_t exception,
		       int64_t now_ns);

/* ---- page.c ------------------------------------------------------------------------------ */

/* What chooses the page of a read. */
struct modbus_request modbus_page_request(const struct modbus_device *device, uint32_t read);
/* That under way was answered. */
void modbus_page_answered(struct modbus_line *line, bool is_exception, uint8_t exception, int64_t now_ns);
/* The device whose page was chosen, and which may be read. False: there is none. */
bool modbus_find_chosen(const struct modbus_line *line, int64_t now_ns, uint32_t *index);
/* Its reads are others, or it is not there: nothing is chosen. */
static inline void modbus_forget_page(struct modbus_device *device)
{
	if (device->pages != NULL)
		device->pages->chosen = 0;
}

/* ---- identify.c -------------------------------------------------------------------------- */

/* The device may be asked now what it is. */
bool modbus_may_identify(const struct modbus_line *line, const struct modbus_device *device, int64_t now_ns);
/* When one may be that is to be asked; MODBUS_NEVER: none, or when something else comes. */
int64_t modbus_next_identify_ns(const struct modbus_line *line, const struct modbus_device *device,
				int64_t now_ns);
/* How long its answer is waited for. */
int64_t modbus_identify_timeout(const struct modbus_device *device);
/* The request under way was answered, or not: body NULL. */
void modbus_identify_answered(struct modbus_line *line, const uint8_t *body, bool is_exception,
			      int64_t now_ns);

/* Nothing with a period becomes due until then. */
bool modbus_is_room(const struct modbus_line *line, int64_t until_ns);

/* ---- passed.c ---------------------------------------------------------------------------- */

/* The body of the request that begins. Returns its length. */
size_t modbus_put_body(const struct modbus_line *line, uint8_t *body);
/* What waits to be passed on may go now; when something of that changes, MODBUS_NEVER: nothing waits. */
bool modbus_may_pass(const struct modbus_line *line, int64_t now_ns);
int64_t modbus_next_pass_ns(const struct modbus_line *line, int64_t now_ns);
/* Its answer is awaited. */
bool modbus_pass_is_under_way(const struct modbus_line *line);
int64_t modbus_pass_timeout(const struct modbus_line *line, const struct modbus_device *device);
/* As far as a line's request goes: what its answer looks like. */
struct modbus_request modbus_passed_request(const struct modbus_passed *passed);
/* The answer to this function has the fields of one to a request of the line's own. */
bool modbus_pass_is_known(uint8_t function);
/* The body is that of the answer to what was passed on, or of its exception. */
bool modbus_answers_pass(const struct modbus_line *line, const uint8_t *body, size_t length);
/* If it has not ended, it does now. */
void modbus_pass_ended(struct modbus_line *line, enum modbus_result result, const uint8_t *body,
		       size_t length, int64_t now_ns);

/* ---- transaction.c ----------------------------------------------------------------------- */

/* Begins line->request. Returns the length of its frame, in line->frame. */
size_t modbus_begin(struct modbus_line *line, enum modbus_purpose purpose, uint32_t index, int64_t now_ns);
/* Nothing is under way any more; the next request may begin at silent_ns. */
void modbus_end(struct modbus_line *line, int64_t silent_ns, int64_t now_ns);
/* The request under way was answered. body: unit, function and data, which have been checked against it. */
void modbus_request_answered(struct modbus_line *line, const uint8_t *body, bool is_exception,
			     int64_t now_ns);
/* It was not: by no sound frame, by none in time. */
void modbus_answer_garbled(struct modbus_line *line, int64_t now_ns);
void modbus_request_timed_out(struct modbus_line *line, int64_t now_ns);
/* A sound frame that is not the answer awaited. body: length bytes of unit, function and data. */
void modbus_count_wrong_answer(struct modbus_line *line, const uint8_t *body, size_t length, int64_t now_ns);
/* The answer to what was sent then, and has timed out, began and ended. sent_ns 0: nobody knows when. */
void modbus_tell_late(struct modbus_line *line, uint32_t index, int64_t sent_ns, int64_t began_ns,
		      int64_t now_ns);

/* The body of a frame has come while the answer to what was passed on is awaited. False: it is another's. */
bool modbus_pass_answered(struct modbus_line *line, const uint8_t *body, size_t length, int64_t now_ns);

/* The connection has ended under it: a read may be asked again, and what has become of a write nobody knows. */
void modbus_request_torn(struct modbus_line *line, int64_t now_ns);

/* ---- turn.c ------------------------------------------------------------------------------ */

/* Begins what comes next. Returns the length of the request in line->frame, 0: there is nothing to do. */
size_t modbus_begin_next(struct modbus_line *line, int64_t now_ns);
/* When something may become due on a line that has nothing to do. */
int64_t modbus_next_due(const struct modbus_line *line, int64_t now_ns);

/* Something is, which a connection is worth. */
bool modbus_is_anything_due(const struct modbus_line *line, int64_t now_ns);

/* ---- connection.c ------------------------------------------------------------------------ */

void modbus_connection_made(struct modbus_line *line, int64_t now_ns);
/* A request is sent on it; it brought a frame; a request was not answered. A line without one takes no notice. */
void modbus_connection_asked(struct modbus_line *line);
void modbus_connection_answered(struct modbus_line *line);
void modbus_connection_unanswered(struct modbus_line *line);
/* The peer has hung up. True: that is no fault. */
bool modbus_connection_ended(struct modbus_line *line, int64_t now_ns);
/* True: it is, and has been given up. */
bool modbus_connection_is_hung(struct modbus_line *line, int64_t now_ns);

/* ---- octets.c ---------------------------------------------------------------------------- */

/* Octets of RTU frames, the first of which came at began_ns. */
void modbus_take_octets(struct modbus_line *line, const uint8_t *octets, size_t length, int64_t began_ns,
			int64_t now_ns);
/* They have ceased. True: they were the answer to what was passed on. */
bool modbus_pass_burst(struct modbus_line *line, int64_t now_ns);
/* Something comes that nobody has asked for: the next request waits until it has ceased. */
void modbus_note_unrest(struct modbus_line *line, int64_t now_ns);
/* Counts the strays, which are one burst, and removes them. */
void modbus_remove_strays(struct modbus_line *line, int64_t now_ns);
/* line->request as an RTU frame, in line->frame. Returns its length. */
size_t modbus_build_rtu(struct modbus_line *line);
/* That of the device under way may still come: nothing says which request an answer answers. */
void modbus_remember_unanswered(struct modbus_line *line);
extern const struct modbus_framer modbus_rtu_framer;

/* ---- line_ascii.c ------------------------------------------------------------------------ */

extern const struct modbus_framer modbus_ascii_framer;

/* ---- stream.c ---------------------------------------------------------------------------- */

extern const struct modbus_framer modbus_tcp_framer;

#endif
