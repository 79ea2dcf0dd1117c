/* SPDX-License-Identifier: GPL-2.0-only */
#ifndef __LINUX_SOC_NUVOTON_NUC980_H
#define __LINUX_SOC_NUVOTON_NUC980_H

#include <linux/types.h>

void nuc980_clk_init(void);
void nuc980_timer_init(void);

/**
 * nuc980_protected_write() - write a register behind the system's write lock
 * @reg: the register; chip reset and watchdog control are of this kind
 * @value: what it shall hold
 *
 * May be called from any context.
 */
void nuc980_protected_write(void __iomem *reg, u32 value);

#endif
