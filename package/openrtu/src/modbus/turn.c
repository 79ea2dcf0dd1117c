/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Whose turn it is on a line that is silent: commands, what was written, what is due, the scan, the dead. */
#include "line_parts.h"
#include "map/time_ns.h"

static bool is_ready(const struct modbus_device *device, int64_t now_ns)
{
	return now_ns >= modbus_ready_ns(device);
}

static size_t begin_probe(struct modbus_line *line, uint32_t index, int64_t now_ns)
{
	if (!modbus_find_probe(&line->devices[index], &line->request))
		return 0;
	return modbus_begin(line, MODBUS_PROBE, index, now_ns);
}

static size_t ask(struct modbus_line *line, uint32_t index, uint32_t read_index, int64_t now_ns)
{
	const struct modbus_device *device = &line->devices[index];
	const struct modbus_read *read = &device->reads[read_index];

	line->read = read_index;
	line->request = (struct modbus_request){
	    .unit = device->unit, .function = read->function, .address = read->address, .count = read->count};
	return modbus_begin(line, MODBUS_SCAN, index, now_ns);
}

static size_t begin_read(struct modbus_line *line, uint32_t index, uint32_t read_index, int64_t now_ns)
{
	struct modbus_read *read = &line->devices[index].reads[read_index];

	read->urgent = false;
	if (read->page == 0)
		return ask(line, index, read_index, now_ns);
	line->read = read_index;
	line->request = modbus_page_request(&line->devices[index], read_index);
	return modbus_begin(line, MODBUS_CHOOSE, index, now_ns);
}

/* What the page that was chosen last has: nothing goes before it. */
static size_t begin_chosen_read(struct modbus_line *line, int64_t now_ns)
{
	uint32_t index, read;

	if (!modbus_find_chosen(line, now_ns, &index))
		return 0;
	read = line->devices[index].pages->chosen - 1;
	modbus_forget_page(&line->devices[index]);
	return ask(line, index, read, now_ns);
}

static bool is_first_of_device(const struct modbus_line *line, uint32_t place)
{
	for (uint32_t i = 0; i < place; i++)
		if (line->commands[i].device == line->commands[place].device)
			return false;
	return true;
}

/* Commands of one device go in order; one that must wait for its device does not stop those of others. */
static size_t begin_command(struct modbus_line *line, int64_t now_ns)
{
	modbus_drop_old_commands(line, now_ns);
	for (uint32_t place = 0; place < line->command_count; place++) {
		uint32_t index = line->commands[place].device;
		struct modbus_device *device = &line->devices[index];
		size_t length = 0;

		if (!is_first_of_device(line, place) || now_ns < modbus_surely_ready_ns(device))
			continue;
		modbus_choose_function(device, &line->commands[place].request);
		modbus_forget_unanswered(device, now_ns);
		if (!modbus_owes(device, line->commands[place].request.function) &&
		    !modbus_may_be_busy(device, now_ns)) {
			line->command = modbus_take_command(line, place);
			line->request = line->command.request;
			line->counters.commands++;
			line->commands_in_row++;
			return modbus_begin(line, MODBUS_COMMAND, index, now_ns);
		}
		if (device->alive)
			length = begin_probe(line, index, now_ns);
		if (length > 0)
			return length;
	}
	return 0;
}

/* What was due first, of all devices. */
static size_t begin_kept(struct modbus_line *line, int64_t now_ns)
{
	int64_t first_ns = MODBUS_NEVER;
	uint32_t index = 0, kept = 0;

	for (uint32_t i = 0; i < line->device_count; i++) {
		struct modbus_device *device = &line->devices[i];
		uint32_t found;

		if (device->kept_count == 0)
			continue;
		modbus_forget_unanswered(device, now_ns);
		if (!modbus_find_kept(device, now_ns, &found) || device->kept[found].due_ns >= first_ns)
			continue;
		first_ns = device->kept[found].due_ns;
		index = i;
		kept = found;
	}
	if (first_ns == MODBUS_NEVER)
		return 0;
	line->kept = kept;
	line->request = *modbus_kept_request(&line->devices[index].kept[kept]);
	modbus_choose_function(&line->devices[index], &line->request);
	return modbus_begin(line, MODBUS_KEEP, index, now_ns);
}

static uint32_t find_urgent_read(const struct modbus_device *device)
{
	uint32_t read = 0;

	while (read < device->read_count &&
	       !(device->reads[read].urgent && device->reads[read].pause_ns == 0))
		read++;
	return read;
}

static size_t begin_urgent_read(struct modbus_line *line, int64_t now_ns)
{
	bool held = false;

	if (!line->urgent)
		return 0;
	for (uint32_t index = 0; index < line->device_count; index++) {
		struct modbus_device *device = &line->devices[index];
		uint32_t read = find_urgent_read(device);

		modbus_forget_unanswered(device, now_ns);
		if (!device->alive || device->unanswered_count > 0 || read == device->read_count)
			continue;
		if (is_ready(device, now_ns))
			return begin_read(line, index, read, now_ns);
		held = true;
	}
	line->urgent = held;
	return 0;
}

