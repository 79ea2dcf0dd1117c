/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/web/commands.h"

#include <string.h>

#include "map/time_ns.h"
#include "rows/words.h"

#define ORDERS_MAX 32
#define MARGIN_MS  4000 /* the device's answer may come just before the deadline, its read-back 3 s later */

/* What was ordered, until another one needs its place. */
struct order {
	uint32_t number; /* 0: the place is free */
	uint32_t id;     /* of the request; 0: it has ended */
	uint32_t session, point, generation;
	uint8_t action, state, result, detail;
	int64_t begun_ns, limit_ns;
	char value[WORDS_SIZE];
	char user[WEB_USER_SIZE];
};

static struct order orders[ORDERS_MAX];
static uint32_t last_number;

static const char *const actions[] = {
    [MAP_SELECT] = "select", [MAP_EXECUTE] = "execute", [MAP_CANCEL] = "cancel"};

/* ---- what becomes of them ---------------------------------------------------------------- */

static void name_of(const struct http_site *site, const struct order *order, char name[MAP_NAME_SIZE])
{
	if (order->point < map_config(site->map)->point_count)
		map_point_name(map_config(site->map), &map_config(site->map)->points[order->point], name);
	else
		snprintf(name, MAP_NAME_SIZE, "?");
}

static void end(struct http_site *site, struct order *order, uint8_t state, uint8_t result, uint8_t detail)
{
	char name[MAP_NAME_SIZE];

	order->state = state;
	order->result = result;
	order->detail = detail;
	order->id = 0;
	name_of(site, order, name);
	map_log(site->map,
		result == MAP_RESULT_DONE || result == MAP_RESULT_NONE ? MAP_LOG_INFO : MAP_LOG_WARNING,
		"%s: %s %s = %s: %s: %s", order->user, actions[order->action], name, order->value,
		map_command_state_name(state), map_command_result_name(result));
	/* Whoever looks has seen the last state: the point is free again. */
	if (order->action == MAP_EXECUTE)
		map_request_post(site->map, (struct map_request){.point = order->point,
								 .session = order->session,
								 .action = MAP_RELEASE});
}

/* Negative, as that stage of the command has it. */
static void fail(struct http_site *site, struct order *order, enum map_command_result result)
{
	static const uint8_t states[] = {[MAP_SELECT] = MAP_REFUSED_SELECTION,
					 [MAP_EXECUTE] = MAP_REFUSED_COMMAND,
					 [MAP_CANCEL] = MAP_INTERRUPTED_SELECTION};

	end(site, order, states[order->action], (uint8_t)result, 0);
}

void commands_take_answer(struct http_site *site, const struct map_answer *answer)
{
	for (unsigned i = 0; i < ORDERS_MAX; i++) {
		struct order *order = &orders[i];

		if (order->id == 0 || order->id != answer->id)
			continue;
		if (answer->state == MAP_EXECUTING) {
			order->state = answer->state;
			order->result = answer->result;
		} else {
			end(site, order, answer->state, answer->result, answer->detail);
		}
		return;
	}
}

static bool owner_is_the_same(const struct http_site *site, const struct order *order)
{
	struct map_module module;

	map_module(site->map, map_owner(site->map, order->point), &module);
	return module.alive && module.generation == order->generation;
}

void commands_tick(struct http_site *site)
{
	for (unsigned i = 0; i < ORDERS_MAX; i++) {
		struct order *order = &orders[i];

		if (order->id == 0)
			continue;
		if (!owner_is_the_same(site, order))
			fail(site, order, MAP_RESULT_UNKNOWN_FATE);
		else if (site->now_ns >= order->limit_ns)
			fail(site, order, MAP_RESULT_TIMEOUT);
	}
}

void commands_renew(struct http_site *site, const struct map_config *before)
{
	for (unsigned i = 0; i < ORDERS_MAX; i++) {
		struct order *order = &orders[i];

		if (order->number == 0)
			continue;
		order->point = map_number_now(site->map, before, order->point);
		if (order->point == MAP_NONE)
			*order = (struct order){.number = 0};
	}
}

/* ---- the page's side --------------------------------------------------------------------- */

static struct http_answer show(const struct http_site *site, const struct order *order)
{
	char name[MAP_NAME_SIZE];
	json_t *row;

	name_of(site, order, name);
	row =
	    json_pack("{s:I, s:s, s:s, s:s, s:s, s:s, s:b, s:f}", "number", (json_int_t)order->number,
		      "action", actions[order->action], "name", name, "value", order->value, "state",
		      map_command_state_name(order->state), "result", map_command_result_name(order->result),
		      "ended", order->id == 0, "age_s", (double)(site->now_ns - order->begun_ns) / NS_PER_S);
	if (order->result == MAP_RESULT_EXCEPTION)
		json_object_set_new(row, "exception", json_integer(order->detail));
	return answer_json(MHD_HTTP_OK, row);
}

