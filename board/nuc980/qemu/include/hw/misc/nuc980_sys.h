/*
 * Nuvoton NUC980 system and clock registers
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_MISC_NUC980_SYS_H
#define HW_MISC_NUC980_SYS_H

#include "hw/clock.h"
#include "hw/misc/nuc980_pins.h"
#include "hw/sysbus.h"

#define TYPE_NUC980_SYS "nuc980-sys"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980SysState, NUC980_SYS)

#define NUC980_TIMERS       6
#define NUC980_SYS_REGS     (0x300 / 4)

/*
 * Clock outputs: "uart0".."uart9", "etimer0".."etimer5", "wdt", "hclk".
 * Named GPIO output "unlocked": SYS_REGWPCTL has had its three keys.
 * Named GPIO input "wdt-reset": the watchdog is about to reset the chip.
 */
struct NUC980SysState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    Clock *uart_clk[NUC980_UARTS], *etimer_clk[NUC980_TIMERS];
    Clock *wdt_clk, *hclk;
    qemu_irq unlocked;
    NUC980PinsState *pins;
    uint32_t pwron;                 /* power-on straps */
    bool booted;                    /* -kernel: what a boot loader leaves */
    uint32_t regs[NUC980_SYS_REGS];
    uint32_t unlock;                /* keys seen, 3: writable */
};

#endif /* HW_MISC_NUC980_SYS_H */
