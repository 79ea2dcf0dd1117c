/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "snmp/write.h"

#include "snmp/agent.h"

static enum snmp_error find(const struct snmp_agent *agent, uint8_t user,
			    const struct snmp_assignment *assignment, struct snmp_place *place)
{
	const struct snmp_table *table;

	if (!snmp_find(agent, assignment->name, assignment->length, place))
		return SNMP_NO_CREATION;
	table = snmp_table_at(agent, place);
	if (!(table->writable & 1u << place->column))
		return SNMP_NOT_WRITABLE;
	return agent->settings->users[user].role < table->writer ? SNMP_NO_ACCESS : SNMP_GOOD;
}

/* The change of this row, or a new one. NULL: there are too many. */
static struct snmp_change *change_of(struct snmp_change *changes, unsigned *count, struct snmp_place place,
				     uint8_t user)
{
	for (unsigned i = 0; i < *count; i++)
		if (changes[i].place.root == place.root && changes[i].place.table == place.table &&
		    changes[i].place.row == place.row)
			return &changes[i];
	if (*count == SNMP_ROWS_SET_MAX)
		return NULL;
	changes[*count] = (struct snmp_change){.place = place, .user = user};
	return &changes[(*count)++];
}

static enum snmp_error gather(const struct snmp_agent *agent, uint8_t user,
			      const struct snmp_assignment *assignments, size_t count,
			      struct snmp_change *changes, unsigned *rows, size_t *index)
{
	for (size_t i = 0; i < count; i++) {
		struct snmp_place place = {0};
		enum snmp_error error = find(agent, user, &assignments[i], &place);
		struct snmp_change *change;

		*index = i + 1;
		if (error != SNMP_GOOD)
			return error;
		change = change_of(changes, rows, place, user);
		if (change == NULL)
			return SNMP_RESOURCE_UNAVAILABLE;
		if (change->given & 1u << place.column)
			return SNMP_INCONSISTENT_VALUE;
		change->given |= 1u << place.column;
		change->syntax[place.column] = assignments[i].syntax;
		change->size[place.column] = assignments[i].size;
		change->number[place.column] = assignments[i].number;
		change->place_in_request[place.column] = (uint16_t)(i + 1);
	}
	return SNMP_GOOD;
}

enum snmp_error snmp_blame(struct snmp_change *change, unsigned column, enum snmp_error error)
{
	change->fault = (uint8_t)column;
	return error;
}

enum snmp_error snmp_check_column(struct snmp_change *change, unsigned column, enum snmp_syntax syntax,
				  uint16_t size)
{
	if (!snmp_sets(change, column))
		return SNMP_GOOD;
	if (change->syntax[column] != syntax)
		return snmp_blame(change, column, SNMP_WRONG_TYPE);
	return syntax != SNMP_OCTETS || change->size[column] == size
		   ? SNMP_GOOD
		   : snmp_blame(change, column, SNMP_WRONG_LENGTH);
}

uint32_t snmp_first_spin(const struct snmp_agent *agent, uint32_t row)
{
	const uint32_t seed = (uint32_t)agent->started_ns ^ (uint32_t)(agent->started_ns >> 32);

	return (seed * 2654435761u + row * 40503u) & SNMP_SPIN_MAX;
}

enum snmp_error snmp_check_spin(struct snmp_change *change, uint32_t spin)
{
	unsigned first = SNMP_SPIN;

	while (!snmp_sets(change, first))
		first++;
	if (first == SNMP_SPIN && change->number[SNMP_SPIN] == (int64_t)spin)
		return SNMP_GOOD;
	return snmp_blame(change, first, SNMP_INCONSISTENT_VALUE);
}

enum snmp_error snmp_set(struct snmp_agent *agent, uint8_t user, const struct snmp_assignment *assignments,
			 size_t count, size_t *index)
{
	struct snmp_change changes[SNMP_ROWS_SET_MAX];
	unsigned rows = 0;
	enum snmp_error error = gather(agent, user, assignments, count, changes, &rows, index);

	for (unsigned i = 0; i < rows && error == SNMP_GOOD; i++) {
		error = snmp_table_at(agent, &changes[i].place)->check(agent, &changes[i]);
		if (error != SNMP_GOOD)
			*index = changes[i].place_in_request[changes[i].fault];
	}
	if (error != SNMP_GOOD)
		return error;
	for (unsigned i = 0; i < rows; i++)
		snmp_table_at(agent, &changes[i].place)->apply(agent, &changes[i]);
	map_count(&agent->shared->counters[SNMP_COUNT_SETS], 1);
	return SNMP_GOOD;
}
