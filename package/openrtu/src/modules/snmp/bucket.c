/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/snmp/bucket.h"

#include <string.h>

#include "map/time_ns.h"

#define BUCKETS 64

struct bucket {
	struct in6_addr address;
	int64_t since_ns; /* its second began; 0: free */
	uint32_t taken;
	uint32_t second; /* in which it discovered last, by number */
	uint32_t discovered;
};

/* The seconds in which anybody discovers. */
static struct {
	int64_t since_ns; /* the present one; 0: there was none */
	uint32_t number;
	uint32_t taken;
	uint32_t addresses, addresses_before; /* that discovered in it, and in the one before */
} discovery;

static struct bucket buckets[BUCKETS];

/* The address's, a free one, or the one whose second began first: its sender is quiet, or one of very many. */
static struct bucket *bucket_of(const struct in6_addr *address)
{
	struct bucket *oldest = &buckets[0];

	for (unsigned i = 0; i < BUCKETS; i++) {
		if (buckets[i].since_ns != 0 && memcmp(&buckets[i].address, address, sizeof(*address)) == 0)
			return &buckets[i];
		if (buckets[i].since_ns < oldest->since_ns)
			oldest = &buckets[i];
	}
	*oldest = (struct bucket){.address = *address};
	return oldest;
}

static struct bucket *bucket_at(const struct in6_addr *address, int64_t now_ns)
{
	struct bucket *bucket = bucket_of(address);

	if (bucket->since_ns == 0 || now_ns - bucket->since_ns >= NS_PER_S) {
		bucket->since_ns = now_ns;
		bucket->taken = 0;
	}
	return bucket;
}

bool bucket_takes(const struct in6_addr *address, uint32_t rate, int64_t now_ns)
{
	return bucket_at(address, now_ns)->taken++ < rate;
}

static void begin_second(int64_t now_ns)
{
	const bool next = discovery.since_ns != 0 && now_ns - discovery.since_ns < 2 * NS_PER_S;

	discovery.addresses_before = next ? discovery.addresses : 0;
	discovery.addresses = discovery.taken = 0;
	discovery.since_ns = now_ns;
	discovery.number++;
}

/* Of the addresses of this second, and of the last: those of a flood are there again, whoever comes first. */
static uint32_t share(uint32_t rate)
{
	const uint32_t addresses = discovery.addresses > discovery.addresses_before
				       ? discovery.addresses
				       : discovery.addresses_before;

	return rate / addresses > 0 ? rate / addresses : 1;
}

bool bucket_discovers(const struct in6_addr *address, uint32_t rate, int64_t now_ns)
{
	struct bucket *bucket = bucket_at(address, now_ns);

	if (discovery.since_ns == 0 || now_ns - discovery.since_ns >= NS_PER_S)
		begin_second(now_ns);
	if (bucket->second != discovery.number) {
		bucket->second = discovery.number;
		bucket->discovered = 0;
		discovery.addresses++;
	}
	/* The first of an address is good for that address, as long as there are as many as buckets. */
	if (discovery.taken >= rate && (bucket->discovered > 0 || discovery.taken >= rate + BUCKETS))
		return false;
	if (bucket->discovered >= share(rate))
		return false;
	bucket->discovered++;
	discovery.taken++;
	return true;
}
