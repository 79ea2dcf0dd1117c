/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The process of a module: which program it is, as whom it runs, what it may have, how it ends. */
#include "rtud/start.h"

#include <errno.h>
#include <pwd.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include "map/supervise.h"
#include "map/time_ns.h"
#include "modbus/config.h"
#include "rtud/kinds.h"
#include "rtud/process.h"

/* What a module may have: some times what each was seen to have, and more with the map. */
#define MEMORY_BASE   (24u << 20) /* of address space; rtu-iec104-tls has been seen with 11 MiB */
#define MEMORY_FACTOR 4
#define FILES_BASE                                                                                           \
	96u /* descriptors: a bell of each module, the station's connections and those that are to be */

#define PROCESSES 64 /* and threads, that a program of others may have */

/* A module's user, of modules that have one of their own. */
uid_t start_user(const struct supervisor *supervisor, const struct map_module *module)
{
	return supervisor->options->uid_base ? supervisor->options->uid_base + module->user : 0;
}

/* The one that the configuration names goes before. False with errno: there is none, or it has rights. */
static bool find_user(const struct supervisor *supervisor, const char *name, uid_t *uid)
{
	const struct passwd *user;

	if (name == NULL || supervisor->options->uid_base == 0)
		return true;
	errno = ESRCH;
	user = getpwnam(name);
	if (user == NULL || user->pw_uid == 0)
		return false;
	*uid = user->pw_uid;
	return true;
}

pid_t start_process(const struct supervisor *supervisor, const struct map *map, uint32_t index,
		    const struct map_module *module)
{
	const struct supervise_options *options = supervisor->options;
	const struct kind_run run = kinds_run(module, map_config(map));
	struct process_plan plan = {
	    .folder = options->modules,
	    .program = run.program,
	    .path = run.path,
	    .map = options->map,
	    .module = module->name,
	    .dev = options->dev,
	    .segment = map_segment_open(map, index),
	    .group = kinds_find(module->kind)->group,
	    .uid = start_user(supervisor, module),
	    .gid = options->uid_base,
	    .memory = OPENRTU_INSTRUMENTED ? 0 : MEMORY_BASE + MEMORY_FACTOR * map_size(map),
	    .files = FILES_BASE + MODBUS_PASS_CONNECTIONS_MAX + modbus_port_count(map_config(map)),
	    .open = kinds_opens(module->kind, module->name, map_config(map)),
	    .describe = kinds_find(module->kind)->describe,
	    .config = map_config(map),
	    .filtered = supervisor->filtered && run.program != NULL,
	};
	pid_t pid;

	if (run.memory && plan.memory)
		plan.memory = run.memory;
	if (run.path && plan.uid)
		plan.processes = PROCESSES;
	if (!find_user(supervisor, run.user, &plan.uid)) {
		map_log(supervisor->map, MAP_LOG_ERROR, "the user %s of %s is not there, or is root",
			run.user, module->name);
		close(plan.segment);
		return -1;
	}
	if (plan.segment < 0)
		return -1;
	pid = process_start(&plan);
	close(plan.segment);
	return pid;
}

/* A process that was stopped by a signal would not hear the one that ends it. */
void start_end(struct child *child)
{
	if (child->pid == 0 || child->kill_at_ns != 0)
		return;
	kill(child->pid, SIGTERM);
	kill(child->pid, SIGCONT);
	child->kill_at_ns = map_now_ns() + STOP_MS * NS_PER_MS;
}

void start_allow_memory(const struct supervisor *supervisor)
{
	const rlim_t most = MEMORY_BASE + MEMORY_FACTOR * map_size(supervisor->map);

	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++) {
		const pid_t pid = supervisor->children[i].pid;
		struct rlimit limits;

		if (pid == 0 || prlimit(pid, RLIMIT_AS, NULL, &limits) < 0 || limits.rlim_cur >= most)
			continue;
		limits = (struct rlimit){most, most};
		prlimit(pid, RLIMIT_AS, &limits, NULL);
		prlimit(pid, RLIMIT_MEMLOCK, &limits, NULL);
	}
}
