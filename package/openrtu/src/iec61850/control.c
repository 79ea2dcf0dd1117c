/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/control.h"

#include <stdio.h>
#include <string.h>

#include "iec61850/tags.h"
#include "iec61850/value.h"

/* No command begins after its deadline; a device, its read-back and the end of a pulse take less than this. */
#define LONGEST_NS (60 * NS_PER_S)

/* Tags of the PDUs (ISO 9506-2, clauses 7 and 14). */
enum {
	CONFIRMED_RESPONSE = 0xa1,
	READ = 0xa4,
	WRITE = 0xa5,
	FAILURE = 0x80,
	SUCCESS = 0x81,
	VARIABLE_NAME = 0xa0,
	DOMAIN_SPECIFIC = 0xa1,
};

/* AddCause (IEC 61850-7-2, table 54; 8-1, table 103). */
enum add_cause {
	NOT_SUPPORTED = 1,
	BLOCKED_BY_MODE = 8,
	BLOCKED_BY_PROCESS = 9,
	ALREADY_IN_EXECUTION = 12,
	BLOCKED_BY_HEALTH = 13,
	TIME_LIMIT_OVER = 16,
	NOT_SELECTED = 18,
	NO_ACCESS_AUTHORITY = 20,
	COMMUNICATION_LOSS = 23,
	NO_CAUSE = 25,
	INCONSISTENT_PARAMETERS = 26,
	LOCKED_BY_OTHER_CLIENT = 27
};
/* Error of LastApplError (8-1, 20.6). */
enum { UNKNOWN_ERROR = 1, TIMEOUT_TEST_NOT_OK = 2 };

/* What is to be said of a command. */
enum { OWES_ERROR = 1, OWES_ANSWER = 2, OWES_TERMINATION = 4 };

/* ---- records ----------------------------------------------------------------------------- */

/* Whether its client waits for it, or has selected it. */
static bool is_live(const struct iec61850_control *control)
{
	return control->phase != IEC61850_CONTROL_OVER && control->phase != IEC61850_ORPHANED;
}

static bool is_free(const struct iec61850_control *control)
{
	return control->phase == IEC61850_CONTROL_OVER && control->owes == 0;
}

/* The client's command of a point that has not ended. NULL: there is none. */
static struct iec61850_control *find_live(struct iec61850_server *server, uint32_t point)
{
	for (unsigned i = 0; i < server->control_count; i++)
		if (server->controls[i].client == server->client && is_live(&server->controls[i]) &&
		    server->controls[i].request.point == point)
			return &server->controls[i];
	return NULL;
}

/* NULL: this client, or all together, have as many as there may be. */
static struct iec61850_control *find_free(struct iec61850_server *server)
{
	struct iec61850_control *found = NULL;
	unsigned own = 0;

	for (unsigned i = 0; i < server->control_count; i++) {
		if (is_free(&server->controls[i]))
			found = &server->controls[i];
		else if (server->controls[i].client == server->client)
			own++;
	}
	if (own == IEC61850_CONTROLS_EACH)
		return NULL;
	if (found == NULL && server->control_count < IEC61850_CONTROLS)
		found = &server->controls[server->control_count++];
	return found;
}

static bool is_enhanced(const struct iec61850_server *server, const struct iec61850_control *control)
{
	const enum iec61850_ctl_kind model = iec61850_ctl_model(&server->model, control->request.point);

	return model == IEC61850_DIRECT_ENHANCED || model == IEC61850_SBO_ENHANCED;
}

/* The service that is to be answered reads SBO. All others are written. */
static bool is_read(const struct iec61850_control *control)
{
	return control->object.node->leaf == IEC61850_SBO;
}

static void owe(struct iec61850_control *control, unsigned what)
{
	control->owes = control->client != NULL ? (uint8_t)(control->owes | what) : 0;
}

/* ---- the map's side ---------------------------------------------------------------------- */

