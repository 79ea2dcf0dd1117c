/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/web/proposals.h"

#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "map/time_ns.h"

#define REPORT_MAX (64u * 1024u)
#define SHOWN_MAX                                                                                            \
	(2u << 20) /* a text with each octet escaped would be longer: its file is none of a person's */
#define PATIENCE_NS (180 * NS_PER_S)

/* The wish that rtud has not answered yet, and what became of the last one. */
static struct {
	uint32_t id; /* 0: none waits */
	uint8_t result;
	int64_t limit_ns;
} asked;
static const struct http_request *uploading; /* whose text comes now; NULL: nobody's */

/* ---- files of rtud's ----------------------------------------------------------------------- */

/* To be freed. NULL: there is none, or it is too long. */
static char *read_file(const struct http_site *site, const char *name, size_t most, size_t *size)
{
	char path[PATH_MAX], *text;
	struct stat status;
	ssize_t got;
	int fd;

	snprintf(path, sizeof(path), "%s/%s", site->map_folder, name);
	fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
	if (fd < 0)
		return NULL;
	text = fstat(fd, &status) == 0 && S_ISREG(status.st_mode) && status.st_size <= (off_t)most
		   ? malloc((size_t)status.st_size + 1)
		   : NULL;
	got = text != NULL ? read(fd, text, (size_t)status.st_size) : 0;
	close(fd);
	if (text == NULL)
		return NULL;
	*size = got > 0 ? (size_t)got : 0;
	text[*size] = '\0';
	return text;
}

static json_t *read_row(const struct http_site *site, const char *name, size_t most)
{
	size_t size = 0;
	char *text = read_file(site, name, most, &size);
	json_t *row = text != NULL ? json_loadb(text, size, 0, NULL) : NULL;

	free(text);
	return row != NULL ? row : json_object();
}

/* ---- what the page sees ---------------------------------------------------------------------- */

static void add_report(const struct http_site *site, json_t *row)
{
	size_t size = 0;
	char *text = read_file(site, SETUP_REPORT, REPORT_MAX, &size);
	json_t *report = text != NULL ? json_string(text) : NULL;

	json_object_set_new(row, "report", report != NULL ? report : json_string(""));
	free(text);
}

struct http_answer setup_state(struct http_site *site, struct http_request *request)
{
	json_t *row = read_row(site, SETUP_STATE, REPORT_MAX);
	const char *user = json_string_value(json_object_get(row, "user"));
	const int64_t until_ns = json_integer_value(json_object_get(row, "until_ns"));
	const double left_s = (double)(until_ns - site->now_ns) / NS_PER_S;

	json_object_del(row, "until_ns");
	if (user == NULL)
		json_object_set_new(row, "phase", json_string("none"));
	json_object_set_new(row, "mine",
			    json_boolean(user != NULL && strcmp(user, request->session->name) == 0));
	json_object_set_new(row, "left_s", json_real(left_s > 0 ? left_s : 0));
	json_object_set_new(row, "waits", json_boolean(asked.id != 0));
	json_object_set_new(row, "good", json_boolean(asked.result == MAP_RESULT_DONE));
	json_object_set_new(
	    row, "refused",
	    json_boolean(asked.result == MAP_RESULT_INTERLOCK || asked.result == MAP_RESULT_NOT_COMMANDABLE));
	json_object_set_new(row, "longest", json_integer(SETUP_TEXT_MAX));
	add_report(site, row);
	return answer_json(MHD_HTTP_OK, row);
}

struct http_answer setup_text(struct http_site *site, struct http_request *request)
{
	struct http_answer answer = {.status = MHD_HTTP_OK};
	size_t size = 0;
	char *text = read_file(site, SETUP_SHOWN, SHOWN_MAX, &size);

	(void)request;
	if (text == NULL)
		return answer_refusal(MHD_HTTP_NOT_FOUND, "unknown", "rtud has shown no file");
	answer.response = MHD_create_response_from_buffer(size, text, MHD_RESPMEM_MUST_FREE);
	MHD_add_response_header(answer.response, MHD_HTTP_HEADER_CONTENT_TYPE, "application/json");
	return answer;
}

