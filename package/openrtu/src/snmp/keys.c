/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "snmp/keys.h"

#include <stdio.h>
#include <string.h>

#define WORDS_MAX 7

static const struct {
	const char *name;
	uint8_t size;
} auths[SNMP_AUTHS] = {{"SHA-256", 32}, {"SHA-384", 48}, {"SHA-512", 64}},
  privs[SNMP_PRIVS] = {{"AES-128", 16}, {"AES-192", 24}, {"AES-256", 32}};

/* Cuts a copy of the line at its spaces. Returns how many words there are, WORDS_MAX + 1 if too many. */
static unsigned split(char line[SNMP_KEY_LINE], const char *words[WORDS_MAX])
{
	unsigned count = 0;
	char *rest = NULL;

	for (char *word = strtok_r(line, " \t\r\n", &rest); word != NULL;
	     word = strtok_r(NULL, " \t\r\n", &rest)) {
		if (count == WORDS_MAX)
			return WORDS_MAX + 1;
		words[count++] = word;
	}
	return count;
}

static int digit(char c)
{
	if (c >= '0' && c <= '9')
		return c - '0';
	if (c >= 'a' && c <= 'f')
		return c - 'a' + 10;
	return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* Returns how many octets there are, 0: it is no such text. */
static uint8_t read_octets(const char *text, uint8_t *out, size_t most)
{
	const size_t size = strlen(text) / 2;

	if (strlen(text) % 2 != 0 || size > most)
		return 0;
	for (size_t i = 0; i < size; i++) {
		const int high = digit(text[2 * i]), low = digit(text[2 * i + 1]);

		if (high < 0 || low < 0)
			return 0;
		out[i] = (uint8_t)(high << 4 | low);
	}
	return (uint8_t)size;
}

static bool read_engine(const char *text, struct snmp_engine_id *out)
{
	out->size = read_octets(text, out->octets, sizeof(out->octets));
	return out->size >= 5; /* RFC 3411, SnmpEngineID */
}

static bool read_keys(const char *const words[4], struct snmp_keys *out)
{
	unsigned auth = 0, priv = 0;

	while (auth < SNMP_AUTHS && strcmp(auths[auth].name, words[0]) != 0)
		auth++;
	while (priv < SNMP_PRIVS && strcmp(privs[priv].name, words[2]) != 0)
		priv++;
	if (auth == SNMP_AUTHS || priv == SNMP_PRIVS)
		return false;
	out->auth = (enum snmp_auth)auth;
	out->priv = (enum snmp_priv)priv;
	out->auth_size = read_octets(words[1], out->auth_key, sizeof(out->auth_key));
	out->priv_size = read_octets(words[3], out->priv_key, sizeof(out->priv_key));
	return out->auth_size == auths[auth].size && out->priv_size == privs[priv].size;
}

static bool take_user(struct snmp_keyring *ring, const struct snmp_settings *settings,
		      const char *const words[WORDS_MAX])
{
	struct snmp_keys keys;

	if (!read_keys(&words[2], &keys))
		return false;
	for (uint32_t i = 0; i < settings->user_count; i++)
		if (strcmp(settings->users[i].name, words[1]) == 0)
			ring->users[i] = keys;
	return true;
}

static bool take_sink(struct snmp_keyring *ring, const struct snmp_settings *settings,
		      const char *const words[WORDS_MAX])
{
	struct snmp_engine_id engine;
	struct snmp_keys keys;

	if (!read_engine(words[2], &engine) || !read_keys(&words[3], &keys))
		return false;
	for (uint32_t i = 0; i < settings->sink_count; i++)
		if (strcmp(settings->sinks[i].name, words[1]) == 0) {
			ring->sink_engines[i] = engine;
			ring->sinks[i] = keys;
		}
	return true;
}

bool snmp_keys_take(struct snmp_keyring *ring, const struct snmp_settings *settings, const char *line)
{
	const char *words[WORDS_MAX] = {NULL};
	char copy[SNMP_KEY_LINE];
	unsigned count;

	if (snprintf(copy, sizeof(copy), "%s", line) >= (int)sizeof(copy))
		return false;
	count = split(copy, words);
	if (count == 0 || words[0][0] == '#')
		return true;
	if (count == 2 && strcmp(words[0], "engine") == 0)
		return read_engine(words[1], &ring->engine);
	if (count == 6 && strcmp(words[0], "user") == 0)
		return take_user(ring, settings, words);
	return count == 7 && strcmp(words[0], "sink") == 0 && take_sink(ring, settings, words);
}

const char *snmp_keys_missing(const struct snmp_keyring *ring, const struct snmp_settings *settings,
			      const char **name)
{
	*name = "the gateway";
	if (ring->engine.size == 0)
		return "engine ID";
	for (uint32_t i = 0; i < settings->user_count; i++) {
		*name = settings->users[i].name;
		if (ring->users[i].auth_size == 0)
			return "user";
	}
	for (uint32_t i = 0; i < settings->sink_count; i++) {
		*name = settings->sinks[i].name;
		if (settings->sinks[i].inform && ring->sinks[i].auth_size == 0)
			return "sink";
	}
	return NULL;
}