/* Back to inactive: the owner sees to it that only who was last served can do that, and that nothing under way is touched. */
static bool release(struct iec61850_server *server, const struct iec61850_control *control)
{
	struct map_request request = control->request;

	request.action = MAP_RELEASE;
	return map_request_post(server->map, request) != 0;
}

static void refuse(struct iec61850_server *server, struct iec61850_control *control, enum add_cause cause)
{
	const bool told = control->phase == IEC61850_EXECUTING;

	control->phase = IEC61850_CONTROL_OVER;
	control->cause = (uint8_t)cause;
	iec61850_count(server, IEC61850_COUNT_COMMANDS_REFUSED);
	if (!told) /* a Read of SBO is answered by an empty name */
		owe(control, is_read(control) ? OWES_ANSWER : OWES_ERROR | OWES_ANSWER);
	else if (is_enhanced(server, control))
		owe(control, OWES_TERMINATION);
}

static void post(struct iec61850_server *server, struct iec61850_control *control, enum map_action action,
		 enum iec61850_phase phase)
{
	struct map_module owner;

	map_module(server->map, map_owner(server->map, control->request.point), &owner);
	control->generation = owner.generation;
	control->phase = (uint8_t)phase;
	control->request.action = (uint8_t)action;
	control->request.time_ns = server->now_ns;
	control->request.deadline_ns = server->now_ns + map_command_timeout_s(server->map) * NS_PER_S;
	control->request.id = map_request_post(server->map, control->request);
	if (control->request.id == 0)
		refuse(server, control, BLOCKED_BY_HEALTH);
}

/* Who has the point: it is under way, or another's. */
static enum add_cause interlock_of(const struct iec61850_server *server, uint32_t point)
{
	struct map_command command;

	return map_command_read(server->map, point, &command) && command.state == MAP_ACCEPTED_SELECTION
		   ? LOCKED_BY_OTHER_CLIENT
		   : ALREADY_IN_EXECUTION;
}

static enum add_cause cause_of(const struct iec61850_server *server, const struct map_answer *answer,
			       uint32_t point)
{
	switch ((enum map_command_result)answer->result) {
	case MAP_RESULT_EXCEPTION:
		return BLOCKED_BY_PROCESS;
	case MAP_RESULT_TIMEOUT:
	case MAP_RESULT_TOO_OLD:
		return TIME_LIMIT_OVER;
	case MAP_RESULT_NOT_SELECTED:
		return NOT_SELECTED;
	case MAP_RESULT_INTERLOCK:
		return interlock_of(server, point);
	case MAP_RESULT_OUT_OF_RANGE:
	case MAP_RESULT_NOT_COMMANDABLE:
		return NOT_SUPPORTED;
	case MAP_RESULT_UNKNOWN_FATE:
	case MAP_RESULT_SENT:
		return COMMUNICATION_LOSS;
	case MAP_RESULT_NO_SCALE:
		return BLOCKED_BY_HEALTH;
	case MAP_RESULT_NONE:
	case MAP_RESULT_DONE:
		break;
	}
	return NO_CAUSE;
}

static void accept(struct iec61850_control *control)
{
	control->accepted = true;
	owe(control, OWES_ANSWER);
}

/* The device has confirmed it. */
static void confirm(struct iec61850_control *control)
{
	if (control->phase != IEC61850_OPERATING)
		return;
	control->phase = IEC61850_EXECUTING;
	accept(control);
}

static void accept_selection(struct iec61850_server *server, struct iec61850_control *control)
{
	if (control->client == NULL) { /* it went meanwhile */
		control->phase = IEC61850_CONTROL_OVER;
		release(server, control);
	} else if (control->phase != IEC61850_SELECTING && control->phase != IEC61850_RESELECTING) {
		refuse(server, control, NO_CAUSE); /* an owner gone wild */
	} else if (control->phase == IEC61850_RESELECTING) {
		post(server, control, MAP_EXECUTE, IEC61850_OPERATING);
	} else {
		control->phase = IEC61850_SELECTED;
		accept(control);
	}
}

