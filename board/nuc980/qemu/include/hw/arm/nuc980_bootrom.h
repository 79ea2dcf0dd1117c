/*
 * Nuvoton NUC980 boot ROM: starting from NAND
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_ARM_NUC980_BOOTROM_H
#define HW_ARM_NUC980_BOOTROM_H

#include "sysemu/block-backend.h"
#include "target/arm/cpu.h"

/*
 * At every reset the CPU starts what the NAND's image has in its first blocks,
 * or halts if there is nothing.
 */
void nuc980_boot_from_nand(ARMCPU *cpu, BlockBackend *nand);

#endif /* HW_ARM_NUC980_BOOTROM_H */
