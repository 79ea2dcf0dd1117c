/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace.h"

#include <stdio.h>
#include <time.h>

#include "line.h"
#include "loop.h"

#define LIST_SIZE (LINE_ANSWER_MAX * 5 + 3) /* "255, " a byte */

static bool on_stdout;
static trace_listener *listening;
static enum trace_wish wished;

void trace_to_stdout(void)
{
	on_stdout = true;
}

void trace_listen(trace_listener *listener, enum trace_wish wish)
{
	listening = listener;
	wished = wish;
}

static const char *wall_time(char text[32])
{
	struct timespec now;
	struct tm local;
	size_t size;

	clock_gettime(CLOCK_REALTIME, &now);
	localtime_r(&now.tv_sec, &local);
	size = strftime(text, 32, "%Y/%m/%d %H:%M:%S", &local);
	snprintf(text + size, 32 - size, ".%03d", (int)(now.tv_nsec / 1000000));
	return text;
}

static const char *list(char text[LIST_SIZE], const uint8_t *bytes, size_t size, const char *separator)
{
	size_t end = 0;

	text[end++] = '[';
	for (size_t i = 0; i < size && i < LINE_ANSWER_MAX; i++)
		end += (size_t)snprintf(text + end, LIST_SIZE - end, "%s%u", i ? separator : "", bytes[i]);
	text[end++] = ']';
	text[end] = '\0';
	return text;
}

/* fields: further members of the JSON object, with a leading comma, or "". */
static void emit(uint16_t port, uint8_t unit, const char *kind, const char *text, const char *fields,
		 bool writes)
{
	static char line[2 * LIST_SIZE + 512];
	char when[32];

	wall_time(when);
	if (on_stdout) {
		printf("%s - INFO: %s\n", when, text);
		fflush(stdout);
	}
	if (wished) {
		const int size = snprintf(line, sizeof line,
					  "{\"time\":\"%s\",\"monotonic_ns\":%lld,\"port\":%u,\"unit\":%u,"
					  "\"kind\":\"%s\",\"text\":\"%s\"%s}\n",
					  when, (long long)loop_now_ns(), port, unit, kind, text, fields);

		listening(line, (size_t)size, writes);
	}
}

void trace_frame(uint16_t port, uint8_t unit, enum trace_kind kind, const uint8_t *bytes, size_t size,
		 enum slave_fault_kind fault)
{
	static const struct {
		const char *name;
		const char *words;
	} kinds[] = {
	    [TRACE_RECEIVED] = {"received", "Modbus frame received"},
	    [TRACE_SENT] = {"sent", "Modbus frame sent"},
	    [TRACE_CRC_ERROR] = {"crc_error", "CRC error"},
	    [TRACE_COLLISION] = {"collision", "Collision"},
	};
	static char numbers[LIST_SIZE], text[LIST_SIZE + 32], fields[LIST_SIZE + 64];

	if (!on_stdout && wished < TRACE_ALL)
		return;
	snprintf(text, sizeof text, "%s: %s", kinds[kind].words, list(numbers, bytes, size, " "));
	snprintf(fields, sizeof fields, ",\"bytes\":%s,\"fault\":\"%s\"", list(numbers, bytes, size, ","),
		 slave_fault_name(fault));
	emit(port, unit, kinds[kind].name, text, fields, false);
}

void trace_access(uint16_t port, const struct slave *slave, const struct slave_access *access)
{
	if (!on_stdout && wished < (access->write ? TRACE_WRITES : TRACE_ALL))
		return;
	for (unsigned i = 0; i < access->count; i++) {
		const unsigned address = access->first + i;
		const unsigned value = slave->table[access->table].value[address];
		char text[64], fields[96];

		snprintf(text, sizeof text, "%s value: %u%s%u = %u", access->write ? "Writing" : "Reading",
			 slave->unit, slave_table_mark(access->table), address, value);
		snprintf(fields, sizeof fields, ",\"table\":\"%s\",\"address\":%u,\"value\":%u",
			 slave_table_name(access->table), address, value);
		emit(port, slave->unit, access->write ? "writing" : "reading", text, fields, access->write);
	}
}
