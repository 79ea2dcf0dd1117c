/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Who comes in, stays and goes. */
#ifndef OPENRTU_MODULES_WEB_LOGIN_H
#define OPENRTU_MODULES_WEB_LOGIN_H

#include "modules/web/answer.h"

http_route login_begin, login_end, login_state;

/* Browsers know a cookie by its host alone: other gateways may be behind other ports. */
void login_cookie_name(const struct http_site *site, char *out, size_t size);
/* Ends the sessions of users whom the file does not have so any more, some seconds after it has changed. */
void login_review(struct http_site *site);
/* Says in the log what is wrong with the file of users. */
void login_look(struct http_site *site);

#endif
