/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * How often somebody may guess a password: the rules of the control centre (centre/login.py). So many wrong ones are free, of a
 * name from a host, of a host, and of a name from hosts that it never came from; each more doubles the wait. Times are the map's.
 */
#ifndef OPENRTU_WEB_TRIES_H
#define OPENRTU_WEB_TRIES_H

#include <netinet/in.h>
#include <stdbool.h>
#include <stdint.h>

#define WEB_OF_BOTH    5
#define WEB_OF_HOST    20
#define WEB_OF_NAME    50
#define WEB_OF_CODE    5 /* of a name, from wherever they come: a code has six digits */
#define WEB_WAIT_S     30
#define WEB_WAIT_MAX_S 900
#define WEB_FORGET_S   900 /* after the last wait */
#define WEB_COUNTS_MAX 256
#define WEB_KNOWN_MAX  16

/*
 * A hash stops all else of the process for as long as it takes: of those who are not known from where they come, so many at once
 * and one more after so long.
 */
#define WEB_HASHES 20
#define WEB_HASH_S 3

struct web_count {
	uint64_t key; /* 0: it is free */
	uint32_t wrong;
	int64_t until_ns, last_ns;
};

struct web_tries {
	struct web_count counts[WEB_COUNTS_MAX];
	uint64_t known[WEB_KNOWN_MAX]; /* names with the hosts that they came from */
	uint32_t next_known;
	int64_t hashes_full_ns; /* when WEB_HASHES are free again */
};

/* True: it may be looked at, and is counted as a wrong one. False: after *wait_s. */
bool web_try_begin(struct web_tries *tries, const char *name, const struct in6_addr *address, int64_t now_ns,
		   unsigned *wait_s);
/* It was a right one. */
void web_try_right(struct web_tries *tries, const char *name, const struct in6_addr *address);
/* The same of a code. */
bool web_code_begin(struct web_tries *tries, const char *name, int64_t now_ns, unsigned *wait_s);
void web_code_right(struct web_tries *tries, const char *name);

#endif
