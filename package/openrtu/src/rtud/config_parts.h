/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the files of the configuration's loader know of each other. file, masters, port, slave and object each read one level of the
 * file by its rules, report what is wrong there and call the next; collisions looks at all points together. config_load starts
 * them.
 */
#ifndef OPENRTU_RTUD_CONFIG_PARTS_H
#define OPENRTU_RTUD_CONFIG_PARTS_H

#include "rtud/config.h"
#include "rtud/config_keys.h"

#define CONFIG_PORTS_MAX 64  /* 1000 * 64 + 255 is still a common address */
#define CONFIG_UNIT_MAX  247 /* of serial devices; on TCP, 255 is the device itself */
#define CONFIG_TABLES    (MAP_HOLDING_REGISTERS + 1)

/* The keys that lead to an object; a slave's tables follow, see config_table_names. */
#define CONFIG_KEY_PORTS     "port"
#define CONFIG_KEY_SLAVES    "slaves"
#define CONFIG_KEY_PROBE_MAX "probe_max_s" /* of a slave */
#define CONFIG_KEY_TEMPLATES "templates"
#define CONFIG_KEY_INCLUDE   "include"
#define CONFIG_KEY_TEMPLATE  "template" /* of a slave */
#define CONFIG_KEY_NAME      "name"     /* of an object */

#define CONFIG_FILES_MAX 32 /* the file itself and those that it includes */

/* A file that was read. */
struct config_file {
	struct config_source source;
	const struct config_file *includer; /* NULL: it was asked for */
	char *path, *text;                  /* the source's, to be freed */
	json_t *root;
	uint64_t device, inode;
};

/* A device that is described once, for many slaves. */
struct config_template {
	const char *name;
	const json_t *json;
	const struct config_source *source;
	bool wrong; /* that has been said */
};

/* A point, and what leads to it in the file. */
struct config_entry {
	struct map_point point;
	uint32_t port, slave, object;
	const struct config_template *template; /* whose object it is, NULL: the slave's own */
	const json_t *json;                     /* the object, with what an instance changes of it */
	const json_t *overrides;                /* of a template's objects, by their names; NULL: none */
	const char *prefix;                     /* of all names, and of names of status bits */
	uint32_t ioa_offset;
	uint16_t ca;
	char name[MAP_NAME_SIZE];
	uint16_t period_ms;                  /* the slave's, for objects without one */
	bool read_back;                      /* the same */
	bool named;                          /* by the file */
	const char *status[MAP_STATUS_BITS]; /* names of status bits, NULL: none; the file's */
};

struct config_loader {
	struct config_report report;
	struct map_config *config;
	struct config_entry *entries; /* config->point_count of them */
	uint32_t entries_max;
	uint32_t objects; /* in the file, of active ports */
	struct config_file files[CONFIG_FILES_MAX];
	uint32_t file_count;
	size_t bytes; /* of all files */
	struct config_template *templates;
	uint32_t template_count;
	json_t *kept;                            /* array of what was put together of template and instance */
	size_t port_of[CONFIG_PORTS_MAX + 1];    /* 1 + index in the file of the port with that value */
	uint32_t port_of_line[CONFIG_PORTS_MAX]; /* index in the file */
};

static inline bool config_is_writable(enum map_table table)
{
	return table == MAP_COILS || table == MAP_HOLDING_REGISTERS;
}

/* ---- config_common.c --------------------------------------------------------------------- */

/* The key of each table in a slave, by enum map_table. */
extern const char *const config_table_names[CONFIG_TABLES];

void config_out_of_memory(struct config_loader *loader);

/* Gives the point a name of its own; there is room for one each. */
void config_keep_name(struct map_config *config, struct map_point *point, const char *name);

/* ---- config_file.c ----------------------------------------------------------------------- */

/* Fills the settings, then lines, devices and entries from the ports. root: any JSON. */
void config_read_file(struct config_loader *loader, const json_t *root);
/* Reports what needs a module that is not there. root: a file without errors, which has been read. */
void config_check_modules(struct config_loader *loader, const json_t *root, struct config_modules modules);

/* ---- config_template.c ------------------------------------------------------------------- */

/* Reads the file that was asked for, what it includes, and the templates of all. False: it is not JSON or not readable. */
bool config_read_files(struct config_loader *loader, const char *path);
void config_free_files(struct config_loader *loader);
/* Says what is wrong with the templates' own keys, and with files that cannot be included. */
void config_check_templates(struct config_loader *loader);
/* NULL: there is none of this name. */
struct config_template *config_find_template(const struct config_loader *loader, const char *name);
/* The template's file, as it is read for a slave. instance: NULL for none. */
struct config_place config_template_file(const struct config_template *template,
					 const struct config_place *instance);

