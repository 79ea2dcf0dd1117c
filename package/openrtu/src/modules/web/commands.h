/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Commands of the page, if the configuration has them: a selection, an execution or the end of a selection each, and what has
 * become of it. Nothing is queued or repeated.
 */
#ifndef OPENRTU_MODULES_WEB_COMMANDS_H
#define OPENRTU_MODULES_WEB_COMMANDS_H

#include "modules/web/answer.h"

/* {"action": "select" | "execute" | "cancel", "name": POINT, "value": TEXT}: begins it; answers as command_state. */
http_route command_order;
/* number: what has become of it. */
http_route command_state;

/* An answer of a point's owner. */
void commands_take_answer(struct http_site *site, const struct map_answer *answer);
/* The end of those who should have given one. */
void commands_tick(struct http_site *site);
/* Points have other numbers now. */
void commands_renew(struct http_site *site, const struct map_config *before);

#endif
