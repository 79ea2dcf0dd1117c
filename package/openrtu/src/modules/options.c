/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/options.h"

#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>

static bool parse(int argc, char **argv, struct options *out)
{
	static const struct option known[] = {
	    {"map", required_argument, NULL, 'm'},
	    {"module", required_argument, NULL, 'n'},
	    {"dev", required_argument, NULL, 'd'},
	    {"filter", required_argument, NULL, 'f'},
	    {0},
	};

	*out = (struct options){.devices = "/dev", .filter_fd = -1};
	for (int option; (option = getopt_long(argc, argv, "", known, NULL)) != -1;) {
		if (option == 'm')
			out->map = optarg;
		else if (option == 'n')
			out->module = optarg;
		else if (option == 'd')
			out->devices = optarg;
		else if (option == 'f')
			out->filter_fd = atoi(optarg);
		else
			return false;
	}
	return out->map != NULL && out->module != NULL && optind == argc;
}

bool options_parse(int argc, char **argv, const char *program, struct options *out)
{
	if (parse(argc, argv, out))
		return true;
	fprintf(stderr,
		"usage: %s --map DIR --module NAME [--dev DIR] [--filter FD]\n"
		"rtud starts it so. DIR of --dev holds the ports that the configuration names without a "
		"path; behind FD "
		"is the filter of its system calls.\n",
		program);
	return false;
}
