/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What only IEC 61850 knows of the configuration: its section of it. */
#ifndef OPENRTU_IEC61850_CONFIG_H
#define OPENRTU_IEC61850_CONFIG_H

#include "channel/config.h"
#include "map/config.h"

#define IEC61850_KIND        "iec61850"
#define IEC61850_SETTINGS    MAP_SECTION_ID('6', '8', '5', '0')
#define IEC61850_ASSIGNMENTS MAP_SECTION_ID('6', '8', 'L', 'N')
#define IEC61850_DATA_SETS   MAP_SECTION_ID('6', '8', 'D', 'S')
#define IEC61850_MEMBERS     MAP_SECTION_ID('6', '8', 'D', 'M')
#define IEC61850_REPORTS     MAP_SECTION_ID('6', '8', 'R', 'C')

#define IEC61850_ASSOCIATIONS_MAX 16
#define IEC61850_CLIENTS_MAX      16
#define IEC61850_PDU_MIN          1000
#define IEC61850_INTEGRITY_MS_MIN 100 /* a client's wish must not take the processor from the others */
#define IEC61850_PDU_MAX          65000
#define IEC61850_BUFFER_MIN       64
#define IEC61850_BUFFER_MAX       65536
#define IEC61850_DATA_SETS_MAX    256
#define IEC61850_SET_REPORTS_MAX  8       /* control blocks of a data set, indexed ones as one */
#define IEC61850_INSTANCES_MAX    16      /* of an indexed control block */
#define IEC61850_IOA_MAX          9999999 /* a data object's name has 12 characters, 5 of them letters */

struct iec61850_settings {
	char address[MAP_ADDRESS_SIZE];
	char clients[IEC61850_CLIENTS_MAX][MAP_ADDRESS_SIZE];     /* who may connect; none: everybody */
	char controllers[IEC61850_CLIENTS_MAX][MAP_ADDRESS_SIZE]; /* who may command; none: nobody */
	char ied[MAP_NAME_SIZE]; /* what the names of logical devices begin with */
	uint32_t client_count, controller_count;
	uint32_t associations;  /* at a time */
	uint32_t max_pdu;       /* octets of an MMS PDU */
	uint32_t report_buffer; /* changes that are kept for buffered reports: a power of two */
	uint16_t port;
	bool normal_security; /* of commands: without a CommandTermination */
	struct channel_tls tls;
};

#define IEC61850_LN_SIZE     17 /* a prefix and an instance of 12 characters together, the class between them */
#define IEC61850_SET_SIZE    33 /* a data set's name, as Edition 2 has it */
#define IEC61850_CB_SIZE     29 /* a control block's, before its index: its variable's name has 32 characters */
#define IEC61850_RPT_ID_SIZE 130 /* VISIBLE STRING129 */

/* A data set that somebody has chosen, of points of one device; it has no other data sets then. */
struct iec61850_data_set {
	char ln[IEC61850_LN_SIZE]; /* whose it is */
	char name[IEC61850_SET_SIZE];
	uint32_t first_member, member_count;
	uint32_t conf_rev; /* 0: of its members */
};

#define IEC61850_ATTRIBUTE_SIZE 20 /* of valWTr.transInd, the longest */

/* A member of a data set. */
struct iec61850_chosen {
	uint32_t point;
	char attribute[IEC61850_ATTRIBUTE_SIZE]; /* as mag.f; empty: all */
};

/* Report control blocks of a data set that are the same but for their index, and what they are set to at first. */
struct iec61850_report {
	char name[IEC61850_CB_SIZE];
	char id[IEC61850_RPT_ID_SIZE]; /* empty: its reference */
	uint16_t set;                  /* of the data sets */
	uint16_t options;              /* as enum iec61850_option */
	uint8_t triggers;              /* as enum iec61850_trigger */
	uint8_t instances;
	bool buffered;
	uint32_t buffer_ms, integrity_ms;
};

/* Which data object a point is, if not one of GGIO1. In the order of the points. */
struct iec61850_assignment {
	uint32_t point;
	char ln[IEC61850_LN_SIZE]; /* Q1XCBR2 */
	uint8_t class;             /* of iec61850_ln_classes */
	uint8_t data;              /* of the class's */
	uint16_t number;           /* behind its name; 0: there is none */
};

static inline struct iec61850_assignment *iec61850_assignments(const struct map_config *config)
{
	return map_records(config, IEC61850_ASSIGNMENTS, sizeof(struct iec61850_assignment));
}

/* NULL: it is one of GGIO1. */
static inline const struct iec61850_assignment *iec61850_assigned_to(const struct map_config *config,
								     uint32_t point)
{
	const struct iec61850_assignment *assigned = iec61850_assignments(config);

	for (uint32_t i = 0; i < map_record_count(config, IEC61850_ASSIGNMENTS); i++)
		if (assigned[i].point == point)
			return &assigned[i];
	return NULL;
}

static inline struct iec61850_data_set *iec61850_data_sets(const struct map_config *config)
{
	return map_records(config, IEC61850_DATA_SETS, sizeof(struct iec61850_data_set));
}

static inline struct iec61850_report *iec61850_reports(const struct map_config *config)
{
	return map_records(config, IEC61850_REPORTS, sizeof(struct iec61850_report));
}

static inline struct iec61850_chosen *iec61850_members(const struct map_config *config)
{
	return map_records(config, IEC61850_MEMBERS, sizeof(struct iec61850_chosen));
}

/* NULL: IEC 61850 is not configured. */
static inline struct iec61850_settings *iec61850_settings(const struct map_config *config)
{
	return map_records(config, IEC61850_SETTINGS, sizeof(struct iec61850_settings));
}

#endif
