/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "snmp/tree.h"

#include "snmp/agent.h"

const struct snmp_table *snmp_table_at(const struct snmp_agent *agent, const struct snmp_place *place)
{
	return agent->roots[place->root].tables[place->table];
}

static uint32_t rows_of(const struct snmp_agent *agent, const struct snmp_table *table)
{
	return table->count == NULL ? 1 : table->count(agent);
}

static uint32_t entry_of(const struct snmp_table *table)
{
	return table->entry == 0 ? 1 : table->entry;
}

/* What an instance's name has between its root and its index. */
static size_t object_ids(const struct snmp_table *table, uint32_t column, uint32_t out[SNMP_IDS_MAX])
{
	size_t length = 0;

	while (length < table->prefix_length) {
		out[length] = table->prefix[length];
		length++;
	}
	if (table->last == 0) {
		out[length++] = 0;
		return length;
	}
	out[length++] = entry_of(table);
	out[length++] = column;
	return length;
}

size_t snmp_name(const struct snmp_agent *agent, const struct snmp_place *place, uint32_t out[SNMP_IDS_MAX])
{
	const struct snmp_root *root = &agent->roots[place->root];
	const struct snmp_table *table = snmp_table_at(agent, place);
	size_t length = root->length;

	for (size_t i = 0; i < length; i++)
		out[i] = root->ids[i];
	length += object_ids(table, place->column, &out[length]);
	if (table->indexes > 0)
		table->index(agent, place->row, &out[length]);
	return length + table->indexes;
}

/* As the names' order: a beginning lies before what it begins. */
static int compare(const uint32_t *a, size_t a_length, const uint32_t *b, size_t b_length)
{
	for (size_t i = 0; i < a_length && i < b_length; i++)
		if (a[i] != b[i])
			return a[i] < b[i] ? -1 : 1;
	return a_length == b_length ? 0 : a_length < b_length ? -1 : 1;
}

static int compare_row(const struct snmp_agent *agent, const struct snmp_table *table, uint32_t row,
		       const uint32_t *index, size_t length)
{
	uint32_t own[SNMP_INDEX_MAX];

	if (table->indexes > 0)
		table->index(agent, row, own);
	return compare(own, table->indexes, index, length);
}

/* The first row that does not lie before an index, or with_equal false, behind it. */
static uint32_t find_row(const struct snmp_agent *agent, const struct snmp_table *table,
			 const uint32_t *index, size_t length, bool with_equal)
{
	uint32_t low = 0, high = rows_of(agent, table);

	while (low < high) {
		const uint32_t middle = low + (high - low) / 2;
		const int order = compare_row(agent, table, middle, index, length);

		if (order < 0 || (order == 0 && !with_equal))
			low = middle + 1;
		else
			high = middle;
	}
	return low;
}

/* ---- exactly ----------------------------------------------------------------------------- */

static bool find_in(const struct snmp_agent *agent, const uint32_t *rest, size_t length,
		    struct snmp_place *place)
{
	const struct snmp_table *table = snmp_table_at(agent, place);
	const size_t ids = table->prefix_length + (table->last == 0 ? 1u : 2u);
	uint32_t own[SNMP_IDS_MAX];
	size_t own_length;

	if (length != ids + table->indexes)
		return false;
	place->column = table->last == 0 ? 0 : (uint8_t)rest[ids - 1];
	if (table->last != 0 && (rest[ids - 1] < table->first || rest[ids - 1] > table->last))
		return false;
	own_length = object_ids(table, place->column, own);
	if (compare(own, own_length, rest, ids) != 0)
		return false;
	place->row = find_row(agent, table, rest + ids, length - ids, true);
	return place->row < rows_of(agent, table) &&
	       compare_row(agent, table, place->row, rest + ids, length - ids) == 0;
}

bool snmp_find(const struct snmp_agent *agent, const uint32_t *name, size_t length, struct snmp_place *out)
{
	for (uint8_t i = 0; i < SNMP_ROOTS; i++) {
		const struct snmp_root *root = &agent->roots[i];

		if (length <= root->length || compare(root->ids, root->length, name, root->length) != 0)
			continue;
		for (uint32_t j = 0; j < root->count; j++) {
			*out = (struct snmp_place){.root = i, .table = (uint8_t)j};
			if (find_in(agent, name + root->length, length - root->length, out))
				return true;
		}
	}
	return false;
}

/* ---- whether there is an object ----------------------------------------------------------- */

