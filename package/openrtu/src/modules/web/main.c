/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-web: a page for a browser. One loop: connections (front.c), HTTP by libmicrohttpd (http.c), answers row by row (lists.c). It
 * allocates for a request and frees that with its answer; how many there are at a time is bounded.
 */
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <string.h>

#include "map/heap.h"
#include "modules/web/commands.h"
#include "modules/web/front.h"
#include "modules/web/http.h"
#include "modules/web/login.h"
#include "modules/web/proposals.h"
#include "process/module.h"

#define IDLE_MS 500

static struct http_site site;

static void name_counters(void)
{
	static const char *const names[WEB_COUNT_OF_COUNTERS] = {
	    [WEB_COUNT_CONNECTIONS] = "connections",
	    [WEB_COUNT_REFUSED] = "connections_refused",
	    [WEB_COUNT_LATE] = "connections_late",
	    [WEB_COUNT_DAMAGED] = "handshakes_failed",
	    [WEB_COUNT_REQUESTS] = "requests",
	    [WEB_COUNT_DENIED] = "requests_denied",
	    [WEB_COUNT_LOGINS] = "logins",
	    [WEB_COUNT_LOGINS_FAILED] = "logins_failed",
	    [WEB_COUNT_LOGINS_LIMITED] = "logins_limited",
	    [WEB_COUNT_COMMANDS] = "commands",
	};

	for (unsigned i = 0; i < WEB_COUNT_OF_COUNTERS; i++)
		map_name_counter(site.map, &site.stats->counters[i], "%s", names[i]);
}

/* Another configuration: lists and commands go on with it. */
static void renew(void)
{
	struct map_config before;
	char error[MAP_ERROR_SIZE];

	if (!map_is_changed(site.map) || map_renew(site.map, &before, error) < 0)
		return;
	commands_renew(&site, &before);
	site.settings = web_settings(map_config(site.map));
	front_renew(site.settings);
	map_forget(site.map);
}

static void take_answers(void)
{
	struct map_answer answer;

	if (!site.settings->commands && !site.settings->setup)
		return;
	while (map_answer_next(site.map, &answer)) {
		commands_take_answer(&site, &answer);
		setup_take_answer(&site, &answer);
	}
	commands_tick(&site);
	setup_tick(&site);
}

static void run(int stop)
{
	enum { STOP, BELL, HTTP, FRONTS };
	struct pollfd waits[FRONTS + FRONT_POLLS] = {
	    [STOP] = {.fd = stop, .events = POLLIN},
	    [BELL] = {.fd = map_bell_fd(site.map), .events = POLLIN},
	    [HTTP] = {.fd = http_fd(), .events = POLLIN},
	};

	bool served = true;

	while (map_may_run(site.map) && (waits[STOP].revents & POLLIN) == 0) {
		const bool pending = front_wait(&waits[FRONTS]);

		poll(waits, FRONTS + FRONT_POLLS, pending || !served ? 0 : IDLE_MS);
		site.now_ns = map_begin_cycle(site.map);
		map_heartbeat(site.map);
		map_bell_clear(site.map);
		renew();
		take_answers();
		front_serve(&waits[FRONTS], site.now_ns);
		served = http_serve();
	}
}

static bool start(const struct options *options)
{
	signal(SIGPIPE, SIG_IGN); /* OpenSSL writes to a socket as to a file */
	/* What a password's hash took, and what a long list did, goes back at once. */
	mallopt(M_MMAP_THRESHOLD, 64 * 1024);
	mallopt(M_TRIM_THRESHOLD, 64 * 1024);
	if (!front_begin(site.map, site.settings, site.stats, options->socket_fd, http_take))
		return false;
	if (options->socket_fd < 0 || !http_begin(&site)) {
		map_log(site.map, MAP_LOG_ERROR, "cannot start: %s", strerror(errno));
		return false;
	}
	name_counters();
	login_look(&site);
	map_log(site.map, MAP_LOG_INFO, "the page is at %s://%s port %u",
		site.settings->certificate[0] != '\0' ? "https" : "http", site.settings->address,
		(unsigned)site.settings->port);
	return true;
}

/* With set-up, its section has more behind them. */
static struct web_stats *find_stats(void)
{
	struct web_section *section;

	if (site.settings == NULL || !site.settings->setup)
		return map_section(site.map, map_self(site.map), sizeof(struct web_stats));
	section = map_section(site.map, map_self(site.map), sizeof(*section));
	return section != NULL ? &section->stats : NULL;
}

int main(int argc, char **argv)
{
	struct options options;
	int stop;

	site.map = module_begin(argc, argv, &options);
	site.settings = web_settings(map_config(site.map));
	site.map_folder = options.map;
	site.stats = find_stats();
	if (site.settings == NULL || site.stats == NULL)
		return module_is_of_another_build(site.map);
	stop = module_stop_fd();
	if (stop < 0 || !start(&options) || !module_confine(site.map, &options, 0))
		return MODULE_FAILED;
	run(stop);
	http_end();
	map_detach(site.map);
	return MODULE_ENDED;
}
