/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the libFuzzer harnesses share. */
#ifndef OPENRTU_FUZZ_TARGET_H
#define OPENRTU_FUZZ_TARGET_H

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#define CHECK(condition)                                                                                     \
	do {                                                                                                 \
		if (!(condition))                                                                            \
			abort();                                                                             \
	} while (0)

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#endif
