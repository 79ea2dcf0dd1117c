/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/realtime.h"

#include <stdio.h>
#include <string.h>

bool realtime_kernel(const char *file, const char *version)
{
	FILE *said = fopen(file, "re");
	bool is_one = said != NULL && fgetc(said) == '1';

	if (said != NULL)
		fclose(said);
	return is_one || strstr(version, "PREEMPT_RT") != NULL;
}

const char *realtime_verdict(bool is_realtime_kernel, uint8_t priority, uint32_t longest_us)
{
	if (!is_realtime_kernel)
		return "none: this kernel is not PREEMPT_RT, what was measured promises nothing";
	if (priority == 0)
		return "none: the lines have no real-time priority, what was measured promises nothing";
	if (longest_us > REALTIME_LIMIT_US)
		return "bad: a wake-up was more than 500 us late";
	return "good: no wake-up was more than 500 us late";
}