/* Of the reads that are due, the one whose deadline is first; of devices that owe an answer, or of the others. */
static bool find_due_read(struct modbus_line *line, bool owing, int64_t now_ns, uint32_t *index,
			  uint32_t *read)
{
	int64_t first_ns = MODBUS_NEVER;

	for (uint32_t i = 0; i < line->device_count; i++) {
		struct modbus_device *device = &line->devices[i];

		modbus_forget_unanswered(device, now_ns);
		if (!device->alive || !is_ready(device, now_ns) || (device->unanswered_count > 0) != owing)
			continue;
		if (owing && !modbus_find_probe(device, &line->request))
			continue;
		for (uint32_t j = 0; j < device->read_count; j++) {
			if (!modbus_period_due(&device->reads[j], now_ns) ||
			    modbus_period_deadline(&device->reads[j]) >= first_ns)
				continue;
			first_ns = modbus_period_deadline(&device->reads[j]);
			*index = i;
			*read = j;
		}
	}
	return first_ns != MODBUS_NEVER;
}

/* A device that owes an answer is probed before it is read, and behind the others: it may be dying. */
static size_t begin_due_read(struct modbus_line *line, int64_t now_ns)
{
	uint32_t index, read;
	size_t length = 0;

	if (find_due_read(line, false, now_ns, &index, &read))
		length = begin_read(line, index, read, now_ns);
	else if (find_due_read(line, true, now_ns, &index, &read))
		length = begin_probe(line, index, now_ns);
	line->due_in_row += length > 0;
	return length;
}

/* The next dead device whose probe is due, after the one that was probed last. */
static size_t begin_due_probe(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t tried = 0; tried < line->device_count; tried++) {
		uint32_t index = line->probe_turn;
		struct modbus_device *device = &line->devices[index];
		size_t length = 0;

		line->probe_turn = (line->probe_turn + 1) % line->device_count;
		modbus_forget_unanswered(device, now_ns);
		if (!device->alive && modbus_is_readable(device) && is_ready(device, now_ns) &&
		    now_ns >= modbus_probe_due_ns(line, device))
			length = begin_probe(line, index, now_ns);
		if (length > 0)
			return length;
	}
	return 0;
}

/* A device that has to rest goes on from where it is when its turn comes again: the others do not wait for it. */
static void leave_device(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->turn];

	if (device->alive && device->cursor < device->read_count && !is_ready(device, now_ns))
		line->scan_held = true;
	else
		device->cursor = 0;
}

static void next_turn(struct modbus_line *line, int64_t now_ns)
{
	leave_device(line, now_ns);
	if (++line->turn < line->device_count)
		return;
	line->turn = 0;
	line->probed_in_vain = false;
	if (line->scan_held) {
		line->scan_held = false;
		return;
	}
	/* Else nothing was answered in it. */
	if (line->scan_begun && line->scan_ended_ns >= line->scan_began_ns) {
		line->counters.scan_us = (uint32_t)((line->scan_ended_ns - line->scan_began_ns) / NS_PER_US);
		line->counters.scans++;
		line->whole_scan_began_ns = line->scan_began_ns;
	}
	line->scan_begun = false;
}

static bool is_of_scan(const struct modbus_read *read, int64_t now_ns)
{
	return read->period_ns == 0 && (read->pause_ns == 0 || now_ns >= read->not_before_ns);
}

/* The next read of the device whose turn it is; 0 when it is through. */
static size_t begin_scan_read(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->turn];

	while (device->cursor < device->read_count && !is_of_scan(&device->reads[device->cursor], now_ns))
		device->cursor++;
	if (device->cursor >= device->read_count)
		return 0;
	if (!line->scan_begun) {
		line->scan_begun = true;
		line->scan_began_ns = now_ns;
	}
	return begin_read(line, line->turn, device->cursor, now_ns);
}

static size_t begin_for_turn(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_device *device = &line->devices[line->turn];

	modbus_forget_unanswered(device, now_ns);
	if (!device->alive || !is_ready(device, now_ns))
		return 0;
	if (device->unanswered_count > 0)
		return begin_probe(line, line->turn, now_ns);
	return begin_scan_read(line, now_ns);
}

static size_t begin_scan(struct modbus_line *line, int64_t now_ns)
{
	/* Each twice: it may only have to end its scan, with a read that went ahead while it rested. */
	for (uint32_t tried = 0; tried < 2 * line->device_count; tried++) {
		size_t length = begin_for_turn(line, now_ns);

		if (length > 0)
			return length;
		next_turn(line, now_ns);
	}
	return 0;
}

static size_t begin_identify(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t i = 0; now_ns >= line->identify_free_ns && i < line->device_count; i++) {
		const struct modbus_device *device = &line->devices[i];

		if (!modbus_may_identify(line, device, now_ns))
			continue;
		line->request = modbus_identity_request(device->identity, device->unit);
		return modbus_begin(line, MODBUS_IDENTIFY, i, now_ns);
	}
	return 0;
}