static bool may_read(const struct snmp_table *table, enum snmp_role role)
{
	return role >= table->reader;
}

static bool is_below(const struct snmp_table *table, const uint32_t *rest, size_t length)
{
	const size_t ids = table->prefix_length + (table->last == 0 ? 0u : 2u);
	uint32_t own[SNMP_IDS_MAX];

	if (length < ids ||
	    (table->last != 0 && (rest[ids - 1] < table->first || rest[ids - 1] > table->last)))
		return false;
	object_ids(table, table->last == 0 ? 0 : rest[ids - 1], own);
	return compare(own, ids, rest, ids) == 0;
}

bool snmp_knows(const struct snmp_agent *agent, const uint32_t *name, size_t length, enum snmp_role role)
{
	for (uint8_t i = 0; i < SNMP_ROOTS; i++) {
		const struct snmp_root *root = &agent->roots[i];

		if (length < root->length || compare(root->ids, root->length, name, root->length) != 0)
			continue;
		for (uint32_t j = 0; j < root->count; j++)
			if (may_read(root->tables[j], role) &&
			    is_below(root->tables[j], name + root->length, length - root->length))
				return true;
	}
	return false;
}

/* ---- the next ---------------------------------------------------------------------------- */

/* The first instance of a column or of one behind it, behind this index of the column. */
static bool next_in_columns(const struct snmp_agent *agent, uint32_t column, const uint32_t *index,
			    size_t length, struct snmp_place *place)
{
	const struct snmp_table *table = snmp_table_at(agent, place);

	place->column = (uint8_t)column;
	place->row = index == NULL ? 0 : find_row(agent, table, index, length, false);
	if (place->row < rows_of(agent, table))
		return true;
	place->row = 0;
	place->column++;
	return column < table->last && rows_of(agent, table) > 0;
}

/* The first instance of a table behind what a name says below its root. */
static bool next_in(const struct snmp_agent *agent, const uint32_t *rest, size_t length,
		    struct snmp_place *place)
{
	const struct snmp_table *table = snmp_table_at(agent, place);
	const size_t before = table->prefix_length;
	uint32_t own[SNMP_IDS_MAX];
	int order;

	object_ids(table, table->first, own);
	order = compare(own, before, rest, length < before ? length : before);
	if (order > 0 || length <= before)
		return order >= 0 && next_in_columns(agent, table->first, NULL, 0, place);
	if (order < 0)
		return false;
	if (table->last == 0 || rest[before] > entry_of(table))
		return false; /* behind the only instance, or behind the table */
	if (rest[before] < entry_of(table) || length == before + 1 || rest[before + 1] < table->first)
		return next_in_columns(agent, table->first, NULL, 0, place);
	if (rest[before + 1] > table->last)
		return false;
	return next_in_columns(agent, rest[before + 1], rest + before + 2, length - before - 2, place);
}

/* From this table on, the first instance behind a name. */
static bool next_from(const struct snmp_agent *agent, uint8_t first_root, uint32_t first_table,
		      const uint32_t *name, size_t length, enum snmp_role role, struct snmp_place *out)
{
	for (uint8_t i = first_root; i < SNMP_ROOTS; i++) {
		const struct snmp_root *root = &agent->roots[i];
		const int order =
		    compare(root->ids, root->length, name, length < root->length ? length : root->length);
		const bool within = order == 0 && length > root->length;

		if (order < 0)
			continue;
		for (uint32_t j = i == first_root ? first_table : 0; j < root->count; j++) {
			*out = (struct snmp_place){.root = i, .table = (uint8_t)j};
			if (may_read(root->tables[j], role) &&
			    next_in(agent, within ? name + root->length : NULL,
				    within ? length - root->length : 0, out))
				return true;
		}
	}
	return false;
}

bool snmp_next(const struct snmp_agent *agent, const uint32_t *name, size_t length, enum snmp_role role,
	       struct snmp_place *out)
{
	return next_from(agent, 0, 0, name, length, role, out);
}

static const uint32_t no_name[1];

bool snmp_after(const struct snmp_agent *agent, enum snmp_role role, struct snmp_place *place)
{
	const struct snmp_table *table = snmp_table_at(agent, place);
	const uint32_t rows = rows_of(agent, table);

	if (++place->row < rows)
		return true;
	place->row = 0;
	if (place->column < table->last && rows > 0) {
		place->column++;
		return true;
	}
	/* An empty name lies before all that comes from the next table on. */
	return next_from(agent, place->root, place->table + 1u, no_name, 0, role, place);
}
