/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/setup.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "map/hash.h"
#include "map/supervise.h"
#include "map/time_ns.h"
#include "rtud/history.h"
#include "rtud/process.h"
#include "rtud/proposed.h"
#include "rtud/start.h"
#include "rtud/supervisor.h"

#define WORKER_MS 60000

/* ---- files of the map's folder --------------------------------------------------------------- */

/* What it says of the proposal, for who asks. */
static void tell(const struct supervisor *supervisor)
{
	const struct proposal *proposal = &supervisor->setup.proposal;
	const gid_t group = supervisor->options->uid_base ? supervisor->options->uid_base : (gid_t)-1;
	json_t *row =
	    json_pack("{s:s, s:s, s:I, s:I, s:I}", "phase", proposal_phase_name(proposal->phase), "user",
		      proposal->user, "until_ns", (json_int_t)proposal->until_ns, "proposed",
		      (json_int_t)proposal->text, "in_force", (json_int_t)supervisor->setup.in_force);
	char *text = json_dumps(row, JSON_COMPACT);

	if (text == NULL || !proposed_put(supervisor, SETUP_STATE, text, strlen(text), (uid_t)-1, group))
		map_log(supervisor->map, MAP_LOG_ERROR, "cannot say how far the page's proposal is");
	free(text);
	json_decref(row);
}

/* ---- the wish ---------------------------------------------------------------------------------- */

/* The page's process may write meanwhile: what was copied is looked at, nothing else. */
static void copy_user(const struct web_setup *wish, char user[WEB_USER_SIZE])
{
	json_t *said;

	memcpy(user, wish->user, WEB_USER_SIZE - 1);
	user[WEB_USER_SIZE - 1] = '\0';
	for (char *c = user; *c != '\0'; c++)
		if ((unsigned char)*c <= ' ' || *c == '\x7f')
			*c = '?';
	said = json_string(user);
	for (char *c = user; said == NULL && *c != '\0'; c++) /* it is not UTF-8 */
		if ((unsigned char)*c > '\x7f')
			*c = '?';
	json_decref(said);
}

/* ---- beside rtud: a text that is shown, the file that is written ------------------------------------- */

/* Who asked reads it, and nobody else. */
static uid_t user_of(const struct supervisor *supervisor, const struct map_request *request)
{
	struct map_module module;

	map_module(supervisor->map, request->requester, &module);
	return start_user(supervisor, &module);
}

static json_t *describe(uint32_t number, const struct history_text *text)
{
	json_t *shown = json_stringn(text->octets, text->length);

	if (shown == NULL)
		return json_pack("{s:s}", "error", "the file is not UTF-8");
	return json_pack("{s:I, s:I, s:o}", "number", (json_int_t)number, "base", (json_int_t)text->hash,
			 "text", shown);
}

/* number: of the history; 0: what runs. */
static json_t *read_shown(const struct supervisor *supervisor, uint32_t number)
{
	const struct supervise_options *options = supervisor->options;
	struct history_text text;

	if (!(number == 0 ? history_read(proposed_source(options), &text)
			  : history_recall(proposed_target(options), number, &text)))
		return json_pack("{s:s}", "error", strerror(errno));
	if (number == 0 && text.hash != supervisor->setup.in_force)
		return json_pack("{s:s}", "error",
				 "the file is not what runs: put it into force with rtuctl reload first");
	return describe(number, &text);
}

static bool show(const struct supervisor *supervisor, const struct map_request *request)
{
	const uid_t user = user_of(supervisor, request);
	json_t *row = read_shown(supervisor, proposed_wish(supervisor->map, request)->number);
	char *dumped;

	json_object_set_new(row, "path", json_string(proposed_target(supervisor->options)));
	json_object_set_new(row, "history", history_list(proposed_target(supervisor->options)));
	dumped = json_dumps(row, JSON_COMPACT);
	return dumped != NULL && proposed_put(supervisor, SETUP_SHOWN, dumped, strlen(dumped),
					      user != 0 ? user : (uid_t)-1, (gid_t)-1);
}

static bool keep(const struct supervisor *supervisor)
{
	const struct setup *setup = &supervisor->setup;
	const char *source = proposed_source(supervisor->options);
	struct history_text former, text;
	char path[PATH_MAX];
	FILE *report;
	bool done = false;

	proposed_path(supervisor, SETUP_REPORT, path);
	report = fopen(path, "a");
	proposed_path(supervisor, PROPOSED_FILE, path);
	if (report == NULL)
		return false;
	if (!history_read(source, &former))
		proposed_say_errno(report, source);
	else if (former.hash != setup->base)
		fputs("somebody has changed the file meanwhile: it stays as that is\n", report);
	else if (!history_read(path, &text) || text.hash != setup->proposal.text)
		proposed_say_errno(report, PROPOSED_FILE);
	else
		done = history_replace(proposed_target(supervisor->options), &former, &text,
				       setup->proposal.user, report);
	fclose(report);
	return done;
}

