/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A manager of SNMPv3 by Net-SNMP's library: reads the points' tables and the new events again and again, and prints each round
 * as a line of JSON. `at` is plant time.
 */
#include <net-snmp/net-snmp-config.h>

#include <net-snmp/net-snmp-includes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define BASE        1, 3, 6, 1, 4, 1, 8072, 9999, 9999, 104, 1
#define BASE_LENGTH 11
#define ROWS        20 /* in an answer, at most */
#define COLUMNS     8
#define TIMEOUT_US  1000000
#define RETRIES     1

struct table {
	const char *name;
	oid place[3]; /* of its entry, below BASE */
	size_t count;
	oid columns[COLUMNS];
};

static const struct table tables[] = {
    {"points", {2, 2, 1}, 3, {1, 2, 3}}, /* rtuSingleTable: value, quality, time */
    {"points", {2, 6, 1}, 3, {1, 4, 5}}, /* rtuMeasuredTable: the same */
    {"totals", {4, 1, 1}, 3, {1, 2, 3}}, /* rtuTotalTable: the same */
    {"events",
     {8, 5, 1},
     6,
     {2, 3, 4, 6, 8, 9}}, /* rtuEventTable: kind, station, object, value, quality, time */
};

static unsigned long last_event, epoch; /* the numbers of events begin anew with each epoch */

/* ---- JSON -------------------------------------------------------------------------------- */

static void tell_octets(const netsnmp_variable_list *variable)
{
	unsigned long long number = 0;

	for (size_t i = 0; i < variable->val_len; i++)
		number = number << 8 | variable->val.string[i];
	printf(", %llu", number);
}

static void tell_value(const netsnmp_variable_list *variable)
{
	if (variable->type == ASN_OCTET_STR)
		tell_octets(variable);
	else
		printf(", %ld", *variable->val.integer);
}

static void tell_index(const netsnmp_variable_list *variable)
{
	const size_t from = BASE_LENGTH + 4;

	printf("\"");
	for (size_t i = from; i < variable->name_length; i++)
		printf("%s%lu", i > from ? "." : "", (unsigned long)variable->name[i]);
	printf("\"");
}

/* ---- rounds ------------------------------------------------------------------------------ */

static size_t put_column(const struct table *table, size_t column, oid out[MAX_OID_LEN])
{
	const oid base[] = {BASE};

	memcpy(out, base, sizeof(base));
	memcpy(out + BASE_LENGTH, table->place, sizeof(table->place));
	out[BASE_LENGTH + 3] = table->columns[column];
	return BASE_LENGTH + 4;
}

/* From behind index on. NULL: nobody answers. */
static netsnmp_pdu *ask(netsnmp_session *session, const struct table *table, const oid *index, size_t length)
{
	netsnmp_pdu *request = snmp_pdu_create(SNMP_MSG_GETBULK), *answer = NULL;

	request->non_repeaters = 0;
	request->max_repetitions = ROWS;
	for (size_t i = 0; i < table->count; i++) {
		oid name[MAX_OID_LEN];
		const size_t size = put_column(table, i, name);

		memcpy(name + size, index, length * sizeof(*index));
		snmp_add_null_var(request, name, size + length);
	}
	if (snmp_synch_response(session, request, &answer) != STAT_SUCCESS && answer) {
		snmp_free_pdu(answer);
		answer = NULL;
	}
	return answer;
}

static bool is_of(const struct table *table, const netsnmp_variable_list *variable)
{
	oid name[MAX_OID_LEN];
	const size_t size = put_column(table, 0, name);

	return variable->type != SNMP_ENDOFMIBVIEW && variable->name_length > size &&
	       snmp_oid_compare(name, size, variable->name, size) == 0;
}

/* All columns of a row are there, and of one index. */
static bool is_row(const struct table *table, const netsnmp_variable_list *first)
{
	const size_t from = BASE_LENGTH + 4;
	const netsnmp_variable_list *variable = first;

	for (size_t i = 0; i < table->count; i++, variable = variable->next_variable)
		if (!variable || variable->type == SNMP_ENDOFMIBVIEW ||
		    snmp_oid_compare(first->name + from, first->name_length - from, variable->name + from,
				     variable->name_length - from) != 0)
			return false;
	return true;
}

static const netsnmp_variable_list *tell_row(const struct table *table, const netsnmp_variable_list *variable,
					     bool first)
{
	printf("%s[", first ? "" : ", ");
	tell_index(variable);
	for (size_t i = 0; i < table->count; i++, variable = variable->next_variable)
		tell_value(variable);
	printf("]");
	return variable;
}

