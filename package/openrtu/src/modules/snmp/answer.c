/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/snmp/answer.h"

#include <stdlib.h>
#include <string.h>

#include "modules/snmp/kernel.h"
#include "snmp/write.h"

#define SET_VARBINDS_MAX 64
#define NAME_MAX_IDS     128 /* RFC 3416: of a name */

/* ---- sizes (X.690) ----------------------------------------------------------------------- */

static long with_header(long octets)
{
	return octets + (octets < 128 ? 2 : octets < 256 ? 3 : octets < 65536 ? 4 : 5);
}

static long size_of_arc(uint32_t arc)
{
	long size = 1;

	while (arc >>= 7)
		size++;
	return size;
}

static long size_of_name(const uint32_t *name, size_t length)
{
	long size = length > 1 ? size_of_arc(name[0] * 40 + name[1]) : 1;

	for (size_t i = 2; i < length; i++)
		size += size_of_arc(name[i]);
	return with_header(size);
}

/* In two's complement, without octets that say nothing: X.690, 8.3. */
static long size_of_number(int64_t number)
{
	long size = 1;

	for (; number < -128 || number > 127; number >>= 8)
		size++;
	return size;
}

static long size_of_value(const struct snmp_value *value)
{
	switch (value == NULL ? 0 : value->syntax) {
	case SNMP_OCTETS:
		return with_header(value->size);
	case SNMP_OID:
		return size_of_name(value->ids, value->size);
	case 0:
		return 2;
	case SNMP_COUNTER_64: /* what has the highest bit has one octet before it */
		return 2 + (value->number < 0 ? 9 : size_of_number(value->number));
	default:
		return 2 + size_of_number(value->number);
	}
}

/*
 * RFC 3412, 6 and RFC 3414, 2.4: header data 19 with its own headers 26, security parameters 51 with 12 to 48 octets of MAC, the
 * PDU's fields 52, the two engine IDs and the user's name.
 */
long answer_overhead(const struct snmp_agent *agent, size_t name_size)
{
	return 26 + 51 + 48 + 52 + 2 * agent->engine_id_size + (long)name_size;
}

/* ---- varbinds ---------------------------------------------------------------------------- */

static void put_value(netsnmp_variable_list *variable, const struct snmp_value *value)
{
	long number = (long)value->number;
	const struct counter64 counter = {.high = (u_long)((uint64_t)value->number >> 32),
					  .low = (uint32_t)value->number};
	oid ids[SNMP_IDS_MAX];

	switch (value->syntax) {
	case SNMP_OCTETS:
		snmp_set_var_typed_value(variable, ASN_OCTET_STR, value->octets, value->size);
		break;
	case SNMP_OID:
		for (unsigned i = 0; i < value->size; i++)
			ids[i] = value->ids[i];
		snmp_set_var_typed_value(variable, ASN_OBJECT_ID, ids, value->size * sizeof(oid));
		break;
	case SNMP_COUNTER_64:
		snmp_set_var_typed_value(variable, ASN_COUNTER64, &counter, sizeof(counter));
		break;
	default:
		snmp_set_var_typed_value(variable, value->syntax, &number, sizeof(number));
		break;
	}
}

static netsnmp_variable_list *new_variable(netsnmp_variable_list **end, const uint32_t *name, size_t length)
{
	netsnmp_variable_list *variable = calloc(1, sizeof(*variable));
	oid ids[NAME_MAX_IDS];

	if (variable == NULL)
		return NULL;
	for (size_t i = 0; i < length; i++)
		ids[i] = name[i];
	variable->type = ASN_NULL;
	snmp_set_var_objid(variable, ids, length);
	*end = variable;
	return variable;
}

bool answer_add(netsnmp_variable_list **end, const uint32_t *name, size_t length,
		const struct snmp_value *value, long *left)
{
	netsnmp_variable_list *variable;

	*left -= with_header(size_of_name(name, length) + size_of_value(value));
	if (*left < 0)
		return false;
	variable = new_variable(end, name, length);
	if (variable != NULL && value != NULL)
		put_value(variable, value);
	return variable != NULL;
}

/* ---- a request --------------------------------------------------------------------------- */

struct asked {
	uint32_t ids[NAME_MAX_IDS];
	size_t length;
};

static void take_name(const netsnmp_variable_list *variable, struct asked *out)
{
	out->length = variable->name_length < NAME_MAX_IDS ? variable->name_length : NAME_MAX_IDS;
	for (size_t i = 0; i < out->length; i++)
		out->ids[i] = (uint32_t)variable->name[i];
}

