/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A kind of module: all that rtud has to know of it, in one record. The records are in the folders of the modules, and
 * rtud/kinds.c lists them. What starts and supervises modules, and the map, name no kind.
 */
#ifndef OPENRTU_MODULES_KIND_H
#define OPENRTU_MODULES_KIND_H

#include <sys/types.h>

#include "map/map.h"

struct call_rule;
struct config_part;

/* An executable in the folder of the modules. */
struct kind_program {
	const char *name;
	const struct call_rule *calls; /* that it makes once it has started: process/calls.h */
	size_t call_count;
};

/* How a module is run. */
struct kind_run {
	const struct kind_program *program; /* in the folder of the modules; NULL: it is another's */
	const char *path;                   /* of another's program; NULL: it is ours */
	const char *user;                   /* by name; NULL: the one of its plan */
	int priority;                       /* SCHED_FIFO 1..99, 0: none */
	size_t memory;                      /* bytes of address space; 0: as rtud gives it */
};

/* It is a program that rtud starts. */
static inline bool kind_is_started(const struct kind_run *run)
{
	return run->program != NULL || run->path != NULL;
}

/* Where a module listens. */
struct kind_port {
	int type; /* SOCK_STREAM, SOCK_DGRAM */
	const char *address;
	uint16_t port;
};

/* What a module does when only that has changed which its kind alone knows of it. */
enum kind_change {
	KIND_UNCHANGED,
	KIND_TAKES,        /* it takes the change as it runs (map_renew) */
	KIND_STARTS_AGAIN, /* its process ends, and another one begins in the same segment */
	KIND_EXCHANGED, /* another process, with a segment of its own, waits beside it and takes its place */
};

typedef int kind_opener(const struct map_config *config, const char *module);

struct kind {
	const char *name; /* as in the plans of its modules */
	/* What of the configuration file is its own: config/part.h. Left out: nothing. */
	const struct config_part *part;
	/* Plans the modules that the configuration asks for, and gives them their points. False: there is no room for more. */
	bool (*plan)(struct map_config *config);
	const struct kind_program *programs; /* left out: rtud starts none of its modules */
	size_t program_count;
	/* Which of them the modules run; NULL: none. Left out: the first. */
	const struct kind_program *(*choose)(const struct map_config *config);
	/* SCHED_FIFO 1..99, 0: none; with run, the highest of its modules. Left out: none. */
	int (*priority)(const struct map_config *config);
	/* Of a kind that runs programs of others: fills in what is not as it is for all modules. Left out: nothing. */
	void (*run)(const struct map_config *config, const char *module, struct kind_run *out);
	/* Before any module is started, and before one that a reload adds or changes: with its user and group (0: rtud's own). Left out: nothing. */
	void (*begin)(struct map *map, const struct map_config *config, uid_t user, gid_t group);
	/* After that, before any module is started: what is left of before a power cut. Left out: nothing. */
	void (*restore)(struct map *map);
	/*
	 * Whether what only this kind knows of a module is the same in both configurations, whatever numbers the module's sets
	 * and points have there. Left out: there is nothing.
	 */
	bool (*same)(const struct map_config *a, const struct map_config *b, uint32_t module,
		     const char *name);
	/* How far its modules follow what is not the same. Left out: they are exchanged. */
	enum kind_change (*change)(const struct map_config *before, const struct map_config *now);
	/*
	 * What of a module's own section passes over to another process, when that has another configuration. In the same
	 * segment, from is to. Left out: nothing, and there all.
	 */
	void (*carry)(const struct map_config *before, const void *from, const struct map_config *now,
		      void *to, const char *module);
	/* The module's point of others' number i, which it knows by its number; MAP_NONE: it has no more. Left out: none. */
	uint32_t (*reads)(const struct map_config *config, const char *module, uint32_t i);
	/* The key of what only rtud's restart changes, and why. NULL: its modules change while rtud runs. */
	const char *fixed, *fixed_because;
	bool by_numbers; /* its modules keep numbers of points: whenever these may change, they start again */
	const char *group; /* a further one of its processes, by name; NULL: none */
	/* Where a module listens: no two may at one port. False: its configuration has it not. Left out: nowhere. */
	bool (*listens)(const struct map_config *config, const char *module, struct kind_port *out);
	/*
	 * Opens what its user may not, as a socket with a privileged port: in the new process, before that gives up rtud's
	 * rights. The module gets it as --socket. -1 with errno: it cannot, and the process ends. Since two cannot have it at
	 * once, a process that takes another's place begins when that has ended. Left out, or of a module that listens nowhere
	 * though some of its kind do: nothing.
	 */
	kind_opener *open;
	/*
	 * Writes a file about the configuration that the module hands out: in the new process, with the module's rights, so that
	 * what writes it is no part of a program that faces the network. The module gets it as --file. -1 with errno: the
	 * module does without. Left out: nothing.
	 */
	int (*describe)(const struct map_config *config);
};

/* ---- what several kinds do alike --------------------------------------------------------- */

/* For change: whatever has changed, it begins anew. */
enum kind_change kind_starts_again(const struct map_config *before, const struct map_config *now);
/* For open: a socket of type (SOCK_STREAM, which listens, or SOCK_DGRAM) at address and port. -1 with errno. */
int kind_open_port(const char *address, uint16_t port, int type);
/*
 * For begin: a file of secrets, whoever brought it, becomes user's alone (0400). what: for the log, as "the keys of SNMP to
 * rtu-snmp". One that is no file stays as it is: its module says so.
 */
void kind_give_secret(struct map *map, const char *path, const char *what, uid_t user, gid_t group);

#endif
