/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/proposed.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "config/page.h"
#include "rtud/config_parts.h"
#include "rtud/history.h"
#include "rtud/supervisor.h"

#define FORMER "setup.former" /* in the map's folder, for rtud alone */

const char *proposed_source(const struct supervise_options *options)
{
	return options->kept != NULL && access(options->kept, F_OK) == 0 ? options->kept : options->file;
}

const char *proposed_target(const struct supervise_options *options)
{
	return options->kept != NULL ? options->kept : options->file;
}

void proposed_path(const struct supervisor *supervisor, const char *name, char *path)
{
	snprintf(path, PATH_MAX, "%s/%s", supervisor->options->map, name);
}

/* Whole or not at all; nobody else writes there. */
bool proposed_put(const struct supervisor *supervisor, const char *name, const char *octets, size_t length,
		  uid_t user, gid_t group)
{
	const mode_t mode = user != (uid_t)-1 ? 0400 : group != (gid_t)-1 ? 0640 : 0600;
	char path[PATH_MAX], new_path[PATH_MAX];
	FILE *file;
	bool done;
	int fd;

	proposed_path(supervisor, name, path);
	if (snprintf(new_path, sizeof(new_path), "%s.%d.new", path, (int)getpid()) >= (int)sizeof(new_path))
		return false;
	unlink(new_path);
	fd = open(new_path, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
	file = fd < 0 ? NULL : fdopen(fd, "w");
	if (file == NULL)
		return false;
	done = fwrite(octets, 1, length, file) == length && fchown(fd, user, group) == 0 &&
	       fchmod(fd, mode) == 0;
	done = fclose(file) == 0 && done;
	if (done && rename(new_path, path) == 0)
		return true;
	unlink(new_path);
	return false;
}

const struct web_setup *proposed_wish(const struct map *map, const struct map_request *request)
{
	const struct web_section *section = map_section(map, request->requester, sizeof(*section));

	return section != NULL ? &section->setup : NULL;
}

/* ---- beside rtud: what is proposed ---------------------------------------------------------- */

bool proposed_say_errno(FILE *report, const char *what)
{
	fprintf(report, "%s: %s\n", what, strerror(errno));
	return false;
}

/* The file on the disk, as long as it is the one that runs. */
static bool read_in_force(const struct supervisor *supervisor, struct history_text *out, FILE *report)
{
	const char *file = proposed_source(supervisor->options);

	if (!history_read(file, out))
		return proposed_say_errno(report, file);
	if (out->hash == supervisor->setup.in_force)
		return true;
	fprintf(report,
		"%s is not what runs: somebody has changed it, or reloaded another one. Put it into "
		"force with rtuctl reload, then load it here again\n",
		file);
	free(out->octets);
	return false;
}

static bool take_text(const struct supervisor *supervisor, FILE *report)
{
	const struct web_setup *wish = proposed_wish(supervisor->map, &supervisor->setup.request);
	const uint32_t length = *(const volatile uint32_t *)&wish->length;

	if (length > SETUP_TEXT_MAX) {
		fprintf(report, "is longer than the page may hand over, %u octets\n", SETUP_TEXT_MAX);
		return false;
	}
	return proposed_put(supervisor, PROPOSED_FILE, wish->text, length, (uid_t)-1, (gid_t)-1) ||
	       proposed_say_errno(report, PROPOSED_FILE);
}

/* As the file's reader has it: of a key that is given twice, which that refuses, the last. */
static json_t *parse(const struct history_text *text)
{
	json_error_t error;
	json_t *json = json_loadb(text->octets, text->length, JSON_REJECT_DUPLICATES, &error);

	if (json == NULL && json_error_code(&error) == json_error_duplicate_key)
		json = json_loadb(text->octets, text->length, 0, &error);
	return json;
}

/*
 * What the page may not propose is not read, since a file names others, which rtud may open and the page may not. One that is no
 * JSON names none: it is read on, so that its reader says where.
 */
static enum setup_verdict compare(const struct supervisor *supervisor, const struct history_text *in_force,
				  const struct history_text *proposed, FILE *report)
{
	const struct config_part *parts[KINDS_MAX];
	struct config_rule rules[CONFIG_FILE_KEYS_MAX];
	const struct config_inside file = {.rules = rules,
					   .count = config_file_rules(parts, kinds_parts(parts), rules)};
	struct config_report said = {
	    .messages = report,
	    .source = {proposed_source(supervisor->options), proposed->octets, proposed->length},
	};
	json_t *was = parse(in_force), *is = parse(proposed);
	enum setup_verdict verdict = SETUP_ONLY;

	if (is != NULL) {
		config_check_page(&said, was, is, &file);
		config_report_end(&said);
		verdict = said.errors == 0 ? SETUP_READ : SETUP_REFUSED;
	}
	if (verdict == SETUP_REFUSED)
		fputs("what else is wrong is not looked for until the page may change all of this\n", report);
	json_decref(was);
	json_decref(is);
	return verdict;
}

static enum setup_verdict judge(const struct supervisor *supervisor, enum setup_job job,
				const char *proposed_path, FILE *report)
{
	struct history_text in_force, proposed;
	enum setup_verdict verdict = SETUP_REFUSED;

	if (!read_in_force(supervisor, &in_force, report))
		return SETUP_REFUSED;
	if (supervisor->setup.base != in_force.hash)
		fputs("the file has changed since you have loaded it: load it again\n", report);
	else if (job == SETUP_JOB_APPLY &&
		 !proposed_put(supervisor, FORMER, in_force.octets, in_force.length, (uid_t)-1, (gid_t)-1))
		proposed_say_errno(report, FORMER);
	else if (!history_read(proposed_path, &proposed))
		proposed_say_errno(report, PROPOSED_FILE);
	else {
		verdict = compare(supervisor, &in_force, &proposed, report);
		supervisor->setup.told->text = proposed.hash;
		if (job == SETUP_JOB_APPLY && proposed.hash != supervisor->setup.proposal.text) {
			fputs("this is not what was checked: check it again\n", report);
			verdict = SETUP_REFUSED;
		}
		free(proposed.octets);
	}
	free(in_force.octets);
	return verdict;
}

enum setup_verdict proposed_prepare(const struct supervisor *supervisor, enum setup_job job, char *instead,
				    FILE *report)
{
	proposed_path(supervisor, job == SETUP_JOB_BACK ? FORMER : PROPOSED_FILE, instead);
	if (job == SETUP_JOB_BACK)
		return SETUP_READ;
	if (job == SETUP_JOB_CHECK && !take_text(supervisor, report))
		return SETUP_REFUSED;
	return judge(supervisor, job, instead, report);
}
