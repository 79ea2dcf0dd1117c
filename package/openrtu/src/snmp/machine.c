/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Of the machine: interfaces (RFC 2863), uptime, memory and storage (RFC 2790). */
#include "snmp/machine.h"

#include <string.h>

#include "snmp/agent.h"

/* ---- numbers that last ------------------------------------------------------------------- */

static const struct snmp_numbered *find_number(const struct snmp_numbered *list, uint32_t count,
					       uint32_t number)
{
	for (uint32_t i = 0; i < count; i++)
		if (list[i].number == number)
			return &list[i];
	return NULL;
}

static uint32_t free_number(const struct snmp_numbered *list, uint32_t count, uint32_t wanted)
{
	uint32_t most = wanted - 1;

	if (find_number(list, count, wanted) == NULL)
		return wanted;
	for (uint32_t i = 0; i < count; i++)
		if (list[i].number > most)
			most = list[i].number;
	return most + 1;
}

/*
 * A name's number is what it had before, else the wanted one, else one behind all. A place whose number nobody has now is taken for
 * another name only when none is empty.
 */
static uint32_t take_number(struct snmp_numbered *list, uint32_t count, const char *name, uint32_t wanted,
			    bool (*is_taken)(const struct snmp_agent *agent, uint32_t number),
			    const struct snmp_agent *agent)
{
	struct snmp_numbered *place = NULL;

	for (uint32_t i = 0; i < count; i++) {
		const bool taken = list[i].number != 0 && is_taken(agent, list[i].number);

		if (!taken && list[i].number != 0 && strcmp(list[i].name, name) == 0)
			return list[i].number;
		if (!taken && (place == NULL || (place->number != 0 && list[i].number == 0)))
			place = &list[i];
	}
	if (place == NULL)
		return 0;
	*place = (struct snmp_numbered){.number = free_number(list, count, wanted)};
	strcpy(place->name, name);
	return place->number;
}

/* ---- interfaces -------------------------------------------------------------------------- */

static bool has_interface(const struct snmp_agent *agent, uint32_t number)
{
	for (uint32_t i = 0; i < agent->machine.interface_count; i++)
		if (agent->machine.interfaces[i].number == number)
			return true;
	return false;
}

/* What changed while the agent was not there is as if it had been so before (RFC 2863, ifLastChange). */
static int64_t moment(const struct snmp_agent *agent)
{
	return agent->machine.up_ns == 0 ? 0 : agent->now_ns;
}

static struct snmp_interface *interface_of(struct snmp_machine *machine, uint32_t kernel)
{
	for (uint32_t i = 0; i < machine->interface_count; i++)
		if (machine->interfaces[i].kernel == kernel)
			return &machine->interfaces[i];
	return NULL;
}

/* Each that is there has one. */
static struct snmp_numbered *numbered_interface(const struct snmp_agent *agent, uint32_t number)
{
	struct snmp_numbered *numbered = agent->shared->interfaces;

	while (numbered->number != number)
		numbered++;
	return numbered;
}

/* NULL: there are too many. */
static struct snmp_interface *add_interface(struct snmp_agent *agent, const struct snmp_interface *interface)
{
	struct snmp_machine *machine = &agent->machine;
	uint32_t number, at = machine->interface_count;

	if (machine->interface_count == SNMP_INTERFACES_MAX)
		return NULL;
	number = take_number(agent->shared->interfaces, SNMP_INTERFACES_MAX, interface->name,
			     interface->kernel, has_interface, agent);
	while (at > 0 && machine->interfaces[at - 1].number > number)
		at--;
	memmove(&machine->interfaces[at + 1], &machine->interfaces[at],
		(machine->interface_count - at) * sizeof(machine->interfaces[0]));
	machine->interface_count++;
	machine->interfaces_changed_ns = moment(agent);
	machine->interfaces[at] = (struct snmp_interface){.number = number,
							  .link = interface->link,
							  .told = numbered_interface(agent, number)->link,
							  .came_ns = machine->interfaces_changed_ns,
							  .changed_ns = machine->interfaces_changed_ns};
	return &machine->interfaces[at];
}