static size_t begin_pass(struct modbus_line *line, int64_t now_ns)
{
	if (!line->passing)
		return 0;
	if (now_ns > line->passed.deadline_ns) {
		modbus_pass_ended(line, MODBUS_TOO_OLD, NULL, 0, now_ns);
		return 0;
	}
	modbus_forget_unanswered(&line->devices[line->passed.device], now_ns);
	if (!modbus_may_pass(line, now_ns))
		return 0;
	line->request = modbus_passed_request(&line->passed);
	return modbus_begin(line, MODBUS_PASS, line->passed.device, now_ns);
}

/* What keeps its place in the line's turn: however many devices are dead, the living are scanned after each probe. */
static size_t begin_in_turn(struct modbus_line *line, int64_t now_ns)
{
	size_t length = 0;

	line->due_in_row = 0;
	if (!line->probed_in_vain)
		length = begin_due_probe(line, now_ns);
	if (length == 0)
		length = begin_scan(line, now_ns);
	return length;
}

/* However many commands come and writes of its own are due, polling goes on; however many reads are due, the scan does. */
size_t modbus_begin_next(struct modbus_line *line, int64_t now_ns)
{
	size_t length = begin_chosen_read(line, now_ns);

	if (length > 0)
		return length;
	if (line->commands_in_row < MODBUS_COMMANDS_IN_ROW)
		length = begin_command(line, now_ns);
	if (length > 0)
		return length;
	length = begin_urgent_read(line, now_ns);
	if (length > 0)
		return length;
	line->commands_in_row = 0;
	if (!line->kept_last)
		length = begin_kept(line, now_ns);
	if (length > 0)
		return length;
	if (line->due_in_row < MODBUS_DUE_IN_ROW)
		length = begin_due_read(line, now_ns);
	if (length == 0)
		length = begin_identify(line, now_ns);
	if (length == 0)
		length = begin_pass(line, now_ns);
	if (length == 0)
		length = begin_in_turn(line, now_ns);
	/* Nobody is kept waiting. */
	if (length == 0)
		length = begin_command(line, now_ns);
	if (length == 0)
		length = begin_kept(line, now_ns);
	if (length == 0)
		length = begin_due_read(line, now_ns);
	if (length == 0)
		length = begin_due_probe(line, now_ns);
	return length;
}

/* It is asked something else at once: only an answer settles what it owes. */
static bool is_to_settle(const struct modbus_device *device, int64_t now_ns)
{
	struct modbus_request probe;

	return device->unanswered_count > 0 && now_ns < device->trust_ns && modbus_find_probe(device, &probe);
}

static bool is_due(const struct modbus_line *line, const struct modbus_device *device, int64_t now_ns)
{
	uint32_t kept;

	if (!is_ready(device, now_ns))
		return false;
	if (!device->alive)
		return modbus_is_readable(device) && now_ns >= modbus_probe_due_ns(line, device);
	if (is_to_settle(device, now_ns) || modbus_find_kept(device, now_ns, &kept) ||
	    modbus_may_identify(line, device, now_ns))
		return true;
	for (uint32_t i = 0; i < device->read_count; i++)
		if (is_of_scan(&device->reads[i], now_ns) || modbus_period_due(&device->reads[i], now_ns))
			return true;
	return false;
}

bool modbus_is_anything_due(const struct modbus_line *line, int64_t now_ns)
{
	if (line->command_count > 0 || line->urgent || modbus_may_pass(line, now_ns))
		return true;
	for (uint32_t i = 0; i < line->device_count; i++)
		if (is_due(line, &line->devices[i], now_ns))
			return true;
	return false;
}

int64_t modbus_next_due(const struct modbus_line *line, int64_t now_ns)
{
	int64_t due = modbus_next_pass_ns(line, now_ns);

	for (uint32_t i = 0; i < line->device_count; i++) {
		const struct modbus_device *device = &line->devices[i];

		if ((device->unanswered_count > 0 || device->inherited) && device->trust_ns > now_ns)
			due = earlier(due, device->trust_ns);
		if (!is_ready(device, now_ns))
			due = earlier(due, modbus_ready_ns(device));
		due = earlier(due, modbus_next_kept_ns(device, now_ns));
		due = earlier(due, modbus_next_identify_ns(line, device, now_ns));
		if ((line->command_count > 0 || device->kept_count > 0) &&
		    now_ns < modbus_surely_ready_ns(device))
			due = earlier(due, modbus_surely_ready_ns(device));
		if (modbus_may_be_busy(device, now_ns))
			due = earlier(due, device->trust_ns - MODBUS_LATE_NS);
		if (!device->alive && modbus_is_readable(device) &&
		    modbus_probe_due_ns(line, device) > now_ns)
			due = earlier(due, modbus_probe_due_ns(line, device));
		for (uint32_t read = 0; device->alive && read < device->read_count; read++) {
			if (device->reads[read].not_before_ns > now_ns)
				due = earlier(due, device->reads[read].not_before_ns);
			if (device->reads[read].period_ns > 0 && device->reads[read].due_ns > now_ns)
				due = earlier(due, device->reads[read].due_ns);
		}
	}
	return due;
}
