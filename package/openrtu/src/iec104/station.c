/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/station_parts.h"
#include "map/time_ns.h"

#include <stdio.h>
#include <string.h>

struct iec104_times iec104_times_of(const struct iec104_settings *settings)
{
	return (struct iec104_times){
	    .k = settings->k,
	    .w = settings->w,
	    .t1_ns = settings->t1_s * NS_PER_S,
	    .t2_ns = settings->t2_s * NS_PER_S,
	    .t3_ns = settings->t3_s * NS_PER_S,
	};
}

uint32_t iec104_group_of(const struct iec104_station *station, uint32_t party)
{
	const struct map_settings *settings = &station->config->settings;

	return party < settings->queue_count ? settings->queues[party].slot : MAP_NONE;
}

void iec104_station_init(struct iec104_station *station, struct map *map, int64_t *sent_ns,
			 struct map_queue_place *places)
{
	const struct iec104_settings *settings = iec104_settings(map_config(map));

	station->map = map;
	station->config = map_config(map);
	station->settings = settings;
	station->next_serial = 0;
	station->now_ns = 0;
	station->lines = (struct map_lines){0};
	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		station->connections[i].open = false;
	for (unsigned i = 0; i < IEC104_OPEN_REQUESTS_MAX; i++)
		station->open_requests[i] = (struct iec104_open_request){.terminating = false};
	for (unsigned i = 0; i < IEC104_OPEN_FREEZES_MAX; i++)
		station->freezes[i].used = false;
	station->initialised = false;
	station->points_asked = 0;
	station->initialising_since_ns = 0;
	station->new_stations = NULL;
	station->new_to_tell = false;
	station->sent_ns = sent_ns;
	station->places = places;
	station->stats = iec104_stats_of(map);
	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		atomic_store(&station->stats->connections[i].open, 0);
	iec104_find_queues(station);
	station->losses_changed = true;
	station->times = iec104_times_of(settings);
}

/* ---- connections ------------------------------------------------------------------------- */

static void count(struct iec104_station *station, enum iec104_counter counter)
{
	map_count(&station->stats->counters[counter], 1);
}

static void open_session(struct iec104_station *station, struct iec104_connection *connection,
			 int64_t *sent_ns, int64_t now_ns)
{
	const struct iec104_memory memory = {.sent_ns = sent_ns,
					     .input = connection->input,
					     .output = connection->output,
					     .input_size = sizeof(connection->input),
					     .output_size = sizeof(connection->output)};

	iec104_session_open(&connection->session, &station->times, IEC104_CONTROLLED,
			    station->stats->counters, &memory, now_ns);
}

struct iec104_connection *iec104_station_connect(struct iec104_station *station,
						 const struct iec104_peer *peer, int64_t now_ns)
{
	const struct iec104_settings *settings = station->settings;

	station->now_ns = now_ns;
	if (!iec104_admits(station, peer)) {
		count(station, IEC104_COUNT_TOO_MANY);
		return NULL;
	}
	for (unsigned i = 0; i < settings->max_connections && i < IEC104_CONNECTIONS_MAX; i++) {
		struct iec104_connection *connection = &station->connections[i];

		if (connection->open)
			continue;
		memset(connection, 0, sizeof(*connection));
		connection->open = true;
		connection->clock_master = peer->clock_master;
		connection->party = peer->party;
		connection->group = iec104_group_of(station, peer->party);
		connection->since_ns = now_ns;
		connection->queue = MAP_NONE;
		connection->serial = ++station->next_serial;
		connection->places = station->places + (size_t)i * settings->k;
		connection->retry_ns = INT64_MAX;
		snprintf(connection->peer, sizeof(connection->peer), "%s", peer->name);
		snprintf(connection->address, sizeof(connection->address), "%s", peer->address);
		open_session(station, connection, station->sent_ns + (size_t)i * settings->k, now_ns);
		count(station, IEC104_COUNT_ACCEPTED);
		iec104_show_opened(station, connection);
		iec104_log(station, MAP_LOG_INFO, peer->name, "connected");
		return connection;
	}
	return NULL;
}

void iec104_station_refuse(struct iec104_station *station, const char *name, int64_t now_ns)
{
	station->now_ns = now_ns;
	count(station, IEC104_COUNT_NOT_LISTED);
	iec104_log(station, MAP_LOG_WARNING, name, "refused, its address is not in \"masters\"");
}

void iec104_station_disconnect(struct iec104_station *station, struct iec104_connection *connection)
{
	iec104_session_close(&connection->session, IEC104_CLOSED_BY_STATION);
	iec104_log(station, MAP_LOG_INFO, connection->peer, "connection ends: %s",
		   iec104_closing_text(connection->session.closing));
	iec104_release_queue(station, connection);
	iec104_show_closed(station, connection);
	connection->open = false;
	iec104_drop_terminations(station, connection);
	iec104_end_selections(station, connection);
}

