/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The files of a configuration, and the templates in them. A file includes others by names relative to its own folder.
 * Each is read once, must be a regular file and not one of those that include it; all together they are no larger than
 * one file may be.
 */
#include "config/files.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "config/mistake.h"
#include "config/places.h"

#define DEPTH_MAX     8 /* of files that include each other */
#define TEMPLATES_MAX 256
#define REASON_SIZE   192

enum { INCLUDED_INCLUDE, INCLUDED_TEMPLATES, INCLUDED_ABOUT, INCLUDED_KEYS };
static const struct config_rule included_rules[INCLUDED_KEYS] = {
    [INCLUDED_INCLUDE] = {CONFIG_KEY_INCLUDE, CONFIG_ARRAY, .high = CONFIG_FILES_MAX},
    [INCLUDED_TEMPLATES] = {CONFIG_KEY_TEMPLATES, CONFIG_OBJECT},
    [INCLUDED_ABOUT] = {"about", CONFIG_ANYTHING}, /* for readers */
};

/* ---- one file ---------------------------------------------------------------------------- */

static void report_json_error(struct config_report *report, const struct config_source *source,
			      const json_error_t *error)
{
	struct config_spot spot;
	const char *mistake = config_mistake(source, error, &spot);

	report->errors++;
	if (mistake != NULL) {
		fprintf(report->messages, "%s:%u:%u: %s\n", source->path, spot.line, spot.column, mistake);
		return;
	}
	fprintf(report->messages, "%s:%d:%d: ", source->path, error->line, error->column);
	for (const char *c = error->text; *c != '\0'; c++)
		fputc(iscntrl((unsigned char)*c) ? '?' : *c, report->messages);
	fputc('\n', report->messages);
}

/* A key that is given twice is an error, but not one that hides all others. */
static json_t *parse(struct config_report *report, const struct config_source *source)
{
	json_error_t error;
	json_t *root = json_loadb(source->text, source->length, JSON_REJECT_DUPLICATES, &error);

	if (root == NULL)
		report_json_error(report, source, &error);
	if (root == NULL && json_error_code(&error) == json_error_duplicate_key)
		root = json_loadb(source->text, source->length, 0, &error);
	return root;
}

/* Reads up to one octet more than all files may have, so that a larger one is noticed. False with errno. */
static bool read_text(struct config_file *file, FILE *stream, size_t room)
{
	char *shorter;

	file->text = malloc(room + 1);
	if (file->text == NULL)
		return false;
	file->source.length = fread(file->text, 1, room + 1, stream);
	if (ferror(stream))
		return false;
	shorter = realloc(file->text, file->source.length + 1);
	if (shorter != NULL)
		file->text = shorter;
	file->source.path = file->path;
	file->source.text = file->text;
	return true;
}

/* Reads the next file. False: reason says why not. */
static bool take_text(struct config_loader *loader, int fd, bool regular, char reason[REASON_SIZE])
{
	struct config_file *file = &loader->files[loader->file_count];
	FILE *stream = fd < 0 ? NULL : fdopen(fd, "rb");
	struct stat status;
	bool read = false;

	if (stream == NULL || fstat(fd, &status) < 0) {
		snprintf(reason, REASON_SIZE, "cannot be read: %s", strerror(errno));
	} else if (regular && !S_ISREG(status.st_mode)) {
		snprintf(reason, REASON_SIZE, "is not a regular file");
	} else if (!read_text(file, stream, CONFIG_FILE_SIZE_MAX - loader->bytes)) {
		snprintf(reason, REASON_SIZE, "cannot be read: %s", strerror(errno));
	} else {
		file->device = status.st_dev;
		file->inode = status.st_ino;
		loader->bytes += file->source.length;
		read = loader->bytes <= CONFIG_FILE_SIZE_MAX;
		if (!read)
			snprintf(reason, REASON_SIZE, "is too large, expected at most %u bytes%s",
				 CONFIG_FILE_SIZE_MAX, regular ? " in all files" : "");
	}
	if (stream != NULL)
		fclose(stream);
	return read;
}

