/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/snmp/notify.h"

#include <string.h>
#include <sys/socket.h>

#include "modules/snmp/answer.h"

#define MESSAGES_A_TURN 16
#define REFUSED_AGAIN   NS_PER_S /* a report, or a network that is not there: no sooner than this */
#define EVENTS_A_PDU    10

/* rtuNotifications. */
enum notification {
	NOTE_STARTED = 1,
	NOTE_POINT_CHANGED,
	NOTE_COMMAND_CHANGED,
	NOTE_TOTALS_FROZEN,
	NOTE_CYCLIC_READY,
	NOTE_PARAMETER_CHANGED,
	NOTE_MODULE_CHANGED,
	NOTE_EVENTS_MISSED,
	NOTE_CLOCK_CHANGED,
	NOTE_INITIALISED,
	NOTE_COLD_START, /* of SNMPv2-MIB, as the next two */
	NOTE_LINK_DOWN,
	NOTE_LINK_UP,
};

/* What the library gives back with an answer. */
struct ticket {
	struct snmp_agent *agent;
	uint32_t sink;
	struct snmp_flight *flight; /* NULL: the probe */
};

static struct wire *wires[SNMP_SINKS_MAX];
static struct ticket tickets[SNMP_SINKS_MAX][SNMP_WINDOW_MAX + 1];

bool notify_begin(struct snmp_agent *agent, const struct snmp_keyring *ring)
{
	for (uint32_t i = 0; i < agent->settings->sink_count; i++) {
		const int family = strchr(agent->settings->sinks[i].address, ':') ? AF_INET6 : AF_INET;
		const int fd = socket(family, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);

		wires[i] = fd < 0 ? NULL : wire_to_sink(agent, ring, i, fd);
		if (wires[i] == NULL)
			return false;
		for (unsigned j = 0; j <= SNMP_WINDOW_MAX; j++)
			tickets[i][j] = (struct ticket){
			    agent, i, j < SNMP_WINDOW_MAX ? &agent->sinks[i].flights[j] : NULL};
	}
	return true;
}

int notify_fd(uint32_t sink)
{
	return wire_fd(wires[sink]);
}

/* ---- a message --------------------------------------------------------------------------- */

struct note {
	struct snmp_agent *agent;
	netsnmp_variable_list *first, **end;
	long left;
};

static bool add(struct note *note, const uint32_t *name, size_t length, const struct snmp_value *value)
{
	if (!answer_add(note->end, name, length, value, &note->left))
		return false;
	note->end = &(*note->end)->next_variable;
	return true;
}

/* An object below rtuObjects: a table's column with its index, or a scalar with 0. */
static bool add_object(struct note *note, const uint32_t *below, size_t length,
		       const struct snmp_value *value)
{
	const struct snmp_settings *settings = note->agent->settings;
	uint32_t name[SNMP_IDS_MAX];

	memcpy(name, settings->base, settings->base_length * sizeof(name[0]));
	memcpy(name + settings->base_length, below, length * sizeof(name[0]));
	return add(note, name, settings->base_length + length, value);
}

/* Its number below snmpTraps. 0: it is one of ours. */
static uint32_t standard_number(enum notification notification)
{
	switch (notification) {
	case NOTE_COLD_START:
		return 1;
	case NOTE_LINK_DOWN:
		return 3;
	case NOTE_LINK_UP:
		return 4;
	default:
		return 0;
	}
}

static void put_notification(const struct snmp_settings *settings, enum notification notification,
			     struct snmp_value *out)
{
	static const uint32_t standard[] = {1, 3, 6, 1, 6, 3, 1, 1, 5};
	const size_t length = sizeof(standard) / sizeof(standard[0]);

	out->syntax = SNMP_OID;
	if (standard_number(notification) != 0) {
		out->size = (uint16_t)(length + 1);
		memcpy(out->ids, standard, sizeof(standard));
		out->ids[length] = standard_number(notification);
		return;
	}
	out->size = (uint16_t)(settings->base_length + 2);
	memcpy(out->ids, settings->base, settings->base_length * sizeof(out->ids[0]));
	out->ids[settings->base_length] = 0;
	out->ids[settings->base_length + 1] = notification;
}

