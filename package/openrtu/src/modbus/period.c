/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "period.h"

bool modbus_period_due(const struct modbus_read *read, int64_t now_ns)
{
	return read->period_ns > 0 && now_ns >= read->due_ns &&
	       (read->pause_ns == 0 || now_ns >= read->not_before_ns);
}

int64_t modbus_period_deadline(const struct modbus_read *read)
{
	return read->due_ns + read->period_ns;
}

uint32_t modbus_period_served(struct modbus_read *read, int64_t begun_ns)
{
	int64_t due_ns = (begun_ns / read->period_ns + 1) * read->period_ns;
	int64_t missed = read->due_ns == 0 ? 0 : (due_ns - read->due_ns) / read->period_ns - 1;

	read->due_ns = due_ns;
	return missed > 0 ? (uint32_t)missed : 0;
}
