/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec104m/outstation.h"

#include <inttypes.h>
#include <stdlib.h>

#include "map/time_ns.h"

#define POLLS_A_SET 3                 /* clock, interrogation, counters */
#define FULL_NS     (100 * NS_PER_MS) /* until a poll is tried again that could not be sent */
#define CLOCK_NS    NS_PER_S          /* until the outstation's clock can be set, since ours is not */

/* ---- what it says ------------------------------------------------------------------------ */

static struct values_moment moment_of(const struct outstation *outstation)
{
	const int64_t now_ns = outstation->now.monotonic_ns;

	return (struct values_moment){.now_ns = now_ns,
				      .asked_ns = outstation->poll != 0 ? outstation->asked_ns : now_ns,
				      .clock = outstation->clock};
}

/*
 * An event of before what is known: the station had kept it, or its clock is behind and it is news. An interrogation says what
 * is true, and is an event behind this one.
 */
static void doubt(struct outstation *outstation, uint16_t ca)
{
	iec104_polls_doubt(outstation->polls, outstation->poll_count, ca, outstation->now.monotonic_ns);
	if (!outstation->doubted &&
	    map_repeats_happened(&outstation->doubts, 1, outstation->now.monotonic_ns) > 0)
		map_log(outstation->map, MAP_LOG_INFO,
			"%s: CA %" PRIu16 " tells events of before its last interrogation: they go on, its "
			"points stay, and it is interrogated again",
			outstation->config->name, ca);
	outstation->doubted = true;
}

static void on_information(void *context, const struct iec104_asdu *asdu,
			   const struct iec104_information *information)
{
	struct outstation *outstation = context;
	const struct values_entry *entry = values_find(&outstation->values, asdu->ca, information->ioa);
	const struct values_moment moment = moment_of(outstation);
	enum map_cause cause = MAP_SPONTANEOUS;

	if (asdu->test || asdu->negative)
		return;
	if (information->content == IEC104_INITIALISATION) {
		iec104_polls_renew(outstation->polls, outstation->poll_count, asdu->ca,
				   outstation->now.monotonic_ns);
		return;
	}
	if (entry != NULL)
		cause = commands_cause(&outstation->commands, entry->point, asdu->cause);
	if (!values_take(&outstation->values, asdu, information, cause, &moment))
		doubt(outstation, asdu->ca);
}

static void on_position(void *context, const struct iec104_asdu *asdu, uint32_t ioa,
			const struct iec104_geoposition *position)
{
	struct outstation *outstation = context;
	const struct values_moment moment = moment_of(outstation);

	if (!asdu->test && !asdu->negative &&
	    !values_take_position(&outstation->values, asdu, ioa, position, &moment))
		doubt(outstation, asdu->ca);
}

/* Its failure is said once, until one succeeds or there is data transfer again. */
static void end_poll(struct outstation *outstation, const struct iec104_controlling_request *request)
{
	const bool done = request->state == MAP_EXECUTED_COMMAND;

	outstation->poll = 0;
	if (!done)
		iec104_polls_failed(outstation->polls, outstation->poll_count, request,
				    outstation->now.monotonic_ns);
	if (request->type != IEC104_C_IC_NA_1)
		return;
	if (!done && !outstation->unanswered &&
	    map_repeats_happened(&outstation->refusals, 1, outstation->now.monotonic_ns) > 0)
		map_log(outstation->map, MAP_LOG_WARNING,
			"%s: CA %" PRIu16 " %s the general interrogation, which is repeated",
			outstation->config->name, request->ca,
			request->result == MAP_RESULT_EXCEPTION ? "refuses" : "does not answer");
	outstation->unanswered = !done;
}

static void on_progress(void *context, const struct iec104_controlling_request *request)
{
	struct outstation *outstation = context;

	values_publish(&outstation->values); /* what came before a command's end is seen before it */
	if (request->id != outstation->poll)
		commands_progress(&outstation->commands, &outstation->active->controlling, request,
				  outstation->now);
	else if (iec104_controlling_has_ended(request->state))
		end_poll(outstation, request);
}