void snmp_interface_is(struct snmp_agent *agent, const struct snmp_interface *interface)
{
	struct snmp_interface *own = interface_of(&agent->machine, interface->kernel), before;

	if (own == NULL)
		own = add_interface(agent, interface);
	else if (strcmp(own->name, interface->name) != 0)
		strcpy(numbered_interface(agent, own->number)->name, interface->name);
	if (own == NULL)
		return;
	before = *own;
	*own = *interface;
	own->number = before.number;
	own->came_ns = before.came_ns;
	own->told_ns = before.told_ns;
	own->told = before.told;
	own->changed_ns = before.link == interface->link ? before.changed_ns : moment(agent);
	own->seen = true;
}

/* RFC 2863: linkDown is into the state down, and linkUp out of it; what is not present has neither, nor what is seen for the first time. */
static void tell_link(struct snmp_agent *agent, struct snmp_interface *own)
{
	const uint8_t before = own->told;
	const bool down = own->link == SNMP_LINK_DOWN;

	own->told = own->link;
	numbered_interface(agent, own->number)->link = own->link;
	if (before == 0 || before == SNMP_LINK_NOT_PRESENT || own->link == SNMP_LINK_NOT_PRESENT ||
	    down == (before == SNMP_LINK_DOWN))
		return;
	own->told_ns = agent->now_ns;
	snmp_event_add_now(agent,
			   (struct snmp_event){.kind = down ? SNMP_EVENT_LINK_DOWN : SNMP_EVENT_LINK_UP,
					       .ca = SNMP_NO_CA,
					       .value.u = own->number,
					       .state = own->link,
					       .result = own->enabled ? SNMP_LINK_UP : SNMP_LINK_DOWN});
}

#define LINK_PAUSE_NS NS_PER_S /* a loose contact fills no table of events */

void snmp_links_tick(struct snmp_agent *agent)
{
	for (uint32_t i = 0; i < agent->machine.interface_count; i++) {
		struct snmp_interface *own = &agent->machine.interfaces[i];

		if (own->link != own->told && agent->now_ns - own->told_ns >= LINK_PAUSE_NS)
			tell_link(agent, own);
	}
}

/* What has gone is down. */
static void tell_gone(struct snmp_agent *agent, struct snmp_interface *own)
{
	own->link = SNMP_LINK_DOWN;
	own->enabled = false;
	if (own->told != 0 && own->told != own->link)
		tell_link(agent, own);
}

/* Keeps what was seen. */
static void keep_interfaces(struct snmp_agent *agent)
{
	struct snmp_machine *machine = &agent->machine;
	uint32_t kept = 0;

	for (uint32_t i = 0; i < machine->interface_count; i++)
		if (machine->interfaces[i].seen)
			machine->interfaces[kept++] = machine->interfaces[i];
		else
			tell_gone(agent, &machine->interfaces[i]);
	if (kept < machine->interface_count)
		machine->interfaces_changed_ns = moment(agent);
	machine->interface_count = kept;
}

static void see_all(struct snmp_machine *machine, bool seen)
{
	for (uint32_t i = 0; i < machine->interface_count; i++)
		machine->interfaces[i].seen = seen;
}

void snmp_interface_gone(struct snmp_agent *agent, uint32_t kernel)
{
	struct snmp_interface *own = interface_of(&agent->machine, kernel);

	if (own == NULL)
		return;
	see_all(&agent->machine, true);
	own->seen = false;
	keep_interfaces(agent);
}

void snmp_interfaces_before(struct snmp_agent *agent)
{
	see_all(&agent->machine, false);
}

void snmp_interfaces_after(struct snmp_agent *agent)
{
	keep_interfaces(agent);
}

/* Ticks of sysUpTime at a moment. */
static void put_up_time(const struct snmp_agent *agent, struct snmp_value *out, int64_t time_ns)
{
	snmp_put_number(out, SNMP_TICKS,
			time_ns == 0 ? 0 : (uint32_t)((time_ns - agent->started_ns) / (10 * NS_PER_MS)));
}

static bool read_interface_count(struct snmp_agent *agent, uint32_t column, uint32_t row,
				 struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_INTEGER, agent->machine.interface_count);
	return true;
}

static bool read_interfaces_changed(struct snmp_agent *agent, uint32_t column, uint32_t row,
				    struct snmp_value *out)
{
	(void)column, (void)row;
	put_up_time(agent, out, agent->machine.interfaces_changed_ns);
	return true;
}

static uint32_t count_interfaces(const struct snmp_agent *agent)
{
	return agent->machine.interface_count;
}

static void index_interface(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	out[0] = agent->machine.interfaces[row].number;
}

