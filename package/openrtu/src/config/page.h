/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the gateway's page may change of the configuration file: what the column page of the keys' rows lets it. Whatever else
 * differs is refused, also a key that no row knows, since a file that names a program is one that runs it.
 */
#ifndef OPENRTU_CONFIG_PAGE_H
#define OPENRTU_CONFIG_PAGE_H

#include "config/keys.h"

/* Of a key that has keys of its own: their rows. */
struct config_inside {
	const struct config_rule *rules;
	size_t count;
	bool by_name; /* an object of such objects, by names that the file's author gives */
	bool whole;   /* all of them stay beside what the page may not change, as if their rows said stays */
	const struct config_inside *further; /* it may have these keys, too; NULL: no others */
};

/*
 * Reports each difference between the file in force and a proposed one that the page may not make, at its line of the proposed
 * one, which is the report's source. Elements with nothing that is locked may come, go and move; those with something keep their
 * order, and what is locked stays with the element, as do the keys whose rows say stays.
 */
void config_check_page(struct config_report *report, const json_t *in_force, const json_t *proposed,
		       const struct config_inside *file);

#endif
