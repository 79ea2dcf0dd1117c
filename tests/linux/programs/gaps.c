/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * gaps ONE OTHER BAUD BYTES SHORTEST LONGEST: random bytes between two serial ports at one line, both ways at once, in
 * bursts with silences of so many microseconds, below a second, between them. Each byte must come, and no other.
 */

#include <fcntl.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define BURST      40
#define LOOK_US    10
#define SILENCE_MS 10000

static void fail(const char *what)
{
	perror(what);
	exit(1);
}

static speed_t speed(unsigned baud)
{
	switch (baud) {
	case 9600:
		return B9600;
	case 38400:
		return B38400;
	case 115200:
		return B115200;
	default:
		fprintf(stderr, "%u baud is not known here\n", baud);
		exit(1);
	}
}

static int port(const char *path, unsigned baud)
{
	struct termios settings;
	const int fd = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK);

	if (fd < 0 || tcgetattr(fd, &settings))
		fail(path);
	cfmakeraw(&settings);
	cfsetspeed(&settings, speed(baud));
	settings.c_cflag |= CLOCAL | CREAD;
	if (tcsetattr(fd, TCSAFLUSH, &settings))
		fail(path);
	return fd;
}

/* The same bytes at both ends. */
static uint32_t next_random(uint32_t *state)
{
	*state = *state * 1664525 + 1013904223;
	return *state >> 16;
}

static void sleep_us(unsigned us)
{
	nanosleep(&(struct timespec){.tv_nsec = us * 1000L}, NULL);
}

/* The last stop bit too. */
static void wait_until_sent(int fd)
{
	for (int state = 0; !(state & TIOCSER_TEMT); sleep_us(LOOK_US))
		if (ioctl(fd, TIOCSERGETLSR, &state))
			fail("TIOCSERGETLSR");
}

static void send_all(int fd, unsigned bytes, unsigned shortest, unsigned longest)
{
	uint32_t content = 1, shape = 2;

	while (bytes) {
		uint8_t burst[BURST];
		unsigned count = 1 + next_random(&shape) % BURST;
		const unsigned gap = shortest + next_random(&shape) % (longest - shortest + 1);

		if (count > bytes)
			count = bytes;
		for (unsigned i = 0; i < count; i++)
			burst[i] = (uint8_t)next_random(&content);
		if (write(fd, burst, count) != (ssize_t)count)
			fail("write");
		bytes -= count;
		wait_until_sent(fd);
		sleep_us(gap);
	}
}

static void receive_all(int fd, unsigned bytes)
{
	struct pollfd line = {.fd = fd, .events = POLLIN};
	uint32_t content = 1;
	unsigned seen = 0, reads = 0;

	for (; seen < bytes; reads++) {
		uint8_t buffer[4096];

		if (poll(&line, 1, SILENCE_MS) != 1) {
			printf("silence after %u of %u bytes\n", seen, bytes);
			exit(1);
		}
		const ssize_t count = read(fd, buffer, sizeof(buffer));

		if (count <= 0)
			fail("read");
		for (ssize_t i = 0; i < count; i++, seen++) {
			const uint8_t wanted = (uint8_t)next_random(&content);

			if (buffer[i] != wanted) {
				printf("byte %u is %02x, not %02x\n", seen, buffer[i], wanted);
				exit(1);
			}
		}
	}
	printf("%u bytes in %u reads\n", seen, reads);
}

static pid_t fork_off(void)
{
	const pid_t child = fork();

	if (child < 0)
		fail("fork");
	return child;
}

int main(int argc, char **argv)
{
	if (argc != 7) {
		fputs("gaps ONE OTHER BAUD BYTES SHORTEST LONGEST\n", stderr);
		return 1;
	}
	const unsigned baud = (unsigned)atoi(argv[3]), bytes = (unsigned)atoi(argv[4]);
	const int ports[] = {port(argv[1], baud), port(argv[2], baud)};
	int failed = 0;

	for (int i = 0; i < 2; i++) {
		if (!fork_off()) {
			receive_all(ports[i], bytes);
			return 0;
		}
		if (!fork_off()) {
			send_all(ports[i], bytes, (unsigned)atoi(argv[5]), (unsigned)atoi(argv[6]));
			return 0;
		}
	}
	for (int status; wait(&status) > 0;)
		failed |= status;
	return failed != 0;
}