static void work(const struct supervisor *supervisor, const struct map_request *shown, pid_t parent)
{
	prctl(PR_SET_PDEATHSIG, SIGKILL);
	if (getppid() != parent)
		_exit(EXIT_FAILURE);
	process_set_priority(0, 0);
	_exit((shown != NULL ? show(supervisor, shown) : keep(supervisor)) ? EXIT_SUCCESS : EXIT_FAILURE);
}

/* shown: the request for a text; NULL: the file is written. */
static bool start_worker(struct supervisor *supervisor, const struct map_request *shown)
{
	struct setup *setup = &supervisor->setup;
	const pid_t parent = getpid();

	if (setup->worker != 0 || (shown != NULL && !proposal_begins(&setup->pace, map_now_ns())))
		return false;
	setup->deadline_ns = map_now_ns() + WORKER_MS * NS_PER_MS;
	setup->shown = shown != NULL ? *shown : (struct map_request){.requester = 0};
	setup->worker = fork();
	if (setup->worker == 0)
		work(supervisor, shown, parent);
	if (setup->worker > 0)
		return true;
	setup->worker = 0;
	return false;
}

/* ---- what is done ------------------------------------------------------------------------------ */

static void answer(struct supervisor *supervisor, bool good)
{
	if (supervisor->setup.asked)
		map_request_answer(supervisor->map, &supervisor->setup.request,
				   good ? MAP_RESULT_DONE : MAP_RESULT_OUT_OF_RANGE);
	supervisor->setup.asked = false;
}

static void log_step(const struct supervisor *supervisor, const char *what)
{
	map_log(supervisor->map, MAP_LOG_WARNING, "set-up: %s %s", supervisor->setup.proposal.user, what);
}

static void ended(struct supervisor *supervisor, bool good);

static void perform(struct supervisor *supervisor, enum proposal_task task)
{
	switch (task) {
	case PROPOSAL_NOTHING:
	case PROPOSAL_REFUSE:
		return;
	case PROPOSAL_CHECK:
		reload_propose(supervisor, SETUP_JOB_CHECK);
		return;
	case PROPOSAL_APPLY:
		log_step(supervisor, "puts a configuration into force, for a minute unless it is confirmed");
		reload_propose(supervisor, SETUP_JOB_APPLY);
		return;
	case PROPOSAL_GO_BACK:
		map_log(supervisor->map, MAP_LOG_WARNING,
			"set-up: the configuration of %s goes, the former one comes back",
			supervisor->setup.proposal.user);
		reload_propose(supervisor, SETUP_JOB_BACK);
		return;
	case PROPOSAL_KEEP:
		if (!start_worker(supervisor, NULL))
			ended(supervisor, false);
		return;
	}
}

static void ended(struct supervisor *supervisor, bool good)
{
	struct setup *setup = &supervisor->setup;
	const enum proposal_phase was = setup->proposal.phase;
	const enum proposal_task task =
	    proposal_ended(&setup->proposal, good, setup->told->text, map_now_ns());

	if (was == PROPOSAL_CHECKING)
		proposal_rests(&setup->pace, map_now_ns());
	if (was == PROPOSAL_KEEPING)
		log_step(supervisor, good ? "has confirmed: the file is written"
					  : "has confirmed, but the file cannot be written");
	if (good && (was == PROPOSAL_APPLYING || was == PROPOSAL_RETURNING))
		setup->in_force = setup->told->text;
	answer(supervisor, good);
	perform(supervisor, task);
	tell(supervisor);
}

/* ---- requests ---------------------------------------------------------------------------------- */

static bool is_of_a_page(const struct supervisor *supervisor, const struct map_request *request)
{
	struct map_module requester;

	map_module(supervisor->map, request->requester, &requester);
	return (requester.flags & MAP_ASKS_SETUP) && request->detail < SETUP_WISHES &&
	       proposed_wish(supervisor->map, request) != NULL;
}

/* What it hands over is read when its process begins. */
static enum proposal_task begin(struct supervisor *supervisor, const struct map_request *request)
{
	struct setup *setup = &supervisor->setup;
	const struct web_setup *wish = proposed_wish(supervisor->map, request);
	const uint32_t base = wish->base, proposed = wish->proposed;
	char user[WEB_USER_SIZE];
	enum proposal_task task;

