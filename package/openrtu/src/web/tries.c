/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "web/tries.h"

#include <string.h>

#include "map/time_ns.h"
#include "web/mix.h"

#define LIMITS 3

/* What is counted. */
enum { BOTH, HOST, NAME, CODE };

struct limit {
	uint64_t key;
	uint32_t free;
};

/* Whoever has an address of IPv6 has 64 bits to choose from. */
static struct in6_addr host_of(const struct in6_addr *address)
{
	struct in6_addr host = *address;

	if (!IN6_IS_ADDR_V4MAPPED(address))
		memset(&host.s6_addr[8], 0, 8);
	return host;
}

/* Two that have one key are counted together: whoever makes them so waits longer. */
static uint64_t key_of(uint8_t what, const char *name, const struct in6_addr *address)
{
	uint64_t key = web_mix(WEB_MIX_BEGIN, &what, sizeof(what));
	struct in6_addr host;

	if (address != NULL) {
		host = host_of(address);
		key = web_mix(key, &host, sizeof(host));
	}
	if (name != NULL)
		key = web_mix(key, name, strlen(name));
	return key != 0 ? key : 1;
}

/* NULL: it is not counted. */
static struct web_count *find(struct web_tries *tries, uint64_t key)
{
	for (unsigned i = 0; i < WEB_COUNTS_MAX; i++)
		if (tries->counts[i].key == key)
			return &tries->counts[i];
	return NULL;
}

static int64_t forgotten_ns(const struct web_count *count)
{
	const int64_t last_ns = count->until_ns > count->last_ns ? count->until_ns : count->last_ns;

	return last_ns + WEB_FORGET_S * NS_PER_S;
}

/* The one that nobody asked of for longest gives way. */
static struct web_count *count_of(struct web_tries *tries, uint64_t key, int64_t now_ns)
{
	struct web_count *count = find(tries, key), *oldest = &tries->counts[0];

	for (unsigned i = 0; count == NULL && i < WEB_COUNTS_MAX; i++)
		if (tries->counts[i].key == 0 ||
		    (oldest->key != 0 && tries->counts[i].last_ns < oldest->last_ns))
			oldest = &tries->counts[i];
	if (count == NULL || now_ns > forgotten_ns(count)) {
		count = count != NULL ? count : oldest;
		*count = (struct web_count){.key = key};
	}
	count->last_ns = now_ns;
	return count;
}

static int64_t wait_ns(const struct limit *limit, uint32_t wrong)
{
	int64_t wait_s = WEB_WAIT_S;

	if (wrong < limit->free)
		return 0;
	for (uint32_t i = limit->free; i < wrong && wait_s < WEB_WAIT_MAX_S; i++)
		wait_s *= 2;
	return (wait_s < WEB_WAIT_MAX_S ? wait_s : WEB_WAIT_MAX_S) * NS_PER_S;
}

static unsigned seconds(int64_t ns)
{
	return ns > 0 ? (unsigned)((ns + NS_PER_S - 1) / NS_PER_S) : 0;
}

static int64_t wait_for(struct web_tries *tries, const struct limit *limits, unsigned count, int64_t now_ns)
{
	int64_t longest_ns = 0;

	for (unsigned i = 0; i < count; i++) {
		const int64_t until_ns = count_of(tries, limits[i].key, now_ns)->until_ns;

		if (until_ns - now_ns > longest_ns)
			longest_ns = until_ns - now_ns;
	}
	return longest_ns;
}

static void add(struct web_tries *tries, const struct limit *limits, unsigned count, int64_t now_ns)
{
	for (unsigned i = 0; i < count; i++) {
		struct web_count *counted = count_of(tries, limits[i].key, now_ns);

		counted->wrong++;
		counted->until_ns = now_ns + wait_ns(&limits[i], counted->wrong);
	}
}

static bool is_known(const struct web_tries *tries, uint64_t key)
{
	for (unsigned i = 0; i < WEB_KNOWN_MAX; i++)
		if (tries->known[i] == key)
			return true;
	return false;
}

bool web_try_begin(struct web_tries *tries, const char *name, const struct in6_addr *address, int64_t now_ns,
		   unsigned *wait_s)
{
	const struct limit limits[LIMITS] = {{key_of(BOTH, name, address), WEB_OF_BOTH},
					     {key_of(HOST, NULL, address), WEB_OF_HOST},
					     {key_of(NAME, name, NULL), WEB_OF_NAME}};
	const bool known = is_known(tries, limits[0].key);
	const unsigned count = known ? LIMITS - 1 : LIMITS;
	const int64_t full_ns = tries->hashes_full_ns > now_ns ? tries->hashes_full_ns : now_ns;
	const int64_t hash_ns = known ? 0 : full_ns - (WEB_HASHES - 1) * WEB_HASH_S * NS_PER_S - now_ns;

	/* Before anything is counted: strangers have no count that they push out. */
	*wait_s = seconds(hash_ns);
	if (*wait_s == 0)
		*wait_s = seconds(wait_for(tries, limits, count, now_ns));
	if (*wait_s > 0)
		return false;
	add(tries, limits, count, now_ns);
	if (!known)
		tries->hashes_full_ns = full_ns + WEB_HASH_S * NS_PER_S;
	return true;
}

static void take_back(struct web_tries *tries, uint64_t key, uint32_t free)
{
	struct web_count *count = find(tries, key);

	if (count == NULL || count->wrong == 0)
		return;
	if (--count->wrong < free)
		count->until_ns = 0;
}

static void forget(struct web_tries *tries, uint64_t key)
{
	struct web_count *count = find(tries, key);

	if (count != NULL)
		memset(count, 0, sizeof(*count));
}

void web_try_right(struct web_tries *tries, const char *name, const struct in6_addr *address)
{
	const uint64_t both = key_of(BOTH, name, address);

	forget(tries, both);
	take_back(tries, key_of(HOST, NULL, address), WEB_OF_HOST);
	if (is_known(tries, both))
		return;
	take_back(tries, key_of(NAME, name, NULL), WEB_OF_NAME);
	tries->known[tries->next_known++ % WEB_KNOWN_MAX] = both;
}

bool web_code_begin(struct web_tries *tries, const char *name, int64_t now_ns, unsigned *wait_s)
{
	const struct limit limit = {key_of(CODE, name, NULL), WEB_OF_CODE};

	*wait_s = seconds(wait_for(tries, &limit, 1, now_ns));
	if (*wait_s > 0)
		return false;
	add(tries, &limit, 1, now_ns);
	return true;
}

void web_code_right(struct web_tries *tries, const char *name)
{
	forget(tries, key_of(CODE, name, NULL));
}
