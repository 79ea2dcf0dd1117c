/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Sections of the configuration that grow while the file is read. */
#ifndef OPENRTU_CONFIG_SECTIONS_H
#define OPENRTU_CONFIG_SECTIONS_H

#include "config/keys.h"
#include "map/config.h"

/*
 * Room for so many more records of a section, which is added if there is none yet; map_next_record() takes them. False: there is no
 * memory, which is reported.
 */
bool config_make_room(struct config_report *report, struct map_config *config, uint32_t id,
		      size_t record_size, size_t more);

#endif
