/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What every probe stands on: its console on UART0, interrupts, and a clock. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "nuc980.h"

#define ARRAY_SIZE(array) (sizeof(array) / sizeof((array)[0]))
#define XIN_HZ            12000000

/* The probe itself: all clocks are on, TIMER5 counts microseconds, UART0 is on its pins at 115200 8N1. */
void probe(void);

/* ---- console */
void say(const char *format, ...) __attribute__((format(printf, 1, 2))); /* knows %s %c %u %x */
uint32_t ask(void); /* a decimal number and its line's end */

/* ---- interrupts */
void irq_handle(unsigned source, void (*handler)(void)); /* and unmasks the source */
void irq_level(unsigned source, unsigned level);         /* 0: it is the FIQ; 1 first .. 7 last */
void irq_mask(unsigned source);
void irq_unmask(unsigned source);
void interrupts_on(void);
void interrupts_off(void);

/* ---- time */
uint32_t microseconds(void); /* of 24 bits */
uint32_t since(uint32_t start);
void wait(uint32_t microseconds);
void etimer_start(unsigned timer, uint32_t mode, uint32_t microseconds); /* with its interrupt */

/* ---- pins and lines */
void pin_select(char port, unsigned pin, unsigned function);
void uart_start(unsigned uart, uint32_t clock_hz, uint32_t baud, uint32_t fcr);
void unlock(void); /* SYS_REGWPCTL */

#endif