static void on_looked_at(void *context, const struct iec104_asdu *asdu)
{
	struct outstation *outstation = context;

	(void)asdu;
	values_publish(&outstation->values);
}

/* ---- what it is asked -------------------------------------------------------------------- */

static void add_poll(struct outstation *outstation, enum iec104_poll_kind kind, uint16_t ca, bool at_start,
		     uint32_t period_s)
{
	if (at_start || period_s > 0)
		outstation->polls[outstation->poll_count++] = (struct iec104_poll){
		    .kind = (uint8_t)kind, .at_start = at_start, .ca = ca, .period_ns = period_s * NS_PER_S};
}

static void add_reads(struct outstation *outstation, const struct iec104_outstation_set *set)
{
	const struct map_config *config = map_config(outstation->map);
	const struct iec104_outstation_point *points = iec104_outstation_points(config) + set->first_point;

	for (uint32_t i = 0; i < config->sets[set->set].point_count; i++)
		if (points[i].read_ms > 0)
			outstation->polls[outstation->poll_count++] =
			    (struct iec104_poll){.kind = IEC104_POLL_READ,
						 .ca = set->ca,
						 .ioa = points[i].ioa,
						 .period_ns = points[i].read_ms * NS_PER_MS};
}

static uint32_t count_polls(const struct outstation *outstation)
{
	const struct map_config *config = map_config(outstation->map);
	const struct iec104_outstation_set *sets =
	    iec104_outstation_sets(config) + outstation->config->first_set;
	uint32_t polls = POLLS_A_SET * outstation->config->set_count;

	for (uint32_t i = 0; i < outstation->config->set_count; i++)
		polls += config->sets[sets[i].set].point_count;
	return polls;
}

static void plan_polls(struct outstation *outstation)
{
	const struct iec104_outstation *config = outstation->config;
	const struct iec104_outstation_set *sets =
	    iec104_outstation_sets(map_config(outstation->map)) + config->first_set;

	for (uint32_t i = 0; i < config->set_count; i++)
		add_poll(outstation, IEC104_POLL_CLOCK, sets[i].ca, config->clock_s > 0, config->clock_s);
	for (uint32_t i = 0; i < config->set_count; i++)
		add_poll(outstation, IEC104_POLL_INTERROGATION, sets[i].ca, config->interrogates,
			 config->interrogation_s);
	for (uint32_t i = 0; i < config->set_count; i++)
		add_poll(outstation, IEC104_POLL_COUNTERS, sets[i].ca, config->counters_s > 0,
			 config->counters_s);
	for (uint32_t i = 0; i < config->set_count; i++)
		add_reads(outstation, &sets[i]);
}

static bool is_started(const struct outstation *outstation)
{
	return outstation->active != NULL && outstation->active->state == LINK_STARTED;
}

static int64_t poll_due(const struct outstation *outstation)
{
	const struct iec104_poll *poll = iec104_polls_next(outstation->polls, outstation->poll_count);

	if (!is_started(outstation) || outstation->poll != 0 || poll == NULL)
		return INT64_MAX;
	return later(poll->due_ns, outstation->poll_ns);
}

static void ask_next(struct outstation *outstation)
{
	const int64_t now_ns = outstation->now.monotonic_ns;
	struct iec104_poll *poll;

	if (now_ns < poll_due(outstation))
		return;
	poll = iec104_polls_next(outstation->polls, outstation->poll_count);
	if (poll->kind == IEC104_POLL_CLOCK && !outstation->clock.set) { /* ours is no better than its own */
		poll->due_ns = now_ns + CLOCK_NS;
		return;
	}
	outstation->poll = iec104_poll_post(poll, &outstation->active->controlling, outstation->now);
	outstation->asked_ns = now_ns;
	if (outstation->poll != 0)
		iec104_poll_put_off(poll, now_ns);
	else
		outstation->poll_ns = now_ns + FULL_NS;
}

/* ---- links ------------------------------------------------------------------------------- */

static unsigned number_of(const struct outstation *outstation, const struct link *link)
{
	return (unsigned)(link - outstation->links) + 1;
}

