/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The octets of a session, and what carries them. */
#ifndef OPENRTU_IEC104_OCTETS_H
#define OPENRTU_IEC104_OCTETS_H

#include "channel/channel.h"
#include "iec104/session.h"

/* Takes what there is room for. True: something came. An error closes the session. */
bool iec104_receive(struct channel *channel, struct iec104_session *session);
/* Writes what the connection takes. True: something went, so there may be room for more. */
bool iec104_transmit(struct channel *channel, struct iec104_session *session);
/* What epoll shall tell of: EPOLLIN while there is space for input, EPOLLOUT while output is left. */
uint32_t iec104_interest(const struct channel *channel, struct iec104_session *session);

#endif
