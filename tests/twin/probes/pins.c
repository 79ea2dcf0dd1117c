/* SPDX-License-Identifier: GPL-3.0-or-later */
/* UART3 on pins that it can use, but that the board does not wire to it; then on its own. */
#include "board.h"

static void speak(const char *text)
{
	for (; *text; text++)
		UART_DAT(3) = (uint8_t)*text;
	while (!(UART_FSR(3) & FSR_TX_DONE))
		;
}

static uint32_t heard(void)
{
	uint32_t bytes = 0;

	for (; !(UART_FSR(3) & FSR_RX_EMPTY); bytes++)
		(void)UART_DAT(3);
	return bytes;
}

void probe(void)
{
	uart_start(3, XIN_HZ, 115200, FCR_TRIGGER_1);
	speak("nowhere");
	pin_select('B', 10, 1);
	pin_select('B', 9, 1);
	speak("wrong");
	say("wrong pins, type\n");
	ask();
	wait(20000);
	say("heard %u\n", heard());
	pin_select('B', 10, 0);
	pin_select('B', 9, 0);
	pin_select('D', 3, 2);
	pin_select('D', 2, 2);
	speak("right");
	say("right pins, type\n");
	ask();
	wait(20000);
	say("heard %u\n", heard());
	pin_select('D', 2, 0);
	speak("gone");
}
