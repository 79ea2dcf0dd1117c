/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The files of the page, which are in the program: no path of a request ever names a file of the gateway. */
#ifndef OPENRTU_MODULES_WEB_FILES_H
#define OPENRTU_MODULES_WEB_FILES_H

#include <stddef.h>

struct web_file {
	const char *path, *type;
	const char *packed; /* how; NULL: it is not */
	const unsigned char *octets;
	size_t size;
};

/* NULL: there is none. */
const struct web_file *web_file_find(const char *path);

#endif
