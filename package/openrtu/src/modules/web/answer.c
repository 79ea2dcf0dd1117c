/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/web/answer.h"

#include <stdlib.h>
#include <string.h>

#include "rows/rows.h"

struct http_answer answer_json(unsigned status, json_t *row)
{
	char *text = json_dumps(row, ROWS_FORMAT | JSON_COMPACT);
	struct http_answer answer = {.status = status};

	json_decref(row);
	if (text == NULL)
		return answer;
	answer.response = MHD_create_response_from_buffer(strlen(text), text, MHD_RESPMEM_MUST_FREE);
	MHD_add_response_header(answer.response, MHD_HTTP_HEADER_CONTENT_TYPE, "application/json");
	return answer;
}

struct http_answer answer_refusal(unsigned status, const char *why, const char *text)
{
	return answer_json(status, json_pack("{s:s, s:s}", "error", why, "text", text));
}

const char *request_text(const struct http_request *request, const char *key)
{
	const char *text = MHD_lookup_connection_value(request->connection, MHD_GET_ARGUMENT_KIND, key);

	return text != NULL ? text : "";
}

uint32_t request_number(const struct http_request *request, const char *key, uint32_t most, uint32_t fallback)
{
	const char *text = request_text(request, key);
	char *end;
	const unsigned long number = strtoul(text, &end, 10);

	return text[0] >= '0' && text[0] <= '9' && *end == '\0' && number <= most ? (uint32_t)number
										  : fallback;
}
