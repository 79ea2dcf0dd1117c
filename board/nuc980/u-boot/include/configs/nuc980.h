/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Nuvoton NUC980
 */

#ifndef __NUC980_H
#define __NUC980_H

#define CONFIG_SYS_SDRAM_BASE		0

#endif
