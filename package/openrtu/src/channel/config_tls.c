/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An object "tls": files, versions, who may come. What is in the files the module says, which is on the board. */
#include "channel/config_tls.h"

#include <ctype.h>
#include <string.h>

#define COMMON_NAME_MAX    64 /* X.520, ub-common-name */
#define FINGERPRINT_LENGTH 95 /* 32 octets, as AB:CD:... */
#define SECONDS_OF_A_DAY   86400

enum {
	TLS_CERTIFICATE,
	TLS_KEY,
	TLS_CA,
	TLS_CRL,
	TLS_VERSIONS,
	TLS_RESUMPTION,
	TLS_RENEWAL,
	TLS_PEERS = CHANNEL_TLS_RULES, /* the last: of one who lets others in alone */
	TLS_KEYS
};
const struct config_rule channel_tls_rules[CHANNEL_TLS_RULES] = {
    [TLS_CERTIFICATE] =
	{"certificate", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_FILE_SIZE - 1,
	 CONFIG_SAYS(
	     "Absolute path of one's own certificate, PEM; followed in the file by the chain to its CA.",
	     .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [TLS_KEY] = {"key", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_FILE_SIZE - 1,
		 CONFIG_SAYS(
		     "Absolute path of its key, PEM without a passphrase. Only the program's user, or its "
		     "group, may read it: that of rtu-iec104, rtu-iec61850, rtu-104m or rtu-centre.",
		     .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [TLS_CA] =
	{"ca", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_FILE_SIZE - 1,
	 CONFIG_SAYS(
	     "Absolute path of the certificates of the CAs that the peers' certificates are from, PEM.",
	     .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [TLS_CRL] = {"crl", CONFIG_TEXT, .low = 1, .high = MAP_FILE_SIZE - 1,
		 CONFIG_SAYS("Absolute path of the lists of revoked certificates, PEM; one of each CA. "
			     "Without it, none is revoked.",
			     .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [TLS_VERSIONS] =
	{"versions", CONFIG_ARRAY, .high = 2,
	 CONFIG_SAYS(
	     "Versions of TLS that are allowed.",
	     .json = CONFIG_JSON(
		 {"minItems" : 1, "items" : {"enum" : [ "1.2", "1.3" ]}, "default" : [ "1.2", "1.3" ]}))},
    /* IEC 62351-3: a session is resumed within a day, then the certificates are looked at again. */
    [TLS_RESUMPTION] = {"resumption_s", CONFIG_INTEGER, .low = 0, .high = SECONDS_OF_A_DAY,
			.fallback = SECONDS_OF_A_DAY,
			CONFIG_SAYS("Seconds in which a lost connection can be resumed without checking the "
				    "certificates again; 0: never.")},
    /* IEC 62351-3: keys are renewed within a day. */
    [TLS_RENEWAL] = {"renewal_s", CONFIG_INTEGER, .low = 10, .high = SECONDS_OF_A_DAY,
		     .fallback = SECONDS_OF_A_DAY,
		     CONFIG_SAYS("Seconds after which a connection gets new keys: in TLS 1.3 it goes on, in "
				 "TLS 1.2 it is closed and the peer opens it again.")},
};

static void read_path(struct config_report *report, const struct config_place *tls, unsigned key,
		      const struct config_value *value, char out[MAP_FILE_SIZE])
{
	const struct config_place here = config_key_of(tls, channel_tls_rules[key].name);

	if (!value->given)
		return;
	if (value->text[0] == '/')
		snprintf(out, MAP_FILE_SIZE, "%s", value->text);
	else
		config_error(report, &here, "is not an absolute path, expected one like /data/tls/%s.pem",
			     channel_tls_rules[key].name);
}

static uint8_t read_version(struct config_report *report, const struct config_place *place,
			    const json_t *json)
{
	const char *text = json_string_value(json);

	if (text != NULL && strcmp(text, "1.2") == 0)
		return CHANNEL_TLS_1_2;
	if (text != NULL && strcmp(text, "1.3") == 0)
		return CHANNEL_TLS_1_3;
	config_error(report, place, "is not an allowed version of TLS, expected \"1.2\" or \"1.3\"");
	return 0;
}

static uint8_t read_versions(struct config_report *report, const struct config_place *tls,
			     const struct config_value *value)
{
	const struct config_place array = config_key_of(tls, channel_tls_rules[TLS_VERSIONS].name);
	uint8_t versions = 0;
	const json_t *json;
	size_t i;

	if (!value->given)
		return CHANNEL_TLS_1_2 | CHANNEL_TLS_1_3;
	if (json_array_size(value->json) == 0)
		config_error(report, &array, "is empty, expected \"1.2\" or \"1.3\" or both");
	json_array_foreach(value->json, i, json)
	{
		const struct config_place place = config_element_of(&array, i);

		versions |= read_version(report, &place, json);
	}
	return versions;
}

static bool is_fingerprint(const char *text)
{
	for (size_t i = 0; i < FINGERPRINT_LENGTH; i++)
		if (i % 3 == 2 ? text[i] != ':' : !isxdigit((unsigned char)text[i]))
			return false;
	return text[FINGERPRINT_LENGTH] == '\0';
}

static bool is_common_name(const char *text)
{
	for (const char *c = text; *c != '\0'; c++)
		if (iscntrl((unsigned char)*c))
			return false;
	return text[0] != '\0' && strlen(text) <= COMMON_NAME_MAX;
}

bool channel_names_certificate(const char *text)
{
	return is_common_name(text) || is_fingerprint(text);
}

static void read_peers(struct config_report *report, const struct config_place *array, const json_t *peers,
		       struct channel_tls *out)
{
	const json_t *json;
	size_t i;

	json_array_foreach(peers, i, json)
	{
		const struct config_place place = config_element_of(array, i);
		const char *text = json_string_value(json);

		if (text != NULL && channel_names_certificate(text))
			snprintf(out->peers[i], CHANNEL_TLS_PEER_SIZE, "%s", text);
		else
			config_error(report, &place,
				     "is neither a common name of 1 to %d bytes nor a SHA-256 fingerprint as "
				     "AB:CD:...",
				     COMMON_NAME_MAX);
	}
	out->peer_count = (uint8_t)json_array_size(peers);
}

void channel_read_tls(struct config_report *report, const struct config_place *place, const json_t *json,
		      const struct config_rule *peers, struct channel_tls *tls)
{
	struct config_rule rules[TLS_KEYS];
	struct config_value values[TLS_KEYS] = {{.given = false}};

	memcpy(rules, channel_tls_rules, sizeof(channel_tls_rules));
	if (peers != NULL)
		rules[TLS_PEERS] = *peers;
	config_read_keys(report, place, json, rules, peers != NULL ? TLS_KEYS : TLS_PEERS, values);
	read_path(report, place, TLS_CERTIFICATE, &values[TLS_CERTIFICATE], tls->certificate);
	read_path(report, place, TLS_KEY, &values[TLS_KEY], tls->key);
	read_path(report, place, TLS_CA, &values[TLS_CA], tls->ca);
	read_path(report, place, TLS_CRL, &values[TLS_CRL], tls->crl);
	tls->versions = read_versions(report, place, &values[TLS_VERSIONS]);
	if (values[TLS_PEERS].given) {
		const struct config_place array = config_key_of(place, peers->name);

		read_peers(report, &array, values[TLS_PEERS].json, tls);
	}
	tls->resumption_s = (uint32_t)values[TLS_RESUMPTION].integer;
	tls->renewal_s = (uint32_t)values[TLS_RENEWAL].integer;
}
