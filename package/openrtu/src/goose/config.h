/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What only GOOSE knows of the configuration: its sections of it. */
#ifndef OPENRTU_GOOSE_CONFIG_H
#define OPENRTU_GOOSE_CONFIG_H

#include "goose/message.h"
#include "map/config.h"

#define GOOSE_KIND "goose"

#define GOOSE_SETTINGS      MAP_SECTION_ID('G', 'O', 'O', 'S')
#define GOOSE_PUBLICATIONS  MAP_SECTION_ID('G', 'O', 'P', 'U')
#define GOOSE_SUBSCRIPTIONS MAP_SECTION_ID('G', 'O', 'S', 'U')
#define GOOSE_MEMBERS       MAP_SECTION_ID('G', 'O', 'P', 'M') /* uint32_t: points that are published */
#define GOOSE_LEAVES        MAP_SECTION_ID('G', 'O', 'S', 'L')

#define GOOSE_INTERFACE_SIZE 16 /* IFNAMSIZ */
#define GOOSE_NAME_SIZE      17
#define GOOSE_PUBLISHED_MAX  16
#define GOOSE_SUBSCRIBED_MAX 32

struct goose_settings {
	char interface[GOOSE_INTERFACE_SIZE];
	int32_t priority; /* SCHED_FIFO, 0: none */
};

/* What names the messages of one control block. */
struct goose_stream {
	char name[GOOSE_NAME_SIZE]; /* as those of its counters begin */
	char control[GOOSE_REFERENCE_SIZE];
	char data_set[GOOSE_REFERENCE_SIZE]; /* of a subscription empty: any */
	uint8_t destination[6];
	uint16_t app_id;
	uint32_t conf_rev;
	bool simulation; /* published as such; of a subscription: such are wanted */
};

struct goose_publication {
	struct goose_stream stream;
	char id[GOOSE_REFERENCE_SIZE];
	bool tagged;
	uint8_t vlan_priority;
	uint16_t vlan;
	uint32_t least_ms, most_ms; /* between messages: behind a change, and at rest */
	bool with_quality, with_time;
	uint32_t first_member, member_count;
};

/* What a leaf of a subscription's data set is to its set of points. */
enum goose_use { GOOSE_VALUE, GOOSE_QUALITY, GOOSE_MOMENT, GOOSE_UNUSED };

struct goose_leaf {
	uint8_t use;    /* enum goose_use */
	uint16_t place; /* of its point in the set */
};

struct goose_subscription {
	struct goose_stream stream;
	uint16_t set;           /* 65535: its leaves are no points */
	uint32_t alive_most_ms; /* that a message may say it holds */
	uint32_t first_leaf, leaf_count;
};

static inline struct goose_settings *goose_settings(const struct map_config *config)
{
	return map_records(config, GOOSE_SETTINGS, sizeof(struct goose_settings));
}

static inline struct goose_publication *goose_publications(const struct map_config *config)
{
	return map_records(config, GOOSE_PUBLICATIONS, sizeof(struct goose_publication));
}

static inline struct goose_subscription *goose_subscriptions(const struct map_config *config)
{
	return map_records(config, GOOSE_SUBSCRIPTIONS, sizeof(struct goose_subscription));
}

static inline uint32_t *goose_members(const struct map_config *config)
{
	return map_records(config, GOOSE_MEMBERS, sizeof(uint32_t));
}

static inline struct goose_leaf *goose_leaves(const struct map_config *config)
{
	return map_records(config, GOOSE_LEAVES, sizeof(struct goose_leaf));
}

#endif
