/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The file of keys that openrtu snmp-keys makes on the engineer's machine. A line a record, words between spaces:
 *
 *   engine 80001f88...                             the engine ID of this gateway
 *   user NAME AUTH KEY PRIV KEY                    keys of a user, localized to it
 *   sink NAME ENGINE AUTH KEY PRIV KEY             keys of a sink's user, localized to the sink's engine
 *
 * No pass phrase is in it, and none can be made of it.
 */
#ifndef OPENRTU_SNMP_KEYS_H
#define OPENRTU_SNMP_KEYS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "snmp/config.h"

#define SNMP_ENGINE_ID_MAX 32
#define SNMP_KEY_MAX       64
#define SNMP_KEY_LINE      512

enum snmp_auth { SNMP_SHA256, SNMP_SHA384, SNMP_SHA512, SNMP_AUTHS };
enum snmp_priv { SNMP_AES128, SNMP_AES192, SNMP_AES256, SNMP_PRIVS };

struct snmp_engine_id {
	uint8_t octets[SNMP_ENGINE_ID_MAX];
	uint8_t size; /* 0: none */
};

struct snmp_keys {
	enum snmp_auth auth;
	enum snmp_priv priv;
	uint8_t auth_key[SNMP_KEY_MAX], priv_key[SNMP_KEY_MAX];
	uint8_t auth_size, priv_size; /* 0: the file has none */
};

/* All of the file that the configuration asks for. */
struct snmp_keyring {
	struct snmp_engine_id engine;
	struct snmp_keys users[SNMP_USERS_MAX];
	struct snmp_engine_id sink_engines[SNMP_SINKS_MAX];
	struct snmp_keys sinks[SNMP_SINKS_MAX];
};

/* Takes a line. False: it is none of these. What is of nobody in the configuration is left out. */
bool snmp_keys_take(struct snmp_keyring *ring, const struct snmp_settings *settings, const char *line);
/* What the file lacks, in words; NULL: nothing. name: of whom. */
const char *snmp_keys_missing(const struct snmp_keyring *ring, const struct snmp_settings *settings,
			      const char **name);

#endif
