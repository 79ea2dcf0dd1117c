/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a configuration says of TLS, of whatever protocol. */
#ifndef OPENRTU_CHANNEL_CONFIG_H
#define OPENRTU_CHANNEL_CONFIG_H

#include "map/config.h"

/* The list of who may come, and a SHA-256 fingerprint as openssl prints it. */
#define CHANNEL_TLS_PEERS_MAX 16
#define CHANNEL_TLS_PEER_SIZE 96

#define CHANNEL_NAME_SIZE 65 /* of a common name: X.520, ub-common-name */

enum channel_tls_version { CHANNEL_TLS_1_2 = 1u << 0, CHANNEL_TLS_1_3 = 1u << 1 };

/* How a station proves who it is and asks who its peers are. IEC 62351-3. The files hold PEM. */
struct channel_tls {
	char certificate[MAP_FILE_SIZE]; /* and what leads from it to its CA; empty: no TLS */
	char key[MAP_FILE_SIZE];
	char ca[MAP_FILE_SIZE];  /* whose certificates the peers have */
	char crl[MAP_FILE_SIZE]; /* of each of these CAs; empty: nothing is revoked */
	uint32_t resumption_s;   /* how long a session may be resumed, 0: never */
	uint32_t renewal_s;      /* how old a connection's keys become */
	uint8_t versions;        /* enum channel_tls_version */
	uint8_t peer_count;      /* 0: whoever has a certificate from the CA */
	uint8_t reserved[2];
	char peers[CHANNEL_TLS_PEERS_MAX][CHANNEL_TLS_PEER_SIZE]; /* common names and fingerprints */
};

static inline bool channel_tls_used(const struct channel_tls *tls)
{
	return tls->certificate[0] != '\0';
}

#endif
