/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Octets as hexadecimal digits, small letters alone. */
#ifndef OPENRTU_WEB_HEX_H
#define OPENRTU_WEB_HEX_H

#include <stddef.h>
#include <stdint.h>

/* Returns how many octets there are; 0: it is no such text, or there are more than most (of 255). */
uint8_t web_hex_read(const char *text, uint8_t *out, size_t most);
/* out: 2 * size octets and the terminator. */
void web_hex_write(const uint8_t *octets, size_t size, char *out);

#endif