enum {
	IF_INDEX = 1,
	IF_DESCRIPTION,
	IF_TYPE,
	IF_MTU,
	IF_SPEED,
	IF_ADDRESS,
	IF_ADMIN_STATUS,
	IF_OPER_STATUS,
	IF_LAST_CHANGE,
	IF_IN_OCTETS,
	IF_IN_PACKETS,
	IF_IN_DISCARDS = 13,
	IF_IN_ERRORS,
	IF_OUT_OCTETS = 16,
	IF_OUT_PACKETS,
	IF_OUT_DISCARDS = 19,
	IF_OUT_ERRORS,
};

#define SPEED_MAX 4294967295u /* RFC 2863: of what is faster, ifHighSpeed says how fast */

static void put_octets(struct snmp_value *out, const uint8_t *octets, uint16_t size)
{
	out->syntax = SNMP_OCTETS;
	out->size = size;
	memcpy(out->octets, octets, size);
}

static void put_speed(struct snmp_value *out, uint32_t megabits)
{
	const uint64_t speed = megabits * UINT64_C(1000000);

	snmp_put_number(out, SNMP_GAUGE, (int64_t)(speed < SPEED_MAX ? speed : SPEED_MAX));
}

static bool read_traffic(const struct snmp_interface *interface, uint32_t column, struct snmp_value *out)
{
	static const uint8_t of_columns[] = {
	    [IF_IN_OCTETS] = SNMP_IN_OCTETS,       [IF_IN_PACKETS] = SNMP_IN_PACKETS,
	    [IF_IN_DISCARDS] = SNMP_IN_DISCARDS,   [IF_IN_ERRORS] = SNMP_IN_ERRORS,
	    [IF_OUT_OCTETS] = SNMP_OUT_OCTETS,     [IF_OUT_PACKETS] = SNMP_OUT_PACKETS,
	    [IF_OUT_DISCARDS] = SNMP_OUT_DISCARDS, [IF_OUT_ERRORS] = SNMP_OUT_ERRORS,
	};

	snmp_put_number(out, SNMP_COUNTER, (uint32_t)interface->traffic[of_columns[column]]);
	return true;
}

static bool read_interface(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const struct snmp_interface *interface = &agent->machine.interfaces[row];

	switch (column) {
	case IF_INDEX:
		snmp_put_number(out, SNMP_INTEGER, interface->number);
		return true;
	case IF_DESCRIPTION:
		snmp_put_text(out, interface->name);
		return true;
	case IF_TYPE:
		snmp_put_number(out, SNMP_INTEGER, interface->type);
		return true;
	case IF_MTU:
		snmp_put_number(out, SNMP_INTEGER, interface->mtu & INT32_MAX);
		return true;
	case IF_SPEED:
		put_speed(out, interface->speed);
		return true;
	case IF_ADDRESS:
		put_octets(out, interface->address, interface->address_size);
		return true;
	case IF_ADMIN_STATUS:
		snmp_put_truth(out, interface->enabled);
		return true;
	case IF_OPER_STATUS:
		snmp_put_number(out, SNMP_INTEGER, interface->link);
		return true;
	case IF_LAST_CHANGE:
		put_up_time(agent, out, interface->changed_ns);
		return true;
	default:
		return read_traffic(interface, column, out);
	}
}

enum {
	IF_NAME = 1,
	IF_IN_MULTICAST,
	IF_HC_IN_OCTETS = 6,
	IF_HC_IN_PACKETS,
	IF_HC_IN_MULTICAST,
	IF_HC_OUT_OCTETS = 10,
	IF_HC_OUT_PACKETS,
	IF_TRAPS = 14,
	IF_HIGH_SPEED,
	IF_PROMISCUOUS,
	IF_CONNECTOR,
	IF_ALIAS,
	IF_DISCONTINUITY,
};

static bool read_long_traffic(const struct snmp_interface *interface, uint32_t column, struct snmp_value *out)
{
	static const uint8_t of_columns[] = {
	    [IF_HC_IN_OCTETS] = SNMP_IN_OCTETS,       [IF_HC_IN_PACKETS] = SNMP_IN_PACKETS,
	    [IF_HC_IN_MULTICAST] = SNMP_IN_MULTICAST, [IF_HC_OUT_OCTETS] = SNMP_OUT_OCTETS,
	    [IF_HC_OUT_PACKETS] = SNMP_OUT_PACKETS,
	};

	snmp_put_number(out, SNMP_COUNTER_64, (int64_t)interface->traffic[of_columns[column]]);
	return true;
}

enum { TRAPS_ENABLED = 1 };