static void complete(struct iec61850_server *server, struct iec61850_control *control)
{
	if (is_enhanced(server, control))
		owe(control, OWES_TERMINATION);
	control->phase = IEC61850_CONTROL_OVER;
}

static void conclude(struct iec61850_server *server, struct iec61850_control *control,
		     const struct map_answer *answer)
{
	switch (answer->state) {
	case MAP_EXECUTED_COMMAND:
		confirm(control);                           /* that and the end may be told at once */
		if (control->phase != IEC61850_EXECUTING) { /* an owner gone wild */
			refuse(server, control, NO_CAUSE);
			break;
		}
		complete(server, control);
		break;
	case MAP_INTERRUPTED_SELECTION:
		if (control->phase != IEC61850_CANCELLING) {
			refuse(server, control, NO_CAUSE);
			break;
		}
		control->phase = IEC61850_CONTROL_OVER;
		accept(control);
		break;
	default:
		refuse(server, control, cause_of(server, answer, control->request.point));
	}
	release(server, control);
}

void iec61850_control_answer(struct iec61850_server *server, const struct map_answer *answer)
{
	for (unsigned i = 0; i < server->control_count; i++) {
		struct iec61850_control *control = &server->controls[i];

		if (!is_live(control) || control->phase == IEC61850_SELECTED ||
		    control->request.id != answer->id)
			continue;
		if (answer->state == MAP_ACCEPTED_SELECTION)
			accept_selection(server, control);
		else if (answer->state != MAP_EXECUTING)
			conclude(server, control, answer);
		else if (answer->result == MAP_RESULT_DONE)
			confirm(control);
		return;
	}
}

static bool owner_has_ended(const struct iec61850_server *server, const struct iec61850_control *control)
{
	struct map_module owner;

	map_module(server->map, map_owner(server->map, control->request.point), &owner);
	return owner.state == MAP_MODULE_DOWN || owner.state == MAP_MODULE_STOPPED ||
	       owner.generation != control->generation;
}

/* The map's own word on a selection: it ends by itself. */
static bool selection_is_over(const struct iec61850_server *server, const struct iec61850_control *control)
{
	struct map_command command;

	return map_command_read(server->map, control->request.point, &command) &&
	       (command.state != MAP_ACCEPTED_SELECTION || command.requester != map_self(server->map) ||
		command.session != control->request.session);
}

static void look_after(struct iec61850_server *server, struct iec61850_control *control)
{
	if (control->phase == IEC61850_ORPHANED) {
		if (release(server, control))
			control->phase = IEC61850_CONTROL_OVER;
		return;
	}
	if (control->phase == IEC61850_SELECTED) {
		if (selection_is_over(server, control) && !(control->owes & OWES_ANSWER))
			control->phase = IEC61850_CONTROL_OVER;
		return;
	}
	if (!owner_has_ended(server, control) && server->now_ns <= control->request.deadline_ns + LONGEST_NS)
		return;
	/* What the device has confirmed is done. Else its fate is unknown: negative, and not repeated. */
	if (control->phase == IEC61850_EXECUTING)
		complete(server, control);
	else
		refuse(server, control, COMMUNICATION_LOSS);
	control->phase = IEC61850_ORPHANED;
}

void iec61850_controls_tick(struct iec61850_server *server)
{
	for (unsigned i = 0; i < server->control_count; i++)
		if (server->controls[i].phase != IEC61850_CONTROL_OVER)
			look_after(server, &server->controls[i]);
}

void iec61850_controls_release(struct iec61850_server *server, const void *client)
{
	for (unsigned i = 0; i < server->control_count; i++) {
		struct iec61850_control *control = &server->controls[i];

		if (control->client != client)
			continue;
		control->client = NULL;
		control->owes = 0;
		if (control->phase != IEC61850_SELECTED)
			continue;
		control->phase = IEC61850_CONTROL_OVER;
		release(server, control);
	}
}

/* ---- the client's side ------------------------------------------------------------------- */

