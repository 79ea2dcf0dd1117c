/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/reload.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "map/supervise.h"
#include "map/time_ns.h"
#include "rtud/change.h"
#include "rtud/clock.h"
#include "rtud/compare.h"
#include "rtud/kinds.h"
#include "rtud/process.h"
#include "rtud/proposed.h"
#include "rtud/start.h"

#define START_MS  10000 /* a new process that has not attached by then does not come up */
#define QUIET_MS  10000 /* commands that have not ended by then end with their process */
#define PROOF_MS  1000  /* so long the new processes have to live */
#define PROVEN_MS 10000 /* and by then to have begun */
#define WORKER_MS 60000 /* a file that takes longer to read is not read */

static void log_line(const struct supervisor *supervisor, enum map_log_level level, const char *text)
{
	map_log(supervisor->map, level, "%s", text);
}

/* ---- the report ---------------------------------------------------------------------------- */

static void report_path(const struct supervisor *supervisor, char path[PATH_MAX])
{
	snprintf(path, PATH_MAX, "%s/%s", supervisor->options->map,
		 supervisor->reload.job != SETUP_NO_JOB ? SETUP_REPORT : MAP_REPORT);
}

static FILE *open_report(const struct supervisor *supervisor, const char *mode)
{
	char path[PATH_MAX];
	FILE *report;

	report_path(supervisor, path);
	if (mode[0] == 'w')
		unlink(path);
	report = fopen(path, mode);
	if (report != NULL && mode[0] == 'w' && supervisor->options->uid_base != 0 &&
	    fchown(fileno(report), (uid_t)-1, supervisor->options->uid_base) == 0)
		fchmod(fileno(report), 0640);
	return report;
}

static void add_to_report(const struct supervisor *supervisor, const char *text)
{
	FILE *report = open_report(supervisor, "a");

	if (report == NULL)
		return;
	fprintf(report, "%s\n", text);
	fclose(report);
}

/* Nobody waits for it: it goes where rtud's own words go. */
static void print_report(const struct supervisor *supervisor)
{
	FILE *report = open_report(supervisor, "r");
	char line[512];

	while (report != NULL && fgets(line, sizeof(line), report) != NULL)
		fprintf(stderr, "rtud: %s", line);
	if (report != NULL)
		fclose(report);
}

/* What led to it stays said. */
static bool goes_back(const struct reload *reload)
{
	return reload->back || reload->job == SETUP_JOB_BACK;
}

static bool is_dry(const struct reload *reload)
{
	return reload->job == SETUP_JOB_CHECK || (reload->asked && reload->request.detail != 0);
}

/* ---- its end ------------------------------------------------------------------------------- */

static void drop_map(struct map **map)
{
	if (*map != NULL)
		map_detach(*map);
	*map = NULL;
}

static void kill_incoming(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;

	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++) {
		if (reload->incoming[i] > 0 && kill(reload->incoming[i], SIGKILL) == 0)
			waitpid(reload->incoming[i], NULL, 0);
		reload->incoming[i] = 0;
	}
}

static void finish(struct supervisor *supervisor, enum map_command_result result, const char *text)
{
	struct reload *reload = &supervisor->reload;
	const enum setup_job job = reload->job;
	const bool dry = is_dry(reload);

	if (text != NULL) {
		log_line(supervisor, result == MAP_RESULT_DONE ? MAP_LOG_INFO : MAP_LOG_ERROR, text);
		add_to_report(supervisor, text);
	}
	if (reload->asked)
		map_request_answer(supervisor->map, &reload->request, result);
	else if (job == SETUP_NO_JOB)
		print_report(supervisor);
	drop_map(&reload->next);
	drop_map(&reload->former);
	*reload = (struct reload){.phase = RELOAD_IDLE};
	supervisor->setup.reloaded = job;
	supervisor->setup.reloaded_well = result == MAP_RESULT_DONE;
	if (job == SETUP_NO_JOB && result == MAP_RESULT_DONE && !dry) {
		supervisor->setup.in_force = supervisor->setup.told->text;
		supervisor->setup.replaced = true;
	}
}

static map_modules ending(const struct reload *reload)
{
	return reload->exchanged | reload->gone | reload->again;
}

/* Those that were to be followed have ended: they are started again as what they were. */
static void announce_ended(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;

	for (uint32_t i = 0; reload->phase == RELOAD_ENDING && i < map_module_count(supervisor->map); i++)
		if (ending(reload) & map_module_bit(i))
			map_announce(supervisor->map, MAP_EVENT_MODULE_DOWN, i);
}

