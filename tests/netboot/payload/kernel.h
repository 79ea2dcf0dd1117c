/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef KERNEL_H
#define KERNEL_H

#include <stddef.h>
#include <stdint.h>

/* ---- machine-*.c */
void open_console(void);
void close_console(void); /* once all is sent; what is put then is lost */
void put(char character);
void wait_seconds(uint32_t seconds);
void restart(void);

/* ---- tree.c */
uint32_t be32(const void *number);
const void *tree_property(const void *tree, const char *path, const char *name,
			  uint32_t *size); /* NULL: none */

#endif
