/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Set-up, if the configuration has it: the page's text goes to rtud, which judges it and does all that touches a file, and what
 * rtud says comes to the page. One wish at a time.
 */
#ifndef OPENRTU_MODULES_WEB_PROPOSALS_H
#define OPENRTU_MODULES_WEB_PROPOSALS_H

#include "modules/web/answer.h"
#include "web/setup.h"

/* How far the proposal is, what rtud says of it, and whether the last wish has ended. */
http_route setup_state;
/* The text and the history that setup_show asked for. */
http_route setup_text;
/* number: of the history, 0: the file in force. */
http_route setup_show;
/* The body is the text; base: the hash of the one that it was made of. */
http_route setup_check;
/* proposed: the hash of what was checked. */
http_route setup_apply;
http_route setup_confirm;
http_route setup_return;

/* The text of a request comes in pieces: setup_check takes it. False: another one's does, or it is too long. */
bool setup_take_piece(struct http_site *site, struct http_request *request, const char *octets, size_t size);
/* The request is over. */
void setup_forget(const struct http_request *request);
/* An answer of rtud's. */
void setup_take_answer(struct http_site *site, const struct map_answer *answer);
/* From the loop. */
void setup_tick(struct http_site *site);

#endif