static bool read_extra(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const struct snmp_interface *interface = &agent->machine.interfaces[row];

	switch (column) {
	case IF_NAME:
		snmp_put_text(out, interface->name);
		return true;
	case IF_IN_MULTICAST:
		snmp_put_number(out, SNMP_COUNTER, (uint32_t)interface->traffic[SNMP_IN_MULTICAST]);
		return true;
	case IF_TRAPS:
		snmp_put_number(out, SNMP_INTEGER, TRAPS_ENABLED);
		return true;
	case IF_HIGH_SPEED:
		snmp_put_number(out, SNMP_GAUGE, interface->speed);
		return true;
	case IF_PROMISCUOUS:
		snmp_put_truth(out, interface->promiscuous);
		return true;
	case IF_CONNECTOR:
		snmp_put_truth(out, interface->connector);
		return true;
	case IF_ALIAS:
		snmp_put_text(out, interface->alias);
		return true;
	case IF_DISCONTINUITY:
		put_up_time(agent, out, interface->came_ns);
		return true;
	default:
		return read_long_traffic(interface, column, out);
	}
}

const struct snmp_table snmp_interface_count = {
    .prefix = {2, 1}, .prefix_length = 2, .read = read_interface_count};
const struct snmp_table snmp_interfaces_changed = {
    .prefix = {31, 1, 5}, .prefix_length = 3, .read = read_interfaces_changed};

/* What RFC 2863 deprecates, and what Linux does not count, is not there. */
#define COLUMNS(first_, last_, reader, ...)                                                                  \
	{                                                                                                    \
		.prefix = {__VA_ARGS__}, .prefix_length = sizeof((uint8_t[]){__VA_ARGS__}), .first = first_, \
		.last = last_, .indexes = 1, .count = count_interfaces, .index = index_interface,            \
		.read = reader                                                                               \
	}
const struct snmp_table snmp_interface_tables[4] = {
    COLUMNS(IF_INDEX, IF_IN_PACKETS, read_interface, 2, 2),
    COLUMNS(IF_IN_DISCARDS, IF_IN_ERRORS, read_interface, 2, 2),
    COLUMNS(IF_OUT_OCTETS, IF_OUT_PACKETS, read_interface, 2, 2),
    COLUMNS(IF_OUT_DISCARDS, IF_OUT_ERRORS, read_interface, 2, 2),
};
const struct snmp_table snmp_interface_extras[4] = {
    COLUMNS(IF_NAME, IF_IN_MULTICAST, read_extra, 31, 1, 1),
    COLUMNS(IF_HC_IN_OCTETS, IF_HC_IN_MULTICAST, read_extra, 31, 1, 1),
    COLUMNS(IF_HC_OUT_OCTETS, IF_HC_OUT_PACKETS, read_extra, 31, 1, 1),
    COLUMNS(IF_TRAPS, IF_DISCONTINUITY, read_extra, 31, 1, 1),
};

/* ---- storage ----------------------------------------------------------------------------- */

/* Net-SNMP's numbers, which managers know: memory 1, swap 10, file systems from 31 on. */
#define NUMBER_OF_RAM   1
#define NUMBER_OF_SWAP  10
#define FIRST_OF_MOUNTS 31

static bool has_storage(const struct snmp_agent *agent, uint32_t number)
{
	for (uint32_t i = 0; i < agent->machine.storage_count; i++)
		if (agent->machine.storages[i].number == number)
			return true;
	return false;
}

static struct snmp_storage *storage_of(struct snmp_machine *machine, const struct snmp_storage *storage)
{
	for (uint32_t i = 0; i < machine->storage_count; i++)
		if (strcmp(machine->storages[i].name, storage->name) == 0)
			return &machine->storages[i];
	return NULL;
}

static uint32_t number_of_storage(struct snmp_agent *agent, const struct snmp_storage *storage)
{
	if (storage->type == SNMP_STORAGE_RAM)
		return NUMBER_OF_RAM;
	if (storage->type == SNMP_STORAGE_VIRTUAL)
		return NUMBER_OF_SWAP;
	return take_number(agent->shared->mounts, SNMP_MOUNTS_MAX, storage->name, FIRST_OF_MOUNTS,
			   has_storage, agent);
}

/* NULL: there are too many. */
static struct snmp_storage *add_storage(struct snmp_agent *agent, const struct snmp_storage *storage)
{
	struct snmp_machine *machine = &agent->machine;
	const uint32_t number =
	    machine->storage_count == SNMP_STORAGES_MAX ? 0 : number_of_storage(agent, storage);
	uint32_t at = machine->storage_count;