struct answering {
	struct snmp_agent *agent;
	enum snmp_role role;
	netsnmp_variable_list *first, **end;
	long left; /* octets */
};

static bool add(struct answering *answering, const uint32_t *name, size_t length,
		const struct snmp_value *value)
{
	if (!answer_add(answering->end, name, length, value, &answering->left))
		return false;
	answering->end = &(*answering->end)->next_variable;
	return true;
}

/* ... with one of the three words that stand for a value. */
static bool add_word(struct answering *answering, const struct asked *asked, u_char word)
{
	netsnmp_variable_list **here = answering->end;

	if (!add(answering, asked->ids, asked->length, NULL))
		return false;
	(*here)->type = word;
	return true;
}

static bool add_place(struct answering *answering, const struct snmp_place *place)
{
	static struct snmp_value value;
	uint32_t name[SNMP_IDS_MAX];
	const size_t length = snmp_name(answering->agent, place, name);

	if (snmp_table_at(answering->agent, place)->read(answering->agent, place->column, place->row, &value))
		return add(answering, name, length, &value);
	return add(answering, name, length, NULL);
}

static bool get(struct answering *answering, const netsnmp_variable_list *variable)
{
	struct snmp_place place;
	struct asked asked;

	take_name(variable, &asked);
	if (snmp_find(answering->agent, asked.ids, asked.length, &place) &&
	    answering->role >= snmp_table_at(answering->agent, &place)->reader)
		return add_place(answering, &place);
	return add_word(answering, &asked,
			snmp_knows(answering->agent, asked.ids, asked.length, answering->role)
			    ? SNMP_NOSUCHINSTANCE
			    : SNMP_NOSUCHOBJECT);
}

static bool get_next(struct answering *answering, const netsnmp_variable_list *variable)
{
	struct snmp_place place;
	struct asked asked;

	take_name(variable, &asked);
	if (snmp_next(answering->agent, asked.ids, asked.length, answering->role, &place))
		return add_place(answering, &place);
	return add_word(answering, &asked, SNMP_ENDOFMIBVIEW);
}

/* ---- GETBULK ----------------------------------------------------------------------------- */

#define REPEATERS_MAX 1024 /* that are told more than once */

struct repeater {
	bool empty; /* nothing lies behind the name that was asked */
	bool ended; /* nothing lies behind the place */
	struct snmp_place place;
};

static bool add_end_behind(struct answering *answering, const struct snmp_place *place)
{
	struct asked last;

	last.length = snmp_name(answering->agent, place, last.ids);
	return add_word(answering, &last, SNMP_ENDOFMIBVIEW);
}

static bool repeat_first(struct answering *answering, const netsnmp_variable_list *variable,
			 struct repeater *repeater)
{
	struct asked asked;

	take_name(variable, &asked);
	repeater->empty =
	    !snmp_next(answering->agent, asked.ids, asked.length, answering->role, &repeater->place);
	repeater->ended = repeater->empty;
	return repeater->empty ? add_word(answering, &asked, SNMP_ENDOFMIBVIEW)
			       : add_place(answering, &repeater->place);
}

static bool repeat_again(struct answering *answering, const netsnmp_variable_list *variable,
			 struct repeater *repeater)
{
	struct snmp_place next = repeater->place;

	if (repeater->empty)
		return repeat_first(answering, variable, repeater);
	repeater->ended = repeater->ended || !snmp_after(answering->agent, answering->role, &next);
	if (repeater->ended)
		return add_end_behind(answering, &repeater->place);
	repeater->place = next;
	return add_place(answering, &next);
}

/* False: there is no room for all of it, or nothing is left to tell. */
static bool repeat_all(struct answering *answering, const netsnmp_variable_list *variable,
		       struct repeater *repeaters, bool again)
{
	uint32_t going = 0;

	for (; variable != NULL; variable = variable->next_variable, repeaters++) {
		if (!(again ? repeat_again : repeat_first)(answering, variable, repeaters))
			return false;
		going += !repeaters->ended;
	}
	return going > 0;
}

static void tell_once(struct answering *answering, const netsnmp_variable_list *variable)
{
	while (variable != NULL && get_next(answering, variable))
		variable = variable->next_variable;
}

static uint32_t count_variables(const netsnmp_variable_list *variable)
{
	uint32_t count = 0;

	for (; variable != NULL; variable = variable->next_variable)
		count++;
	return count;
}

