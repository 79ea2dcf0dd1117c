/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The configuration file of rtu-centre: docs/centre.md. */
#ifndef OPENRTU_CENTRE_CONFIG_H
#define OPENRTU_CENTRE_CONFIG_H

#include <netinet/in.h>
#include <stdio.h>

#include "centre/records.h"
#include "iec104/config.h"
#include "iec104/polls.h"

#define CENTRE_SOCKET_SIZE  108 /* sun_path */
#define CENTRE_STATIONS_MAX 65535
#define CENTRE_LINKS_MAX    2  /* to a station */
#define CENTRE_SHARDS_MAX   64 /* processes */

struct centre_plan {
	char name[CENTRE_NAME_SIZE];
	struct in6_addr addresses[CENTRE_LINKS_MAX]; /* of redundant links */
	uint8_t address_count;
	bool secure;       /* with TLS */
	char *certificate; /* by which it is known; NULL: it may have any of the CA */
	uint32_t second;   /* place of its second link among all links */
	uint16_t port;
	uint8_t originator;
	uint8_t position_type; /* 0: none */
	bool terminates;       /* it sends the termination of a command */
	uint32_t first_poll, poll_count;
};

struct centre_config {
	char socket[CENTRE_SOCKET_SIZE];
	struct iec104_controlling_settings common; /* but for what a station has of its own */
	uint32_t connections_at_once, polls_at_once;
	int64_t connect_ns;                   /* how long a connection may take */
	int64_t slow_ns;                      /* whoever takes longer gives its place in the window back */
	int64_t retry_ns, retry_max_ns;       /* the first pause before another attempt, and the longest */
	uint16_t receive_octets, send_octets; /* buffers of a connection */
	uint32_t batches, batch_records, batches_in_flight;
	uint32_t shards; /* processes: station i of the file is one of shard i % shards */
	uint32_t shard;  /* that this process is, once its stations are taken */
	struct centre_plan *stations;
	uint32_t station_count;
	uint32_t link_count; /* the first of each station, then the second ones */
	bool secure;         /* a station is */
	struct channel_tls tls;
	struct iec104_poll *polls;
	uint32_t poll_count;
};

/* As an exit code. */
enum centre_config_result { CENTRE_CONFIG_GOOD, CENTRE_CONFIG_WRONG, CENTRE_CONFIG_UNREADABLE };

/* Reads the file; says all that is wrong with it. centre_config_free frees it after each. */
enum centre_config_result centre_config_load(const char *path, struct centre_config *config, FILE *messages);
/* Leaves the stations of this shard alone. */
void centre_config_take_shard(struct centre_config *config, uint32_t shard);
/* Where a station of the shard is in the file; and which of the shard is at that place, false: another shard's. */
uint32_t centre_config_place(const struct centre_config *config, uint32_t station);
bool centre_config_station(const struct centre_config *config, uint32_t place, uint32_t *station);
void centre_config_free(struct centre_config *config);

/* The keys of the file, in a build with the option schema. */
extern const struct config_table centre_file_table;

#endif
