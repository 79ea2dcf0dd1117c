/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "process/options.h"

#include <errno.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>

static void print_usage(FILE *out)
{
	fprintf(out,
		"usage: %s --map DIR --module NAME [--dev DIR] [--filter FD] [--socket FD] [--file FD]\n"
		"\n"
		"A module of OpenRTU's gateway, which rtud starts.\n"
		"\n"
		"  --map DIR      folder of the point map\n"
		"  --module NAME  its name in the map\n"
		"  --dev DIR      folder of the ports that the configuration names without a path  [/dev]\n"
		"  --filter FD    open descriptor of the filter of its system calls  [none]\n"
		"  --socket FD    open descriptor of what rtud has opened for it  [none]\n"
		"  --file FD      open descriptor of a file that it hands out  [none]\n"
		"  --help         this text\n"
		"  --version      the version\n",
		program_invocation_short_name);
}

static bool parse(int argc, char **argv, struct options *out)
{
	static const struct option known[] = {
	    {"map", required_argument, NULL, 'm'},
	    {"module", required_argument, NULL, 'n'},
	    {"dev", required_argument, NULL, 'd'},
	    {"filter", required_argument, NULL, 'f'},
	    {"socket", required_argument, NULL, 's'},
	    {"file", required_argument, NULL, 'o'},
	    {"help", no_argument, NULL, 'h'},
	    {"version", no_argument, NULL, 'V'},
	    {NULL, 0, NULL, 0},
	};

	*out = (struct options){.devices = "/dev", .socket_fd = -1, .file_fd = -1, .filter_fd = -1};
	for (int option; (option = getopt_long(argc, argv, "", known, NULL)) != -1;) {
		switch (option) {
		case 'm':
			out->map = optarg;
			break;
		case 'n':
			out->module = optarg;
			break;
		case 'd':
			out->devices = optarg;
			break;
		case 'f':
			out->filter_fd = atoi(optarg);
			break;
		case 's':
			out->socket_fd = atoi(optarg);
			break;
		case 'o':
			out->file_fd = atoi(optarg);
			break;
		case 'h':
			print_usage(stdout);
			exit(0);
		case 'V':
			printf("%s (OpenRTU) " OPENRTU_VERSION "\n", program_invocation_short_name);
			exit(0);
		default:
			return false;
		}
	}
	return out->map != NULL && out->module != NULL && optind == argc;
}

bool options_parse(int argc, char **argv, struct options *out)
{
	if (parse(argc, argv, out))
		return true;
	print_usage(stderr);
	return false;
}
