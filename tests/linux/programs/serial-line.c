/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A serial line's near end, in Linux on the emulated board: what tests/linux/test_serial.py has at the other.
 *
 *   serial-line duplex FORMAT SPEED COUNT DEVICE...   sends and checks COUNT bytes on each, all at once
 *   serial-line receive FORMAT SPEED COUNT DEVICE     COUNT bytes, their errors marked
 *   serial-line echo FORMAT COUNT DEVICE SPEED...     COUNT bytes back at each speed, in one open
 *   serial-line speeds DEVICE SPEED...                what each becomes
 *   serial-line direction FLAGS BEFORE AFTER DEVICE   a word after each thing that might turn RS-485 off
 *   serial-line rs485 DEVICE [off]                    its flags and delays; turns it off before
 */

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <asm/termbits.h>
#include <linux/serial.h>

enum { LINES_MAX = 6, SILENCE_MS = 20000 };

struct line {
	const char *device;
	int fd;
	uint32_t sent, received; /* bytes */
	uint32_t wrong, first;   /* bytes; the first of them */
};

static void fail(const char *what)
{
	fprintf(stderr, "%s: %s\n", what, strerror(errno));
	exit(1);
}

/* FORMAT: data bits, parity (N, E, O, M, S), stop bits; h behind it is RTS/CTS, i marks errors */
static struct termios2 settings(const char *format, unsigned speed)
{
	static const tcflag_t sizes[] = {CS5, CS6, CS7, CS8};
	struct termios2 termios = {
	    .c_cflag = CREAD | CLOCAL | BOTHER | sizes[format[0] - '5'],
	    .c_ispeed = speed,
	    .c_ospeed = speed,
	};

	if (format[1] != 'N')
		termios.c_cflag |= PARENB;
	if (format[1] == 'O' || format[1] == 'M')
		termios.c_cflag |= PARODD;
	if (format[1] == 'M' || format[1] == 'S')
		termios.c_cflag |= CMSPAR;
	if (format[2] == '2')
		termios.c_cflag |= CSTOPB;
	if (strchr(format + 3, 'h'))
		termios.c_cflag |= CRTSCTS;
	if (strchr(format + 3, 'i'))
		termios.c_iflag |= INPCK | PARMRK;
	termios.c_cc[VMIN] = 1;
	return termios;
}

static int open_line(const char *device)
{
	int fd = open(device, O_RDWR | O_NOCTTY | O_NONBLOCK);

	if (fd < 0)
		fail(device);
	return fd;
}

static void set_line(int fd, const char *format, unsigned speed)
{
	struct termios2 termios = settings(format, speed);

	if (ioctl(fd, TCSETSW2, &termios) != 0)
		fail("TCSETSW2");
}

static void print_counts(int fd, const char *device)
{
	struct serial_icounter_struct counts;

	if (ioctl(fd, TIOCGICOUNT, &counts) != 0)
		fail("TIOCGICOUNT");
	printf("%s rx %d tx %d overrun %d parity %d frame %d brk %d buf_overrun %d\n", device, counts.rx,
	       counts.tx, counts.overrun, counts.parity, counts.frame, counts.brk, counts.buf_overrun);
}

/* The n-th byte from an end, 0 this one, 1 the other; the last digit of the device's name makes a difference. */
static uint8_t pattern(const char *device, unsigned end, uint32_t n, uint8_t mask)
{
	unsigned line = (unsigned)(device[strlen(device) - 1] - '0');

	return (uint8_t)((n * 7 + (n >> 8) * 13 + line * 31 + end * 101) & mask);
}

static void send_some(struct line *line, uint32_t count, uint8_t mask)
{
	uint8_t chunk[256];
	uint32_t size = 0;

	while (size < sizeof chunk && line->sent + size < count) {
		chunk[size] = pattern(line->device, 0, line->sent + size, mask);
		size++;
	}
	ssize_t taken = write(line->fd, chunk, size);
	if (taken < 0 && errno != EAGAIN)
		fail(line->device);
	line->sent += taken > 0 ? (uint32_t)taken : 0;
}

