/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/tls_dates.h"

#include <stdarg.h>
#include <stdio.h>
#include <time.h>

#include "channel/tls_certificate.h"
#include "map/time_ns.h"

#define AHEAD_DAYS 30
#define DAY_NS     (S_PER_DAY * NS_PER_S)
#define FIRST_CLOCK                                                                                          \
	1672531200 /* 2023-01-01, before this was written: no clock that was ever set is behind it */

enum state { UNKNOWN, GOOD, ENDS_SOON, EXPIRED, NOT_YET_VALID, CLOCK_NOT_SET };

struct subject {
	enum state logged;
	int64_t until_ns; /* when it is logged once more */
};

static struct subject own, lists;

void tls_dates_forget(void)
{
	own = lists = (struct subject){.logged = UNKNOWN};
}

/* True: it is news, or was logged a day ago. */
static bool is_due(struct subject *subject, enum state state, int64_t now_ns)
{
	bool known = state == subject->logged;

	if (known && (state == GOOD || now_ns < subject->until_ns))
		return false;
	*subject = (struct subject){.logged = state, .until_ns = now_ns + DAY_NS};
	return true;
}

static bool is_over(const ASN1_TIME *end)
{
	return end != NULL && X509_cmp_current_time(end) < 0;
}

static void log_line(tls_dates_say say, enum map_log_level level, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

static void log_line(tls_dates_say say, enum map_log_level level, const char *format, ...)
{
	char text[MAP_LOG_TEXT_SIZE];
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(text, sizeof(text), format, arguments);
	va_end(arguments);
	say(level, NULL, text);
}

/* ---- the own certificate ----------------------------------------------------------------- */

static enum state state_of(const X509 *certificate, int *days)
{
	const ASN1_TIME *end = X509_get0_notAfter(certificate);
	int seconds;

	if (time(NULL) < FIRST_CLOCK)
		return CLOCK_NOT_SET;
	if (is_over(end))
		return EXPIRED;
	if (X509_cmp_current_time(X509_get0_notBefore(certificate)) > 0)
		return NOT_YET_VALID;
	return ASN1_TIME_diff(days, &seconds, NULL, end) == 1 && *days < AHEAD_DAYS ? ENDS_SOON : GOOD;
}

/* The peers judge it, by their own clocks: ours may be wrong. */
static void watch_own(tls_dates_say say, const X509 *certificate, int64_t now_ns)
{
	char name[CHANNEL_NAME_SIZE], until[TLS_DATE_SIZE];
	int days = 0;
	enum state state = state_of(certificate, &days);

	if (!is_due(&own, state, now_ns))
		return;
	tls_common_name(certificate, name);
	tls_date(X509_get0_notAfter(certificate), until);
	switch (state) {
	case CLOCK_NOT_SET:
		log_line(say, MAP_LOG_WARNING,
			 "the system's clock was never set: every certificate is refused until it is");
		return;
	case EXPIRED:
		log_line(say, MAP_LOG_WARNING, "own certificate expired on %s: \"%s\"", until, name);
		return;
	case NOT_YET_VALID:
		log_line(say, MAP_LOG_WARNING, "own certificate is not yet valid: \"%s\"", name);
		return;
	case ENDS_SOON:
		log_line(say, MAP_LOG_WARNING, "own certificate expires on %s, in %d days: \"%s\"", until,
			 days, name);
		return;
	default:
		log_line(say, MAP_LOG_INFO, "TLS, own certificate until %s: \"%s\"", until, name);
	}
}

/* ---- lists of revoked certificates ------------------------------------------------------- */

/* One that is over; NULL: there is none. */
static const X509_CRL *outdated_list(const SSL_CTX *context)
{
	const STACK_OF(X509_OBJECT) *objects = X509_STORE_get0_objects(SSL_CTX_get_cert_store(context));

	for (int i = 0; i < sk_X509_OBJECT_num(objects); i++) {
		const X509_CRL *list = X509_OBJECT_get0_X509_CRL(sk_X509_OBJECT_value(objects, i));

		if (list != NULL && is_over(X509_CRL_get0_nextUpdate(list)))
			return list;
	}
	return NULL;
}

static void watch_lists(tls_dates_say say, const SSL_CTX *context, int64_t now_ns)
{
	const X509_CRL *outdated = outdated_list(context);
	char until[TLS_DATE_SIZE];

	if (!is_due(&lists, outdated != NULL ? EXPIRED : GOOD, now_ns) || outdated == NULL)
		return;
	tls_date(X509_CRL_get0_nextUpdate(outdated), until);
	log_line(say, MAP_LOG_WARNING,
		 "a list in crl expired on %s: new connections are refused, existing ones stay", until);
}

void tls_dates_watch(tls_dates_say say, const SSL_CTX *context, int64_t now_ns)
{
	watch_own(say, SSL_CTX_get0_certificate(context), now_ns);
	watch_lists(say, context, now_ns);
}
