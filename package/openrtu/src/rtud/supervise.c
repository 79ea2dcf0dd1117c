/* SPDX-License-Identifier: GPL-3.0-or-later */
/* rtud's loop: starts the modules, ends and restarts the generations of those that die or hang. */
#include "rtud/supervise.h"

#include <errno.h>
#include <limits.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/signalfd.h>
#include <sys/timerfd.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "map/heap.h"
#include "map/map.h"
#include "map/supervise.h"
#include "map/time_ns.h"
#include "modbus/config.h"
#include "rtud/clock.h"
#include "rtud/config.h"
#include "rtud/filter.h"
#include "rtud/force.h"
#include "rtud/kinds.h"
#include "rtud/plan.h"
#include "rtud/print.h"
#include "rtud/process.h"
#include "rtud/programs.h"
#include "rtud/reload.h"
#include "rtud/serve.h"
#include "rtud/start.h"
#include "rtud/watchdog.h"

#define TICK_MS          50 /* how often heartbeats are looked at and logs are printed */
#define SECOND_MS        1000
#define ATTACH_MAX_MS    10000 /* from its start until a module takes part in the map */
#define SILENCE_PAUSE_MS 10000 /* between two silences of a module that the log has */
#define QUICK_RESTART_MS 100   /* pause after a life shorter than a second */
#define SLOW_RESTART_MS  5000  /* longest pause for a module that cannot run */

/* ---- one module -------------------------------------------------------------------------- */

static struct kind_run run_of(const struct supervisor *supervisor, const struct map_module *module)
{
	return kinds_run(module, map_config(supervisor->map));
}

static void start_module(struct supervisor *supervisor, uint32_t index, const struct map_module *module)
{
	struct child *child = &supervisor->children[index];

	map_module_starting(supervisor->map, index);
	child->attached = false;
	child->silent = false;
	child->started_ns = map_now_ns();
	child->pid = start_process(supervisor, supervisor->map, index, module);
	if (child->pid < 0) {
		const struct kind_run run = run_of(supervisor, module);

		map_log(supervisor->map, MAP_LOG_ERROR, "cannot start %s from %s: %s", module->name,
			run.path ? run.path : supervisor->options->modules, strerror(errno));
		child->pid = 0;
		child->restart_at_ns = map_now_ns() + SLOW_RESTART_MS * NS_PER_MS;
		map_module_ended(supervisor->map, index, true);
		return;
	}
	map_module_started(supervisor->map, index, child->pid);
}

/*
 * At once after a decent life; one that never attached had none, however long a busy host took to start it. A module
 * that ends young by itself cannot run, and trying is not to eat the core nor to fill the log; one that was killed is
 * not to blame.
 */
static void plan_restart(struct child *child, bool attached, int status)
{
	int64_t now = map_now_ns();

	if (attached && now - child->started_ns >= SECOND_MS * NS_PER_MS)
		child->pause_ms = 0;
	else if (child->pause_ms == 0 || (WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL))
		child->pause_ms = QUICK_RESTART_MS;
	else
		child->pause_ms =
		    child->pause_ms * 2 < SLOW_RESTART_MS ? child->pause_ms * 2 : SLOW_RESTART_MS;
	child->restart_at_ns = now + child->pause_ms * NS_PER_MS;
}

/* No program of ours makes one: this is a fault of the filter's, or somebody else's code runs in the module. */
static void log_forbidden_call(struct supervisor *supervisor, uint32_t index, const char *name)
{
	int call = map_module_forbidden(supervisor->map, index);
	char call_name[FILTER_NAME_SIZE];

	filter_name(call, call_name);
	map_log(supervisor->map, MAP_LOG_ERROR, "%s was killed for a forbidden system call: %d (%s)", name,
		call, call_name);
}

static void log_end(struct supervisor *supervisor, uint32_t index, const char *name, int status)
{
	if (WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS)
		log_forbidden_call(supervisor, index, name);
	else if (WIFSIGNALED(status))
		map_log(supervisor->map, MAP_LOG_ERROR, "%s was killed by signal %d (%s)", name,
			WTERMSIG(status), strsignal(WTERMSIG(status)));
	else
		map_log(supervisor->map, MAP_LOG_ERROR, "%s exited with code %d", name, WEXITSTATUS(status));
}

