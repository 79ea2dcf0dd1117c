/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Registers that hold a text. */
#ifndef OPENRTU_MODBUS_TEXT_H
#define OPENRTU_MODBUS_TEXT_H

#include <stdint.h>

#include "map/value.h"
#include "modbus/config.h"

/*
 * The text of a point in UTF-8, from the octets of its registers as they came: Latin-1 up to the first zero, without the blanks
 * and the octets of ones that fill it up. What is no character of Latin-1 is a question mark.
 */
void modbus_text(const struct modbus_point *point, const uint8_t *octets, char out[MAP_TEXT_SIZE]);

#endif
