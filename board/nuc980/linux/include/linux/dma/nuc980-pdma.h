/* SPDX-License-Identifier: GPL-2.0-only */
#ifndef _LINUX_DMA_NUC980_PDMA_H
#define _LINUX_DMA_NUC980_PDMA_H

#include <linux/types.h>

/**
 * struct nuc980_pdma_config - a channel's dma_slave_config.peripheral_config
 * @timeout_ns: how long after a request that no other followed the callback of
 *		a cyclic transfer is called, before its period has ended; 0: never
 *
 * May be given at any time, also while the transfer runs: its callback is then
 * called once more, for what the old time-out would have reported.
 */
struct nuc980_pdma_config {
	u32 timeout_ns;
};

#endif
