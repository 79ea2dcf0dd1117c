/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/snmp/bucket.h"

#include <string.h>

#include "map/time_ns.h"

#define BUCKETS 64

struct bucket {
	struct in6_addr address;
	int64_t since_ns; /* its second began; 0: free */
	uint32_t taken;
};

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

bool bucket_takes(const struct in6_addr *address, uint32_t rate, int64_t now_ns)
{
	struct bucket *bucket = bucket_of(address);

	if (bucket->since_ns == 0 || now_ns - bucket->since_ns >= NS_PER_S) {
		bucket->since_ns = now_ns;
		bucket->taken = 0;
	}
	return bucket->taken++ < rate;
}
