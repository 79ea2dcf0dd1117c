/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The files of "tls", as they lie on disk. */
#ifndef OPENRTU_CHANNEL_TLS_FILES_H
#define OPENRTU_CHANNEL_TLS_FILES_H

#include "channel/config.h"

/* True: a file is another one than at the call before, by its inode, size and times; also at the first call. */
bool tls_files_changed(const struct channel_tls *settings);

#endif