static void check_some(struct line *line, uint8_t mask)
{
	uint8_t chunk[4096];
	ssize_t size = read(line->fd, chunk, sizeof chunk);

	if (size < 0 && errno != EAGAIN)
		fail(line->device);
	for (ssize_t i = 0; i < size; i++, line->received++) {
		if (chunk[i] == pattern(line->device, 1, line->received, mask))
			continue;
		if (line->wrong++ == 0)
			line->first = line->received;
	}
}

static int duplex(const char *format, unsigned speed, uint32_t count, unsigned lines, char **devices)
{
	uint8_t mask = (uint8_t)((1u << (format[0] - '0')) - 1);
	struct line line[LINES_MAX] = {0};
	struct pollfd fds[LINES_MAX] = {{0}};
	bool busy;

	for (unsigned i = 0; i < lines; i++) {
		line[i] = (struct line){.device = devices[i], .fd = open_line(devices[i])};
		set_line(line[i].fd, format, speed);
		ioctl(line[i].fd, TCFLSH, TCIOFLUSH);
		print_counts(line[i].fd, line[i].device);
	}
	puts("ready");
	fflush(stdout);
	do {
		busy = false;
		for (unsigned i = 0; i < lines; i++) {
			fds[i] = (struct pollfd){.fd = line[i].fd};
			fds[i].events |= line[i].sent < count ? POLLOUT : 0;
			fds[i].events |= line[i].received < count ? POLLIN : 0;
			fds[i].fd = fds[i].events ? fds[i].fd : -1;
			busy |= fds[i].events != 0;
		}
		if (busy && poll(fds, lines, SILENCE_MS) == 0)
			break;
		for (unsigned i = 0; i < lines; i++) {
			if (fds[i].revents & POLLOUT)
				send_some(&line[i], count, mask);
			if (fds[i].revents & POLLIN)
				check_some(&line[i], mask);
		}
	} while (busy);
	for (unsigned i = 0; i < lines; i++) {
		ioctl(line[i].fd, TCSBRK, 1); /* tcdrain */
		printf("%s sent %u received %u wrong %u first %u\n", line[i].device, line[i].sent,
		       line[i].received, line[i].wrong, line[i].first);
		print_counts(line[i].fd, line[i].device);
	}
	return 0;
}

static int receive(const char *format, unsigned speed, uint32_t count, const char *device)
{
	int fd = open_line(device);
	struct pollfd poller = {.fd = fd, .events = POLLIN};

	set_line(fd, format, speed);
	print_counts(fd, device);
	puts("ready");
	fflush(stdout);
	for (uint32_t received = 0; received < count;) {
		uint8_t chunk[256];

		if (poll(&poller, 1, SILENCE_MS) == 0)
			break;
		ssize_t size = read(fd, chunk, sizeof chunk);
		if (size < 0)
			fail(device);
		for (ssize_t i = 0; i < size; i++)
			printf("%02x ", chunk[i]);
		fflush(stdout);
		received += (uint32_t)size;
	}
	puts("");
	print_counts(fd, device);
	return 0;
}

static int echo(const char *format, uint32_t count, const char *device, unsigned speeds, char **speed)
{
	int fd = open_line(device);
	struct pollfd poller = {.fd = fd, .events = POLLIN};

	for (unsigned i = 0; i < speeds; i++) {
		set_line(fd, format, (unsigned)atoi(speed[i]));
		printf("at %s\n", speed[i]);
		fflush(stdout);
		for (uint32_t received = 0; received < count;) {
			uint8_t chunk[256];

			if (poll(&poller, 1, SILENCE_MS) == 0)
				return 1;
			ssize_t size = read(fd, chunk, sizeof chunk);
			if (size < 0 || write(fd, chunk, (size_t)size) != size)
				fail(device);
			received += (uint32_t)size;
		}
	}
	if (ioctl(fd, TCSBRK, 1) != 0)
		fail("tcdrain");
	print_counts(fd, device);
	return 0;
}