/*
 * RFC 3416, 4.2.3: the answer is a beginning of the ordered set, each repetition whole before the next. It ends where a varbind
 * has no room, or nothing is left to tell. Of more repeaters than it keeps the places of, it ends behind the first repetition.
 */
static void get_bulk(struct answering *answering, const netsnmp_pdu *pdu)
{
	static struct repeater repeaters[REPEATERS_MAX];
	const netsnmp_variable_list *variable = pdu->variables;

	for (long once = pdu->non_repeaters; variable != NULL && once > 0; once--) {
		if (!get_next(answering, variable))
			return;
		variable = variable->next_variable;
	}
	if (variable == NULL || pdu->max_repetitions <= 0)
		return;
	if (count_variables(variable) > REPEATERS_MAX)
		tell_once(answering, variable);
	else
		for (long i = 0; i < pdu->max_repetitions; i++)
			if (!repeat_all(answering, variable, repeaters, i > 0))
				return;
}

/* ---- SET --------------------------------------------------------------------------------- */

static int64_t number_of_octets(const netsnmp_variable_list *variable)
{
	uint64_t number = 0;

	for (size_t i = 0; i < variable->val_len && i < sizeof(number); i++)
		number = number << 8 | variable->val.string[i];
	return (int64_t)number;
}

static void take_value(const netsnmp_variable_list *variable, struct snmp_assignment *out)
{
	out->syntax = variable->type;
	out->size = (uint16_t)variable->val_len;
	if (variable->type == ASN_OCTET_STR)
		out->number = number_of_octets(variable);
	else if (variable->type == ASN_INTEGER)
		out->number = *variable->val.integer;
	else if (variable->type == ASN_UNSIGNED && variable->val.integer != NULL)
		out->number = (int64_t)(uint32_t)*variable->val.integer;
}

static enum snmp_error set(struct snmp_agent *agent, uint8_t user, const netsnmp_pdu *pdu, size_t *index)
{
	static struct asked names[SET_VARBINDS_MAX];
	struct snmp_assignment assignments[SET_VARBINDS_MAX] = {0};
	size_t count = 0;

	for (const netsnmp_variable_list *variable = pdu->variables; variable != NULL;
	     variable = variable->next_variable, count++) {
		*index = count + 1;
		if (count == SET_VARBINDS_MAX)
			return SNMP_RESOURCE_UNAVAILABLE;
		take_name(variable, &names[count]);
		assignments[count].name = names[count].ids;
		assignments[count].length = names[count].length;
		take_value(variable, &assignments[count]);
	}
	return snmp_set(agent, user, assignments, count, index);
}

/* ---- the answer -------------------------------------------------------------------------- */

static bool find_user(const struct snmp_agent *agent, const netsnmp_pdu *pdu, uint8_t *user)
{
	for (*user = 0; *user < agent->settings->user_count; ++*user) {
		const char *name = agent->settings->users[*user].name;

		if (strlen(name) == pdu->securityNameLen &&
		    memcmp(name, pdu->securityName, pdu->securityNameLen) == 0)
			return true;
	}
	return false;
}

/* Without encryption a user has no right to anything, not even to know what there is. */
static bool may_ask(const struct snmp_agent *agent, const netsnmp_pdu *pdu, uint8_t *user)
{
	return pdu->securityLevel == SNMP_SEC_LEVEL_AUTHPRIV && find_user(agent, pdu, user);
}

static enum snmp_error read_all(struct answering *answering, const netsnmp_pdu *pdu)
{
	for (const netsnmp_variable_list *variable = pdu->variables; variable != NULL;
	     variable = variable->next_variable)
		if (!(pdu->command == SNMP_MSG_GET ? get(answering, variable)
						   : get_next(answering, variable)))
			return SNMP_TOO_BIG;
	return SNMP_GOOD;
}

static bool asks_for_any(const netsnmp_pdu *pdu)
{
	return pdu->variables != NULL && (pdu->non_repeaters > 0 || pdu->max_repetitions > 0);
}

/* A GETBULK is answered with what has room, but with one varbind at least. */
static enum snmp_error read_asked(struct answering *answering, const netsnmp_pdu *pdu)
{
	if (pdu->command != SNMP_MSG_GETBULK)
		return read_all(answering, pdu);
	get_bulk(answering, pdu);
	return answering->first == NULL && asks_for_any(pdu) ? SNMP_TOO_BIG : SNMP_GOOD;
}

