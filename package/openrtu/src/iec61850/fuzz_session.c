/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the session layer: what an SPDU carries lies inside it, and an SPDU that is written around it carries the same.
 */
#include "ber/fuzz_element.h"
#include "iec61850/session.h"

#define OCTETS_MAX 8192

static uint8_t octets[OCTETS_MAX];

static void read_again(const struct iec61850_session *session, enum iec61850_spdu kind)
{
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
	struct iec61850_session again;
	struct ber_element whole;

	ber_put_octets(&writer, session->user_data.value, session->user_data.size);
	iec61850_session_write(&writer, kind, sizeof(octets), &session->called);
	whole = written(&writer, sizeof(octets));
	if (kind == IEC61850_SPDU_ACCEPT) /* which a server does not read: but for its kind it is a CONNECT */
		octets[writer.at] = IEC61850_SPDU_CONNECT;
	if (kind == IEC61850_SPDU_DISCONNECT)
		octets[writer.at] = IEC61850_SPDU_FINISH;
	CHECK(iec61850_session_read(whole.value, whole.size, &again));
	check_same(&again.user_data, &session->user_data);
	if (kind == IEC61850_SPDU_ACCEPT)
		check_same(&again.called, &session->called);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	const struct ber_element whole = {.value = data, .size = size};
	struct iec61850_session session;

	if (!iec61850_session_read(data, size, &session) || size > OCTETS_MAX / 2)
		return 0;
	check_inside(&session.user_data, &whole);
	check_inside(&session.called, &whole);
	CHECK(session.called.size <= IEC61850_SESSION_SELECTOR_MAX);
	read_again(&session, IEC61850_SPDU_DATA);
	read_again(&session, IEC61850_SPDU_ACCEPT);
	read_again(&session, IEC61850_SPDU_DISCONNECT);
	return 0;
}
