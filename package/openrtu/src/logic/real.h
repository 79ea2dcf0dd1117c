/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Functions of LREAL in our own code: bit for bit the same on every machine with IEEE 754 arithmetic, and without libm.
 * Outside of a function's domain they return a value that is not finite.
 */
#ifndef OPENRTU_LOGIC_REAL_H
#define OPENRTU_LOGIC_REAL_H

#include <stdbool.h>
#include <stdint.h>

enum logic_function {
	LOGIC_SQRT,
	LOGIC_LN,
	LOGIC_LOG,
	LOGIC_EXP,
	LOGIC_SIN,
	LOGIC_COS,
	LOGIC_TAN,
	LOGIC_ASIN,
	LOGIC_ACOS,
	LOGIC_ATAN,
	LOGIC_FUNCTIONS
};

bool logic_finite(double x);
double logic_real(enum logic_function function, double x);
double logic_expt(double base, double exponent);
/* To an integer, halves to the even one. */
double logic_round(double x);

#endif