static void module_ended(struct supervisor *supervisor, uint32_t index, int status)
{
	struct child *child = &supervisor->children[index];
	bool attached = map_module_attached(supervisor->map, index); /* maybe since the last look at it */
	const bool asked = child->kill_at_ns != 0;
	struct map_module module;

	map_module_ended(supervisor->map, index, !supervisor->stopping && !asked);
	child->pid = 0;
	child->kill_at_ns = 0;
	if (supervisor->stopping)
		return;
	if (attached) /* also when it was silent: it may have woken and published before it died */
		map_announce(supervisor->map, MAP_EVENT_MODULE_DOWN, index);
	child->restart_at_ns = 0;
	if (asked)
		return;
	map_module(supervisor->map, index, &module);
	log_end(supervisor, index, module.name, status);
	plan_restart(child, attached, status);
}

static void reap(struct supervisor *supervisor)
{
	pid_t pid;
	int status;

	while ((pid = waitpid(-1, &status, WNOHANG)) > 0) {
		if (reload_reap(supervisor, pid, status) || setup_reap(supervisor, pid, status))
			continue;
		for (uint32_t i = 0; i < map_module_count(supervisor->map); i++)
			if (supervisor->children[i].pid == pid)
				module_ended(supervisor, i, status);
	}
}

/* Says once what it may not give. */
static void give_priority(struct supervisor *supervisor, pid_t pid, int priority)
{
	if (process_set_priority(pid, priority) == 0 || supervisor->priority_refused)
		return;
	supervisor->priority_refused = true;
	map_log(supervisor->map, MAP_LOG_WARNING, "cannot give the line processes a real-time priority: %s",
		strerror(errno));
}

/* It has read its configuration and is about to work. */
static void module_attached(struct supervisor *supervisor, uint32_t index, const struct map_module *module)
{
	struct child *child = &supervisor->children[index];
	int priority = run_of(supervisor, module).priority;

	child->attached = true;
	if (priority)
		give_priority(supervisor, child->pid, priority);
	map_module_running(supervisor->map, index);
}

/* One whose heartbeat comes and goes does not fill the log: it says itself how often (process/heartbeat.c). */
static bool silence_is_worth_a_line(struct child *child)
{
	int64_t now_ns = map_now_ns();

	if (child->silence_logged_ns != 0 && now_ns - child->silence_logged_ns < SILENCE_PAUSE_MS * NS_PER_MS)
		return false;
	child->silence_logged_ns = now_ns;
	return true;
}

static int64_t beaten_ns(const struct map_module *module)
{
	return map_now_ns() - module->heartbeat_age_ms * NS_PER_MS;
}

static void log_silence(struct supervisor *supervisor, struct child *child, const struct map_module *module,
			uint32_t limit)
{
	child->silent_since_ns = beaten_ns(module);
	child->silence_logged = silence_is_worth_a_line(child);
	if (child->silence_logged)
		map_log(supervisor->map, MAP_LOG_WARNING, "%s has been silent for %u ms (limit %u)%s",
			module->name, module->heartbeat_age_ms, limit,
			module->point_count ? ": its points are invalid" : "");
}

static void log_return(struct supervisor *supervisor, const struct child *child,
		       const struct map_module *module)
{
	if (child->silence_logged)
		map_log(supervisor->map, MAP_LOG_WARNING, "%s is back: it was silent for %lld ms",
			module->name, (long long)((beaten_ns(module) - child->silent_since_ns) / NS_PER_MS));
}

/* A silent module's points are invalid to every reader already; events tell those who do not ask. */
static void watch_heartbeat(struct supervisor *supervisor, uint32_t index, const struct map_module *module)
{
	struct child *child = &supervisor->children[index];
	uint32_t limit = map_heartbeat_limit_ms(supervisor->map, index);

	if (module->heartbeat_age_ms > limit && !child->silent) {
		child->silent = true;
		map_announce(supervisor->map, MAP_EVENT_MODULE_DOWN, index);
		log_silence(supervisor, child, module, limit);
	} else if (module->heartbeat_age_ms <= limit && child->silent) {
		child->silent = false;
		map_announce(supervisor->map, MAP_EVENT_MODULE_UP, index);
		log_return(supervisor, child, module);
	} else if (module->heartbeat_age_ms > map_patience_ms(supervisor->map, index)) {
		kill(child->pid, SIGKILL);
	}
}