/* What a service is refused for before the map is asked; 0: nothing. selected: its client's command, or NULL. */
static unsigned objection(const struct iec61850_server *server, const struct iec61850_wish *wish,
			  const struct iec61850_control *selected)
{
	if (!server->may_control)
		return NO_ACCESS_AUTHORITY;
	if (selected != NULL && (selected->phase != IEC61850_SELECTED || selected->owes != 0))
		return ALREADY_IN_EXECUTION;
	if (wish->test) /* Mod is on, never test */
		return BLOCKED_BY_MODE;
	return wish->out_of_range ? NOT_SUPPORTED : 0;
}

/* What follows it takes its place at the owner. */
static void forget_orphan(struct iec61850_server *server, uint32_t point)
{
	for (unsigned i = 0; i < server->control_count; i++)
		if (server->controls[i].client == server->client &&
		    server->controls[i].phase == IEC61850_ORPHANED &&
		    server->controls[i].request.point == point)
			server->controls[i].phase = IEC61850_CONTROL_OVER;
}

/* A service that is not the continuation of its client's selection begins a command of its own. */
static struct iec61850_control *begin(struct iec61850_server *server, const struct iec61850_object *object,
				      const struct iec61850_wish *wish)
{
	struct iec61850_control *control;

	forget_orphan(server, iec61850_point_of(&server->model, object));
	control = find_free(server);
	if (control == NULL)
		return NULL;
	*control = (struct iec61850_control){.client = server->client,
					     .invoke_id = server->invoke_id,
					     .object = *object,
					     .wish = *wish,
					     .request = {.point = iec61850_point_of(&server->model, object),
							 .value = wish->value,
							 .session = server->session}};
	return control;
}

static void go_on(struct iec61850_server *server, struct iec61850_control *control,
		  const struct iec61850_object *object, const struct iec61850_wish *wish)
{
	control->invoke_id = server->invoke_id;
	control->object = *object;
	control->wish = *wish;
	control->request.value = wish->value;
	control->accepted = false;
	control->cause = 0;
}

/* An execution that is not what was selected ends the selection (7-2, 20.2.2). */
static bool is_as_selected(const struct iec61850_server *server, const struct iec61850_control *control,
			   const struct iec61850_wish *wish)
{
	return iec61850_ctl_model(&server->model, control->request.point) == IEC61850_SBO_NORMAL ||
	       iec61850_wish_is_same(&control->wish, wish);
}

static void operate(struct iec61850_server *server, struct iec61850_control *control,
		    const struct iec61850_object *object, const struct iec61850_wish *wish)
{
	const bool selected = control->phase == IEC61850_SELECTED;
	const bool same = !selected || is_as_selected(server, control, wish);

	go_on(server, control, object, wish);
	iec61850_count(server, IEC61850_COUNT_COMMANDS);
	if (!same) {
		release(server, control);
		control->phase = IEC61850_CONTROL_OVER;
		refuse(server, control, INCONSISTENT_PARAMETERS);
	} else if (selected &&
		   iec61850_ctl_model(&server->model, control->request.point) == IEC61850_SBO_NORMAL) {
		post(server, control, MAP_SELECT, IEC61850_RESELECTING); /* now it has a value */
	} else {
		post(server, control, MAP_EXECUTE, IEC61850_OPERATING);
	}
}

static void serve(struct iec61850_server *server, struct iec61850_control *control,
		  const struct iec61850_object *object, const struct iec61850_wish *wish)
{
	switch (object->node->leaf) {
	case IEC61850_OPER:
		operate(server, control, object, wish);
		return;
	case IEC61850_CANCEL:
		if (control->phase != IEC61850_SELECTED) {
			refuse(server, control, NOT_SELECTED);
			return;
		}
		go_on(server, control, object, wish);
		post(server, control, MAP_CANCEL, IEC61850_CANCELLING);
		return;
	default:
		go_on(server, control, object, wish);
		post(server, control, MAP_SELECT, IEC61850_SELECTING);
	}
}