/* Before the configuration is in force: what ran runs on. */
static void give_up(struct supervisor *supervisor, const char *module, const char *why)
{
	struct reload *reload = &supervisor->reload;
	char text[MAP_LOG_TEXT_SIZE];

	kill_incoming(supervisor);
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		if (reload->added & map_module_bit(i))
			map_module_ended(supervisor->map, i, false);
	map_abandon(supervisor->map);
	announce_ended(supervisor);
	snprintf(text, sizeof(text), "%s %s: the configuration stays as it was", module, why);
	finish(supervisor, MAP_RESULT_INTERLOCK, text);
}

void reload_cancel(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;

	if (reload->phase == RELOAD_IDLE)
		return;
	if (reload->worker > 0 && kill(reload->worker, SIGKILL) == 0)
		waitpid(reload->worker, NULL, 0);
	if (reload->phase == RELOAD_PROVING)
		finish(supervisor, MAP_RESULT_DONE, NULL);
	else
		give_up(supervisor, "rtud", "ends");
}

/* ---- reading the file ------------------------------------------------------------------------ */

/* Beside rtud, whose heartbeats, restarts and watchdog do not wait for it; and below the lines. */
__attribute__((noreturn)) static void prepare(const struct supervisor *supervisor, pid_t parent)
{
	const struct reload *reload = &supervisor->reload;
	struct change_plan plan = {
	    .path = reload->back ? NULL : reload->path,
	    .text = &supervisor->setup.told->text,
	    .map = supervisor->options->map,
	    .modules = supervisor->options->build,
	    .group = supervisor->options->uid_base,
	    .dry = is_dry(reload),
	};
	FILE *report = open_report(supervisor, goes_back(reload) ? "a" : "w");
	enum setup_verdict verdict = SETUP_READ;
	enum change_result result = CHANGE_REFUSED;
	char instead[PATH_MAX];

	prctl(PR_SET_PDEATHSIG, SIGKILL);
	if (getppid() != parent)
		_exit(CHANGE_REFUSED);
	process_set_priority(0, 0);
	if (report != NULL && reload->job != SETUP_NO_JOB && !reload->back) {
		verdict = proposed_prepare(supervisor, reload->job, instead, report);
		plan.instead = instead;
		plan.dry |= verdict != SETUP_READ;
	} else if (plan.path == supervisor->options->file) {
		plan.instead = proposed_source(supervisor->options);
		if (report != NULL && plan.instead != plan.path)
			fprintf(report, "%s is read in place of %s (--kept)\n", plan.instead, plan.path);
	}
	if (report != NULL && verdict != SETUP_REFUSED)
		result = change_prepare(supervisor->map, reload->former, &plan, report);
	if (report != NULL)
		fclose(report);
	_exit(verdict == SETUP_READ ? result : CHANGE_REFUSED);
}

static void begin(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;
	const pid_t parent = getpid();

	reload->phase = RELOAD_PREPARING;
	reload->deadline_ns = map_now_ns() + WORKER_MS * NS_PER_MS;
	reload->worker = fork();
	if (reload->worker == 0)
		prepare(supervisor, parent);
	if (reload->worker < 0)
		give_up(supervisor, "rtud", "cannot start a process");
}

void reload_again(struct supervisor *supervisor)
{
	if (supervisor->reload.phase != RELOAD_IDLE || proposal_holds(&supervisor->setup.proposal)) {
		log_line(supervisor, MAP_LOG_WARNING, "SIGHUP is ignored: a configuration is being changed");
		return;
	}
	log_line(supervisor, MAP_LOG_INFO, "SIGHUP: reads the configuration again");
	supervisor->reload.path = supervisor->options->file;
	begin(supervisor);
}

void reload_take(struct supervisor *supervisor, const struct map_request *request)
{
	struct reload *reload = &supervisor->reload;
	const char *path = map_section(supervisor->map, request->requester, MAP_PATH_SIZE);
	struct map_module requester;

	map_module(supervisor->map, request->requester, &requester);
	if (!(requester.flags & MAP_IS_LOCAL) || path == NULL || reload->phase != RELOAD_IDLE ||
	    proposal_holds(&supervisor->setup.proposal)) {
		map_request_answer(supervisor->map, request, MAP_RESULT_NOT_COMMANDABLE);
		return;
	}
	reload->asked = true;
	reload->request = *request;
	memcpy(reload->asked_path, path, MAP_PATH_SIZE - 1);
	reload->path = reload->asked_path[0] ? reload->asked_path : supervisor->options->file;
	map_log(supervisor->map, MAP_LOG_INFO, "%s: %s the configuration %.60s", requester.name,
		request->detail ? "checks" : "reads", reload->path);
	begin(supervisor);
}

