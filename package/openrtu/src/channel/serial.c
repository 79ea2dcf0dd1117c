/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/serial.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/serial.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include "channel/termios2.h"

#define PTY_MAJOR_FIRST        136 /* Linux, Documentation/admin-guide/devices.txt: Unix98 PTY slaves */
#define PTY_MAJOR_LAST         143
#define BAUD_TOLERANCE_PERCENT 2
#define RS485_FLAGS            (SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND | SER_RS485_RTS_AFTER_SEND)
#define CHECKED_FLAGS          (CSIZE | PARENB | PARODD | CSTOPB | CRTSCTS)

/* A request is a number of 32 bits, whichever integer a C library takes for it. */
static int ask(int fd, unsigned int request, struct termios2 *settings)
{
	return ioctl(fd, request, settings);
}

void serial_discard_output(int fd)
{
	ioctl(fd, TCFLSH, TCOFLUSH);
}

void serial_close(int fd)
{
	serial_discard_output(fd);
	close(fd);
}

static bool is_pty(int fd)
{
	struct stat status;

	if (fstat(fd, &status) < 0)
		return false;
	return major(status.st_rdev) >= PTY_MAJOR_FIRST && major(status.st_rdev) <= PTY_MAJOR_LAST;
}

static struct termios2 wanted_settings(const struct serial_settings *line)
{
	/* A character with a parity or framing error is read as 0, and the CRC finds it. */
	struct termios2 settings = {
	    .c_iflag = IGNBRK | INPCK,
	    .c_cflag = (line->data_bits == 7 ? CS7 : CS8) | CREAD | CLOCAL | BOTHER,
	    .c_ispeed = line->baud,
	    .c_ospeed = line->baud,
	};

	if (line->parity != SERIAL_PARITY_NONE)
		settings.c_cflag |= PARENB;
	if (line->parity == SERIAL_PARITY_ODD)
		settings.c_cflag |= PARODD;
	if (line->stop_bits == 2)
		settings.c_cflag |= CSTOPB;
	settings.c_cc[VMIN] = 1; /* no byte is EAGAIN, 0 is a hang-up */
	return settings;
}

static bool is_near(uint32_t baud, uint32_t wanted)
{
	uint32_t difference = baud > wanted ? baud - wanted : wanted - baud;

	return difference <= wanted / 100 * BAUD_TOLERANCE_PERCENT;
}

/* A driver says nothing when it cannot do something: what it did not take is seen only when it is read back. */
static bool took(const struct termios2 *settings, const struct termios2 *wanted, bool carries_parity,
		 char *error)
{
	tcflag_t checked =
	    carries_parity ? CHECKED_FLAGS : CHECKED_FLAGS & ~(tcflag_t)(PARENB | PARODD | CSIZE);

	if (!is_near(settings->c_ospeed, wanted->c_ospeed))
		snprintf(error, SERIAL_ERROR_SIZE, "does not accept %u bit/s, it stays at %u",
			 (unsigned)wanted->c_ospeed, (unsigned)settings->c_ospeed);
	else if (((settings->c_cflag ^ wanted->c_cflag) & checked) != 0)
		snprintf(error, SERIAL_ERROR_SIZE,
			 "does not accept these data bits, this parity or these stop bits");
	else
		return true;
	return false;
}

static struct serial_rs485 wanted_rs485(const struct serial_settings *line)
{
	return (struct serial_rs485){
	    .flags = SER_RS485_ENABLED |
		     (line->rs485 == SERIAL_RS485_HIGH ? SER_RS485_RTS_ON_SEND : SER_RS485_RTS_AFTER_SEND),
	    .delay_rts_before_send = line->before_ms,
	    .delay_rts_after_send = line->after_ms,
	};
}

static bool is_rs485(const struct serial_rs485 *settings, const struct serial_settings *line)
{
	struct serial_rs485 wanted = wanted_rs485(line);

	return ((settings->flags ^ wanted.flags) & RS485_FLAGS) == 0 &&
	       settings->delay_rts_before_send == wanted.delay_rts_before_send &&
	       settings->delay_rts_after_send == wanted.delay_rts_after_send;
}