static enum iec61850_error take(struct iec61850_server *server, const struct iec61850_object *object,
				const struct iec61850_wish *wish, int *error)
{
	struct iec61850_control *selected = find_live(server, iec61850_point_of(&server->model, object));
	const unsigned objected = objection(server, wish, selected);
	struct iec61850_control *control =
	    objected != 0 || selected == NULL ? begin(server, object, wish) : selected;

	if (control == NULL) {
		*error = IEC61850_ACCESS_UNAVAILABLE;
		return IEC61850_NO_ERROR;
	}
	if (objected != 0)
		refuse(server, control, (enum add_cause)objected);
	else
		serve(server, control, object, wish);
	return IEC61850_LATER;
}

enum iec61850_error iec61850_control_write(struct iec61850_server *server,
					   const struct iec61850_object *object,
					   const struct ber_element *data, int *error)
{
	const uint32_t point = iec61850_point_of(&server->model, object);
	struct iec61850_wish wish;

	if (point == MAP_NONE || object->node == NULL ||
	    (object->node->leaf != IEC61850_SBOW && object->node->leaf != IEC61850_OPER &&
	     object->node->leaf != IEC61850_CANCEL)) {
		*error = IEC61850_ACCESS_DENIED;
		return IEC61850_NO_ERROR;
	}
	*error = iec61850_wish_read(&server->model.config->points[point], object->node, data, &wish);
	return *error != 0 ? IEC61850_NO_ERROR : take(server, object, &wish, error);
}

/* What to select with as long as nobody has said a value: the one that is there, which the point can hold. */
static union map_value value_of(const struct iec61850_server *server, uint32_t point)
{
	enum { DOUBLE_OFF = 1, DOUBLE_ON = 2 };
	struct map_sample sample = {.quality = MAP_INVALID};
	const uint8_t type = server->model.config->points[point].type;

	if (!map_read(server->map, point, &sample))
		sample.value.u = 0;
	if (type == MAP_DOUBLE && sample.value.u != DOUBLE_ON)
		sample.value.u = DOUBLE_OFF;
	return sample.value;
}

enum iec61850_error iec61850_control_select(struct iec61850_server *server,
					    const struct iec61850_object *object, int *error)
{
	const struct iec61850_wish wish = {.value =
					       value_of(server, iec61850_point_of(&server->model, object))};

	return take(server, object, &wish, error);
}

/* ---- what is said ------------------------------------------------------------------------ */

/* The item that a service is in its logical device. */
static void service_name(const struct iec61850_model *model, const struct iec61850_object *object,
			 char out[IEC61850_REFERENCE_SIZE])
{
	char name[IEC61850_NAME_SIZE];

	iec61850_object_name(model, object, name);
	snprintf(out, IEC61850_REFERENCE_SIZE, "%s$%s", name, object->node->name);
}

static void put_name(struct ber_writer *writer, const struct iec61850_model *model,
		     const struct iec61850_object *object)
{
	char name[IEC61850_NAME_SIZE], service[IEC61850_REFERENCE_SIZE];
	const size_t end = writer->at;

	service_name(model, object, service);
	ber_put_text(writer, BER_VISIBLE_STRING, service);
	iec61850_device_name(model, object->device, name);
	ber_put_text(writer, BER_VISIBLE_STRING, name);
	ber_close(writer, DOMAIN_SPECIFIC, end);
}

static void put_error_value(struct ber_writer *writer, const struct iec61850_model *model,
			    const struct iec61850_control *control)
{
	const size_t end = writer->at;
	char service[IEC61850_REFERENCE_SIZE];
	size_t origin;

	ber_put_integer(writer, IEC61850_TAG_INTEGER, control->cause);
	ber_put_integer(writer, IEC61850_TAG_UNSIGNED, control->wish.number);
	origin = writer->at;
	ber_put(writer, IEC61850_TAG_OCTET_STRING, control->wish.identity, control->wish.identity_size);
	ber_put_integer(writer, IEC61850_TAG_INTEGER, control->wish.category);
	ber_close(writer, IEC61850_TAG_STRUCTURE, origin);
	ber_put_integer(writer, IEC61850_TAG_INTEGER,
			control->cause == TIME_LIMIT_OVER ? TIMEOUT_TEST_NOT_OK : UNKNOWN_ERROR);
	service_name(model, &control->object, service);
	iec61850_put_reference(writer, model, control->object.device, service);
	ber_close(writer, IEC61850_TAG_STRUCTURE, end);
}