/* RFC 3416, 4.2.6: each begins with sysUpTime.0 and snmpTrapOID.0. */
static bool add_head(struct note *note, enum notification notification)
{
	static const uint32_t uptime[] = {1, 3, 6, 1, 2, 1, 1, 3, 0},
			      trap_oid[] = {1, 3, 6, 1, 6, 3, 1, 1, 4, 1, 0};
	struct snmp_value value;

	snmp_put_number(&value, SNMP_TICKS,
			(uint32_t)((note->agent->now_ns - note->agent->started_ns) / (10 * NS_PER_MS)));
	if (!add(note, uptime, sizeof(uptime) / sizeof(uptime[0]), &value))
		return false;
	put_notification(note->agent->settings, notification, &value);
	return add(note, trap_oid, sizeof(trap_oid) / sizeof(trap_oid[0]), &value);
}

static bool add_event_column(struct note *note, uint32_t column, uint32_t number)
{
	const uint32_t below[] = {1, 8, 5, 1, column, number};
	struct snmp_value value;

	snmp_event_read(note->agent, column, number, &value);
	return add_object(note, below, sizeof(below) / sizeof(below[0]), &value);
}

/* What an object of the tree says now. */
static bool add_current(struct note *note, const uint32_t *below, size_t length)
{
	const struct snmp_settings *settings = note->agent->settings;
	uint32_t name[SNMP_IDS_MAX];
	struct snmp_place place;
	struct snmp_value value;

	memcpy(name, settings->base, settings->base_length * sizeof(name[0]));
	memcpy(name + settings->base_length, below, length * sizeof(name[0]));
	if (!snmp_find(note->agent, name, settings->base_length + length, &place) ||
	    !snmp_table_at(note->agent, &place)->read(note->agent, place.column, place.row, &value))
		return false;
	return add(note, name, settings->base_length + length, &value);
}

#define ADD_CURRENT(note, ...)                                                                               \
	add_current(note, (const uint32_t[]){__VA_ARGS__},                                                   \
		    sizeof((const uint32_t[]){__VA_ARGS__}) / sizeof(uint32_t))

static enum notification notification_of(const struct snmp_event *event)
{
	switch ((enum snmp_event_kind)event->kind) {
	case SNMP_EVENT_CHANGE:
		return NOTE_POINT_CHANGED;
	case SNMP_EVENT_MODULE_DOWN:
	case SNMP_EVENT_MODULE_UP:
		return NOTE_MODULE_CHANGED;
	case SNMP_EVENT_CLOCK:
		return NOTE_CLOCK_CHANGED;
	case SNMP_EVENT_COMMAND:
		return NOTE_COMMAND_CHANGED;
	case SNMP_EVENT_FROZEN:
		return NOTE_TOTALS_FROZEN;
	case SNMP_EVENT_PARAMETER:
		return NOTE_PARAMETER_CHANGED;
	case SNMP_EVENT_CYCLIC:
		return NOTE_CYCLIC_READY;
	case SNMP_EVENT_INITIALISED:
		return NOTE_INITIALISED;
	case SNMP_EVENT_COLD_START:
		return NOTE_COLD_START;
	case SNMP_EVENT_LINK_DOWN:
		return NOTE_LINK_DOWN;
	case SNMP_EVENT_LINK_UP:
		return NOTE_LINK_UP;
	case SNMP_EVENT_STARTED:
		break;
	}
	return NOTE_STARTED;
}

static bool add_change(struct note *note, uint32_t number)
{
	for (uint32_t column = SNMP_EVENT_KIND; column <= SNMP_EVENT_CAUSE; column++)
		if (!add_event_column(note, column, number))
			return false;
	return true;
}

static void put_owner(const struct snmp_agent *agent, const struct snmp_event *event,
		      struct snmp_value *owner, struct snmp_value *protocol)
{
	struct map_module module;

