/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A fuzzer's input that is read octet by octet. */
#ifndef OPENRTU_FUZZ_INPUT_H
#define OPENRTU_FUZZ_INPUT_H

#include "fuzz/target.h"

static struct input {
	const uint8_t *at, *end;
} input;

/* 0 behind the end. */
static uint8_t next_octet(void)
{
	return input.at < input.end ? *input.at++ : 0;
}

#endif
