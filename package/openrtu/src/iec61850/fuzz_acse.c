/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on ACSE: what an AARQ carries lies inside it, and an AARE carries what is written into it.
 */
#include "ber/fuzz_element.h"
#include "iec61850/acse.h"

#define OCTETS_MAX 8192

enum { AARE = 0x61, USER_INFORMATION = 0xbe, EXTERNAL = 0x28, SINGLE_TYPE = 0xa0 };

static uint8_t octets[OCTETS_MAX];

static void answer(const struct ber_element *carried, bool accepted)
{
	static const uint32_t path[] = {AARE, USER_INFORMATION, EXTERNAL, SINGLE_TYPE};
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
	struct ber_element whole, again, mms;

	ber_put_octets(&writer, carried->value, carried->size);
	iec61850_acse_answer(&writer, 3, accepted, sizeof(octets));
	whole = written(&writer, sizeof(octets));
	CHECK(ber_follow(&whole, path, sizeof(path) / sizeof(path[0]), &again));
	check_same(&again, carried);
	CHECK(!iec61850_acse_request(&whole, &mms));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	const struct ber_element whole = {.value = data, .size = size};
	struct ber_element mms;

	if (size > OCTETS_MAX / 2)
		return 0;
	if (!iec61850_acse_request(&whole, &mms))
		return 0;
	check_inside(&mms, &whole);
	answer(&mms, true);
	answer(&mms, false);
	return 0;
}