static void say_use(const struct outstation *outstation, const struct link *link, const char *again)
{
	map_log(outstation->map, MAP_LOG_INFO, "%s: %s %s%s", outstation->config->name,
		link == outstation->active ? "data transfer on" : "standing by on", link->address, again);
}

/* One that failed has data transfer, or has stood by for some time. */
static void note_use(const struct outstation *outstation, struct link *link)
{
	const int64_t now_ns = outstation->now.monotonic_ns;
	char text[MAP_TROUBLE_SIZE];

	if (link->state != LINK_STARTED &&
	    !(link->state == LINK_OPEN && retry_has_lasted(&link->attempts.retry, now_ns)))
		return;
	if (map_trouble_well(&link->attempts.trouble, now_ns))
		say_use(outstation, link, map_trouble_ended(&link->attempts.trouble, now_ns, text));
}

static void note_start(struct outstation *outstation)
{
	const struct link *link = outstation->active;

	if (!link->attempts.trouble.is)
		say_use(outstation, link, "");
	outstation->valid = true;
	outstation->taken_over = false;
	outstation->unanswered = false;
	outstation->doubted = false;
	outstation->valid_until_ns = INT64_MAX;
	outstation->poll = 0;
	outstation->poll_ns = 0;
	iec104_polls_begin(outstation->polls, outstation->poll_count, outstation->now.monotonic_ns);
	atomic_store(&outstation->stats->started, number_of(outstation, link));
	map_count(&outstation->stats->starts, 1);
}

static void say_failure(const struct outstation *outstation, const struct link *link)
{
	char text[ATTEMPTS_TEXT_SIZE];

	if (link->to_be_said)
		map_log(outstation->map, MAP_LOG_WARNING, "%s: %s %s%s", outstation->config->name,
			link->address, link->reason,
			attempts_failure(&link->attempts, outstation->now.monotonic_ns, text));
}

static void invalidate(struct outstation *outstation)
{
	outstation->valid = outstation->taken_over = false;
	outstation->valid_until_ns = INT64_MAX;
	values_invalidate(&outstation->values, outstation->now.monotonic_ns);
	if (map_repeats_happened(&outstation->invalid, 1, outstation->now.monotonic_ns) > 0)
		map_log(outstation->map, MAP_LOG_WARNING, "%s: its points are invalid",
			outstation->config->name);
}

/* The points stay as they are while another link takes over, for t1 at most. */
static void lose(struct outstation *outstation, struct link *link)
{
	const int64_t now_ns = outstation->now.monotonic_ns;

	say_failure(outstation, link);
	map_count(&outstation->stats->failures, 1);
	if (link != outstation->active)
		return;
	outstation->active = NULL;
	outstation->poll = 0;
	atomic_store(&outstation->stats->started, 0);
	if (outstation->valid && outstation->valid_until_ns == INT64_MAX)
		outstation->valid_until_ns = now_ns + outstation->config->t1_s * NS_PER_S;
}

static void run_link(struct outstation *outstation, struct link *link)
{
	const uint32_t failures = link->failures;
	const enum link_state before = link->state;
	const uint32_t unknown = link->controlling.unknown_types;

	link_run(link, outstation->now);
	if (before >= LINK_OPEN)
		map_count(&outstation->stats->unknown, link->controlling.unknown_types - unknown);
	if (before != LINK_STARTED && link->state == LINK_STARTED)
		note_start(outstation);
	note_use(outstation, link);
	if (link->failures != failures)
		lose(outstation, link);
}

/* The first that is open, the preferred one before the other. */
static void choose_link(struct outstation *outstation)
{
	for (unsigned i = 0; i < outstation->config->address_count && outstation->active == NULL; i++) {
		struct link *link = &outstation->links[i];

		if (link->state != LINK_OPEN)
			continue;
		outstation->active = link;
		link_start(link, outstation->now);
	}
	if (outstation->valid && !is_started(outstation) &&
	    ((outstation->active == NULL && !outstation->taken_over) ||
	     outstation->now.monotonic_ns >= outstation->valid_until_ns))
		invalidate(outstation);
}

