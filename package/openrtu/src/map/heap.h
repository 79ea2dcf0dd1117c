/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The switches of glibc's heap, which keeps what was freed; another C library's has none, and gives it back by itself. */
#ifndef MAP_HEAP_H
#define MAP_HEAP_H

#include <stdlib.h>

#ifdef __GLIBC__
#include <malloc.h>
#else
enum { M_MMAP_THRESHOLD, M_TRIM_THRESHOLD, M_TOP_PAD };

static inline int mallopt(int what, int value)
{
	(void)what, (void)value;
	return 0;
}

static inline int malloc_trim(size_t pad)
{
	(void)pad;
	return 0;
}
#endif

#endif