/* False: nobody answers. */
static bool walk(netsnmp_session *session, const struct table *table, bool *first)
{
	const bool of_events = strcmp(table->name, "events") == 0;
	oid index[MAX_OID_LEN] = {last_event};
	size_t length = of_events ? 1 : 0;
	bool more = true;

	while (more) {
		netsnmp_pdu *answer = ask(session, table, index, length);
		const netsnmp_variable_list *row = answer ? answer->variables : NULL;

		if (!answer)
			return false;
		more = false;
		while (row && is_of(table, row) && is_row(table, row)) {
			length = row->name_length - BASE_LENGTH - 4;
			memcpy(index, row->name + BASE_LENGTH + 4, length * sizeof(*index));
			row = tell_row(table, row, *first);
			if (of_events)
				last_event = index[0];
			*first = false;
			more = true;
		}
		snmp_free_pdu(answer);
	}
	return true;
}

/* False: nobody answers. */
static bool look_at_epoch(netsnmp_session *session)
{
	const oid name[] = {BASE, 8, 3, 0}; /* rtuEventEpoch */
	netsnmp_pdu *request = snmp_pdu_create(SNMP_MSG_GET), *answer = NULL;
	bool answered;

	snmp_add_null_var(request, name, OID_LENGTH(name));
	answered = snmp_synch_response(session, request, &answer) == STAT_SUCCESS && answer->variables &&
		   answer->variables->type == ASN_GAUGE;
	if (answered && epoch != (unsigned long)*answer->variables->val.integer) {
		epoch = (unsigned long)*answer->variables->val.integer;
		last_event = 0;
	}
	if (answer)
		snmp_free_pdu(answer);
	return answered;
}

static long long now_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return (long long)now.tv_sec * 1000000000 + now.tv_nsec;
}

static bool take_round(netsnmp_session *session)
{
	const size_t count = sizeof(tables) / sizeof(tables[0]);
	const char *open = "";
	bool answered = look_at_epoch(session), first = true;

	printf("{\"epoch\": %lu, \"asked\": %lld", epoch, now_ns());
	for (size_t i = 0; i < count && answered; i++) {
		if (strcmp(open, tables[i].name) != 0) {
			printf("%s, \"%s\": [", *open ? "]" : "", tables[i].name);
			first = true;
		}
		open = tables[i].name;
		answered = walk(session, &tables[i], &first);
	}
	printf("%s, \"whole\": %s, \"at\": %lld}\n", *open ? "]" : "", answered ? "true" : "false", now_ns());
	fflush(stdout);
	return answered;
}

/* ---- the session ------------------------------------------------------------------------- */

static bool make_key(const oid *protocol, size_t length, const char *phrase, u_char *key, size_t *size)
{
	return generate_Ku(protocol, (u_int)length, (const u_char *)phrase, strlen(phrase), key, size) ==
	       SNMPERR_SUCCESS;
}

static netsnmp_session *opened(char *peer, char *user, const char *authentication, const char *encryption)
{
	static const oid hashes[] = {1, 3, 6, 1, 6, 3, 10, 1, 1, 5};  /* usmHMAC192SHA256AuthProtocol */
	static const oid ciphers[] = {1, 3, 6, 1, 6, 3, 10, 1, 2, 4}; /* usmAESPrivProtocol */
	netsnmp_session session;

	snmp_sess_init(&session);
	session.version = SNMP_VERSION_3;
	session.peername = peer;
	session.timeout = TIMEOUT_US;
	session.retries = RETRIES;
	session.securityName = user;
	session.securityNameLen = strlen(user);
	session.securityLevel = SNMP_SEC_LEVEL_AUTHPRIV;
	session.securityAuthProto = snmp_duplicate_objid(hashes, OID_LENGTH(hashes));
	session.securityAuthProtoLen = OID_LENGTH(hashes);
	session.securityAuthKeyLen = USM_AUTH_KU_LEN;
	session.securityPrivProto = snmp_duplicate_objid(ciphers, OID_LENGTH(ciphers));
	session.securityPrivProtoLen = OID_LENGTH(ciphers);
	session.securityPrivKeyLen = USM_PRIV_KU_LEN;
	if (!make_key(hashes, OID_LENGTH(hashes), authentication, session.securityAuthKey,
		      &session.securityAuthKeyLen) ||
	    !make_key(hashes, OID_LENGTH(hashes), encryption, session.securityPrivKey,
		      &session.securityPrivKeyLen))
		return NULL;
	return snmp_open(&session);
}

int main(int count, char **words)
{
	netsnmp_session *session = NULL;

	if (count != 6) {
		fputs("usage: manager PEER USER AUTHENTICATION ENCRYPTION PERIOD\n", stderr);
		return 2;
	}
	setenv("MIBS", "", 1);
	netsnmp_ds_set_boolean(NETSNMP_DS_LIBRARY_ID, NETSNMP_DS_LIB_DONT_READ_CONFIGS, 1);
	netsnmp_ds_set_boolean(NETSNMP_DS_LIBRARY_ID, NETSNMP_DS_LIB_DONT_PERSIST_STATE, 1);
	init_snmp("manager");
	while (true) {
		if (!session)
			session = opened(words[1], words[2], words[3], words[4]);
		if (session && !take_round(session)) {
			snmp_close(session);
			session = NULL;
		}
		nanosleep(&(struct timespec){.tv_sec = strtol(words[5], NULL, 10)}, NULL);
	}
}