/* ---- what it wishes -------------------------------------------------------------------------- */

static struct web_setup *wish_of(const struct http_site *site)
{
	struct web_section *section = map_section(site->map, map_self(site->map), sizeof(*section));

	return section != NULL && site->settings->setup ? &section->setup : NULL;
}

static struct http_answer refuse_busy(void)
{
	return answer_refusal(MHD_HTTP_SERVICE_UNAVAILABLE, "busy",
			      "the gateway is busy with another change");
}

static bool is_busy(void)
{
	return asked.id != 0 || uploading != NULL;
}

/* What its section says. */
static struct http_answer post(struct http_site *site, const struct http_request *request,
			       enum setup_wish wish)
{
	struct web_setup *setup = wish_of(site);
	const struct map_request said = {.action = MAP_SETUP,
					 .point = MAP_NONE,
					 .detail = (uint8_t)wish,
					 .session = request->session->number};

	snprintf(setup->user, sizeof(setup->user), "%s", request->session->name);
	asked.id = map_request_post(site->map, said);
	asked.result = MAP_RESULT_NONE;
	asked.limit_ns = site->now_ns + PATIENCE_NS;
	if (asked.id == 0)
		return refuse_busy();
	return answer_json(MHD_HTTP_ACCEPTED, json_pack("{s:b}", "asked", 1));
}

/* A number of the body by its key; 0: it has none. */
static uint32_t number_in(const struct http_request *request, const char *key)
{
	json_t *row = json_loadb(request->body, request->size, 0, NULL);
	const json_int_t number = json_integer_value(json_object_get(row, key));

	json_decref(row);
	return number > 0 && number <= UINT32_MAX ? (uint32_t)number : 0;
}

static struct http_answer ask(struct http_site *site, const struct http_request *request,
			      enum setup_wish wish)
{
	struct web_setup *setup = wish_of(site);

	if (setup == NULL || is_busy())
		return refuse_busy();
	setup->number = number_in(request, "number");
	setup->proposed = number_in(request, "proposed");
	return post(site, request, wish);
}

struct http_answer setup_show(struct http_site *site, struct http_request *request)
{
	return ask(site, request, SETUP_SHOW);
}

struct http_answer setup_apply(struct http_site *site, struct http_request *request)
{
	return ask(site, request, SETUP_APPLY);
}

struct http_answer setup_confirm(struct http_site *site, struct http_request *request)
{
	return ask(site, request, SETUP_CONFIRM);
}

struct http_answer setup_return(struct http_site *site, struct http_request *request)
{
	return ask(site, request, SETUP_RETURN);
}

bool setup_take_piece(struct http_site *site, struct http_request *request, const char *octets, size_t size)
{
	struct web_setup *setup = wish_of(site);

	if (setup == NULL || asked.id != 0 || (uploading != NULL && uploading != request) ||
	    size > SETUP_TEXT_MAX - request->size)
		return false;
	uploading = request;
	memcpy(setup->text + request->size, octets, size);
	request->size += size;
	return true;
}

void setup_forget(const struct http_request *request)
{
	if (uploading == request)
		uploading = NULL;
}

struct http_answer setup_check(struct http_site *site, struct http_request *request)
{
	struct web_setup *setup = wish_of(site);

	if (setup == NULL || uploading != request)
		return answer_refusal(MHD_HTTP_BAD_REQUEST, "form", "expected a configuration");
	uploading = NULL;
	setup->length = (uint32_t)request->size;
	setup->base = request_number(request, "base", UINT32_MAX, 0);
	return post(site, request, SETUP_CHECK);
}

/* ---- what comes of it ------------------------------------------------------------------------- */

void setup_take_answer(struct http_site *site, const struct map_answer *answer)
{
	(void)site;
	if (asked.id == 0 || answer->id != asked.id)
		return;
	asked.id = 0;
	asked.result = answer->result;
}

void setup_tick(struct http_site *site)
{
	if (asked.id != 0 && site->now_ns >= asked.limit_ns) {
		asked.id = 0;
		asked.result = MAP_RESULT_TIMEOUT;
	}
}