static void watch_module(struct supervisor *supervisor, uint32_t index)
{
	struct child *child = &supervisor->children[index];
	struct map_module module;
	struct kind_run run;

	if (map_is_gone(supervisor->map, index))
		return;
	map_module(supervisor->map, index, &module);
	run = run_of(supervisor, &module);
	if (!kind_is_started(&run))
		return;
	if (child->pid == 0 && (child->held || reload_holds(supervisor, index)))
		return;
	if (child->kill_at_ns != 0 && map_now_ns() > child->kill_at_ns) {
		kill(child->pid, SIGKILL);
	} else if (child->pid == 0 && map_now_ns() >= child->restart_at_ns) {
		start_module(supervisor, index, &module);
	} else if (child->pid && child->attached) {
		watch_heartbeat(supervisor, index, &module);
	} else if (child->pid && map_module_attached(supervisor->map, index)) {
		module_attached(supervisor, index, &module);
	} else if (child->pid && map_now_ns() - child->started_ns > ATTACH_MAX_MS * NS_PER_MS) {
		kill(child->pid, SIGKILL);
	}
}

static void watch_modules(struct supervisor *supervisor)
{
	map_heartbeat(supervisor->map);
	force_tick(supervisor->map);
	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++)
		watch_module(supervisor, i);
}

/* ---- stopping ---------------------------------------------------------------------------- */

static bool any_child(const struct supervisor *supervisor)
{
	for (unsigned i = 0; i < MAP_MODULES_MAX; i++)
		if (supervisor->children[i].pid)
			return true;
	return false;
}

static void signal_children(const struct supervisor *supervisor, int signal_number)
{
	for (unsigned i = 0; i < MAP_MODULES_MAX; i++)
		if (supervisor->children[i].pid)
			kill(supervisor->children[i].pid, signal_number);
}

static void stop_modules(struct supervisor *supervisor)
{
	int64_t deadline = map_now_ns() + STOP_MS * NS_PER_MS;
	sigset_t child_ended;

	supervisor->stopping = true;
	signal_children(supervisor, SIGTERM);
	signal_children(supervisor, SIGCONT); /* a stopped one would not hear the first */
	sigemptyset(&child_ended);
	sigaddset(&child_ended, SIGCHLD);
	for (reap(supervisor); any_child(supervisor); reap(supervisor)) {
		const struct timespec tick = {.tv_nsec = TICK_MS * NS_PER_MS};

		sigtimedwait(&child_ended, NULL, &tick);
		if (map_now_ns() > deadline)
			signal_children(supervisor, SIGKILL);
	}
}

/* The map stays; the next look at the modules starts them. */
static void reset_modules(struct supervisor *supervisor)
{
	bool was_there[MAP_MODULES_MAX] = {false};

	if (supervisor->reset_at_ns == 0 || map_now_ns() < supervisor->reset_at_ns)
		return;
	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++)
		was_there[i] = supervisor->children[i].pid && map_module_attached(supervisor->map, i);
	stop_modules(supervisor);
	supervisor->stopping = false;
	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++) {
		supervisor->children[i].restart_at_ns = 0;
		if (was_there[i])
			map_announce(supervisor->map, MAP_EVENT_MODULE_DOWN, i);
	}
	map_modules_restarting(supervisor->map);
	supervisor->reset_ns = map_now_ns();
	supervisor->reset_at_ns = 0;
}

/* ---- the board's watchdog ---------------------------------------------------------------- */

/* With the modules started: what keeps rtud from starting at all must not end in a board that resets for ever. */
static bool start_watchdog(struct supervisor *supervisor)
{
	const char *device = supervisor->options->watchdog;
	int timeout_s;

	supervisor->watchdog = device ? watchdog_open(device, &timeout_s) : -1;
	if (supervisor->watchdog >= 0)
		map_log(supervisor->map, MAP_LOG_INFO, "%s resets the board after %d s without rtud", device,
			timeout_s);
	else if (device)
		fprintf(stderr, "rtud: cannot use %s as a watchdog: %s\n", device, strerror(errno));
	return supervisor->watchdog >= 0 || !device;
}

