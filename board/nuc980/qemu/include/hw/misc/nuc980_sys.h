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
#include "qemu/bitops.h"

#define TYPE_NUC980_SYS "nuc980-sys"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980SysState, NUC980_SYS)

#define NUC980_TIMERS       6
#define NUC980_SYS_REGS     (0x300 / 4)
#define NUC980_RESETS       96

/* Numbers of the "reset" lines: the bits of AHBIPRST, APBIPRST0, APBIPRST1 */
enum {
    NUC980_RESET_PDMA0 = 4,         /* and PDMA1 */
    NUC980_RESET_SDIC = 6,
    NUC980_RESET_GPIO = 7,
    NUC980_RESET_EMAC0 = 16,        /* and EMAC1 */
    NUC980_RESET_FMI = 20,
    NUC980_RESET_AIC = 32 + 4,
    NUC980_RESET_ETIMER0 = 32 + 8,  /* to ETIMER5 */
    NUC980_RESET_UART0 = 32 + 16,   /* to UART9 */
    NUC980_RESET_QSPI0 = 64 + 4,    /* then SPI0, SPI1 */
};

/*
 * Clock outputs: "uart0".."uart9", "etimer0".."etimer5", "wdt", "wwdt", "hclk".
 * Named GPIO output "unlocked": SYS_REGWPCTL has had its three keys.
 * Named GPIO outputs "reset": a block's reset bit is set.
 * Named GPIO inputs "wdt-reset", 0 the WDT's, 1 the WWDT's: it is about to
 * reset the chip.
 */
struct NUC980SysState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    Clock *uart_clk[NUC980_UARTS], *etimer_clk[NUC980_TIMERS];
    Clock *wdt_clk, *wwdt_clk, *hclk;
    qemu_irq unlocked, reset[NUC980_RESETS];
    NUC980PinsState *pins;
    uint32_t pwron;                 /* power-on straps */
    bool booted;                    /* -kernel: what a boot loader leaves */
    uint32_t regs[NUC980_SYS_REGS];
    uint32_t keys;                  /* seen by REGWPCTL, 3: writable */
    uint32_t cause;                 /* RSTSTS's bit for the coming reset */
    DECLARE_BITMAP(seen, NUC980_SYS_REGS);
};

#endif /* HW_MISC_NUC980_SYS_H */