	if (setup->asked || setup->worker != 0 || supervisor->reload.phase != RELOAD_IDLE ||
	    supervisor->reset_at_ns != 0)
		return PROPOSAL_REFUSE;
	copy_user(wish, user);
	if (user[0] == '\0' ||
	    (request->detail == SETUP_CHECK && !proposal_begins(&setup->pace, map_now_ns())))
		return PROPOSAL_REFUSE;
	task = proposal_ask(&setup->proposal, (enum setup_wish)request->detail, user, proposed, map_now_ns());
	if (task == PROPOSAL_REFUSE)
		return task;
	if (task == PROPOSAL_CHECK)
		setup->base = base;
	if (task == PROPOSAL_GO_BACK)
		map_log(supervisor->map, MAP_LOG_INFO, "set-up: %s asks for the former configuration", user);
	setup->asked = true;
	setup->request = *request;
	return task;
}

void setup_take(struct supervisor *supervisor, const struct map_request *request)
{
	enum proposal_task task = PROPOSAL_REFUSE;

	if (!is_of_a_page(supervisor, request)) {
		map_request_answer(supervisor->map, request, MAP_RESULT_NOT_COMMANDABLE);
		return;
	}
	if (request->detail == SETUP_SHOW) {
		if (!start_worker(supervisor, request))
			map_request_answer(supervisor->map, request, MAP_RESULT_INTERLOCK);
		return;
	}
	task = begin(supervisor, request);
	if (task == PROPOSAL_REFUSE)
		map_request_answer(supervisor->map, request, MAP_RESULT_INTERLOCK);
	else
		tell(supervisor);
	perform(supervisor, task);
}

/* ---- from rtud's loop --------------------------------------------------------------------------- */

bool setup_begin(struct supervisor *supervisor, uint32_t text)
{
	struct setup *setup = &supervisor->setup;

	setup->in_force = text;
	setup->told =
	    mmap(NULL, sizeof(*setup->told), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	return setup->told != MAP_FAILED;
}

/* A file that is right has come into force: nothing has to come back. */
static void take_replacement(struct supervisor *supervisor)
{
	struct setup *setup = &supervisor->setup;

	if (setup->replaced && setup->proposal.phase == PROPOSAL_STUCK) {
		setup->proposal = (struct proposal){.phase = PROPOSAL_NONE};
		tell(supervisor);
	}
	setup->replaced = false;
}

void setup_step(struct supervisor *supervisor)
{
	struct setup *setup = &supervisor->setup;

	if (setup->worker != 0 && map_now_ns() > setup->deadline_ns)
		kill(setup->worker, SIGKILL);
	if (setup->reloaded != SETUP_NO_JOB) {
		setup->reloaded = SETUP_NO_JOB;
		ended(supervisor, setup->reloaded_well);
	}
	take_replacement(supervisor);
	if (supervisor->reload.phase == RELOAD_IDLE && supervisor->reset_at_ns == 0) {
		const enum proposal_task task = proposal_wait(&setup->proposal, map_now_ns());

		if (task != PROPOSAL_NOTHING)
			tell(supervisor);
		perform(supervisor, task);
	}
}

static bool is_same(const struct history_text *a, const struct history_text *b)
{
	return a->length == b->length && memcmp(a->octets, b->octets, a->length) == 0;
}

/* One that was killed may have written it all the same. */
static bool is_kept(const struct supervisor *supervisor)
{
	struct history_text text, proposed;
	char path[PATH_MAX];
	bool kept = false;

	if (!history_read(proposed_target(supervisor->options), &text))
		return false;
	proposed_path(supervisor, PROPOSED_FILE, path);
	if (history_read(path, &proposed)) {
		kept = is_same(&text, &proposed);
		free(proposed.octets);
	}
	free(text.octets);
	return kept;
}

bool setup_reap(struct supervisor *supervisor, pid_t pid, int status)
{
	struct setup *setup = &supervisor->setup;
	const bool good = WIFEXITED(status) && WEXITSTATUS(status) == EXIT_SUCCESS;
	const struct map_request shown = setup->shown;

	if (setup->worker == 0 || pid != setup->worker)
		return false;
	setup->worker = 0;
	if (shown.requester != 0) {
		proposal_rests(&setup->pace, map_now_ns());
		map_request_answer(supervisor->map, &shown, good ? MAP_RESULT_DONE : MAP_RESULT_OUT_OF_RANGE);
	} else {
		ended(supervisor, good || is_kept(supervisor));
	}
	return true;
}