static int speeds(const char *device, unsigned count, char **wanted)
{
	int fd = open_line(device);

	for (unsigned i = 0; i < count; i++) {
		struct termios2 termios = settings("8N1", (unsigned)atoi(wanted[i]));

		if (ioctl(fd, TCSETS2, &termios) != 0 || ioctl(fd, TCGETS2, &termios) != 0)
			fail("TCSETS2");
		printf("%s %u\n", wanted[i], termios.c_ospeed);
	}
	return 0;
}

static void print_rs485(const char *word, const struct serial_rs485 *rs485)
{
	printf("%s %#x %u %u\n", word, rs485->flags, rs485->delay_rts_before_send,
	       rs485->delay_rts_after_send);
}

static void say(int fd, const char *word)
{
	struct serial_rs485 rs485;

	if (write(fd, word, strlen(word)) != (ssize_t)strlen(word))
		fail("write");
	if (ioctl(fd, TCSBRK, 1) != 0)
		fail("tcdrain");
	if (ioctl(fd, TIOCGRS485, &rs485) != 0)
		fail("TIOCGRS485");
	print_rs485(word, &rs485);
}

static int rs485(const char *device, bool off)
{
	struct serial_rs485 settings = {0};
	int fd = open_line(device);

	if (off && ioctl(fd, TIOCSRS485, &settings) != 0)
		fail("TIOCSRS485");
	if (ioctl(fd, TIOCGRS485, &settings) != 0)
		fail("TIOCGRS485");
	print_rs485(device, &settings);
	return 0;
}

static int direction(unsigned flags, unsigned before, unsigned after, const char *device)
{
	struct serial_rs485 rs485 = {
	    .flags = flags, .delay_rts_before_send = before, .delay_rts_after_send = after};
	int fd = open_line(device);

	set_line(fd, "8N1", 115200);
	if (ioctl(fd, TIOCSRS485, &rs485) != 0)
		fail("TIOCSRS485");
	print_rs485("set", &rs485);
	say(fd, "after-setting.");
	set_line(fd, "8E1", 19200);
	say(fd, "after-tcsetattr.");
	set_line(fd, "8N1h", 115200);
	say(fd, "with-crtscts.");
	close(fd);
	fd = open_line(device);
	set_line(fd, "8N1", 115200);
	say(fd, "after-open.");
	int rts = TIOCM_RTS;
	ioctl(fd, TIOCMBIC, &rts);
	ioctl(fd, TIOCMBIS, &rts);
	say(fd, "after-rts.");
	rs485.flags = 0;
	if (ioctl(fd, TIOCSRS485, &rs485) != 0)
		fail("TIOCSRS485");
	say(fd, "without.");
	return 0;
}

int main(int argc, char **argv)
{
	const char *what = argc > 1 ? argv[1] : "";

	if (!strcmp(what, "duplex") && argc > 5 && argc <= 5 + LINES_MAX)
		return duplex(argv[2], (unsigned)atoi(argv[3]), (uint32_t)atoi(argv[4]), (unsigned)argc - 5,
			      argv + 5);
	if (!strcmp(what, "receive") && argc == 6)
		return receive(argv[2], (unsigned)atoi(argv[3]), (uint32_t)atoi(argv[4]), argv[5]);
	if (!strcmp(what, "echo") && argc > 5)
		return echo(argv[2], (uint32_t)atoi(argv[3]), argv[4], (unsigned)argc - 5, argv + 5);
	if (!strcmp(what, "speeds") && argc > 3)
		return speeds(argv[2], (unsigned)argc - 3, argv + 3);
	if (!strcmp(what, "direction") && argc == 6)
		return direction((unsigned)strtoul(argv[2], NULL, 0), (unsigned)atoi(argv[3]),
				 (unsigned)atoi(argv[4]), argv[5]);
	if (!strcmp(what, "rs485") && (argc == 3 || argc == 4))
		return rs485(argv[2], argc == 4);
	fprintf(stderr, "usage: see the head of serial-line.c\n");
	return 2;
}
