/*
 * Nuvoton NUC980 real-time clock
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_RTC_NUC980_RTC_H
#define HW_RTC_NUC980_RTC_H

#include "hw/sysbus.h"
#include "qemu/bitops.h"
#include "qemu/timer.h"

#define TYPE_NUC980_RTC "nuc980-rtc"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980RTCState, NUC980_RTC)

#define NUC980_RTC_SIZE     0x100
#define NUC980_RTC_SPARES   16

struct NUC980RTCState {
    SysBusDevice parent_obj;

    MemoryRegion iomem;
    qemu_irq irq;
    QEMUTimer *timer;               /* the next alarm or tick */
    bool battery;                   /* it ran on while the board was off */
    bool active;                    /* since INIT's key, when it did not */
    int64_t offset;                 /* seconds, to QEMU's -rtc */
    int32_t weekday_offset;         /* days, to the calendar's */
    int64_t open_until_ns;          /* when RWEN's key ends to count */
    int64_t busy_until_ns;          /* when the last write has arrived */
    int64_t alarm_ns;               /* on rtc_clock; INT64_MAX: never */
    int64_t tick;                   /* the last one that INTSTS has seen */
    uint32_t freqadj, timefmt, talm, calm, inten, intsts, tick_period, pwrctl;
    uint32_t spare[NUC980_RTC_SPARES];
    DECLARE_BITMAP(seen, NUC980_RTC_SIZE / 4);
};

#endif /* HW_RTC_NUC980_RTC_H */