/* ---- config_masters.c -------------------------------------------------------------------- */

bool config_is_same_address(const char *a, const char *b);
/* An IP address at a place; out is left as it is when it is none. */
void config_read_address(struct config_loader *loader, const struct config_place *place, const char *text,
			 char out[MAP_ADDRESS_SIZE]);
/* An array of them, for which out has room. Returns how many there are. */
uint32_t config_read_addresses(struct config_loader *loader, const struct config_place *array,
			       const json_t *addresses, char (*out)[MAP_ADDRESS_SIZE]);
/* The settings of these names, from arrays of at most MAP_MASTERS_MAX, MAP_GROUPS_MAX and 256 elements. */
void config_read_masters(struct config_loader *loader, const struct config_place *array, const json_t *json);
void config_read_groups(struct config_loader *loader, const struct config_place *array, const json_t *json);
void config_read_originators(struct config_loader *loader, const struct config_place *array,
			     const json_t *json);
/* Reports a group's master that may not connect, and counts the masters in no group. groups: where the groups are. */
void config_check_masters(struct config_loader *loader, const struct config_place *groups);

/* ---- config_zone.c ----------------------------------------------------------------------- */

/* Reads a POSIX TZ string with its rules, as "CET-1CEST,M3.5.0,M10.5.0/3". False: it is none. */
bool config_read_zone(const char *text, struct map_zone *zone);

/* ---- config_tls.c ------------------------------------------------------------------------ */

/* Fills settings.tls. json: the object "tls" of the file. */
void config_read_tls(struct config_loader *loader, const struct config_place *place, const json_t *json);

/* ---- config_journal.c -------------------------------------------------------------------- */

/* Fills settings.journal. json: the object "journal" of the file. */
void config_read_journal(struct config_loader *loader, const struct config_place *place, const json_t *json);

/* ---- config_port.c ----------------------------------------------------------------------- */

/* Adds a line for every active port, with its devices and entries. ports: an array of at most CONFIG_PORTS_MAX. */
void config_read_ports(struct config_loader *loader, const struct config_place *file, const json_t *ports);

/* ---- config_slave.c ---------------------------------------------------------------------- */

/* Adds a device for every slave to the last line, with its entries. slaves: an array of at most CONFIG_UNIT_MAX + 1. */
void config_read_slaves(struct config_loader *loader, const struct config_place *port, const json_t *slaves);

/* ---- config_object.c --------------------------------------------------------------------- */

/* Reports the keys of a template that are no slave's, and values that no slave could have. */
void config_check_template(struct config_loader *loader, const struct config_place *place,
			   const json_t *json);

/*
 * Adds an entry for every object without errors to the last device. objects: an array, or NULL for none; slave: where
 * they are in the file, the slave or its template; entry: where the slave is, and what it has of all objects.
 */
void config_read_objects(struct config_loader *loader, const struct config_place *slave,
			 const json_t *objects, enum map_table table, struct config_entry entry);

/* Reports what no name of a point may have. place: of the name, or of what is put before it. */
void config_check_name(struct config_loader *loader, const struct config_place *place, const char *name);

/* The key of each status bit in an object, by enum map_status. */
extern const char *const config_status_keys[MAP_STATUS_BITS];

/* ---- config_points.c --------------------------------------------------------------------- */

/* Prints the points of a configuration that has been read. False without memory. */
bool config_list_points(const struct config_loader *loader, enum config_list list, FILE *out);

/* ---- config_collisions.c ----------------------------------------------------------------- */

/* Reports entries that share what must be a point's own. Leaves the entries in the order map/config.h asks for. */
void config_check_collisions(struct config_loader *loader);

#define CONFIG_ENTRY_LINKS 10

/* Where an entry is in the file, put together in links. */
const struct config_place *config_entry_place(const struct config_entry *entry,
					      struct config_place links[CONFIG_ENTRY_LINKS]);

/* ---- config_own.c ------------------------------------------------------------------------ */

#define CONFIG_OWN_POINTS_MAX (2 * (MAP_GROUPS_MAX + 1))

/*
 * Adds the gateway's own station behind all others, if the settings have its common address. There is room for a line,
 * a device and CONFIG_OWN_POINTS_MAX points. Reports what they collide with.
 */
void config_add_own_station(struct config_loader *loader);

/* ---- config_status.c --------------------------------------------------------------------- */

/* Fills in the status bits of the entries' points. The entries are in their final order. */
void config_resolve_status(struct config_loader *loader);
/* ---- config_periods.c -------------------------------------------------------------------- */

/* Reports periods that a line cannot hold. The configuration is complete and has no errors. False without memory. */
bool config_check_periods(struct config_loader *loader);

#endif
