/* SPDX-License-Identifier: GPL-3.0-or-later */
/* HTTP by libmicrohttpd: requests find their answers, and who may have them. */
#ifndef OPENRTU_MODULES_WEB_HTTP_H
#define OPENRTU_MODULES_WEB_HTTP_H

#include "modules/web/answer.h"
#include "modules/web/front.h"

/* The library; false: it cannot. */
bool http_begin(struct http_site *site);
/* For poll; the library's own epoll. */
int http_fd(void);
/* Lets the library read, answer and write what it can. False: there is more, which no descriptor tells of. */
bool http_serve(void);
front_taker http_take;
void http_end(void);

#endif
