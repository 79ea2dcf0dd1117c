/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The file of users, which openrtu web-users makes. A line is
 *	NAME ROLE scrypt N R P SALT HASH [SECRET]
 * with salt and hash in hexadecimal digits (RFC 7914), and the secret of a second factor in base32; an empty line or one that begins with # is none.
 */
#ifndef OPENRTU_WEB_USERS_H
#define OPENRTU_WEB_USERS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "web/totp.h"

#define WEB_USER_SIZE  33 /* of a name, terminator included */
#define WEB_LINE_SIZE  384
#define WEB_SALT_MAX   32
#define WEB_HASH_SIZE  32
#define WEB_MEMORY_MAX (16u << 20) /* octets that a hash may take */
#define WEB_EFFORT_MAX 4           /* times as long as one that takes that */

enum web_role { WEB_VIEWER, WEB_OPERATOR, WEB_ENGINEER, WEB_INSTALLER };
/* What a user may do besides looking. */
enum web_right { WEB_LOOKS = 0, WEB_COMMANDS = 1u << 0, WEB_SETS_UP = 1u << 1 };

struct web_user {
	char name[WEB_USER_SIZE];
	uint8_t role; /* enum web_role */
	uint32_t n, r, p;
	uint8_t salt[WEB_SALT_MAX];
	uint8_t salt_size;
	uint8_t hash[WEB_HASH_SIZE];
	uint8_t secret[WEB_TOTP_MAX];
	uint8_t secret_size; /* 0: a password is enough */
};

/* A line of the file, which is cut in pieces. False: it is none. */
bool web_user_read(char line[WEB_LINE_SIZE], struct web_user *out);
/*
 * Looks a user up. False: there is none of this name, and *out is another one (n is 0 if there is none): a password is compared with
 * that as slowly. wrong counts the lines that are none.
 */
bool web_user_find(FILE *file, const char *name, struct web_user *out, unsigned *wrong);
const char *web_role_name(uint8_t role);
bool web_role_may(uint8_t role, enum web_right right);

#endif