struct http_answer command_state(struct http_site *site, struct http_request *request)
{
	const uint32_t number = request_number(request, "number", UINT32_MAX, 0);

	for (unsigned i = 0; number != 0 && i < ORDERS_MAX; i++)
		if (orders[i].number == number && orders[i].session == request->session->number)
			return show(site, &orders[i]);
	return answer_refusal(MHD_HTTP_NOT_FOUND, "unknown", "there is no such command of yours");
}

/* A free place, or that of the oldest that has ended. NULL: all wait. */
static struct order *place_of_order(void)
{
	struct order *oldest = NULL;

	for (unsigned i = 0; i < ORDERS_MAX; i++)
		if (orders[i].id == 0 && (oldest == NULL || orders[i].number < oldest->number))
			oldest = &orders[i];
	return oldest;
}

static uint32_t find_point(const struct map_config *config, const char *name)
{
	char known[MAP_NAME_SIZE];

	for (uint32_t i = 0; i < config->point_count; i++) {
		map_point_name(config, &config->points[i], known);
		if (strcmp(known, name) == 0)
			return i;
	}
	return MAP_NONE;
}

static bool find_action(const char *text, uint8_t *action)
{
	for (uint8_t i = MAP_SELECT; i <= MAP_CANCEL; i++)
		if (strcmp(text, actions[i]) == 0) {
			*action = i;
			return true;
		}
	return false;
}

static void post(struct http_site *site, struct order *order, struct map_request request)
{
	const int64_t patience_ns = map_config(site->map)->settings.command_timeout_s * NS_PER_S;
	struct map_module owner;

	map_module(site->map, map_owner(site->map, order->point), &owner);
	order->generation = owner.generation;
	request.time_ns = map_now_ns();
	request.deadline_ns = request.time_ns + patience_ns;
	order->limit_ns = request.deadline_ns + patience_ns + MARGIN_MS * NS_PER_MS;
	order->id = map_request_post(site->map, request);
	map_count(&site->stats->counters[WEB_COUNT_COMMANDS], 1);
	if (order->id == 0) /* nothing was posted: the module does not run */
		fail(site, order, MAP_RESULT_NONE);
}

static struct http_answer begin(struct http_site *site, const struct http_request *request, uint8_t action,
				const char *name, const char *value)
{
	const struct map_config *config = map_config(site->map);
	struct map_request wish = {
	    .point = find_point(config, name), .action = action, .session = request->session->number};
	struct order *order = place_of_order();
	char expected[WORDS_LONG_SIZE];

	if (wish.point == MAP_NONE || !(config->points[wish.point].flags & MAP_POINT_COMMAND))
		return answer_refusal(MHD_HTTP_NOT_FOUND, "unknown", "there is no such command");
	if (!words_parse_point(config, wish.point, value, &wish.value))
		return answer_refusal(MHD_HTTP_BAD_REQUEST, "value",
				      words_expected_of(config, wish.point, expected));
	if (order == NULL)
		return answer_refusal(MHD_HTTP_SERVICE_UNAVAILABLE, "busy", "too many commands wait");
	*order = (struct order){.number = ++last_number,
				.session = wish.session,
				.point = wish.point,
				.action = action,
				.state = action == MAP_SELECT    ? MAP_SELECTION_REQUEST
					 : action == MAP_EXECUTE ? MAP_EXECUTION_REQUEST
								 : MAP_INTERRUPTION_REQUEST,
				.begun_ns = site->now_ns};
	snprintf(order->value, sizeof(order->value), "%s", value);
	snprintf(order->user, sizeof(order->user), "%s", request->session->name);
	post(site, order, wish);
	return show(site, order);
}

struct http_answer command_order(struct http_site *site, struct http_request *request)
{
	json_t *row = json_loadb(request->body, request->size, 0, NULL);
	const char *action, *name, *value;
	struct http_answer answer;
	uint8_t known;

	if (!site->settings->commands)
		answer =
		    answer_refusal(MHD_HTTP_FORBIDDEN, "read_only",
				   "the page is read-only: \"commands\": true in \"web\" lets it command");
	else if (json_unpack(row, "{s:s, s:s, s:s}", "action", &action, "name", &name, "value", &value) < 0 ||
		 !find_action(action, &known))
		answer = answer_refusal(MHD_HTTP_BAD_REQUEST, "form", "expected action, name and value");
	else
		answer = begin(site, request, known, name, value);
	json_decref(row);
	return answer;
}
