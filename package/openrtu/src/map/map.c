/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The segments: creating them, attaching to them, letting go. */
#include "map/map.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "map/layout.h"
#include "map/supervise.h"

#define FILE_NAME_SIZE (MAP_NAME_SIZE + 8)

__attribute__((format(printf, 2, 3))) static int fail(char *error, const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(error, MAP_ERROR_SIZE, format, arguments);
	va_end(arguments);
	return -1;
}

static void segment_file(char *name, const char *module)
{
	snprintf(name, FILE_NAME_SIZE, "%s.seg", module);
}

static void bell_file(char *name, const char *module)
{
	snprintf(name, FILE_NAME_SIZE, "%s.bell", module);
}

/* ---- create ------------------------------------------------------------------------------ */

/* The kernel keeps modules apart by their users. 0 is of those that rtud starts no process for. */
static int check_users(const struct map_config *config, char *error)
{
	for (uint32_t i = 0; i < config->module_count; i++)
		for (uint32_t j = i + 1; j < config->module_count; j++)
			if (config->modules[i].user != 0 &&
			    config->modules[i].user == config->modules[j].user)
				return fail(error,
					    "%s and %s would run as one user, number %u of the modules'",
					    config->modules[i].name, config->modules[j].name,
					    config->modules[i].user);
	return 0;
}

static int take_modules(struct directory *directory, const struct map_config *config, char *error)
{
	if (config->module_count == 0 || config->module_count > MAP_MODULES_MAX ||
	    !(config->modules[MAP_RTUD].flags & MAP_IS_SUPERVISOR))
		return fail(error, "a map holds at most %d modules, with rtud as the first", MAP_MODULES_MAX);
	if (check_users(config, error) < 0)
		return -1;
	directory->module_count = config->module_count;
	for (uint32_t i = 0; i < config->module_count; i++)
		directory->modules[i].plan = config->modules[i];
	for (uint32_t i = 0; i < config->set_count; i++)
		if (config->sets[i].module >= config->module_count ||
		    !(config->modules[config->sets[i].module].flags & MAP_MAY_OWN))
			return fail(error, "the set of points %s belongs to no module that may own it",
				    config->sets[i].name);
	return 0;
}

static void assign_slots(struct directory *directory, const struct map_config *config)
{
	for (uint32_t i = 0; i < config->point_count; i++) {
		struct map_point *point = &config->points[i];
		struct module_entry *owner = &directory->modules[config->sets[point->set].module];

		point->slot = owner->point_count++;
		point->command = (point->flags & MAP_POINT_COMMAND) ? owner->command_count++ : MAP_NONE;
		if (point->type == MAP_COUNTER)
			point->extra = owner->total_count++;
		else if (is_measured(point))
			point->extra = owner->parameter_count++;
	}
}

struct address_key {
	uint64_t key; /* CA, IOA */
	uint32_t point;
};

static uint64_t address_key(const struct map_config *config, uint32_t point)
{
	return (uint64_t)config->sets[config->points[point].set].ca << 32 | config->points[point].ioa;
}

static int compare_keys(const void *left, const void *right)
{
	const struct address_key *a = left, *b = right;

	return (a->key > b->key) - (a->key < b->key);
}

static int index_addresses(const struct map_config *config, uint32_t *by_address)
{
	struct address_key *keys = calloc(config->point_count + 1, sizeof(*keys));

	if (!keys)
		return -1;
	for (uint32_t i = 0; i < config->point_count; i++)
		keys[i] = (struct address_key){address_key(config, i), i};
	qsort(keys, config->point_count, sizeof(*keys), compare_keys);
	for (uint32_t i = 0; i < config->point_count; i++)
		by_address[i] = keys[i].point;
	free(keys);
	return 0;
}

