/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Reads with a period. They are due at the multiples of their period since the clock's zero, so nothing that delays
 * one read delays the next, and their deadline is when they are due again. Of those that are due, the one whose
 * deadline is first goes first (EDF): whatever can be held on a line is held so, but for the request that is under way.
 */
#ifndef OPENRTU_MODBUS_PERIOD_H
#define OPENRTU_MODBUS_PERIOD_H

#include <stdbool.h>
#include <stdint.h>

#include "plan.h"

/* One that the device refused is due as seldom as it is asked for. */
bool modbus_period_due(const struct modbus_read *read, int64_t now_ns);

/* Of a read that is due. */
int64_t modbus_period_deadline(const struct modbus_read *read);

/* The device has answered the request that was begun then. Returns how many periods went by without a request. */
uint32_t modbus_period_served(struct modbus_read *read, int64_t begun_ns);

#endif
