/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A serial port: of a Modbus line, or of a receiver. */
#ifndef OPENRTU_CHANNEL_SERIAL_H
#define OPENRTU_CHANNEL_SERIAL_H

#include <stdbool.h>
#include <stddef.h>

#include <stdint.h>

#define SERIAL_ERROR_SIZE 96
#define SERIAL_HINT_SIZE  160

enum serial_parity { SERIAL_PARITY_NONE, SERIAL_PARITY_ODD, SERIAL_PARITY_EVEN };

/* How the port's driver drives an RS-485 transceiver that has a direction pin. */
enum serial_rs485_mode {
	SERIAL_RS485_NONE, /* the transceiver finds the direction itself, or somebody else has told the driver */
	SERIAL_RS485_HIGH, /* RTS is active while sending */
	SERIAL_RS485_LOW,
};

struct serial_settings {
	uint32_t baud;               /* bit/s */
	uint8_t data_bits;           /* 7; else 8, as of any pseudo-terminal */
	uint8_t parity;              /* enum serial_parity */
	uint8_t stop_bits;           /* 1, 2 */
	uint8_t rs485;               /* enum serial_rs485_mode */
	uint8_t before_ms, after_ms; /* that mode's delays around what is sent */
};

/*
 * Opens the port for us alone, raw, non-blocking, as the line has it, and checks what it took. *carries_parity is
 * false for a pseudo-terminal, which has none to carry. Returns the descriptor, or -1 with a message in error
 * (SERIAL_ERROR_SIZE bytes), and whose the port is in hint, empty if that is not why.
 */
int serial_open(const char *path, const struct serial_settings *line, bool *carries_parity, char *error,
		char hint[SERIAL_HINT_SIZE]);

/*
 * Whether the port still has what serial_open set: another program that may open it, as root may in spite of us, may
 * have set something else. A pseudo-terminal always has: its settings are those of its other side as well.
 */
bool serial_is_as_set(int fd, const struct serial_settings *line);

/* Forgets what was written and has not been sent. */
void serial_discard_output(int fd);

/* Closes the port at once: close alone waits up to 30 s for what a stuck port has not sent. */
void serial_close(int fd);

/* ---- serial_group.c ---------------------------------------------------------------------- */

/* Of a port that this user may not open: its group, and what to type. */
void serial_explain(const char *path, char hint[SERIAL_HINT_SIZE]);

#endif