/* A new file of that size, all zero and really there, so that a full tmpfs shows now and not as SIGBUS. */
static void *create_segment(int directory_fd, const char *module, size_t size, uint32_t group, char *error)
{
	const mode_t mode = group ? 0640 : 0600;
	char name[FILE_NAME_SIZE];
	void *memory = MAP_FAILED;
	int fd;

	segment_file(name, module);
	unlinkat(directory_fd, name, 0);
	fd = openat(directory_fd, name, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, mode);
	if (fd < 0) {
		fail(error, "cannot create the map's segment %s: %s", name, strerror(errno));
		return NULL;
	}
	if (fchmod(fd, mode) < 0 || (group && fchown(fd, (uid_t)-1, group) < 0) ||
	    (errno = posix_fallocate(fd, 0, (off_t)size)) != 0 ||
	    (memory = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0)) == MAP_FAILED)
		fail(error, "cannot give the map's segment %s %zu bytes: %s", name, size, strerror(errno));
	close(fd);
	return memory == MAP_FAILED ? NULL : memory;
}

static int create_bell(int directory_fd, const char *module, uint32_t group, char *error)
{
	char name[FILE_NAME_SIZE];

	bell_file(name, module);
	unlinkat(directory_fd, name, 0);
	if (mkfifoat(directory_fd, name, 0660) < 0 || fchmodat(directory_fd, name, 0660, 0) < 0 ||
	    (group && fchownat(directory_fd, name, (uid_t)-1, group, AT_SYMLINK_NOFOLLOW) < 0))
		return fail(error, "cannot create the bell %s: %s", name, strerror(errno));
	return 0;
}

static void sign_header(struct segment_header *header, size_t size)
{
	header->layout = MAP_LAYOUT;
	header->fingerprint = layout_fingerprint();
	header->size = (uint32_t)size;
	header->next_request = 1;
	atomic_thread_fence(memory_order_release);
	header->magic = MAP_MAGIC;
}

static int create_module_segment(int directory_fd, const struct module_entry *entry,
				 const struct map_config *config, uint32_t group, char *error)
{
	struct layout layout = layout_of(entry, config);
	void *memory = create_segment(directory_fd, entry->plan.name, layout.size, group, error);

	if (!memory)
		return -1;
	sign_header(memory, layout.size);
	munmap(memory, layout.size);
	return 0;
}

/* An empty table may be no table at all. */
static void copy_table(uint8_t *to, const void *table, size_t size)
{
	if (size)
		memcpy(to, table, size);
}

static int fill_rtud_segment(uint8_t *memory, const struct layout *layout, struct directory *directory,
			     const struct map_config *config)
{
	directory->starts = 1;
	directory->settings = config->settings;
	directory->set_count = config->set_count;
	directory->point_count = config->point_count;
	directory->names_size = config->names_size;
	directory->section_count = config->section_count;
	for (uint32_t i = 0; i < config->section_count; i++)
		directory->sections[i] = (struct section_entry){
		    config->sections[i].id, config->sections[i].record_size, config->sections[i].count};
	memcpy(memory + layout->directory, directory, sizeof(*directory));
	copy_table(memory + layout->sets, config->sets, config->set_count * sizeof(*config->sets));
	copy_table(memory + layout->points, config->points, config->point_count * sizeof(*config->points));
	copy_table(memory + layout->names, config->names, config->names_size);
	for (uint32_t i = 0; i < config->section_count; i++)
		copy_table(memory + layout->sections[i], config->sections[i].records,
			   (size_t)config->sections[i].count * config->sections[i].record_size);
	return index_addresses(config, (uint32_t *)(void *)(memory + layout->by_address));
}

static int create_segments(int directory_fd, const struct map_config *config, uint32_t group, char *error)
{
	struct directory directory = {0};
	struct layout layout;
	uint8_t *memory;
	int result;

	if (take_modules(&directory, config, error) < 0)
		return -1;
	assign_slots(&directory, config);
	for (uint32_t i = 0; i < directory.module_count; i++) {
		const struct module_entry *entry = &directory.modules[i];

		if (create_bell(directory_fd, entry->plan.name, group, error) < 0)
			return -1;
		if (i != MAP_RTUD && create_module_segment(directory_fd, entry, config, group, error) < 0)
			return -1;
	}
	layout = layout_of(&directory.modules[MAP_RTUD], config);
	memory =
	    create_segment(directory_fd, directory.modules[MAP_RTUD].plan.name, layout.size, group, error);
	if (!memory)
		return -1;
	result = fill_rtud_segment(memory, &layout, &directory, config);
	if (result == 0)
		sign_header((void *)memory, layout.size);
	else
		fail(error, "out of memory for %u points", config->point_count);
	munmap(memory, layout.size);
	return result;
}

