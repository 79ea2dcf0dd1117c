/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "line_parts.h"
#include "map/time_ns.h"

#define SETTLE_FIRST_NS (500 * NS_PER_MS)
#define SLOW_STARTS     2 /* once may be anything */

static int64_t settle_ns(const struct modbus_connection *connection)
{
	if (connection->trying)
		return connection->settle_least_ns;
	return later(connection->settle_ns, connection->settle_least_ns);
}

/* Its first request may be sent when the peer has had its time. */
void modbus_connection_made(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_connection *connection = &line->connection;

	connection->there = true;
	connection->made_ns = now_ns;
	connection->answers = connection->vain = 0;
	connection->asked = false;
	connection->trying = connection->worked && !connection->settled;
	line->silent_ns = line->restless_ns = later(line->silent_ns, now_ns + settle_ns(connection));
}

void modbus_connection_asked(struct modbus_line *line)
{
	if (line->purpose != MODBUS_PASS)
		line->connection.asked = line->connection.there;
}

/* ---- it brings something, or nothing ------------------------------------------------------------------ */

static void learn_settled(struct modbus_connection *connection, int64_t settle_ns)
{
	connection->settle_ns = settle_ns;
	connection->settled = settle_ns > 0;
	connection->worked = connection->trying = false;
}

/* The first request that was answered was not the first one: once more, and the others came too soon. */
static void learn_settling(struct modbus_line *line)
{
	struct modbus_connection *connection = &line->connection;
	int64_t took_ns = begun_ns(line) - connection->made_ns;

	if (connection->vain == 0 || took_ns > MODBUS_SETTLE_MAX_NS)
		connection->slow_starts = 0;
	else if (++connection->slow_starts >= SLOW_STARTS)
		learn_settled(connection, later(connection->settle_ns, took_ns));
}

/* Behind a time that was guessed; without it, it was none. */
static void prove_settling(struct modbus_connection *connection)
{
	if (connection->trying)
		learn_settled(connection, 0);
	else
		connection->worked |= connection->settle_ns > 0;
}

void modbus_connection_answered(struct modbus_line *line)
{
	struct modbus_connection *connection = &line->connection;

	if (!connection->there)
		return;
	if (connection->answers == 0) {
		prove_settling(connection);
		learn_settling(line);
	}
	connection->answers++;
	connection->vain = 0;
	connection->patience_ns = 0;
}

void modbus_connection_unanswered(struct modbus_line *line)
{
	if (line->connection.there && line->connection.vain++ == 0)
		line->connection.vain_ns = line->sent_ns;
}

static bool is_answered_by_some(const struct modbus_line *line)
{
	for (uint32_t i = 0; i < line->device_count; i++)
		if (line->devices[i].alive && line->devices[i].failures == 0)
			return true;
	return false;
}

bool modbus_connection_is_hung(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_connection *connection = &line->connection;
	int64_t first_ns = line->devices[line->device].response_timeout_ns + MODBUS_LATE_NS;
	int64_t patience_ns = later(connection->patience_ns, first_ns);
	uint32_t enough = connection->patience_ns == 0 ? MODBUS_HUNG_REQUESTS : 1;

	if (!connection->there || connection->vain < enough || now_ns - connection->vain_ns < patience_ns ||
	    is_answered_by_some(line))
		return false;
	connection->patience_ns = earlier(2 * patience_ns, MODBUS_RAREST_PROBE_NS);
	connection->there = false;
	connection->hung++;
	/* Whether it was the connection shows on the next. */
	for (uint32_t i = 0; i < line->device_count; i++)
		line->devices[i].next_probe_ns = line->devices[i].lone_probe_ns = now_ns;
	return true;
}

/* ---- the peer hangs up -------------------------------------------------------------------------------- */

static bool is_under_way(const struct modbus_line *line)
{
	return line->state == MODBUS_WAITING || line->state == MODBUS_TURNAROUND;
}

/* It hung up on its first request, which may have come too soon; where time does not help, it begins anew. */
static void wait_longer(struct modbus_connection *connection)
{
	if (connection->settle_ns >= MODBUS_SETTLE_MAX_NS)
		learn_settled(connection, 0);
	else if (connection->settle_ns == 0)
		connection->settle_ns = SETTLE_FIRST_NS;
	else
		connection->settle_ns = earlier(connection->settle_ns * 9 / 4, MODBUS_SETTLE_MAX_NS);
}

/* Nothing was under way: so long nobody had asked anything. */
static void learn_idling(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_connection *connection = &line->connection;
	int64_t idle_ns = later(now_ns - line->scan_ended_ns, 1);

	if (line->scan_ended_ns >= connection->made_ns)
		connection->idle_ns =
		    connection->idle_ns == 0 ? idle_ns : earlier(connection->idle_ns, idle_ns);
}

bool modbus_connection_ended(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_connection *connection = &line->connection;

	if (!connection->there)
		return false;
	connection->there = false;
	/* What was passed on may have been too much for it. */
	if (modbus_pass_is_under_way(line))
		return true;
	if (connection->answers == 0 && !connection->trying) {
		if (connection->asked)
			wait_longer(connection);
		return false;
	}
	if (connection->trying && connection->answers == 0)
		learn_settled(connection, connection->settle_ns);
	connection->closes++;
	if (!is_under_way(line))
		learn_idling(line, now_ns);
	return true;
}

void modbus_connection_take(struct modbus_connection *connection, int64_t settle_ns)
{
	if (settle_ns > 0 && settle_ns <= MODBUS_SETTLE_MAX_NS)
		learn_settled(connection, settle_ns);
}
