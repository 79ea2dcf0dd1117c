/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * An object's address, and manuals' numbers for it: Modicon's, whose first digit is the table and whose others count from 1.
 * 40001 and 400001 are holding register 0.
 */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "modbus/config_object.h"

/* The report, section 4.3: from here on coils would reach the discrete inputs' IOA. */
#define SCHEME_LAST 9999

#define SHORT_COUNT 9999 /* numbers of a table with five digits */
#define LONG_COUNT  (MODBUS_ADDRESS_LAST + 1)

static const char first_digits[] = {'0', '1', '3', '4'}; /* of each table */
static const char *const one_of[] = {"coil", "discrete input", "input register", "holding register"};

struct number {
	enum modbus_table table;
	int64_t address;
};

/* What a manual means by these digits. False: they are no such number. */
static bool parse(const char *digits, struct number *number)
{
	size_t length = strlen(digits);
	int64_t count = length == MODBUS_NUMBER_LONG ? LONG_COUNT : SHORT_COUNT;
	const char *table = memchr(first_digits, digits[0], sizeof(first_digits));

	if (strspn(digits, "0123456789") != length || table == NULL ||
	    (length != MODBUS_NUMBER_SHORT && length != MODBUS_NUMBER_LONG))
		return false;
	number->table = (enum modbus_table)(table - first_digits);
	number->address = strtol(digits + 1, NULL, 10) - 1;
	return number->address >= 0 && number->address < count;
}

/* ---- as a string ------------------------------------------------------------------------- */

static bool read_register(struct modbus_loader *loader, const struct config_place *here,
			  enum modbus_table table, const struct config_value *value, int64_t *address)
{
	struct number number;

	if (!parse(value->text, &number)) {
		config_error(loader->report, here,
			     "\"%s\" is no number of a register as manuals print it, expected \"%c0001\" to "
			     "\"%c9999\", or \"%c00001\" to \"%c65536\"",
			     value->text, first_digits[table], first_digits[table], first_digits[table],
			     first_digits[table]);
		return false;
	}
	if (number.table != table) {
		config_error(loader->report, here,
			     "\"%s\" is %s %lld, but this is one of %s, whose numbers begin with %c",
			     value->text, one_of[number.table], (long long)number.address,
			     modbus_table_names[table], first_digits[table]);
		return false;
	}
	*address = number.address;
	return true;
}

/* A number without quotation marks loses its noughts, so the key takes a string. */
static void explain_register(struct modbus_loader *loader, const struct config_place *here,
			     const json_t *json)
{
	if (json_is_integer(json))
		config_note(loader->report, here, "write it in quotation marks, as \"%05lld\"",
			    (long long)json_integer_value(json));
}

/* ---- as a number that was meant otherwise ------------------------------------------------ */

/* Whether a manual may have printed this: coils' numbers look like addresses. */
static bool may_be_number(int64_t address, char digits[MODBUS_NUMBER_LONG + 1], struct number *number)
{
	if (address <= SCHEME_LAST || address > 4 * 100000 + LONG_COUNT)
		return false;
	snprintf(digits, MODBUS_NUMBER_LONG + 1, "%lld", (long long)address);
	return parse(digits, number);
}

/* JSON has no hexadecimal numbers, which manuals do print. */
static bool from_hexadecimal(const char *text, long *number)
{
	char *end;

	*number = strtol(text, &end, 16);
	return strncasecmp(text, "0x", 2) == 0 && *end == '\0' && *number >= 0 &&
	       *number <= MODBUS_ADDRESS_LAST;
}

static void explain_address(struct modbus_loader *loader, const struct config_place *here, const json_t *json)
{
	char digits[MODBUS_NUMBER_LONG + 1];
	struct number number;
	long written;

	if (json_is_string(json) && parse(json_string_value(json), &number))
		config_note(loader->report, here,
			    "a number as manuals print it has another key: \"" MODBUS_KEY_REGISTER
			    "\": \"%s\"",
			    json_string_value(json));
	else if (json_is_string(json) && from_hexadecimal(json_string_value(json), &written))
		config_note(loader->report, here, "write it in decimal, without quotation marks: %ld",
			    written);
	else if (json_is_integer(json) && may_be_number(json_integer_value(json), digits, &number))
		config_note(loader->report, here,
			    "manuals print %s for %s %lld: write \"" MODBUS_KEY_REGISTER "\": \"%s\"", digits,
			    one_of[number.table], (long long)number.address, digits);
}

void modbus_check_scheme(struct modbus_loader *loader, const struct config_place *object,
			 const struct config_value *values, enum modbus_table table)
{
	const struct config_place address = modbus_object_key(object, OBJECT_ADDRESS);
	const struct config_place ioa = modbus_object_key(object, OBJECT_IOA);
	int64_t given = values[OBJECT_ADDRESS].integer;
	char digits[MODBUS_NUMBER_LONG + 1];
	struct number number;

	if (given <= SCHEME_LAST)
		return;
	if (values[OBJECT_REGISTER].given || !may_be_number(given, digits, &number))
		config_error(
		    loader->report, &ioa,
		    "is missing: addresses from %d on have no IOA by themselves, expected an integer from "
		    "1 to %d",
		    SCHEME_LAST + 1, MODBUS_IOA_MAX);
	else if (number.table == table)
		config_error(loader->report, &address,
			     "manuals print %s for %s %lld: for that, write \"" MODBUS_KEY_REGISTER
			     "\": \"%s\" instead; for %s %s, add an \"ioa\"",
			     digits, one_of[table], (long long)number.address, digits, one_of[table], digits);
	else
		config_error(loader->report, &address,
			     "manuals print %s for %s %lld, but this is one of %s; for %s %s, add an \"ioa\"",
			     digits, one_of[number.table], (long long)number.address,
			     modbus_table_names[table], one_of[table], digits);
}

/* ---- either ------------------------------------------------------------------------------ */

void modbus_read_address(struct modbus_loader *loader, const struct config_place *object,
			 enum modbus_table table, struct config_value *values)
{
	const struct config_place address_key = modbus_object_key(object, OBJECT_ADDRESS);
	const struct config_place register_key = modbus_object_key(object, OBJECT_REGISTER);
	struct config_value *address = &values[OBJECT_ADDRESS], *number = &values[OBJECT_REGISTER];

	if (address->wrong)
		explain_address(loader, &address_key, address->json);
	if (number->wrong)
		explain_register(loader, &register_key, number->json);
	if (address->json != NULL && number->json != NULL) {
		config_error(loader->report, &register_key,
			     "says the same as " MODBUS_KEY_ADDRESS ", expected one of them");
		address->wrong = true;
	} else if (address->json == NULL && number->json == NULL) {
		if (!address->wrong) /* not an object at all */
			config_error(
			    loader->report, &address_key,
			    "is missing, expected an integer from 0 to %d, or the key " MODBUS_KEY_REGISTER,
			    MODBUS_ADDRESS_LAST);
		address->wrong = true;
	} else if (number->given) {
		address->wrong = !read_register(loader, &register_key, table, number, &address->integer);
	} else {
		address->wrong |= number->wrong;
	}
}