/* ---- what is due ------------------------------------------------------------------------- */

/* Sends one ASDU, or gets nearer to it. False: there is nothing to send now. */
static bool send_next(struct iec104_station *station, struct iec104_connection *connection, int64_t now_ns)
{
	if (iec104_send_confirmation(connection, now_ns) ||
	    iec104_send_initialised(station, connection, now_ns) ||
	    iec104_send_termination(station, connection, now_ns))
		return true;
	if (connection->down) /* later events wait until all of the module's points are reported */
		return iec104_send_invalid(station, connection, now_ns);
	return iec104_send_event(station, connection, now_ns) ||
	       iec104_answer_read(station, connection, now_ns) ||
	       iec104_send_refresh(station, connection, now_ns) ||
	       iec104_advance_procedure(station, connection, now_ns) ||
	       iec104_send_periodic(station, connection, now_ns);
}

static void send_all(struct iec104_station *station, struct iec104_connection *connection, int64_t now_ns)
{
	connection->retry_ns = INT64_MAX;
	iec104_refresh_recovered(station, connection, now_ns);
	while (iec104_session_may_send(&connection->session) && send_next(station, connection, now_ns))
		iec104_note_place(station, connection);
}

static void begin_transfer(struct iec104_station *station, struct iec104_connection *connection,
			   int64_t now_ns)
{
	connection->has_started = true;
	iec104_claim_queue(station, connection);
	iec104_begin_initialised(station, connection);
	iec104_schedule_periodic(station, connection, now_ns);
	iec104_log(station, MAP_LOG_INFO, connection->peer, "data transfer started");
}

/* A controlling station that stops data transfer waits for no confirmation and no interrogation any more. */
static void end_transfer(struct iec104_station *station, struct iec104_connection *connection)
{
	connection->replies.begin = connection->replies.end = 0;
	connection->procedure_count = 0;
	iec104_drop_terminations(station, connection);
	iec104_release_queue(station, connection);
	iec104_log(station, MAP_LOG_INFO, connection->peer, "data transfer stopped");
}

static void note_transfer(struct iec104_station *station, struct iec104_connection *connection,
			  int64_t now_ns)
{
	if (connection->transfer == connection->session.started)
		return;
	connection->transfer = connection->session.started;
	if (connection->transfer)
		begin_transfer(station, connection, now_ns);
	else
		end_transfer(station, connection);
}

static void run_connection(struct iec104_station *station, struct iec104_connection *connection,
			   int64_t now_ns)
{
	const uint8_t *asdu;
	size_t size;

	if (connection->transfer)
		iec104_begin_periodic(station, connection, now_ns);
	send_all(station, connection, now_ns);
	while (iec104_session_next(&connection->session, now_ns, &asdu, &size)) {
		iec104_take_acknowledgement(station, connection);
		note_transfer(station, connection, now_ns);
		if (asdu != NULL)
			iec104_take_asdu(station, connection, asdu, size, now_ns);
		send_all(station, connection, now_ns);
		iec104_session_run(&connection->session, now_ns);
	}
	iec104_session_run(&connection->session, now_ns);
	iec104_show_connection(station, connection);
}

static void run_connections(struct iec104_station *station, bool transfer, int64_t now_ns)
{
	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		if (station->connections[i].open && station->connections[i].transfer == transfer)
			run_connection(station, &station->connections[i], now_ns);
}

/* Who has ended has no queue any more, also when the connection after it was started in the same moment. */
static void release_ended(struct iec104_station *station)
{
	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		if (station->connections[i].open && station->connections[i].session.closing != IEC104_OPEN)
			iec104_release_queue(station, &station->connections[i]);
}

/* What is started first: its acknowledgements count before another connection of its group takes over. */
void iec104_station_run(struct iec104_station *station, int64_t now_ns)
{
	station->now_ns = now_ns;
	iec104_take_answers(station);
	iec104_conclude_orphans(station, now_ns);
	iec104_conclude_freezes(station, now_ns);
	iec104_watch_initialisation(station, now_ns);
	release_ended(station);
	iec104_trim_queues(station);
	run_connections(station, true, now_ns);
	run_connections(station, false, now_ns);
	iec104_publish_losses(station);
}

static int64_t connection_deadline(const struct iec104_connection *connection)
{
	int64_t deadline = earlier(iec104_session_deadline(&connection->session), connection->retry_ns);

	if (connection->transfer && !connection->periodic)
		deadline = earlier(deadline, connection->periodic_due_ns);
	return deadline;
}

int64_t iec104_station_deadline(const struct iec104_station *station)
{
	int64_t deadline = earlier(iec104_orphan_deadline(station), iec104_freeze_deadline(station));

	deadline = earlier(deadline, iec104_initialisation_deadline(station));
	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		if (station->connections[i].open)
			deadline = earlier(deadline, connection_deadline(&station->connections[i]));
	return deadline;
}
