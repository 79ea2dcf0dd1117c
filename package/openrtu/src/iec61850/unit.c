/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/unit.h"

#include <stddef.h>
#include <string.h>

/* SIUnitKind (IEC 61850-7-3, annex A), of what stands in a point's unit. */
static const char *const names[IEC61850_SI_UNIT_MAX + 1] = {
    [1] = "",      [2] = "m",         [3] = "kg",         [4] = "s",     [5] = "A",     [6] = "K",
    [9] = "deg",   [10] = "rad",      [23] = "°C",        [25] = "F",    [26] = "C",    [27] = "S",
    [28] = "H",    [29] = "V",        [30] = "ohm",       [31] = "J",    [32] = "N",    [33] = "Hz",
    [34] = "lx",   [35] = "Lm",       [36] = "Wb",        [37] = "T",    [38] = "W",    [39] = "Pa",
    [41] = "m²",   [42] = "m³",       [43] = "m/s",       [44] = "m/s²", [45] = "m³/s", [52] = "ppm",
    [53] = "1/s",  [54] = "rad/s",    [55] = "W/m²",      [58] = "K/s",  [59] = "Pa/s", [61] = "VA",
    [63] = "VAr",  [65] = "cos(phi)", [68] = "As",        [71] = "VAh",  [72] = "Wh",   [73] = "VArh",
    [74] = "V/Hz", [75] = "Hz/s",     [79] = "dB",        [81] = "W/s",  [82] = "l/s",  [84] = "h",
    [85] = "min",  [86] = "Ohm/m",    [87] = "percent/s",
};

/* What is written in another way than SCL does, or is a decimal part of a unit that has a number. */
static const struct {
	const char *text;
	struct iec61850_unit unit;
} others[] = {
    {"1", {1, 0}},     {"%", {1, -2}},    {"‰", {1, -3}},    {"°", {9, 0}},    {"degC", {23, 0}},
    {"Ohm", {30, 0}},  {"Ω", {30, 0}},    {"lm", {35, 0}},   {"m2", {41, 0}},  {"m3", {42, 0}},
    {"m/s2", {44, 0}}, {"m3/s", {45, 0}}, {"W/m2", {55, 0}}, {"var", {63, 0}}, {"varh", {73, 0}},
    {"%/s", {87, 0}},  {"g", {3, -3}},    {"l", {42, -3}},
};

/* multiplierKind. */
static const struct {
	const char *name;
	int8_t exponent;
} prefixes[] = {{"y", -24}, {"z", -21}, {"a", -18}, {"f", -15}, {"p", -12}, {"n", -9}, {"µ", -6},
		{"m", -3},  {"c", -2},  {"d", -1},  {"", 0},    {"da", 1},  {"h", 2},  {"k", 3},
		{"M", 6},   {"G", 9},   {"T", 12},  {"P", 15},  {"E", 18},  {"Z", 21}, {"Y", 24}};
#define MICRO_ALSO   "u"
#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

const char *iec61850_si_unit_name(int si)
{
	return si >= 0 && si <= IEC61850_SI_UNIT_MAX ? names[si] : NULL;
}

const char *iec61850_multiplier_name(int exponent)
{
	for (size_t i = 0; i < COUNT(prefixes); i++)
		if (prefixes[i].exponent == exponent)
			return prefixes[i].name;
	return NULL;
}

/* Without a prefix. */
static struct iec61850_unit unit_of(const char *text)
{
	for (uint8_t si = 0; si <= IEC61850_SI_UNIT_MAX; si++)
		if (names[si] != NULL && names[si][0] != '\0' && strcmp(names[si], text) == 0)
			return (struct iec61850_unit){si, 0};
	for (size_t i = 0; i < COUNT(others); i++)
		if (strcmp(others[i].text, text) == 0)
			return others[i].unit;
	return (struct iec61850_unit){0, 0};
}

/* A prefix is of the unit's first letter: of an area or a volume it would count twice or three times. */
static bool takes_prefix(const char *text)
{
	return strncmp(text, "m2", 2) != 0 && strncmp(text, "m3", 2) != 0 && strncmp(text, "m²", 3) != 0 &&
	       strncmp(text, "m³", 3) != 0 && text[0] != '%' && strcmp(text, "min") != 0 &&
	       strcmp(text, "h") != 0 && strcmp(text, "kg") != 0;
}

static struct iec61850_unit with_prefix(const char *text, const char *prefix, int8_t exponent)
{
	const size_t size = strlen(prefix);
	struct iec61850_unit unit = {0, 0};

	if (size == 0 || strncmp(text, prefix, size) != 0 || !takes_prefix(text + size))
		return unit;
	unit = unit_of(text + size);
	unit.exponent = (int8_t)(unit.exponent + exponent);
	return iec61850_multiplier_name(unit.exponent) != NULL ? unit : (struct iec61850_unit){0, 0};
}

struct iec61850_unit iec61850_unit_parse(const char *text)
{
	struct iec61850_unit unit = unit_of(text);

	for (size_t i = 0; unit.si == 0 && i < COUNT(prefixes); i++)
		unit = with_prefix(text, prefixes[i].name, prefixes[i].exponent);
	return unit.si != 0 ? unit : with_prefix(text, MICRO_ALSO, -6);
}
