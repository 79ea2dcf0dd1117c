/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "control.h"
#include "plant.h"
#include "trace.h"

#define LATENCY_US     2000
#define LATENCY_US_MAX 1000000
#define PATH_SIZE      512

enum exit_code { DONE, FAILED, WRONG_USAGE };

struct options {
	const char *config;
	const char *values;
	const char *directory;
	int64_t latency_ns;
	int64_t silence_ns;
	bool serves_tcp;
	bool whole;
};

static const char help[] =
    "usage: linesim --config FILE [--values FILE] --dir DIR [--latency US] [--silence US] [--tcp]\n          "
    "     [--whole] [--trace]\n"
    "\n"
    "Simulates the Modbus RTU slaves that a gateway's configuration file describes, one pty a line.\n"
    "\n"
    "  --config FILE  the gateway's configuration\n"
    "  --values FILE  initial values: {\"3.67\": {\"coils\": {\"0\": 1}}}; all else is 0\n"
    "  --dir DIR      where the links to the lines (ttyS1, ...) and the socket \"control\" are made\n"
    "  --latency US   from the end of a request to the answer, microseconds, default 2000\n"
    "  --silence US   least silence that ends a request, microseconds, default 3.5 characters\n"
    "  --tcp          serves the ports with a host, too, which is an address of this machine\n"
    "  --whole        writes an answer when its last byte has ended, and not byte by byte\n"
    "  --trace        writes the frame log to standard output\n"
    "  --version      prints the version\n"
    "\n"
    "Prints \"ready\" when the lines are there. Ends upon SIGTERM.\n";

static struct plant plant;

static enum exit_code complain(enum exit_code code, const char *subject, const char *reason)
{
	fprintf(stderr, "linesim: %s: %s\n", subject, reason);
	return code;
}

static enum exit_code parse_options(int count, char **words, struct options *options)
{
	static const struct option known[] = {
	    {"config", required_argument, NULL, 'c'},
	    {"values", required_argument, NULL, 'v'},
	    {"dir", required_argument, NULL, 'd'},
	    {"trace", no_argument, NULL, 't'},
	    {"whole", no_argument, NULL, 'w'},
	    {"tcp", no_argument, NULL, 'p'},
	    {"latency", required_argument, NULL, 'l'},
	    {"silence", required_argument, NULL, 's'},
	    {"help", no_argument, NULL, 'h'},
	    {"version", no_argument, NULL, 'V'},
	    {NULL, 0, NULL, 0},
	};
	long latency_us = LATENCY_US, silence_us = 0;
	int option;

	while ((option = getopt_long(count, words, "", known, NULL)) != -1) {
		switch (option) {
		case 'c':
			options->config = optarg;
			break;
		case 'v':
			options->values = optarg;
			break;
		case 'd':
			options->directory = optarg;
			break;
		case 't':
			trace_to_stdout();
			break;
		case 'w':
			options->whole = true;
			break;
		case 'p':
			options->serves_tcp = true;
			break;
		case 'l':
			if (!plant_number(optarg, 0, LATENCY_US_MAX, &latency_us))
				return complain(WRONG_USAGE, "--latency",
						"expected 0 to 1000000 microseconds");
			break;
		case 's':
			if (!plant_number(optarg, 0, LATENCY_US_MAX, &silence_us))
				return complain(WRONG_USAGE, "--silence",
						"expected 0 to 1000000 microseconds");
			break;
		case 'h':
			fputs(help, stdout);
			exit(DONE);
		case 'V':
			puts("linesim (OpenRTU) " OPENRTU_VERSION);
			exit(DONE);
		default:
			return WRONG_USAGE;
		}
	}
	if (!options->config || !options->directory || optind != count) {
		fputs(help, stderr);
		return WRONG_USAGE;
	}
	options->latency_ns = latency_us * INT64_C(1000);
	options->silence_ns = silence_us * INT64_C(1000);
	return DONE;
}

static void take_options(struct line *line, const struct options *options)
{
	line->whole = options->whole;
	line_set_silence(line, options->silence_ns);
}

static enum exit_code load_plant(const struct options *options)
{
	char error[PLANT_ERROR_SIZE];

	if (plant_load_config(&plant, options->config, options->latency_ns, options->serves_tcp, error))
		return complain(WRONG_USAGE, options->config, error);
	for (size_t i = 0; i < plant.line_count; i++)
		take_options(&plant.lines[i], options);
	if (options->values && plant_load_values(&plant, options->values, error))
		return complain(WRONG_USAGE, options->values, error);
	return DONE;
}

/* The lock says that what lies in the directory belongs to no living linesim. */
static int open_directory(const char *path)
{
	const int directory = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);

	return directory >= 0 && flock(directory, LOCK_EX | LOCK_NB) ? -1 : directory;
}

static int64_t advance(void *context, int64_t now_ns)
{
	int64_t next = LOOP_NEVER;

	(void)context;
	for (size_t i = 0; i < plant.line_count; i++) {
		const int64_t line_next = line_advance(&plant.lines[i], now_ns);

		next = line_next < next ? line_next : next;
	}
	return next;
}

static enum exit_code serve_until_told(const char *control_path)
{
	unlink(control_path); /* left by a killed linesim */
	if (control_open(&plant, control_path))
		return complain(FAILED, control_path, strerror(errno));
	puts("ready");
	fflush(stdout);
	loop_run(advance, NULL);
	unlink(control_path);
	return DONE;
}

static enum exit_code simulate(const struct options *options, int directory)
{
	enum exit_code code = DONE;
	char control_path[PATH_SIZE];
	size_t open_lines = 0;

	if (loop_open())
		return complain(FAILED, "event loop", strerror(errno));
	for (; open_lines < plant.line_count && code == DONE; open_lines++)
		if (line_open(&plant.lines[open_lines], directory))
			code = complain(FAILED, plant.lines[open_lines].name, strerror(errno));
	snprintf(control_path, sizeof control_path, "%s/%s", options->directory, CONTROL_NAME);
	if (code == DONE)
		code = serve_until_told(control_path);
	while (open_lines)
		line_close(&plant.lines[--open_lines], directory);
	return code;
}

int main(int count, char **words)
{
	struct options options = {0};
	enum exit_code code = parse_options(count, words, &options);

	if (code == DONE)
		code = load_plant(&options);
	if (code != DONE)
		return code;

	const int directory = open_directory(options.directory);

	if (directory < 0)
		return complain(FAILED, options.directory,
				errno == EWOULDBLOCK ? "another linesim runs here" : strerror(errno));
	return simulate(&options, directory);
}