void reload_propose(struct supervisor *supervisor, enum setup_job job)
{
	supervisor->reload.job = job;
	supervisor->reload.path = supervisor->options->file;
	begin(supervisor);
}

/* ---- the new processes ------------------------------------------------------------------------ */

static void sort_modules(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;
	const uint32_t known = map_module_count(supervisor->map);
	map_modules kept = 0;

	for (uint32_t i = 0; i < map_module_count(reload->next); i++) {
		const bool was = i < known && !map_is_gone(supervisor->map, i);

		if (map_is_gone(reload->next, i))
			reload->gone |= was ? map_module_bit(i) : 0;
		else if (map_is_made_for(reload->next, i))
			*(was ? &reload->exchanged : &reload->added) |= map_module_bit(i);
		else
			kept |= map_module_bit(i);
	}
	reload->again = compare_again(supervisor->map, map_config(reload->next), kept,
				      (reload->exchanged | reload->added | reload->gone) != 0);
}

static void begin_module(const struct supervisor *supervisor, const struct map *map, uint32_t index)
{
	struct map_module module;
	const struct kind *kind;

	map_module(map, index, &module);
	kind = kinds_find(module.kind);
	if (kind->begin != NULL)
		kind->begin(supervisor->map, map_config(map), start_user(supervisor, &module),
			    supervisor->options->uid_base);
}

/* What the former process has opened, the new one cannot have beside it. */
static bool waits_for_the_former(const struct reload *reload, uint32_t index)
{
	const struct map_module_plan *plan = map_plan_of(reload->next, index);

	return (reload->exchanged & map_module_bit(index)) &&
	       kinds_opens(plan->kind, plan->name, map_config(reload->next)) != NULL;
}

static bool start_incoming(struct supervisor *supervisor, uint32_t index)
{
	struct reload *reload = &supervisor->reload;
	struct map_module module;

	if ((supervisor->children[index].held && (reload->exchanged & map_module_bit(index))) ||
	    waits_for_the_former(reload, index))
		return true;
	if (reload->added & map_module_bit(index))
		map_module_starting(supervisor->map, index);
	begin_module(supervisor, reload->next, index);
	map_module(reload->next, index, &module);
	reload->incoming[index] = start_process(supervisor, reload->next, index, &module);
	if (reload->incoming[index] > 0)
		return true;
	reload->incoming[index] = 0;
	give_up(supervisor, module.name, "cannot be started");
	return false;
}

static void start_all(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;
	char error[MAP_ERROR_SIZE];

	if (map_attach_again(&reload->next, supervisor->map, 1, error) < 0) {
		give_up(supervisor, "rtud", error);
		return;
	}
	sort_modules(supervisor);
	reload->phase = RELOAD_STARTING;
	reload->deadline_ns = map_now_ns() + START_MS * NS_PER_MS;
	for (uint32_t i = 0; i < map_module_count(reload->next); i++)
		if ((reload->exchanged | reload->added) & map_module_bit(i) && !start_incoming(supervisor, i))
			return;
}

static void take_preparation(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;

	if (reload->worker != 0) {
		if (map_now_ns() > reload->deadline_ns)
			kill(reload->worker, SIGKILL);
		return;
	}
	if (!WIFEXITED(reload->worker_status) || WEXITSTATUS(reload->worker_status) == CHANGE_REFUSED)
		finish(supervisor, MAP_RESULT_OUT_OF_RANGE,
		       reload->back ? "cannot go back" : "the configuration stays as it was");
	else if (WEXITSTATUS(reload->worker_status) == CHANGE_NONE)
		finish(supervisor, MAP_RESULT_DONE, NULL);
	else
		start_all(supervisor);
}

static void await_incoming(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;
	bool ready = true;

	for (uint32_t i = 0; i < map_module_count(reload->next); i++) {
		const bool late = map_now_ns() > reload->deadline_ns;
		const bool broken = (reload->broken & map_module_bit(i)) != 0;

		if (broken || (late && reload->incoming[i] && !map_module_is_ready(reload->next, i))) {
			give_up(supervisor, map_plan_of(reload->next, i)->name, "does not come up");
			return;
		}
		ready &= reload->incoming[i] == 0 || map_module_is_ready(reload->next, i);
	}
	if (!ready)
		return;
	reload->phase = RELOAD_QUIET;
	reload->deadline_ns = map_now_ns() + QUIET_MS * NS_PER_MS;
}

