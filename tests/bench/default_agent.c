/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The contender of managers.py: an agent of Net-SNMP with its own table helper. A row has a value, a quality and a time, as ours.
 * default_agent PORT ROWS. Its user is that of the managers in scripts/lab/manager.py.
 */
#include <stdio.h>
#include <stdlib.h>

#include <net-snmp/net-snmp-config.h>

#include <net-snmp/net-snmp-includes.h>

#include <net-snmp/agent/net-snmp-agent-includes.h>

enum { VALUE = 1, QUALITY, TIME };

struct row {
	long value;
	unsigned char quality[1], time[8];
};

/* Of libnetsnmpmibs; no header has it. */
void init_vacm_conf(void);

static int answer(netsnmp_mib_handler *handler, netsnmp_handler_registration *registration,
		  netsnmp_agent_request_info *about, netsnmp_request_info *requests)
{
	(void)handler, (void)registration, (void)about;
	for (netsnmp_request_info *request = requests; request != NULL; request = request->next) {
		const struct row *row = netsnmp_tdata_extract_entry(request);
		const netsnmp_table_request_info *table = netsnmp_extract_table_info(request);

		if (row == NULL || request->processed)
			continue;
		if (table->colnum == VALUE)
			snmp_set_var_typed_value(request->requestvb, ASN_INTEGER, &row->value,
						 sizeof(row->value));
		else if (table->colnum == QUALITY)
			snmp_set_var_typed_value(request->requestvb, ASN_OCTET_STR, row->quality,
						 sizeof(row->quality));
		else
			snmp_set_var_typed_value(request->requestvb, ASN_OCTET_STR, row->time,
						 sizeof(row->time));
	}
	return SNMP_ERR_NOERROR;
}

static void add_table(unsigned rows)
{
	static const oid name[] = {1, 3, 6, 1, 4, 1, 8072, 9999, 9999, 104, 1, 2, 6};
	netsnmp_table_registration_info *info = SNMP_MALLOC_TYPEDEF(netsnmp_table_registration_info);
	netsnmp_tdata *table = netsnmp_tdata_create_table("points", 0);

	netsnmp_table_helper_add_indexes(info, ASN_UNSIGNED, ASN_UNSIGNED, 0);
	info->min_column = VALUE;
	info->max_column = TIME;
	for (unsigned i = 0; i < rows; i++) {
		netsnmp_tdata_row *place = netsnmp_tdata_create_row();
		struct row *row = calloc(1, sizeof(*row));
		u_long ca = 1001, ioa = 30001 + i;

		if (place == NULL || row == NULL)
			exit(1);
		row->value = (long)i;
		place->data = row;
		netsnmp_tdata_row_add_index(place, ASN_UNSIGNED, &ca, sizeof(ca));
		netsnmp_tdata_row_add_index(place, ASN_UNSIGNED, &ioa, sizeof(ioa));
		netsnmp_tdata_add_row(table, place);
	}
	netsnmp_tdata_register(
	    netsnmp_create_handler_registration("points", answer, name, OID_LENGTH(name), HANDLER_CAN_RONLY),
	    table, info);
}

static void configure(const char *line)
{
	char copy[128];

	snprintf(copy, sizeof(copy), "%s", line);
	netsnmp_config(copy);
}

int main(int argc, char **argv)
{
	char address[32];

	if (argc != 3)
		return 2;
	snprintf(address, sizeof(address), "udp:127.0.0.1:%s", argv[1]);
	netsnmp_ds_set_string(NETSNMP_DS_APPLICATION_ID, NETSNMP_DS_AGENT_PORTS, address);
	netsnmp_ds_set_boolean(NETSNMP_DS_LIBRARY_ID, NETSNMP_DS_LIB_DONT_PERSIST_STATE, 1);
	snmp_disable_log();
	init_agent("default_agent");
	init_vacm_conf();
	add_table((unsigned)atoi(argv[2]));
	init_snmp("default_agent");
	configure("createUser centre SHA-256 centre-authentic AES centre-encrypted");
	configure("rouser centre priv");
	if (init_master_agent() != 0)
		return 1;
	puts("ready");
	fflush(stdout);
	for (;;)
		agent_check_and_process(1);
}
