/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/programs.h"

#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static bool has(const char *folder, const char *program)
{
	char path[PATH_MAX];

	return snprintf(path, sizeof(path), "%s/%s", folder, program) < (int)sizeof(path) &&
	       access(path, X_OK) == 0;
}

/* A build's folder, and that of an installation which was moved. */
static bool find_near(const char *program, char found[PATH_MAX])
{
	static const char *const near[] = {"../modules", "../libexec/openrtu"};
	char own[PATH_MAX], path[2 * PATH_MAX];
	ssize_t length = readlink("/proc/self/exe", own, sizeof(own) - 1);

	if (length < 0)
		return false;
	own[length] = '\0';
	dirname(own);
	for (size_t i = 0; i < sizeof(near) / sizeof(near[0]); i++) {
		snprintf(path, sizeof(path), "%s/%s", own, near[i]);
		if (realpath(path, found) != NULL && has(found, program))
			return true;
	}
	return false;
}

bool programs_look_for(const char *folder, const char *program)
{
	char found[PATH_MAX];
	int reason;

	if (has(folder, program))
		return true;
	reason = errno;
	fprintf(stderr, "rtud: cannot use the module %s/%s: %s\n", folder, program, strerror(reason));
	if (find_near(program, found))
		fprintf(stderr, "rtud: there is one in %s: add --modules %s\n", found, found);
	else
		fputs("rtud: name the folder of the module programs with --modules, or install them there\n",
		      stderr);
	return false;
}

bool programs_are_known(const char *folder, const char *program)
{
	char found[PATH_MAX];

	return has(folder, program) || find_near(program, found);
}