/* ---- the switch ------------------------------------------------------------------------------- */

static void await_quiet(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;
	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++)
		if ((ending(reload) & map_module_bit(i)) && map_now_ns() < reload->deadline_ns &&
		    map_has_commands_under_way(supervisor->map, i))
			return;
	reload->phase = RELOAD_ENDING;
	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++) {
		if (!(ending(reload) & map_module_bit(i)))
			continue;
		if (map_alive(supervisor->map, i))
			reload->valid |= map_module_bit(i);
		if (reload->exchanged & map_module_bit(i) & reload->valid)
			map_module_switching(supervisor->map, i);
		start_end(&supervisor->children[i]);
	}
}

static bool have_ended(const struct supervisor *supervisor, map_modules modules)
{
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		if ((modules & map_module_bit(i)) && supervisor->children[i].pid != 0)
			return false;
	return true;
}

/* One that was killed, or had begun a command in the last moment, is followed by another generation. */
static map_modules find_seamless(const struct supervisor *supervisor)
{
	const struct reload *reload = &supervisor->reload;
	map_modules seamless = 0;

	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++)
		if ((reload->exchanged & reload->valid & map_module_bit(i)) && reload->incoming[i] != 0 &&
		    !map_has_commands_under_way(supervisor->map, i))
			seamless |= map_module_bit(i);
	return seamless;
}

static void adopt(struct supervisor *supervisor, uint32_t index)
{
	struct child *child = &supervisor->children[index];

	*child = (struct child){.pid = supervisor->reload.incoming[index], .started_ns = map_now_ns()};
	supervisor->reload.incoming[index] = 0;
	map_module_started(supervisor->map, index, child->pid);
}

/* The next look at the modules starts it. */
static void start_again(struct supervisor *supervisor, uint32_t index)
{
	struct reload *reload = &supervisor->reload;

	begin_module(supervisor, supervisor->map, index);
	map_module_ended(supervisor->map, index, false);
	map_announce(supervisor->map, MAP_EVENT_MODULE_DOWN, index);
	supervisor->children[index].restart_at_ns = 0;
	supervisor->children[index].attached = false;
	if (supervisor->children[index].held) { /* nothing is to be proven */
		reload->again &= ~map_module_bit(index);
		reload->exchanged &= ~map_module_bit(index);
	}
}

static void begin_proof(struct supervisor *supervisor, map_modules seamless, map_modules late)
{
	struct reload *reload = &supervisor->reload;

	reload->again |= late;
	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++) {
		const map_modules bit = map_module_bit(i);

		if (reload->gone & bit)
			map_module_ended(supervisor->map, i, false);
		if ((reload->gone | (reload->exchanged & ~seamless & ~reload->again)) & bit)
			map_announce(supervisor->map, MAP_EVENT_MODULE_DOWN, i);
		if (reload->again & bit)
			start_again(supervisor, i);
		if (reload->incoming[i] != 0)
			adopt(supervisor, i);
	}
	reload->exchanged |= reload->added | reload->again;
	reload->added = reload->gone = reload->again = 0;
	reload->broken = 0;
	reload->phase = RELOAD_PROVING;
	reload->switched_ns = map_now_ns();
}

/* Of modules that go on in another generation, before they are told of it. */
static void begin_generations(struct supervisor *supervisor, map_modules seamless)
{
	const struct reload *reload = &supervisor->reload;

	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++)
		if ((reload->exchanged & ~seamless & map_module_bit(i)) && reload->incoming[i] != 0)
			map_module_starting(supervisor->map, i);
}

static void carry_section(const struct map *map, const struct map *next, uint32_t module, const void *from,
			  void *to)
{
	const struct map_module_plan *plan = map_plan_of(next, module);
	const struct kind *kind = kinds_find(plan->kind);

	if (kind->carry != NULL && !map_is_gone(map, module))
		kind->carry(map_config(map), from, map_config(next), to, plan->name);
}