/*
 * A folder that somebody else may write to, made before us in a place like /tmp, would let him exchange the
 * segments.
 */
static int take_directory(int fd, const char *dir, char *error)
{
	struct stat status;

	if (fstat(fd, &status) < 0 || status.st_uid != geteuid() || (status.st_mode & (S_IWGRP | S_IWOTH)))
		return fail(error,
			    "another user owns the map's folder %s or may write to it: remove it or use "
			    "another --map",
			    dir);
	if (flock(fd, LOCK_EX | LOCK_NB) < 0)
		return fail(error, "another rtud runs on the map in %s: stop it or use another --map", dir);
	return 0;
}

/* Others may pass through the folder, whatever the umask, and not open it: so nobody but this user can hold its lock. */
static int open_directory(const char *dir, char *error)
{
	bool made = mkdir(dir, 0711) == 0;
	int fd;

	if (!made && errno != EEXIST)
		return fail(error, "cannot create the map's folder %s: %s", dir, strerror(errno));
	fd = open(dir, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
	if (fd < 0)
		return fail(error, "cannot open the map's folder %s: %s", dir, strerror(errno));
	if (take_directory(fd, dir, error) == 0 && (!made || fchmod(fd, 0711) == 0))
		return fd;
	close(fd);
	return -1;
}

int map_create(struct map **map, const char *dir, const struct map_config *config, uint32_t group,
	       char *error)
{
	int fd = open_directory(dir, error);

	if (fd < 0)
		return -1;
	if (create_segments(fd, config, group, error) < 0 || map_attach(map, dir, "rtud", error) < 0) {
		close(fd);
		return -1;
	}
	close((*map)->directory_fd);
	(*map)->directory_fd = fd;
	atomic_store(&(*map)->directory->modules[MAP_RTUD].state, MAP_MODULE_RUNNING);
	atomic_store(&(*map)->directory->modules[MAP_RTUD].pid, (uint32_t)getpid());
	atomic_store(&(*map)->directory->modules[MAP_RTUD].started_s, now_s());
	return 0;
}

size_t map_size(const struct map *map)
{
	size_t size = 0;

	for (uint32_t i = 0; i < map->directory->module_count; i++)
		size += map->segments[i].size;
	return size;
}

int map_segment_open(const struct map *map, uint32_t module)
{
	char name[FILE_NAME_SIZE];

	segment_file(name, map->directory->modules[module].plan.name);
	return openat(map->directory_fd, name, O_RDWR | O_CLOEXEC | O_NOFOLLOW);
}

void map_remove(struct map *map)
{
	for (uint32_t i = 0; i < map->directory->module_count; i++) {
		char name[FILE_NAME_SIZE];

		segment_file(name, map->directory->modules[i].plan.name);
		unlinkat(map->directory_fd, name, 0);
		bell_file(name, map->directory->modules[i].plan.name);
		unlinkat(map->directory_fd, name, 0);
	}
}

/* ---- attach ------------------------------------------------------------------------------ */

static int check_header(const struct segment_header *header, size_t size, char *error)
{
	if (header->magic != MAP_MAGIC)
		return fail(error, "rtud.seg is not a segment of a point map");
	if (header->layout != MAP_LAYOUT)
		return fail(error,
			    "rtud.seg has layout %u, this program was built for layout %u: restart rtud and "
			    "all modules with the same version",
			    header->layout, MAP_LAYOUT);
	if (header->fingerprint != layout_fingerprint() || header->size != size)
		return fail(
		    error,
		    "rtud.seg has records of other sizes: the program that made it was built differently");
	return 0;
}

/* Whether rtud opened this segment for us, whose user may not. */
static bool is_handed(int directory_fd, const char *name)
{
	struct stat file, handed;

	return (fcntl(MAP_SEGMENT_FD, F_GETFL) & O_ACCMODE) == O_RDWR &&
	       fstat(MAP_SEGMENT_FD, &handed) == 0 &&
	       fstatat(directory_fd, name, &file, AT_SYMLINK_NOFOLLOW) == 0 && file.st_dev == handed.st_dev &&
	       file.st_ino == handed.st_ino;
}

/* The descriptor is closed once the segment is mapped: what takes over the process later cannot truncate the file. */
static int open_segment(int directory_fd, const char *name, bool writable)
{
	if (writable && is_handed(directory_fd, name))
		return MAP_SEGMENT_FD;
	return openat(directory_fd, name, (writable ? O_RDWR : O_RDONLY) | O_CLOEXEC | O_NOFOLLOW);
}

static void *map_file(int directory_fd, const char *module, bool writable, size_t *size, char *error)
{
	char name[FILE_NAME_SIZE];
	struct stat status;
	void *memory = MAP_FAILED;
	int fd;

	segment_file(name, module);
	fd = open_segment(directory_fd, name, writable);
	if (fd < 0) {
		fail(error, "cannot open %s: %s%s", name, strerror(errno),
		     errno == EACCES
			 ? " (rtud's user may write it, members of the modules' group may read it)"
			 : "");
		return NULL;
	}
	if (fstat(fd, &status) == 0 && status.st_size >= (off_t)sizeof(struct segment_header))
		memory = mmap(NULL, (size_t)status.st_size, writable ? PROT_READ | PROT_WRITE : PROT_READ,
			      MAP_SHARED, fd, 0);
	close(fd);
	if (memory == MAP_FAILED) {
		fail(error, "cannot map %s: it is empty, or memory is short", name);
		return NULL;
	}
	*size = (size_t)status.st_size;
	return memory;
}

/* rtud's segment first: it says what else there is, and which version. The others' headers are their owners' to write. */
static int attach_directory(struct map *map, bool writable, char *error)
{
	struct module_entry rtud = {.plan = {.flags = MAP_IS_SUPERVISOR}};
	struct layout layout = layout_of(&rtud, &(struct map_config){0});
	struct directory *directory;
	size_t size;
	uint8_t *memory = map_file(map->directory_fd, "rtud", writable, &size, error);

	if (!memory)
		return -1;
	map->segments[MAP_RTUD] = (struct segment){.header = (void *)memory, .size = size, .bell = -1};
	if (check_header((void *)memory, size, error) < 0)
		return -1;
	directory = (void *)(memory + layout.directory);
	map->config.settings = directory->settings;
	map->config.set_count = directory->set_count;
	map->config.point_count = directory->point_count;
	map->config.names_size = directory->names_size;
	for (uint32_t i = 0; i < directory->section_count; i++)
		map_add_section(&map->config, directory->sections[i].id, directory->sections[i].record_size,
				directory->sections[i].count, NULL);
	rtud = directory->modules[MAP_RTUD];
	layout = layout_of(&rtud, &map->config);
	if (layout.size != size)
		return fail(error, "rtud.seg has %zu bytes, its contents need %zu", size, layout.size);
	segment_place(&map->segments[MAP_RTUD], memory, &layout);
	map->directory = directory;
	map->config.sets = (void *)(memory + layout.sets);
	map->config.points = (void *)(memory + layout.points);
	map->by_address = (void *)(memory + layout.by_address);
	map->config.names = (char *)(memory + layout.names);
	for (uint32_t i = 0; i < map->config.section_count; i++)
		map->config.sections[i].records = memory + layout.sections[i];
	return 0;
}

static int find_self(struct map *map, const char *module, char *error)
{
	for (uint32_t i = 0; i < map->directory->module_count; i++) {
		if (strcmp(map->directory->modules[i].plan.name, module) == 0) {
			map->self = i;
			return 0;
		}
	}
	return fail(error, "the map has no module %s", module);
}

static int attach_segments(struct map *map, char *error)
{
	for (uint32_t i = 0; i < map->directory->module_count; i++) {
		const struct module_entry *entry = &map->directory->modules[i];
		struct layout layout = layout_of(entry, &map->config);
		size_t size;
		void *memory;

		if (i == MAP_RTUD)
			continue;
		memory = map_file(map->directory_fd, entry->plan.name, i == map->self, &size, error);
		if (!memory)
			return -1;
		if (size != layout.size) {
			munmap(memory, size);
			return fail(error, "%s.seg has %zu bytes, its contents need %zu", entry->plan.name,
				    size, layout.size);
		}
		segment_place(&map->segments[i], memory, &layout);
	}
	return 0;
}

/* Opened for reading too: then it never fails for want of a listener, and never raises SIGPIPE. */
static int attach_bells(struct map *map, char *error)
{
	for (uint32_t i = 0; i < map->directory->module_count; i++) {
		char name[FILE_NAME_SIZE];

		bell_file(name, map->directory->modules[i].plan.name);
		map->segments[i].bell =
		    openat(map->directory_fd, name, O_RDWR | O_NONBLOCK | O_CLOEXEC | O_NOFOLLOW);
		if (map->segments[i].bell < 0)
			return fail(error, "cannot open the bell %s: %s", name, strerror(errno));
	}
	return 0;
}

/* What was asked of the former generation is not done by this one. */
static void begin_generation(struct map *map)
{
	struct segment_header *header = map->segments[map->self].header;
	struct module_entry *entry = &map->directory->modules[map->self];

	for (uint32_t i = 0; i < map->directory->module_count; i++) {
		header->request_next[i] = ring_head(&map->segments[i].requests);
		header->answer_next[i] = ring_head(&map->segments[i].answers);
	}
	points_recover(map);
	commands_recover(map);
	totals_recover(map);
	map_heartbeat(map);
	if (entry->plan.flags & MAP_IS_LOCAL)
		atomic_fetch_add(&header->generation, 1);
	else
		atomic_store(&header->generation, atomic_load(&entry->generation));
}

static int attach_all(struct map *map, const char *module, char *error)
{
	bool is_rtud = module && strcmp(module, "rtud") == 0;

	if (attach_directory(map, is_rtud, error) < 0)
		return -1;
	if (module && find_self(map, module, error) < 0)
		return -1;
	if (attach_segments(map, error) < 0)
		return -1;
	if (!module)
		return 0;
	if (attach_bells(map, error) < 0)
		return -1;
	map->reported = calloc(map->directory->modules[map->self].point_count + 1, sizeof(*map->reported));
	map->smoothed = calloc(map->directory->modules[map->self].point_count + 1, sizeof(*map->smoothed));
	if (!map->reported || !map->smoothed)
		return fail(error, "out of memory");
	begin_generation(map);
	return 0;
}

int map_attach(struct map **out, const char *dir, const char *module, char *error)
{
	struct map *map = calloc(1, sizeof(*map));

	if (!map)
		return fail(error, "out of memory");
	map->self = MAP_NONE;
	for (unsigned i = 0; i < MAP_MODULES_MAX; i++)
		map->segments[i].bell = -1;
	map->directory_fd = open(dir, O_PATH | O_DIRECTORY | O_CLOEXEC);
	if (map->directory_fd < 0)
		fail(error, "no map in %s: %s (does rtud run?)", dir, strerror(errno));
	else if (attach_all(map, module, error) == 0) {
		*out = map;
		return 0;
	}
	map_detach(map);
	return -1;
}

void map_detach(struct map *map)
{
	for (unsigned i = 0; i < MAP_MODULES_MAX; i++) {
		if (map->segments[i].header)
			munmap(map->segments[i].header, map->segments[i].size);
		if (map->segments[i].bell >= 0)
			close(map->segments[i].bell);
	}
	if (map->directory_fd >= 0)
		close(map->directory_fd);
	free(map->reported);
	free(map->smoothed);
	free(map);
}
