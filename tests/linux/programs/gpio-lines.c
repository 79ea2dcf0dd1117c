// SPDX-License-Identifier: GPL-3.0-or-later
/*
 * GPIO lines by the kernel's character device, as libgpiod does it.
 *
 *   gpio-lines set LINE=0|1 ...            puts levels out
 *   gpio-lines get none|up|down LINE ...   what inputs with such a pull read
 *   gpio-lines watch rising|falling|both COUNT LINE ...
 *                                          "ready", then a line for each of COUNT edges: LINE EDGE NUMBER
 *   gpio-lines names                       what the kernel calls the lines: NUMBER NAME
 *
 * LINE is a number, 32 * bank + pin. A refused request says why and ends with status 1.
 */
#include <fcntl.h>
#include <linux/gpio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

static void die(const char *what)
{
	perror(what);
	exit(1);
}

static int open_chip(void)
{
	int chip = open("/dev/gpiochip0", O_RDWR);
	if (chip < 0)
		die("/dev/gpiochip0");
	return chip;
}

static int request(int count, char **lines, __u64 flags, __u64 values)
{
	struct gpio_v2_line_request r = {.num_lines = (unsigned)count, .consumer = "gpio-lines"};
	for (int i = 0; i < count; i++)
		r.offsets[i] = (unsigned)strtoul(lines[i], NULL, 10);
	r.config.flags = flags;
	if (flags & GPIO_V2_LINE_FLAG_OUTPUT) {
		r.config.num_attrs = 1;
		r.config.attrs[0].attr.id = GPIO_V2_LINE_ATTR_ID_OUTPUT_VALUES;
		r.config.attrs[0].attr.values = values;
		r.config.attrs[0].mask = (1ull << count) - 1;
	}
	if (ioctl(open_chip(), GPIO_V2_GET_LINE_IOCTL, &r) < 0)
		die("request");
	return r.fd;
}

static int set(int count, char **lines)
{
	__u64 values = 0;
	for (int i = 0; i < count; i++)
		if (strchr(lines[i], '=') && strchr(lines[i], '=')[1] == '1')
			values |= 1ull << i;
	request(count, lines, GPIO_V2_LINE_FLAG_OUTPUT, values);
	return 0;
}

static int get(const char *pull, int count, char **lines)
{
	__u64 bias = !strcmp(pull, "up")     ? GPIO_V2_LINE_FLAG_BIAS_PULL_UP
		     : !strcmp(pull, "down") ? GPIO_V2_LINE_FLAG_BIAS_PULL_DOWN
					     : GPIO_V2_LINE_FLAG_BIAS_DISABLED;
	struct gpio_v2_line_values values = {.mask = (1ull << count) - 1};
	if (ioctl(request(count, lines, GPIO_V2_LINE_FLAG_INPUT | bias, 0), GPIO_V2_LINE_GET_VALUES_IOCTL,
		  &values) < 0)
		die("read");
	for (int i = 0; i < count; i++)
		printf("%s=%u\n", lines[i], (unsigned)(values.bits >> i & 1));
	return 0;
}

static int watch(const char *edge, int edges, int count, char **lines)
{
	__u64 flags = GPIO_V2_LINE_FLAG_INPUT;
	if (strcmp(edge, "falling") != 0)
		flags |= GPIO_V2_LINE_FLAG_EDGE_RISING;
	if (strcmp(edge, "rising") != 0)
		flags |= GPIO_V2_LINE_FLAG_EDGE_FALLING;
	int fd = request(count, lines, flags, 0);
	puts("ready");
	fflush(stdout);
	for (int i = 0; i < edges; i++) {
		struct gpio_v2_line_event event;
		if (read(fd, &event, sizeof(event)) != sizeof(event))
			die("event");
		printf("%u %s %u\n", event.offset,
		       event.id == GPIO_V2_LINE_EVENT_RISING_EDGE ? "rising" : "falling", event.seqno);
		fflush(stdout);
	}
	return 0;
}

static int names(void)
{
	struct gpiochip_info chip;
	int fd = open_chip();
	if (ioctl(fd, GPIO_GET_CHIPINFO_IOCTL, &chip) < 0)
		die("chip");
	for (unsigned i = 0; i < chip.lines; i++) {
		struct gpio_v2_line_info line = {.offset = i};
		if (ioctl(fd, GPIO_V2_GET_LINEINFO_IOCTL, &line) == 0 && line.name[0])
			printf("%u %s\n", i, line.name);
	}
	return 0;
}

int main(int argc, char **argv)
{
	if (argc == 2 && !strcmp(argv[1], "names"))
		return names();
	if (argc >= 3 && !strcmp(argv[1], "set"))
		return set(argc - 2, argv + 2);
	if (argc >= 4 && !strcmp(argv[1], "get"))
		return get(argv[2], argc - 3, argv + 3);
	if (argc >= 5 && !strcmp(argv[1], "watch"))
		return watch(argv[2], atoi(argv[3]), argc - 4, argv + 4);
	fputs("gpio-lines set|get|watch|names ...\n", stderr);
	return 2;
}
