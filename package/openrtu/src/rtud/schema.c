/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The schema of the file as a whole: the rules of rtud and of the parts of all kinds. */
#include "rtud/schema.h"

#include "config/schema.h"
#include "rtud/config_parts.h"

static const char of_file[] = CONFIG_JSON({
	"title" : "OpenRTU gateway configuration",
	"description" : "The report's file and optional keys. rtud --check sees more.",
	"$defs" : {
		"ip_address" : {
			"type" : "string",
			"minLength" : 1,
			"maxLength" : 45,
			"anyOf" : [ {"format" : "ipv4"}, {"format" : "ipv6"} ]
		}
	}
});

bool schema_print(FILE *out)
{
	const struct config_part *parts[KINDS_MAX];
	struct config_rule rules[CONFIG_FILE_KEYS_MAX];
	const struct config_table file = {
	    .rules = rules, .count = config_file_rules(parts, kinds_parts(parts), rules), .json = of_file};

	return config_print_schema(&file, out);
}