	if (event->user != SNMP_NO_USER) {
		snmp_put_text(owner, snmp_user_name(agent, event->user));
		snmp_put_number(protocol, SNMP_INTEGER, SNMP_BY_SNMP);
		return;
	}
	map_module(agent->map, event->module, &module);
	snmp_put_text(owner, module.name);
	snmp_put_number(protocol, SNMP_INTEGER, snmp_protocol_of(&module));
}

/* The row as it was when the event happened: it may have gone on since. */
static bool add_command(struct note *note, uint32_t number)
{
	const struct snmp_event *event = snmp_event_at(note->agent, number);
	uint32_t below[] = {1, 3, 1, 1, 0, event->ca, event->ioa};
	const size_t length = sizeof(below) / sizeof(below[0]);
	static const uint8_t columns[] = {SNMP_COMMAND_STATE,  SNMP_COMMAND_RESULT, SNMP_COMMAND_DETAIL,
					  SNMP_COMMAND_NUMBER, SNMP_COMMAND_OWNER,  SNMP_COMMAND_PROTOCOL,
					  SNMP_COMMAND_SPIN,   SNMP_COMMAND_TIME};
	struct snmp_value values[sizeof(columns)];

	snmp_put_number(&values[0], SNMP_INTEGER, event->state + 1);
	snmp_put_number(&values[1], SNMP_INTEGER, event->result + 1);
	snmp_put_number(&values[2], SNMP_GAUGE, event->detail);
	snmp_put_number(&values[3], SNMP_GAUGE, event->value.u);
	put_owner(note->agent, event, &values[4], &values[5]);
	snmp_put_number(&values[6], SNMP_INTEGER, event->spin);
	snmp_put_time(&values[7], event->time_ms);
	if (!add_event_column(note, SNMP_EVENT_KIND, number))
		return false;
	for (unsigned i = 0; i < sizeof(columns); i++) {
		below[4] = columns[i];
		if (!add_object(note, below, length, &values[i]))
			return false;
	}
	return true;
}

/* Threshold, smoothing, limits, cyclic transmission, and which of them were loaded, as they are in force now. */
static bool add_parameters(struct note *note, const struct snmp_event *event)
{
	for (uint32_t column = 2; column <= 7; column++)
		if (!ADD_CURRENT(note, 1, 6, 1, 1, column, event->ca, event->ioa))
			return false;
	return true;
}

/* ifIndex, ifAdminStatus, ifOperStatus, as they were. */
static bool add_link(struct note *note, const struct snmp_event *event)
{
	const uint32_t columns[] = {1, 7, 8}, values[] = {event->value.u, event->result, event->state};
	uint32_t name[] = {1, 3, 6, 1, 2, 1, 2, 2, 1, 0, event->value.u};
	const size_t length = sizeof(name) / sizeof(name[0]);
	struct snmp_value value;

	for (unsigned i = 0; i < sizeof(columns) / sizeof(columns[0]); i++) {
		name[length - 2] = columns[i];
		snmp_put_number(&value, SNMP_INTEGER, values[i]);
		if (!add(note, name, length, &value))
			return false;
	}
	return true;
}