static long room_of(const struct snmp_agent *agent, const netsnmp_pdu *pdu)
{
	const long own = (long)agent->settings->max_message;
	const long most = pdu->msgMaxSize > 0 && pdu->msgMaxSize < own ? pdu->msgMaxSize : own;

	return most - answer_overhead(agent, pdu->securityNameLen);
}

/* The varbinds of the answer take the place of the request's, which stay after a SET. */
static enum snmp_error answer(struct snmp_agent *agent, netsnmp_pdu *pdu, uint8_t user, size_t *index)
{
	struct answering answering = {.agent = agent,
				      .role = (enum snmp_role)agent->settings->users[user].role,
				      .left = room_of(agent, pdu)};
	enum snmp_error error;

	if (pdu->command == SNMP_MSG_SET)
		return set(agent, user, pdu, index);
	answering.end = &answering.first;
	error = read_asked(&answering, pdu);
	if (error != SNMP_GOOD) {
		snmp_free_varbind(answering.first);
		answering.first = NULL;
	}
	snmp_free_varbind(pdu->variables);
	pdu->variables = answering.first;
	return error;
}

static bool is_request(const netsnmp_pdu *pdu)
{
	return pdu->command == SNMP_MSG_GET || pdu->command == SNMP_MSG_GETNEXT ||
	       pdu->command == SNMP_MSG_GETBULK || pdu->command == SNMP_MSG_SET;
}

static void make_response(struct snmp_agent *agent, const netsnmp_pdu *pdu, netsnmp_pdu *reply)
{
	enum snmp_error error = SNMP_AUTHORIZATION_ERROR;
	size_t index = 0;
	uint8_t user;

	if (may_ask(agent, pdu, &user)) {
		kernel_look(agent);
		error = answer(agent, reply, user, &index);
	}
	if (error == SNMP_AUTHORIZATION_ERROR || error == SNMP_NO_ACCESS)
		map_count(&agent->shared->counters[SNMP_COUNT_DENIED], 1);
	reply->command = SNMP_MSG_RESPONSE;
	reply->errstat = error;
	reply->errindex = error == SNMP_TOO_BIG || error == SNMP_GOOD ? 0 : (long)index;
}

/* ---- reports ----------------------------------------------------------------------------- */

static bool is_of_this_engine(const struct snmp_agent *agent, const netsnmp_pdu *pdu)
{
	return pdu->contextEngineIDLen == agent->engine_id_size &&
	       memcmp(pdu->contextEngineID, agent->engine_id, agent->engine_id_size) == 0;
}

/* It has a counter, which has one more now. */
static void make_report(struct snmp_agent *agent, netsnmp_pdu *reply, const uint32_t *name, size_t length,
			enum snmp_counter counter)
{
	netsnmp_variable_list *first = NULL;
	struct snmp_value value;
	long left = (long)agent->settings->max_message;

	map_count(&agent->shared->counters[counter], 1);
	snmp_put_number(&value, SNMP_COUNTER, agent->shared->counters[counter]);
	answer_add(&first, name, length, &value, &left);
	snmp_free_varbind(reply->variables);
	reply->variables = first;
	reply->command = SNMP_MSG_REPORT;
	reply->errstat = reply->errindex = 0;
}

/* A context that is not here: RFC 3412, 4.2.2.1.2 and RFC 3413, 3.2. False: it is here. */
static bool report_context(struct snmp_agent *agent, const netsnmp_pdu *pdu, netsnmp_pdu *reply)
{
	static const uint32_t unknown_handlers[] = {1, 3, 6, 1, 6, 3, 11, 2, 1, 3, 0},
			      unknown_contexts[] = {1, 3, 6, 1, 6, 3, 12, 1, 5, 0};

	if (!is_of_this_engine(agent, pdu))
		make_report(agent, reply, unknown_handlers, sizeof(unknown_handlers) / sizeof(uint32_t),
			    SNMP_COUNT_UNKNOWN_HANDLERS);
	else if (pdu->contextNameLen != 0)
		make_report(agent, reply, unknown_contexts, sizeof(unknown_contexts) / sizeof(uint32_t),
			    SNMP_COUNT_UNKNOWN_CONTEXTS);
	else
		return false;
	return true;
}

void answer_request(void *context, void *session, netsnmp_pdu *pdu)
{
	struct snmp_agent *agent = context;
	netsnmp_pdu *reply = is_request(pdu) ? snmp_clone_pdu(pdu) : NULL;

	if (reply == NULL)
		return;
	if (!report_context(agent, pdu, reply))
		make_response(agent, pdu, reply);
	if (!snmp_sess_send(session, reply))
		snmp_free_pdu(reply);
}
