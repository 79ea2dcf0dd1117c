/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Codes of a second factor by time (RFC 6238, with the values that all apps have: HMAC-SHA1, six digits, 30 s). */
#ifndef OPENRTU_WEB_TOTP_H
#define OPENRTU_WEB_TOTP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define WEB_TOTP_MAX   40 /* octets of a secret */
#define WEB_TOTP_LEAST 10
#define WEB_MAC_SIZE   20
#define WEB_CODE_SIZE  7 /* terminator included */
#define WEB_STEP_S     30
#define WEB_STEPS_MAX  32 /* codes that were used, and could be once more */

/* A secret as apps have it (RFC 4648, base32 without padding). Returns its octets; 0: it is none. */
uint8_t web_secret_read(const char *text, uint8_t out[WEB_TOTP_MAX]);
/* The digits of a step's HMAC (RFC 4226, 5.3). */
void web_code_of(const uint8_t mac[WEB_MAC_SIZE], char out[WEB_CODE_SIZE]);

struct web_used {
	uint64_t user; /* a hash of the name */
	uint64_t step;
};

/* True: no code of this step or of a later one was used by this user, and this one is now. */
bool web_step_use(struct web_used used[WEB_STEPS_MAX], uint64_t user, uint64_t step);

#endif
