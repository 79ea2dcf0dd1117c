/* SPDX-License-Identifier: GPL-3.0-or-later */
/* rtud --scl: the configuration as IEC 61850's tools read it. */
#ifndef OPENRTU_RTUD_SCL_H
#define OPENRTU_RTUD_SCL_H

#include "modules/iec61850/cid.h"
#include "rtud/config.h"

/* Prints the server of IEC 61850 on stdout. Errors as config_load. Returns the exit code. */
int scl_print(const char *path, struct config_modules modules, struct cid_form form);

#endif
