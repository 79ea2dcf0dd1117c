/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Requests of the consumer. */
#ifndef OPENRTU_CENTRE_ORDER_H
#define OPENRTU_CENTRE_ORDER_H

#include "centre/station.h"

/* Sends a request, or says why it is not sent; at most one record. */
void centre_station_order(struct centre *centre, const struct centre_request *request);

#endif