static bool add_event(struct note *note, enum notification notification, uint32_t number)
{
	const struct snmp_event *event = snmp_event_at(note->agent, number);

	switch (notification) {
	case NOTE_POINT_CHANGED:
	case NOTE_TOTALS_FROZEN:
		return add_change(note, number);
	case NOTE_COMMAND_CHANGED:
		return add_command(note, number);
	case NOTE_MODULE_CHANGED:
		return add_event_column(note, SNMP_EVENT_KIND, number) &&
		       ADD_CURRENT(note, 1, 9, 1, 1, 2, event->module + 1u) &&
		       ADD_CURRENT(note, 1, 9, 1, 1, 3, event->module + 1u) &&
		       ADD_CURRENT(note, 1, 9, 1, 1, 5, event->module + 1u);
	case NOTE_CLOCK_CHANGED:
		return add_event_column(note, SNMP_EVENT_KIND, number) && ADD_CURRENT(note, 1, 7, 2, 0) &&
		       ADD_CURRENT(note, 1, 7, 5, 0);
	case NOTE_STARTED:
		return add_event_column(note, SNMP_EVENT_KIND, number) && ADD_CURRENT(note, 1, 1, 2, 0) &&
		       ADD_CURRENT(note, 1, 1, 4, 0) && ADD_CURRENT(note, 1, 8, 3, 0);
	case NOTE_PARAMETER_CHANGED:
		return add_event_column(note, SNMP_EVENT_KIND, number) && add_parameters(note, event);
	case NOTE_CYCLIC_READY:
		return add_event_column(note, SNMP_EVENT_KIND, number) && ADD_CURRENT(note, 1, 5, 1, 0);
	case NOTE_INITIALISED:
		return add_event_column(note, SNMP_EVENT_KIND, number) &&
		       add_event_column(note, SNMP_EVENT_CA, number) &&
		       add_event_column(note, SNMP_EVENT_VALUE, number);
	case NOTE_LINK_DOWN:
	case NOTE_LINK_UP:
		return add_link(note, event) && add_event_column(note, SNMP_EVENT_KIND, number);
	case NOTE_COLD_START:
	case NOTE_EVENTS_MISSED:
		break;
	}
	return add_event_column(note, SNMP_EVENT_KIND, number);
}

/* Only changes go together: of all others each tells what its rows say now. */
static bool goes_with(enum notification notification, const struct snmp_event *event)
{
	return (notification == NOTE_POINT_CHANGED || notification == NOTE_TOTALS_FROZEN) &&
	       notification_of(event) == notification;
}

/* From first on, as many events as the message takes. Returns the last one's number. */
static uint32_t add_events(struct note *note, uint32_t first, uint32_t last)
{
	const enum notification notification = notification_of(snmp_event_at(note->agent, first));
	uint32_t number = first;

	add_head(note, notification);
	add_event(note, notification, first);
	while (number < last && number - first + 1 < EVENTS_A_PDU &&
	       goes_with(notification, snmp_event_at(note->agent, number + 1))) {
		netsnmp_variable_list **const end = note->end;
		const long left = note->left;

		if (!add_event(note, notification, number + 1)) {
			snmp_free_varbind(*end);
			*end = NULL;
			note->end = end;
			note->left = left;
			break;
		}
		number++;
	}
	return number;
}

static void add_probe(struct note *note, uint32_t sink)
{
	if (add_head(note, NOTE_EVENTS_MISSED) && ADD_CURRENT(note, 1, 8, 6, 1, 4, sink + 1) &&
	    ADD_CURRENT(note, 1, 8, 1, 0) && ADD_CURRENT(note, 1, 8, 2, 0))
		ADD_CURRENT(note, 1, 8, 6, 1, 6, sink + 1);
}

/* ---- sending ----------------------------------------------------------------------------- */

/* Why a sink sends a report. NULL: it does not say. */
static const char *reason_of(netsnmp_pdu *pdu)
{
	switch (snmpv3_get_report_type(pdu)) {
	case SNMPERR_UNKNOWN_ENG_ID:
		return "usmStatsUnknownEngineIDs";
	case SNMPERR_UNKNOWN_USER_NAME:
		return "usmStatsUnknownUserNames";
	case SNMPERR_UNSUPPORTED_SEC_LEVEL:
		return "usmStatsUnsupportedSecLevels";
	case SNMPERR_AUTHENTICATION_FAILURE:
		return "usmStatsWrongDigests";
	case SNMPERR_NOT_IN_TIME_WINDOW:
		return "usmStatsNotInTimeWindows";
	case SNMPERR_DECRYPTION_ERR:
		return "usmStatsDecryptionErrors";
	default:
		return NULL;
	}
}

static void time_out(struct snmp_agent *agent, uint32_t sink)
{
	if (wire_discovers_anew(wires[sink]))
		map_log(
		    agent->map, MAP_LOG_WARNING,
		    "the sink %s answers with other boots or another time than it had: it is discovered anew",
		    agent->settings->sinks[sink].name);
}

