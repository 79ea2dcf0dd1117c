/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the readers of the ports in the configuration file know of each other. Port, slave and object each read one level of
 * the file by its rules, report what is wrong there and call the next; collisions looks at all points together.
 */
#ifndef OPENRTU_MODBUS_CONFIG_LOADER_H
#define OPENRTU_MODBUS_CONFIG_LOADER_H

#include "config/names.h"
#include "config/page.h"
#include "config/part.h"
#include "modbus/config.h"

#define MODBUS_PORTS_MAX    64  /* 1000 * 64 + 255 is still a common address */
#define MODBUS_UNIT_MAX     247 /* of serial devices; on TCP, 255 is the device itself */
#define MODBUS_TABLES       (MODBUS_HOLDING_REGISTERS + 1)
#define MODBUS_ADDRESS_LAST 65535

/* The keys that lead to an object; a slave's tables follow, see modbus_table_names. */
#define MODBUS_KEY_PORTS     "port"
#define MODBUS_KEY_SLAVES    "slaves"
#define MODBUS_KEY_PROBE_MAX "probe_max_s" /* of a slave */
#define MODBUS_KEY_TEMPLATE  "template"    /* of a slave */
#define MODBUS_KEY_ADDRESS   "address"     /* of an object */
#define MODBUS_KEY_REGISTER  "register"    /* the same, as a manual's number */

/* Digits of a manual's number: its table, and which of it, from 1. */
#define MODBUS_NUMBER_SHORT 5
#define MODBUS_NUMBER_LONG  6

/* A point, and what leads to it in the file. */
struct modbus_entry {
	struct map_point point;
	struct modbus_point wire;
	uint32_t port, slave, object;
	const struct config_template *template; /* whose object it is, NULL: the slave's own */
	const json_t *json;                     /* the object, with what an instance changes of it */
	const json_t *overrides;                /* of a template's objects, by their names; NULL: none */
	const char *prefix;                     /* of all names, and of names of status bits */
	uint32_t ioa_offset;
	uint16_t ca;
	uint16_t write_address; /* MODBUS_WRITTEN_ELSEWHERE */
	uint32_t page;          /* and 1; 0: it is on none */
	bool may_be_paged;      /* its slave has page_address */
	bool is_kept;           /* by the gateway itself: */
	uint32_t kept_every_ms;
	const json_t *kept_values; /* NULL: what was commanded last; the file's */
	char name[MAP_NAME_SIZE];
	uint32_t period_ms;              /* the slave's, for objects without one */
	bool read_back;                  /* the same */
	bool named;                      /* by the file */
	const json_t *names;             /* of its values, NULL: none; the file's */
	const char *ln;                  /* its name in IEC 61850, NULL: none; the file's */
	const char *links[MODBUS_LINKS]; /* names of other points, NULL: none; the file's */
};

/* What the part keeps from step to step. */
struct modbus_loader {
	struct config_loader *files;
	struct config_report *report; /* the files' */
	struct map_config *config;    /* the same */
	struct modbus_entry *entries; /* config->point_count of them */
	uint32_t ports_max, slaves_max, entries_max;
	uint32_t objects;                        /* in the file, of active ports */
	size_t port_of[MODBUS_PORTS_MAX + 1];    /* 1 + index in the file of the port with that value */
	uint32_t port_of_line[MODBUS_PORTS_MAX]; /* index in the file */
};

static inline bool modbus_is_writable(enum modbus_table table)
{
	return table == MODBUS_COILS || table == MODBUS_HOLDING_REGISTERS;
}

/* What the gateway's page may change of a port, a slave, an object. */
extern const struct config_inside modbus_port_inside, modbus_slave_inside, modbus_object_inside;

/* ---- config_object_keys.c ---------------------------------------------------------------- */

/* The key of each table in a slave, by enum modbus_table. */
extern const char *const modbus_table_names[MODBUS_TABLES];

