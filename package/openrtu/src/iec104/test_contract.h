/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What test_contract.c asks of whoever makes the map that it tests, with the points of fake_map.h. */
#ifndef OPENRTU_IEC104_TEST_CONTRACT_H
#define OPENRTU_IEC104_TEST_CONTRACT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "iec104/fake_map.h"

/* A scaled point that can be commanded, and a counter, of an owner each. */
#define CONTRACT_POINT   HOLDING3
#define CONTRACT_COUNTER COUNTER

/* A map begun anew, as rtu-iec104 has it. All owners live. */
struct map *contract_begin(void);
void contract_end(void);
/* By the point's owner. */
void contract_publish(uint32_t point, int32_t value, uint8_t quality);
/* The owner of CONTRACT_POINT goes down. */
void contract_end_owner(void);
/* That owner begins to carry out a request. */
void contract_answer(uint32_t id);
int64_t contract_now(void);

#endif