/* ---- the loop ---------------------------------------------------------------------------- */

static int watch_fd(int epoll, int fd)
{
	struct epoll_event event = {.events = EPOLLIN, .data.fd = fd};

	return fd < 0 ? -1 : epoll_ctl(epoll, EPOLL_CTL_ADD, fd, &event);
}

static void hear_bell(const struct supervisor *supervisor, int epoll, bool heard)
{
	int fd = map_bell_fd(supervisor->map);
	struct epoll_event event = {.events = heard ? EPOLLIN : 0, .data.fd = fd};

	epoll_ctl(epoll, EPOLL_CTL_MOD, fd, &event);
}

static int create_tick(void)
{
	const struct itimerspec tick = {.it_interval.tv_nsec = TICK_MS * NS_PER_MS, .it_value.tv_nsec = 1};
	int fd = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);

	if (fd >= 0)
		timerfd_settime(fd, 0, &tick, NULL);
	return fd;
}

/*
 * The end of who reads the log is not the gateway's. And whoever started rtud may have left SIGCHLD ignored: then the
 * kernel would reap the modules, and their pids would be other processes'. So may nohup SIGHUP, which is answered in the log.
 */
static int create_signals(void)
{
	sigset_t signals;

	signal(SIGPIPE, SIG_IGN);
	signal(SIGCHLD, SIG_DFL);
	signal(SIGHUP, SIG_DFL);
	sigemptyset(&signals);
	sigaddset(&signals, SIGTERM);
	sigaddset(&signals, SIGINT);
	sigaddset(&signals, SIGCHLD);
	sigaddset(&signals, SIGHUP);
	sigprocmask(SIG_BLOCK, &signals, NULL);
	return signalfd(-1, &signals, SFD_NONBLOCK | SFD_CLOEXEC);
}

/* SIGHUP asks other services to read their files again; it also comes from a terminal that closes. */
static bool asked_to_stop(struct supervisor *supervisor, int signals)
{
	struct signalfd_siginfo info;
	bool stop = false;

	while (read(signals, &info, sizeof(info)) == (ssize_t)sizeof(info))
		if (info.ssi_signo == SIGHUP)
			reload_again(supervisor);
		else
			stop |= info.ssi_signo != SIGCHLD;
	return stop;
}

static void tick_passed(struct supervisor *supervisor)
{
	const struct clock_reading system = clock_read(adjtimex);

	clock_follow(supervisor->map, &system);
	print_logs(supervisor);
	if (supervisor->watchdog >= 0)
		watchdog_feed(supervisor->watchdog);
}

static void loop(struct supervisor *supervisor, int epoll, int signals, int tick)
{
	for (;;) {
		struct epoll_event events[3];
		uint64_t ticks;

		epoll_wait(epoll, events, 3, -1);
		if (asked_to_stop(supervisor, signals))
			return;
		if (read(tick, &ticks, sizeof(ticks)) == (ssize_t)sizeof(ticks)) {
			if (map_bell_is_wild(supervisor->map))
				hear_bell(supervisor, epoll, true);
			map_bell_new_period(supervisor->map);
			tick_passed(supervisor);
		}
		map_bell_clear(supervisor->map);
		if (map_bell_is_wild(supervisor->map))
			hear_bell(supervisor, epoll, false);
		reap(supervisor);
		serve_requests(supervisor);
		reload_step(supervisor);
		setup_step(supervisor);
		reset_modules(supervisor);
		watch_modules(supervisor);
	}
}

/* Above all modules: a line that runs wild must not keep rtud from ending it. */
static void raise_priority(struct supervisor *supervisor)
{
	int highest = kinds_highest_priority(map_config(supervisor->map));

	if (highest)
		give_priority(supervisor, 0, highest < 99 ? highest + 1 : highest);
}

/* Parsing took far more than config itself, from the same heap: the kernel gets these pages back too. */
static void forget(struct map_config *config)
{
	config_free(config);
	malloc_trim(0);
}

/* What else a module may not do holds without filters: it is a user without rights, and its means have limits. */
static void look_for_filters(struct supervisor *supervisor)
{
	const char *missing = filter_missing();

	supervisor->filtered = missing == NULL;
	if (missing != NULL)
		map_log(supervisor->map, MAP_LOG_WARNING,
			"the modules run without a filter of system calls: %s", missing);
}