/* The key of each other point in an object, by enum modbus_status and enum modbus_link. */
extern const char *const modbus_link_keys[MODBUS_LINKS];

/* ---- config_port.c ----------------------------------------------------------------------- */

/* Adds a line for every active port, with its devices and entries. ports: an array of at most MODBUS_PORTS_MAX. */
void modbus_read_ports(struct modbus_loader *loader, const struct config_place *file, const json_t *ports);

/* ---- config_pass.c ----------------------------------------------------------------------- */

#define MODBUS_KEY_PASS "pass_through" /* of a port */

/* What of the last line, whose slaves have been read, is open to a tool. json: the object at this key of the port. */
void modbus_read_pass(struct modbus_loader *loader, const struct config_place *port, const char *key,
		      const json_t *json);

/* ---- config_slave.c ---------------------------------------------------------------------- */

/* Says what is wrong with the templates' own keys. */
void modbus_check_templates(struct modbus_loader *loader);

/* Adds a device for every slave to the last line, with its entries. slaves: an array of at most MODBUS_UNIT_MAX + 1. */
void modbus_read_slaves(struct modbus_loader *loader, const struct config_place *port, const json_t *slaves);

/* ---- config_identification.c -------------------------------------------------------------- */

extern const struct config_inside modbus_identification_inside;

/* Adds what the last device shall say that it is, and checks which registers tell it. json: the object at this key of the slave. */
void modbus_read_identification(struct modbus_loader *loader, const struct config_place *slave,
				const char *key, const json_t *json);

/* Whether it has an object of function 43/14, so that a device is asked. json: NULL for none. */
bool modbus_says_objects(const json_t *json);

/* ---- config_object.c --------------------------------------------------------------------- */

/*
 * Adds an entry for every object without errors to the last device. objects: an array, or NULL for none; slave: where
 * they are in the file, the slave or its template; entry: where the slave is, and what it has of all objects.
 */
void modbus_read_objects(struct modbus_loader *loader, const struct config_place *slave,
			 const json_t *objects, enum modbus_table table, struct modbus_entry entry);

/* ---- config_collisions.c ----------------------------------------------------------------- */

/* Reports entries that share what must be a point's own. Leaves the entries in the order map/config.h asks for. */
void modbus_check_collisions(struct modbus_loader *loader);

#define MODBUS_ENTRY_LINKS 10

/* Where an entry is in the file, put together in links. */
const struct config_place *modbus_entry_place(const struct modbus_entry *entry,
					      struct config_place links[MODBUS_ENTRY_LINKS]);

/* ---- config_extras.c --------------------------------------------------------------------- */

/* Fills in what few of the entries' points have. The entries are in their final order. */
void modbus_resolve_extras(struct modbus_loader *loader);

/* Of the name of a point that scales another one. */
#define MODBUS_READ_TOO_LATE                                                                                 \
	"\"%s\" is not read before this object, expected one with a shorter period_ms, or in one request "   \
	"with it"

/* ---- config_keeps.c ---------------------------------------------------------------------- */

/* Keeps what the gateway itself writes, and says what cannot be. The entries are in their final order. */
void modbus_resolve_keeps(struct modbus_loader *loader);

/* ---- config_periods.c -------------------------------------------------------------------- */

/* Reports periods that a line cannot hold. The configuration is complete and has no errors. False without memory. */
bool modbus_check_periods(struct modbus_loader *loader);

/* ---- the schema -------------------------------------------------------------------------- */

/* Of "port": a line, a connection, and what is not used. */
extern const struct config_table modbus_port_table, modbus_tcp_table, modbus_inactive_table;
extern const struct config_table modbus_pass_table;
/* Of the devices in them. */
extern const struct config_table modbus_slave_table, modbus_tcp_slave_table, modbus_identification_table;
/* Of the objects in these. */
extern const struct config_table modbus_coil_table, modbus_discrete_input_table, modbus_input_register_table,
    modbus_holding_register_table;

#endif
