/*
 * Nuvoton NUC980 watchdog timer, and window watchdog timer
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_WATCHDOG_NUC980_WDT_H
#define HW_WATCHDOG_NUC980_WDT_H

#include "hw/clock.h"
#include "hw/sysbus.h"
#include "qemu/bitops.h"
#include "qemu/timer.h"

#define TYPE_NUC980_WDT "nuc980-wdt"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980WDTState, NUC980_WDT)

#define TYPE_NUC980_WWDT "nuc980-wwdt"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980WWDTState, NUC980_WWDT)

#define NUC980_WDT_SIZE     0x100

/*
 * Both: clock input "clk", and a named GPIO output "reset" that pulses as the
 * watchdog resets the machine.
 */

/* Named GPIO input "unlocked": CTL and ALTCTL may be written. */
struct NUC980WDTState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq, reset;
    Clock *clk;
    QEMUTimer *timer;               /* the time-out, then the reset */
    bool unlocked;
    uint32_t ctl, altctl;
    int64_t base;                   /* the counter ... */
    int64_t start_ns;               /* ... at this time */
    bool timed_out;                 /* the reset's delay runs */
    bool has_reset;                 /* tells the coming reset from others */
    DECLARE_BITMAP(seen, NUC980_WDT_SIZE / 4);
};

struct NUC980WWDTState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq, reset;
    Clock *clk;
    QEMUTimer *timer;               /* the compare value, then the end */
    uint32_t ctl, status;
    int64_t start_ns;               /* when the counter was full */
    bool in_window;                 /* past the compare value */
    bool has_reset;
    DECLARE_BITMAP(seen, NUC980_WDT_SIZE / 4);
};

#endif /* HW_WATCHDOG_NUC980_WDT_H */