	if (number == 0)
		return NULL;
	for (; at > 0 && machine->storages[at - 1].number > number; at--)
		machine->storages[at] = machine->storages[at - 1];
	machine->storages[at].number = number;
	machine->storage_count++;
	return &machine->storages[at];
}

void snmp_storages_before(struct snmp_agent *agent)
{
	for (uint32_t i = 0; i < agent->machine.storage_count; i++)
		agent->machine.storages[i].seen = false;
}

void snmp_storage_is(struct snmp_agent *agent, const struct snmp_storage *storage)
{
	struct snmp_storage *own = storage_of(&agent->machine, storage);
	uint32_t number;

	if (own == NULL)
		own = add_storage(agent, storage);
	if (own == NULL)
		return;
	number = own->number;
	*own = *storage;
	own->number = number;
	own->seen = true;
}

void snmp_storages_after(struct snmp_agent *agent)
{
	struct snmp_machine *machine = &agent->machine;
	uint32_t kept = 0;

	for (uint32_t i = 0; i < machine->storage_count; i++)
		if (machine->storages[i].seen)
			machine->storages[kept++] = machine->storages[i];
	machine->storage_count = kept;
}

static uint32_t count_storages(const struct snmp_agent *agent)
{
	return agent->machine.storage_count;
}

static void index_storage(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX])
{
	out[0] = agent->machine.storages[row].number;
}

enum { STORAGE_INDEX = 1, STORAGE_TYPE, STORAGE_DESCRIPTION, STORAGE_UNIT, STORAGE_SIZE, STORAGE_USED };

/* hrStorageSize has 31 bits: of what is larger, units are. */
static unsigned shift_of(const struct snmp_storage *storage)
{
	unsigned shift = 0;

	while (storage->size >> shift > INT32_MAX && storage->unit << shift <= INT32_MAX / 2)
		shift++;
	return shift;
}

static void put_bounded(struct snmp_value *out, uint64_t number)
{
	snmp_put_number(out, SNMP_INTEGER, (int64_t)(number < INT32_MAX ? number : INT32_MAX));
}

static void put_storage_type(struct snmp_value *out, uint8_t type)
{
	static const uint32_t types[] = {1, 3, 6, 1, 2, 1, 25, 2, 1};
	const size_t length = sizeof(types) / sizeof(types[0]);

	out->syntax = SNMP_OID;
	out->size = (uint16_t)(length + 1);
	memcpy(out->ids, types, sizeof(types));
	out->ids[length] = type;
}

static bool read_storage(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const struct snmp_storage *storage = &agent->machine.storages[row];
	const unsigned shift = shift_of(storage);

	switch (column) {
	case STORAGE_INDEX:
		snmp_put_number(out, SNMP_INTEGER, storage->number);
		return true;
	case STORAGE_TYPE:
		put_storage_type(out, storage->type);
		return true;
	case STORAGE_DESCRIPTION:
		snmp_put_text(out, storage->name);
		return true;
	case STORAGE_UNIT:
		put_bounded(out, storage->unit << shift);
		return true;
	case STORAGE_SIZE:
		put_bounded(out, storage->size >> shift);
		return true;
	default:
		put_bounded(out, storage->used >> shift);
		return true;
	}
}

static bool read_machine_uptime(struct snmp_agent *agent, uint32_t column, uint32_t row,
				struct snmp_value *out)
{
	(void)column, (void)row;
	snmp_put_number(out, SNMP_TICKS, (uint32_t)(agent->machine.up_ns / (10 * NS_PER_MS)));
	return true;
}

static bool read_memory_size(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	(void)column, (void)row;
	put_bounded(out, agent->machine.memory_kb);
	return true;
}

const struct snmp_table snmp_machine_uptime = {
    .prefix = {25, 1, 1}, .prefix_length = 3, .read = read_machine_uptime};
const struct snmp_table snmp_memory_size = {
    .prefix = {25, 2, 2}, .prefix_length = 3, .read = read_memory_size};
const struct snmp_table snmp_storage_table = {.prefix = {25, 2, 3},
					      .prefix_length = 3,
					      .first = STORAGE_INDEX,
					      .last = STORAGE_USED,
					      .indexes = 1,
					      .count = count_storages,
					      .index = index_storage,
					      .read = read_storage};
