/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The model in SCL, with what other rooms know of it: addresses of IEC 60870-5-104, control blocks of GOOSE. */
#ifndef OPENRTU_MODULES_IEC61850_CID_H
#define OPENRTU_MODULES_IEC61850_CID_H

#include <stdio.h>

#include "iec61850/model.h"

/* As struct iec61850_scl has them. */
struct cid_form {
	bool configured, edition_2;
};

/* messages: what is left out, and why; NULL: nobody wants to know. */
void cid_write(FILE *out, const struct iec61850_model *model, struct cid_form form, FILE *messages);
/* A CID in memory of the kernel, which nobody can change any more. -1 with errno: there is none. */
int cid_file(const struct map_config *config);

#endif