static void close_variable(struct ber_writer *writer, size_t end)
{
	ber_close(writer, VARIABLE_NAME, end);
	ber_close(writer, BER_SEQUENCE, end);
}

/* LastApplError, CommandTermination+, or both, which is CommandTermination- (8-1, 20.8 and 20.9). */
static void put_information(struct ber_writer *writer, const struct iec61850_model *model,
			    const struct iec61850_control *control, bool error, bool service)
{
	const size_t end = writer->at;
	size_t names, name;

	if (service)
		ber_put(writer, IEC61850_TAG_STRUCTURE, control->wish.octets, control->wish.octet_count);
	if (error)
		put_error_value(writer, model, control);
	ber_close(writer, IEC61850_TAG_RESULTS, end);
	names = writer->at;
	if (service) {
		put_name(writer, model, &control->object);
		close_variable(writer, names);
	}
	name = writer->at;
	if (error) {
		ber_put_text(writer, IEC61850_TAG_VMD_SPECIFIC, "LastApplError");
		close_variable(writer, name);
	}
	ber_close(writer, IEC61850_TAG_VARIABLES, names);
	ber_close(writer, IEC61850_TAG_INFORMATION_REPORT, end);
	ber_close(writer, IEC61850_TAG_UNCONFIRMED, end);
}

/* The answer to a Read of SBO: the name of what is selected, or nothing (7-2, 20.3.2). */
static void put_selected(struct ber_writer *writer, const struct iec61850_model *model,
			 const struct iec61850_control *control)
{
	const size_t end = writer->at;
	char name[IEC61850_NAME_SIZE];

	iec61850_object_name(model, &control->object, name);
	if (control->accepted)
		iec61850_put_reference(writer, model, control->object.device, name);
	else
		ber_put(writer, IEC61850_TAG_VISIBLE_STRING, NULL, 0);
	ber_close(writer, 0xa1, end);
	ber_close(writer, READ, end);
}

static void put_answer(struct ber_writer *writer, const struct iec61850_model *model,
		       const struct iec61850_control *control)
{
	const size_t end = writer->at;

	if (is_read(control)) {
		put_selected(writer, model, control);
	} else {
		if (control->accepted)
			ber_put(writer, SUCCESS, NULL, 0);
		else
			ber_put_integer(writer, FAILURE, IEC61850_ACCESS_DENIED);
		ber_close(writer, WRITE, end);
	}
	ber_put_integer(writer, BER_INTEGER, control->invoke_id);
	ber_close(writer, CONFIRMED_RESPONSE, end);
}

/* In their order: why it is refused, that it is, how it ended. */
static void put_next(struct iec61850_server *server, struct ber_writer *writer,
		     struct iec61850_control *control)
{
	if (control->owes & OWES_ERROR) {
		control->owes &= (uint8_t)~OWES_ERROR;
		put_information(writer, &server->model, control, true, false);
	} else if (control->owes & OWES_ANSWER) {
		control->owes &= (uint8_t)~OWES_ANSWER;
		put_answer(writer, &server->model, control);
	} else {
		control->owes = 0;
		put_information(writer, &server->model, control, control->cause != 0, true);
	}
}

bool iec61850_control_put(struct iec61850_server *server, struct ber_writer *writer, bool ends)
{
	for (unsigned i = 0; i < server->control_count; i++) {
		struct iec61850_control *control = &server->controls[i];

		if (control->client != server->client || control->owes == 0 ||
		    (control->owes == OWES_TERMINATION && !ends))
			continue;
		put_next(server, writer, control);
		return true;
	}
	return false;
}
