/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Commands to the program's own points: the program decides, or the point takes the value as it is. */
#include "logic/value.h"
#include "map/time_ns.h"
#include "modules/logic/host.h"

/* Longer than any COMMAND that a program passes a request on to: no answer of one is taken for that of the next. */
#define PASSED_ON_NS (40 * NS_PER_S)

static enum logic_type type_of(const struct host *host, const struct host_point *point)
{
	return (enum logic_type)host->logic.points[point - host->points].type;
}

static struct host_request *find(const struct host *host, const struct host_point *point)
{
	for (uint16_t i = 0; i < host->logic.head->requests; i++)
		if (host->requests[i].point == point)
			return &host->requests[i];
	return NULL;
}

/* A program's point has no pulses and no steps. */
static bool number_of(const struct host *host, const struct host_point *point,
		      const struct map_request *request, double *number)
{
	return request->pulse_ms == 0 && request->step == 0 &&
	       logic_number(point->type, type_of(host, point), request->value, number);
}

static void begin(struct host *host, const struct map_request *request, int64_t now_ns)
{
	struct host_point *point = points_find(host, request->point);
	struct host_request *decided;
	double number;

	if (point == NULL || !number_of(host, point, request, &number)) {
		map_command_finish(host->map, request->point, MAP_RESULT_OUT_OF_RANGE, 0);
		return;
	}
	decided = find(host, point);
	if (decided != NULL) {
		decided->phase = REQUEST_WAITS;
		decided->confirmed = false;
		decided->request = *request;
		decided->number = number;
		decided->begun_ns = now_ns;
		return;
	}
	map_command_confirm(host->map, request->point); /* before its return information */
	points_set(point, request->value, (uint8_t)map_cause_of(host->map, request));
	points_publish_set(host, point);
	kept_store(host);
	map_command_finish(host->map, request->point, MAP_RESULT_DONE, 0);
}

void requests_take(struct host *host, int64_t now_ns)
{
	struct map_request request;

	while (map_request_next(host->map, &request))
		if (map_command_request(host->map, &request))
			begin(host, &request, now_ns);
}

/* Between two of them a scan sees that there is none, so that the program's blocks begin anew. */
void requests_before(struct host *host)
{
	struct logic *logic = &host->logic;

	for (uint16_t i = 0; i < logic->head->requests; i++) {
		struct host_request *request = &host->requests[i];

		if (request->phase == REQUEST_WAITS && request->seen_none)
			request->phase = REQUEST_ACTIVE;
		request->seen_none = request->phase != REQUEST_ACTIVE;
		logic_tell(logic, logic->requests[i].active, request->phase == REQUEST_ACTIVE);
		logic_tell_number(logic, logic->requests[i].value, request->number);
	}
}

static void confirm(struct host *host, struct host_request *request)
{
	if (!request->confirmed)
		map_command_confirm(host->map, request->point->point);
	request->confirmed = true;
}

/* Before the outputs are published: the confirmation goes before the return information. */
void requests_judge(struct host *host)
{
	for (uint16_t i = 0; i < host->logic.head->requests; i++) {
		struct host_request *request = &host->requests[i];
		uint8_t cause = (uint8_t)map_cause_of(host->map, &request->request);
		enum logic_decision decision = logic_judge(&host->logic, &host->logic.requests[i]).decision;

		if (request->phase != REQUEST_ACTIVE ||
		    (decision != LOGIC_CONFIRMED && decision != LOGIC_EXECUTED))
			continue;
		confirm(host, request);
		if (decision != LOGIC_EXECUTED)
			continue;
		if (host->logic.points[request->point - host->points].written)
			request->point->cause = cause;
		else
			points_set(request->point, request->request.value, cause);
	}
}

static void finish(struct host *host, struct host_request *request, uint8_t result)
{
	char name[MAP_NAME_SIZE];
	const struct map_config *config = map_config(host->map);

	request->phase = REQUEST_NONE;
	if (result != MAP_RESULT_DONE) {
		map_point_name(config, &config->points[request->point->point], name);
		map_log(host->map, MAP_LOG_WARNING, "a command of %s was refused: %s", name,
			map_command_result_name((enum map_command_result)result));
	}
	map_command_finish(host->map, request->point->point, (enum map_command_result)result, 0);
}

/* A program that does not decide. */
static bool is_too_late(const struct host *host, const struct host_request *request,
			const struct logic_request *block, int64_t now_ns)
{
	int64_t patience_ns = map_command_timeout_s(host->map) * NS_PER_S;

	if (host->logic.cells[block->state].i != MAP_INACTIVE)
		patience_ns += PASSED_ON_NS;
	return now_ns > request->begun_ns + patience_ns;
}

void requests_after(struct host *host, int64_t now_ns)
{
	for (uint16_t i = 0; i < host->logic.head->requests; i++) {
		struct host_request *request = &host->requests[i];
		const struct logic_request *block = &host->logic.requests[i];
		struct logic_verdict verdict = logic_judge(&host->logic, block);

		if (request->phase != REQUEST_ACTIVE)
			continue;
		if (verdict.decision == LOGIC_EXECUTED || verdict.decision == LOGIC_REFUSED) {
			finish(host, request, verdict.result);
		} else if (is_too_late(host, request, block, now_ns)) {
			finish(host, request, MAP_RESULT_TIMEOUT);
		}
	}
}
