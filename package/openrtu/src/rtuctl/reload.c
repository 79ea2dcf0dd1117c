/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A changed configuration: rtud reads it, and says what came of it in a file. */
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "rtuctl/ask.h"
#include "rtuctl/rtuctl.h"

#define PATIENCE_MS 180000 /* a long file on the board, and commands that end first */

static bool name_file(struct map *map, const char *file)
{
	char *path = map_section(map, map_self(map), MAP_PATH_SIZE);
	char full[PATH_MAX] = "";

	if (file != NULL && realpath(file, full) == NULL) {
		perror(file);
		return false;
	}
	if (strlen(full) >= MAP_PATH_SIZE) {
		fprintf(stderr, "rtuctl: %s is too long a path: %d octets at most\n", full,
			MAP_PATH_SIZE - 1);
		return false;
	}
	memcpy(path, full, strlen(full) + 1);
	return true;
}

static void print_report(const char *dir, FILE *out)
{
	char path[PATH_MAX], line[512];
	FILE *report;

	snprintf(path, sizeof(path), "%s/" MAP_REPORT, dir);
	report = fopen(path, "r");
	while (report != NULL && fgets(line, sizeof(line), report) != NULL)
		fputs(line, out);
	if (report != NULL)
		fclose(report);
}

int rtuctl_reload(struct map *map, const struct rtuctl_request *arguments)
{
	const struct map_request request = {
	    .action = MAP_RELOAD, .point = MAP_NONE, .detail = arguments->dry_run ? 1 : 0};
	struct map_answer answer;

	if (!name_file(map, arguments->arguments[0]))
		return RTUCTL_FAILED;
	if (!rtuctl_ask(map, request, PATIENCE_MS, &answer)) {
		fputs("rtuctl: rtud does not answer: see its log\n", stderr);
		return RTUCTL_FAILED;
	}
	if (answer.result == MAP_RESULT_NOT_COMMANDABLE) {
		fputs("rtuctl: rtud is busy with another change: try again when it is over\n", stderr);
		return RTUCTL_FAILED;
	}
	print_report(arguments->dir, answer.result == MAP_RESULT_DONE ? stdout : stderr);
	return answer.result == MAP_RESULT_DONE ? RTUCTL_DONE : RTUCTL_FAILED;
}