/* ---- includes ---------------------------------------------------------------------------- */

static void read_includes(struct config_loader *loader, const struct config_file *file, unsigned depth);

static struct config_place whole(const struct config_source *source)
{
	return (struct config_place){.source = source};
}

/* The included file's path: relative to the folder of the one that includes it. NULL: no memory. */
static char *path_beside(const char *includer, const char *name)
{
	const char *slash = strrchr(includer, '/');
	int folder = name[0] == '/' || slash == NULL ? 0 : (int)(slash - includer) + 1;
	char *path;

	return asprintf(&path, "%.*s%s", folder, includer, name) < 0 ? NULL : path;
}

static bool is_same_file(const struct config_file *a, const struct config_file *b)
{
	return a->device == b->device && a->inode == b->inode;
}

static bool includes(const struct config_file *file, const struct config_file *other)
{
	for (; file != NULL; file = file->includer)
		if (is_same_file(file, other))
			return true;
	return false;
}

static bool is_read_already(const struct config_loader *loader, const struct config_file *file)
{
	for (uint32_t i = 0; i < loader->file_count; i++)
		if (is_same_file(&loader->files[i], file))
			return true;
	return false;
}

static void forget(struct config_file *file)
{
	free(file->path);
	free(file->text);
	*file = (struct config_file){.path = NULL};
}

/* The next file has a text: reads what is in it. */
static void take_included(struct config_loader *loader, const struct config_place *here,
			  const struct config_file *includer, unsigned depth)
{
	struct config_file *file = &loader->files[loader->file_count];

	if (includes(includer, file)) {
		config_error(&loader->report, here, "\"%s\" includes itself here", file->path);
		forget(file);
		return;
	}
	if (is_read_already(loader, file)) {
		forget(file);
		return;
	}
	loader->file_count++;
	file->root = parse(&loader->report, &file->source);
	if (file->root != NULL)
		read_includes(loader, file, depth + 1);
}

static void include(struct config_loader *loader, const struct config_place *here, const json_t *name,
		    const struct config_file *includer, unsigned depth)
{
	struct config_file *file = &loader->files[loader->file_count];
	char reason[REASON_SIZE];

	if (json_string_length(name) == 0) {
		config_error(&loader->report, here, "is not a file name, expected a string");
		return;
	}
	if (depth == DEPTH_MAX || loader->file_count == CONFIG_FILES_MAX) {
		config_error(&loader->report, here, "is one file too many, expected at most %d%s",
			     depth == DEPTH_MAX ? DEPTH_MAX : CONFIG_FILES_MAX,
			     depth == DEPTH_MAX ? ", each included by the one before" : "");
		return;
	}
	*file = (struct config_file){.includer = includer,
				     .path = path_beside(includer->path, json_string_value(name))};
	if (file->path == NULL) {
		config_out_of_memory(&loader->report);
		return;
	}
	errno = 0; /* what is no error of the system leaves it */
	/* A name may lead to a pipe or a terminal, for which nobody shall wait. */
	if (take_text(loader, open(file->path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY), true, reason)) {
		take_included(loader, here, includer, depth);
		return;
	}
	config_error(&loader->report, here, "\"%s\" %s%s", file->path, reason,
		     errno == ENOENT ? "; OpenRTU's templates are in " OPENRTU_TEMPLATES : "");
	forget(file);
}

static void read_includes(struct config_loader *loader, const struct config_file *file, unsigned depth)
{
	const struct config_place root = whole(&file->source);
	const struct config_place array = config_key_of(&root, CONFIG_KEY_INCLUDE);
	const json_t *name;
	size_t i;

	json_array_foreach(json_object_get(file->root, CONFIG_KEY_INCLUDE), i, name)
	{
		const struct config_place here = config_element_of(&array, i);

		include(loader, &here, name, file, depth);
	}
}