/*
 * One that is missing costs its points, and not the gateway: an image without rtu-web still polls its lines. It is tried
 * again like one that cannot be started. Where all are missing it is their folder that is wrong.
 */
static bool look_for_programs(const struct supervisor *supervisor)
{
	unsigned wanted = 0, missing = 0;

	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++) {
		struct map_module module;
		struct kind_run run;

		map_module(supervisor->map, i, &module);
		run = run_of(supervisor, &module);
		if (run.program == NULL)
			continue;
		wanted++;
		if (programs_look_for(supervisor->options->modules, run.program->name))
			continue;
		missing++;
		map_log(supervisor->map, MAP_LOG_ERROR, "runs without %s: there is no %s in %s", module.name,
			run.program->name, supervisor->options->modules);
	}
	return missing == 0 || missing < wanted;
}

/* Each line on stderr, as rtud's. */
static void print_reasons(const char *lines)
{
	while (*lines != '\0') {
		const size_t length = strcspn(lines, "\n");

		fprintf(stderr, "rtud: %.*s\n", (int)length, lines);
		lines += length + (lines[length] == '\n');
	}
}

static bool plan(struct map_config *config, const struct supervise_options *options)
{
	char *lines = NULL;
	size_t size;
	FILE *messages = open_memstream(&lines, &size);
	bool possible;

	if (messages == NULL)
		return false;
	possible = plan_modules(config, options->map, messages);
	fclose(messages);
	print_reasons(lines);
	free(lines);
	return possible;
}

/* What has to be before any of them is started. */
static void begin_modules(const struct supervisor *supervisor)
{
	for (uint32_t i = 0; i < map_module_count(supervisor->map); i++) {
		struct map_module module;
		const struct kind *kind;

		map_module(supervisor->map, i, &module);
		kind = kinds_find(module.kind);
		if (kind->begin != NULL)
			kind->begin(supervisor->map, map_config(supervisor->map),
				    start_user(supervisor, &module), supervisor->options->uid_base);
		if (kind->restore != NULL)
			kind->restore(supervisor->map);
	}
}

int supervise(struct map_config *config, const struct supervise_options *options)
{
	static struct supervisor supervisor;
	char error[MAP_ERROR_SIZE];
	int epoll = epoll_create1(EPOLL_CLOEXEC), signals = create_signals(), tick = create_tick();
	struct clock_reading system;
	bool started;

	supervisor.options = options;
	if (!setup_begin(&supervisor, config->text)) {
		perror("rtud");
		return 1;
	}
	if (!plan(config, options))
		return 1;
	if (map_create(&supervisor.map, options->map, config, options->uid_base, error) < 0) {
		fprintf(stderr, "rtud: %s\n", error);
		return 1;
	}
	if (!look_for_programs(&supervisor)) {
		map_remove(supervisor.map);
		return 1;
	}
	if (watch_fd(epoll, signals) < 0 || watch_fd(epoll, tick) < 0 ||
	    watch_fd(epoll, map_bell_fd(supervisor.map)) < 0) {
		fprintf(stderr, "rtud: cannot watch for events: %s\n", strerror(errno));
		return 1;
	}
	raise_priority(&supervisor);
	look_for_filters(&supervisor);
	system = clock_read(adjtimex);
	clock_begin(supervisor.map, &system);
	begin_modules(&supervisor);
	map_log(supervisor.map, MAP_LOG_INFO, "%u lines, %u devices, %u points; map in %s",
		modbus_port_count(config), modbus_slave_count(config), config->point_count, options->map);
	forget(config);
	watch_modules(&supervisor);
	started = start_watchdog(&supervisor);
	if (started)
		loop(&supervisor, epoll, signals, tick);
	reload_cancel(&supervisor);
	stop_modules(&supervisor);
	if (supervisor.watchdog >= 0)
		watchdog_stop(supervisor.watchdog);
	map_log(supervisor.map, MAP_LOG_INFO, "stopped");
	print_last_lines(&supervisor);
	map_remove(supervisor.map);
	map_detach(supervisor.map);
	return started ? 0 : 1;
}