static int take_answer(int operation, netsnmp_session *session, int request, netsnmp_pdu *pdu, void *magic)
{
	const struct ticket *ticket = magic;
	struct snmp_agent *agent = ticket->agent;

	(void)session, (void)request;
	if (operation == NETSNMP_CALLBACK_OP_RECEIVED_MESSAGE && pdu->command == SNMP_MSG_RESPONSE)
		snmp_sink_answered(agent, ticket->sink, ticket->flight);
	else if (operation == NETSNMP_CALLBACK_OP_RECEIVED_MESSAGE)
		snmp_sink_unanswered(agent, ticket->sink, ticket->flight, agent->now_ns + REFUSED_AGAIN,
				     pdu->command == SNMP_MSG_REPORT ? reason_of(pdu) : NULL);
	else if (operation == NETSNMP_CALLBACK_OP_TIMED_OUT || operation == NETSNMP_CALLBACK_OP_SEND_FAILED) {
		time_out(agent, ticket->sink);
		snmp_sink_unanswered(agent, ticket->sink, ticket->flight, agent->now_ns, NULL);
	}
	return 1;
}

/* Twice as long with each try. False: it was not sent. */
static bool post(struct note *note, uint32_t sink, struct ticket *ticket, unsigned tries)
{
	const struct snmp_sink *settings = &note->agent->settings->sinks[sink];
	void *session = wire_session(wires[sink]);
	netsnmp_pdu *pdu = snmp_pdu_create(settings->inform ? SNMP_MSG_INFORM : SNMP_MSG_TRAP2);
	int sent;

	if (pdu == NULL)
		return false;
	pdu->variables = note->first;
	note->first = NULL;
	snmp_sess_session(session)->timeout = (settings->timeout_ms * 1000L) << (tries > 8 ? 8 : tries);
	sent = settings->inform ? snmp_sess_async_send(session, pdu, take_answer, ticket)
				: snmp_sess_send(session, pdu);
	if (sent == 0)
		snmp_free_pdu(pdu);
	return sent != 0;
}

static struct note new_note(struct snmp_agent *agent, uint32_t sink)
{
	const char *name = agent->settings->users[agent->settings->sinks[sink].user].name;

	return (struct note){.agent = agent,
			     .left = (long)agent->settings->max_message -
				     answer_overhead(agent, strlen(name)) - SNMP_ENGINE_ID_MAX};
}

static struct ticket *ticket_of(uint32_t sink, const struct snmp_flight *flight)
{
	struct ticket *ticket = &tickets[sink][0];

	while (ticket->flight != flight)
		ticket++;
	return ticket;
}

/* False: nothing was to be sent. */
static bool send_next(struct snmp_agent *agent, uint32_t sink)
{
	struct note note = new_note(agent, sink);
	struct snmp_flight *flight = NULL;
	const enum snmp_sending what = snmp_sink_next(agent, sink, &flight);
	unsigned tries = 0;
	uint32_t last = 0;

	note.end = &note.first;
	if (what == SNMP_SEND_NOTHING)
		return false;
	if (what == SNMP_SEND_PROBE) {
		add_probe(&note, sink);
		snmp_sink_probed(agent, sink);
	} else {
		tries = flight->tries;
		last = add_events(&note, flight->first, flight->last);
		snmp_sink_sent(agent, sink, flight, last);
	}
	if (!post(&note, sink, ticket_of(sink, flight), tries))
		snmp_sink_unanswered(agent, sink, flight, agent->now_ns + REFUSED_AGAIN, NULL);
	return true;
}

bool notify_run(struct snmp_agent *agent)
{
	bool busy = false;

	for (uint32_t i = 0; i < agent->settings->sink_count; i++) {
		wire_read(wires[i], MESSAGES_A_TURN);
		wire_expire(wires[i]);
		for (unsigned j = 0; j < MESSAGES_A_TURN && send_next(agent, i); j++)
			;
		busy |= snmp_sink_is_busy(agent, i);
	}
	return busy;
}