/* ---- templates --------------------------------------------------------------------------- */

struct config_place config_template_file(const struct config_template *template,
					 const struct config_place *instance)
{
	return (struct config_place){.source = template->source, .instance = instance};
}

struct config_template *config_find_template(const struct config_loader *loader, const char *name)
{
	for (uint32_t i = 0; i < loader->template_count; i++)
		if (strcmp(loader->templates[i].name, name) == 0)
			return &loader->templates[i];
	return NULL;
}

static void add_template(struct config_loader *loader, const struct config_file *file, const char *name,
			 const json_t *json)
{
	const struct config_place root = whole(&file->source);
	const struct config_place templates = config_key_of(&root, CONFIG_KEY_TEMPLATES);
	const struct config_place here = config_key_of(&templates, name);
	const struct config_template *other = config_find_template(loader, name);

	if (other != NULL) {
		const struct config_place other_root = whole(other->source);
		const struct config_place others = config_key_of(&other_root, CONFIG_KEY_TEMPLATES);
		const struct config_place there = config_key_of(&others, name);
		char where[CONFIG_WHERE_SIZE];

		config_place_where(&loader->report, &there, where);
		config_error(&loader->report, &here, "has the name of %s", where);
	} else if (loader->template_count == TEMPLATES_MAX) {
		config_error(&loader->report, &here, "is one template too many, expected at most %d",
			     TEMPLATES_MAX);
	} else {
		loader->templates[loader->template_count++] =
		    (struct config_template){.name = name, .json = json, .source = &file->source};
	}
}

static void add_templates(struct config_loader *loader, const struct config_file *file)
{
	const json_t *templates = json_object_get(file->root, CONFIG_KEY_TEMPLATES);
	const char *name;
	json_t *json;

	json_object_foreach((json_t *)templates, name, json)
	{
		add_template(loader, file, name, json);
	}
}

void config_check_included(struct config_loader *loader)
{
	struct config_value values[INCLUDED_KEYS];

	for (uint32_t i = 1; i < loader->file_count; i++) {
		const struct config_place root = whole(&loader->files[i].source);

		if (loader->files[i].root != NULL)
			config_read_keys(&loader->report, &root, loader->files[i].root, included_rules,
					 INCLUDED_KEYS, values);
	}
}

/* ---- all --------------------------------------------------------------------------------- */

void *config_allocate(uint32_t count, size_t size)
{
	return calloc(count > 0 ? count : 1, size);
}

bool config_read_files(struct config_loader *loader, const char *path, const char *instead)
{
	struct config_file *file = &loader->files[0];
	char reason[REASON_SIZE];

	loader->report.source = (struct config_source){.path = path, .text = ""};
	loader->kept = json_array();
	loader->templates = calloc(TEMPLATES_MAX, sizeof(*loader->templates));
	*file = (struct config_file){.path = strdup(path)};
	if (loader->kept == NULL || loader->templates == NULL || file->path == NULL) {
		config_out_of_memory(&loader->report);
		return false;
	}
	if (!take_text(loader, open(instead != NULL ? instead : path, O_RDONLY | O_CLOEXEC), false, reason)) {
		fprintf(loader->report.messages, "%s: %s\n", path, reason);
		return false;
	}
	loader->file_count = 1;
	loader->report.source = file->source;
	file->root = parse(&loader->report, &file->source);
	if (file->root == NULL)
		return false;
	read_includes(loader, file, 0);
	for (uint32_t i = 0; i < loader->file_count; i++)
		add_templates(loader, &loader->files[i]);
	return true;
}

void config_free_files(struct config_loader *loader)
{
	for (uint32_t i = 0; i < loader->file_count; i++)
		json_decref(loader->files[i].root);
	for (uint32_t i = 0; i < CONFIG_FILES_MAX; i++)
		forget(&loader->files[i]);
	json_decref(loader->kept);
	free(loader->templates);
}
