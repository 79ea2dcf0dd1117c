/*
 * Nuvoton NUC980 system on chip
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_ARM_NUC980_H
#define HW_ARM_NUC980_H

#include "hw/block/nuc980_fmi.h"
#include "hw/char/nuc980_uart.h"
#include "hw/dma/nuc980_pdma.h"
#include "hw/gpio/nuc980_gpio.h"
#include "hw/intc/nuc980_aic.h"
#include "hw/misc/nuc980_pins.h"
#include "hw/misc/nuc980_sdic.h"
#include "hw/misc/nuc980_sys.h"
#include "hw/misc/nuc980_unmodelled.h"
#include "hw/net/nuc980_emac.h"
#include "hw/rtc/nuc980_rtc.h"
#include "hw/ssi/nuc980_spi.h"
#include "hw/timer/nuc980_etimer.h"
#include "hw/watchdog/nuc980_wdt.h"
#include "target/arm/cpu.h"

#define TYPE_NUC980 "nuc980"
OBJECT_DECLARE_SIMPLE_TYPE(NUC980State, NUC980)

#define NUC980_PDMAS        2
#define NUC980_SPIS         3

struct NUC980State {
    DeviceState parent_obj;

    ARMCPU cpu;
    MemoryRegion sram;
    NUC980UnmodelledState unmodelled;
    NUC980AICState aic;
    NUC980PinsState pins;
    NUC980SysState sys;
    NUC980SDICState sdic;
    NUC980ETimerState etimer[NUC980_TIMERS];
    NUC980WDTState wdt;
    NUC980WWDTState wwdt;
    NUC980RTCState rtc;
    NUC980PDMAState pdma[NUC980_PDMAS];
    NUC980UARTState uart[NUC980_UARTS];
    NUC980GPIOState gpio;
    NUC980FMIState fmi;
    NUC980SPIState spi[NUC980_SPIS];
    NUC980EMACState emac[NUC980_EMACS];
};

#endif /* HW_ARM_NUC980_H */
