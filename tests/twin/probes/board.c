/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "board.h"

#include <stdarg.h>

/* ---- console ------------------------------------------------------------------------------------ */

static void put(char character)
{
	while (UART_FSR(0) & FSR_TX_FULL)
		;
	UART_DAT(0) = (uint8_t)character;
}

static void put_text(const char *text)
{
	for (; *text; text++)
		put(*text);
}

static void put_number(uint32_t value, unsigned base)
{
	char digits[11];
	unsigned n = sizeof(digits) - 1;

	digits[n] = '\0';
	do {
		digits[--n] = "0123456789abcdef"[value % base];
		value /= base;
	} while (value);
	put_text(&digits[n]);
}

void say(const char *format, ...)
{
	va_list values;

	va_start(values, format);
	for (; *format; format++) {
		if (*format != '%') {
			put(*format);
			continue;
		}
		switch (*++format) {
		case 's':
			put_text(va_arg(values, const char *));
			break;
		case 'c':
			put((char)va_arg(values, int));
			break;
		case 'u':
			put_number(va_arg(values, uint32_t), 10);
			break;
		case 'x':
			put_number(va_arg(values, uint32_t), 16);
			break;
		}
	}
	va_end(values);
}

uint32_t ask(void)
{
	uint32_t number = 0;

	for (;;) {
		while (UART_FSR(0) & FSR_RX_EMPTY)
			;
		const uint32_t character = UART_DAT(0);

		if (character == '\n')
			return number;
		number = 10 * number + (character - '0');
	}
}

/* From start.S: the processor has given up what it was doing. */
void died(const char *why, uint32_t where);

void died(const char *why, uint32_t where)
{
	say("died: %s near %x\n", why, where);
	for (;;)
		;
}

/* libgcc's division by zero comes here. */
int raise(int signal);

int raise(int signal)
{
	died("division by zero", (uint32_t)signal);
	return 0;
}

/* ---- interrupts --------------------------------------------------------------------------------- */

static void (*handlers[64])(void);

/* As the vendor's kernel does: mask and end the interrupt, then serve it; once more until none is left. */
void serve_irq(void);

void serve_irq(void)
{
	uint32_t source;

	while ((source = AIC_IRQNUM) != 0) {
		irq_mask(source);
		AIC_EOIS = 1;
		handlers[source]();
		irq_unmask(source);
	}
}

void serve_fiq(void);

void serve_fiq(void)
{
	const uint32_t source = AIC_FIQNUM;

	if (source)
		handlers[source]();
	AIC_EOFS = 1;
}

void irq_handle(unsigned source, void (*handler)(void))
{
	handlers[source] = handler;
	irq_unmask(source);
}

void irq_level(unsigned source, unsigned level)
{
	const unsigned shift = source % 4 * 8;

	AIC_SRCCTL(source) = (AIC_SRCCTL(source) & ~(7u << shift)) | level << shift;
}

void irq_mask(unsigned source)
{
	AIC_INTDIS(source) = BIT(source % 32);
}

void irq_unmask(unsigned source)
{
	AIC_INTEN(source) = BIT(source % 32);
}

static uint32_t status(void)
{
	uint32_t cpsr;

	__asm__ volatile("mrs %0, cpsr" : "=r"(cpsr) : : "memory");
	return cpsr;
}

static void set_status(uint32_t cpsr)
{
	__asm__ volatile("msr cpsr_c, %0" : : "r"(cpsr) : "memory");
}

void interrupts_on(void)
{
	set_status(status() & ~0xc0u);
}

void interrupts_off(void)
{
	set_status(status() | 0xc0);
}

/* ---- time --------------------------------------------------------------------------------------- */

uint32_t microseconds(void)
{
	return ETIMER_DR(5);
}

uint32_t since(uint32_t start)
{
	return (microseconds() - start) & 0xffffff;
}

void wait(uint32_t time)
{
	const uint32_t start = microseconds();

	while (since(start) < time)
		;
}

void etimer_start(unsigned timer, uint32_t mode, uint32_t time)
{
	ETIMER_CTL(timer) = 0;
	ETIMER_PRECNT(timer) = XIN_HZ / 1000000 - 1;
	ETIMER_CMPR(timer) = time;
	ETIMER_IER(timer) = 1;
	ETIMER_CTL(timer) = mode;
}

/* ---- pins and lines ----------------------------------------------------------------------------- */

void pin_select(char port, unsigned pin, unsigned function)
{
	volatile uint32_t *mfp = &SYS_MFP(port)[pin / 8];
	const unsigned shift = pin % 8 * 4;

	*mfp = (*mfp & ~(0xfu << shift)) | function << shift;
}

void uart_start(unsigned uart, uint32_t clock_hz, uint32_t baud, uint32_t fcr)
{
	UART_LCR(uart) = 3;
	UART_BAUD(uart) = 0x30000000 | ((clock_hz + baud / 2) / baud - 2);
	UART_FCR(uart) = fcr | FCR_RESET;
	UART_FCR(uart) = fcr;
	UART_TOR(uart) = 0x40; /* bit times, as the vendor's driver */
}

void unlock(void)
{
	do {
		SYS_REGWPCTL = 0x59;
		SYS_REGWPCTL = 0x16;
		SYS_REGWPCTL = 0x88;
	} while (!(SYS_REGWPCTL & 1));
}

/* From start.S. */
void begin(void);

void begin(void)
{
	CLK_HCLKEN = 0xffffffff;
	CLK_PCLKEN0 = 0xffffffff;
	ETIMER_PRECNT(5) = XIN_HZ / 1000000 - 1;
	ETIMER_CMPR(5) = 0xffffff;
	ETIMER_CTL(5) = ETIMER_CONTINUOUS;
	pin_select('F', 11, 1);
	pin_select('F', 12, 1);
	uart_start(0, XIN_HZ, 115200, FCR_TRIGGER_1);
	probe();
	say("end\n");
}