/* To be called after each change of termios: some drivers forget the mode or the level of RTS then. */
static bool configure_rs485(int fd, const struct serial_settings *line, char *error)
{
	struct serial_rs485 wanted = wanted_rs485(line), settings = {0};

	if (line->rs485 == SERIAL_RS485_NONE)
		return true;
	if (ioctl(fd, TIOCSRS485, &wanted) < 0 || ioctl(fd, TIOCGRS485, &settings) < 0) {
		snprintf(error, SERIAL_ERROR_SIZE, "has no RS-485 mode: %s", strerror(errno));
		return false;
	}
	if (is_rs485(&settings, line))
		return true;
	snprintf(error, SERIAL_ERROR_SIZE, "does not accept this RS-485 level or these delays");
	return false;
}

static bool configure(int fd, const struct serial_settings *line, bool carries_parity, char *error)
{
	struct termios2 wanted = wanted_settings(line), settings;

	if (ask(fd, TCSETS2, &wanted) < 0 || ask(fd, TCGETS2, &settings) < 0) {
		snprintf(error, SERIAL_ERROR_SIZE, "is not a serial port: %s", strerror(errno));
		return false;
	}
	if (!took(&settings, &wanted, carries_parity, error) || !configure_rs485(fd, line, error))
		return false;
	ioctl(fd, TCFLSH, TCIOFLUSH);
	return true;
}

/*
 * flock keeps away those who ask, TIOCEXCL those who do not. The latter lasts until nobody has the port
 * open: on a pseudo-terminal, which its other side may hold open, it would outlive a killed owner and
 * keep out the next.
 */
static bool seize(int fd, char *error)
{
	if (flock(fd, LOCK_EX | LOCK_NB) < 0) {
		snprintf(error, SERIAL_ERROR_SIZE, "is used by another process");
		return false;
	}
	if (!is_pty(fd) && ioctl(fd, TIOCEXCL) < 0) {
		snprintf(error, SERIAL_ERROR_SIZE, "is not a serial port: %s", strerror(errno));
		return false;
	}
	return true;
}

int serial_open(const char *path, const struct serial_settings *line, bool *carries_parity, char *error,
		char hint[SERIAL_HINT_SIZE])
{
	int fd = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);

	hint[0] = '\0';
	if (fd < 0) {
		bool denied = errno == EACCES;

		snprintf(error, SERIAL_ERROR_SIZE, "cannot be opened: %s", strerror(errno));
		if (denied)
			serial_explain(path, hint);
		return -1;
	}
	*carries_parity = !is_pty(fd);
	if (seize(fd, error) && configure(fd, line, *carries_parity, error))
		return fd;
	close(fd);
	return -1;
}

/* A port that does not answer has hung up: reading it will tell. */
static bool has_termios(int fd, const struct serial_settings *line)
{
	struct termios2 wanted = wanted_settings(line), settings;

	if (ask(fd, TCGETS2, &settings) < 0)
		return true;
	return is_near(settings.c_ospeed, wanted.c_ospeed) &&
	       ((settings.c_cflag ^ wanted.c_cflag) & CHECKED_FLAGS) == 0 &&
	       settings.c_iflag == wanted.c_iflag && settings.c_oflag == wanted.c_oflag &&
	       settings.c_lflag == wanted.c_lflag;
}

static bool has_rs485(int fd, const struct serial_settings *line)
{
	struct serial_rs485 settings;

	return line->rs485 == SERIAL_RS485_NONE || ioctl(fd, TIOCGRS485, &settings) < 0 ||
	       is_rs485(&settings, line);
}

bool serial_is_as_set(int fd, const struct serial_settings *line)
{
	return is_pty(fd) || (has_termios(fd, line) && has_rs485(fd, line));
}
