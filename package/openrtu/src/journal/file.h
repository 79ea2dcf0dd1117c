/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The journal's file: grows record by record. A new one is made beside it and takes its place when it is whole, so that at
 * each moment there is one that can be read.
 */
#ifndef OPENRTU_JOURNAL_FILE_H
#define OPENRTU_JOURNAL_FILE_H

#include <stdint.h>
#include <sys/types.h>

#include "journal/record.h"

struct journal_file {
	const char *folder;
	int fd; /* -1: none was begun */
	off_t size;
};

/* Begins a new file with a record, in the place of the one there is. 0: it is on the flash; -1 with errno: there is the former one, or this one, and fd is -1. */
int journal_file_begin(struct journal_file *file, const struct journal_builder *record);
/*
 * Adds a record to the file that was begun. 0: it is on the flash; -1 with errno: it is not, and fd is -1 if that has
 * left something behind the last whole record, so that a new file is to be begun.
 */
int journal_file_append(struct journal_file *file, const struct journal_builder *record);

#endif
