/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/serve.h"

#include "map/map.h"
#include "map/supervise.h"
#include "map/time_ns.h"
#include "rtud/clock.h"
#include "rtud/force.h"
#include "rtud/kinds.h"
#include "rtud/reload.h"
#include "rtud/start.h"

#define RESET_DELAY_MS 500 /* until then whoever asked for a reset has been told */
#define RESET_PAUSE_MS 10000

/* Not one after another: a module gone wild shall not keep the others from working. */
static void take_reset(struct supervisor *supervisor, const struct map_request *request)
{
	int64_t now = map_now_ns();
	bool soon = supervisor->reset_at_ns != 0 || supervisor->reload.phase != RELOAD_IDLE ||
		    (supervisor->reset_ns != 0 && now - supervisor->reset_ns < RESET_PAUSE_MS * NS_PER_MS);
	struct map_module requester;

	map_module(supervisor->map, request->requester, &requester);
	map_log(supervisor->map, MAP_LOG_WARNING, "%s asked for a reset of all modules%s", requester.name,
		soon ? ": refused, the last one was just now" : "");
	map_request_answer(supervisor->map, request, soon ? MAP_RESULT_INTERLOCK : MAP_RESULT_DONE);
	if (!soon)
		supervisor->reset_at_ns = now + RESET_DELAY_MS * NS_PER_MS;
}

static const char *const wishes[] = {
    [MAP_WISH_STOP] = "stop", [MAP_WISH_START] = "start", [MAP_WISH_RESTART] = "restart"};

/* False: it is none that rtud runs, or not this requester's to ask for. */
static bool may_wish(const struct supervisor *supervisor, const struct map_request *request)
{
	struct map_module requester, module;
	struct kind_run run;

	map_module(supervisor->map, request->requester, &requester);
	if (!(requester.flags & MAP_IS_LOCAL) || request->point >= map_module_count(supervisor->map) ||
	    map_is_gone(supervisor->map, request->point) ||
	    request->detail >= sizeof(wishes) / sizeof(wishes[0]))
		return false;
	map_module(supervisor->map, request->point, &module);
	run = kinds_run(&module, map_config(supervisor->map));
	return kind_is_started(&run);
}

static void take_wish(struct supervisor *supervisor, const struct map_request *request)
{
	struct map_module requester, module;
	struct child *child;

	/* A check exchanges nothing. */
	if (supervisor->reload.phase != RELOAD_IDLE && supervisor->reload.job != SETUP_JOB_CHECK) {
		map_request_answer(supervisor->map, request, MAP_RESULT_INTERLOCK);
		return;
	}
	if (!may_wish(supervisor, request)) {
		map_request_answer(supervisor->map, request, MAP_RESULT_NOT_COMMANDABLE);
		return;
	}
	map_module(supervisor->map, request->requester, &requester);
	map_module(supervisor->map, request->point, &module);
	map_log(supervisor->map, MAP_LOG_WARNING, "%s asked to %s %s", requester.name,
		wishes[request->detail], module.name);
	child = &supervisor->children[request->point];
	child->held = request->detail == MAP_WISH_STOP;
	child->restart_at_ns = 0;
	if (request->detail != MAP_WISH_START)
		start_end(child);
	if (child->held && child->pid == 0)
		map_module_ended(supervisor->map, request->point, false);
	map_request_answer(supervisor->map, request, MAP_RESULT_DONE);
}

void serve_requests(struct supervisor *supervisor)
{
	struct map_request request;

	while (map_request_next(supervisor->map, &request)) {
		if (request.action == MAP_SET_CLOCK)
			clock_set(supervisor->map, &request);
		else if (request.action == MAP_RESTART)
			take_reset(supervisor, &request);
		else if (request.action == MAP_MODULE)
			take_wish(supervisor, &request);
		else if (request.action == MAP_RELOAD)
			reload_take(supervisor, &request);
		else if (request.action == MAP_SETUP)
			setup_take(supervisor, &request);
		else if (request.action == MAP_FORCE)
			force_take(supervisor->map, &request);
	}
}