void outstation_run(struct outstation *outstation, int64_t now_ns)
{
	outstation->clock = map_clock_read(outstation->map);
	outstation->now = (struct iec104_moment){now_ns, map_wall_ns(outstation->clock, now_ns)};
	for (unsigned i = 0; i < outstation->config->address_count; i++)
		run_link(outstation, &outstation->links[i]);
	choose_link(outstation);
	ask_next(outstation);
	if (outstation->active != NULL)
		run_link(outstation, outstation->active); /* what was asked goes out */
}

int64_t outstation_deadline(const struct outstation *outstation)
{
	int64_t deadline_ns = earlier(poll_due(outstation), outstation->valid_until_ns);

	for (unsigned i = 0; i < outstation->config->address_count; i++)
		deadline_ns = earlier(deadline_ns, link_deadline(&outstation->links[i]));
	return deadline_ns;
}

/* ---- commands ---------------------------------------------------------------------------- */

bool outstation_has(const struct outstation *outstation, uint16_t set)
{
	const struct iec104_outstation_set *sets =
	    iec104_outstation_sets(map_config(outstation->map)) + outstation->config->first_set;

	for (uint32_t i = 0; i < outstation->config->set_count; i++)
		if (sets[i].set == set)
			return true;
	return false;
}

void outstation_execute(struct outstation *outstation, const struct map_request *request, int64_t now_ns)
{
	outstation->now.monotonic_ns = now_ns;
	commands_execute(&outstation->commands,
			 is_started(outstation) ? &outstation->active->controlling : NULL, request,
			 outstation->now);
}

/* ---- start ------------------------------------------------------------------------------- */

static void set_up(struct outstation *outstation)
{
	const struct iec104_outstation *config = outstation->config;

	outstation->settings = (struct iec104_controlling_settings){
	    .times = {.k = config->k,
		      .w = config->w,
		      .t1_ns = config->t1_s * NS_PER_S,
		      .t2_ns = config->t2_s * NS_PER_S,
		      .t3_ns = config->t3_s * NS_PER_S},
	    .zone = config->zone,
	    .originator = config->originator,
	    .position_type = config->position_type,
	    .requests_max = IEC104_CONTROLLING_REQUESTS_MAX,
	    .confirmation_ns = config->confirmation_ms * NS_PER_MS,
	    .selection_ns = config->confirmation_ms * NS_PER_MS,
	    .termination_ns = config->terminates ? config->termination_ms * NS_PER_MS : 0,
	    .interrogation_ns = config->interrogation_ms * NS_PER_MS,
	};
	outstation->listener = (struct iec104_controlling_listener){.context = outstation,
								    .information = on_information,
								    .position = on_position,
								    .progress = on_progress,
								    .looked_at = on_looked_at};
}

bool outstation_init(struct outstation *outstation, struct map *map, const struct iec104_outstation *config,
		     struct iec104_outstation_stats *stats, int64_t now_ns)
{
	bool good;

	*outstation =
	    (struct outstation){.map = map, .config = config, .stats = stats, .valid_until_ns = INT64_MAX};
	set_up(outstation);
	outstation->polls = calloc(count_polls(outstation), sizeof(*outstation->polls));
	good = outstation->polls != NULL && values_init(&outstation->values, map, config, stats);
	for (unsigned i = 0; good && i < config->address_count; i++)
		good =
		    link_init(&outstation->links[i], config, i, &outstation->settings, &outstation->listener);
	if (!good)
		return false;
	plan_polls(outstation);
	if (values_hold(&outstation->values)) {
		outstation->valid = outstation->taken_over = true;
		outstation->valid_until_ns = now_ns + config->t1_s * NS_PER_S;
	}
	commands_init(&outstation->commands, map, &outstation->values, stats);
	return true;
}

void outstation_free(struct outstation *outstation)
{
	for (unsigned i = 0; i < outstation->config->address_count; i++)
		link_close(&outstation->links[i]);
	values_free(&outstation->values);
	free(outstation->polls);
}
