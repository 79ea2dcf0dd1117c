/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The consumer: one process at a time on a Unix socket (SOCK_SEQPACKET), which takes batches, acknowledges them and sends
 * requests. While there is none, there is no connection to any station.
 */
#ifndef OPENRTU_CENTRE_CONSUMER_H
#define OPENRTU_CENTRE_CONSUMER_H

#include "centre/station.h"

/* Listens. A socket of this name that nobody listens on is left over and taken. -1: said on stderr. */
int centre_consumer_listen(const char *path);
/* Takes whoever connects; a second one is turned away. True: the consumer is new. */
bool centre_consumer_accept(struct centre *centre, int listener);
/* The consumer's packets, as many as are there. */
void centre_consumer_receive(struct centre *centre);
/* Sends what there is. True: the socket has to become writable first. */
bool centre_consumer_flush(struct centre *centre);
/* Ends the connection to the consumer, and so all to stations; says why. */
void centre_consumer_drop(struct centre *centre, const char *why);

#endif
