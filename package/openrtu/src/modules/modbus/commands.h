/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The commands of a process' lines, each from its acceptance to the read that shows its effect: writes, confirmation,
 * the end of its pulse. A pulse's end is carried out by whoever owns the point then; it is tried until the device confirms it.
 */
#ifndef OPENRTU_MODULES_MODBUS_COMMANDS_H
#define OPENRTU_MODULES_MODBUS_COMMANDS_H

#include "map/map.h"
#include "modbus/config.h"
#include "modbus/line.h"
#include "modules/modbus/operation.h"

#define COMMANDS_HELD_MAX 16
#define COMMANDS_READ_BACK_NS                                                                                \
	3000000000LL /* a device that confirmed and is not read by then: done all the same */
#define COMMANDS_READ_LATER_NS 120000000000LL /* what is read behind that is no return */

enum commands_phase {
	COMMANDS_WRITING,
	COMMANDS_PULSE,     /* until due_ns */
	COMMANDS_ENDING,    /* its end is being written */
	COMMANDS_READ_BACK, /* until due_ns at most */
	COMMANDS_READ_LATER, /* ended; its return information comes with a read in its turn, until due_ns at most */
};

/* A command under way. */
struct commands_progress {
	uint32_t point;
	enum commands_phase phase;
	enum map_cause cause; /* of its return information */
	bool unseen;          /* what was written has not been read back */
	bool reported;        /* ended for its requester; the pulse's end is still owed */
	uint8_t next;         /* of the operation's writes */
	uint16_t pulse_ms;
	struct operation operation;
	int64_t due_ns;
	int64_t backoff_ns; /* between tries to end the pulse; 0: none has failed */
};

struct commands {
	/* Filled in by the caller, who owns the memory. */
	struct map *map;
	const int8_t *exponents;            /* of all points' raw values, as last read (convert.h) */
	struct commands_progress *progress; /* room for all commands of the process */
	/* Hands a write to the point's line. False: the line is closed. */
	bool (*write)(void *context, uint32_t point, const struct modbus_request *request,
		      int64_t deadline_ns);
	void *context;

	uint32_t count; /* of commands under way, which lie first */
	struct map_request
	    held[COMMANDS_HELD_MAX]; /* until the read-back of the command before, one a point */
	uint32_t held_count;
};

/* Goes on with the pulses that a former process left. */
void commands_resume(struct commands *commands);
/*
 * Takes a request of map_request_next through the state machine, and begins what that accepts. A point that is only being
 * read back takes the next command when that is done: whoever waits for the device's confirmation alone is not refused.
 */
void commands_request(struct commands *commands, const struct map_request *request);
/* The line's answer to a write for this point. */
void commands_answered(struct commands *commands, uint32_t point, enum modbus_result result,
		       uint8_t exception, int64_t now_ns);
/* The cause of a sample of this point that was read just now. */
enum map_cause commands_cause(const struct commands *commands, uint32_t point);
/* That sample was published. */
void commands_published(struct commands *commands, uint32_t point);
/* A device died or answers again. */
void commands_device_changed(struct commands *commands, uint32_t device, bool alive, int64_t now_ns);
/* Ends all pulses early, for a process that is to stop. True: some are still to be confirmed by their devices. */
bool commands_end_pulses(struct commands *commands, int64_t now_ns);
/* Does what is due at now_ns. */
void commands_run(struct commands *commands, int64_t now_ns);
/* When something is due; INT64_MAX: nothing. */
int64_t commands_deadline(const struct commands *commands);

#endif