static void put_into_force(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;
	struct map_config before;
	char error[MAP_ERROR_SIZE];
	struct map_switching how = {.again = reload->again, .carry = carry_section};
	map_modules late = 0;

	if (!have_ended(supervisor, ending(reload)))
		return;
	how.valid = reload->valid;
	how.seamless = find_seamless(supervisor);
	if (!reload->back && map_attach_again(&reload->former, supervisor->map, 0, error) < 0) {
		give_up(supervisor, "rtud", error);
		return;
	}
	begin_generations(supervisor, how.seamless);
	if (map_switch(supervisor->map, reload->next, &how, error) < 0) {
		give_up(supervisor, "rtud", error);
		return;
	}
	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++)
		late |= waits_for_the_former(reload, i) ? map_module_bit(i) : 0;
	map_unlink_former(supervisor->map, reload->next);
	if (map_renew(supervisor->map, &before, error) < 0)
		abort(); /* what is mapped already cannot be mapped again: the watchdog or init starts rtud anew */
	clock_mode_changed(supervisor->map, (enum map_clock_mode)before.settings.clock);
	map_forget(supervisor->map);
	drop_map(&reload->next);
	begin_proof(supervisor, how.seamless, late);
	start_allow_memory(supervisor);
}

/* ---- the proof -------------------------------------------------------------------------------- */

static const char *find_failure(const struct supervisor *supervisor)
{
	const struct reload *reload = &supervisor->reload;
	const bool late = map_now_ns() > reload->switched_ns + PROVEN_MS * NS_PER_MS;

	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++)
		if ((reload->broken & map_module_bit(i)) ||
		    (late && (reload->exchanged & map_module_bit(i)) &&
		     !map_module_has_taken_over(supervisor->map, i)))
			return map_plan_of(supervisor->map, i)->name;
	return NULL;
}

static bool have_taken_over(const struct supervisor *supervisor)
{
	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++)
		if ((supervisor->reload.exchanged & map_module_bit(i)) && supervisor->children[i].pid != 0 &&
		    !map_module_has_taken_over(supervisor->map, i))
			return false;
	return true;
}

static void go_back(struct supervisor *supervisor, const char *module)
{
	struct reload *reload = &supervisor->reload;
	char text[MAP_LOG_TEXT_SIZE];

	snprintf(text, sizeof(text), "%s does not work: the former configuration comes back", module);
	log_line(supervisor, MAP_LOG_ERROR, text);
	add_to_report(supervisor, text);
	reload->back = true;
	reload->exchanged = reload->again = reload->broken = reload->valid = 0;
	begin(supervisor);
}

static void watch_proof(struct supervisor *supervisor)
{
	struct reload *reload = &supervisor->reload;
	const char *broken = find_failure(supervisor);
	char text[MAP_LOG_TEXT_SIZE];

	if (broken != NULL && !reload->back) {
		go_back(supervisor, broken);
		return;
	}
	if (broken == NULL &&
	    (map_now_ns() < reload->switched_ns + PROOF_MS * NS_PER_MS || !have_taken_over(supervisor)))
		return;
	if (reload->back) {
		finish(supervisor, MAP_RESULT_INTERLOCK, "the former configuration is in force again");
		return;
	}
	snprintf(text, sizeof(text), "the configuration %.60s is in force", reload->path);
	finish(supervisor, MAP_RESULT_DONE, text);
}

/* ---- from rtud's loop ------------------------------------------------------------------------- */

void reload_step(struct supervisor *supervisor)
{
	enum reload_phase before;

	do {
		before = supervisor->reload.phase;
		switch (before) {
		case RELOAD_IDLE:
			return;
		case RELOAD_PREPARING:
			take_preparation(supervisor);
			break;
		case RELOAD_STARTING:
			await_incoming(supervisor);
			break;
		case RELOAD_QUIET:
			await_quiet(supervisor);
			break;
		case RELOAD_ENDING:
			put_into_force(supervisor);
			break;
		case RELOAD_PROVING:
			watch_proof(supervisor);
			break;
		}
	} while (supervisor->reload.phase != before);
}

bool reload_reap(struct supervisor *supervisor, pid_t pid, int status)
{
	struct reload *reload = &supervisor->reload;

	if (reload->phase == RELOAD_IDLE)
		return false;
	if (pid == reload->worker) {
		reload->worker = 0;
		reload->worker_status = status;
		return true;
	}
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++) {
		struct child *child = &supervisor->children[i];

		if (reload->incoming[i] == pid) {
			reload->incoming[i] = 0;
			reload->broken |= map_module_bit(i);
			return true;
		}
		if (child->pid == pid && reload_holds(supervisor, i)) {
			child->pid = 0;
			child->kill_at_ns = 0;
			return true;
		}
		if (child->pid == pid && reload->phase == RELOAD_PROVING)
			reload->broken |= reload->exchanged & map_module_bit(i);
	}
	return false;
}

bool reload_holds(const struct supervisor *supervisor, uint32_t module)
{
	const struct reload *reload = &supervisor->reload;

	return reload->phase == RELOAD_ENDING && (ending(reload) & map_module_bit(module));
}
