/* SPDX-License-Identifier: GPL-3.0-or-later */
/* "synch" and "start", the simple form; "net", the full one. Both together are one net. */
#include "synch/config_part.h"

#include <stdlib.h>

#include "synch/config_builder.h"

enum { FILE_SYNCH, FILE_START, FILE_NET, FILE_KEYS };
static const struct config_rule file_rules[FILE_KEYS] = {
    [FILE_SYNCH] =
	{"synch", CONFIG_ARRAY, .high = SYNCH_PLACES_MAX,
	 CONFIG_SAYS(
	     "Who scans when others have, as arrows between lines, programs and modules.",
	     .see = "configuration.md#the-net",
	     .json = CONFIG_JSON({
		     "items" : {
			     "type" : "string",
			     "pattern" :
				 "^ *[A-Za-z0-9._-]{1,39} +(-\\([0-9]{1,3}\\))?-> +[A-Za-z0-9._-]{1,39} *$"
		     },
		     "examples" : [ [], ["line3 -> mixer"], ["line3 -(2)-> mixer"] ]
	     }))},
    [FILE_START] = {"start", CONFIG_ARRAY, .high = SYNCH_PARTICIPANTS_MAX,
		    CONFIG_SAYS("Of those that arrows lead to, who scans once without waiting.",
				.see = "configuration.md#the-net",
				.json = CONFIG_JSON({
					"items" : {"type" : "string", "minLength" : 1},
					"examples" : [ [], ["mixer"] ]
				}))},
    [FILE_NET] = {"net", CONFIG_OBJECT,
		  CONFIG_SAYS("The same as a Petri net, in which more can be said.",
			      .table = &synch_net_table, .json = CONFIG_JSON({"examples" : [ {} ]}))},
};

struct own {
	struct config_value values[FILE_KEYS];
	struct synch_tables *tables;
};

static void read_part(struct config_loader *loader, void *own_memory, const struct config_value *values)
{
	struct own *own = own_memory;

	(void)loader;
	memcpy(own->values, values, sizeof(own->values));
}

static bool has_net(const struct own *own)
{
	return own->values[FILE_SYNCH].given || own->values[FILE_START].given || own->values[FILE_NET].given;
}

/* The lines, programs and modules are there: their parts have named them. */
static bool link_net(struct config_loader *loader, void *own_memory)
{
	const struct config_place file = {.in = NULL};
	const struct config_place arrows = config_key_of(&file, file_rules[FILE_SYNCH].name);
	const struct config_place start = config_key_of(&file, file_rules[FILE_START].name);
	const struct config_place net = config_key_of(&file, file_rules[FILE_NET].name);
	struct own *own = own_memory;
	struct synch_builder builder = {.loader = loader};

	if (!has_net(own))
		return true;
	builder.tables = own->tables = calloc(1, sizeof(*own->tables));
	if (own->tables == NULL)
		return false;
	if (own->values[FILE_NET].given)
		synch_read_net(&builder, &net, own->values[FILE_NET].json);
	if (own->values[FILE_SYNCH].given)
		synch_read_arrows(&builder, &arrows, own->values[FILE_SYNCH].json);
	if (own->values[FILE_START].given)
		synch_read_start(&builder, &start, own->values[FILE_START].json);
	if (loader->report.errors == 0)
		synch_check_fired(&builder, &net);
	synch_order_arcs(own->tables);
	map_add_section(loader->config, SYNCH_NET, sizeof(*own->tables), 1, own->tables);
	own->tables = NULL;
	return true;
}

static void end(void *own_memory)
{
	struct own *own = own_memory;

	free(own->tables);
}

const struct config_part synch_part = {
    .keys = file_rules,
    .key_count = FILE_KEYS,
    .own_size = sizeof(struct own),
    .read = read_part,
    .link = link_net,
    .end = end,
};
